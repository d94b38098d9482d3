// What makes a job's results provable, and the button that proves them.
import { useEffect, useRef, useState } from "preact/hooks";
import { get } from "./api";
import { count } from "./format";
import { Facts } from "./parts";
import { type Iteration, type Job, type Provenance, type Verification, gainKeys } from "./types";

interface Progress {
  iteration: number;
  last_iteration: number;
}
type Check =
  | { at: "idle" }
  | { at: "running"; progress: Progress | null }
  | { at: "done"; result: Verification }
  | { at: "failed"; message: string };

// The newest: what came with the stream's snapshot is that of its beginning.
function useProvenance(job: Job): Provenance | null {
  const [provenance, setProvenance] = useState(job.provenance ?? null);
  useEffect(() => {
    const abort = new AbortController();
    get<Job>(`/v1/${job.name}`, abort.signal)
      .then((now) => setProvenance(now.provenance ?? null))
      .catch(() => undefined); // the page says by itself that the server is away
    return () => abort.abort();
  }, [job.name, job.state]);
  return provenance;
}

function useVerification(name: string): { check: Check; start: () => void } {
  const [check, setCheck] = useState<Check>({ at: "idle" });
  const source = useRef<EventSource | null>(null);
  const close = () => source.current?.close();
  useEffect(() => {
    setCheck({ at: "idle" });
    return close;
  }, [name]);
  const start = () => {
    close();
    setCheck({ at: "running", progress: null });
    const stream = new EventSource(`/v1/${name}:verify`);
    source.current = stream;
    stream.addEventListener("progress", (event) => {
      setCheck({ at: "running", progress: (JSON.parse(event.data as string) as { progress: Progress }).progress });
    });
    stream.addEventListener("verification", (event) => {
      stream.close();
      setCheck({ at: "done", result: (JSON.parse(event.data as string) as { verification: Verification }).verification });
    });
    // The server's own error, or a connection lost; a verification is not resumed.
    stream.addEventListener("error", (event) => {
      stream.close();
      const data = (event as MessageEvent<string>).data;
      const body = data ? (JSON.parse(data) as { error: { message: string } }) : null;
      setCheck({ at: "failed", message: body?.error.message ?? "the server did not verify this job" });
    });
  };
  return { check, start };
}

function line(iteration: Iteration | null | undefined): string {
  if (!iteration) return "none";
  return `K ${gainKeys.map((key) => String(iteration.gains[key])).join(", ")}; J ${String(iteration.cost ?? "none")}`;
}

function Result({ check }: { check: Check }) {
  if (check.at === "idle") return null;
  if (check.at === "failed") return <p class="fault" role="alert">{check.message}</p>;
  if (check.at === "running") {
    const { progress } = check;
    return <p role="status">{progress ? `running again: iteration ${count(progress.iteration)} of ${count(progress.last_iteration)}` : "waiting…"}</p>;
  }
  const { verdict, conclusion, first_difference: difference, engine_differences: engines } = check.result;
  return (
    <div role="status" data-testid="verdict" data-verdict={verdict}>
      <p><strong>{verdict.replace("VERDICT_", "")}</strong>: {conclusion}</p>
      {difference && <p>stored: {line(difference.stored)}</p>}
      {difference && <p>run again: {line(difference.recomputed)}</p>}
      {engines.map((text) => <p key={text}>{text}</p>)}
    </div>
  );
}

export function Proof({ job }: { job: Job }) {
  const provenance = useProvenance(job);
  const { check, start } = useVerification(job.name);
  return (
    <div data-testid="proof">
      {provenance && (
        <Facts
          facts={[
            { name: "Scenario digest", value: <code class="digest">{provenance.scenario_digest}</code> },
            { name: "Inputs digest", value: <code class="digest">{provenance.inputs_digest}</code> },
            {
              name: `History digest, ${count(provenance.iterations)} iterations`,
              value: <code class="digest" data-testid="digest">{provenance.digest}</code>,
            },
            ...provenance.engines.map((engine) => ({
              name: `Engine, from iteration ${count(engine.first_iteration)}`,
              value: `Orbitune ${engine.version}, ${engine.simd_target}, multiply-add ${engine.fused_multiply_add ? "" : "not "}fused, ${engine.libraries}`,
            })),
          ]}
        />
      )}
      <button type="button" onClick={start} disabled={check.at === "running" || !(job.latest_iteration || job.report)}>
        verify
      </button>
      <Result check={check} />
    </div>
  );
}
