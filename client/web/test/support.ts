// What several tests make their messages with.
import type { Iteration, Job } from "../src/types";

export function iteration(number: number, cost: number | undefined = 100 - number, outcome = "OUTCOME_SETTLED"): Iteration {
  return {
    iteration: number,
    gains: { k1: 1, k2: 2, k3: 3, k4: 4, k5: 5 },
    ...(cost === undefined ? {} : { cost }),
    settling_samples: 10,
    fuel_sum: 0.5,
    outcome,
    cost_std: 0,
    pairs_left_out: 0,
    pairs_not_settled: 0,
    episodes: String(number),
  };
}

export function job(completed: number, seq: number, state: Job["state"] = "JOB_STATE_RUNNING"): Job {
  return {
    name: "jobs/a",
    display_name: "",
    labels: {},
    scenario: "scenarios/gto-geo",
    hyperparameters: { iterations: 100 },
    state,
    completed_iterations: completed,
    last_seq: String(seq),
    error_message: "",
    etag: "",
  };
}
