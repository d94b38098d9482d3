// One campaign: how far its jobs are, the paper's tables over its initial conditions, and how K and J are spread.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Stream, get, post } from "../api";
import { type Flown, fly, joined } from "../flights";
import { Chart } from "../chart";
import { count, enumText, fixed, idOf, percent, real, significant, utc } from "../format";
import { isTerminal } from "../job_events";
import { Copy, Facts, Fault, GainsLine, Progress, State, gainName, orbitText } from "../parts";
import { Projections } from "../projection";
import { isMissing, messageOf, useTitle } from "../store";
import { type Campaign, type CampaignEvent, type CampaignMember, type CampaignResults, type GainsComparison, type MemberEpisode, gainKeys } from "../types";
import { ended } from "./campaigns";

const shownMembers = 200;
const flownMembers = 12;

interface Watched {
  campaign: Campaign | null;
  members: Map<string, CampaignMember>;
  connected: boolean;
  error: string;
}

const keyOf = (m: CampaignMember) => `${m.role} ${m.number}`;

export function applyCampaignEvent(old: Campaign | null, event: CampaignEvent): Campaign | null {
  if (event.snapshot) return event.snapshot;
  if (!old) return old;
  if (event.progress) return { ...old, progress: event.progress };
  // What the snapshot told of a later state counts for more.
  if (event.state_change && Number(event.seq) > Number(old.last_seq)) {
    const { state, message, results, time } = event.state_change;
    return { ...old, state, error_message: message, last_seq: event.seq, ...(results ? { results } : {}), ...(isTerminal(state) ? { end_time: time } : {}) };
  }
  return old;
}

async function loadMembers(name: string, signal: AbortSignal): Promise<CampaignMember[]> {
  const all: CampaignMember[] = [];
  for (let token = ""; ; ) {
    const path = `/v1/${name}/members?page_size=1000${token && `&page_token=${encodeURIComponent(token)}`}`;
    const page = await get<{ members: CampaignMember[]; next_page_token: string }>(path, signal);
    all.push(...page.members);
    token = page.next_page_token;
    if (token === "") return all;
  }
}

function useCampaign(name: string): Watched {
  const [state, setState] = useState<Watched>({ campaign: null, members: new Map(), connected: true, error: "" });
  const latest = useRef<Campaign | null>(null);
  useEffect(() => {
    const abort = new AbortController();
    latest.current = null;
    // Progress is told now and then: what it came to in the end is asked for.
    const reload = async () => {
      try {
        const [campaign, all] = await Promise.all([get<Campaign>(`/v1/${name}`, abort.signal), loadMembers(name, abort.signal)]);
        latest.current = campaign;
        setState((old) => ({ ...old, campaign, members: new Map(all.map((m) => [keyOf(m), m])), error: "" }));
      } catch (error) {
        if (abort.signal.aborted) return;
        setState((old) => ({ ...old, error: messageOf(error) }));
        if (isMissing(error)) stream.close();
      }
    };
    const stream = new Stream<CampaignEvent>(`/v1/${name}:watch`, {
      events: (batch) => {
        const before = latest.current?.state;
        const endedMembers = batch.flatMap((e) => (e.member_ended ? [e.member_ended] : []));
        for (const event of batch) latest.current = applyCampaignEvent(latest.current, event);
        const campaign = latest.current;
        setState((old) => {
          const updated = new Map(old.members);
          for (const member of endedMembers) updated.set(keyOf(member), member);
          return { ...old, campaign, members: updated };
        });
        if (campaign && before && campaign.state !== before) void reload();
        if (campaign && isTerminal(campaign.state) && batch.some((e) => e.snapshot || e.state_change)) stream.close();
      },
      connected: (connected) => setState((old) => ({ ...old, connected: connected || (latest.current !== null && isTerminal(latest.current.state)) })),
    });
    void reload();
    return () => {
      abort.abort();
      stream.close();
    };
  }, [name]);
  return state;
}

const choiceText = (choice: string): string =>
  ({ INITIAL: "K(1), first", TUNED: "K*, own", BEST: "best, own", MEAN: "K̂, mean of K*", ROBUST: "robust", NEAREST: "K* of the nearest" })[
    choice.replace("GAINS_CHOICE_", "")
  ] ?? enumText(choice, "GAINS_CHOICE_");

const quantities: [keyof Pick<GainsComparison, "cost" | "settling_time" | "fuel_sum" | "delta_v">, string][] = [
  ["cost", "J"],
  ["settling_time", "Settling time"],
  ["fuel_sum", "Fuel Σ‖u‖"],
  ["delta_v", "Δv"],
];

function Comparisons({ results, over, title }: { results: CampaignResults; over: string; title: string }) {
  const shown = results.comparisons.filter((c) => c.over === over);
  const [quantity, setQuantity] = useState<(typeof quantities)[number][0]>("cost");
  if (shown.length === 0) return null;
  return (
    <section aria-label={title}>
      <header class="title">
        <h2>{title}</h2>
        <label>
          <span class="unseen">Quantity</span>
          <select value={quantity} onChange={(e) => setQuantity(e.currentTarget.value as typeof quantity)}>
            {quantities.map(([key, text]) => <option key={key} value={key}>{`Reduction of ${text}, %`}</option>)}
          </select>
        </label>
      </header>
      <div class="scroll">
        <table data-testid={`comparison-${over}`}>
          <thead>
            <tr>
              <th scope="col">Gains</th>
              <th scope="col" class="number">Settled</th>
              <th scope="col" class="number">Average</th>
              <th scope="col" class="number">Min</th>
              <th scope="col" class="number">5 %</th>
              <th scope="col" class="number">25 %</th>
              <th scope="col" class="number">Median</th>
              <th scope="col" class="number">75 %</th>
              <th scope="col" class="number">95 %</th>
              <th scope="col" class="number">Max</th>
            </tr>
          </thead>
          <tbody>
            {shown.map((c) => {
              const s = c[quantity];
              const values = [s.average, s.minimum, s.percentile_5, s.percentile_25, s.percentile_50, s.percentile_75, s.percentile_95, s.maximum];
              return (
                <tr key={c.choice} class={over === "MEMBER_ROLE_HELD_OUT" && c.choice === results.best_on_held_out ? "chosen" : ""}>
                  <th scope="row">{choiceText(c.choice)}</th>
                  <td class="number">{`${c.settled} / ${c.flown}`}</td>
                  {values.map((v, i) => <td class="number" key={i}>{fixed(v, 1)}</td>)}
                </tr>
              );
            })}
          </tbody>
        </table>
      </div>
    </section>
  );
}

// Two histograms over one scale: before in grey, after in colour. A value that all share is one tall bar.
function Histogram({ title, unit, before, after, single }: { title: string; unit: string; before: number[]; after: number[]; single?: number }) {
  const all = [...before, ...after, ...(single === undefined ? [] : [single])].filter(Number.isFinite);
  if (all.length === 0) return null;
  const low = Math.min(...all);
  const high = Math.max(...all);
  const span = high - low || Math.abs(high) || 1;
  const bins = Math.max(6, Math.min(24, Math.ceil(Math.sqrt(after.length) * 2)));
  const of = (values: number[]) => {
    const counts = new Array<number>(bins).fill(0);
    for (const v of values) if (Number.isFinite(v)) counts[Math.min(bins - 1, Math.floor((bins * (v - low)) / span))]!++;
    return counts;
  };
  const sets: [string, number[]][] = [["before", of(before)], ["after", of(after)]];
  const tallest = Math.max(1, ...sets.flatMap(([, counts]) => counts));
  const [width, height] = [260, 90];
  const place = (v: number) => (width * (v - low)) / span;
  return (
    <figure class="histogram">
      <figcaption>{title}{unit && <small>{`, ${unit}`}</small>}</figcaption>
      <svg viewBox={`0 0 ${width} ${height + 18}`} role="img" aria-label={`${title}: from ${significant(low)} to ${significant(high)} ${unit}`}>
        {sets.map(([name, counts]) => (
          <g class={name} key={name}>
            {counts.map((n, i) => n > 0 && (
              <rect key={i} x={(i * width) / bins + 1} width={width / bins - 2} y={height - (n / tallest) * (height - 6)} height={(n / tallest) * (height - 6)}>
                <title>{`${significant(low + (i * span) / bins)} … ${significant(low + ((i + 1) * span) / bins)} ${unit}: ${n}`}</title>
              </rect>
            ))}
          </g>
        ))}
        {single !== undefined && <path class="mark" d={`M${place(single).toFixed(1)} 0V${height}`} />}
        <path class="base" d={`M0 ${height}H${width}`} />
        <text x="0" y={height + 14}>{significant(low, 4)}</text>
        <text x={width} y={height + 14} text-anchor="end">{significant(high, 4)}</text>
      </svg>
    </figure>
  );
}

const episodeOf = (m: CampaignMember, ...choices: string[]): MemberEpisode | undefined =>
  choices.map((choice) => m.episodes.find((e) => e.choice === `GAINS_CHOICE_${choice}`)).find((e) => e !== undefined);

function Distributions({ campaign, members }: { campaign: Campaign; members: CampaignMember[] }) {
  const tuned = members.filter((m) => m.role === "MEMBER_ROLE_TUNED" && episodeOf(m, "TUNED"));
  if (tuned.length < 2) return null;
  const after = tuned.map((m) => episodeOf(m, "TUNED")!);
  const first = campaign.hyperparameters.initial_gains;
  const before = tuned.flatMap((m) => episodeOf(m, "INITIAL") ?? []);
  return (
    <section aria-labelledby="spread">
      <h2 id="spread">Distributions over the tuned initial conditions</h2>
      <p class="key"><span class="before">K(1)</span><span class="after">K*, own</span></p>
      <div class="histograms">
        <Histogram title="J" unit="" before={before.map((e) => real(e.cost))} after={after.map((e) => real(e.cost))} />
        {gainKeys.map((key, i) => (
          <Histogram
            key={key}
            title={gainName(i)}
            unit=""
            before={[]}
            after={after.map((e) => e.gains[key])}
            {...(first ? { single: first[key] } : {})}
          />
        ))}
      </div>
    </section>
  );
}

// The first dozen's distances, before and after.
function Flights({ campaign, members }: { campaign: Campaign; members: CampaignMember[] }) {
  const [flights, setFlights] = useState<Flown[]>([]);
  const [error, setError] = useState("");
  const flown = members.filter((m) => m.role === "MEMBER_ROLE_TUNED" && episodeOf(m, "TUNED")).slice(0, flownMembers);
  const key = flown.map(keyOf).join();
  useEffect(() => {
    const scenario = campaign.scenario_definition;
    if (!isTerminal(campaign.state) || !scenario || flown.length === 0) return;
    const abort = new AbortController();
    const first = campaign.hyperparameters.initial_gains;
    const run = async () => {
      const made: Flown[] = [];
      for (const member of flown) {
        const after = episodeOf(member, "TUNED")!;
        const before = episodeOf(member, "INITIAL")?.gains ?? first;
        const one = (gains: typeof after.gains) => fly(scenario, member.initial_condition, gains, scenario.horizon_samples / 4, 160, abort.signal);
        if (before) made.push({ label: `${member.number} before`, colour: "--before", episode: await one(before) });
        made.push({ label: `${member.number} after`, colour: `--c${(member.number % 8) + 1}`, episode: await one(after.gains) });
      }
      setFlights(made.sort((a, b) => Number(b.colour === "--before") - Number(a.colour === "--before")));
    };
    run().catch((e: unknown) => abort.signal.aborted || setError(messageOf(e)));
    return () => abort.abort();
  }, [key, campaign.state]);
  const drawn = useMemo(() => {
    const { hours, rows } = joined(flights);
    return {
      hours,
      distance: rows.map((row) => row.map((s) => s?.distance_km ?? null)),
      tracks: flights.map((f) => ({ label: f.label, colour: f.colour.slice(2), samples: f.episode.trajectory })),
    };
  }, [flights]);
  if (error) return <Fault>{`The flights could not be simulated: ${error}`}</Fault>;
  if (flights.length === 0) return null;
  return (
    <section class="many" aria-labelledby="distances">
      <h2 id="distances">{`Flights of the first ${flown.length} initial conditions`}</h2>
      <Chart
        title="Distance to the target: under K(1) in grey, under K* in colour"
        xLabel="time, h"
        yLabel="km"
        log
        x={drawn.hours}
        xFormat={(x) => `${fixed(x, 2)} h`}
        height={320}
        curves={flights.map((f, i) => ({ label: f.label, colour: f.colour, unit: "km", values: drawn.distance[i] ?? [], width: f.colour === "--before" ? 1 : 1.5 }))}
      />
      <Projections tracks={drawn.tracks} />
    </section>
  );
}

// best: the choice to show where there was no tuning.
function Members({ members, iterations, best }: { members: CampaignMember[]; iterations: number; best: string }) {
  return (
    <section aria-labelledby="members">
      <h2 id="members">Initial conditions</h2>
      <div class="scroll">
        <table data-testid="members">
          <thead>
            <tr>
              <th scope="col" class="number">No.</th>
              <th scope="col">Role</th>
              <th scope="col">Job</th>
              <th scope="col">Progress</th>
              <th scope="col" class="number">J, K(1)</th>
              <th scope="col">Gains</th>
              <th scope="col" class="number">J</th>
              <th scope="col" class="number">Reduction</th>
              <th scope="col">K₁ … K₅</th>
              <th scope="col">Initial condition</th>
            </tr>
          </thead>
          <tbody>
            {members.slice(0, shownMembers).map((m) => {
              const after = episodeOf(m, "TUNED", "BEST", best, "ROBUST", "MEAN");
              return (
                <tr key={keyOf(m)}>
                  <td class="number">{m.number}</td>
                  <td class="nowrap">{enumText(m.role, "MEMBER_ROLE_")}</td>
                  <td>{m.job ? <a href={`#/${m.job}`}><State of={m.job_state} /></a> : "–"}</td>
                  <td class="progress">{m.job ? <Progress done={m.job_state === "JOB_STATE_SUCCEEDED" ? iterations : m.completed_iterations} of={iterations} label={`Progress of ${m.number}`} /> : null}</td>
                  <td class="number">{significant(episodeOf(m, "INITIAL")?.cost)}</td>
                  <td class="nowrap">{!after ? "–" : m.role === "MEMBER_ROLE_ROBUST" ? "robust" : choiceText(after.choice)}</td>
                  <td class="number">{significant(after?.cost)}</td>
                  <td class="number">{percent(after?.cost_reduction_percent)}</td>
                  <td>{after ? <GainsLine gains={after.gains} /> : "–"}</td>
                  <td class="orbit">{orbitText(m.initial_condition)}</td>
                </tr>
              );
            })}
          </tbody>
        </table>
      </div>
      {members.length > shownMembers && <p class="note">{`The first ${shownMembers} of ${count(members.length)}; the rest by orbitune campaign export.`}</p>}
    </section>
  );
}

function Actions({ campaign }: { campaign: Campaign }) {
  const [error, setError] = useState("");
  const state = campaign.state.replace("CAMPAIGN_STATE_", "");
  const verbs = { RUNNING: ["pause", "cancel"], PAUSED: ["resume", "cancel"], EVALUATING: ["cancel"] }[state] ?? [];
  const act = (verb: string) => {
    if (verb === "cancel" && !confirm(`Cancel ${campaign.display_name || campaign.name} and its jobs?`)) return;
    post(`/v1/${campaign.name}:${verb}`, {}).then(() => setError(""), (e: unknown) => setError(messageOf(e)));
  };
  return (
    <span class="actions">
      {verbs.map((verb) => <button type="button" key={verb} onClick={() => act(verb)}>{verb}</button>)}
      {error && <Fault>{error}</Fault>}
    </span>
  );
}

export function CampaignView({ id }: { id: string }) {
  const name = `campaigns/${id}`;
  const { campaign, members: byKey, connected, error } = useCampaign(name);
  useTitle(campaign?.display_name || id);
  if (!campaign) return error ? <Fault>{error}</Fault> : <p class="loading" role="status">{connected ? "loading…" : "the server does not answer; trying again…"}</p>;
  const members = [...byKey.values()];
  const [done, of] = ended(campaign.progress);
  const results = campaign.results;
  return (
    <article data-testid="campaign" data-state={campaign.state}>
      {!connected && <p class="banner" role="alert">Connection lost. What is shown may be old; trying again…</p>}
      {error && <Fault>{error}</Fault>}
      <header class="title">
        <div>
          <h1>{campaign.display_name || id}</h1>
          <p class="sub"><State of={campaign.state} prefix="CAMPAIGN_STATE_" /> <span>{campaign.scenario_definition?.display_name || campaign.scenario}</span></p>
        </div>
        <Actions campaign={campaign} />
      </header>
      {campaign.error_message && <Fault>{campaign.error_message}</Fault>}
      <div class="tiles">
        <div class="tile"><span class="name">Jobs ended</span><span class="value">{count(done)}</span><span class="note">{`of ${count(of)}`}</span></div>
        <div class="tile"><span class="name">Tuned for</span><span class="value">{count(campaign.progress?.tuned?.members)}</span><span class="note">initial conditions</span></div>
        <div class="tile"><span class="name">Held out</span><span class="value">{count(campaign.progress?.held_out?.members)}</span><span class="note">to compare on</span></div>
        <div class="tile"><span class="name">Iterations</span><span class="value">{count(campaign.progress?.tuned?.completed_iterations)}</span><span class="note">{`${count(campaign.hyperparameters.iterations)} each`}</span></div>
      </div>
      <Progress done={done} of={of} label="Jobs ended" />
      {results?.conclusion && <p class="conclusion">{results.conclusion}</p>}
      {results && <Comparisons results={results} over="MEMBER_ROLE_TUNED" title="Over the tuned initial conditions" />}
      {results && <Comparisons results={results} over="MEMBER_ROLE_HELD_OUT" title="Over the held-out initial conditions" />}
      <Distributions campaign={campaign} members={members} />
      <Flights campaign={campaign} members={members} />
      <Members members={members} iterations={campaign.hyperparameters.iterations ?? 1} best={(results?.best_on_held_out ?? "").replace("GAINS_CHOICE_", "")} />
      <div class="grid two">
        <section aria-labelledby="provenance">
          <h2 id="provenance">Provenance</h2>
          <Facts
            facts={[
              { name: "Name", value: <code>{campaign.name}</code> },
              { name: "Created (UTC)", value: utc(campaign.create_time) },
              { name: "Ended (UTC)", value: utc(campaign.end_time) },
              { name: "K(1)", value: <GainsLine gains={campaign.hyperparameters.initial_gains} /> },
              results?.mean_gains ? { name: `K̂, mean of ${results.mean_of}`, value: <GainsLine gains={results.mean_gains} /> } : null,
              results?.robust_gains ? { name: "Robust K", value: <GainsLine gains={results.robust_gains} /> } : null,
              { name: "Seed of the first job", value: campaign.hyperparameters.seed ?? "–" },
            ]}
          />
        </section>
        <section aria-labelledby="export">
          <h2 id="export">Export</h2>
          <Copy label="Every initial condition with its gains, as CSV" text={`orbitune campaign export ${idOf(campaign.name)} --output ${idOf(campaign.name)}.csv`} />
          <Copy label="Report as one HTML file" text={`orbitune report ${campaign.name} --output ${idOf(campaign.name)}.html`} />
        </section>
      </div>
    </article>
  );
}
