// Pause, resume and cancel, as far as a job's state lets one.
import { useState } from "preact/hooks";
import { call, post } from "./api";
import { messageOf } from "./store";
import type { Job } from "./types";

const actions: { verb: string; states: string[] }[] = [
  { verb: "pause", states: ["QUEUED", "RUNNING"] },
  { verb: "resume", states: ["PAUSED"] },
  { verb: "cancel", states: ["QUEUED", "RUNNING", "PAUSED"] },
  { verb: "delete", states: ["SUCCEEDED", "FAILED", "CANCELLED"] },
];

export function JobActions({ job, done, compact = false }: { job: Job; done?: (verb: string) => void; compact?: boolean }) {
  const [busy, setBusy] = useState(false);
  const [error, setError] = useState("");
  const state = job.state.replace("JOB_STATE_", "");
  const act = async (verb: string) => {
    const final = verb === "cancel" || verb === "delete";
    if (final && !confirm(`${verb === "cancel" ? "Cancel" : "Delete"} ${job.display_name || job.name}?`)) return;
    setBusy(true);
    setError("");
    try {
      await (verb === "delete" ? call("DELETE", `/v1/${job.name}`) : post(`/v1/${job.name}:${verb}`, {}));
      done?.(verb);
    } catch (e) {
      setError(messageOf(e));
    }
    setBusy(false);
  };
  return (
    <span class="actions">
      {actions
        .filter((a) => a.states.includes(state) && !(compact && a.verb === "delete"))
        .map(({ verb }) => (
          <button
            type="button"
            key={verb}
            class={compact ? "quiet" : ""}
            disabled={busy}
            aria-label={`${verb} ${job.display_name || job.name}`}
            onClick={() => void act(verb)}
          >
            {verb}
          </button>
        ))}
      {error && <span class="fault" role="alert">{error}</span>}
    </span>
  );
}
