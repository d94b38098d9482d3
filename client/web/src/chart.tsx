// Curves: uPlot in the page's colours, as wide as there is room, with the values under the cursor and their units.
import { useEffect, useRef, useState } from "preact/hooks";
import uPlot from "uplot";
import { significant, withUnit } from "./format";

export interface Curve {
  label: string;
  unit?: string;
  colour: string; // a custom property: "--c1"
  dashed?: boolean;
  width?: number;
  values: (number | null)[] | number[];
}

export interface ChartProps {
  title: string;
  xLabel: string; // with its unit
  yLabel: string;
  x: number[];
  curves: Curve[];
  height?: number;
  log?: boolean; // at first
  xFormat?: (x: number) => string;
  sync?: string; // cursors of charts of one name move together
  onZoom?: (range: [number, number] | null) => void; // the stretch of x that is shown, where it is not all
  testId?: string;
}

const colourOf = (name: string): string =>
  name.startsWith("--") ? getComputedStyle(document.documentElement).getPropertyValue(name).trim() : name;

const font = "12px system-ui, sans-serif";

// Of a scale over many decades only these have a line.
const decades: uPlot.Axis.Filter = (_u, splits) => {
  const many = splits.length > 30;
  return splits.map((v) => (many && Math.abs(Math.log10(v) - Math.round(Math.log10(v))) > 1e-6 ? null : v));
};

function axis(label: string, size: number, log = false): uPlot.Axis {
  const filter = log ? { filter: decades } : {};
  return {
    label,
    labelFont: font,
    labelSize: 18,
    font,
    size,
    stroke: () => colourOf("--muted"),
    grid: { stroke: () => colourOf("--grid"), width: 1, ...filter },
    ticks: { stroke: () => colourOf("--grid"), width: 1, size: 4, ...filter },
  };
}

const tick = (value: number | null): string =>
  value === null ? "" : value !== 0 && (Math.abs(value) >= 1e5 || Math.abs(value) < 1e-3) ? value.toExponential().replace("e+", "e").replace("-", "−") : String(+value.toPrecision(6)).replace("-", "−");

// Log scales have no room for what is not above zero.
function positive(values: Curve["values"]): (number | null)[] {
  return Array.from(values, (v) => (v !== null && v > 0 ? v : null));
}

const finite = (values: Curve["values"]): (number | null)[] =>
  Array.from(values, (v) => (v !== null && Number.isFinite(v) ? v : null));

// What of x is shown; nothing where that is all.
function zoomOf(plot: uPlot): [number, number] | null {
  const all = plot.data[0];
  const { min, max } = plot.scales.x!;
  if (typeof min !== "number" || typeof max !== "number" || all.length === 0) return null;
  return min > all[0]! || max < all[all.length - 1]! ? [min, max] : null;
}

function options(props: ChartProps, log: boolean, width: number, zoomed: () => void): uPlot.Options {
  return {
    width,
    hooks: { setScale: [(_u, key) => key === "x" && zoomed()] },
    height: props.height ?? 260,
    cursor: {
      ...(props.sync ? { sync: { key: props.sync } } : {}),
      points: { size: 7 },
      drag: { x: true, y: false },
    },
    legend: { live: true },
    scales: {
      x: { time: false },
      y: log ? { distr: 3 } : { range: (_u, min, max) => uPlot.rangeNum(min, max, 0.08, true) },
    },
    axes: [
      { ...axis(props.xLabel, 34), values: (_u, splits) => splits.map(tick) },
      {
        ...axis(props.yLabel, 58, log),
        values: (_u, splits) => splits.map((v) => (v === null ? "" : tick(v))),
      },
    ],
    series: [
      {
        label: props.xLabel.replace(/,.*/, ""),
        value: (_u, v: number | null) => (v === null ? "–" : (props.xFormat ?? tick)(v)),
      },
      ...props.curves.map(
        (curve): uPlot.Series => ({
          label: curve.label,
          stroke: () => colourOf(curve.colour),
          width: curve.width ?? 1.5,
          pxAlign: 0,
          ...(curve.dashed ? { dash: [5, 4] } : {}),
          points: { show: (u) => u.data[0].length < 2 },
          value: (_u, v: number | null) => (v === null ? "–" : withUnit(significant(v), curve.unit ?? "")),
        }),
      ),
    ],
  };
}

// Arrows move the cursor, + and - zoom around it, 0 shows all. False: another key.
function steer(plot: uPlot, key: string): boolean {
  const x = plot.data[0];
  const last = x.length - 1;
  if (last < 0) return false;
  const { min, max } = plot.scales.x!;
  const at = plot.cursor.idx ?? null;
  const from = plot.valToIdx(min ?? x[0]!);
  const to = plot.valToIdx(max ?? x[last]!);
  const step = Math.max(1, Math.round((to - from) / 50));
  const go = (index: number) => {
    const left = plot.valToPos(x[Math.max(from, Math.min(to, index))]!, "x");
    // The nearest point of an edge may be just beyond it, where there is no cursor.
    plot.setCursor({ left: Math.max(0, Math.min(plot.over.clientWidth, left)), top: plot.over.clientHeight / 2 });
  };
  const zoom = (factor: number) => {
    const [low, high] = [min ?? x[0]!, max ?? x[last]!];
    const centre = at === null ? (low + high) / 2 : x[at]!;
    const half = ((high - low) / 2) * factor;
    const range = { min: Math.max(x[0]!, centre - half), max: Math.min(x[last]!, centre + half) };
    if (range.max > range.min) plot.setScale("x", range);
  };
  const keys: Record<string, () => void> = {
    ArrowLeft: () => go((at ?? to + step) - step),
    ArrowRight: () => go((at ?? from - step) + step),
    Home: () => go(from),
    End: () => go(to),
    "+": () => zoom(0.5),
    "=": () => zoom(0.5),
    "-": () => zoom(2),
    "0": () => plot.setScale("x", { min: x[0]!, max: x[last]! }),
    Escape: () => plot.setScale("x", { min: x[0]!, max: x[last]! }),
  };
  const act = keys[key];
  act?.();
  return act !== undefined;
}

export function Chart(props: ChartProps) {
  const place = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const [log, setLog] = useState(props.log ?? false);
  const [read, setRead] = useState(""); // what the keys have moved the cursor to
  const latest = useRef(props);
  latest.current = props;
  const shape = JSON.stringify([log, props.title, props.xLabel, props.yLabel, props.curves.map((c) => [c.label, c.colour, c.unit])]);
  const data = (): uPlot.AlignedData =>
    [props.x, ...props.curves.map((c) => (log ? positive(c.values) : finite(c.values)))] as uPlot.AlignedData;

  useEffect(() => {
    const box = place.current!;
    const zoomed = () => plot.current && latest.current.onZoom?.(zoomOf(plot.current));
    const made = new uPlot(options(props, log, Math.max(240, box.clientWidth), zoomed), data(), box);
    plot.current = made;
    const resize = new ResizeObserver(() => {
      const width = Math.max(240, box.clientWidth);
      if (width !== made.width) made.setSize({ width, height: props.height ?? 260 });
    });
    resize.observe(box);
    // On paper colours are the light ones.
    const themes = ["(prefers-color-scheme: dark)", "print"].map((query) => matchMedia(query));
    const redraw = () => made.redraw(false, true);
    for (const theme of themes) theme.addEventListener("change", redraw);
    return () => {
      for (const theme of themes) theme.removeEventListener("change", redraw);
      resize.disconnect();
      made.destroy();
      plot.current = null;
    };
  }, [shape]);

  useEffect(() => {
    const made = plot.current;
    if (!made) return;
    // What was zoomed into stays.
    const zoom = zoomOf(made);
    made.setData(data(), zoom === null);
    if (zoom) made.setScale("x", { min: zoom[0], max: zoom[1] });
  }, [props.x, ...props.curves.map((c) => c.values)]);

  const last = props.curves.map((c) => `${c.label} ${withUnit(significant(lastOf(c.values)), c.unit ?? "")}`).join(", ");
  return (
    <figure class="chart" data-testid={props.testId} data-points={props.x.length}>
      <figcaption>
        <span>{props.title}</span>
        <button
          type="button"
          class="quiet"
          aria-pressed={log}
          aria-label={`Logarithmic scale of ${props.title}`}
          onClick={() => setLog(!log)}
        >
          {log ? "log" : "lin"}
        </button>
      </figcaption>
      <div
        ref={place}
        class="plot"
        role="group"
        aria-roledescription="chart"
        aria-label={`${props.title} over ${props.xLabel}. Last: ${last}. Arrow keys read values, plus and minus zoom, 0 shows all.`}
        tabIndex={0}
        onKeyDown={(event) => {
          if (event.ctrlKey || event.altKey || event.metaKey || !plot.current || !steer(plot.current, event.key)) return;
          event.preventDefault();
          setRead(valuesAt(plot.current));
        }}
      />
      <p class="unseen" role="status">{read}</p>
    </figure>
  );
}

// The legend's texts under the cursor.
function valuesAt(plot: uPlot): string {
  return [...plot.root.querySelectorAll(".u-legend tr")].map((row) => [...row.children].map((cell) => cell.textContent).join(" ")).join(", ");
}

function lastOf(values: Curve["values"]): number {
  for (let i = values.length - 1; i >= 0; --i) {
    const value = values[i];
    if (value !== null && value !== undefined && Number.isFinite(value)) return value;
  }
  return NaN;
}

// A word-sized curve through [x, y], ascending in x.
export function Sparkline({ points, label }: { points: [number, number][]; label: string }) {
  const shown = points.filter(([, y]) => Number.isFinite(y));
  if (shown.length < 2) return <svg class="spark" viewBox="0 0 96 22" aria-hidden="true" />;
  const costs = shown.map(([, y]) => y);
  const low = Math.min(...costs);
  const height = Math.max(...costs) - low || 1;
  const first = shown[0]![0];
  const width = shown[shown.length - 1]![0] - first || 1;
  const line = shown
    .map(([x, y]) => `${(1 + (94 * (x - first)) / width).toFixed(1)},${(20 - (18 * (y - low)) / height).toFixed(1)}`)
    .join(" ");
  return (
    <svg class="spark" viewBox="0 0 96 22" role="img" aria-label={label}>
      <polyline points={line} />
    </svg>
  );
}
