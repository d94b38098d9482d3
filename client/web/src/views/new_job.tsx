// A job to be: what is typed is checked by the server as one types, and shown as the command and the JSON it comes to.
import { useEffect, useMemo, useState } from "preact/hooks";
import { ApiError, get, post } from "../api";
import { Field, InitialConditionFields } from "../fields";
import {
  type FieldSpec,
  type JobForm,
  forms,
  gainFields,
  moreFields,
  searchFields,
  textFaults,
  toCommand,
  toJob,
  valueAt,
  violationsByField,
} from "../form";
import { brief, idOf } from "../format";
import { gainUnits } from "../orbit";
import { Copy, Fault, gainName, orbitText } from "../parts";
import { messageOf, useLoaded, useSettled, useTitle } from "../store";
import { type Job, type Scenario, gainKeys } from "../types";

const empty: JobForm = { scenario: "scenarios/gto-geo", title: "", labels: "", form: "chaser", texts: {}, logGains: false };

const allPaths: string[] = [
  "display_name",
  "labels",
  ...[...searchFields, ...moreFields].map((f) => `hyperparameters.${f.key}`),
  ...gainFields.flatMap((f) => gainKeys.map((gain) => `hyperparameters.${f.key}.${gain}`)),
  ...Object.entries(forms).flatMap(([form, fields]) => fields.map((f) => `initial_condition.${form}.${f.key}`)),
];

interface Check {
  busy: boolean;
  resolved: Job | null; // every default filled in
  faults: Record<string, string>;
  error: string; // not of the input
}

function useCheck(job: Record<string, unknown>, local: Record<string, string>): Check {
  const text = JSON.stringify(job);
  const settled = useSettled(text, 300);
  const [check, setCheck] = useState<Check>({ busy: true, resolved: null, faults: {}, error: "" });
  useEffect(() => {
    if (Object.keys(local).length > 0) return;
    const abort = new AbortController();
    setCheck((old) => ({ ...old, busy: true }));
    post<Job>("/v1/jobs?validate_only=true", JSON.parse(settled), abort.signal)
      .then((resolved) => setCheck({ busy: false, resolved, faults: {}, error: "" }))
      .catch((error: unknown) => {
        if (abort.signal.aborted) return;
        const violations = error instanceof ApiError ? error.violations : [];
        const faults = violationsByField(violations, allPaths);
        setCheck((old) => ({ ...old, busy: false, faults, error: violations.length > 0 ? "" : messageOf(error) }));
      });
    return () => abort.abort();
  }, [settled]);
  return Object.keys(local).length > 0 ? { ...check, faults: local, error: "" } : { ...check, busy: check.busy || text !== settled };
}

function standardOf(scenario: Scenario | undefined, resolved: Job | null, key: string): string {
  const own = valueAt(scenario?.hyperparameters, key) ?? valueAt(resolved?.hyperparameters, key);
  return own === undefined || own === null ? "" : typeof own === "number" ? String(+own.toPrecision(7)) : String(own);
}

export function NewJobView() {
  useTitle("New job");
  const scenarios = useLoaded("scenarios", (signal) => get<{ scenarios: Scenario[] }>("/v1/scenarios", signal));
  const [form, setForm] = useState<JobForm>(empty);
  const [submitting, setSubmitting] = useState(false);
  const [error, setError] = useState("");
  const scenario = scenarios.value?.scenarios.find((s) => s.name === form.scenario);
  const job = useMemo(() => toJob(form, scenario), [form, scenario]);
  const local = useMemo(() => textFaults(form.texts), [form.texts]);
  const check = useCheck(job, local);
  const input = (path: string, text: string) => setForm((old) => ({ ...old, texts: { ...old.texts, [path]: text } }));
  const algorithm = form.texts["hyperparameters.algorithm"] || "ALGORITHM_ARS";
  // The same form sent twice is one job: each form shown has its own id.
  const requestId = useMemo(() => `web-${Array.from(crypto.getRandomValues(new Uint32Array(4)), (n) => n.toString(36)).join("")}`, []);

  const submit = async (event: Event) => {
    event.preventDefault();
    setSubmitting(true);
    setError("");
    try {
      const created = await post<Job>(`/v1/jobs?request_id=${requestId}`, job);
      location.hash = `#/${created.name}`;
    } catch (e) {
      setError(messageOf(e));
      setSubmitting(false);
    }
  };
  const field = (spec: FieldSpec) => {
    const path = `hyperparameters.${spec.key}`;
    return (!spec.only || spec.only === algorithm) && (
      <Field
        key={path}
        path={path}
        spec={spec}
        text={form.texts[path] ?? ""}
        standard={standardOf(scenario, check.resolved, spec.key)}
        fault={check.faults[path]}
        input={input}
      />
    );
  };
  const faultCount = Object.keys(check.faults).length;
  return (
    <article>
      <h1>New job</h1>
      {scenarios.error && <Fault>{scenarios.error}</Fault>}
      <form onSubmit={(e) => void submit(e)} noValidate>
        <fieldset>
          <legend>Scenario</legend>
          <div class="presets">
            {(scenarios.value?.scenarios ?? []).map((s) => (
              <label class="preset" key={s.name}>
                <input
                  type="radio"
                  name="scenario"
                  value={s.name}
                  checked={s.name === form.scenario}
                  onChange={() => setForm((old) => ({ ...old, scenario: s.name, form: "chaser" }))}
                />
                <span>
                  <strong>{s.display_name}</strong> <code>{idOf(s.name)}</code>
                  <small>{s.description}</small>
                </span>
              </label>
            ))}
          </div>
          {scenario && (
            <p class="note">
              {`Target ${orbitText(scenario.target)}. Chaser ${orbitText(scenario.chaser)}. Sampled every ${brief(scenario.sampling_period_s / 60, 4)} min, at most ${scenario.horizon_samples} times; ρ = ${brief(scenario.fuel_weight, 4)}; settled within ${brief(scenario.settling_distance_km, 4)} km.`}
            </p>
          )}
        </fieldset>
        <fieldset>
          <legend>Name</legend>
          <div class="fields">
            <Field
              path="display_name"
              spec={{ label: "Title", unit: "", range: "" }}
              text={form.title}
              standard="none"
              fault={check.faults.display_name}
              input={(_, title) => setForm((old) => ({ ...old, title }))}
            />
            <Field
              path="labels"
              spec={{ label: "Labels", unit: "", range: "key=value, key=value" }}
              text={form.labels}
              standard="none"
              fault={check.faults.labels}
              input={(_, labels) => setForm((old) => ({ ...old, labels }))}
            />
          </div>
        </fieldset>
        <InitialConditionFields
          form={form.form}
          texts={form.texts}
          faults={check.faults}
          scenario={scenario}
          choose={(chosen, texts) => setForm((old) => ({ ...old, form: chosen, texts: { ...old.texts, ...texts } }))}
          input={input}
        />
        <fieldset>
          <legend>Search</legend>
          <div class="fields">{searchFields.map(field)}</div>
          {gainFields
            .filter((f) => !f.only || f.only === algorithm)
            .map(({ key, label }) => (
              <div class="fields five" role="group" aria-label={label} key={key}>
                {gainKeys.map((gain, i) => {
                  const path = `hyperparameters.${key}.${gain}`;
                  return (
                    <Field
                      key={path}
                      path={path}
                      spec={{ label: i === 0 ? `${label}: ${gainName(i)}` : gainName(i), unit: "", range: key === "initial_gains" ? "≥ gain floor" : "≥ 0" }}
                      text={form.texts[path] ?? ""}
                      standard={standardOf(scenario, check.resolved, `${key}.${gain}`)}
                      fault={check.faults[path]}
                      input={input}
                    />
                  );
                })}
              </div>
            ))}
          <details>
            <summary>More: when to end, variants</summary>
            <div class="fields">{moreFields.map(field)}</div>
            {algorithm === "ALGORITHM_ARS" && (
              <label class="check">
                <input type="checkbox" checked={form.logGains} onChange={(e) => { const on = e.currentTarget.checked; setForm((old) => ({ ...old, logGains: on })); }} />
                search over ln K
              </label>
            )}
          </details>
          <p class="note">
            {scenario && `K₁ is in ${brief(gainUnits(scenario).velocity_m_s, 5)} m/s, K₂ to K₅ in ${brief(1000 * gainUnits(scenario).acceleration_m_s2, 5)} mm/s². What is left empty takes the grey value.`}
          </p>
        </fieldset>
        {check.faults[""] && <Fault>{check.faults[""]}</Fault>}
        {(error || check.error) && <Fault>{error || check.error}</Fault>}
        <p class="actions">
          <button type="submit" class="primary" disabled={submitting || faultCount > 0}>Submit</button>
          <span role="status" data-testid="check">
            {faultCount > 0 ? `${faultCount} ${faultCount === 1 ? "field needs" : "fields need"} attention` : check.busy ? "checking…" : check.error ? "" : "the server would take it"}
          </span>
        </p>
      </form>
      <div class="grid two">
        <Copy label="The same on the command line" text={toCommand(form, scenario)} />
        <Copy label="The same as JSON, for POST /v1/jobs" text={JSON.stringify(job, null, 2)} />
      </div>
    </article>
  );
}
