// Campaigns, and a new one: many initial conditions tuned for, others held out to compare gains on.
import { useEffect, useMemo, useState } from "preact/hooks";
import { ApiError, get, post, query } from "../api";
import { Field } from "../fields";
import { shellQuoted, textFaults, violationsByField } from "../form";
import { count, idOf, utc } from "../format";
import { Copy, Fault, Progress, State } from "../parts";
import { messageOf, useLoaded, useSettled, useTitle } from "../store";
import type { Campaign, CampaignProgress, Scenario } from "../types";

export function ended(progress: CampaignProgress | null | undefined): [number, number] {
  const parts = progress ? [progress.tuned, progress.held_out, progress.robust].filter(Boolean) : [];
  return [parts.reduce((sum, p) => sum + p.ended, 0), parts.reduce((sum, p) => sum + p.jobs, 0)];
}

export function CampaignsView() {
  useTitle("Campaigns");
  const [tokens, setTokens] = useState<string[]>([]);
  const path = `/v1/campaigns${query({ page_size: 25, page_token: tokens[tokens.length - 1] ?? "" })}`;
  const list = useLoaded(path, (signal) => get<{ campaigns: Campaign[]; next_page_token: string }>(path, signal), 2000);
  const campaigns = list.value?.campaigns ?? [];
  return (
    <article>
      <header class="title">
        <h1>Campaigns</h1>
        <a class="button primary" href="#/campaigns/new">New campaign</a>
      </header>
      {list.error && <Fault>{list.error}</Fault>}
      {list.value && campaigns.length === 0 && <p class="empty">No campaigns yet: a campaign tunes for many initial conditions, and tells which gains serve them all.</p>}
      {campaigns.length > 0 && (
        <div class="scroll">
          <table data-testid="campaigns">
            <thead>
              <tr>
                <th scope="col">Campaign</th>
                <th scope="col">State</th>
                <th scope="col">Jobs ended</th>
                <th scope="col" class="number">Tuned for</th>
                <th scope="col" class="number">Held out</th>
                <th scope="col" class="number">Created, UTC</th>
              </tr>
            </thead>
            <tbody>
              {campaigns.map((c) => {
                const [done, of] = ended(c.progress);
                return (
                  <tr key={c.name}>
                    <th scope="row"><a href={`#/${c.name}`}>{c.display_name || idOf(c.name)}</a><small>{` ${idOf(c.scenario)}`}</small></th>
                    <td><State of={c.state} prefix="CAMPAIGN_STATE_" /></td>
                    <td class="progress"><Progress done={done} of={of} label="Jobs ended" /><small>{`${count(done)} / ${count(of)}`}</small></td>
                    <td class="number">{count(c.progress?.tuned?.members)}</td>
                    <td class="number">{count(c.progress?.held_out?.members)}</td>
                    <td class="number time">{utc(c.create_time)}</td>
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

const fields: { path: string; label: string; range: string; standard: string; flag: string }[] = [
  { path: "initial_conditions.draw.count", label: "Initial conditions to tune for", range: "1 … 10 000", standard: "8", flag: "--count" },
  { path: "initial_conditions.draw.seed", label: "Seed of the draws", range: "≥ 0", standard: "1", flag: "--ic-seed" },
  { path: "held_out.draw.count", label: "Initial conditions held out", range: "0 … 10 000", standard: "8", flag: "--held-out" },
  { path: "hyperparameters.iterations", label: "Iterations M of each job", range: "1 … 10 000 000", standard: "", flag: "--iterations" },
  { path: "hyperparameters.seed", label: "Seed of the first job", range: "≥ 0", standard: "", flag: "--seed" },
];

export function NewCampaignView() {
  useTitle("New campaign");
  const scenarios = useLoaded("scenarios", (signal) => get<{ scenarios: Scenario[] }>("/v1/scenarios", signal));
  const [scenario, setScenario] = useState("scenarios/gto-geo");
  const [title, setTitle] = useState("");
  const [texts, setTexts] = useState<Record<string, string>>({});
  const [robust, setRobust] = useState(false);
  const [faults, setFaults] = useState<Record<string, string>>({});
  const [error, setError] = useState("");
  const requestId = useMemo(() => `web-${Array.from(crypto.getRandomValues(new Uint32Array(4)), (n) => n.toString(36)).join("")}`, []);
  const chosen = scenarios.value?.scenarios.find((s) => s.name === scenario);
  const text = (path: string) => (texts[path] ?? "").trim();
  const number = (path: string, standard: string) => {
    const given = text(path) || standard;
    return given === "" || Number.isNaN(Number(given)) ? given : Number(given);
  };
  const hyperparameters = {
    ...(text("hyperparameters.iterations") ? { iterations: number("hyperparameters.iterations", "") } : {}),
    ...(text("hyperparameters.seed") ? { seed: text("hyperparameters.seed") } : {}),
  };
  const heldOut = number("held_out.draw.count", "8");
  const campaign = {
    scenario,
    ...(title.trim() ? { display_name: title.trim() } : {}),
    initial_conditions: { draw: { count: number("initial_conditions.draw.count", "8"), seed: text("initial_conditions.draw.seed") || "1" } },
    ...(heldOut === 0 ? {} : { held_out: { draw: { count: heldOut } } }),
    ...(Object.keys(hyperparameters).length > 0 ? { hyperparameters } : {}),
    ...(robust ? { robust: {} } : {}),
  };
  const settled = useSettled(JSON.stringify(campaign), 300);
  const local = textFaults(texts);
  const bad = Object.keys(local).length > 0;
  useEffect(() => {
    if (bad) return;
    const abort = new AbortController();
    post("/v1/campaigns?validate_only=true", JSON.parse(settled), abort.signal)
      .then(() => {
        setFaults({});
        setError("");
      })
      .catch((e: unknown) => {
        if (abort.signal.aborted) return;
        const violations = e instanceof ApiError ? e.violations : [];
        setFaults(violationsByField(violations, fields.map((f) => f.path)));
        setError(violations.length > 0 ? "" : messageOf(e));
      });
    return () => abort.abort();
  }, [settled, bad]);
  const shownFaults = bad ? local : faults;
  const submit = async (event: Event) => {
    event.preventDefault();
    try {
      const created = await post<Campaign>(`/v1/campaigns?request_id=${requestId}`, campaign);
      location.hash = `#/${created.name}`;
    } catch (e) {
      setError(messageOf(e));
    }
  };
  const flags = fields.flatMap((f) => {
    const given = text(f.path) || f.standard;
    return given ? [`${f.flag} ${shellQuoted(given)}`] : [];
  });
  const command = ["orbitune campaign create", `--scenario ${idOf(scenario)}`, ...(title.trim() ? [`--name ${shellQuoted(title.trim())}`] : []), ...flags, ...(robust ? ["--robust"] : [])].join(" ");
  return (
    <article>
      <h1>New campaign</h1>
      <form onSubmit={(e) => void submit(e)} noValidate>
        <fieldset>
          <legend>Scenario</legend>
          <div class="fields">
            <div class="field">
              <label for="campaign-scenario">Scenario</label>
              <select id="campaign-scenario" value={scenario} onChange={(e) => setScenario(e.currentTarget.value)}>
                {(scenarios.value?.scenarios ?? []).map((s) => <option key={s.name} value={s.name}>{s.display_name}</option>)}
              </select>
              <p class="note">initial conditions are drawn from its neighbourhood</p>
            </div>
            <Field path="display_name" spec={{ label: "Title", unit: "", range: "" }} text={title} standard="none" input={(_, t) => setTitle(t)} />
          </div>
        </fieldset>
        <fieldset>
          <legend>What is tuned, and what it is held against</legend>
          <div class="fields">
            {fields.map((f) => (
              <Field
                key={f.path}
                path={f.path}
                spec={{ label: f.label, unit: "", range: f.range }}
                text={texts[f.path] ?? ""}
                standard={f.standard || (f.path === "hyperparameters.iterations" ? String(chosen?.hyperparameters.iterations ?? "") : String(chosen?.hyperparameters.seed ?? ""))}
                fault={shownFaults[f.path]}
                input={(path, t) => setTexts((old) => ({ ...old, [path]: t }))}
              />
            ))}
          </div>
          <label class="check"><input type="checkbox" checked={robust} onChange={(e) => setRobust(e.currentTarget.checked)} /> also look for one K for all of them, by CMA-ES</label>
        </fieldset>
        {shownFaults[""] && <Fault>{shownFaults[""]}</Fault>}
        {error && <Fault>{error}</Fault>}
        <p class="actions"><button class="primary" type="submit" disabled={Object.keys(shownFaults).length > 0}>Submit</button></p>
      </form>
      <div class="grid two">
        <Copy label="The same on the command line" text={command} />
        <Copy label="The same as JSON, for POST /v1/campaigns" text={JSON.stringify(campaign, null, 2)} />
      </div>
    </article>
  );
}

