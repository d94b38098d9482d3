import assert from "node:assert/strict";
import { test } from "node:test";
import { type JobForm, chaserTexts, shellQuoted, textFaults, toCommand, toJob, violationsByField } from "../src/form";
import type { Scenario } from "../src/types";

const scenario = {
  name: "scenarios/gto-geo",
  hyperparameters: { initial_gains: { k1: 1, k2: 2, k3: 3, k4: 4, k5: 5 } },
} as Scenario;
const form = (part: Partial<JobForm>): JobForm => ({
  scenario: "scenarios/gto-geo",
  title: "",
  labels: "",
  form: "chaser",
  texts: {},
  logGains: false,
  ...part,
});

test("an empty form is the scenario alone", () => {
  assert.deepEqual(toJob(form({}), scenario), { scenario: "scenarios/gto-geo" });
  assert.equal(toCommand(form({}), scenario), "orbitune submit --scenario gto-geo");
});

test("what is typed is in the JSON and in the command", () => {
  const typed = form({
    title: "it's a test",
    labels: "case=a, board = 7",
    form: "cartesian",
    texts: {
      "hyperparameters.iterations": " 200 ",
      "hyperparameters.seed": "18446744073709551615",
      "hyperparameters.initial_gains.k2": "2.5",
      "initial_condition.cartesian.x_km": "−7000",
      "initial_condition.keplerian.eccentricity": "0.5",
    },
  });
  assert.deepEqual(toJob(typed, scenario), {
    scenario: "scenarios/gto-geo",
    display_name: "it's a test",
    labels: { case: "a", board: "7" },
    initial_condition: { cartesian: { x_km: -7000 } },
    hyperparameters: {
      iterations: 200,
      seed: "18446744073709551615",
      initial_gains: { k1: 1, k2: 2.5, k3: 3, k4: 4, k5: 5 },
    },
  });
  assert.equal(
    toCommand(typed, scenario),
    "orbitune submit --scenario gto-geo --name 'it'\\''s a test' --label case=a --label board=7 --iterations 200 " +
      "--seed 18446744073709551615 --initial-gains 1,2.5,3,4,5 --ic x_km=-7000",
  );
});

test("an algorithm brings its own options, and leaves the others'", () => {
  const typed = form({
    texts: {
      "hyperparameters.algorithm": "ALGORITHM_CMA_ES",
      "hyperparameters.step_size": "0.1",
      "hyperparameters.cma_es.population": "12",
    },
  });
  assert.deepEqual(toJob(typed, scenario).hyperparameters, { algorithm: "ALGORITHM_CMA_ES", cma_es: { population: 12 } });
  assert.equal(toCommand(typed, scenario), "orbitune submit --scenario gto-geo --algorithm cma-es --population 12");
});

test("what is no number is told beside its field", () => {
  const faults = textFaults({ "hyperparameters.step_size": "abc", "hyperparameters.iterations": "1e3", "hyperparameters.algorithm": "ALGORITHM_ARS" });
  assert.deepEqual(faults, { "hyperparameters.step_size": "must be a number, got 'abc'" });
});

test("the server's violations find their fields", () => {
  const paths = ["hyperparameters.step_size", "hyperparameters.initial_gains.k1", "hyperparameters.exploration_std.k1"];
  const found = violationsByField(
    [
      { field: "hyperparameters.step_size", description: "must be > 0" },
      { field: "job.hyperparameters.initial_gains.k1", description: "must be in" },
      { field: "hyperparameters.exploration_std", description: "must not be 0 for all" },
      { field: "scenario", description: "unknown" },
    ],
    paths,
  );
  assert.deepEqual(found, {
    "hyperparameters.step_size": "must be > 0",
    "hyperparameters.initial_gains.k1": "must be in",
    "hyperparameters.exploration_std.k1": "must not be 0 for all",
    "": "scenario: unknown",
  });
});

test("the chaser is the same orbit in every form", () => {
  const keplerian = { semi_major_axis_km: 7000, eccentricity: 0.1, inclination_deg: 30, raan_deg: 40, argument_of_periapsis_deg: 50, true_anomaly_deg: 0 };
  const number = (texts: Record<string, string>, key: string) => Number(Object.entries(texts).find(([path]) => path.endsWith(`.${key}`))?.[1]);
  const equinoctial = chaserTexts("equinoctial", { keplerian }, 398600.4418);
  assert.ok(Math.abs(number(equinoctial, "p_km") - 7000 * 0.99) < 1e-6);
  assert.equal(number(equinoctial, "true_longitude_deg"), 90);
  const cartesian = chaserTexts("cartesian", { keplerian }, 398600.4418);
  // At periapsis: r = a (1 - e), v = sqrt(mu (1 + e) / r).
  const radius = Math.hypot(...["x_km", "y_km", "z_km"].map((key) => number(cartesian, key)));
  const speed = Math.hypot(...["x_dot_km_s", "y_dot_km_s", "z_dot_km_s"].map((key) => number(cartesian, key)));
  assert.ok(Math.abs(radius - 6300) < 1e-6, String(radius));
  assert.ok(Math.abs(speed - Math.sqrt((398600.4418 * 1.1) / 6300)) < 1e-9, String(speed));
  const numbers = { p_km: 0, ex: 0, ey: 0, hx: 0, hy: 0, true_longitude_deg: 0 };
  for (const key of Object.keys(numbers) as (keyof typeof numbers)[]) numbers[key] = number(equinoctial, key);
  const back = chaserTexts("keplerian", { equinoctial: numbers }, 398600.4418);
  for (const key of ["semi_major_axis_km", "eccentricity", "inclination_deg", "raan_deg", "argument_of_periapsis_deg"] as const) {
    assert.ok(Math.abs(number(back, key) - keplerian[key]) < 1e-6, key);
  }
});

test("a shell takes a word as it is", () => {
  assert.equal(shellQuoted("a=1,b=-2"), "a=1,b=-2");
  assert.equal(shellQuoted("two words"), "'two words'");
});
