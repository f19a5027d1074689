/** The steps view: measures of the walk, the trend of the peak force, and the table of steps. */

import { type Node, byId, fill } from "./dom";
import { forceText, numberText, unitOf } from "./format";
import type { Side, Step } from "./generated/quantities";
import { type Settings, percentOfWeight } from "./settings";
import { SIDES, sideTitle } from "./side";
import type { StoredBout, StoredStep } from "./step_store";
import { cadence_per_min, footMeasures, impulse_n_s, stepsOf, symmetryIndex } from "./walk";

/** Number of steps of each foot in the diagram. */
const TREND_STEPS = 60;
/** Largest number of rows in the table. */
const ROWS = 200;

/** Shows the steps. To be called after each change of the steps or of the settings. */
export function drawSteps(steps: readonly StoredStep[], settings: Settings): void {
  const is_empty = steps.length === 0;
  byId("no-steps").hidden = !is_empty;
  for (const id of ["measures", "symmetry", "trend", "table"]) byId(id).hidden = is_empty;
  if (is_empty) return;
  const both = { left: footMeasures(steps, "left"), right: footMeasures(steps, "right") };

  fill("measures", [
    card("Cadence", numberText(cadence_per_min(steps), 0), "steps per minute"),
    card("Steps", String(steps.length), `left ${both.left.count}, right ${both.right.count}`),
  ]);

  const force = (value: number | null) => (value === null ? "–" : forceText(value, settings, "")[0]);
  const row = (name: string, of: (side: Side) => number | null, text: (value: number | null) => string): Node => [
    "tr",
    {},
    ["th", { scope: "row" }, name],
    ...SIDES.map((side): Node => ["td", {}, text(of(side))]),
    ["td", {}, numberText(symmetryIndex(of("left"), of("right")), 1, "%")],
  ];
  fill(byId("symmetry").querySelector("tbody"), [
    row(`Peak force, ${unitOf(settings)}`, (side) => both[side].peak_n, force),
    row("Contact time, s", (side) => both[side].contact_s, (value) => numberText(value, 2)),
    row("Force × time, N s", (side) => both[side].impulse_n_s, (value) => numberText(value, 0)),
  ]);
  fill("trend", trend(steps, settings));

  const head = ["Foot", "Step", "Contact, s", "Peak, N", "Peak, %BW", "Force × time, N s"];
  fill(byId("table").querySelector("thead"), [["tr", {}, ...head.map((name): Node => ["th", { scope: "col" }, name])]]);
  const rows = steps.slice(-ROWS).reverse();
  fill(byId("table").querySelector("tbody"), rows.map(({ step }): Node => [
    "tr",
    {},
    ["td", { class: step.side }, sideTitle(step.side)],
    ["td", {}, String(step.step)],
    ["td", {}, step.duration_s.toFixed(2)],
    ["td", {}, `${hasMaskedCells(step) ? "~ " : ""}${step.foot.foot_force_peak_n.toFixed(0)}`],
    ["td", {}, numberText(percentOfWeight(step.foot.foot_force_peak_n, settings), 0)],
    ["td", {}, impulse_n_s(step).toFixed(0)],
  ]));
}

/** Number of load bouts in the table. */
const BOUT_ROWS = 50;

/** Shows the load bouts. To be called after each change of them. */
export function drawBouts(bouts: readonly StoredBout[]): void {
  byId("bouts").hidden = bouts.length === 0;
  fill(byId("bouts").querySelector("tbody"), bouts.slice(-BOUT_ROWS).reverse().map(({ bout, start_unix_s }): Node => {
    const integral_n_s = Object.values(bout.regions).reduce((sum, region) => sum + region.measured_force_integral_n_s, 0);
    const start = start_unix_s === null ? "–" : new Date(start_unix_s * 1000).toLocaleTimeString();
    return [
      "tr",
      {},
      ["td", { class: bout.side }, sideTitle(bout.side)],
      ["td", {}, start],
      ["td", {}, bout.kind],
      ["td", {}, bout.duration_s.toFixed(0)],
      ["td", {}, integral_n_s.toFixed(0)],
    ];
  }));
}

/** True if cells were masked in any region of the step. */
const hasMaskedCells = (step: Step) => Object.values(step.regions).some(({ masked_cells }) => masked_cells > 0);

/** A measure of the walk: its name, its value, and a detail below the value. */
function card(name: string, value: string, detail: string): Node {
  return ["div", {}, ["dt", {}, name], ["dd", {}, value, ["small", {}, detail]]];
}

/** A diagram of the peak force of the last steps of each foot. */
function trend(steps: readonly StoredStep[], settings: Settings): Node[] {
  const [width, height, left, bottom] = [360, 150, 40, 22];
  const series = SIDES.map((side) => ({
    side,
    values: stepsOf(steps, side)
      .slice(-TREND_STEPS)
      .map(({ step }) => Number(forceText(step.foot.foot_force_peak_n, settings, "")[0])),
  })).filter(({ values }) => values.length > 0);
  if (series.length === 0) return [];
  const all = series.flatMap(({ values }) => values);
  const step = 10 ** Math.floor(Math.log10(Math.max(...all))) / 2;
  const low = Math.floor((Math.min(...all) * 0.95) / step) * step;
  const high = Math.ceil((Math.max(...all) * 1.01) / step) * step;
  const longest = Math.max(2, ...series.map(({ values }) => values.length));
  // The last step of each foot is at the right end.
  const x = (i: number, count: number) => left + ((longest - count + i) / (longest - 1)) * (width - left - 8);
  const y = (value: number) => 8 + ((high - value) / (high - low)) * (height - bottom - 8);
  const unit = unitOf(settings);
  return [
    [
      "svg",
      { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Peak force of the last steps, ${unit}` },
      ...[low, (low + high) / 2, high].flatMap((value): Node[] => [
        ["path", { class: "grid", d: `M${left} ${y(value)}H${width}` }],
        ["text", { x: String(left - 6), y: String(y(value) + 4), "text-anchor": "end" }, String(Math.round(value))],
      ]),
      ["text", { x: String(width - 4), y: String(height - 4), "text-anchor": "end" }, "last step"],
      ...series.flatMap(({ side, values }): Node[] => {
        const points = values.map((value, i) => `${x(i, values.length).toFixed(1)} ${y(value).toFixed(1)}`);
        // Circles for left and squares for right, so that colour is not the only difference.
        const mark = (at: string) => (side === "left" ? `M${at}m-3 0a3 3 0 1 0 6 0a3 3 0 1 0-6 0` : `M${at}m-3-3h6v6h-6z`);
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
