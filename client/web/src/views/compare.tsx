// Several jobs side by side: their J over the iterations, and what each came to.
import { useMemo, useState } from "preact/hooks";
import uPlot from "uplot";
import { get } from "../api";
import { Chart } from "../chart";
import { count, duration, enumText, fixed, idOf, percent, real, reductionPercent, significant } from "../format";
import { Fault, State, gainName } from "../parts";
import { useLoaded, useTitle } from "../store";
import { type Iteration, type Job, gainKeys } from "../types";

const samplePoints = 600;
const most = 8; // colours there are

interface Compared {
  job: Job;
  iterations: Iteration[];
}

async function load(ids: string[], signal: AbortSignal): Promise<Compared[]> {
  return Promise.all(
    ids.map(async (id) => {
      const [job, history] = await Promise.all([
        get<Job>(`/v1/jobs/${id}`, signal),
        get<{ iterations: Iteration[] }>(`/v1/jobs/${id}/iterations?max_points=${samplePoints}`, signal),
      ]);
      return { job, iterations: history.iterations };
    }),
  );
}

function Curves({ compared, relative }: { compared: Compared[]; relative: boolean }) {
  const joined = useMemo(() => {
    const tables = compared.map(({ job, iterations }): uPlot.AlignedData => {
      const first = relative ? real(job.initial_iteration?.cost) : 1;
      return [iterations.map((i) => i.iteration), iterations.map((i) => real(i.cost) / first)];
    });
    // What a sample leaves out is bridged, so that each curve is whole.
    const [x, ...values] = uPlot.join(tables) as [number[], ...(number | null)[][]];
    return { x, values: values.map((column) => bridged(x, column)) };
  }, [compared, relative]);
  return (
    <Chart
      title={relative ? "J over the first J" : "Cost J"}
      xLabel="iteration"
      yLabel={relative ? "J / J(1)" : "J"}
      x={joined.x}
      xFormat={count}
      height={340}
      testId="compare"
      curves={compared.map(({ job }, i) => ({
        label: job.display_name || idOf(job.name),
        colour: `--c${i + 1}`,
        values: joined.values[i] ?? [],
      }))}
    />
  );
}

// Straight lines over what is missing between two values.
export function bridged(x: readonly number[], values: readonly (number | null | undefined)[]): (number | null)[] {
  const whole = values.map((v) => v ?? null);
  let before = -1;
  for (let i = 0; i < whole.length; ++i) {
    if (whole[i] === null) continue;
    for (let j = before + 1; before >= 0 && j < i; ++j) {
      whole[j] = whole[before]! + ((whole[i]! - whole[before]!) * (x[j]! - x[before]!)) / (x[i]! - x[before]!);
    }
    before = i;
  }
  return whole;
}

const rows: [string, (job: Job) => preact.ComponentChildren][] = [
  ["State", (job) => <State of={job.state} />],
  ["Scenario", (job) => idOf(job.scenario)],
  ["Algorithm", (job) => enumText(job.hyperparameters.algorithm, "ALGORITHM_")],
  ["Seed", (job) => job.hyperparameters.seed ?? "–"],
  ["Iterations", (job) => `${count(job.completed_iterations)} of ${count(job.hyperparameters.iterations)}`],
  ["Episodes", (job) => count(job.latest_iteration?.episodes)],
  ["First J", (job) => significant(job.initial_iteration?.cost, 6)],
  ["Best J", (job) => significant(job.best_iteration?.cost, 6)],
  ["Reduction of J", (job) => percent(reductionPercent(job.initial_iteration?.cost, job.best_iteration?.cost))],
  ["Best at iteration", (job) => count(job.best_iteration?.iteration)],
  ["Settling time, h", (job) => fixed((job.report?.best.result.settling_time_s ?? NaN) / 3600, 2)],
  ["Δv to settling, m/s", (job) => fixed(job.report?.best.result.delta_v_to_settling_m_s, 1)],
  ["Peak acceleration, mm/s²", (job) => fixed(1000 * real(job.report?.best.result.peak_acceleration_m_s2), 3)],
  ...gainKeys.map((key, i): [string, (job: Job) => string] => [`Best ${gainName(i)}`, (job) => significant(job.best_iteration?.gains[key])]),
  ["Ran for", (job) => duration(job.start_time && job.end_time ? (Date.parse(job.end_time) - Date.parse(job.start_time)) / 1000 : NaN)],
];

export function CompareView({ ids }: { ids: string[] }) {
  useTitle("Compare");
  const [added, setAdded] = useState("");
  const [relative, setRelative] = useState(false);
  const shown = ids.slice(0, most);
  const loaded = useLoaded(shown.join(","), (signal) => load(shown, signal), 3000);
  const recent = useLoaded("recent", (signal) => get<{ jobs: Job[] }>("/v1/jobs?page_size=200", signal));
  const others = (recent.value?.jobs ?? []).filter((job) => !ids.includes(idOf(job.name)));
  const go = (next: string[]) => (location.hash = `#/compare?jobs=${next.join(",")}`);
  const compared = loaded.value ?? [];
  return (
    <article>
      <header class="title">
        <h1>Compare</h1>
        <span class="actions">
          <label>
            <span class="unseen">A job to add</span>
            <select
              value={added}
              disabled={shown.length >= most}
              onChange={(e) => {
                setAdded("");
                if (e.currentTarget.value) go([...shown, e.currentTarget.value]);
              }}
            >
              <option value="">{shown.length >= most ? `${most} at most` : "add a job…"}</option>
              {others.map((job) => <option key={job.name} value={idOf(job.name)}>{job.display_name || idOf(job.name)}</option>)}
            </select>
          </label>
          <label class="check"><input type="checkbox" checked={relative} onChange={(e) => setRelative(e.currentTarget.checked)} /> relative to the first J</label>
        </span>
      </header>
      {loaded.error && <Fault>{loaded.error}</Fault>}
      {shown.length === 0 && <p class="empty">Choose jobs to set side by side, here or in the list of <a href="#/jobs">jobs</a>.</p>}
      {compared.length > 0 && <Curves compared={compared} relative={relative} />}
      {compared.length > 0 && (
        <div class="scroll">
          <table data-testid="compare-table">
            <thead>
              <tr>
                <th scope="col" />
                {compared.map(({ job }, i) => (
                  <th scope="col" class="number" key={job.name}>
                    <span class={`swatch s${i + 1}`} aria-hidden="true" /> <a href={`#/${job.name}`}>{job.display_name || idOf(job.name)}</a>{" "}
                    <button type="button" class="quiet" aria-label={`Leave out ${job.display_name || idOf(job.name)}`} onClick={() => go(shown.filter((id) => id !== idOf(job.name)))}>×</button>
                  </th>
                ))}
              </tr>
            </thead>
            <tbody>
              {rows.map(([title, value]) => (
                <tr key={title}>
                  <th scope="row">{title}</th>
                  {compared.map(({ job }) => <td class="number" key={job.name}>{value(job)}</td>)}
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
    </article>
  );
}
