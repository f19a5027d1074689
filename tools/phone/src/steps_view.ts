/** The steps view: measures of the walk, the trend of the peak force, and the table of steps. */

import { type DayTotals, type FootTotals, boutIntegral_n_s, isToday } from "./days";
import { type Node, byId, fill } from "./dom";
import { dateText, forceText, numberText, signedText, timeText, unitOf } from "./format";
import type { Estimate, Gait, GaitMeasure, Step } from "./generated/quantities";
import { type Settings, percentOfWeight } from "./settings";
import { SIDES, sideTitle } from "./side";
import { type StoredBout, type StoredStep, newestFirst } from "./step_store";
import { LATEST_STEPS, stepsOf, whyNotCompared } from "./walk";

/** Largest number of steps of each foot in the diagram. */
const TREND_STEPS = 60;
/** Largest number of rows in the table. */
const ROWS = 200;

/** Measures of both feet that the table omits, because they follow from others. */
const OMITTED = ["swing_percent", "first_double_support_s", "single_support_percent"];

/**
 * Shows the last steps. `today` contains the numbers of steps of the left and of the right foot today, and `count` is the number
 * of all stored steps; for a recording, `today` contains all its steps, and `count` is `undefined`. To be called after each
 * change of the steps or of the settings, and of the day.
 */
export function drawSteps(
  steps: readonly StoredStep[],
  today: readonly number[],
  count: number | undefined,
  gait: Gait,
  settings: Settings,
): void {
  const is_empty = steps.length === 0;
  byId("no-steps").hidden = !is_empty;
  for (const id of ["measures-of-steps", "table"]) byId(id).hidden = is_empty;
  if (is_empty) return;
  const newest_unix_s = Math.max(...steps.map(({ start_unix_s }) => start_unix_s ?? -Infinity));
  const is_old = Number.isFinite(newest_unix_s) && !isToday(newest_unix_s);
  fill("steps-date", is_old ? [`These values are of ${timeText(newest_unix_s)} and before.`] : []);
  const speed = gait.speed_m_s === null ? [] : [card("Walking speed", numberText(gait.speed_m_s, 2), "m/s, from your stride length")];
  const [left = 0, right = 0] = today;
  fill("measures", [
    card("Cadence", numberText(gait.cadence_per_min?.mean ?? null, 0), "steps per minute"),
    card(
      count === undefined ? "Steps so far" : "Steps today",
      String(left + right),
      `left ${left}, right ${right}${count === undefined ? "" : `; ${count} stored in all`}`,
    ),
    ...speed,
  ]);
  drawGait(gait, settings, gait.has_both_feet ? "" : `${whyNotCompared(steps)} `);
  fill("trend", trend(steps, settings));

  const head = ["Foot", "Time", "Contact, s", `Peak, ${unitOf(settings)}`, "Force × time, N s"];
  fill(byId("table").querySelector("thead"), [["tr", {}, ...head.map((name): Node => ["th", { scope: "col" }, name])]]);
  const rows = newestFirst(steps).slice(0, ROWS);
  fill(byId("table").querySelector("tbody"), rows.map(({ step, start_unix_s }): Node => [
    "tr",
    {},
    ["td", { class: step.side }, sideTitle(step.side)],
    ["td", {}, timeText(start_unix_s)],
    ["td", {}, step.duration_s.toFixed(2)],
    ["td", {}, `${hasMaskedCells(step) ? "~ " : ""}${forceText(step.foot.foot_force_peak_n, settings, "")[0]}`],
    ["td", {}, step.foot.foot_force_integral_n_s.toFixed(0)],
  ]));
}

/** Largest number of days in the table until the wearer asks for all of them. */
const DAY_ROWS = 31;

/** Shows the totals of the last days, or of all. To be called after each change of the records or of the settings. */
export function drawDays(days: readonly DayTotals[], shows_all: boolean, settings: Settings): void {
  byId("days").hidden = days.length === 0;
  byId("days-all").hidden = shows_all || days.length <= DAY_ROWS;
  fill(byId("days-all"), [`Show all ${days.length} days`]);
  const unit = unitOf(settings);
  fill(byId("days-peak"), [`Highest peak, ${unit}`]);
  // The days are sorted, because a stored step can arrive after a step of a later day.
  const latest = [...days].sort((a, b) => b.day.localeCompare(a.day)).slice(0, shows_all ? undefined : DAY_ROWS);
  fill(byId("days").querySelector("tbody"), latest.map((totals): Node => {
    const cells = (text: (foot: FootTotals) => string) => SIDES.map((side): Node => {
      const foot = totals[side];
      return ["td", {}, foot.steps || foot.bouts || foot.alerts ? text(foot) : "–"];
    });
    return [
      "tr",
      {},
      ["th", { scope: "row" }, dateText(totals.day)],
      ...cells(({ steps }) => String(steps)),
      ...cells(({ integral_n_s }) => (integral_n_s / 1000).toFixed(1)),
      // Load outside steps, as in standing, has no peak.
      ...cells(({ steps, peak_n }) => (steps ? forceText(peak_n, settings, "")[0] : "–")),
    ];
  }));
}

/** Largest number of load bouts in the table. */
const BOUT_ROWS = 50;

/** Shows the load bouts. To be called after each change of them. */
export function drawBouts(bouts: readonly StoredBout[]): void {
  byId("bouts").hidden = bouts.length === 0;
  fill(byId("bouts").querySelector("tbody"), newestFirst(bouts).slice(0, BOUT_ROWS).map(({ bout, start_unix_s }): Node => [
    "tr",
    {},
    ["td", { class: bout.side }, sideTitle(bout.side)],
    ["td", {}, timeText(start_unix_s)],
    ["td", {}, bout.kind === "unclassified" ? "other" : bout.kind],
    // Some bouts last for a fraction of a second.
    ["td", {}, bout.duration_s.toFixed(bout.duration_s < 10 ? 1 : 0)],
    ["td", {}, boutIntegral_n_s(bout).toFixed(0)],
  ]));
}

/** Shows the measures of both feet, with the intervals of the means, and why the feet are not compared. */
function drawGait(gait: Gait, settings: Settings, why: string): void {
  const value = (estimate: Estimate | null, digits: number, scale: number): Node => {
    if (!estimate) return ["td", {}, "–"];
    const text = (value: number | null) => (value === null ? "–" : signedText(scale * value, digits));
    const interval = estimate.low === null ? "" : `${text(estimate.low)} to ${text(estimate.high)}`;
    return ["td", {}, text(estimate.mean), ["small", {}, interval]];
  };
  const row = ({ key, title, unit, digits, left, right, symmetry_percent }: GaitMeasure): Node => {
    const is_force = key === "peak_force_n";
    const scale = (is_force && unitOf(settings) === "%BW" && percentOfWeight(1, settings)) || 1;
    const name = `${title}, ${is_force ? unitOf(settings) : unit}`;
    const feet = [left, right].map((estimate) => value(estimate, digits, scale));
    return ["tr", {}, ["th", { scope: "row" }, name], ...feet, value(symmetry_percent, 1, 1)];
  };
  // Walking has no flight.
  const isShown = ({ key, left, right }: GaitMeasure) =>
    (left || right) && !OMITTED.includes(key) && (key !== "flight_s" || left?.mean || right?.mean);
  const measures = gait.measures.filter(isShown);
  for (const id of ["both-feet", "both-feet-help"]) byId(id).hidden = measures.length === 0;
  fill(byId("both-feet").querySelector("tbody"), measures.map(row));
  const { strides, gaps, unpaired } = gait;
  const both = ({ left, right }: { left: number; right: number }) => `${left} left, ${right} right`;
  fill("both-feet-note", [
    `${why}Strides in use: ${both(strides)}, of the last ${LATEST_STEPS} steps of each foot. Not used, because of a pause ` +
      `or a missing step: ${both(gaps)}; without exactly one step of the other foot from 15 to 85 % of the stride: ` +
      `${both(unpaired)}.`,
  ]);
}

/** True if cells were masked in any region of the step. */
const hasMaskedCells = (step: Step) => Object.values(step.regions).some(({ masked_cells }) => masked_cells > 0);

/** A card with a measure of the walk: its name, its value, and a detail below the value. */
function card(name: string, value: string, detail: string): Node {
  return ["div", {}, ["dt", {}, name], ["dd", {}, value, ["small", {}, detail]]];
}

/** A diagram of the peak force of the last steps of each foot. */
function trend(steps: readonly StoredStep[], settings: Settings): Node[] {
  // One unit is one CSS pixel, so that the texts have the size of `font-size`. The margins follow the browser's size of texts.
  const em = 0.75 * parseFloat(getComputedStyle(document.documentElement).fontSize);
  const width = byId("trend").clientWidth || 360;
  const [height, left, top, bottom] = [12 * em, 3.2 * em, 0.7 * em, 1.8 * em];
  const series = SIDES.map((side) => ({
    side,
    values: stepsOf(steps, side)
      .slice(-TREND_STEPS)
      .map(({ step }) => Number(forceText(step.foot.foot_force_peak_n, settings, "")[0])),
  })).filter(({ values }) => values.length > 0);
  if (series.length === 0) return [];
  const all = series.flatMap(({ values }) => values);
  // The ends of the scale are multiples of this value. All values can be 0, because they are rounded.
  const multiple = 10 ** Math.floor(Math.log10(Math.max(1, ...all))) / 2;
  const low = Math.floor((Math.min(...all) * 0.95) / multiple) * multiple;
  const high = Math.max(Math.ceil((Math.max(...all) * 1.01) / multiple) * multiple, low + 2);
  const longest = Math.max(2, ...series.map(({ values }) => values.length));
  // The last step of each foot is at the right end.
  const x = (i: number, count: number) => left + ((longest - count + i) / (longest - 1)) * (width - left - 8);
  const y = (value: number) => top + ((high - value) / (high - low)) * (height - bottom - top);
  const unit = unitOf(settings);
  return [
    [
      "svg",
      { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Peak force of the last steps, ${unit}` },
      ...[low, (low + high) / 2, high].flatMap((value): Node[] => [
        ["path", { class: "grid", d: `M${left} ${y(value)}H${width}` }],
        ["text", { x: String(left - 6), y: String(y(value) + em / 3), "text-anchor": "end" }, String(Math.round(value))],
      ]),
      ["text", { x: String(width - 4), y: String(height - em / 3), "text-anchor": "end" }, "last step"],
      ...series.flatMap(({ side, values }): Node[] => {
        const points = values.map((value, i) => `${x(i, values.length).toFixed(1)} ${y(value).toFixed(1)}`);
        // Circles for left and squares for right, so that colour is not the only difference.
        const mark = (point: string) =>
          side === "left" ? `M${point}m-3 0a3 3 0 1 0 6 0a3 3 0 1 0-6 0` : `M${point}m-3-3h6v6h-6z`;
        const colour = `var(--${side})`;
        return [
          ["path", { class: "trace", stroke: colour, d: `M${points.join("L")}` }],
          ["path", { fill: colour, d: points.map(mark).join("") }],
        ];
      }),
    ],
    [
      "figcaption",
      {},
      `Peak force of each step, ${unit}: `,
      ...series.flatMap(({ side }): Node[] => [["strong", { class: side }, side === "left" ? "● left " : "■ right "]]),
    ],
  ];
}
