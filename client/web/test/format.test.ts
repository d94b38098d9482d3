import assert from "node:assert/strict";
import { test } from "node:test";
import { brief, count, duration, enumText, fixed, flightTime, percent, reductionPercent, significant, utc, withUnit } from "../src/format";

test("numbers have so many significant digits, and an exponent where they are very large or small", () => {
  const cases: [number | "NaN" | "Infinity" | undefined, string][] = [
    [812.6284, "812.63"],
    [0.0123456, "0.01235"],
    [-3.5, "−3.5000"],
    [0, "0"],
    [123456, "123456"],
    [1234567, "1.2346e6"],
    [0.000012345, "1.2345e−5"],
    [undefined, "–"],
    ["NaN", "–"],
    ["Infinity", "∞"],
  ];
  for (const [value, text] of cases) assert.equal(significant(value), text);
});

test("running text has no digits that say nothing", () => {
  assert.equal(brief(24364.0000001), "24364");
  assert.equal(brief(-0.25), "−0.25");
  assert.equal(brief(-0.0000543), "−5.43e−5");
  assert.equal(brief(0), "0");
  assert.equal(brief("NaN"), "–");
});

test("fixed decimals know no negative zero", () => {
  assert.equal(fixed(-0.0001, 2), "0.00");
  assert.equal(fixed(-1.256, 2), "−1.26");
  assert.equal(fixed(NaN, 2), "–");
});

test("units stand by values only", () => {
  assert.equal(withUnit("1.5", "km"), "1.5 km");
  assert.equal(withUnit("–", "km"), "–");
  assert.equal(percent(41.23), "41.2 %");
});

test("counts are grouped", () => {
  assert.equal(count("1234567"), "1 234 567");
  assert.equal(count(999), "999");
  assert.equal(count(undefined), "–");
});

test("a reduction is of the first value", () => {
  assert.equal(reductionPercent(200, 50), 75);
  assert.ok(Number.isNaN(reductionPercent(undefined, 50)));
});

test("durations round up into the next unit", () => {
  assert.equal(duration(4.24), "4.2 s");
  assert.equal(duration(59.7), "1 min 00 s");
  assert.equal(duration(3599.9), "1 h 00 min");
  assert.equal(duration(3 * 86400 + 4 * 3600), "3 d 04 h");
  assert.equal(duration(Infinity), "–");
  assert.equal(flightTime(3600), "1.00 h");
  assert.equal(flightTime(86400 * 3), "3.00 d");
});

test("times are UTC", () => {
  assert.equal(utc("2026-03-01T23:59:59.999Z"), "2026-03-01 23:59:59");
  assert.equal(utc("2026-03-01T01:30:00+02:00"), "2026-02-28 23:30:00");
  assert.equal(utc(null), "–");
});

test("enums read as words", () => {
  assert.equal(enumText("JOB_STATE_RUNNING", "JOB_STATE_"), "running");
  assert.equal(enumText("OUTCOME_LEFT_DOMAIN", "OUTCOME_"), "left domain");
  assert.equal(enumText("OUTCOME_UNSPECIFIED", "OUTCOME_"), "–");
});
