import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { DayTotals } from "../src/days";
import type { Gait } from "../src/generated/quantities";
import { loadSettings } from "../src/settings";
import type { StoredBout, StoredStep } from "../src/step_store";
import { drawBouts, drawDays, drawSteps } from "../src/steps_view";
import { element } from "./elements";
import { step } from "./wire";

vi.mock("../src/dom", async () => (await import("./elements")).dom);

const SETTINGS = loadSettings(() => ({ getItem: () => null }) as unknown as Storage);
const NONE = { left: 0, right: 0 };
const GAIT = {
  has_both_feet: false, strides: NONE, gaps: NONE, unpaired: NONE, cadence_per_min: null, speed_m_s: null, measures: [],
} as Gait;
const STEPS: StoredStep[] = [{ step: step({ side: "left" }), start_unix_s: null }];

beforeEach(() => {
  vi.stubGlobal("document", {});
  vi.stubGlobal("getComputedStyle", () => ({ fontSize: "16px" }));
  // The parts of each table have an identifier of their own here.
  for (const id of ["both-feet", "table", "days", "bouts"]) element(id).querySelector = ((name: string) => `${id} ${name}`) as never;
});
afterEach(() => void vi.unstubAllGlobals());

test("the steps of a recording are called neither those of today nor stored", () => {
  drawSteps(STEPS, [1, 0], 12, GAIT, SETTINGS);
  expect(element("measures").content).toMatch(/Steps today.*left 1, right 0; 12 stored in all/);
  drawSteps(STEPS, [1, 0], undefined, GAIT, SETTINGS);
  expect(element("measures").content).toMatch(/Steps so far.*left 1, right 0"/);
  expect(element("measures").content).not.toMatch(/today|stored/);
});

test("without measures, the reason is shown instead of an empty table", () => {
  drawSteps(STEPS, [1, 0], 1, GAIT, SETTINGS);
  expect([element("both-feet").hidden, element("both-feet-help").hidden]).toEqual([true, true]);
  expect(element("both-feet-note").content).toMatch(/^\["The feet are not compared, because there are no steps of the right foot\. Strides/);
  const estimate = { count: 3, mean: 0.7, low: null, high: null };
  const measure = { key: "stance_time_s", title: "Stance", unit: "s", digits: 2, left: estimate, right: null, symmetry_percent: null };
  drawSteps(STEPS, [1, 0], 1, { ...GAIT, measures: [measure] } as Gait, SETTINGS);
  expect([element("both-feet").hidden, element("both-feet-help").hidden]).toEqual([false, false]);
});

test("flight is shown only if there is any, on one foot or both", () => {
  const measure = (key: string, left: number | null, right: number | null) => {
    const [of_left, of_right] = [left, right].map((mean) => mean !== null && { count: 3, mean, low: null, high: null });
    return { key, title: key, unit: "s", digits: 2, left: of_left || null, right: of_right || null, symmetry_percent: null };
  };
  const shown = (left: number | null, right: number | null) => {
    const measures = [measure("stance_time_s", 0.3, 0.3), measure("flight_s", left, right)];
    drawSteps(STEPS, [1, 0], 1, { ...GAIT, measures } as Gait, SETTINGS);
    return element("both-feet tbody").content.includes("flight_s");
  };
  expect([shown(0, 0), shown(0, null), shown(null, null)]).toEqual([false, false, false]);
  expect([shown(0.05, 0), shown(null, 0.05)]).toEqual([true, true]);
});

test("the duration of a short load bout is not rounded to zero, and a day of standing has no peak", () => {
  const bout = (duration_s: number) =>
    ({ bout: { side: "left", kind: "shuffling", duration_s, regions: {} }, start_unix_s: null }) as unknown as StoredBout;
  drawBouts([bout(0.4)]);
  expect(element("bouts tbody").content).toContain('"0.4"');
  drawBouts([bout(12.4)]);
  expect(element("bouts tbody").content).toContain('"12"');
  const standing = { steps: 0, bouts: 3, alerts: 0, integral_n_s: 5000, peak_n: 0 };
  const walking = { steps: 20, bouts: 0, alerts: 0, integral_n_s: 9000, peak_n: 800 };
  drawDays([{ day: "2026-01-01", left: standing, right: walking } as DayTotals], false, SETTINGS);
  const cells = JSON.parse(element("days tbody").content)[0].slice(3).map(([, , text]: string[]) => text);
  expect(cells).toEqual(["0", "20", "5.0", "9.0", "–", "800"]);
});
