// The dashboard of a server that has tokens: logging in, what a role may, and how a session ends.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { Server, becomes, launch, openPage, output } from "./support.mjs";

const server = new Server();
let browser;

const orbituned = (...words) =>
  execFileSync(process.env.ORBITUNED, [...words, "--data-dir", server.directory], { encoding: "utf8", stdio: "pipe" });
const token = (name, role) => orbituned("token", "create", "--name", name, "--role", role).trim();

before(async () => {
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server.remove();
});

const expected = /401 \(Unauthorized\)|403 \(Forbidden\)|text\/event-stream/;
const logIn = async (page, secret) => {
  await page.getByLabel("Token").fill(secret);
  await page.getByRole("button", { name: "Log in" }).click();
};

test("log in with a token, work, log out; a session ends with its token", async () => {
  const operator = token("ana", "operator");
  await server.start();
  const { page, errors } = await openPage(browser, { expected });
  await page.goto(`${server.base}/`);
  await page.getByRole("heading", { name: "Log in" }).waitFor();
  assert.equal(await page.getByRole("navigation").count(), 0, "nothing else is shown");
  await page.screenshot({ path: join(output, "log-in.png") });
  await logIn(page, "orb_guessed");
  await page.getByText("the token is not one of this server's").waitFor();
  await logIn(page, operator);
  await becomes(() => page.getByTestId("who").innerText(), "ana, operatorLog out");

  // What it needs to be told as it happens reaches it by the cookie, which no script can read.
  const job = await page.evaluate(async () => {
    const body = JSON.stringify({ scenario: "scenarios/gto-geo", hyperparameters: { iterations: 10_000_000 } });
    const answer = await fetch("/v1/jobs", { method: "POST", headers: { "Content-Type": "application/json" }, body });
    return answer.json();
  });
  assert.equal(job.owner, "ana");
  assert.equal(await page.evaluate(() => document.cookie), "");
  assert.ok(!JSON.stringify(await page.evaluate(() => ({ ...localStorage, ...sessionStorage }))).includes("orb_"));
  await page.goto(`${server.base}/#/${job.name}`);
  await page.waitForFunction(() => Number(document.querySelector("[data-testid=job]")?.dataset.iterations) > 3);
  await page.reload();
  await becomes(() => page.getByTestId("who").innerText(), "ana, operatorLog out", "a new load is logged in");

  await page.getByRole("button", { name: "Log out" }).click();
  await page.getByRole("heading", { name: "Log in" }).waitFor();
  await logIn(page, operator);
  await page.waitForSelector("[data-testid=job]");
  orbituned("token", "revoke", "ana");
  await page.getByRole("heading", { name: "Log in" }).waitFor();
  await logIn(page, operator);
  await page.getByText("the token was revoked").waitFor();
  assert.deepEqual(errors, []);

  const viewer = token("vera", "viewer");
  await becomes(async () => {
    await logIn(page, viewer);
    await page.waitForTimeout(200);
    return page.getByTestId("who").count();
  }, 1);
  await page.waitForSelector("[data-testid=job]");
  await page.getByRole("button", { name: /^pause/ }).click();
  await page.getByText(/needs the role operator/).waitFor();
});
