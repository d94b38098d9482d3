// A form's texts made into the API's messages and the command line that says the same. Pure.
import type { Equinoctial, Gains, Hyperparameters, OrbitState, Scenario } from "./types";
import { gainKeys } from "./types";

export interface FieldSpec {
  key: string; // its path in Hyperparameters, or in a form of OrbitState
  label: string;
  unit: string;
  range: string;
  flag?: string; // of `orbitune submit`
  choices?: [value: string, text: string, flag: string][]; // the first is the default
  integer64?: boolean; // a string in JSON
  only?: string; // the algorithm it belongs to
}

export const algorithms: FieldSpec["choices"] = [
  ["ALGORITHM_ARS", "ARS (the paper's)", "ars"],
  ["ALGORITHM_CMA_ES", "CMA-ES", "cma-es"],
  ["ALGORITHM_NELDER_MEAD", "Nelder–Mead", "nelder-mead"],
];
const schedules: NonNullable<FieldSpec["choices"]> = [
  ["SCHEDULE_CONSTANT", "constant", "constant"],
  ["SCHEDULE_LINEAR", "linear, to 0", "linear"],
  ["SCHEDULE_INVERSE_SQRT", "1/√i", "inverse-sqrt"],
];
const ars = "ALGORITHM_ARS";
const cma = "ALGORITHM_CMA_ES";
const simplex = "ALGORITHM_NELDER_MEAD";

export const searchFields: FieldSpec[] = [
  { key: "algorithm", label: "Algorithm", unit: "", range: "", flag: "--algorithm", choices: algorithms! },
  { key: "iterations", label: "Iterations M", unit: "", range: "1 … 10 000 000", flag: "--iterations" },
  { key: "seed", label: "Seed", unit: "", range: "≥ 0", flag: "--seed", integer64: true },
  { key: "step_size", label: "Step size α", unit: "", range: "> 0", flag: "--step-size", only: ars },
  { key: "exploration_scale", label: "Exploration scale σ", unit: "", range: "> 0", flag: "--exploration-scale", only: ars },
  { key: "directions", label: "Directions N", unit: "", range: "1 … 1024", flag: "--directions", only: ars },
  { key: "gain_floor", label: "Gain floor", unit: "gain units", range: "> 0", flag: "--gain-floor" },
];
export const moreFields: FieldSpec[] = [
  { key: "max_episodes", label: "Episodes at most", unit: "", range: "≥ 0; 0: no bound (ARS)", flag: "--max-episodes", integer64: true },
  { key: "plateau_stop.iterations", label: "End on a plateau of", unit: "iterations", range: "≥ 0; 0: never", flag: "--plateau" },
  { key: "plateau_stop.min_improvement", label: "Least improvement", unit: "of J", range: "0 … < 1", flag: "--plateau-improvement" },
  { key: "ars_variants.top_directions", label: "Best directions b", unit: "", range: "0 … N; 0: all", flag: "--top-directions", only: ars },
  { key: "ars_variants.step_schedule", label: "α falls", unit: "", range: "", flag: "--step-schedule", choices: schedules, only: ars },
  { key: "ars_variants.exploration_schedule", label: "σ falls", unit: "", range: "", flag: "--exploration-schedule", choices: schedules, only: ars },
  { key: "cma_es.population", label: "Population", unit: "candidates", range: "4 … 1024", flag: "--population", only: cma },
  { key: "cma_es.initial_sigma", label: "Initial σ of ln K", unit: "", range: "1e−6 … 5", flag: "--initial-sigma", only: cma },
  { key: "cma_es.restarts", label: "Restarts", unit: "", range: "0 … 1000", flag: "--restarts", only: cma },
  { key: "cma_es.population_growth", label: "Population growth", unit: "×", range: "1 … 4", flag: "--population-growth", only: cma },
  { key: "nelder_mead.initial_step", label: "First simplex, in ln K", unit: "", range: "1e−6 … 5", flag: "--initial-step", only: simplex },
  { key: "nelder_mead.restarts", label: "Restarts", unit: "", range: "0 … 1000", flag: "--restarts", only: simplex },
];
export const gainFields: { key: "initial_gains" | "exploration_std"; label: string; flag: string; only?: string }[] = [
  { key: "initial_gains", label: "Initial gains K(1)", flag: "--initial-gains" },
  { key: "exploration_std", label: "Std of δ", flag: "--exploration-std", only: ars },
];

export type Form = "chaser" | "keplerian" | "equinoctial" | "cartesian";
export const forms: Record<Exclude<Form, "chaser">, FieldSpec[]> = {
  keplerian: [
    { key: "semi_major_axis_km", label: "Semi-major axis a", unit: "km", range: "> 0" },
    { key: "eccentricity", label: "Eccentricity e", unit: "", range: "0 … < 1" },
    { key: "inclination_deg", label: "Inclination i", unit: "deg", range: "0 … < 180" },
    { key: "raan_deg", label: "RAAN Ω", unit: "deg", range: "" },
    { key: "argument_of_periapsis_deg", label: "Arg. of periapsis ω", unit: "deg", range: "" },
    { key: "true_longitude_deg", label: "True longitude L", unit: "deg", range: "ω + Ω + ν" },
  ],
  equinoctial: [
    { key: "p_km", label: "Semi-parameter p", unit: "km", range: "> 0" },
    { key: "ex", label: "ex", unit: "", range: "e cos(ω + Ω)" },
    { key: "ey", label: "ey", unit: "", range: "e sin(ω + Ω)" },
    { key: "hx", label: "hx", unit: "", range: "tan(i/2) cos Ω" },
    { key: "hy", label: "hy", unit: "", range: "tan(i/2) sin Ω" },
    { key: "true_longitude_deg", label: "True longitude L", unit: "deg", range: "" },
  ],
  cartesian: [
    { key: "x_km", label: "x", unit: "km", range: "" },
    { key: "y_km", label: "y", unit: "km", range: "" },
    { key: "z_km", label: "z", unit: "km", range: "" },
    { key: "x_dot_km_s", label: "ẋ", unit: "km/s", range: "" },
    { key: "y_dot_km_s", label: "ẏ", unit: "km/s", range: "" },
    { key: "z_dot_km_s", label: "ż", unit: "km/s", range: "" },
  ],
};

// What was typed, by field path; nothing typed is no entry, or "".
export type Texts = Record<string, string>;

export interface JobForm {
  scenario: string; // scenarios/{id}
  title: string;
  labels: string; // key=value, key=value
  form: Form;
  texts: Texts; // "hyperparameters.step_size", "initial_condition.keplerian.raan_deg", …
  logGains: boolean;
}

// A number where the text is one; else the text, for the server to refuse in its own words.
function value(text: string, integer64 = false): number | string {
  const trimmed = text.trim().replace("−", "-");
  return integer64 || trimmed === "" || Number.isNaN(Number(trimmed)) ? trimmed : Number(trimmed);
}

function set(target: Record<string, unknown>, path: string, entry: unknown): void {
  const keys = path.split(".");
  let at = target;
  for (const key of keys.slice(0, -1)) at = (at[key] ??= {}) as Record<string, unknown>;
  at[keys[keys.length - 1]!] = entry;
}

export function valueAt(source: unknown, path: string): unknown {
  return path.split(".").reduce<unknown>((at, key) => (at as Record<string, unknown> | null | undefined)?.[key], source);
}

const given = (texts: Texts, path: string): boolean => (texts[path] ?? "").trim() !== "";

// Texts that are no number where one is needed: they never reach the server.
export function textFaults(texts: Texts): Record<string, string> {
  const words = new Set([...searchFields, ...moreFields].filter((f) => f.choices).map((f) => `hyperparameters.${f.key}`));
  const faults: Record<string, string> = {};
  for (const [path, text] of Object.entries(texts)) {
    if (words.has(path) || text.trim() === "" || !/^(hyperparameters|initial_condition)\./.test(path)) continue;
    if (!Number.isFinite(Number(text.trim().replace("−", "-")))) faults[path] = `must be a number, got '${text.trim()}'`;
  }
  return faults;
}

export function toInitialCondition(form: Form, texts: Texts): OrbitState | undefined {
  if (form === "chaser") return undefined;
  const fields: Record<string, number | string> = {};
  for (const field of forms[form]) {
    const path = `initial_condition.${form}.${field.key}`;
    if (given(texts, path)) fields[field.key] = value(texts[path]!);
  }
  return { [form]: fields } as OrbitState;
}

export function parseLabels(text: string): Record<string, string> {
  const pairs = text.split(",").map((part) => part.trim()).filter((part) => part !== "");
  return Object.fromEntries(pairs.map((pair) => {
    const at = pair.indexOf("=");
    return at < 0 ? [pair, ""] : [pair.slice(0, at).trim(), pair.slice(at + 1).trim()];
  }));
}

const chosenAlgorithm = (texts: Texts): string => texts["hyperparameters.algorithm"] || ars;

export function toHyperparameters(texts: Texts, defaults: Hyperparameters, logGains = false): Hyperparameters {
  const h: Record<string, unknown> = {};
  const algorithm = chosenAlgorithm(texts);
  for (const field of [...searchFields, ...moreFields]) {
    const path = `hyperparameters.${field.key}`;
    if (!given(texts, path) || (field.only && field.only !== algorithm)) continue;
    set(h, field.key, field.choices ? texts[path] : value(texts[path]!, field.integer64));
  }
  if (logGains && algorithm === ars) set(h, "ars_variants.log_gains", true);
  for (const { key, only } of gainFields) {
    if (only && only !== algorithm) continue;
    if (!gainKeys.some((gain) => given(texts, `hyperparameters.${key}.${gain}`))) continue;
    // One that is typed brings the others with it: a message of gains is whole.
    const gains = Object.fromEntries(gainKeys.map((gain) => {
      const text = texts[`hyperparameters.${key}.${gain}`] ?? "";
      return [gain, text.trim() === "" ? (defaults[key]?.[gain] ?? 0) : value(text)];
    }));
    set(h, key, gains);
  }
  return h as Hyperparameters;
}

export function toJob(form: JobForm, scenario: Scenario | undefined): Record<string, unknown> {
  const initialCondition = toInitialCondition(form.form, form.texts);
  const hyperparameters = toHyperparameters(form.texts, scenario?.hyperparameters ?? {}, form.logGains);
  const labels = parseLabels(form.labels);
  return {
    scenario: form.scenario,
    ...(form.title.trim() === "" ? {} : { display_name: form.title.trim() }),
    ...(Object.keys(labels).length === 0 ? {} : { labels }),
    ...(initialCondition ? { initial_condition: initialCondition } : {}),
    ...(Object.keys(hyperparameters).length === 0 ? {} : { hyperparameters }),
  };
}

export function shellQuoted(text: string): string {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}

export function toCommand(form: JobForm, scenario: Scenario | undefined): string {
  const words: string[] = ["--scenario", form.scenario.replace("scenarios/", "")];
  if (form.title.trim() !== "") words.push("--name", form.title.trim());
  for (const [key, text] of Object.entries(parseLabels(form.labels))) words.push("--label", `${key}=${text}`);
  const job = toJob(form, scenario) as { hyperparameters?: Hyperparameters; initial_condition?: OrbitState };
  for (const field of [...searchFields, ...moreFields]) {
    const entry = valueAt(job.hyperparameters, field.key);
    if (entry === undefined || !field.flag) continue;
    words.push(field.flag, field.choices?.find(([name]) => name === entry)?.[2] ?? String(entry));
  }
  if (job.hyperparameters?.ars_variants?.log_gains) words.push("--log-gains");
  for (const { key, flag } of gainFields) {
    const gains = job.hyperparameters?.[key];
    if (gains) words.push(flag, gainKeys.map((gain) => gains[gain]).join(","));
  }
  const state = form.form === "chaser" ? undefined : job.initial_condition?.[form.form];
  if (state) words.push("--ic", Object.entries(state).map(([key, entry]) => `${key}=${String(entry)}`).join(","));
  let line = "orbitune submit";
  for (let i = 0; i < words.length; ++i) {
    const word = words[i]!;
    const next = words[i + 1];
    const pair = word.startsWith("--") && next !== undefined && !next.startsWith("--");
    line += ` ${word}${pair ? ` ${shellQuoted(next)}` : ""}`;
    if (pair) ++i;
  }
  return line;
}

// The violation of each field, by the path its input has; what belongs to none is under "".
export function violationsByField(
  violations: readonly { field: string; description: string }[],
  paths: readonly string[],
): Record<string, string> {
  const found: Record<string, string> = {};
  for (const { field, description } of violations) {
    const bare = field.replace(/^(job|campaign)\./, "");
    const path = paths.find((p) => p === bare) ?? paths.find((p) => bare.startsWith(`${p}.`)) ?? paths.find((p) => p.startsWith(`${bare}.`)) ?? "";
    const text = path === "" ? `${bare}: ${description}` : description;
    found[path] = found[path] ? `${found[path]}; ${text}` : text;
  }
  return found;
}

const degree = Math.PI / 180;
const round = (x: number): number => +x.toPrecision(12);
const turn = (deg: number): number => ((deg % 360) + 360) % 360;

function toEquinoctial(k: NonNullable<OrbitState["keplerian"]>): Equinoctial {
  const [a, e, i] = [k.semi_major_axis_km ?? 0, k.eccentricity ?? 0, (k.inclination_deg ?? 0) * degree];
  const [node, periapsis] = [k.raan_deg ?? 0, k.argument_of_periapsis_deg ?? 0];
  const longitude = (node + periapsis) * degree;
  return {
    p_km: a * (1 - e * e),
    ex: e * Math.cos(longitude),
    ey: e * Math.sin(longitude),
    hx: Math.tan(i / 2) * Math.cos(node * degree),
    hy: Math.tan(i / 2) * Math.sin(node * degree),
    true_longitude_deg: k.true_longitude_deg ?? node + periapsis + (k.true_anomaly_deg ?? 0),
  };
}

// The scenario's chaser as a form to begin from: in its own form as it is, in the others converted.
export function chaserTexts(form: Form, chaser: OrbitState, mu: number): Texts {
  if (form === "chaser") return {};
  const own = chaser[form];
  const equinoctial = chaser.equinoctial ?? (chaser.keplerian ? toEquinoctial(chaser.keplerian) : null);
  const fields: Record<string, number> = {};
  if (own) Object.assign(fields, own);
  else if (equinoctial && form === "equinoctial") Object.assign(fields, equinoctial);
  else if (equinoctial && form === "keplerian") Object.assign(fields, keplerianOf(equinoctial));
  else if (equinoctial && form === "cartesian") Object.assign(fields, cartesianOf(equinoctial, mu));
  if (form === "keplerian" && fields.true_longitude_deg === undefined) {
    fields.true_longitude_deg = (fields.raan_deg ?? 0) + (fields.argument_of_periapsis_deg ?? 0) + (fields.true_anomaly_deg ?? 0);
  }
  return Object.fromEntries(
    forms[form].map(({ key }) => [`initial_condition.${form}.${key}`, String(round(fields[key] ?? 0))]),
  );
}

function keplerianOf(q: Equinoctial): Record<string, number> {
  const e = Math.hypot(q.ex, q.ey);
  const node = Math.atan2(q.hy, q.hx) / degree;
  const periapsis = e === 0 ? 0 : Math.atan2(q.ey, q.ex) / degree - node;
  return {
    semi_major_axis_km: q.p_km / (1 - e * e),
    eccentricity: e,
    inclination_deg: (2 * Math.atan(Math.hypot(q.hx, q.hy))) / degree,
    raan_deg: turn(node),
    argument_of_periapsis_deg: turn(periapsis),
    true_longitude_deg: q.true_longitude_deg,
  };
}

function cartesianOf(q: Equinoctial, mu: number): Record<string, number> {
  const { hx, hy } = q;
  const s = 1 + hx * hx + hy * hy;
  const f = [(1 + hx * hx - hy * hy) / s, (2 * hx * hy) / s, (-2 * hy) / s];
  const g = [(2 * hx * hy) / s, (1 - hx * hx + hy * hy) / s, (2 * hx) / s];
  const [cos, sin] = [Math.cos(q.true_longitude_deg * degree), Math.sin(q.true_longitude_deg * degree)];
  const r = q.p_km / (1 + q.ex * cos + q.ey * sin);
  const v = Math.sqrt(mu / q.p_km);
  const names = ["x", "y", "z"];
  return Object.fromEntries([
    ...names.map((name, i) => [`${name}_km`, r * (cos * f[i]! + sin * g[i]!)] as const),
    ...names.map((name, i) => [`${name}_dot_km_s`, v * (-(q.ey + sin) * f[i]! + (q.ex + cos) * g[i]!)] as const),
  ]);
}

export const gainsOf = (gains: Gains): number[] => gainKeys.map((key) => gains[key]);
