// The dashboard in a browser against a real server: what an engineer does with it, and what must not happen.
import assert from "node:assert/strict";
import { statSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { Server, becomes, launch, openPage, output } from "./support.mjs";

const server = new Server();
let browser;

before(async () => {
  await server.start();
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server.remove();
});

const picture = (page, name, options = {}) => page.screenshot({ path: join(output, `${name}.png`), ...options });
const iterationsOn = async (page) => Number(await page.getByTestId("job").getAttribute("data-iterations"));
const stateOn = (page, state) => page.waitForSelector(`[data-testid=job][data-state=JOB_STATE_${state}]`);
const beyond = (page, iterations) =>
  page.waitForFunction((n) => Number(document.querySelector("[data-testid=job]")?.dataset.iterations) > n, iterations);
const nameOn = async (page) => {
  await page.waitForURL(/#\/jobs\/./);
  return page.url().slice(page.url().indexOf("jobs/"));
};

test("a job from the form: checked as one types, followed as it runs, reduced by 80 % and more", async () => {
  // A browser's console tells of every answer that is no success; here they are the point.
  const { page, errors } = await openPage(browser, { expected: /400 \(Bad Request\)/ });
  await page.goto(`${server.base}/`);
  await page.getByText("No jobs yet").waitFor();
  await page.getByRole("link", { name: "New job" }).first().click();
  const iterations = page.getByLabel("Iterations M");
  await becomes(() => iterations.getAttribute("placeholder"), "2000", "the default is shown");
  await iterations.fill("-3");
  await page.getByText("must be in [1, 10000000], got -3").waitFor();
  await becomes(() => iterations.getAttribute("aria-invalid"), "true");
  await becomes(() => page.getByRole("button", { name: "Submit" }).isDisabled(), true);
  await iterations.fill("");
  await page.getByLabel("Keplerian").check();
  await becomes(() => page.getByLabel("Semi-major axis a").inputValue(), "24364");
  await page.getByLabel("Eccentricity e").fill("1.5");
  await page.getByText("must be in [0, 1), an ellipse, got 1.5").waitFor();
  await page.getByLabel("Step size").fill("fast");
  await page.getByText("must be a number, got 'fast'").waitFor();
  await page.getByLabel("Step size").fill("");
  await page.getByLabel("the scenario's chaser").check();
  await page.getByLabel("Title").fill("GTO to GEO");
  await page.getByText("the server would take it").waitFor();
  await page.getByText("orbitune submit --scenario gto-geo --name 'GTO to GEO'").waitFor();
  await picture(page, "new-job", { fullPage: true });
  await page.getByRole("button", { name: "Submit" }).click();
  const name = await nameOn(page);

  await stateOn(page, "SUCCEEDED");
  await becomes(() => iterationsOn(page), 2000);
  await page.getByTestId("reduction-of-j").waitFor();
  const reduction = parseFloat(await page.getByTestId("reduction-of-j").textContent());
  assert.ok(reduction >= 80, `${reduction} %`);
  const points = async () => Number(await page.getByTestId("cost").getAttribute("data-points"));
  await becomes(async () => (await points()) > 500, true, "the curve is drawn");
  await page.getByText("Best against first").waitFor();
  await page.getByTestId("distance").waitFor();
  await becomes(() => page.locator(".projection").count(), 4);
  const job = await server.get(`/v1/${name}`);
  assert.ok(Math.abs(job.report.best_reduction.cost_percent - reduction) < 0.06, "the server's own figure");

  // Hovering tells values with units.
  await page.locator("[data-testid=distance] .u-over").hover();
  await page.waitForFunction(() => /\d km/.test(document.querySelector("[data-testid=distance] .u-legend")?.textContent ?? ""));
  await page.mouse.move(0, 0);
  await page.evaluate(() => scrollTo(0, 0));
  await page.setViewportSize({ width: 1000, height: 900 });
  await page.waitForTimeout(300);
  const { y, height } = await page.locator(".projections").boundingBox();
  await page.setViewportSize({ width: 1000, height: Math.ceil(y + height + 10) });
  await page.waitForTimeout(300);
  await picture(page, "job");
  assert.ok(statSync(join(output, "job.png")).size < 200_000, "small enough for the README");
  await picture(page, "job-whole", { fullPage: true });

  // The history's digest, and the proof that the job comes out the same again.
  await becomes(() => page.getByTestId("digest").textContent(), job.provenance.digest);
  await page.getByRole("button", { name: "verify", exact: true }).click();
  await becomes(() => page.getByTestId("verdict").getAttribute("data-verdict"), "VERDICT_IDENTICAL");
  assert.deepEqual(errors, []);
});

test("pause, resume, kill -9 and a new start: the page goes on, nothing is missing and nothing is twice", async () => {
  const { page, errors } = await openPage(browser, { expected: /ERR_(CONNECTION|INCOMPLETE|EMPTY|NETWORK)/ });
  await page.goto(`${server.base}/#/new`);
  await page.getByLabel("Iterations M").fill("1000000");
  await page.getByLabel("Seed", { exact: true }).fill("5");
  await page.getByRole("button", { name: "Submit" }).click();
  const name = await nameOn(page);
  await beyond(page, 20);
  await page.waitForFunction(() => window.shown.length >= 5);
  await page.getByRole("button", { name: /^pause/ }).click();
  await stateOn(page, "PAUSED");
  await becomes(async () => (await iterationsOn(page)) === Number((await server.get(`/v1/${name}`)).completed_iterations), true);
  const paused = await iterationsOn(page);
  await page.waitForTimeout(1000);
  assert.equal(await iterationsOn(page), paused);
  await picture(page, "job-paused");
  await page.getByRole("button", { name: /^resume/ }).click();
  await stateOn(page, "RUNNING");
  await beyond(page, paused + 20);

  await server.end("SIGKILL");
  await page.getByText("Connection lost").waitFor();
  const killed = await iterationsOn(page);
  await picture(page, "job-connection-lost");
  await server.start();
  await beyond(page, killed);
  await page.getByText("Connection lost").waitFor({ state: "detached" });
  await beyond(page, killed + 200);
  page.once("dialog", (dialog) => dialog.accept());
  await page.getByRole("button", { name: /^cancel/ }).click();
  await stateOn(page, "CANCELLED");

  const stream = page.getByTestId("stream");
  assert.equal(await stream.getAttribute("data-gaps"), "0");
  assert.equal(await stream.getAttribute("data-repeats"), "0");
  assert.notEqual(await stream.getAttribute("data-reconnects"), "0");
  const job = await server.get(`/v1/${name}`);
  await becomes(() => page.evaluate(() => window.told.at(-1)), Number(job.last_seq));
  await becomes(() => iterationsOn(page), job.completed_iterations);
  assert.ok(job.completed_iterations < 1_000_000, "all this was on its way");
  const shown = await page.evaluate(() => window.shown);
  assert.deepEqual(shown, [...shown].sort((x, y) => x - y), "the count only grew");
  const told = await page.evaluate(() => window.told);
  for (let i = 1; i < told.length; ++i) assert.equal(told[i], told[i - 1] + 1, `event ${i} of those told`);
  assert.deepEqual(errors, []);
});

test("jobs are listed live, found by filter and search, and compared", async () => {
  const { page, errors } = await openPage(browser);
  const other = await server.post("/v1/jobs", {
    scenario: "scenarios/leo-rendezvous",
    display_name: "rendezvous",
    labels: { board: "seven" },
    hyperparameters: { iterations: 300 },
  });
  await page.goto(`${server.base}/#/jobs`);
  const rows = page.locator("[data-testid=jobs] tbody tr");
  await page.waitForFunction(() => document.querySelectorAll("[data-testid=jobs] tbody tr").length === 3);
  await server.ended(other.name);
  await page.waitForFunction(() => document.querySelectorAll("[data-testid=jobs] .state.succeeded").length === 2);
  await page.waitForFunction(() => document.querySelectorAll("[data-testid=jobs] .spark polyline").length === 3);
  await picture(page, "jobs");
  const search = page.getByRole("searchbox");
  for (const [text, found] of [["rendez", 1], ["board = seven", 1], ["board=eight", 0], ["gto", 2], ["", 3]]) {
    await search.fill(text);
    await page.waitForFunction((n) => document.querySelectorAll("[data-testid=jobs] tbody tr").length === n, found);
  }
  await page.getByLabel("State").selectOption("FAILED");
  await page.getByText("No job matches").waitFor();
  await page.getByLabel("State").selectOption("");
  await rows.nth(2).waitFor();
  for (const i of [1, 2]) await rows.nth(i).getByRole("checkbox").check();
  await page.getByRole("link", { name: "Compare 2" }).click();
  const table = page.getByTestId("compare-table");
  await table.waitFor();
  await becomes(() => table.locator("thead a").count(), 2);
  await table.getByText("2 000 of 2 000").waitFor();
  await becomes(async () => Number(await page.getByTestId("compare").getAttribute("data-points")) > 300, true);
  await picture(page, "compare", { fullPage: true });
  assert.deepEqual(errors, []);
});

test("flights of a job over several initial conditions, from any of them", async () => {
  const start = (semi_major_axis_km) => ({
    keplerian: { semi_major_axis_km, eccentricity: 0.01, inclination_deg: 51, raan_deg: 10, argument_of_periapsis_deg: 20, true_anomaly_deg: 30 },
  });
  const job = await server.post("/v1/jobs", {
    scenario: "scenarios/leo-rendezvous",
    initial_conditions: [start(6800), start(6850)],
    hyperparameters: { iterations: 20 },
  });
  await server.ended(job.name);
  const { page, errors } = await openPage(browser);
  const flown = [];
  page.on("request", (request) => {
    if (request.url().endsWith("episodes:simulate")) flown.push(request.postDataJSON().initial_condition.keplerian.semi_major_axis_km);
  });
  await page.goto(`${server.base}/#/${job.name}`);
  await page.getByTestId("distance").waitFor();
  assert.deepEqual(flown, [6800, 6800]);
  const before = await page.getByTestId("distance").locator(".plot").getAttribute("aria-label");
  await page.getByTestId("start").selectOption({ index: 1 });
  await page.waitForFunction((old) => document.querySelector("[data-testid=distance] .plot").ariaLabel !== old, before);
  assert.deepEqual(flown, [6800, 6800, 6850, 6850]);
  assert.deepEqual(errors, []);
});

test("a small campaign, from its form to the held-out comparison", async () => {
  const { page, errors } = await openPage(browser);
  await page.goto(`${server.base}/#/campaigns`);
  await page.getByRole("link", { name: "New campaign" }).click();
  await page.getByLabel("Title").fill("five");
  await page.getByLabel("Initial conditions to tune for").fill("5");
  await page.getByLabel("Initial conditions held out").fill("3");
  await page.getByLabel("Iterations M").fill("40");
  await page.getByRole("button", { name: "Submit" }).click();
  await page.waitForSelector("[data-testid=campaign][data-state=CAMPAIGN_STATE_SUCCEEDED]");
  await page.getByTestId("comparison-MEMBER_ROLE_HELD_OUT").waitFor();
  await becomes(() => page.locator("[data-testid=members] tbody tr").count(), 8);
  assert.equal(await page.getByText("Connection lost").count(), 0);
  await page.getByText("Flights of the first 5").waitFor();
  await page.waitForTimeout(300);
  await picture(page, "campaign", { fullPage: true });
  await page.getByRole("link", { name: "Campaigns" }).click();
  await page.locator("[data-testid=campaigns] tbody tr").waitFor();
  assert.deepEqual(errors, []);
});

test("gains for an initial condition, ranked, drawn and refined", async () => {
  const { page, errors } = await openPage(browser);
  await page.goto(`${server.base}/#/gains`);
  await page.getByLabel("Keplerian").check();
  await page.getByLabel("Inclination i").fill("60");
  await page.getByRole("button", { name: "Query" }).click();
  const rows = page.locator("[data-testid=answers] tbody tr");
  await rows.first().waitFor();
  const costs = await rows.evaluateAll((all) => all.map((row) => parseFloat(row.children[3].textContent)));
  assert.ok(costs.length > 1);
  assert.deepEqual(costs, [...costs].sort((a, b) => a - b));
  await page.getByTestId("distance").waitFor();
  await page.getByRole("button", { name: "Refine" }).click();
  await page.getByText("Refined with").waitFor();
  await page.getByTestId("distance").waitFor();
  await page.waitForTimeout(300);
  await picture(page, "gains", { fullPage: true });
  assert.deepEqual(errors, []);
});

test("a long history comes as a sample, small and whole", async () => {
  const iterations = Number(process.env.ORBITUNE_E2E_ITERATIONS ?? 5000);
  // One direction: what is long is the history, not the tuning.
  const job = await server.post("/v1/jobs", { scenario: "scenarios/leo-rendezvous", hyperparameters: { iterations, directions: 1 } });
  await server.ended(job.name);
  const { page, errors } = await openPage(browser);
  const session = await page.context().newCDPSession(page);
  await session.send("Network.enable");
  let bytes = 0;
  session.on("Network.loadingFinished", (event) => (bytes += event.encodedDataLength));
  const begun = Date.now();
  await page.goto(`${server.base}/#/${job.name}`);
  await page.waitForFunction(() => Number(document.querySelector("[data-testid=cost]")?.dataset.points) > 0);
  const painted = Date.now() - begun;
  await page.getByTestId("distance").waitFor();
  await page.waitForTimeout(500);
  console.log(`${iterations} iterations: curves after ${painted} ms, ${Math.round(bytes / 1000)} kB in all`);
  assert.ok(bytes < 300_000, `${bytes} bytes`);
  await becomes(() => iterationsOn(page), iterations);
  const points = Number(await page.getByTestId("cost").getAttribute("data-points"));
  assert.ok(points > 400 && points <= 1200, `${points} points`);

  // A closer look, by the keyboard: the stretch comes with every iteration it has.
  const plot = page.getByTestId("cost").locator(".plot");
  const detail = page.waitForResponse(async (response) => {
    const asked = new URL(response.url()).searchParams;
    const [first, last] = [Number(asked.get("first_iteration")), Number(asked.get("last_iteration"))];
    return first > 0 && (await response.json()).iterations.length === last - first + 1;
  });
  await plot.focus();
  for (let zoomed = 1; zoomed * 600 < iterations; zoomed *= 2) await page.keyboard.press("+");
  await detail;
  await page.waitForFunction((n) => Number(document.querySelector("[data-testid=cost]").dataset.points) > n, points + 200);
  await page.keyboard.press("ArrowRight");
  await page.waitForFunction(() => /iteration \d.*J \d/.test(document.querySelector("[data-testid=cost] [role=status]").textContent));
  await picture(page, "job-zoomed");
  await page.keyboard.press("0");
  await becomes(async () => Number(await page.getByTestId("cost").getAttribute("data-points")), points);
  assert.deepEqual(errors, []);
});

test("a live job of thousands of iterations leaves the browser time for 60 frames a second", async () => {
  const job = await server.post("/v1/jobs", { scenario: "scenarios/leo-rendezvous", hyperparameters: { iterations: 1_000_000, directions: 1 } });
  const { page, errors } = await openPage(browser);
  await page.goto(`${server.base}/#/${job.name}`);
  await beyond(page, 5000);
  await page.getByTestId("distance").waitFor();
  await browser.startTracing(page, { categories: ["toplevel", "devtools.timeline"] });
  const begun = Date.now();
  await page.waitForFunction((n) => window.shown.length > n, 20 + (await page.evaluate(() => window.shown.length)));
  const seconds = (Date.now() - begun) / 1000;
  const { traceEvents } = JSON.parse((await browser.stopTracing()).toString());
  await server.post(`/v1/${job.name}:cancel`, {});
  // Time on the processor: what else the machine does is not the page's.
  const main = new Set(traceEvents.filter((e) => e.name === "thread_name" && e.args.name === "CrRendererMain").map((e) => `${e.pid} ${e.tid}`));
  const times = (name) => traceEvents.filter((e) => e.ph === "X" && e.name === name && e.tdur > 0 && main.has(`${e.pid} ${e.tid}`)).map((e) => e.tdur / 1000).sort((a, b) => a - b);
  const tasks = times("ThreadControllerImpl::RunTask");
  const frames = times("FireAnimationFrame");
  const [longest, frame] = [tasks.at(-1), frames[frames.length >> 1]];
  console.log(`${frames.length} frames in ${seconds.toFixed(1)} s, median ${frame.toFixed(1)} ms, the longest task ${longest.toFixed(1)} ms`);
  assert.ok(frames.length >= 20 && frame < 1000 / 60, `${frames.length} frames, median ${frame} ms`);
  assert.ok(longest < 200, `a task of ${longest} ms`);
  assert.deepEqual(errors, []);
});

test("a long list of jobs is paged, and searched as a whole", async () => {
  const jobs = Number(process.env.ORBITUNE_E2E_JOBS ?? 30);
  const create = async (i) => {
    const job = { scenario: "scenarios/leo-rendezvous", display_name: `batch ${i}`, hyperparameters: { iterations: 1, directions: 1 } };
    while (true) {
      try {
        return await server.post("/v1/jobs", job);
      } catch (error) {
        if (!error.message.includes("RESOURCE_EXHAUSTED")) throw error;  // else as many wait as may
        await new Promise((done) => setTimeout(done, 200));
      }
    }
  };
  for (let i = 1; i <= jobs; i += 10) await Promise.all(Array.from({ length: Math.min(10, jobs - i + 1) }, (_, k) => create(i + k)));
  const { page, errors } = await openPage(browser);
  await page.goto(`${server.base}/#/jobs`);
  const rows = page.locator("[data-testid=jobs] tbody tr");
  await becomes(() => rows.count(), 25);
  const newest = await rows.first().textContent();
  await page.getByRole("button", { name: "Older" }).click();
  await page.getByText("Page 2").waitFor();
  await becomes(async () => (await rows.first().textContent()) !== newest, true);
  await page.getByRole("button", { name: "Newer" }).click();
  await page.getByRole("searchbox").fill('text = "Batch 1"');
  const begun = Date.now();
  const expected = Array.from({ length: jobs }, (_, i) => `batch ${i + 1}`).filter((name) => name.includes("batch 1")).length;
  await becomes(() => rows.count(), Math.min(25, expected));
  console.log(`${jobs} more jobs: found after ${Date.now() - begun} ms`);
  assert.deepEqual(errors, []);
});

test("every page fits a narrow screen, in light and dark, and is reached by the keyboard", async () => {
  const { jobs } = await server.get("/v1/jobs?page_size=2");
  const { campaigns } = await server.get("/v1/campaigns");
  const ids = jobs.map((job) => job.name.slice(5));
  const pages = { jobs: "jobs", new: "new", job: jobs[0].name, compare: `compare?jobs=${ids}`, campaigns: "campaigns", "new-campaign": "campaigns/new", campaign: campaigns[0].name, gains: "gains" };
  for (const colorScheme of ["light", "dark"]) {
    const { page, errors } = await openPage(browser, { viewport: { width: 400, height: 800 }, colorScheme });
    for (const [title, path] of Object.entries(pages)) {
      await page.goto(`${server.base}/#/${path}`);
      await page.locator("main h1").waitFor();
      await page.waitForTimeout(1000);
      const beyondEdge = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
      assert.ok(beyondEdge <= 0, `${title} is ${beyondEdge} px too wide`);
      const unnamed = await page.evaluate(() =>
        [...document.querySelectorAll("input, select")].filter((e) => e.labels?.length === 0 && !e.ariaLabel).map((e) => e.outerHTML),
      );
      assert.deepEqual(unnamed, [], "every input has a label");
      await picture(page, `narrow-${colorScheme}-${title}`, { fullPage: true });
    }
    assert.deepEqual(errors, []);
  }
  const { page } = await openPage(browser);
  await page.goto(`${server.base}/#/jobs`);
  await page.locator("main h1").waitFor();
  for (let i = 0; i < 4; ++i) await page.keyboard.press("Tab");
  await page.keyboard.press("Enter");
  await page.getByRole("heading", { name: "New job" }).waitFor();
});
