/** The firmware in the emulator feels a computed walk, `plantar serve` bridges it, Chromium shows it.
 *
 * `PLANTAR` is the command line and `PLANTAR_FIRMWARE` the emulated board's firmware; `cargo xtask test` sets both. */

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

test.skipIf(!plantar || !firmware)("an emulated walk arrives in two pages, each step once, and in a recording", async () => {
  const walk = join(folder, "walk.parquet");
  const recorded = join(folder, "walk.plantar");
  const made = spawnSync(plantar!, ["import", "synthetic", "--side", "left", "--steps", "3", "--out", walk]);
  expect(made.status, made.stderr.toString()).toBe(0);
  const { url, end } = await servePlantar(plantar!, ["--emulate", walk, "--firmware", firmware!, "--record", recorded]);
  try {
    const viewport = { width: 390, height: 844 };
    const one = await open(browser, url, { viewport });
    console.log(`from the emulator, first load drawn after ${(await firstLoad_ms(one)).toFixed(0)} ms`);
    const other = await open(browser, url, { viewport });
    for (const page of [one, other]) {
      // Pages behind others are not drawn.
      await page.bringToFront();
      await page.waitForFunction(() => document.querySelectorAll("#table tbody tr").length >= 4, undefined, { timeout: 60_000 });
      const numbers = await page.locator("#table tbody tr td:nth-child(2)").evaluateAll((cells) => cells.map((cell) => Number(cell.textContent)));
      // Newest first; the walk begins again after three steps and the insole counts on.
      expect(numbers).toEqual([...new Set(numbers)].sort((a, b) => b - a));
      expect(await page.locator("#chips").innerText()).toMatch(/^L \d+ Hz$/);
      expect(await page.locator("#notes").innerText()).toBe("");
    }
    // What a page has taken is still there when it comes back.
    await one.bringToFront();
    const before = await one.locator("#table tbody tr").count();
    await one.reload();
    await one.waitForFunction((before) => document.querySelectorAll("#table tbody tr").length >= before, before);
    // It is connected again: only then is there a link to lose.
    await one.locator("#chips", { hasText: /L \d+ Hz/ }).waitFor();
    await end();
    await one.getByText("The link to the left insole is lost").waitFor();
    for (const page of [one, other]) await page.context().close();
  } finally {
    await end();
  }
  expect([...entries(new Uint8Array(readFileSync(recorded)))].length).toBeGreaterThan(100);
}, 120_000);
