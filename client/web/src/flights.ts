// Flights of first and tuned gains on one grid of times, for curves and trajectories beside each other.
import { post } from "./api";
import type { Episode, Gains, OrbitState, Scenario, TrajectorySample } from "./types";

export interface Flown {
  label: string;
  colour: string; // custom property and class: "--before" / "before"
  episode: Episode;
}

// samples: about how many of the trajectory; expected: settling samples of the longest flight.
export async function fly(
  scenario: Scenario,
  initialCondition: OrbitState | null | undefined,
  gains: Gains,
  expected: number,
  samples: number,
  signal: AbortSignal,
): Promise<Episode> {
  const stride = Math.max(1, Math.ceil(Math.min(expected * 1.1, scenario.horizon_samples) / samples));
  return post<Episode>(
    "/v1/episodes:simulate",
    {
      scenario_definition: scenario,
      ...(initialCondition ? { initial_condition: initialCondition } : {}),
      gains,
      early_exit: true,
      include_trajectory: true,
      sample_stride: stride,
    },
    signal,
  );
}

// Several trajectories over one column of times, in hours; null where one has ended.
export function joined(flights: readonly Flown[]): { hours: number[]; rows: (TrajectorySample | null)[][] } {
  const times = [...new Set(flights.flatMap((f) => f.episode.trajectory.map((s) => s.time_s)))].sort((a, b) => a - b);
  const rows = flights.map((f) => {
    const at = new Map(f.episode.trajectory.map((s) => [s.time_s, s]));
    return times.map((t) => at.get(t) ?? null);
  });
  return { hours: times.map((t) => t / 3600), rows };
}

export const thrust = (s: TrajectorySample): number =>
  Math.hypot(s.control.radial_m_s2, s.control.transverse_m_s2, s.control.normal_m_s2);
