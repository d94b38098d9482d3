// A job's events made into what the page shows: pure, so that a test can say what every sequence of them comes to.
import { real } from "./format";
import { History } from "./history";
import type { Iteration, Job, JobEvent } from "./types";

export function isTerminal(state: string): boolean {
  return /_(SUCCEEDED|FAILED|CANCELLED)$/.test(state);
}

// How the stream has gone, for the page to tell and the tests to hold it to.
export interface StreamCounts {
  events: number;
  gaps: number; // events that were never told
  repeats: number; // events told twice
}

export class JobEvents {
  job: Job | null = null;
  history: History | null = null;
  lastSeq = 0;
  readonly counts: StreamCounts = { events: 0, gaps: 0, repeats: 0 };
  private begin = 0; // iterations there were before the stream began

  // True: iterations are missing that no event will bring, so a sample is to be fetched.
  get needsSample(): boolean {
    return this.history !== null && (this.history.incomplete || this.history.last < this.begin);
  }

  apply(event: JobEvent): void {
    const seq = Number(event.seq);
    if (event.snapshot) return this.snapshot(event.snapshot, seq);
    if (event.gap || !this.job || !this.history) return;
    if (seq <= this.lastSeq) {
      ++this.counts.repeats;
      return;
    }
    this.counts.gaps += seq - this.lastSeq - 1;
    ++this.counts.events;
    this.lastSeq = seq;
    if (event.iteration) this.iteration(event.iteration);
    // What the snapshot told of a later state counts for more.
    if (event.state_change && seq > Number(this.job.last_seq)) {
      const { state, time, message, report } = event.state_change;
      this.job = { ...this.job, state, update_time: time, error_message: message };
      if (state === "JOB_STATE_RUNNING" && !this.job.start_time) this.job.start_time = time;
      if (isTerminal(state)) this.job.end_time = time;
      if (report) this.job.report = report;
    }
  }

  loadSample(sample: readonly Iteration[]): void {
    this.history?.load(sample);
  }

  private snapshot(job: Job, seq: number): void {
    this.history ??= new History(job.scenario_definition?.fuel_weight ?? NaN);
    // The first snapshot says where the stream begins; a later one, that events up to it are still to come.
    if (!this.job) {
      this.lastSeq = seq;
      this.begin = job.completed_iterations;
    }
    this.job = job;
  }

  private iteration(record: Iteration): void {
    const job = this.job!;
    this.history!.add(record);
    const next: Job = { ...job, latest_iteration: record };
    next.completed_iterations = Math.max(job.completed_iterations, record.iteration);
    next.initial_iteration ??= record;
    const best = job.best_iteration;
    const settled = record.outcome === "OUTCOME_SETTLED";
    const bestSettled = best?.outcome === "OUTCOME_SETTLED";
    if (!best || (settled && !bestSettled) || (settled === bestSettled && real(record.cost) < real(best.cost))) {
      next.best_iteration = record;
    }
    this.job = next;
  }
}
