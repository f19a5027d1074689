/**
 * The emulator runs the firmware with a computed walk, `plantar serve` serves its messages, and Chromium shows them.
 *
 * The environment variable `PLANTAR` is the path of the command line, and `PLANTAR_FIRMWARE` is the path of the firmware of the
 * emulated board. `cargo xtask test` sets both.
 */

import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { entries } from "../../src/stream_file";
import { firstLoad_ms, launch, open, servePlantar } from "./browser";

const { PLANTAR: plantar, PLANTAR_FIRMWARE: firmware } = process.env;
if (!plantar || !firmware) console.log("skipped: set PLANTAR and PLANTAR_FIRMWARE (`cargo xtask test` does)");

let browser: Browser;
const folder = mkdtempSync(join(tmpdir(), "plantar-"));
beforeAll(async () => {
  browser = await launch();
});
afterAll(async () => {
  await browser.close();
  rmSync(folder, { recursive: true });
});

test.skipIf(!plantar || !firmware)("an emulated walk is shown in two pages, each step once, and recorded", async () => {
  const walk = join(folder, "walk.parquet");
  const recorded = join(folder, "walk.plantar");
  const made = spawnSync(plantar!, ["import", "synthetic", "--side", "left", "--steps", "3", "--out", walk]);
  expect(made.status, made.stderr.toString()).toBe(0);
  const { url, end } = await servePlantar(plantar!, ["--emulate", walk, "--firmware", firmware!, "--record", recorded]);
  try {
    const viewport = { width: 390, height: 844 };
    const one = await open(browser, url, { viewport });
    console.log(`first load of the emulated walk drawn after ${(await firstLoad_ms(one)).toFixed(0)} ms`);
    const other = await open(browser, url, { viewport });
    for (const page of [one, other]) {
      // Pages in the background are not drawn.
      await page.bringToFront();
      await page.locator("nav [data-to=steps]").click();
      await page.waitForFunction(() => document.querySelectorAll("#table tbody tr").length >= 4, undefined, { timeout: 60_000 });
      // The numbers of the steps, from their keys, which are stored in the order of arrival. The emulator repeats the walk after
      // three steps; the numbers continue.
      const numbers = await page.evaluate(async () => {
        const request = indexedDB.open("plantar");
        await new Promise((resolve) => (request.onsuccess = resolve));
        const all = request.result.transaction("records").objectStore("records").getAll();
        await new Promise((resolve) => (all.onsuccess = resolve));
        request.result.close();
        return (all.result as { key: string }[]).map(({ key }) => parseInt(key.split("-")[0] ?? "", 16));
      });
      expect(numbers.length).toBeGreaterThanOrEqual(4);
      expect(numbers).toEqual([...new Set(numbers)].sort((a, b) => a - b));
      expect(await page.locator("#chips").innerText()).toMatch(/^L \d+ Hz$/);
      // The only note: the insole of `plantar serve` has typical parameters.
      const note = "The model values of the left foot are computed with parameters that are not known to be yours.";
      expect(await page.locator("#notes .note").allInnerTexts()).toEqual([note]);
    }
    // Stored steps are shown again after a reload.
    await one.bringToFront();
    const before = await one.locator("#table tbody tr").count();
    await one.reload();
    await one.locator("nav [data-to=steps]").click();
    await one.waitForFunction((before) => document.querySelectorAll("#table tbody tr").length >= before, before);
    // The insole must be connected before its connection can be lost.
    await one.locator("#chips", { hasText: /L \d+ Hz/ }).waitFor();
    await end();
    await one.getByText("The connection to the left insole is lost").waitFor();
    for (const page of [one, other]) await page.context().close();
  } finally {
    await end();
  }
  expect([...entries(new Uint8Array(readFileSync(recorded)))].length).toBeGreaterThan(100);
}, 120_000);
