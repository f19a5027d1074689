/**
 * The stored records on the built page in Chromium. `PLANTAR_FIGURES` is a folder for a file with the time to open the page and
 * the memory that the page then uses.
 */

import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { loadWire, messagesOf } from "../wire";
import { PHONE, open, phonePath, servedBrowser } from "./browser";

/** Number of records: two weeks with 5,000 steps of each foot on every day. */
const MANY = 140_000;
/** Number of loads of the page that are measured, an odd number. */
const LOADS = 3;
/** Time in which the browser must have stored these records and shown the page; a slow computer needs half a minute. */
const TIMEOUT_MS = 180_000;
/** Time of the first record: noon of 1 January 2026. */
const START_UNIX_S = new Date(2026, 0, 1, 12).getTime() / 1000;

const served = servedBrowser();

/** The messages of the steps of the computed walk. */
async function steps(): Promise<number[][]> {
  const wire = await loadWire();
  return [0, 1].flatMap(messagesOf).filter((message) => wire.decode(message)?.kind === "step").map((message) => [...message]);
}

/** A record of another protocol version. */
const OTHER_VERSION = { message: [255, 255], start_unix_s: START_UNIX_S };

/** Stores records in a database of this earlier version. */
async function storeRecords(
  page: Page,
  version: 1 | 2,
  records: readonly { key?: string; message: number[]; start_unix_s: number }[],
): Promise<void> {
  // Any other file of the same origin; the page itself would create the database.
  await page.goto(`${served.url}manifest.webmanifest`);
  await page.evaluate(
    async ({ version, records }) => {
      const name = version === 1 ? "steps" : "records";
      const request = indexedDB.open("plantar", version);
      const database = await new Promise<IDBDatabase>((resolve) => {
        request.onupgradeneeded = () => {
          const store = request.result.createObjectStore(name, { autoIncrement: true });
          if (version === 1) return;
          store.createIndex("key", "key", { unique: true });
          request.result.createObjectStore("days", { keyPath: "day" });
        };
        request.onsuccess = () => resolve(request.result);
      });
      const transaction = database.transaction(name, "readwrite");
      for (const record of records) transaction.objectStore(name).add({ ...record, message: Uint8Array.from(record.message) });
      await new Promise((resolve) => (transaction.oncomplete = resolve));
      database.close();
    },
    { version, records },
  );
}

/** Opens the page on a phone, without insoles. */
async function openPage(page: Page): Promise<void> {
  await page.goto(`${served.url}?bluetooth`);
  await page.locator("nav [data-to=steps]").click();
}

/** The cells of the table of days. */
const days = (page: Page) =>
  page.locator("#days tbody tr").evaluateAll((rows) => rows.map((row) => [...row.children].map((cell) => cell.textContent)));

test("the records of version 1 of the database are moved, counted by day and exported", async () => {
  const messages = await steps();
  const context = await served.browser.newContext({ viewport: PHONE });
  const page = await context.newPage();
  const records = messages.map((message, i) => ({ message, start_unix_s: START_UNIX_S + i }));
  // A record that was stored twice, and one of another protocol version.
  await storeRecords(page, 1, [...records, { message: messages[0]!, start_unix_s: START_UNIX_S }, OTHER_VERSION]);
  await openPage(page);
  await page.locator("#table tbody tr").first().waitFor();
  const [day, ...others] = await days(page);
  expect(others).toEqual([]);
  expect(day?.[0]).toMatch(/Jan/);
  expect(Number(day?.[1]) + Number(day?.[2])).toBe(messages.length);
  await page.locator("#days").scrollIntoViewIfNeeded();
  await page.screenshot({ path: phonePath("tests/screenshots/days.png") });
  const stored = await page.evaluate(async () => {
    const database = await new Promise<IDBDatabase>((resolve) => {
      const request = indexedDB.open("plantar");
      request.onsuccess = () => resolve(request.result);
    });
    const count = database.transaction("records").objectStore("records").count();
    await new Promise((resolve) => (count.onsuccess = resolve));
    return { stores: [...database.objectStoreNames], count: count.result };
  });
  // The record of another version remains.
  expect(stored).toEqual({ stores: ["days", "records"], count: messages.length + 1 });
  await page.locator("nav [data-to=settings]").click();
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator("#export-steps").click()]);
  const rows = readFileSync(await download.path(), "utf8").trimEnd().split("\n");
  expect(rows).toHaveLength(1 + 8 * messages.length);
  expect(new Set(rows.slice(1).map((row) => row.split(",")[0])).size).toBe(messages.length);
  // After the steps are deleted, the page confirms it where the wearer sees it.
  page.on("dialog", (dialog) => void dialog.accept());
  await page.locator("#clear").click();
  await page.locator("#notes", { hasText: "All steps and loads on this device are deleted." }).waitFor();
  await expect.poll(() => page.evaluate(() => document.activeElement?.id)).toBe("notes");
  await page.locator("nav [data-to=steps]").click();
  await page.locator("#no-steps").waitFor();
  await context.close();
});

test("the table shows all days on request, and a period can be exported", async () => {
  const DAYS = 40;
  const [message] = await steps();
  const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
  await page.locator("#start h2").waitFor();
  // A step of the left foot at noon of each day, the earliest day first.
  const noons = Array.from({ length: DAYS }, (_, i) => {
    const now = new Date();
    return new Date(now.getFullYear(), now.getMonth(), now.getDate() + i - (DAYS - 1), 12);
  });
  const dates = noons.map((noon) => noon.toLocaleDateString("sv"));
  const times_unix_s = noons.map((noon) => noon.getTime() / 1000);
  await page.evaluate(
    async ({ message, dates, times_unix_s }) => {
      const database = await new Promise<IDBDatabase>((resolve) => {
        const request = indexedDB.open("plantar");
        request.onsuccess = () => resolve(request.result);
      });
      const transaction = database.transaction(["records", "days"], "readwrite");
      const none = { steps: 0, bouts: 0, alerts: 0, integral_n_s: 0, peak_n: 0 };
      dates.forEach((day, i) => {
        const record = { key: day, message: Uint8Array.from(message), start_unix_s: times_unix_s[i] };
        transaction.objectStore("records").add(record);
        transaction.objectStore("days").put({ day, left: { ...none, steps: 1, integral_n_s: 400, peak_n: 800 }, right: none });
      });
      await new Promise((resolve) => (transaction.oncomplete = resolve));
      database.close();
    },
    { message: message!, dates, times_unix_s },
  );
  await openPage(page);
  await page.locator("#table tbody tr").first().waitFor();
  expect(await days(page)).toHaveLength(31);
  // The right foot has no records.
  expect((await days(page))[0]?.slice(1)).toEqual(["1", "–", "0.4", "–", "800", "–"]);
  await page.locator("#days-all").scrollIntoViewIfNeeded();
  expect(await page.locator("#days-all").textContent()).toBe(`Show all ${DAYS} days`);
  await page.locator("#days-all").click();
  expect(await days(page)).toHaveLength(DAYS);
  expect(await page.locator("#days-all").isVisible()).toBe(false);
  expect(await page.evaluate(() => document.activeElement?.id)).toBe("days");

  await page.locator("nav [data-to=settings]").click();
  /** The name and the rows of an exported file, without the header line. */
  const exported = async (what: string, period: string): Promise<[string, string[][]]> => {
    await page.locator("#export-period").selectOption(period);
    const [download] = await Promise.all([page.waitForEvent("download"), page.locator(`#export-${what}`).click()]);
    const rows = readFileSync(await download.path(), "utf8").trimEnd().split("\n").slice(1);
    return [download.suggestedFilename(), rows.map((row) => row.split(","))];
  };
  const week = times_unix_s.slice(-7);
  const [name, rows] = await exported("steps", "7");
  expect(name).toBe(`plantar_steps_from_${dates.at(-7)}.csv`);
  expect([...new Set(rows.map(([time_unix_s]) => Number(time_unix_s)))]).toEqual(week);
  expect(rows).toHaveLength(8 * week.length);
  const [, all] = await exported("steps", "0");
  expect(all).toHaveLength(8 * DAYS);
  for (const [period, expected] of [["0", dates], ["7", dates.slice(-7)]] as const) {
    const [, loads] = await exported("days", period);
    // Columns: day, side, steps.
    const with_steps = loads.filter(([, , count]) => count === "1");
    expect(loads).toHaveLength(2 * expected.length);
    expect(with_steps.map(([day]) => day)).toEqual(expected);
  }
  await page.locator("#export-period").scrollIntoViewIfNeeded();
  await page.screenshot({ path: phonePath("tests/screenshots/export.png") });
  await page.close();
});

test("the last steps are listed by their times, and the table is not wider than a phone", async () => {
  const context = await served.browser.newContext({ viewport: PHONE, locale: "en-US" });
  const page = await context.newPage();
  // The steps of the right foot arrived after all of the left one. A minute lies between two steps of a foot.
  const records = (await steps()).map((message, i, { length }) => {
    const number = i % (length / 2);
    return { key: `${i}`, message, start_unix_s: START_UNIX_S + 60 * number + (i < length / 2 ? 0 : 30) };
  });
  await storeRecords(page, 2, records);
  const widths = () => page.locator("#table").evaluate((table) => [table.scrollWidth, table.clientWidth]);
  for (const settings of [{}, { body_mass_kg: 80, force_unit: "%BW" }]) {
    await page.evaluate((settings) => localStorage.setItem("plantar.settings", JSON.stringify(settings)), settings);
    await openPage(page);
    await page.locator("#table tbody tr").first().waitFor();
    const rows = await page.locator("#table tbody tr").evaluateAll((rows) =>
      rows.map((row) => [...row.children].map((cell) => cell.textContent)));
    expect(rows.map(([side]) => side)).toEqual(records.map((_, i) => (i % 2 === 0 ? "Right" : "Left")));
    const minutes = rows.map(([, time]) => Number(/:(\d\d)/.exec(time ?? "")?.[1]));
    expect(minutes).toEqual([...minutes].sort((a, b) => b - a));
    const [content, visible] = await widths();
    expect(content).toBeLessThanOrEqual(visible!);
  }
  await page.locator("#table").screenshot({ path: phonePath("tests/screenshots/last-steps.png") });
  await context.close();
});

test("the records of version 2 of the database get the keys by which repetitions are recognised", async () => {
  const messages = await steps();
  const context = await served.browser.newContext({ viewport: PHONE });
  const page = await context.newPage();
  const hex = (message: number[]) => message.map((byte) => byte.toString(16).padStart(2, "0")).join("");
  const records = messages.map((message, i) => ({ key: hex(message), message, start_unix_s: START_UNIX_S + i }));
  // A record of another protocol version has no key.
  await storeRecords(page, 2, [...records, OTHER_VERSION]);
  await openPage(page);
  await page.locator("#table tbody tr").first().waitFor();
  const stored = await page.evaluate(async () => {
    const database = await new Promise<IDBDatabase>((resolve) => {
      const request = indexedDB.open("plantar");
      request.onsuccess = () => resolve(request.result);
    });
    const all = database.transaction("records").objectStore("records").getAll();
    await new Promise((resolve) => (all.onsuccess = resolve));
    return (all.result as { key?: string; message: Uint8Array }[]).map(({ key, message }) => [key, [...message]] as const);
  });
  const wire = await loadWire();
  const keys = messages.map((message) => {
    const decoded = wire.decode(Uint8Array.from(message));
    return decoded?.kind === "step" ? decoded.key : undefined;
  });
  expect(stored).toEqual([...messages.map((message, i) => [keys[i], message]), [undefined, [255, 255]]]);
  for (const key of keys) expect(key).toMatch(/^[0-9a-f]+-[0-9a-f]+-[0-9a-f]{8}$/);
  expect(new Set(keys).size).toBe(keys.length);
  await context.close();
});

test("a page whose database another tab blocks asks to close that tab, and then continues", async () => {
  const context = await served.browser.newContext({ viewport: PHONE });
  const other = await context.newPage();
  await other.goto(`${served.url}manifest.webmanifest`);
  await other.evaluate(async () => {
    const request = indexedDB.open("plantar", 1);
    await new Promise((resolve) => {
      request.onupgradeneeded = () => request.result.createObjectStore("steps", { autoIncrement: true });
      request.onsuccess = resolve;
    });
    // A database to which nothing refers would be closed.
    Object.assign(window, { database: request.result });
  });
  const page = await context.newPage();
  await page.goto(`${served.url}?bluetooth`);
  const note = page.getByText("Close all other tabs of this page");
  await note.waitFor();
  await other.close();
  await page.locator("#start h2").waitFor();
  expect(await note.count()).toBe(0);
  await context.close();
});

test("a page with many stored records shows the last ones and all days", { timeout: TIMEOUT_MS }, async () => {
  const messages = await steps();
  const context = await served.browser.newContext({ viewport: PHONE });
  const page = await context.newPage();
  await openPage(page);
  await page.locator("#no-steps").waitFor();
  await page.evaluate(
    async ({ messages, count, start_unix_s }) => {
      const database = await new Promise<IDBDatabase>((resolve) => {
        const request = indexedDB.open("plantar");
        request.onsuccess = () => resolve(request.result);
      });
      const encoded = messages.map((message) => Uint8Array.from(message));
      for (let first = 0; first < count; first += 10_000) {
        const transaction = database.transaction(["records", "days"], "readwrite", { durability: "relaxed" });
        for (let i = first; i < first + 10_000; i++) {
          const record = { key: `${i}`, message: encoded[i % encoded.length], start_unix_s: start_unix_s + i };
          transaction.objectStore("records").add(record);
        }
        const foot = { steps: 5000, bouts: 0, alerts: 0, integral_n_s: 2e6, peak_n: 800 };
        const day = `2026-01-${String(1 + first / 10_000).padStart(2, "0")}`;
        transaction.objectStore("days").put({ day, left: foot, right: foot });
        await new Promise((resolve) => (transaction.oncomplete = resolve));
      }
      database.close();
    },
    { messages, count: MANY, start_unix_s: START_UNIX_S },
  );
  // The median, because other programs on this computer can delay a load.
  const loads_ms: number[] = [];
  while (loads_ms.length < LOADS) {
    await page.reload();
    await page.waitForFunction(() => document.querySelectorAll("#table tbody tr").length > 0);
    loads_ms.push(await page.evaluate(() => performance.now()));
  }
  const load_ms = loads_ms.sort((a, b) => a - b)[(LOADS - 1) / 2]!;
  const protocol = await context.newCDPSession(page);
  await protocol.send("Performance.enable");
  const { metrics } = await protocol.send("Performance.getMetrics");
  const heap_mb = (metrics.find(({ name }) => name === "JSHeapUsedSize")?.value ?? NaN) / 1e6;
  console.log(`page_load_ms ${load_ms.toFixed(0)} with ${MANY} stored steps, ${heap_mb.toFixed(0)} MB of memory`);
  const figures = { page_load_ms: Math.round(load_ms), page_load_mb: Math.round(heap_mb) };
  if (process.env.PLANTAR_FIGURES) writeFileSync(join(process.env.PLANTAR_FIGURES, "storage.json"), JSON.stringify(figures));
  expect((await days(page)).length).toBe(MANY / 10_000);
  await page.locator("nav [data-to=steps]").click();
  expect(await page.locator("#measures").textContent()).toContain(`${MANY}`);
  // The last record is the first row.
  const wire = await loadWire();
  const last = wire.decode(Uint8Array.from(messages[(MANY - 1) % messages.length]!));
  if (last?.kind !== "step") throw new Error("The message is not a step.");
  const cells = await page.locator("#table tbody tr").first().locator("td").allTextContents();
  expect([cells[2], cells[3]]).toEqual([last.step.duration_s.toFixed(2), last.step.foot.foot_force_peak_n.toFixed(0)]);
  await context.close();
});
