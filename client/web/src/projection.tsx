// Trajectories drawn in a plane, to scale, with the target's orbit and the Earth.
import { useMemo, useState } from "preact/hooks";
import { duration, significant } from "./format";
import { type Plane, type Vector, orbit, path, planes } from "./orbit";
import type { TrajectorySample } from "./types";

export interface Track {
  label: string;
  colour: string; // a class of the style sheet
  samples: TrajectorySample[];
}

const size = 300;
const earthRadiusKm = 6378.137;

interface Placed {
  label: string;
  colour: string;
  points: { at: [number, number]; sample: TrajectorySample }[];
}

function line(points: [number, number][]): string {
  return points.map(([x, y], i) => `${i === 0 ? "M" : "L"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
}

// A round number near a quarter of `span`.
function scaleLength(span: number): number {
  const power = 10 ** Math.floor(Math.log10(span / 4));
  return ([5, 2, 1].find((m) => m * power <= span / 4) ?? 1) * power;
}

function View({ plane, tracks, target }: { plane: Plane; tracks: Track[]; target: Vector[] }) {
  const [hover, setHover] = useState<{ track: Placed; index: number } | null>(null);
  const drawn = useMemo(() => {
    const flown = tracks.map((track) => ({ ...track, points: path(track.samples) }));
    const targetPoints = target.map(plane.project);
    const all = [...targetPoints, ...flown.flatMap((t) => t.points.map((p) => plane.project(p.point)))];
    const xs = all.map((p) => p[0]);
    const ys = all.map((p) => p[1]);
    const min = (v: number[]) => v.reduce((a, b) => Math.min(a, b), Infinity);
    const max = (v: number[]) => v.reduce((a, b) => Math.max(a, b), -Infinity);
    const span = 1.06 * Math.max(max(xs) - min(xs), max(ys) - min(ys), 1e-9);
    const centre = [(max(xs) + min(xs)) / 2, (max(ys) + min(ys)) / 2];
    const place = ([x, y]: [number, number]): [number, number] => [
      (size * (x - centre[0]! + span / 2)) / span,
      (size * (centre[1]! + span / 2 - y)) / span,
    ];
    const placed: Placed[] = flown.map((t) => ({
      label: t.label,
      colour: t.colour,
      points: t.points.map((p) => ({ at: place(plane.project(p.point)), sample: t.samples[p.sample]! })),
    }));
    return {
      placed,
      target: line(targetPoints.map(place)),
      earth: place([0, 0]),
      earthRadius: (size * earthRadiusKm) / span,
      scale: scaleLength(span),
      scalePixels: (size * scaleLength(span)) / span,
    };
  }, [plane, tracks, target]);

  const move = (event: PointerEvent) => {
    const box = (event.currentTarget as SVGElement).getBoundingClientRect();
    const x = ((event.clientX - box.left) * size) / box.width;
    const y = ((event.clientY - box.top) * size) / box.height;
    let nearest: { track: Placed; index: number } | null = null;
    let least = 15 ** 2;
    for (const track of drawn.placed) {
      track.points.forEach(({ at }, index) => {
        const distance = (at[0] - x) ** 2 + (at[1] - y) ** 2;
        if (distance < least) [least, nearest] = [distance, { track, index }];
      });
    }
    setHover(nearest);
  };
  const point = hover?.track.points[hover.index];
  return (
    <figure class="projection">
      <figcaption>{plane.title}</figcaption>
      <svg
        viewBox={`0 0 ${size} ${size}`}
        role="img"
        aria-label={`${plane.title}: ${tracks.map((t) => t.label).join(", ")} and the target's orbit`}
        onPointerMove={move}
        onPointerLeave={() => setHover(null)}
      >
        <circle class="earth" cx={drawn.earth[0]} cy={drawn.earth[1]} r={Math.max(1.5, drawn.earthRadius)} />
        <path class="target" d={drawn.target} />
        {drawn.placed.map((track) => (
          <g class={track.colour} key={track.label}>
            <path class="track" d={line(track.points.map((p) => p.at))} />
            {track.points[0] && <circle class="start" cx={track.points[0].at[0]} cy={track.points[0].at[1]} r="3" />}
          </g>
        ))}
        {point && <circle class="hover" cx={point.at[0]} cy={point.at[1]} r="4" />}
        <path class="scale" d={`M8 ${size - 8}h${drawn.scalePixels.toFixed(1)}`} />
        <text class="scale" x="8" y={size - 15}>{`${significant(drawn.scale, 1)} km`}</text>
        <text class="axes" x={size - 6} y={size - 8} text-anchor="end">{`→ ${plane.axes[0]}   ↑ ${plane.axes[1]}`}</text>
      </svg>
      <p class="readout">
        {point
          ? `${hover!.track.label}: ${duration(point.sample.time_s)}, ${significant(point.sample.distance_km)} km from the target`
          : " "}
      </p>
    </figure>
  );
}

export function Projections({ tracks }: { tracks: Track[] }) {
  const first = tracks[0]?.samples[0];
  const views = useMemo(() => (first ? { planes: planes(first.target), target: orbit(first.target) } : null), [first]);
  if (!views) return null;
  return (
    <div class="projections">
      {views.planes.map((plane) => (
        <View key={plane.title} plane={plane} tracks={tracks} target={views.target} />
      ))}
    </div>
  );
}
