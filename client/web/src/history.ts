// What the page knows of a job's history: columns to plot, made of a sample the server drew and of the events since.
import { real } from "./format";
import type { Iteration } from "./types";

export const columns = ["cost", "settling", "fuel", "k1", "k2", "k3", "k4", "k5"] as const;
export type Column = (typeof columns)[number];

// Parallel columns, ascending in iteration; NaN where there is no value.
export interface Table {
  iteration: number[];
  values: Record<Column, number[]>;
}

export function emptyTable(): Table {
  return {
    iteration: [],
    values: { cost: [], settling: [], fuel: [], k1: [], k2: [], k3: [], k4: [], k5: [] },
  };
}

// Which rows to keep, at most about `most` of them: the first, the last, and of equal stretches of the iterations those
// of the least and the greatest cost, one without a cost counting as the greatest. As the server picks them.
export function pickExtremes(iteration: readonly number[], cost: readonly number[], most: number): number[] {
  const rows = iteration.length;
  if (rows <= most) return iteration.map((_, row) => row);
  const stretches = Math.max(1, Math.floor((most - 2) / 2));
  const first = iteration[0]!;
  const span = iteration[rows - 1]! - first + 1;
  const kept = new Set<number>([0, rows - 1]);
  const rank = (row: number) => (Number.isNaN(cost[row]!) ? Infinity : cost[row]!);
  for (let row = 0; row < rows; ) {
    const stretch = Math.floor(((iteration[row]! - first) * stretches) / span);
    let least = row;
    let greatest = row;
    for (; row < rows && Math.floor(((iteration[row]! - first) * stretches) / span) === stretch; ++row) {
      if (rank(row) < rank(least)) least = row;
      if (rank(row) > rank(greatest)) greatest = row;
    }
    kept.add(least).add(greatest);
  }
  return [...kept].sort((a, b) => a - b);
}

function append(table: Table, record: Iteration, fuelWeight: number): void {
  table.iteration.push(record.iteration);
  const { values } = table;
  values.cost.push(real(record.cost));
  values.settling.push(record.settling_samples);
  values.fuel.push(fuelWeight * real(record.fuel_sum));
  for (const key of ["k1", "k2", "k3", "k4", "k5"] as const) values[key].push(record.gains[key]);
}

function copyOf(table: Table, begin: number, end: number): Table {
  const copy = emptyTable();
  copy.iteration = table.iteration.slice(begin, end);
  for (const column of columns) copy.values[column] = table.values[column].slice(begin, end);
  return copy;
}

// Grows by whole iterations, in order; never beyond `capacity` rows, past which half of them are let go, extremes kept.
export class History {
  table = emptyTable();
  last = 0; // the newest iteration, and so how many there are
  private early: Iteration[] = []; // beyond a gap that a sample has yet to fill

  constructor(
    private readonly fuelWeight: number,
    private readonly capacity = 6000,
  ) {}

  // An iteration is missing: only a sample taken from now on can fill it.
  get incomplete(): boolean {
    return this.early.length > 0;
  }

  // Of the whole history, as ListIterations gives it with max_points. Newer iterations that are here already stay.
  load(sample: readonly Iteration[]): void {
    const newest = sample.length > 0 ? sample[sample.length - 1]!.iteration : 0;
    const fresh = emptyTable();
    for (const record of sample) append(fresh, record, this.fuelWeight);
    const old = this.table;
    for (let row = 0; row < old.iteration.length; ++row) {
      if (old.iteration[row]! <= newest) continue;
      fresh.iteration.push(old.iteration[row]!);
      for (const column of columns) fresh.values[column].push(old.values[column][row]!);
    }
    this.table = fresh;
    this.last = Math.max(this.last, newest);
    const waiting = this.early;
    this.early = [];
    for (const record of waiting) this.add(record);
  }

  // True: it is new, and the next one. An older one is passed over; one too new waits for a sample.
  add(record: Iteration): boolean {
    if (record.iteration <= this.last) return false;
    if (record.iteration > this.last + 1) {
      this.early.push(record);
      return false;
    }
    append(this.table, record, this.fuelWeight);
    this.last = record.iteration;
    if (this.table.iteration.length > this.capacity) this.thin();
    return true;
  }

  // How many of the iterations from `first` to `last` are here.
  rowsIn(first: number, last: number): number {
    return this.table.iteration.reduce((rows, i) => rows + Number(i >= first && i <= last), 0);
  }

  // A copy to draw, with a closer sample of a stretch in place of what is here of it.
  drawn(closer: readonly Iteration[]): Table {
    const { iteration, values } = this.table;
    const from = closer.length > 0 ? iteration.findIndex((i) => i >= closer[0]!.iteration) : -1;
    if (from < 0) return copyOf(this.table, 0, iteration.length);
    const made = copyOf(this.table, 0, from);
    for (const record of closer) append(made, record, this.fuelWeight);
    const newest = closer[closer.length - 1]!.iteration;
    for (let row = from; row < iteration.length; ++row) {
      if (iteration[row]! <= newest) continue;
      made.iteration.push(iteration[row]!);
      for (const column of columns) made.values[column].push(values[column][row]!);
    }
    return made;
  }

  private thin(): void {
    const { iteration, values } = this.table;
    const rows = pickExtremes(iteration, values.cost, this.capacity / 2);
    const thinned = emptyTable();
    thinned.iteration = rows.map((row) => iteration[row]!);
    for (const column of columns) thinned.values[column] = rows.map((row) => values[column][row]!);
    this.table = thinned;
  }
}

// Iterations per second over the last few seconds.
export class Rate {
  private marks: { ms: number; iterations: number }[] = [];

  constructor(private readonly windowMs = 5000) {}

  mark(ms: number, iterations: number): void {
    this.marks.push({ ms, iterations });
    while (this.marks.length > 2 && ms - this.marks[1]!.ms > this.windowMs) this.marks.shift();
  }

  reset(): void {
    this.marks = [];
  }

  get perSecond(): number {
    const first = this.marks[0];
    const last = this.marks[this.marks.length - 1];
    if (!first || !last || last.ms - first.ms < 250) return NaN;
    return (1000 * (last.iterations - first.iterations)) / (last.ms - first.ms);
  }
}
