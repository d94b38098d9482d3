// Where a spacecraft is, from its modified equinoctial elements (docs/model.md), and the planes it is drawn in.
import type { Equinoctial, Scenario, TrajectorySample } from "./types";

export type Vector = [number, number, number];

const degree = Math.PI / 180;

// The equinoctial frame of an orbit: f and g in its plane, w along its angular momentum.
function frame(e: Equinoctial): { f: Vector; g: Vector; w: Vector } {
  const { hx, hy } = e;
  const s = 1 + hx * hx + hy * hy;
  return {
    f: [(1 + hx * hx - hy * hy) / s, (2 * hx * hy) / s, (-2 * hy) / s],
    g: [(2 * hx * hy) / s, (1 - hx * hx + hy * hy) / s, (2 * hx) / s],
    w: [(2 * hy) / s, (-2 * hx) / s, (1 - hx * hx - hy * hy) / s],
  };
}

const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// In km, inertial.
export function position(e: Equinoctial): Vector {
  const { f, g } = frame(e);
  const longitude = e.true_longitude_deg * degree;
  const cos = Math.cos(longitude);
  const sin = Math.sin(longitude);
  const r = e.p_km / (1 + e.ex * cos + e.ey * sin);
  return [0, 1, 2].map((i) => r * (cos * f[i]! + sin * g[i]!)) as Vector;
}

function between(a: Equinoctial, b: Equinoctial, t: number): Equinoctial {
  const mix = (x: number, y: number) => x + (y - x) * t;
  return {
    p_km: mix(a.p_km, b.p_km),
    ex: mix(a.ex, b.ex),
    ey: mix(a.ey, b.ey),
    hx: mix(a.hx, b.hx),
    hy: mix(a.hy, b.hy),
    true_longitude_deg: mix(a.true_longitude_deg, b.true_longitude_deg),
  };
}

// The path through the samples: elements change slowly, so that between two samples they are interpolated, and the true
// longitude in steps of at most five degrees.
export function path(samples: readonly TrajectorySample[]): { point: Vector; sample: number }[] {
  const points: { point: Vector; sample: number }[] = [];
  samples.forEach((sample, index) => {
    points.push({ point: position(sample.chaser), sample: index });
    const next = samples[index + 1];
    if (!next) return;
    const turn = Math.abs(next.chaser.true_longitude_deg - sample.chaser.true_longitude_deg);
    const steps = Math.min(72, Math.ceil(turn / 5));
    for (let step = 1; step < steps; ++step) {
      points.push({ point: position(between(sample.chaser, next.chaser, step / steps)), sample: index });
    }
  });
  return points;
}

export function orbit(e: Equinoctial): Vector[] {
  return Array.from({ length: 121 }, (_, i) => position({ ...e, true_longitude_deg: 3 * i }));
}

export interface Plane {
  title: string;
  axes: [string, string];
  project: (v: Vector) => [number, number];
}

// Two views in the target's orbital frame, and two of inertial space.
export function planes(target: Equinoctial): Plane[] {
  const { f, g, w } = frame(target);
  return [
    { title: "Target's orbital plane", axes: ["f", "g"], project: (v) => [dot(v, f), dot(v, g)] },
    { title: "Edge of that plane", axes: ["f", "w"], project: (v) => [dot(v, f), dot(v, w)] },
    { title: "Inertial x–y", axes: ["x", "y"], project: (v) => [v[0], v[1]] },
    { title: "Inertial y–z", axes: ["y", "z"], project: (v) => [v[1], v[2]] },
  ];
}

// Of k1, and of k2 to k5; where a scenario leaves one at 0 it is the target's canonical unit.
export function gainUnits(scenario: Scenario): { velocity_m_s: number; acceleration_m_s2: number } {
  const mu = scenario.gravitational_parameter_km3_s2 || 398600.4418;
  const { equinoctial, keplerian } = scenario.target;
  const a = keplerian?.semi_major_axis_km ?? NaN;
  const p = equinoctial?.p_km ?? a * (1 - (keplerian?.eccentricity ?? 0) ** 2);
  return {
    velocity_m_s: scenario.velocity_unit_m_s || 1000 * Math.sqrt(mu / p),
    acceleration_m_s2: scenario.acceleration_unit_m_s2 || (1000 * mu) / (p * p),
  };
}
