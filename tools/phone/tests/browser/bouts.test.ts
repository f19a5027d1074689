/** The load outside steps on the built page in Chromium. */

import { readFileSync } from "node:fs";
import { expect, test } from "vitest";
import { entry } from "../../src/stream_file";
import { PHONE, phonePath, servedBrowser } from "./browser";
import { FakeInsoles, varint } from "./fake_insoles";

/** First byte of a message with a load bout. */
const BOUT = 17;
/** Number of the first bout, the one after those of the six steps of the walk. */
const FIRST = 6;

const served = servedBrowser();

/** A load bout of the left foot in an insole's encoding: 100 N s, 500 kPa s and 51.2 kPa in each region. */
function bout(number: number, kind: number, duration_s: number): Uint8Array {
  const region = [...[10_000, 5_000].flatMap((value) => [value % 256, value >> 8, 0, 0]), 0, 2];
  const regions = Array.from({ length: 8 }, () => region).flat();
  return Uint8Array.from([BOUT, ...varint(number), 0, kind, ...varint(1e6), ...varint(duration_s * 1e6), ...regions, 0, 0]);
}

test("load outside steps is listed, stored, exported and acknowledged", async () => {
  const walk = new Uint8Array(readFileSync(phonePath("public/walk.plantar")));
  const bouts = [1, 2, 3].map((kind, i) => entry({ t_ms: 300, insole: 0, message: bout(FIRST + i, kind, 60 - 20 * i) }));
  const insoles = new FakeInsoles(new Uint8Array(Buffer.concat([walk, ...bouts])), 1);
  const context = await served.browser.newContext({ viewport: PHONE });
  const page = await context.newPage();
  await insoles.serve(page);
  await page.goto(served.url);
  await page.locator("nav [data-to=steps]").click();
  const cells = async () => page.locator("#bouts tbody tr").evaluateAll((rows) => rows.map((row) => [...row.children].map((cell) => cell.textContent)));
  await page.locator("#bouts tbody tr").nth(2).waitFor();
  const kinds = (await cells()).map(([side, , kind, duration_s, integral_n_s]) => [side, kind, duration_s, integral_n_s]);
  expect(kinds).toEqual([
    ["Left", "sitting", "20", "800"],
    ["Left", "shuffling", "40", "800"],
    ["Left", "standing", "60", "800"],
  ]);
  await expect.poll(() => insoles.acknowledged.map(([, bytes]) => bytes[0])).toEqual(expect.arrayContaining([FIRST, FIRST + 1, FIRST + 2]));
  await page.locator("#bouts").scrollIntoViewIfNeeded();
  await page.screenshot({ path: phonePath("tests/screenshots/bouts.png") });
  await page.locator("nav [data-to=settings]").click();
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator("#export-bouts").click()]);
  const rows = readFileSync(await download.path(), "utf8").trimEnd().split("\n");
  expect(rows[0]).toBe("start_unix_s,side,number,kind,start_s,duration_s,region,measured_force_integral_n_s,pressure_integral_kpa_s,peak_pressure_kpa");
  expect(rows).toHaveLength(1 + 3 * 8);
  expect(rows[1]).toMatch(/,left,6,standing,1,60,heel,100,500,51.2$/);
  // The bouts are stored on the phone, so they are shown after a reload.
  insoles.stop();
  await page.reload();
  await page.locator("nav [data-to=steps]").click();
  await page.locator("#bouts tbody tr").nth(2).waitFor();
  await context.close();
});
