import assert from "node:assert/strict";
import { test } from "node:test";
import { orbit, path, planes, position } from "../src/orbit";
import type { TrajectorySample } from "../src/types";

const circular = { p_km: 42165, ex: 0, ey: 0, hx: 0, hy: 0, true_longitude_deg: 90 };

test("positions follow the elements", () => {
  const [x, y, z] = position(circular);
  assert.ok(Math.abs(x) < 1e-6 && Math.abs(y - 42165) < 1e-6 && z === 0);
  // A polar orbit with its node on x: a quarter turn past it is on z.
  const polar = position({ ...circular, hx: 1 });
  assert.ok(Math.abs(polar[2] - 42165) < 1e-6);
});

test("between samples the path follows the orbit, not the chord", () => {
  const sample = (longitude: number) => ({ chaser: { ...circular, true_longitude_deg: longitude } }) as TrajectorySample;
  const points = path([sample(0), sample(170)]);
  assert.ok(points.length > 30);
  for (const { point } of points) assert.ok(Math.abs(Math.hypot(...point) - 42165) < 1e-6);
});

test("the target's orbit lies in its own plane", () => {
  const target = { p_km: 7378, ex: 0.01, ey: 0, hx: 0.5, hy: 0.3, true_longitude_deg: 0 };
  const edge = planes(target)[1]!;
  for (const point of orbit(target)) assert.ok(Math.abs(edge.project(point)[1]) < 1e-6);
});
