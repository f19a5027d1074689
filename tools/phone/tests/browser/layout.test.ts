/**
 * The emulator runs the firmware with a recording, and the page draws the contact ellipses within the outline of the insole's own
 * cells.
 *
 * The environment variable `PLANTAR` is the path of the command line, and `PLANTAR_FIRMWARE` is the path of the firmware of the
 * emulated board. `PLANTAR_RECORDINGS` is the folder with recordings of people that are not public; without it, only the computed
 * walk is shown. `cargo xtask test` sets them.
 */

import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { launch, phonePath, servePlantar } from "./browser";

const { PLANTAR: plantar, PLANTAR_FIRMWARE: firmware, PLANTAR_RECORDINGS: recordings } = process.env;
if (!plantar || !firmware) console.log("skipped: set PLANTAR and PLANTAR_FIRMWARE (`cargo xtask test` does)");
const is_skipped = !plantar || !firmware;

let browser: Browser;
const temporary = mkdtempSync(join(tmpdir(), "plantar-"));
beforeAll(async () => {
  browser = await launch();
});
afterAll(async () => {
  await browser.close();
  rmSync(temporary, { recursive: true });
});

/** The shapes that the page has drawn on its canvas, in foot coordinates. */
interface Drawn {
  /** The outlines of soles, each once. */
  outlines: Path2D[];
  /** The centres of the ellipses, each with the outline that it was clipped by. */
  ellipses: { at: [number, number]; clip: Path2D | undefined }[];
}
declare global {
  interface Window {
    drawn: Drawn;
  }
}

/** Records the outlines and ellipses that the page draws from now on. */
const observe = (page: Page) =>
  page.addInitScript(() => {
    window.drawn = { outlines: [], ellipses: [] };
    const canvas = CanvasRenderingContext2D.prototype;
    const { clip, stroke, ellipse } = canvas;
    let clipped: Path2D | undefined;
    canvas.clip = function (...path: unknown[]) {
      clipped = path[0] as Path2D | undefined;
      Reflect.apply(clip, this, path);
    };
    canvas.stroke = function (...paths: [] | [Path2D]) {
      for (const path of paths) if (!window.drawn.outlines.includes(path)) window.drawn.outlines.push(path);
      Reflect.apply(stroke, this, paths);
    };
    canvas.ellipse = function (this: CanvasRenderingContext2D, ...values: Parameters<typeof ellipse>) {
      window.drawn.ellipses.push({ at: [values[0], values[1]], clip: clipped });
      ellipse.apply(this, values);
    };
  });

/** The number of `points` that lie outside of the outline that was drawn last. */
const outside = (page: Page, points: readonly (readonly [number, number])[]) =>
  page.evaluate((points) => {
    const context = document.createElement("canvas").getContext("2d")!;
    const outline = window.drawn.outlines.at(-1)!;
    return points.filter(([x, y]) => !context.isPointInPath(outline, x, y)).length;
  }, points);

/**
 * Serves the recording, and asserts that the page draws ellipses within the outline of the insole's cells, and that this
 * outline contains the points `cells`. Stores a screenshot with the file name `picture`.
 */
async function expectDrawn(recording: string, picture: string, cells: readonly (readonly [number, number])[]): Promise<void> {
  const { url, end } = await servePlantar(plantar!, ["--emulate", recording, "--firmware", firmware!]);
  try {
    const context = await browser.newContext({ viewport: { width: 390, height: 844 } });
    const page = await context.newPage();
    await observe(page);
    await page.goto(url);
    // The generic sole of both feet is drawn until the cells of the insole have arrived.
    await page.waitForFunction(() => window.drawn.outlines.length >= 2, undefined, { timeout: 60_000 });
    await page.evaluate(() => (window.drawn.ellipses.length = 0));
    await page.waitForFunction(() => window.drawn.ellipses.length > 500, undefined, { timeout: 60_000 });
    expect(await outside(page, cells)).toBe(0);
    const ellipses = await page.evaluate(() => {
      const outline = window.drawn.outlines.at(-1);
      return window.drawn.ellipses.map(({ at, clip }) => ({ at, is_clipped: clip === outline }));
    });
    expect(ellipses.every(({ is_clipped }) => is_clipped)).toBe(true);
    expect(await outside(page, ellipses.map(({ at }) => at))).toBe(0);
    expect(new Set(ellipses.map(({ at }) => at.join())).size).toBeGreaterThan(50);
    await page.locator("#soles").screenshot({ path: phonePath(`tests/screenshots/${picture}`) });
    await context.close();
  } finally {
    await end();
  }
}

/** The centres of the sensors of a pedar insole in foot coordinates, from the corners in its file. */
function pedarCentres(file: string, side: string): [number, number][] {
  const rows = readFileSync(file, "utf8").trim().split(/\r?\n/).slice(1).map((row) => row.split(","));
  const sensors = rows.filter(([foot]) => foot?.trim().toLowerCase() === side).map((row) => row.slice(3).map(Number));
  const mean = (values: number[]) => values.reduce((sum, value) => sum + value, 0) / values.length;
  const of = (corners: number[], axis: number) => corners.filter((_, i) => i % 2 === axis);
  // Foot coordinates begin at the back of the heel and at the medial edge.
  const from = [0, 1].map((axis) => Math.min(...sensors.flatMap((corners) => of(corners, axis))));
  return sensors.map((corners) => [0, 1].map((axis) => mean(of(corners, axis)) - from[axis]!) as [number, number]);
}

test.skipIf(is_skipped || !recordings)("a pedar insole is drawn with an outline that contains its sensors", async () => {
  const pedar = join(recordings!, "pedar");
  const [walk, geometry] = [join(temporary, "pedar.parquet"), join(pedar, "geometry.csv")];
  const files = [join(pedar, "pedar_example.asc"), "--geometry", geometry];
  const made = spawnSync(plantar!, ["import", "pedar", ...files, "--side", "right", "--out", walk]);
  expect(made.status, made.stderr.toString()).toBe(0);
  await expectDrawn(walk, "pedar.png", pedarCentres(geometry, "right"));
}, 120_000);

test.skipIf(is_skipped)("a computed insole is drawn with its ellipses", async () => {
  const walk = join(temporary, "walk.parquet");
  const made = spawnSync(plantar!, ["import", "synthetic", "--side", "left", "--steps", "3", "--out", walk]);
  expect(made.status, made.stderr.toString()).toBe(0);
  await expectDrawn(walk, "computed.png", []);
}, 120_000);
