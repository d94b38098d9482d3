// Every job, newest first, as it goes on.
import { useEffect, useRef, useState } from "preact/hooks";
import { get, query } from "../api";
import { Sparkline } from "../chart";
import { count, idOf, percent, real, reductionPercent, significant, utc } from "../format";
import { JobActions } from "../job_actions";
import { isTerminal } from "../job_events";
import { Fault, Progress, State } from "../parts";
import { useLoaded, useSettled, useTitle } from "../store";
import type { Iteration, Job, Scenario } from "../types";

const pageSize = 25;
const states = ["QUEUED", "RUNNING", "PAUSED", "SUCCEEDED", "FAILED", "CANCELLED"];

interface Filter {
  state: string;
  scenario: string;
  text: string;
}

const quoted = (text: string): string => (text.length > 1 && /^".*"$/.test(text) ? text : `"${text.replace(/[\\"]/g, "\\$&")}"`);

// The filter in the server's words: label=value is a comparison, anything else is looked for word by word.
export function serverFilter({ state, scenario, text }: Filter): string {
  const terms: string[] = [];
  if (state) terms.push(`state = ${state}`);
  if (scenario) terms.push(`scenario = "${scenario}"`);
  const comparison = /^\s*([\w.-]+)\s*(!?=)\s*(.+?)\s*$/.exec(text);
  if (comparison) {
    const [, field, operator, value] = comparison;
    const name = /^(state|scenario|campaign|text|labels\..*)$/.test(field!) ? field! : `labels.${field!}`;
    terms.push(`${name} ${operator} ${quoted(value!)}`);
  } else {
    terms.push(...text.split(/\s+/).filter(Boolean).map((word) => `text = ${quoted(word)}`));
  }
  return terms.join(" AND ");
}

// [iteration, J] for the sparklines, fetched two jobs at a time: once for a job that has ended, and whenever a running one
// has grown by half. In between, what a running job adds comes with the list.
class Sparks {
  private known = new Map<string, { fetched: number; points: [number, number][] }>();
  private wanted: Job[] = [];
  private busy = 0;
  constructor(private readonly changed: () => void) {}

  of(job: Job): [number, number][] {
    const points = this.known.get(job.name)?.points ?? [];
    const latest = job.latest_iteration;
    if (latest && points.length > 0 && latest.iteration > points[points.length - 1]![0]) {
      points.push([latest.iteration, real(latest.cost)]);
    }
    return points;
  }

  want(jobs: Job[]): void {
    this.wanted = jobs.filter((job) => {
      const fetched = this.known.get(job.name)?.fetched ?? 1;
      const grown = job.completed_iterations > (isTerminal(job.state) ? fetched : 1.5 * fetched);
      return job.completed_iterations > 1 && grown;
    });
    this.next();
  }

  private next(): void {
    while (this.busy < 2) {
      const job = this.wanted.shift();
      if (!job) return;
      ++this.busy;
      const { name, completed_iterations: fetched } = job;
      this.known.set(name, { fetched, points: this.known.get(name)?.points ?? [] });
      get<{ iterations: Iteration[] }>(`/v1/${name}/iterations?max_points=40`)
        .then(({ iterations }) => this.known.set(name, { fetched, points: iterations.map((i) => [i.iteration, real(i.cost)]) }))
        .catch(() => this.known.delete(name))
        .finally(() => {
          --this.busy;
          this.changed();
          this.next();
        });
    }
  }
}

export function JobsView() {
  useTitle("Jobs");
  const [filter, setFilter] = useState<Filter>({ state: "", scenario: "", text: "" });
  const [tokens, setTokens] = useState<string[]>([]); // of the pages before this one
  const [chosen, setChosen] = useState<string[]>([]);
  const [, draw] = useState(0);
  const sparks = useRef<Sparks | null>(null);
  sparks.current ??= new Sparks(() => draw((n) => n + 1));
  const settled = useSettled(filter, 250);
  const path = `/v1/jobs${query({ page_size: pageSize, filter: serverFilter(settled), page_token: tokens[tokens.length - 1] ?? "" })}`;
  const list = useLoaded(path, (signal) => get<{ jobs: Job[]; next_page_token: string }>(path, signal), 1500);
  const scenarios = useLoaded("scenarios", (signal) => get<{ scenarios: Scenario[] }>("/v1/scenarios", signal));
  const jobs = list.value?.jobs ?? [];
  useEffect(() => sparks.current!.want(jobs), [list.value]);
  const change = (part: Partial<Filter>) => {
    setFilter((old) => ({ ...old, ...part }));
    setTokens([]);
  };
  const toggle = (id: string) => setChosen((old) => (old.includes(id) ? old.filter((c) => c !== id) : [...old, id]));
  const filtered = settled.state || settled.scenario || settled.text;
  return (
    <article>
      <header class="title">
        <h1>Jobs</h1>
        <span class="actions">
          {chosen.length > 1 && <a class="button" href={`#/compare?jobs=${chosen.join(",")}`}>{`Compare ${chosen.length}`}</a>}
          <a class="button primary" href="#/new">New job</a>
        </span>
      </header>
      <div class="filters" role="search">
        <label>
          State
          <select value={filter.state} onChange={(e) => change({ state: e.currentTarget.value })}>
            <option value="">any</option>
            {states.map((s) => <option key={s} value={s}>{s.toLowerCase()}</option>)}
          </select>
        </label>
        <label>
          Scenario
          <select value={filter.scenario} onChange={(e) => change({ scenario: e.currentTarget.value })}>
            <option value="">any</option>
            {(scenarios.value?.scenarios ?? []).map((s) => <option key={s.name} value={idOf(s.name)}>{idOf(s.name)}</option>)}
          </select>
        </label>
        <label class="wide">
          Search
          <input
            type="search"
            value={filter.text}
            placeholder="title, id, or label=value"
            onInput={(e) => change({ text: e.currentTarget.value })}
          />
        </label>
      </div>
      {list.error && <Fault>{list.error}</Fault>}
      {list.value && jobs.length === 0 && (
        <p class="empty">{filtered ? "No job matches." : <>No jobs yet. <a href="#/new">Submit the first one.</a></>}</p>
      )}
      {jobs.length > 0 && (
        <div class="scroll">
          <table class="jobs" data-testid="jobs">
            <thead>
              <tr>
                <th scope="col"><span class="unseen">Choose to compare</span></th>
                <th scope="col">Job</th>
                <th scope="col">State</th>
                <th scope="col">Progress</th>
                <th scope="col" class="number">Best J</th>
                <th scope="col" class="number">Reduction</th>
                <th scope="col">J</th>
                <th scope="col" class="number">Created, UTC</th>
                <th scope="col"><span class="unseen">Actions</span></th>
              </tr>
            </thead>
            <tbody>
              {jobs.map((job) => {
                const id = idOf(job.name);
                const of = job.hyperparameters.iterations ?? 0;
                const reduction = reductionPercent(job.initial_iteration?.cost, job.best_iteration?.cost);
                return (
                  <tr key={job.name}>
                    <td><input type="checkbox" checked={chosen.includes(id)} onChange={() => toggle(id)} aria-label={`Compare ${job.display_name || id}`} /></td>
                    <th scope="row">
                      <a href={`#/${job.name}`}>{job.display_name || id}</a>
                      <small>{` ${idOf(job.scenario)}${job.display_name ? ` · ${id}` : ""}`}</small>
                    </th>
                    <td><State of={job.state} /></td>
                    <td class="progress">
                      <Progress done={job.completed_iterations} of={of} label={`Progress of ${job.display_name || id}`} />
                      <small>{isTerminal(job.state) && job.completed_iterations === of ? count(of) : `${count(job.completed_iterations)} / ${count(of)}`}</small>
                    </td>
                    <td class="number">{significant(job.best_iteration?.cost)}</td>
                    <td class="number">{percent(reduction)}</td>
                    <td><Sparkline points={sparks.current!.of(job)} label={`J of ${job.display_name || id} over its iterations`} /></td>
                    <td class="number time">{utc(job.create_time)}</td>
                    <td><JobActions job={job} compact done={list.reload} /></td>
                  </tr>
                );
              })}
            </tbody>
          </table>
        </div>
      )}
      {(tokens.length > 0 || list.value?.next_page_token) && (
        <nav class="pages" aria-label="Pages">
          <button type="button" disabled={tokens.length === 0} onClick={() => setTokens(tokens.slice(0, -1))}>Newer</button>
          <span>{`Page ${tokens.length + 1}`}</span>
          <button type="button" disabled={!list.value?.next_page_token} onClick={() => setTokens([...tokens, list.value!.next_page_token])}>Older</button>
        </nav>
      )}
    </article>
  );
}
