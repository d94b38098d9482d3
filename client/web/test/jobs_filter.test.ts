import assert from "node:assert/strict";
import { test } from "node:test";
import { serverFilter } from "../src/views/jobs";

const filter = (text: string, state = "", scenario = ""): string => serverFilter({ state, scenario, text });

test("the list's filter in the server's words", () => {
  assert.equal(filter("  "), "");
  assert.equal(filter("", "RUNNING", "gto-geo"), 'state = RUNNING AND scenario = "gto-geo"');
  assert.equal(filter("board = seven"), 'labels.board = "seven"');
  assert.equal(filter("labels.board != 7", "FAILED"), 'state = FAILED AND labels.board != "7"');
  assert.equal(filter("scenario=gto-geo"), 'scenario = "gto-geo"');
});

test("what is no comparison is looked for word by word", () => {
  assert.equal(filter("GTO to"), 'text = "GTO" AND text = "to"');
  assert.equal(filter('a"b\\'), 'text = "a\\"b\\\\"');
});
