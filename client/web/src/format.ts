// Values as text. Everything a page shows of a number goes through here, so that columns line up and units are there.
import type { Real } from "./types";

const minus = "−";
export const none = "–";

// NaN for what is unset.
export function real(value: Real | string | null | undefined): number {
  return value === null || value === undefined || value === "" ? NaN : Number(value);
}

function signed(text: string): string {
  return text.startsWith("-") ? minus + text.slice(1) : text;
}

// `digits` significant digits; plain from 1e-3 to 1e6, else with an exponent.
export function significant(value: Real | null | undefined, digits = 5): string {
  const number = real(value);
  if (!Number.isFinite(number)) return Number.isNaN(number) ? none : number > 0 ? "∞" : minus + "∞";
  if (number === 0) return "0";
  const size = Math.abs(number);
  if (size < 1e-3 || size >= 1e6) {
    const [mantissa, exponent] = number.toExponential(digits - 1).split("e");
    return `${signed(mantissa!)}e${signed(exponent!.replace("+", ""))}`;
  }
  const before = Math.max(0, Math.floor(Math.log10(size)) + 1);
  return signed(number.toFixed(Math.max(0, Math.min(6, digits - before))));
}

// In running text: no digits that say nothing. 24364, 0.7306, 10
export function brief(value: Real | null | undefined, digits = 7): string {
  const number = real(value);
  if (!Number.isFinite(number)) return significant(value);
  const short = +number.toPrecision(digits);
  const small = short !== 0 && Math.abs(short) < 1e-3;
  return signed((small ? short.toExponential() : String(short)).replace("e-", `e${minus}`));
}

export function fixed(value: Real | null | undefined, decimals: number): string {
  const number = real(value);
  if (!Number.isFinite(number)) return none;
  const text = number.toFixed(decimals);
  return signed(Number(text) === 0 ? text.replace("-", "") : text);
}

export function withUnit(text: string, unit: string): string {
  return text === none || unit === "" ? text : `${text} ${unit}`;
}

// 12 345
export function count(value: number | string | null | undefined): string {
  const number = real(value as Real);
  return Number.isFinite(number) ? String(Math.round(number)).replace(/\B(?=(\d{3})+$)/g, " ") : none;
}

export function percent(value: Real | null | undefined, decimals = 1): string {
  return withUnit(fixed(value, decimals), "%");
}

// 100 (1 - now / before), in percent.
export function reductionPercent(before: Real | null | undefined, now: Real | null | undefined): number {
  return 100 * (1 - real(now) / real(before));
}

// 4.2 s, 3 min 20 s, 2 h 05 min, 3 d 04 h
export function duration(seconds: number): string {
  if (!Number.isFinite(seconds)) return none;
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  const two = (n: number) => String(n).padStart(2, "0");
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${two(whole % 60)} s`;
  const minutes = Math.round(whole / 60);
  if (minutes < 48 * 60) return `${Math.floor(minutes / 60)} h ${two(minutes % 60)} min`;
  const hours = Math.round(minutes / 60);
  return `${Math.floor(hours / 24)} d ${two(hours % 24)} h`;
}

// Simulated time: hours below two days, else days.
export function flightTime(seconds: Real | null | undefined): string {
  const s = real(seconds);
  return s < 48 * 3600 ? withUnit(fixed(s / 3600, 2), "h") : withUnit(fixed(s / 86400, 2), "d");
}

// 2026-03-01 12:34:56
export function utc(time: string | null | undefined): string {
  const date = time ? new Date(time) : null;
  return date && !Number.isNaN(date.getTime()) ? date.toISOString().slice(0, 19).replace("T", " ") : none;
}

// "JOB_STATE_RUNNING", "JOB_STATE_" -> "running"; "NOT_SETTLED" -> "not settled"
export function enumText(value: string | null | undefined, prefix: string): string {
  const name = (value ?? "").startsWith(prefix) ? value!.slice(prefix.length) : (value ?? "");
  return name === "UNSPECIFIED" || name === "" ? none : name.toLowerCase().replaceAll("_", " ");
}

export function idOf(name: string): string {
  return name.slice(name.indexOf("/") + 1);
}

export const subscript = (digit: number): string => String.fromCharCode(0x2080 + digit);
