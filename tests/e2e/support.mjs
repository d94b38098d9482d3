// A real server of the test's own, and a browser that tells of every error.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdirSync, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { isDeepStrictEqual } from "node:util";
import { chromium } from "playwright-core";

const root = new URL("../..", import.meta.url).pathname;
export const output = process.env.ORBITUNE_E2E_OUTPUT ?? join(root, "build/e2e");
mkdirSync(output, { recursive: true });

export class Server {
  constructor() {
    this.directory = mkdtempSync(join(tmpdir(), "orbitune-e2e-"));
    this.port = 0; // the first start chooses
  }

  get base() {
    return `http://127.0.0.1:${this.port}`;
  }

  async start() {
    const binary = process.env.ORBITUNED ?? join(root, "build/release/bin/orbituned");
    const web = process.env.ORBITUNE_WEB_DIR ?? join(root, "client/web/dist");
    const flags = ["--data-dir", this.directory, "--listen", "127.0.0.1:0", "--http", `127.0.0.1:${this.port}`];
    this.process = spawn(binary, [...flags, "--web-dir", web], { stdio: ["ignore", "pipe", "pipe"] });
    let said = "";
    this.process.stderr.on("data", (data) => (said += data));
    this.port = await new Promise((resolve, reject) => {
      this.process.stdout.on("data", (data) => {
        said += data;
        const found = /^http .*:(\d+)$/m.exec(said);
        if (found) resolve(Number(found[1]));
      });
      this.process.once("error", reject);
      this.process.once("exit", () => reject(new Error(`the server ended: ${said}`)));
    });
  }

  async end(signal = "SIGTERM") {
    if (!this.process || this.process.exitCode !== null || this.process.signalCode !== null) return;
    const ended = new Promise((resolve) => this.process.once("exit", resolve));
    this.process.kill(signal);
    await ended;
  }

  async remove() {
    await this.end();
    rmSync(this.directory, { recursive: true, force: true });
  }

  async get(path) {
    const response = await fetch(this.base + path);
    assert.equal(response.status, 200, path);
    return response.json();
  }

  async post(path, body) {
    const headers = { "Content-Type": "application/json" };
    const response = await fetch(this.base + path, { method: "POST", headers, body: JSON.stringify(body) });
    const text = await response.text();
    assert.equal(response.status, 200, `${path}: ${text}`);
    return JSON.parse(text);
  }

  // The job once it has ended.
  async ended(name) {
    for (;;) {
      const job = await this.get(`/v1/${name}`);
      if (/SUCCEEDED|FAILED|CANCELLED/.test(job.state)) return job;
      await new Promise((resolve) => setTimeout(resolve, 200));
    }
  }
}

// Waits until `read` gives `expected`: a page shows what it has been told a moment later.
export async function becomes(read, expected, what) {
  let value = await read();
  for (const end = Date.now() + 60_000; !isDeepStrictEqual(value, expected) && Date.now() < end; value = await read()) {
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  assert.deepEqual(value, expected, what);
}

export function launch() {
  return chromium.launch({
    executablePath: process.env.ORBITUNE_CHROMIUM ?? "/usr/bin/chromium",
    args: [
      "--no-sandbox",
      "--disable-gpu",
      "--disable-quic",
      "--no-first-run",
      "--disable-background-networking",
      "--disable-component-update",
      "--disable-sync",
    ],
  });
}

// Every event that reaches the page by a stream, as the browser has it and apart from what the page makes of it; and
// every number of iterations that a job's page has shown.
function record() {
  window.told = [];
  window.shown = [];
  new MutationObserver(() => {
    const iterations = document.querySelector("[data-testid=job]")?.dataset.iterations;
    if (iterations && Number(iterations) !== window.shown.at(-1)) window.shown.push(Number(iterations));
  }).observe(document, { subtree: true, childList: true, attributes: true, attributeFilter: ["data-iterations"] });
  const Native = window.EventSource;
  window.EventSource = class extends Native {
    constructor(...given) {
      super(...given);
      for (const kind of ["iteration", "state_change"]) {
        this.addEventListener(kind, (event) => window.told.push(Number(event.lastEventId)));
      }
    }
  };
}

// errors: what the console told, and exceptions; `expected` (a pattern) leaves out what the test itself provokes.
export async function openPage(browser, options = {}) {
  const { expected, ...context } = options;
  const page = await (await browser.newContext({ viewport: { width: 1280, height: 900 }, ...context })).newPage();
  const errors = [];
  page.on("console", (message) => {
    const text = `${message.text()} ${message.location().url}`;
    if (["error", "warning"].includes(message.type()) && !expected?.test(text)) errors.push(text);
  });
  page.on("pageerror", (error) => errors.push(String(error.stack)));
  page.setDefaultTimeout(120_000);
  // As a machine so many times slower has it.
  const rate = Number(process.env.ORBITUNE_E2E_THROTTLE ?? 1);
  if (rate > 1) await (await page.context().newCDPSession(page)).send("Emulation.setCPUThrottlingRate", { rate });
  await page.addInitScript(record);
  return { page, errors };
}
