// One job: its history as it grows, what tuning changed, and where it all comes from.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { ApiError, Stream, get } from "../api";
import { Chart } from "../chart";
import { type Flown, fly } from "../flights";
import { brief, count, duration, enumText, fixed, flightTime, idOf, percent, real, reductionPercent, significant, utc, withUnit } from "../format";
import { type History, Rate } from "../history";
import { JobActions } from "../job_actions";
import { JobEvents, isTerminal } from "../job_events";
import { gainUnits } from "../orbit";
import { Copy, Facts, Fault, GainsLine, Progress, State, gainName, orbitText, save } from "../parts";
import { isMissing, messageOf, useTitle } from "../store";
import { type EpisodeResult, type GainsAssessment, type Iteration, type Job, gainKeys } from "../types";
import { Proof } from "../verify";
import { FlightCharts } from "./flight_charts";

const samplePoints = 1200;
const flightSamples = 200;

interface Live {
  events: JobEvents;
  rate: Rate;
  connected: boolean;
  everConnected: boolean;
  reconnects: number;
  error: string;
  version: number; // changes with what is to be drawn
}

function useJob(name: string): Live {
  const [, draw] = useState(0);
  const ref = useRef<Live | null>(null);
  const begin = (): Live => ({
    events: new JobEvents(),
    rate: new Rate(),
    connected: true,
    everConnected: false,
    reconnects: 0,
    error: "",
    version: 0,
  });
  const [made, setMade] = useState(name);
  if (!ref.current || made !== name) {
    ref.current = begin();
    if (made !== name) setMade(name);
  }
  const live = ref.current;
  useEffect(() => {
    const abort = new AbortController();
    const { events } = live;
    let fetching = false;
    let early: Iteration[] | null = null;
    const changed = () => {
      ++live.version;
      draw((n) => n + 1);
    };
    const sample = async () => {
      if (fetching) return;
      fetching = true;
      try {
        const path = `/v1/${name}/iterations?max_points=${samplePoints}`;
        const answer = await get<{ iterations: Iteration[] }>(path, abort.signal);
        live.error = "";
        if (events.history) events.loadSample(answer.iterations);
        else early = answer.iterations;
        fetching = false;
        if (events.needsSample) setTimeout(() => void sample(), 200);
        changed();
      } catch (error) {
        fetching = false;
        if (abort.signal.aborted) return;
        // Lost with the connection: it is taken again when that is back.
        if (error instanceof ApiError && error.code === 0) return;
        live.error = messageOf(error);
        if (isMissing(error)) stream.close();
        changed();
      }
    };
    // The sample and the stream are asked for at once; where the stream begins beyond the sample, another is taken.
    const stream = new Stream(`/v1/${name}:watch`, {
      events: (batch) => {
        const before = events.job?.state;
        for (const event of batch) {
          events.apply(event);
          if (early && events.history) {
            events.loadSample(early);
            early = null;
          }
        }
        const { job, history } = events;
        if (!job || !history) return;
        if (events.needsSample) void sample();
        if (job.state !== before) live.rate.reset();
        if (job.state === "JOB_STATE_RUNNING") live.rate.mark(performance.now(), history.last);
        if (isTerminal(job.state) && events.lastSeq >= Number(job.last_seq)) stream.close();
        changed();
      },
      connected: (connected) => {
        const lost = live.connected && !connected;
        if (connected && live.everConnected && !live.connected) ++live.reconnects;
        live.everConnected ||= connected;
        live.connected = connected || (events.job !== null && isTerminal(events.job.state));
        if (lost) live.rate.reset();
        if (connected && events.needsSample) void sample();
        changed();
      },
    });
    void sample();
    return () => {
      abort.abort();
      stream.close();
    };
  }, [name]);
  return live;
}

const outcome = (r: EpisodeResult) => enumText(r.outcome, "OUTCOME_");

function reductionCell(value: number) {
  if (!Number.isFinite(value)) return <td class="number">–</td>;
  return <td class={`number ${value >= 0 ? "good" : "bad"}`}>{`${value >= 0 ? "−" : "+"}${Math.abs(value).toFixed(1)} %`}</td>;
}

type Row = [string, string, (a: GainsAssessment) => number, number];
function resultRows(rho: number): Row[] {
  return [
    ["Cost J", "", (a) => real(a.result.cost), 3],
    ["Settling samples Hc", "", (a) => a.result.settling_samples, 0],
    ["Settling time", "h", (a) => a.result.settling_time_s / 3600, 2],
    [`Fuel term ${brief(rho)} Σ‖u‖`, "", (a) => rho * real(a.result.fuel_sum), 3],
    ["Δv to settling", "m/s", (a) => real(a.result.delta_v_to_settling_m_s), 1],
    ["Peak acceleration", "mm/s²", (a) => 1000 * real(a.result.peak_acceleration_m_s2), 3],
  ];
}

function Report({ job }: { job: Job }) {
  const report = job.report!;
  const rho = job.scenario_definition?.fuel_weight ?? NaN;
  const units = job.scenario_definition ? gainUnits(job.scenario_definition) : null;
  const columns: [string, GainsAssessment][] = [
    [`First, i = 1`, report.initial],
    [`Last, i = ${count(report.final.iteration)}`, report.final],
    [`Best, i = ${count(report.best.iteration)}`, report.best],
  ];
  return (
    <section aria-labelledby="results">
      <h2 id="results">Result</h2>
      <div class="scroll">
        <table>
          <thead>
            <tr>
              <th scope="col">Over the full horizon</th>
              {columns.map(([title]) => <th scope="col" class="number" key={title}>{title}</th>)}
              <th scope="col" class="number">Best against first</th>
            </tr>
          </thead>
          <tbody>
            {resultRows(rho).map(([title, unit, value, decimals]) => (
              <tr key={title}>
                <th scope="row">{title}{unit && <small>, {unit}</small>}</th>
                {columns.map(([column, of]) => <td class="number" key={column}>{fixed(value(of), decimals)}</td>)}
                {reductionCell(reductionPercent(value(report.initial), value(report.best)))}
              </tr>
            ))}
            <tr>
              <th scope="row">Outcome</th>
              {columns.map(([column, of]) => <td class="number" key={column} title={of.result.outcome_message}>{outcome(of.result)}</td>)}
              <td />
            </tr>
            {gainKeys.map((key, i) => (
              <tr key={key}>
                <th scope="row">{gainName(i)}{units && <small>{`, × ${brief(i === 0 ? units.velocity_m_s : 1000 * units.acceleration_m_s2, 6)} ${i === 0 ? "m/s" : "mm/s²"}`}</small>}</th>
                {columns.map(([column, of]) => <td class="number" key={column}>{significant(of.gains[key], 6)}</td>)}
                <td />
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </section>
  );
}

function Certificate({ result }: { result: EpisodeResult }) {
  const guaranteed = result.domain_guarantee === "DOMAIN_GUARANTEE_GUARANTEED";
  return (
    <ul class="checks">
      <li class="yes">all gains positive, as the proof of stability asks</li>
      <li class={guaranteed ? "yes" : "open"}>
        {guaranteed ? "certain to stay in the domain" : "not certain beforehand to stay in the domain; it did when flown"}, V(0) ={" "}
        {significant(result.initial_lyapunov, 4)}
      </li>
      <li class={result.outcome === "OUTCOME_SETTLED" ? "yes" : "no"}>{outcome(result)}{result.outcome === "OUTCOME_SETTLED" && ` after ${flightTime(result.settling_time_s)}`}</li>
    </ul>
  );
}

async function allIterations(name: string): Promise<Iteration[]> {
  const all: Iteration[] = [];
  for (let token = ""; ; ) {
    const path = `/v1/${name}/iterations?page_size=10000${token && `&page_token=${encodeURIComponent(token)}`}`;
    const page = await get<{ iterations: Iteration[]; next_page_token: string }>(path);
    for (const iteration of page.iterations) all.push(iteration);
    token = page.next_page_token;
    if (token === "") return all;
  }
}

const csvColumns: [string, (i: Iteration) => unknown][] = [
  ["iteration", (i) => i.iteration],
  ...gainKeys.map((key): [string, (i: Iteration) => unknown] => [key, (i) => i.gains[key]]),
  ["cost", (i) => i.cost ?? ""],
  ["settling_samples", (i) => i.settling_samples],
  ["fuel_sum", (i) => i.fuel_sum],
  ["outcome", (i) => i.outcome.replace("OUTCOME_", "")],
  ["cost_std", (i) => i.cost_std],
  ["episodes", (i) => i.episodes],
];

function Exports({ job }: { job: Job }) {
  const [busy, setBusy] = useState("");
  const [error, setError] = useState("");
  const run = async (kind: string, write: () => Promise<void>) => {
    setBusy(kind);
    setError("");
    await write().catch((e: unknown) => setError(messageOf(e)));
    setBusy("");
  };
  const id = idOf(job.name);
  const csv = async () => {
    const rows = (await allIterations(job.name)).map((i) => csvColumns.map(([, value]) => value(i)).join(","));
    save(`${id}.csv`, "text/csv", [csvColumns.map(([title]) => title).join(","), ...rows, ""].join("\n"));
  };
  const json = async () => {
    const whole = { job: await get<Job>(`/v1/${job.name}`), iterations: await allIterations(job.name) };
    save(`${id}.json`, "application/json", JSON.stringify(whole, null, 1));
  };
  return (
    <section aria-labelledby="export">
      <h2 id="export">Export</h2>
      <p class="actions">
        <button type="button" disabled={busy !== ""} onClick={() => void run("csv", csv)}>History as CSV</button>
        <button type="button" disabled={busy !== ""} onClick={() => void run("json", json)}>Job and history as JSON</button>
        <button type="button" onClick={() => print()}>This page on paper, or as PDF</button>
        <a href={`/v1/${job.name}`} target="_blank" rel="noreferrer">Job in the API</a>
        {busy && <span role="status">fetching…</span>}
      </p>
      {error && <Fault>{error}</Fault>}
      <Copy label="Report as one HTML file, from the command line" text={`orbitune report ${job.name} --output ${id}.html`} />
    </section>
  );
}

// A stretch that is looked at closely, in full detail as far as `samplePoints` go; where all of it is here, nothing.
function useCloser(name: string, history: History | null, zoom: [number, number] | null): Iteration[] {
  const [closer, setCloser] = useState<Iteration[]>([]);
  const first = zoom ? Math.max(1, Math.floor(zoom[0])) : 0;
  const last = zoom && history ? Math.min(history.last, Math.ceil(zoom[1])) : 0;
  useEffect(() => {
    if (first === 0) return setCloser([]);
    if (!history || last < first || history.rowsIn(first, last) > last - first) return;
    const abort = new AbortController();
    const path = `/v1/${name}/iterations?max_points=${samplePoints}&first_iteration=${first}&last_iteration=${last}`;
    const load = () => get<{ iterations: Iteration[] }>(path, abort.signal).then((answer) => setCloser(answer.iterations)).catch(() => undefined);
    const timer = setTimeout(() => void load(), 150);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }, [name, first, last]);
  return closer;
}

// First and best, flown again from the `start`-th of several initial conditions, or the one there is; the best one anew
// some seconds after it changed.
function useFlights(job: Job | null, start: number): { flights: Flown[]; error: string } {
  const [flights, setFlights] = useState<Flown[]>([]);
  const [error, setError] = useState("");
  const first = job?.initial_iteration;
  const best = job?.best_iteration;
  const ended = job !== null && isTerminal(job.state);
  // While it runs: soon after it began, when most changes, and then every ten seconds.
  const [turn, setTurn] = useState(0);
  useEffect(() => {
    if (ended || !first) return;
    const timer = setTimeout(() => setTurn((t) => t + 1), turn < 3 ? 2000 : 10_000);
    return () => clearTimeout(timer);
  }, [ended, !first, turn]);
  const key = !first || !best ? "" : `${job!.name} ${start} ${ended ? best.iteration : `turn ${turn}`}`;
  const flown = useRef("");
  useEffect(() => {
    const scenario = job?.scenario_definition;
    if (key === "" || !scenario || !first || !best) return;
    const what = `${job.name} ${start} ${best.iteration} ${ended}`;
    if (flown.current === what) return;
    const abort = new AbortController();
    const expected = Math.max(first.settling_samples, best.settling_samples);
    const from = job.initial_conditions?.[start] ?? job.initial_condition;
    const run = (gains: typeof first.gains) => fly(scenario, from, gains, expected, flightSamples, abort.signal);
    Promise.all([run(first.gains), run(best.gains)])
      .then(([before, after]) => {
        flown.current = what;
        setError("");
        setFlights([
          { label: "first, i = 1", colour: "--before", episode: before },
          // One name while it changes: the charts stay and take new curves, which is far quicker than new charts.
          { label: ended ? `best, i = ${count(best.iteration)}` : "best so far", colour: "--after", episode: after },
        ]);
      })
      .catch((e: unknown) => abort.signal.aborted || setError(messageOf(e)));
    return () => abort.abort();
  }, [key]);
  return { flights, error };
}

function Provenance({ job, live }: { job: Job; live: Live }) {
  const scenario = job.scenario_definition;
  const h = job.hyperparameters;
  const { counts, lastSeq } = live.events;
  const units = scenario ? gainUnits(scenario) : null;
  return (
    <section aria-labelledby="provenance">
      <h2 id="provenance">Provenance</h2>
      <Facts
        facts={[
          { name: "Name", value: <code>{job.name}</code> },
          { name: "Scenario", value: `${scenario?.display_name || job.scenario} (${idOf(job.scenario)})` },
          job.campaign ? { name: "Campaign", value: <a href={`#/${job.campaign}`}>{idOf(job.campaign)}</a> } : null,
          (job.initial_conditions?.length ?? 0) > 0
            ? { name: "Initial conditions", value: count(job.initial_conditions!.length) }
            : { name: "Initial condition", value: orbitText(job.initial_condition) },
          { name: "Target", value: orbitText(scenario?.target) },
          { name: "Algorithm", value: `${enumText(h.algorithm, "ALGORITHM_")}, seed ${h.seed ?? "–"}` },
          { name: "M, N", value: `${count(h.iterations)} iterations, ${count(h.directions)} directions` },
          { name: "α, σ", value: `${brief(h.step_size)}, ${brief(h.exploration_scale)}` },
          { name: "K(1)", value: <GainsLine gains={h.initial_gains} /> },
          { name: "σ of δ", value: <GainsLine gains={h.exploration_std} /> },
          { name: "Units of the gains", value: units ? `${brief(units.velocity_m_s, 6)} m/s (K₁), ${brief(1000 * units.acceleration_m_s2, 6)} mm/s² (K₂–K₅)` : "–" },
          { name: "Sampling, horizon", value: `${flightTime(scenario?.sampling_period_s)}, ${count(scenario?.horizon_samples)} samples` },
          { name: "Settled within", value: withUnit(brief(scenario?.settling_distance_km), "km") },
          { name: "Created (UTC)", value: utc(job.create_time) },
          { name: "Started (UTC)", value: utc(job.start_time) },
          { name: "Ended (UTC)", value: utc(job.end_time) },
          { name: "Episodes", value: count(job.report?.episodes ?? job.latest_iteration?.episodes) },
          {
            name: "Stream",
            value: (
              <span data-testid="stream" data-gaps={counts.gaps} data-repeats={counts.repeats} data-reconnects={live.reconnects}>
                {`event ${count(lastSeq)}; ${counts.gaps} missing, ${counts.repeats} twice, ${live.reconnects} reconnections`}
              </span>
            ),
          },
        ]}
      />
      <Proof job={job} />
    </section>
  );
}

function Headline({ job, live }: { job: Job; live: Live }) {
  const iterations = job.hyperparameters.iterations ?? 0;
  const done = live.events.history?.last ?? 0;
  const rate = job.state === "JOB_STATE_RUNNING" ? live.rate.perSecond : NaN;
  const reduction = reductionPercent(job.initial_iteration?.cost, job.best_iteration?.cost);
  const ran = job.start_time && job.end_time ? (Date.parse(job.end_time) - Date.parse(job.start_time)) / 1000 : NaN;
  const tiles: [string, string, string][] = [
    ["Iteration", count(done), `of ${count(iterations)}`],
    ["Best J", significant(job.best_iteration?.cost, 6), `first ${significant(job.initial_iteration?.cost, 6)}`],
    ["Reduction of J", percent(reduction), `at iteration ${count(job.best_iteration?.iteration)}`],
    isTerminal(job.state)
      ? ["Ran for", duration(ran), `${significant(done / ran, 3)} iterations/s`]
      : ["Time left", duration((iterations - done) / rate), withUnit(significant(rate, 3), "iterations/s")],
  ];
  return (
    <>
      <div class="tiles">
        {tiles.map(([title, value, note]) => (
          <div class="tile" key={title}>
            <span class="name">{title}</span>
            <span class="value" data-testid={title.toLowerCase().replaceAll(" ", "-")}>{value}</span>
            <span class="note">{note}</span>
          </div>
        ))}
      </div>
      <Progress done={done} of={iterations} label="Iterations done" />
    </>
  );
}

export function JobView({ id }: { id: string }) {
  const name = `jobs/${id}`;
  const live = useJob(name);
  const { job, history } = live.events;
  useTitle(job ? job.display_name || id : id);
  const [start, setStart] = useState(0);
  const { flights, error } = useFlights(job, start);
  const [zoom, setZoom] = useState<[number, number] | null>(null);
  const onZoom = (range: [number, number] | null) => setZoom((old) => (String(old) === String(range) ? old : range));
  const closer = useCloser(name, history, zoom);
  // The columns grow in place: what is drawn is a copy of each frame.
  const drawn = useMemo(() => history?.drawn(closer) ?? null, [live.version, history?.table, closer]);
  if (!job) {
    return live.error ? <Fault>{live.error}</Fault> : <p class="loading" role="status">{live.connected ? "loading…" : "the server does not answer; trying again…"}</p>;
  }
  const colours = ["--c1", "--c2", "--c3", "--c4", "--c5"];
  const labels = Object.entries(job.labels ?? {});
  const starts = job.initial_conditions?.length ?? 0;
  return (
    <article data-testid="job" data-state={job.state} data-iterations={history?.last ?? 0}>
      {!live.connected && <p class="banner" role="alert">Connection lost. What is shown may be old; trying again…</p>}
      {live.error && <Fault>{live.error}</Fault>}
      <header class="title">
        <div>
          <h1>{job.display_name || id}</h1>
          <p class="sub">
            <State of={job.state} /> <span>{job.scenario_definition?.display_name || job.scenario}</span>
            {labels.map(([key, value]) => <span class="label" key={key}>{`${key}: ${value}`}</span>)}
          </p>
        </div>
        <span class="actions">
          <a class="button" href={`#/compare?jobs=${id}`}>compare</a>
          <JobActions job={job} done={(verb) => verb === "delete" && (location.hash = "#/jobs")} />
        </span>
      </header>
      {job.error_message && <Fault>{job.error_message}</Fault>}
      <Headline job={job} live={live} />
      {drawn && drawn.iteration.length > 0 && (
        <div class="grid two">
          <Chart
            title="Cost J and its two terms"
            xLabel="iteration"
            yLabel="J"
            testId="cost"
            x={drawn.iteration}
            sync="history"
            onZoom={onZoom}
            xFormat={count}
            height={300}
            curves={[
              { label: "J", colour: "--c1", values: drawn.values.cost, width: 2 },
              { label: "Hc, samples", colour: "--c2", values: drawn.values.settling },
              { label: "ρ Σ‖u‖", colour: "--c3", values: drawn.values.fuel },
            ]}
          />
          <Chart
            title="Gains K₁ … K₅"
            xLabel="iteration"
            yLabel="K, in its unit"
            testId="gains"
            x={drawn.iteration}
            sync="history"
            xFormat={count}
            height={300}
            log
            curves={gainKeys.map((key, i) => ({ label: gainName(i), colour: colours[i]!, values: drawn.values[key] }))}
          />
          {drawn.iteration.length < (history?.last ?? 0) && (
            <p class="note wide">{`${count(drawn.iteration.length)} of ${count(history?.last)} iterations are drawn, peaks and dips kept. Drag across a curve (or + on the keyboard) to zoom: the stretch is then shown in detail. Double-click (or 0) shows all.`}</p>
          )}
        </div>
      )}
      {(job.report?.warnings.length ?? 0) > 0 && (
        <section aria-label="Warnings">
          <ul class="warnings">{job.report!.warnings.map((w) => <li key={w.kind + w.message}>{w.message}</li>)}</ul>
        </section>
      )}
      {flights.length > 0 && (
        <section aria-labelledby="flights">
          <header class="title">
            <h2 id="flights">First against best</h2>
            {starts > 1 && (
              <label>
                from{" "}
                <select value={start} onChange={(e) => setStart(Number(e.currentTarget.value))} data-testid="start">
                  {job.initial_conditions!.map((state, i) => <option key={i} value={i}>{`${i + 1}: ${orbitText(state)}`}</option>)}
                </select>
              </label>
            )}
          </header>
          <p class="key">
            {flights.map((f) => <span class={f.colour.slice(2)} key={f.label}>{f.label}</span>)} <span class="target">target's orbit</span>
          </p>
          <FlightCharts flights={flights} sync="flights" settlingKm={job.scenario_definition?.settling_distance_km ?? NaN} />
        </section>
      )}
      {error && <Fault>{`The flights could not be simulated: ${error}`}</Fault>}
      {job.report && <Report job={job} />}
      {job.report && (
        <section aria-labelledby="certificate">
          <h2 id="certificate">Certificate of the best gains</h2>
          <Certificate result={job.report.best.result} />
        </section>
      )}
      <div class="grid two">
        <Provenance job={job} live={live} />
        <Exports job={job} />
      </div>
    </article>
  );
}
