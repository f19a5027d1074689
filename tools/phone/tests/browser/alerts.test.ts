/** Alerts and the load of the day on the built page in Chromium. */

import { readFileSync } from "node:fs";
import type { BrowserContext, Page } from "playwright-core";
import { expect, test } from "vitest";
import { entries, entry } from "../../src/stream_file";
import { PHONE, phonePath, servedBrowser } from "./browser";
import { FakeInsoles, varint } from "./fake_insoles";

/** First bytes of messages and requests. */
const [TIME, ALERT, ALERT_RULES, DAILY_LOAD] = [6, 18, 19, 20];
const [GET_ALERT_RULES, SET_ALERT_RULES, GET_DAILY_LOAD, SNOOZE_ALERTS] = [22, 23, 24, 25];
/** Number of the alert, the one after those of the six steps of the walk. */
const NUMBER = 6;

const served = servedBrowser();

/** A page without a vibration motor and a loudspeaker: it counts the calls. */
async function countingPage(context: BrowserContext): Promise<Page> {
  const page = await context.newPage();
  await page.addInitScript(() => {
    const counts = { vibrations: 0, tones: 0 };
    Object.assign(window, { counts });
    navigator.vibrate = () => ((counts.vibrations += 1), true);
    const start = OscillatorNode.prototype.start;
    OscillatorNode.prototype.start = function (when?: number) {
      counts.tones += 1;
      start.call(this, when);
    };
  });
  return page;
}

const counts = (page: Page) => page.evaluate(() => (window as unknown as { counts: { vibrations: number; tones: number } }).counts);

const f32 = (value: number) => [...new Uint8Array(Float32Array.of(value).buffer)];

/** An alert 0.3 s after the first scan: heel and big toe of the left foot carried load for most of a window of 15 minutes. */
const ALERT_BYTES = [ALERT, ...varint(NUMBER), 0, ...varint(300_000), 0b10_0001, 0, ...varint(900), 1, 0, 0];
/** The alert 0.4 s after the beginning of the walk. */
const ALERT_ENTRY = { t_ms: 400, insole: 0, message: Uint8Array.from(ALERT_BYTES) } as const;
/** The recommended rules, with this number of alerts in a day. */
const rules = (per_day: number) =>
  [ALERT_RULES, ...f32(200), ...f32(4.7), ...varint(900), 95, 80, 255, ...f32(0), ...varint(1200), per_day, 0];
/** A day in which the heel was under sustained load for 20 minutes, with a dose of 500 kPa s. */
const DAILY_BYTES = [
  ...[DAILY_LOAD, ...varint(20_000), ...varint(7200), ...varint(1500), ...varint(5000), ...varint(90_000), ...varint(1200)],
  ...Array.from({ length: 7 * 3 }, () => 0),
  ...[1, 0, 2, ...varint(600)],
];

test("an alert is shown in plain words, signalled, stored, acknowledged and snoozed", async () => {
  const walk = entries(new Uint8Array(readFileSync(phonePath("public/walk.plantar"))));
  // The times of the recording are not those of today: without them, the alert has no time and counts as new.
  const timeless = [...walk].filter(({ message }) => message[0] !== TIME);
  const insoles = new FakeInsoles(new Uint8Array(Buffer.concat([...timeless, ALERT_ENTRY].map(entry))), 1);
  const context = await served.browser.newContext({ viewport: PHONE });
  const page = await countingPage(context);
  await insoles.serve(page);
  await page.goto(served.url);
  const banner = page.locator("#alert");
  await banner.waitFor();
  const advice =
    "Sit, and hold your left foot off the floor for 4 minutes. It carried load here for most of the last 15 minutes: heel and big toe.";
  expect(await banner.locator("p").textContent()).toMatch(new RegExp(`^${advice} Raised at .*\\d:\\d\\d`));
  // The alert remains in view.
  await page.locator("#quantity").scrollIntoViewIfNeeded();
  expect(await page.evaluate(() => scrollY)).toBeGreaterThan(0);
  expect((await banner.boundingBox())!.y).toBeGreaterThanOrEqual(0);
  // At a zoom of 200 %, which halves the size of the screen in CSS pixels, its buttons remain in view, too.
  await page.setViewportSize({ width: 195, height: 422 });
  const bar = (await page.locator("nav").boundingBox())!;
  const { y, height } = (await page.locator("#alert-snooze").boundingBox())!;
  expect(y + height).toBeLessThanOrEqual(bar.y);
  await page.setViewportSize(PHONE);
  // A browser without a screen allows sound although the page was not touched.
  expect(await counts(page)).toEqual({ vibrations: 1, tones: 2 });
  await expect.poll(() => insoles.acknowledged.map(([, bytes]) => bytes[0])).toContain(NUMBER);
  await page.screenshot({ path: phonePath("tests/screenshots/alert.png") });

  await page.locator("#alert-snooze").click();
  expect(await banner.isHidden()).toBe(true);
  await expect.poll(() => insoles.requests.filter(([, [kind]]) => kind === SNOOZE_ALERTS)).toEqual([
    [0, [SNOOZE_ALERTS, ...varint(1800)]],
    [1, [SNOOZE_ALERTS, ...varint(1800)]],
  ]);
  // The insole sends the alert again, because the acknowledgement was lost: it is not shown again.
  insoles.answer(0, Uint8Array.from(ALERT_BYTES));
  await page.locator("nav [data-to=steps]").click();
  const rows = page.locator("#alert-list tbody tr");
  await rows.first().waitFor();
  expect(await banner.isHidden()).toBe(true);
  expect(await rows.count()).toBe(1);
  expect(await rows.locator("td").last().textContent()).toBe("Heel; Big toe");

  await expect.poll(() => insoles.requests.some(([, [kind]]) => kind === GET_DAILY_LOAD)).toBe(true);
  insoles.answer(0, Uint8Array.from(DAILY_BYTES));
  await page.locator("#today").waitFor();
  const heel = await page.locator("#today tbody tr").last().locator("th, td").allTextContents();
  expect(heel).toEqual(["Heel", "20 ●", "–", "500", "–"]);
  expect(await page.locator("#today-note").textContent()).toMatch(/^Alerts today: 2\. No alert can come now\. The next one can come in \d+ minutes: /);
  await page.locator("nav [data-to=live]").click();
  await page.locator("#notes").getByText("No alert can come now. The next one can come in").waitFor();
  await page.locator("nav [data-to=steps]").click();
  await page.locator("#today").scrollIntoViewIfNeeded();
  await page.screenshot({ path: phonePath("tests/screenshots/daily-load.png") });
  insoles.stop();
  await context.close();
});

test("an alert without a known time is shown before the first live frame", async () => {
  const walk = [...entries(new Uint8Array(readFileSync(phonePath("public/walk.plantar"))))];
  const hello = walk.find(({ insole }) => insole === ALERT_ENTRY.insole)!;
  const insoles = new FakeInsoles(new Uint8Array(Buffer.concat([hello, ALERT_ENTRY].map(entry))), 1);
  const context = await served.browser.newContext({ viewport: PHONE });
  const page = await context.newPage();
  await insoles.serve(page);
  await page.goto(served.url);
  await page.locator("#alert").waitFor();
  await page.locator("nav [data-to=steps]").click();
  expect(await page.locator("#alert-list tbody td").allTextContents()).toEqual(["Left", "–", "Heel; Big toe"]);
  insoles.stop();
  await context.close();
});

test("the wearer turns the alerts of both insoles on and off", async () => {
  const insoles = new FakeInsoles(new Uint8Array(readFileSync(phonePath("public/walk.plantar"))), 1);
  const context = await served.browser.newContext({ viewport: PHONE, timezoneId: "Asia/Kolkata" });
  const page = await countingPage(context);
  await insoles.serve(page);
  await page.goto(served.url);
  await page.locator("nav [data-to=settings]").click();
  const box = page.locator("#alerts-on");
  expect(await box.isDisabled()).toBe(true);
  const asked = () => new Set(insoles.requests.filter(([, [kind]]) => kind === GET_ALERT_RULES).map(([insole]) => insole));
  await expect.poll(asked).toEqual(new Set([0, 1]));
  for (const insole of [0, 1] as const) insoles.answer(insole, Uint8Array.from(rules(0)));
  const sets = () => insoles.requests.filter(([, [kind]]) => kind === SET_ALERT_RULES).map(([, bytes]) => bytes);
  // The day in India begins at 18:30 UTC. The page sets this beginning before the alerts are turned on.
  const inIndia = (per_day: number) => [...rules(per_day).slice(1, -1), ...varint(1110)];
  const [off, on] = [0, 20].map((per_day) => [SET_ALERT_RULES, ...inIndia(per_day)]);
  await expect.poll(sets).toEqual([off, off]);
  for (const insole of [0, 1] as const) insoles.answer(insole, Uint8Array.from([ALERT_RULES, ...inIndia(0)]));
  await expect.poll(() => box.isEnabled()).toBe(true);
  expect(await box.isChecked()).toBe(false);
  await box.check();
  await expect.poll(() => sets().slice(2)).toEqual([on, on]);
  await expect.poll(() => counts(page)).toEqual({ vibrations: 1, tones: 2 });
  await box.scrollIntoViewIfNeeded();
  await page.screenshot({ path: phonePath("tests/screenshots/alert-settings.png") });
  insoles.stop();
  await context.close();
});

/** The element that has the focus, if neither it nor a part of it is visible; otherwise `undefined`. */
const hiddenFocus = (page: Page) =>
  page.evaluate(() => {
    const element = document.activeElement;
    // After the last element of the page, the focus leaves it.
    if (!element || element === document.body) return undefined;
    const { left, top, width, height } = element.getBoundingClientRect();
    const shares = [0.02, 0.25, 0.5, 0.75, 0.98];
    const visible = shares.some((x) => shares.some((y) => element.contains(document.elementFromPoint(left + x * width, top + y * height))));
    return visible ? undefined : `${element.id || element.textContent}: at ${top} to ${top + height}, scrolled by ${scrollY}`;
  });

test.each([[422, 195], [195, 422], [390, 844]])("an alert hides no control that has the focus: %i by %i pixels", async (width, height) => {
  const walk = [...entries(new Uint8Array(readFileSync(phonePath("public/walk.plantar"))))];
  const hello = walk.find(({ insole }) => insole === ALERT_ENTRY.insole)!;
  const insoles = new FakeInsoles(new Uint8Array(Buffer.concat([hello, ALERT_ENTRY].map(entry))), 1);
  const context = await served.browser.newContext({ viewport: { width, height } });
  const page = await context.newPage();
  await insoles.serve(page);
  await page.goto(served.url);
  await page.locator("#alert").waitFor();
  await page.locator("nav [data-to=settings]").click();
  await page.locator("#alert-close").focus();
  const hidden: (string | undefined)[] = [];
  // From the alert to the buttons of the views, and back.
  for (const key of ["Tab", "Shift+Tab"]) {
    for (let count = 0; count < 20; count++) {
      await page.keyboard.press(key);
      hidden.push(await hiddenFocus(page));
    }
  }
  expect(hidden.filter(Boolean)).toEqual([]);
  // The focus does not get lost with the button that closes the alert.
  await page.locator("#alert-close").press("Enter");
  await page.locator("#alert").waitFor({ state: "hidden" });
  await expect.poll(() => page.evaluate(() => document.activeElement?.id)).toBe("notes");
  insoles.stop();
  await context.close();
});
