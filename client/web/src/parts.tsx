// Small pieces that several views are made of.
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { brief, enumText, significant, subscript, withUnit } from "./format";
import { type Equinoctial, type Gains, type Keplerian, type OrbitState, gainKeys } from "./types";

export function State({ of, prefix = "JOB_STATE_" }: { of: string; prefix?: string }) {
  const text = enumText(of, prefix);
  return <span class={`state ${text.replaceAll(" ", "-")}`}>{text}</span>;
}

export function Progress({ done, of, label }: { done: number; of: number; label: string }) {
  return <progress value={Math.min(done, of)} max={Math.max(of, 1)} aria-label={label} />;
}

export function Fault({ children }: { children: ComponentChildren }) {
  return (
    <p class="fault" role="alert">
      {children}
    </p>
  );
}

export function Copy({ label, text }: { label: string; text: string }) {
  const [copied, setCopied] = useState(false);
  const copy = async () => {
    await copyText(text);
    setCopied(true);
    setTimeout(() => setCopied(false), 1500);
  };
  return (
    <div class="copy">
      <div class="bar">
        <span>{label}</span>
        <button type="button" class="quiet" onClick={() => void copy()} aria-label={`Copy: ${label}`}>
          {copied ? "copied" : "copy"}
        </button>
      </div>
      <pre tabIndex={0}>{text}</pre>
    </div>
  );
}

// navigator.clipboard exists only where the page came over TLS or from this machine.
async function copyText(text: string): Promise<void> {
  if (navigator.clipboard) return navigator.clipboard.writeText(text);
  const area = document.createElement("textarea");
  area.value = text;
  document.body.append(area);
  area.select();
  document.execCommand("copy");
  area.remove();
}

export interface Fact {
  name: ComponentChildren;
  value: ComponentChildren;
}
export function Facts({ facts }: { facts: (Fact | null)[] }) {
  return (
    <dl class="facts">
      {facts.map(
        (fact, i) =>
          fact && (
            <div key={i}>
              <dt>{fact.name}</dt>
              <dd>{fact.value}</dd>
            </div>
          ),
      )}
    </dl>
  );
}

export const gainName = (i: number): string => `K${subscript(i + 1)}`;

export function GainsLine({ gains }: { gains: Gains | null | undefined }) {
  if (!gains) return <>–</>;
  return <span class="gains">{gainKeys.map((key) => <span key={key}>{significant(gains[key])}</span>)}</span>;
}

const keplerianRows: [keyof Keplerian, string, string][] = [
  ["semi_major_axis_km", "a", "km"],
  ["eccentricity", "e", ""],
  ["inclination_deg", "i", "°"],
  ["raan_deg", "Ω", "°"],
  ["argument_of_periapsis_deg", "ω", "°"],
  ["true_anomaly_deg", "ν", "°"],
  ["true_longitude_deg", "L", "°"],
];
const equinoctialRows: [keyof Equinoctial, string, string][] = [
  ["p_km", "p", "km"],
  ["ex", "ex", ""],
  ["ey", "ey", ""],
  ["hx", "hx", ""],
  ["hy", "hy", ""],
  ["true_longitude_deg", "L", "°"],
];

// One line: a 24364 km, e 0.7306, …
export function orbitText(state: OrbitState | null | undefined): string {
  if (!state) return "–";
  const { keplerian: k, equinoctial: e, cartesian: c } = state;
  const list = (rows: [string, string, string][], of: object) => {
    const values = of as Record<string, number | null | undefined>;
    return rows
      .filter(([key]) => values[key] !== undefined && values[key] !== null)
      .map(([key, name, unit]) => `${name} ${unit === "°" ? `${brief(values[key], 6)}°` : withUnit(brief(values[key], 6), unit)}`)
      .join(", ");
  };
  if (k) return list(keplerianRows, k);
  if (e) return list(equinoctialRows, e);
  if (c) {
    const vector = (v: number[]) => `(${v.map((x) => significant(x, 6)).join(", ")})`;
    return `r ${vector([c.x_km, c.y_km, c.z_km])} km, v ${vector([c.x_dot_km_s, c.y_dot_km_s, c.z_dot_km_s])} km/s`;
  }
  return "–";
}

export function save(name: string, type: string, text: string): void {
  const url = URL.createObjectURL(new Blob([text], { type }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
