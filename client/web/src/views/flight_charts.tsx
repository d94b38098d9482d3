// What flights look like: distance, control and V over time, and the trajectories.
import { useMemo } from "preact/hooks";
import { Chart } from "../chart";
import { fixed } from "../format";
import { type Flown, joined, thrust } from "../flights";
import { Projections } from "../projection";
import type { TrajectorySample } from "../types";

export function FlightCharts({ flights, sync, settlingKm }: { flights: Flown[]; sync: string; settlingKm: number }) {
  const drawn = useMemo(() => {
    const { hours, rows } = joined(flights);
    const of = (value: (s: TrajectorySample) => number) => rows.map((row) => row.map((s) => (s ? value(s) : null)));
    const last = rows[rows.length - 1] ?? [];
    const part = (value: (s: TrajectorySample) => number) => last.map((s) => (s ? 1000 * value(s) : null));
    return {
      hours,
      distance: of((s) => s.distance_km),
      thrust: of((s) => 1000 * thrust(s)),
      lyapunov: of((s) => s.lyapunov),
      radial: part((s) => s.control.radial_m_s2),
      transverse: part((s) => s.control.transverse_m_s2),
      normal: part((s) => s.control.normal_m_s2),
      settled: hours.map(() => settlingKm),
      tracks: flights.map((f) => ({ label: f.label, colour: f.colour.slice(2), samples: f.episode.trajectory })),
    };
  }, [flights, settlingKm]);
  const curves = (values: (number | null)[][], unit: string) =>
    flights.map((f, i) => ({ label: f.label, colour: f.colour, unit, values: values[i] ?? [] }));
  const time = { x: drawn.hours, xLabel: "time, h", sync, xFormat: (x: number) => `${fixed(x, 2)} h`, height: 220 };
  const newest = flights[flights.length - 1]?.label ?? "";
  return (
    <>
      <div class="grid two">
        <Chart
          {...time}
          title="Distance to the target"
          yLabel="km"
          log
          testId="distance"
          curves={[
            ...curves(drawn.distance, "km"),
            { label: "settled", colour: "--muted", unit: "km", dashed: true, width: 1, values: drawn.settled },
          ]}
        />
        <Chart {...time} title="V" yLabel="dimensionless" log curves={curves(drawn.lyapunov, "")} />
      </div>
      <Projections tracks={drawn.tracks} />
      <div class="grid two">
        <Chart {...time} title="Control ‖u‖" yLabel="mm/s²" log curves={curves(drawn.thrust, "mm/s²")} />
        <Chart
          {...time}
          title={`Control of ${newest}`}
          yLabel="mm/s²"
          curves={[
            { label: "radial", colour: "--c1", unit: "mm/s²", values: drawn.radial },
            { label: "transverse", colour: "--c2", unit: "mm/s²", values: drawn.transverse },
            { label: "normal", colour: "--c3", unit: "mm/s²", values: drawn.normal },
          ]}
        />
      </div>
    </>
  );
}
