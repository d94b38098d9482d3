import assert from "node:assert/strict";
import { test } from "node:test";
import { History, Rate, pickExtremes } from "../src/history";
import { iteration } from "./support";

const range = (from: number, to: number): number[] => Array.from({ length: to - from + 1 }, (_, i) => from + i);

test("a short history is kept whole", () => {
  assert.deepEqual(pickExtremes([1, 2, 3], [3, 2, 1], 3), [0, 1, 2]);
});

test("what is picked has the first, the last, every extreme, and what has no cost", () => {
  const x = range(1, 10_000);
  const cost = x.map((i) => 1000 - i / 100);
  cost[1234] = 5000;
  cost[4321] = 1;
  cost[7777] = NaN;
  for (const most of [50, 51, 999]) {
    const rows = pickExtremes(x, cost, most);
    assert.ok(rows.length <= most, `${rows.length} of ${most}`);
    for (const kept of [0, 1234, 4321, 7777, 9999]) assert.ok(rows.includes(kept), `${kept} at ${most}`);
    assert.deepEqual(rows, [...new Set(rows)].sort((a, b) => a - b));
  }
});

test("iterations are taken once each, in order", () => {
  const history = new History(50);
  assert.ok(history.add(iteration(1)));
  assert.ok(history.add(iteration(2)));
  assert.ok(!history.add(iteration(2)), "told twice");
  assert.ok(!history.add(iteration(1)));
  assert.deepEqual(history.table.iteration, [1, 2]);
  assert.equal(history.last, 2);
  assert.equal(history.table.values.fuel[0], 50 * 0.5);
});

test("what is beyond a gap waits for the sample that fills it", () => {
  const history = new History(50);
  history.add(iteration(1));
  assert.ok(!history.add(iteration(5)));
  assert.ok(!history.add(iteration(6)));
  assert.ok(history.incomplete);
  assert.equal(history.last, 1);
  history.load([1, 3, 4].map((i) => iteration(i)));
  assert.ok(!history.incomplete);
  assert.deepEqual(history.table.iteration, [1, 3, 4, 5, 6]);
  assert.equal(history.last, 6);
});

test("a sample that is older than the events takes none of them away", () => {
  const history = new History(50);
  for (const i of range(1, 10)) history.add(iteration(i));
  history.load([1, 4, 7].map((i) => iteration(i)));
  assert.deepEqual(history.table.iteration, [1, 4, 7, 8, 9, 10]);
  assert.equal(history.last, 10);
});

test("a history grows within its capacity and keeps its extremes", () => {
  const history = new History(50, 100);
  for (const i of range(1, 100_000)) history.add(iteration(i, i === 33 ? 9999 : i === 50_000 ? 0.5 : 100));
  assert.ok(history.table.iteration.length <= 100);
  assert.equal(history.last, 100_000);
  for (const kept of [1, 33, 50_000, 100_000]) assert.ok(history.table.iteration.includes(kept), String(kept));
  for (const column of Object.values(history.table.values)) assert.equal(column.length, history.table.iteration.length);
});

test("the rate is over the last seconds", () => {
  const rate = new Rate(1000);
  assert.ok(Number.isNaN(rate.perSecond));
  for (let ms = 0; ms <= 5000; ms += 100) rate.mark(ms, ms < 4000 ? 0 : (ms - 4000) / 10);
  assert.ok(Math.abs(rate.perSecond - 100) < 10, String(rate.perSecond));
  rate.reset();
  assert.ok(Number.isNaN(rate.perSecond));
});

test("a closer look at a stretch takes the place of what is here of it", () => {
  const history = new History(50);
  history.load([1, 5, 10, 15, 20].map((i) => iteration(i)));
  history.add(iteration(21));
  assert.equal(history.rowsIn(5, 15), 3);
  assert.deepEqual(history.drawn([]).iteration, [1, 5, 10, 15, 20, 21]);
  const closer = history.drawn(range(8, 12).map((i) => iteration(i, 1000 + i)));
  assert.deepEqual(closer.iteration, [1, 5, 8, 9, 10, 11, 12, 15, 20, 21]);
  assert.equal(closer.values.cost[4], 1010);
  assert.equal(closer.values.fuel[4], 25);
  assert.deepEqual(history.drawn(range(18, 20).map((i) => iteration(i))).iteration, [1, 5, 10, 15, 18, 19, 20, 21]);
  assert.deepEqual(history.table.iteration, [1, 5, 10, 15, 20, 21], "the history itself stays");
});
