import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

const css = readFileSync("src/style.css", "utf8");
const properties = (block: string): Record<string, string> =>
  Object.fromEntries([...block.matchAll(/(--[\w-]+):\s*(#[0-9a-f]{6})/g)].map(([, name, value]) => [name!, value!]));
const [light, dark] = [...css.matchAll(/:root \{([^}]*)\}/g)].map((match) => properties(match[1]!));

// WCAG 2: relative luminance and contrast.
function luminance(hex: string): number {
  const [r, g, b] = [1, 3, 5].map((at) => {
    const c = parseInt(hex.slice(at, at + 2), 16) / 255;
    return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r! + 0.7152 * g! + 0.0722 * b!;
}
function contrast(a: string, b: string): number {
  const [high, low] = [luminance(a), luminance(b)].sort((x, y) => y - x);
  return (high! + 0.05) / (low! + 0.05);
}

for (const [scheme, colours] of [["light", light!], ["dark", dark!]] as const) {
  test(`texts and curves stand out to WCAG AA, ${scheme}`, () => {
    const texts = ["text", "muted", "accent", "good", "bad", "caution"].flatMap((name) => [[name, "card"], [name, "back"]]);
    texts.push(["on-accent", "accent"], ["bad", "bad-back"], ["caution", "caution-back"], ["text", "grid"], ["muted", "grid"]);
    for (const [text, back] of texts) {
      const found = contrast(colours[`--${text}`]!, colours[`--${back}`]!);
      assert.ok(found >= 4.5, `${text} on ${back}: ${found.toFixed(2)}`);
    }
    for (const curve of ["before", "after", "c1", "c2", "c3", "c4", "c5", "c6", "c7", "c8"]) {
      const found = contrast(colours[`--${curve}`]!, colours["--card"]!);
      assert.ok(found >= 3, `${curve}: ${found.toFixed(2)}`);
    }
  });
}
