// Gains for an initial condition that nobody tuned for: what the library has, flown from there and ranked.
import { useEffect, useState } from "preact/hooks";
import { get, post, ApiError } from "../api";
import { InitialConditionFields } from "../fields";
import { type Form, type Texts, forms, textFaults, toInitialCondition, violationsByField } from "../form";
import { type Flown, fly } from "../flights";
import { count, enumText, fixed, idOf, real, significant } from "../format";
import { Fault, State, gainName } from "../parts";
import { isMissing, messageOf, useLoaded, useTitle } from "../store";
import { type Certificate, type Gains, type GainAnswer, type GainQueryAnswer, type OrbitState, type Scenario, gainKeys } from "../types";
import { FlightCharts } from "./flight_charts";

const drawnAnswers = 3;
const paths = Object.entries(forms).flatMap(([form, fields]) => fields.map((f) => `initial_condition.${form}.${f.key}`));

const sourceText = (answer: GainAnswer) => enumText(answer.source, "CANDIDATE_SOURCE_");

function CertificateMarks({ of }: { of: Certificate | undefined }) {
  if (!of) return <>–</>;
  const marks: [string, boolean, string][] = [
    ["K", of.gains_positive, "all gains positive"],
    ["D", of.domain_guaranteed, "certain to stay in the domain"],
    ["V", of.lyapunov_decreasing, "V never rose along the flight"],
    ["S", of.settled, "settled within the horizon"],
  ];
  return (
    <span class="marks">
      {marks.map(([letter, holds, text]) => <abbr key={letter} class={holds ? "yes" : "no"} title={`${text}: ${holds ? "yes" : "no"}`}>{letter}{holds ? "✓" : "–"}</abbr>)}
    </span>
  );
}

interface Asked {
  scenario: Scenario;
  initialCondition: OrbitState | undefined;
  answer: GainQueryAnswer;
}

export function GainsView() {
  useTitle("Gains");
  const scenarios = useLoaded("scenarios", (signal) => get<{ scenarios: Scenario[] }>("/v1/scenarios", signal));
  const [scenarioName, setScenarioName] = useState("scenarios/gto-geo");
  const [form, setForm] = useState<Form>("chaser");
  const [texts, setTexts] = useState<Texts>({});
  const [budget, setBudget] = useState("500");
  const [asked, setAsked] = useState<Asked | null>(null);
  const [busy, setBusy] = useState("");
  const [error, setError] = useState("");
  const [faults, setFaults] = useState<Record<string, string>>({});
  const [flights, setFlights] = useState<Flown[]>([]);
  const scenario = scenarios.value?.scenarios.find((s) => s.name === scenarioName);

  const ask = async (refine: boolean) => {
    const local = textFaults(texts);
    setFaults(local);
    if (Object.keys(local).length > 0 || !scenario) return;
    setBusy(refine ? "searching…" : "flying candidates…");
    setError("");
    const initialCondition = toInitialCondition(form, texts);
    try {
      const answer = await post<GainQueryAnswer>("/v1/gains:query", {
        scenario: scenarioName,
        ...(initialCondition ? { initial_condition: initialCondition } : {}),
        ...(refine ? { refine: { budget_ms: Number(budget) || 0 } } : {}),
      });
      setFaults({});
      setAsked({ scenario, initialCondition, answer });
    } catch (e) {
      const violations = e instanceof ApiError ? e.violations : [];
      setFaults(violationsByField(violations, paths));
      setError(violations.length > 0 ? "" : isMissing(e) ? "this server has no gain library" : messageOf(e));
    }
    setBusy("");
  };

  useEffect(() => {
    setFlights([]);
    if (!asked) return;
    const abort = new AbortController();
    const best = asked.answer.answers.slice(0, drawnAnswers);
    const longest = Math.max(1, ...best.map((a) => a.flight.settling_samples));
    const one = (gains: Gains) => fly(asked.scenario, asked.initialCondition, gains, longest, 200, abort.signal);
    Promise.all(best.map((a) => one(a.gains)))
      .then((episodes) =>
        setFlights(episodes.map((episode, i) => ({ label: `${i + 1}: ${sourceText(best[i]!)}`, colour: `--c${i + 1}`, episode })).reverse()),
      )
      .catch((e: unknown) => abort.signal.aborted || setError(messageOf(e)));
    return () => abort.abort();
  }, [asked]);

  const position = asked?.answer.position;
  return (
    <article data-testid="gains">
      <h1>Gains for an initial condition</h1>
      <form
        noValidate
        onSubmit={(e) => {
          e.preventDefault();
          void ask(false);
        }}
      >
        <fieldset>
          <legend>From where</legend>
          <div class="fields">
            <div class="field">
              <label for="gains-scenario">Scenario</label>
              <select id="gains-scenario" value={scenarioName} onChange={(e) => { setScenarioName(e.currentTarget.value); setForm("chaser"); }}>
                {(scenarios.value?.scenarios ?? []).map((s) => <option key={s.name} value={s.name}>{s.display_name}</option>)}
              </select>
              <p class="note">the library of the same dynamics and cost is asked</p>
            </div>
            <div class="field">
              <label for="gains-budget">Time to refine<small>, ms</small></label>
              <input id="gains-budget" type="text" inputMode="numeric" value={budget} onInput={(e) => setBudget(e.currentTarget.value)} />
              <p class="note">1 … 10 000</p>
            </div>
          </div>
        </fieldset>
        <InitialConditionFields
          form={form}
          texts={texts}
          faults={faults}
          scenario={scenario}
          choose={(to, converted) => { setForm(to); setTexts(converted); setFaults({}); }}
          input={(path, text) => setTexts((old) => ({ ...old, [path]: text }))}
        />
        {faults[""] && <Fault>{faults[""]}</Fault>}
        {error && <Fault>{error}</Fault>}
        <p class="actions">
          <button class="primary" type="submit" disabled={busy !== "" || !scenario}>Query</button>
          <button type="button" disabled={busy !== "" || !asked} onClick={() => void ask(true)}>Refine</button>
          <span role="status">{busy}</span>
        </p>
      </form>
      {asked && (
        <section aria-labelledby="answers">
          <h2 id="answers">Answers, flown from there</h2>
          {asked.answer.message && <p class={asked.answer.settled && !position?.extrapolated ? "conclusion" : "conclusion caution"}>{asked.answer.message}</p>}
          <p class="note">
            {`${count(position?.library_size)} gain sets in the library, ${count(asked.answer.candidates)} candidates flown, ${count(asked.answer.candidates_settled)} settled. `}
            {position && Number.isFinite(real(position.nearest_distance)) && `Nearest start ${significant(position.nearest_distance, 3)} away, typical ${significant(position.typical_distance, 3)} (in standard deviations). `}
            {asked.answer.refinement && `Refined with ${count(asked.answer.refinement.episodes)} episodes in ${fixed(asked.answer.refinement.elapsed_s, 2)} s: ${asked.answer.refinement.improved ? "better" : "nothing better found"}.`}
          </p>
          <div class="scroll">
            <table data-testid="answers">
              <thead>
                <tr>
                  <th scope="col" class="number">Rank</th>
                  <th scope="col">Source</th>
                  <th scope="col">Outcome</th>
                  <th scope="col" class="number">J</th>
                  <th scope="col" class="number">Settling time, h</th>
                  <th scope="col" class="number">Δv, m/s</th>
                  <th scope="col" class="number">Peak, mm/s²</th>
                  <th scope="col" class="number">Distance</th>
                  {gainKeys.map((key, i) => <th scope="col" class="number" key={key}>{gainName(i)}</th>)}
                  <th scope="col">Certificate</th>
                </tr>
              </thead>
              <tbody>
                {asked.answer.answers.map((a, rank) => (
                  <tr key={rank}>
                    <td class="number">{rank < drawnAnswers && <span class={`swatch s${rank + 1}`} aria-hidden="true" />} {rank + 1}</td>
                    <th scope="row" title={a.gain_set}>{sourceText(a)}{a.gain_set && <small>{` ${idOf(a.gain_set)}`}</small>}</th>
                    <td title={a.flight.outcome_message}><State of={a.flight.outcome} prefix="OUTCOME_" /></td>
                    <td class="number">{significant(a.flight.cost)}</td>
                    <td class="number">{fixed(a.flight.settling_time_s / 3600, 2)}</td>
                    <td class="number">{fixed(a.flight.delta_v_m_s, 1)}</td>
                    <td class="number">{fixed(1000 * real(a.flight.peak_acceleration_m_s2), 3)}</td>
                    <td class="number">{significant(a.distance, 3)}</td>
                    {gainKeys.map((key) => <td class="number" key={key}>{significant(a.gains[key])}</td>)}
                    <td><CertificateMarks of={a.flight.certificate} /></td>
                  </tr>
                ))}
              </tbody>
            </table>
          </div>
        </section>
      )}
      {asked && flights.length > 0 && (
        <section aria-labelledby="predicted">
          <h2 id="predicted">{`Predicted flights of the best ${flights.length}`}</h2>
          <FlightCharts flights={flights} sync="predicted" settlingKm={asked.scenario.settling_distance_km} />
        </section>
      )}
    </article>
  );
}
