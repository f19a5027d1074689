/**
 * The guided session of the built page in Chromium: with two insoles that play a computed walk faster than in real time, and with
 * the emulated insole.
 *
 * The environment variable `PLANTAR_WALK` is the path of a computed walk of 60 steps of each foot, `PLANTAR` that of the command
 * line, and `PLANTAR_FIRMWARE` that of the firmware of the emulated board. `cargo xtask test` sets all three.
 */

import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import type { Page } from "playwright-core";
import { afterAll, expect, test } from "vitest";
import { entries } from "../../src/stream_file";
import { PHONE, phonePath, servePlantar, servedBrowser } from "./browser";
import { FakeInsoles, WAITING } from "./fake_insoles";

const { PLANTAR: plantar, PLANTAR_FIRMWARE: firmware, PLANTAR_WALK: walk } = process.env;
if (!plantar || !firmware || !walk) {
  console.log("skipped: set PLANTAR, PLANTAR_FIRMWARE and PLANTAR_WALK (`cargo xtask test` does)");
}
/** Speed of the walk relative to real time. */
const FAST = 6;

const served = servedBrowser();
const temporary = mkdtempSync(join(tmpdir(), "plantar-"));
afterAll(() => rmSync(temporary, { recursive: true }));

/** Opens a page that confirms dialogs. */
async function newPage(): Promise<Page> {
  const context = await served.browser.newContext({ viewport: PHONE, colorScheme: "light" });
  const page = await context.newPage();
  page.on("dialog", (dialog) => void dialog.accept());
  return page;
}

/** Opens the view of the guided session. */
async function openSession(page: Page): Promise<void> {
  await page.locator("nav [data-to=settings]").click();
  await page.locator("#identify-open").click();
}

/** The button for an action of the session. */
const act = (page: Page, action: string) => page.locator(`[data-action=${action}]`);
/** Clicks a button that downloads a file, and returns the path of the file. */
async function save(page: Page, action: string, name: string): Promise<string> {
  const [download] = await Promise.all([page.waitForEvent("download"), act(page, action).click()]);
  const path = join(temporary, name);
  await download.saveAs(path);
  return path;
}
/** The number of good steps that the circle of a foot shows. */
const good = (page: Page, side: string) =>
  page.locator(`.rings .${side} svg`).getAttribute("aria-label").then((label) => Number(/: (\d+) of/.exec(label ?? "")?.[1]));

/** The number of parts of a session that the browser stores. */
const storedParts = (page: Page) =>
  page.evaluate(
    () =>
      new Promise<number>((resolve, reject) => {
        const request = indexedDB.open("plantar-identify");
        request.onerror = () => reject(new Error("no database"));
        request.onsuccess = () => {
          const count = request.result.transaction("messages").objectStore("messages").count();
          count.onsuccess = () => {
            request.result.close();
            resolve(count.result);
          };
        };
      }),
  );

/** Stores a screenshot, and asserts that axe finds no serious violation and that the page does not scroll sideways. */
async function inspect(page: Page, name: string): Promise<void> {
  await page.screenshot({ path: phonePath(`tests/screenshots/identify-${name}.png`) });
  await page.evaluate(readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8"));
  const findings = await page.evaluate(async () => {
    const { axe } = window as unknown as { axe: typeof import("axe-core") };
    return (await axe.run()).violations.map(({ id, impact, nodes }) => ({ id, impact, at: nodes.map(({ html }) => html) }));
  });
  expect(findings.filter(({ impact }) => impact === "serious" || impact === "critical"), name).toEqual([]);
  expect(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "no sideways scrolling").toBe(true);
}

test.skipIf(!walk)("both feet are identified, despite a reload, and the parameters are sent, checked and saved", async () => {
  const insoles = new FakeInsoles(new Uint8Array(readFileSync(walk!)), 0.1);
  // The walk waits at 25 s, so that the session is interrupted before it has enough steps, however long the page takes.
  insoles.wait_at_ms = 25_000;
  const page = await newPage();
  await insoles.serve(page);
  await page.goto(served.url);
  await page.locator("#chips", { hasText: /R \d+ Hz/ }).waitFor();
  await openSession(page);
  await page.getByText("Both insoles are connected.").waitFor();
  await inspect(page, "start");
  await act(page, "start").click();
  insoles.speed = FAST;
  await page.getByText("before you had stood still").waitFor();
  await expect.poll(() => good(page, "left"), { timeout: 30_000 }).toBeGreaterThanOrEqual(5);
  await inspect(page, "walk");
  // The walk waits until the session continues.
  insoles.speed = WAITING;
  // The messages of the session are stored in their order, so those of all steps so far are stored once a later part is.
  const parts = await storedParts(page);
  await expect.poll(() => storedParts(page), { timeout: 30_000 }).toBeGreaterThan(parts);
  const before = await good(page, "left");
  await page.reload();
  await act(page, "resume").waitFor();
  await page.locator("#chips", { hasText: /R \d+ Hz/ }).waitFor();
  await act(page, "resume").click();
  await page.getByText("The session was interrupted.").waitFor();
  await page.waitForFunction(() => document.querySelector(".rings .left svg"));
  await expect.poll(() => good(page, "left")).toBeGreaterThanOrEqual(before);
  expect(await good(page, "left")).toBeLessThanOrEqual(before + 1);
  // The walk waits at 42 s, so that enough steps remain for the check.
  insoles.wait_at_ms = 42_000;
  insoles.speed = FAST;

  await act(page, "push").waitFor({ timeout: 60_000 });
  await inspect(page, "result");
  expect(await page.locator(".result tbody tr").count()).toBe(16);
  const stream = await save(page, "export", "session.plantar");
  const parameters = await save(page, "export-left", "left.toml");
  expect(readFileSync(parameters, "utf8")).toContain('side = "left"');
  const messages = [...entries(new Uint8Array(readFileSync(stream)))];
  expect(messages.length).toBeGreaterThan(5000);
  if (plantar) {
    // The exported session gives the same parameters on the command line.
    const json = join(temporary, "fit.json");
    const run = spawnSync(plantar, ["fit", stream, "--json", json, "--out", join(temporary, "fit.toml")]);
    expect(run.status, run.stderr.toString()).toBe(0);
    const steps = (JSON.parse(readFileSync(json, "utf8")) as { steps: unknown[] }).steps.length;
    expect(steps).toBeGreaterThanOrEqual(60);
    // Until the walk waits at 42 s, each foot takes at most 40 steps.
    expect(steps).toBeLessThanOrEqual(80);
  }
  await act(page, "push").click();
  await page.getByText("Walk 10 more steps").waitFor();
  expect(insoles.parameter_requests.map(([insole]) => insole)).toEqual([0, 1]);
  await inspect(page, "check");
  insoles.wait_at_ms = Infinity;
  // These insoles do not compute with the parameters that they received, so the check may fail.
  await page.getByText(/Left foot: error \d+ % on your last 10 steps, \d+ % were expected/).waitFor({ timeout: 60_000 });
  await inspect(page, "done");
  await act(page, "close").click();
  // A reload could interrupt the deletion.
  await expect.poll(() => storedParts(page)).toBe(0);
  await page.reload();
  await page.locator("#chips", { hasText: /R/ }).waitFor();
  expect(await act(page, "resume").count()).toBe(0);
  insoles.stop();
  await page.context().close();
}, 180_000);

test("the session of a recording is not stored as one of the wearer", async () => {
  const page = await newPage();
  await page.goto(`${served.url}?bluetooth`);
  await page.locator("#walk").click();
  await page.locator("#chips", { hasText: /R \d+ Hz/ }).waitFor();
  await openSession(page);
  await act(page, "start").click();
  // A step that is counted was passed on to the storage before.
  await expect.poll(() => good(page, "left"), { timeout: 30_000 }).toBeGreaterThanOrEqual(1);
  expect(await storedParts(page)).toBe(0);
  await page.context().close();
});

test("a second tab neither continues nor deletes a running session, and offers it after the first tab was closed", async () => {
  const context = await served.browser.newContext({ viewport: PHONE });
  /** Opens a tab with the view of the guided session. Both insoles send the computed walk. */
  const openTab = async () => {
    const insoles = new FakeInsoles(new Uint8Array(readFileSync(phonePath("public/walk.plantar"))), 1);
    const page = await context.newPage();
    await insoles.serve(page);
    await page.goto(served.url);
    await page.locator("#chips", { hasText: /R \d+ Hz/ }).waitFor();
    await openSession(page);
    return { insoles, page };
  };
  const first = await openTab();
  await act(first.page, "start").click();
  await expect.poll(() => storedParts(first.page)).toBeGreaterThan(0);
  const second = await openTab();
  await second.page.getByText("An identification is open in another tab.").waitFor();
  for (const action of ["start", "resume", "discard"]) expect(await act(second.page, action).count()).toBe(0);
  first.insoles.stop();
  await first.page.close();
  await act(second.page, "resume").click();
  await second.page.getByText("The session was interrupted.").waitFor();
  second.insoles.stop();
  await context.close();
});

test.skipIf(!walk)("a lost link, a foot without an insole and a small number of steps are reported in words", async () => {
  const insoles = new FakeInsoles(new Uint8Array(readFileSync(walk!)), 0.5, 0);
  const page = await newPage();
  await insoles.serve(page);
  await page.goto(served.url);
  await page.locator("#chips", { hasText: /L \d+ Hz/ }).waitFor();
  await openSession(page);
  await page.getByText("Only the left insole is connected.").waitFor();
  // A screen reader speaks this text when it appears.
  const spoken = page.locator("#notes .spoken");
  expect(await spoken.allTextContents()).toEqual(["The left insole is connected."]);
  await act(page, "start").click();
  insoles.speed = FAST;
  await expect.poll(() => good(page, "left"), { timeout: 30_000 }).toBeGreaterThanOrEqual(4);
  insoles.is_connected = false;
  await page.getByText("The left insole is not connected. Wait until it is connected again.").waitFor();
  expect(await spoken.count()).toBe(0);
  await page.getByText("make its result uncertain").waitFor();
  await act(page, "finish").click();
  await page.getByText(/Only \d steps of the left foot: its result is uncertain/).waitFor({ timeout: 60_000 });
  await inspect(page, "few");
  insoles.stop();
  await page.context().close();
}, 120_000);

test.skipIf(!plantar || !firmware)("the emulated insole confirms the predicted error on further steps", async () => {
  const recording = join(temporary, "walk.parquet");
  const made = spawnSync(plantar!, ["import", "synthetic", "--side", "left", "--steps", "40", "--out", recording]);
  expect(made.status, made.stderr.toString()).toBe(0);
  const { url, end } = await servePlantar(plantar!, ["--emulate", recording, "--firmware", firmware!, "--accept-parameters"]);
  try {
    const page = await newPage();
    await page.goto(url);
    await page.locator("#chips", { hasText: /L \d+ Hz/ }).waitFor({ timeout: 60_000 });
    await openSession(page);
    await act(page, "start").click();
    await act(page, "push").waitFor({ timeout: 120_000 });
    await act(page, "push").click();
    await page.getByText("Walk 10 more steps").waitFor();
    const words = page.getByText(/Left foot: error \d+ % on your last 10 steps, \d+ % were expected/);
    await words.waitFor({ timeout: 60_000 });
    console.log(await words.innerText());
    expect(await words.getAttribute("class")).toBe("fine");
    await page.context().close();
  } finally {
    await end();
  }
}, 300_000);
