/** The built page in Chromium, with the computed walk. */

import { readFileSync, readdirSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import type { Page } from "playwright-core";
import { beforeAll, describe, expect, test } from "vitest";
import { DIST, PHONE, firstLoad_ms, open, phonePath, servedBrowser } from "./browser";

const DESKTOP = { width: 1280, height: 900 };
const MOST_BYTES = 400 * 1024;
/** Time between the frames of the screen on the clock of a test. */
const FRAME_MS = 16;

const served = servedBrowser();
let replay: string;
beforeAll(() => {
  replay = `${served.url}?replay=walk.plantar`;
});

/** Shows a view of the page. */
const show = (page: Page, view: string) => page.locator(`nav [data-to=${view}]`).click();
/** Enters a value, and leaves the field. */
async function enter(page: Page, field: string, value: string): Promise<void> {
  await page.locator(field).fill(value);
  await page.locator(field).blur();
}
/** True if the element that has the focus matches `selector`. */
const has_focus = (page: Page, selector: string) =>
  page.waitForFunction((selector) => document.activeElement?.matches(selector), selector).then(() => true);
/** Replaces the browser's Bluetooth by one that offers an insole which never answers. */
const offerInsole = (page: Page) =>
  page.addInitScript(() => {
    const gatt = { connect: () => new Promise(() => undefined), disconnect: () => undefined };
    const device = { id: "insole", addEventListener: () => undefined, gatt };
    Object.defineProperty(Navigator.prototype, "bluetooth", { value: { requestDevice: () => Promise.resolve(device) } });
  });
/** Shows the steps, and waits until the table has at least this many. Steps are drawn only where they can be seen. */
async function waitForSteps(page: Page, least: number): Promise<void> {
  // On a wide screen, they are always visible.
  if (await page.locator("nav [data-to=steps]").isVisible()) await show(page, "steps");
  await page.waitForFunction((least) => document.querySelectorAll("#table tbody tr").length >= least, least);
}

test("the compressed page is at most 400 KiB", () => {
  const names = readdirSync(DIST, { recursive: true, withFileTypes: true }).filter((entry) => entry.isFile());
  const bytes = names.reduce((sum, { parentPath, name }) => sum + gzipSync(readFileSync(join(parentPath, name))).length, 0);
  console.log(`page, compressed, with the computed walk: ${(bytes / 1024).toFixed(0)} KiB of ${MOST_BYTES / 1024}`);
  expect(bytes).toBeLessThanOrEqual(MOST_BYTES);
});

test("a recording shows both feet, their steps and measures", async () => {
  const page = await open(served.browser, replay, { viewport: PHONE });
  console.log(`first load drawn after ${(await firstLoad_ms(page)).toFixed(0)} ms`);
  const deltas_ms = await page.evaluate(async () => {
    const times: number[] = [];
    while (times.length <= 300) times.push(await new Promise(requestAnimationFrame));
    return times.slice(1).map((t, i) => t - times[i]!).sort((a, b) => a - b);
  });
  const [median_ms, percentile_95_ms] = [deltas_ms[150]!.toFixed(1), deltas_ms[285]!.toFixed(1)];
  console.log(`two feet at 100 Hz: a screen frame every ${median_ms} ms (median), 95 % within ${percentile_95_ms} ms`);
  await page.waitForFunction(() => {
    const totals = [...document.querySelectorAll("#totals dd")];
    return totals.every((total) => parseFloat(total.textContent ?? "") > 100);
  });
  await waitForSteps(page, 4);
  /** The means of the left and of the right foot and the symmetry index in a row of the table. */
  const both = async (name: string) => {
    const cells = page.locator("#both-feet tr", { hasText: name }).first().locator("td");
    return cells.evaluateAll((cells) => cells.map((cell) => parseFloat(cell.firstChild?.textContent ?? "")));
  };
  // The walk has strides of 1.05 s on average, which consist of a step of each foot.
  const [left_s, right_s] = await both("Step time");
  expect(Math.abs((left_s ?? 0) + (right_s ?? 0) - 1.05)).toBeLessThan(0.03);
  // The peak force is 760 N on the left foot and 800 N on the right foot.
  const [left, right, symmetry] = await both("Peak force");
  expect(Math.abs((left ?? 0) - 760)).toBeLessThan(25);
  expect(Math.abs((right ?? 0) - 800)).toBeLessThan(25);
  expect(symmetry).toBeLessThan(0);
  const cadence = Number(await page.locator("#measures dd").first().evaluate((dd) => dd.firstChild?.textContent));
  expect(cadence).toBeGreaterThan(100);
  expect(cadence).toBeLessThan(130);
  await page.close();
});

test("on a web server at localhost without plantar serve, the page offers the example walk", async () => {
  const page = await served.browser.newPage({ viewport: PHONE });
  await page.goto(served.url);
  await page.getByText("plantar serve does not answer").waitFor();
  await page.locator("#walk").click();
  await firstLoad_ms(page);
  expect(await page.locator("#start").isHidden()).toBe(true);
  await page.close();
});

test("the steps of a recording are not shown together with the wearer's steps", async () => {
  const page = await open(served.browser, replay, { viewport: PHONE });
  await page.evaluate(() => {
    // The wearer cancels the first choice. The insole of the second one does not answer.
    const gatt = { connect: () => new Promise(() => undefined) };
    const choices = [
      () => Promise.reject(new DOMException("none chosen", "NotFoundError")),
      () => Promise.resolve({ id: "insole", addEventListener: () => undefined, gatt }),
    ];
    Object.defineProperty(navigator, "bluetooth", { value: { requestDevice: () => choices.shift()?.() } });
  });
  await waitForSteps(page, 4);
  await show(page, "settings");
  await page.locator("#add").click();
  // The recording continues.
  await show(page, "steps");
  await waitForSteps(page, 6);
  await show(page, "settings");
  await page.locator("#add").click();
  // The wearer has no stored steps yet.
  await show(page, "steps");
  await page.locator("#no-steps").waitFor();
  await page.close();
});

test("the soles are drawn at most once with each frame of the screen, and not while another view is shown", async () => {
  const page = await open(served.browser, "about:blank", { viewport: PHONE });
  // The clock of the page is that of the test, so that a busy computer delays no frame of the recording.
  const start = new Date("2026-01-01T12:00:00Z");
  await page.clock.install({ time: start });
  await page.clock.pauseAt(new Date(start.getTime() + 60_000));
  await page.goto(replay);
  const has_load = () => page.evaluate(() => parseFloat(document.querySelector("#totals dd")?.textContent ?? "") > 100);
  while (!(await has_load())) await page.clock.runFor(100);
  /**
   * Returns for `frames` frames of the screen the largest number of drawings of one sole in a frame, the number of soles that
   * were drawn, and the number of frames with another picture than the frame before.
   */
  const drawings = async (frames: number) => {
    const counted = page.evaluate(async (frames) => {
      const context = document.querySelector<HTMLCanvasElement>("#soles")!.getContext("2d")!;
      const { width, height } = context.canvas;
      const picture = () => {
        // The canvas of a view that is not shown has no size.
        if (width === 0) return 0;
        const pixels = new Uint32Array(context.getImageData(0, 0, width, height).data.buffer);
        return pixels.reduce((hash, pixel) => (31 * hash + pixel) | 0, 0);
      };
      // Drawings requested before do not count.
      for (let i = 0; i < 2; i += 1) await new Promise(requestAnimationFrame);
      // Each drawing of a sole is limited to a rectangle, its half of the canvas.
      const drawn = new Map<number, number>();
      const soles = new Set<number>();
      context.rect = (x, ...rest) => {
        drawn.set(x, (drawn.get(x) ?? 0) + 1);
        CanvasRenderingContext2D.prototype.rect.call(context, x, ...rest);
      };
      let [most, changed, last] = [0, 0, picture()];
      for (let i = 0; i < frames; i += 1) {
        await new Promise(requestAnimationFrame);
        const present = picture();
        if (present !== last) changed += 1;
        last = present;
        for (const [x, count] of drawn) {
          soles.add(x);
          most = Math.max(most, count);
        }
        drawn.clear();
      }
      Reflect.deleteProperty(context, "rect");
      return { most, soles: soles.size, changed };
    }, frames);
    for (let i = 0; i < frames + 3; i += 1) await page.clock.runFor(FRAME_MS);
    return counted;
  };
  // While walking, at least one foot is on the ground, so the picture always changes.
  expect(await drawings(300)).toEqual({ most: 1, soles: 2, changed: 300 });
  await show(page, "steps");
  expect(await drawings(60)).toEqual({ most: 0, soles: 0, changed: 0 });
  await page.close();
});

test("in a frame of another page, no insole is connected", async () => {
  const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
  await page.evaluate((url) => {
    const frame = document.createElement("iframe");
    Object.assign(frame, { src: url, allow: "bluetooth", style: "position: fixed; inset: 0; width: 100%; height: 100%; z-index: 9" });
    document.body.append(frame);
  }, replay);
  const frame = page.frameLocator("iframe");
  await frame.locator("nav [data-to=settings]").click();
  await frame.locator("#add").click();
  await frame.locator("#notes", { hasText: "while another page shows it in a frame" }).waitFor();
  await page.close();
});

test("the table of regions shows the chosen quantity", async () => {
  const page = await open(served.browser, replay, { viewport: PHONE });
  await firstLoad_ms(page);
  for (const [quantity, unit] of [["measured", "N"], ["model", "N"], ["deformation", "mm"], ["area", "cm²"]] as const) {
    await page.locator("#quantity").selectOption(quantity);
    await page.waitForFunction((unit) => {
      const value = new RegExp(`[1-9].* ${unit}`);
      return [...document.querySelectorAll("#regions td")].some((cell) => value.test(cell.textContent ?? ""));
    }, unit);
  }
  const select = page.locator("#quantity");
  // By the contact rule of the computed walk, each cell in contact counts with its whole area. With covered shares,
  // the label would be "Effective area".
  expect(await select.locator("option:checked").innerText()).toBe("Contact area");
  await select.selectOption("deformation");
  expect(await select.locator("option:checked").innerText()).toBe("Tissue deformation (scaled by assumption)");
  await page.locator("#quantity-note", { hasText: "Share of assumption: 100 %" }).waitFor();
  await page.close();
});

test("with a body mass, forces are shown in % of body weight, and the mass is stored", async () => {
  const page = await open(served.browser, replay, { viewport: PHONE });
  await show(page, "settings");
  await page.locator("#mass-unit").selectOption("lb");
  await enter(page, "#mass", "176.4");
  await page.locator("#force-unit").selectOption("%BW");
  expect(await page.evaluate(() => localStorage.getItem("plantar.settings"))).toContain("80.01");
  await page.reload();
  await firstLoad_ms(page);
  await page.getByRole("cell", { name: "%BW" }).first().waitFor();
  expect(await page.locator("#mass").inputValue()).toBe("176.4");
  await page.close();
});

test("a decimal comma is a decimal separator", async () => {
  const page = await open(served.browser, replay, { viewport: PHONE });
  await show(page, "settings");
  await page.locator("#mass").pressSequentially("65,5");
  await page.locator("#mass").blur();
  expect(await page.locator("#mass").inputValue()).toBe("65,5");
  expect(await page.evaluate(() => localStorage.getItem("plantar.settings"))).toContain('"body_mass_kg":65.5');
  await page.close();
});

test("a body mass or stride length out of range is refused with the limits", async () => {
  const page = await open(served.browser, replay, { viewport: PHONE });
  await show(page, "settings");
  const stored = async () => JSON.parse((await page.evaluate(() => localStorage.getItem("plantar.settings"))) ?? "{}") as unknown;
  const notes = async () => [await page.locator("#mass-note").textContent(), await page.locator("#stride-note").textContent()];
  const kg = "Enter 10 to 300 kg. Other values are not used.";
  const cm = "Enter 10 to 600 cm. Other values are not used.";
  let last = {};
  for (const [mass_kg, stride_cm, expected] of [
    [9.9, 9, [kg, cm]],
    [10, 10, ["", ""]],
    [300, 600, ["", ""]],
    [301, 601, [kg, cm]],
    ["6,5,5", "x", [kg, cm]],
  ] as const) {
    await enter(page, "#mass", String(mass_kg));
    await enter(page, "#stride", String(stride_cm));
    expect(await notes()).toEqual(expected);
    // A value that is refused does not replace the last valid one.
    if (expected[0] === "") last = { body_mass_kg: mass_kg, stride_cm };
    expect(await stored()).toMatchObject(last);
  }
  await page.locator("#mass-unit").selectOption("lb");
  expect(await notes()).toEqual(["", cm]);
  // 300 kg are 661.4 lb.
  await enter(page, "#mass", "662");
  expect(await notes()).toEqual(["Enter 23 to 661 lb. Other values are not used.", cm]);
  await enter(page, "#mass", "");
  await enter(page, "#stride", "");
  expect(await notes()).toEqual(["", ""]);
  // The first digits of a value are no error, and are not stored.
  for (const [field, digits] of [["#mass", "80"], ["#stride", "8"]] as const) {
    await page.locator(field).pressSequentially(digits);
    expect(await notes()).toEqual(["", ""]);
  }
  expect(await stored()).toMatchObject({ stride_cm: null });
  await page.locator("#stride").blur();
  expect(await notes()).toEqual(["", cm]);
  await page.locator("#stride").pressSequentially("0");
  expect(await notes()).toEqual(["", ""]);
  await page.close();
});

test("live values are recorded and exported, and steps are exported", async () => {
  const page = await open(served.browser, replay, { viewport: DESKTOP });
  await waitForSteps(page, 1);
  await show(page, "settings");
  await page.locator("#record").click();
  await page.waitForFunction(() => /\([1-9]/.test(document.querySelector("#record")?.textContent ?? ""));
  await page.locator("#record").click();
  for (const [button, first] of [
    ["export-live", "unix_s,t_s,side,sequence,device_t_s"],
    ["export-steps", "start_unix_s,side,step,start_s"],
  ] as const) {
    const [download] = await Promise.all([page.waitForEvent("download"), page.locator(`#${button}`).click()]);
    expect(download.suggestedFilename()).toBe(button === "export-live" ? "plantar_live.csv" : "recording_steps.csv");
    const rows = readFileSync(await download.path(), "utf8").trimEnd().split("\n");
    expect(rows[0]).toMatch(new RegExp(`^${first}`));
    expect(rows.length).toBeGreaterThan(button === "export-live" ? 100 : 8);
  }
  await page.close();
});

test.each([1, 2])("the texts of the diagram follow the size of texts, also on a narrow screen (%i times)", async (times) => {
  const page = await open(served.browser, replay, { viewport: { width: 320, height: 844 } });
  await page.addStyleTag({ content: `:root { font-size: ${17 * times}px !important }` });
  await waitForSteps(page, 3);
  const texts = page.locator("#trend text");
  const shown = await texts.evaluateAll((texts) => {
    const svg = document.querySelector("#trend svg")!.getBoundingClientRect();
    return texts.map((text) => {
      const { left, right, top, bottom } = text.getBoundingClientRect();
      const px = parseFloat(getComputedStyle(text).fontSize) * (text as SVGTextElement).getScreenCTM()!.a;
      return { px, is_inside: left >= svg.left && right <= svg.right && top >= svg.top && bottom <= svg.bottom };
    });
  });
  expect(shown.length).toBe(4);
  for (const { px, is_inside } of shown) {
    // Three quarters of the size of other texts, 17 px.
    expect([px.toFixed(1), is_inside]).toEqual([(12.75 * times).toFixed(1), true]);
  }
  // After the screen was turned, the diagram is as wide as the screen, and its texts have the same size.
  await page.setViewportSize({ width: 640, height: 320 });
  await page.waitForFunction(() => Number(document.querySelector("#trend svg")?.getAttribute("viewBox")?.split(" ")[2]) > 500);
  await page.close();
});

test("the installed page can be turned", () => {
  expect(JSON.parse(readFileSync(join(DIST, "manifest.webmanifest"), "utf8"))).not.toHaveProperty("orientation");
});

test("the focus does not return to the start of the page when its element disappears", async () => {
  const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
  await page.locator("#start h2").waitFor();
  await page.locator("#walk").press("Enter");
  await page.locator("#start").waitFor({ state: "hidden" });
  expect(await has_focus(page, "#notes")).toBe(true);
  await show(page, "settings");
  await page.locator("#identify-open").click();
  await page.locator("[data-action=start]").press("Enter");
  await page.locator("[data-action=close]").waitFor();
  // The buttons of a phase disappear when it ends by itself.
  await page.evaluate(() => {
    const button = document.querySelector<HTMLElement>("[data-action=close]")!;
    button.focus();
    button.remove();
  });
  expect(await has_focus(page, "#identify h2")).toBe(true);
  await page.close();
});

test("the page offers to reload once a new version controls it, but not on the first visit", async () => {
  const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
  await page.evaluate(async () => {
    const { serviceWorker } = navigator;
    await serviceWorker.ready;
    while (!serviceWorker.controller) await new Promise((resolve) => setTimeout(resolve, 50));
  });
  const note = page.getByText("A new version of this page is ready.");
  await page.waitForTimeout(300);
  expect(await note.count()).toBe(0);
  await page.evaluate(() => navigator.serviceWorker.dispatchEvent(new Event("controllerchange")));
  await note.waitFor();
  await Promise.all([page.waitForEvent("load"), page.getByRole("button", { name: "Reload" }).click()]);
  await page.locator("#start h2").waitFor();
  expect(await note.count()).toBe(0);
  await page.close();
});

test.each([
  [false, true],
  [true, false],
  [undefined, true],
])("if storage is persistent: %s, a note on lost steps is shown: %s", async (persisted, is_shown) => {
  const context = await served.browser.newContext({ viewport: PHONE });
  await context.addInitScript((persisted) => {
    const storage = persisted === undefined ? undefined : { persisted: async () => persisted };
    Object.defineProperty(Navigator.prototype, "storage", { get: () => storage });
  }, persisted);
  const page = await context.newPage();
  await page.goto(`${served.url}?bluetooth`);
  await page.locator("#start h2").waitFor();
  await show(page, "settings");
  expect(await page.getByText("This browser may delete your steps.").isVisible()).toBe(is_shown);
  await context.close();
});

test("the page works offline after one visit", async () => {
  const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
  await page.evaluate(async () => {
    await navigator.serviceWorker.ready;
    const { serviceWorker } = navigator;
    if (serviceWorker.controller) return;
    await new Promise((resolve) => serviceWorker.addEventListener("controllerchange", resolve, { once: true }));
  });
  await page.context().setOffline(true);
  await page.reload();
  await page.locator("#start h2").waitFor();
  // The identification is loaded only when it is needed, so its files must be among the stored ones.
  const stored = await page.evaluate(async () => {
    const names = await caches.keys();
    const requests = await Promise.all(names.map(async (name) => (await caches.open(name)).keys()));
    return requests.flat().map(({ url }) => url);
  });
  for (const file of [/identify_worker-.*\.js$/, /phone_identify-.*\.wasm$/]) {
    expect(stored.some((url) => file.test(url)), String(file)).toBe(true);
  }
  await page.close();
});

test("a recording that does not exist is reported", async () => {
  const context = await served.browser.newContext({ viewport: PHONE });
  const page = await context.newPage();
  await page.goto(`${served.url}?replay=nothing.plantar`);
  await page.getByText("The recording at nothing.plantar cannot be loaded (status 404).").waitFor();
  await context.close();
});

test("a page that cannot start reports it, and can be loaded again", async () => {
  const context = await served.browser.newContext({ viewport: PHONE });
  await context.route("**/phone_wire-*.wasm", (route) => route.fulfill({ status: 404 }));
  const page = await context.newPage();
  await page.goto(served.url);
  await page.getByText("The page could not start.").waitFor();
  await Promise.all([page.waitForEvent("load"), page.getByRole("button", { name: "Reload" }).click()]);
  await context.close();
});

test("an insole of another major version is reported, and its values are not shown", async () => {
  const bytes = readFileSync(join(DIST, "walk.plantar"));
  // The first entry is the hello of the left insole. The header of the entry (7 bytes) and the message number (1 byte) are
  // followed by the major version.
  bytes[7 + 1] = 99;
  const context = await served.browser.newContext({ viewport: PHONE });
  await context.route("**/other.plantar", (route) => route.fulfill({ body: bytes }));
  const page = await context.newPage();
  await page.goto(`${served.url}?replay=other.plantar`);
  await page.getByText(/This page is older than the firmware \d+\.\d+\.\d+ of the left insole/).waitFor();
  await page.waitForFunction(() => parseFloat(document.querySelectorAll("#totals dd")[1]?.textContent ?? "") > 100);
  expect(await page.locator("#totals dd").first().innerText()).toBe("–");
  await context.close();
});

test.each([195, 320, 390])("on a screen of %i px, everything is within reach, and only tables scroll sideways", async (width) => {
  const page = await open(served.browser, replay, { viewport: { width, height: 844 } });
  await waitForSteps(page, 3);
  for (const view of ["steps", "settings", "live"]) {
    await show(page, view);
    // After a whole day of walking, the table of days has long numbers.
    const widest = await page.evaluate(() => {
      document.querySelectorAll("#days td").forEach((cell) => (cell.textContent = "123456.7"));
      const elements = [...document.querySelectorAll("nav button, main :is(button, input, select, p, dl, table)")];
      const fixed = elements.filter((element) => !element.closest(".wide"));
      return Math.max(document.documentElement.scrollWidth, ...fixed.map((element) => element.getBoundingClientRect().right));
    });
    expect(widest, view).toBeLessThanOrEqual(width);
    await page.screenshot({ path: phonePath(`tests/screenshots/narrow-${width}-${view}.png`), fullPage: true });
  }
  await page.close();
});

test("an element that has the focus is not behind the bar at the bottom", async () => {
  const page = await open(served.browser, replay, { viewport: { width: 390, height: 500 } });
  await show(page, "settings");
  const bar = (await page.locator("nav").boundingBox())!;
  for (let i = 0; i < 12; i += 1) {
    await page.keyboard.press("Tab");
    const bottom = await page.evaluate(() => {
      const focused = document.activeElement!;
      return focused.closest("nav") || focused === document.body ? 0 : focused.getBoundingClientRect().bottom;
    });
    expect(bottom).toBeLessThanOrEqual(bar.y);
  }
  await page.close();
});

describe("without insoles", () => {
  test("in a browser without Bluetooth, the page recommends another browser, and plays the computed walk", async () => {
    const context = await served.browser.newContext({ viewport: PHONE });
    await context.addInitScript(() => Reflect.deleteProperty(Navigator.prototype, "bluetooth"));
    const page = await context.newPage();
    await page.goto(`${served.url}?bluetooth`);
    await page.locator("#unsupported").waitFor();
    expect(await page.locator("#connect").isDisabled()).toBe(true);
    await page.locator("#walk").click();
    await firstLoad_ms(page);
    await show(page, "settings");
    expect(await page.locator("#add-note").textContent()).toBe(await page.locator("#unsupported").textContent());
    await context.close();
  });

  test("without HTTPS, the page states what Bluetooth needs", async () => {
    const context = await served.browser.newContext({ viewport: PHONE });
    await context.addInitScript(() => {
      Reflect.deleteProperty(Navigator.prototype, "bluetooth");
      Object.defineProperty(window, "isSecureContext", { value: false });
    });
    const page = await context.newPage();
    await page.goto(`${served.url}?bluetooth`);
    const text = "Bluetooth works only over HTTPS or at localhost.";
    await page.locator("#unsupported", { hasText: text }).waitFor();
    expect(await page.locator("#add-note").textContent()).toBe(text);
    await context.close();
  });

  test("the wearer leaves the example walk, during which nothing can be deleted", async () => {
    const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
    await page.locator("#walk").click();
    await waitForSteps(page, 1);
    await show(page, "settings");
    expect(await page.locator("#clear").isDisabled()).toBe(true);
    await page.locator("#clear-note").waitFor();
    expect(await page.locator("#alerts-note").textContent()).toContain("This is a recording.");
    await page.getByRole("button", { name: "Leave the recording" }).click();
    await page.locator("#start h2").waitFor();
    await page.close();
  });

  test("an example walk that cannot be loaded is reported until it is loaded or the wearer closes the note", async () => {
    const context = await served.browser.newContext({ viewport: PHONE });
    const page = await context.newPage();
    let is_offline = true;
    await context.route("**/walk.plantar", (route) => (is_offline ? route.abort() : route.continue()));
    await page.goto(`${served.url}?bluetooth`);
    const note = page.getByText("The example walk could not be loaded.");
    await page.locator("#walk").click();
    await note.waitFor();
    await page.getByRole("button", { name: "Close this message" }).click();
    expect(await note.count()).toBe(0);
    await page.locator("#walk").click();
    await note.waitFor();
    is_offline = false;
    await page.locator("#walk").click();
    await firstLoad_ms(page);
    expect(await note.count()).toBe(0);
    await context.close();
  });

  test("without a body mass, the page asks for it to show forces in % of body weight", async () => {
    const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
    await show(page, "settings");
    await page.locator("#force-unit").selectOption("%BW");
    await page.locator("#force-unit-note", { hasText: "Enter your body mass." }).waitFor();
    await enter(page, "#mass", "80");
    expect(await page.locator("#force-unit-note").textContent()).toBe("");
    await page.close();
  });

  test("while an insole is connected over Bluetooth, neither Back nor pulling down ends the connection unasked", async () => {
    const page = await served.browser.newPage({ viewport: PHONE });
    await offerInsole(page);
    const dialogs: string[] = [];
    page.on("dialog", (dialog) => {
      dialogs.push(dialog.type());
      void dialog.dismiss();
    });
    await page.goto(`${served.url}?bluetooth`);
    await page.locator("#connect").click();
    expect(await has_focus(page, "#notes")).toBe(true);
    for (const view of ["steps", "settings"]) await show(page, view);
    // Back shows the live view, also from a view that was shown later.
    await page.evaluate(() => history.back());
    await page.locator("body[data-view=live]").waitFor();
    expect(await page.locator("nav [aria-current]").getAttribute("data-to")).toBe("live");
    expect(dialogs).toEqual([]);
    await page.evaluate(() => history.back());
    await expect.poll(() => dialogs).toEqual(["beforeunload"]);
    expect(await page.locator("body").getAttribute("data-view")).toBe("live");
    expect(await page.evaluate(() => getComputedStyle(document.documentElement).overscrollBehaviorY)).toBe("none");
    await page.close();
  });

  test("the guided session leads to the button that connects the insoles, and its errors come into view", async () => {
    const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
    await page.evaluate(() => {
      const bluetooth = { requestDevice: () => Promise.reject(new DOMException("", "SecurityError")) };
      Object.defineProperty(navigator, "bluetooth", { value: bluetooth });
    });
    await show(page, "settings");
    await page.locator("#identify-open").click();
    await page.locator("[data-action=connect]").click();
    const add = page.locator("#add");
    const isVisible = (selector: string) =>
      page.locator(selector).evaluate((element) => {
        const { top, bottom } = element.getBoundingClientRect();
        return top >= 0 && bottom <= document.querySelector("nav")!.getBoundingClientRect().top;
      });
    expect([await isVisible("#add"), await add.evaluate((element) => element === document.activeElement)]).toEqual([true, true]);
    await add.click();
    await page.getByText("Bluetooth is not allowed").waitFor();
    expect(await isVisible("#notes")).toBe(true);
    await page.close();
  });

  test("the page explains how to allow Bluetooth, by a remark if the wearer may have cancelled the choice", async () => {
    // Chrome reports a refused permission of Android and a cancelled choice by the second error, and so Bluetooth that a setting
    // of the site blocks, but then as not available.
    for (const [name, is_available, words, count] of [
      ["SecurityError", true, "Bluetooth is not allowed", 1],
      ["NotFoundError", true, "No insole was chosen.", 0],
      ["NotFoundError", false, "Bluetooth is off, or not allowed", 1],
    ] as const) {
      const context = await served.browser.newContext({ viewport: PHONE });
      await context.addInitScript(([name, is_available]) => {
        const requestDevice = () => Promise.reject(new DOMException("", name));
        const bluetooth = { requestDevice, getAvailability: async () => is_available };
        Object.defineProperty(Navigator.prototype, "bluetooth", { value: bluetooth });
      }, [name, is_available] as const);
      const page = await context.newPage();
      await page.goto(`${served.url}?bluetooth`);
      await page.locator("#connect").click();
      await page.waitForFunction((words) => document.querySelector("#notes")?.textContent?.includes(words), words);
      expect(await page.locator("#notes .note:not(.remark)").count()).toBe(count);
      await page.locator("#start h2").waitFor();
      await page.getByRole("button", { name: "Close this message" }).press("Enter");
      expect(await has_focus(page, "#notes")).toBe(true);
      await context.close();
    }
  });
});

describe.each([["phone", PHONE], ["desktop", DESKTOP]] as const)("%s", (size, viewport) => {
  test.each(["light", "dark"] as const)("%s: no serious accessibility violations", async (colorScheme) => {
    const page = await open(served.browser, replay, { viewport, colorScheme });
    await waitForSteps(page, 3);
    const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
    await page.evaluate(axe);
    for (const view of ["live", "steps", "settings"].filter((view) => size === "phone" || view !== "steps")) {
      await show(page, view);
      await page.screenshot({ path: phonePath(`tests/screenshots/${size}-${colorScheme}-${view}.png`) });
      const findings = await page.evaluate(async () => {
        const { axe } = window as unknown as { axe: typeof import("axe-core") };
        const { violations } = await axe.run();
        return violations.map(({ id, impact, nodes }) => ({ id, impact, at: nodes.map(({ html }) => html) }));
      });
      const serious = findings.filter(({ impact }) => impact === "serious" || impact === "critical");
      expect(serious, view).toEqual([]);
      expect(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "no sideways scrolling").toBe(true);
    }
    await page.close();
  });
});
