import assert from "node:assert/strict";
import { test } from "node:test";
import { JobEvents } from "../src/job_events";
import type { JobEvent } from "../src/types";
import { iteration, job } from "./support";

// Event 1 is the creation, 2 the start; iteration i is event i + 2.
const told = (i: number): JobEvent => ({ seq: String(i + 2), iteration: iteration(i) });
const snapshot = (completed: number): JobEvent => ({ seq: String(completed + 2), snapshot: job(completed, completed + 2) });

function applied(...events: JobEvent[]): JobEvents {
  const state = new JobEvents();
  for (const event of events) state.apply(event);
  return state;
}

test("a watch from the first iteration needs no sample", () => {
  const state = applied(snapshot(0), told(1), told(2), told(3));
  assert.ok(!state.needsSample);
  assert.equal(state.history?.last, 3);
  assert.equal(state.job?.completed_iterations, 3);
  assert.equal(state.job?.best_iteration?.iteration, 3);
  assert.equal(state.job?.initial_iteration?.iteration, 1);
  assert.deepEqual(state.counts, { events: 3, gaps: 0, repeats: 0 });
});

test("a watch that begins in the middle needs the sample of what came before", () => {
  const state = applied(snapshot(5), told(6), told(7));
  assert.ok(state.needsSample);
  state.loadSample([1, 3, 5, 6].map((i) => iteration(i)));
  assert.ok(!state.needsSample);
  assert.deepEqual(state.history?.table.iteration, [1, 3, 5, 6, 7]);
  assert.deepEqual(state.counts, { events: 2, gaps: 0, repeats: 0 });
});

test("a sample older than the snapshot does not do", () => {
  const state = applied(snapshot(5));
  state.loadSample([1, 2, 3].map((i) => iteration(i)));
  assert.ok(state.needsSample);
});

test("after a reconnection the events go on behind a newer snapshot, none missing, none twice", () => {
  const state = applied(snapshot(0), told(1), told(2), snapshot(5), told(3), told(4), told(5), told(6));
  assert.equal(state.history?.last, 6);
  assert.deepEqual(state.history?.table.iteration, [1, 2, 3, 4, 5, 6]);
  assert.deepEqual(state.counts, { events: 6, gaps: 0, repeats: 0 });
  assert.ok(!state.needsSample);
});

test("events told twice, or never, are counted", () => {
  const state = applied(snapshot(0), told(1), told(1), told(4));
  assert.deepEqual(state.counts, { events: 2, gaps: 2, repeats: 1 });
  assert.ok(state.needsSample);
  assert.equal(state.history?.last, 1);
});

test("changes of state come in order; one that the snapshot has overtaken changes nothing", () => {
  const change = (seq: number, state: "JOB_STATE_PAUSED" | "JOB_STATE_RUNNING" | "JOB_STATE_SUCCEEDED"): JobEvent => ({
    seq: String(seq),
    state_change: { state, time: "2026-01-01T00:00:00Z", message: "" },
  });
  const state = applied(snapshot(0), told(1), change(4, "JOB_STATE_PAUSED"));
  assert.equal(state.job?.state, "JOB_STATE_PAUSED");
  state.apply({ seq: "6", snapshot: job(1, 6, "JOB_STATE_SUCCEEDED") });
  state.apply(change(5, "JOB_STATE_RUNNING"));
  assert.equal(state.job?.state, "JOB_STATE_SUCCEEDED");
  assert.equal(state.counts.gaps, 0);
});

test("the best is the settled one of least cost", () => {
  const event = (i: number, cost: number | undefined, outcome?: string): JobEvent => ({ seq: String(i + 2), iteration: iteration(i, cost, outcome) });
  const state = applied(snapshot(0), event(1, 50, "OUTCOME_NOT_SETTLED"), event(2, 80), event(3, 10, "OUTCOME_NOT_SETTLED"), event(4, undefined, "OUTCOME_LEFT_DOMAIN"), event(5, 70));
  assert.equal(state.job?.best_iteration?.iteration, 5);
});
