/** Measures of a walk. The WebAssembly module (`Wire`) computes them from the steps of both feet. */

import type { Gait, Side } from "./generated/quantities";
import { type Settings } from "./settings";
import { SIDES } from "./side";
import type { Records, StoredStep } from "./step_store";
import type { Wire } from "./wire";

/** The measures are computed from this number of the last steps of each foot. */
export const LATEST_STEPS = 100;

/** The steps of one foot. */
export const stepsOf = (steps: readonly StoredStep[], side: Side) => steps.filter(({ step }) => step.side === side);

/**
 * The steps of a foot with times on one clock, as in `plantar gait`: those with a time on the clock of the browser, or if none
 * has one, those of the newest boot of the insole, because its clock begins with each boot.
 */
function onOneClock(steps: readonly StoredStep[]): StoredStep[] {
  const timed = steps.filter(({ start_unix_s }) => start_unix_s !== null);
  if (timed.length > 0) return timed;
  const newest = Math.min(...steps.map(({ step }) => step.boots_since));
  return steps.filter(({ step }) => step.boots_since === newest);
}

/** The last steps of each foot, with times on one clock. */
const latestOf = (steps: readonly StoredStep[]) => SIDES.map((side) => onOneClock(stepsOf(steps, side)).slice(-LATEST_STEPS));

/** With fewer steps of a foot, their number is named as the reason why the feet are not compared. */
const FEW_STEPS = 10;

/** The reason why {@link gaitOf} does not compare the feet in these steps, as a sentence. */
export function whyNotCompared(steps: readonly StoredStep[]): string {
  const latest = latestOf(steps);
  const missing = SIDES.find((_, i) => latest[i]!.length === 0);
  if (missing) return `The feet are not compared, because there are no steps of the ${missing} foot.`;
  if (latest.some(({ length }) => length < FEW_STEPS)) {
    return "The feet are not compared yet, because there are too few steps so far.";
  }
  const times = latest.map((steps) => steps.flatMap(({ start_unix_s }) => start_unix_s ?? []));
  const [first_s, last_s] = [times.map((times) => Math.min(...times)), times.map((times) => Math.max(...times))];
  return times.every(({ length }) => length > 0) && Math.max(...first_s) > Math.min(...last_s)
    ? "The feet are not compared, because they walked at different times."
    : "The feet are not compared, because too few steps have exact times: steps that an insole stored while it was not connected " +
        "have inexact ones.";
}

/**
 * The measures of both feet. Steps of a foot that cannot be compared in time with its other ones are not used. The feet are
 * compared if the newest step of each foot has an exact time, and enough of all its steps have one
 * ({@link Wire.areFeetComparable}); then only steps with exact times are used. If the steps of one foot are all earlier than
 * those of the other one, only the foot that walked last is measured.
 */
export function gaitOf(wire: Wire, { steps, bouts, alerts }: Pick<Records, "steps" | "bouts" | "alerts">, settings: Settings): Gait {
  const latest = latestOf(steps);
  const exact = latest.map((steps) => steps.filter(({ is_comparable }) => is_comparable));
  const has_common_clock = latest.every(
    (steps, i) => steps.at(-1)?.is_comparable && wire.areFeetComparable(exact[i]!.length, steps.length),
  );
  const feet = has_common_clock ? exact : latest;
  const are_timed = feet.map((steps) => steps.every(({ start_unix_s }) => start_unix_s !== null));
  // The times of a foot are all on the clock of the browser, or all on that of its insole.
  const start_s = ({ step, start_unix_s }: StoredStep) => start_unix_s ?? step.start_s;
  const stride_m = (settings.stride_cm ?? 0) / 100;
  const first_s = feet.map((steps) => Math.min(...steps.map(start_s)));
  const last_s = feet.map((steps) => Math.max(...steps.map(start_s)));
  // An insole numbers steps, load bouts and alerts together. Here, the steps are numbered alone, so a gap is a missing step.
  // Records from before these steps are not counted: they may be of another insole, which had numbers of its own.
  const records = [
    ...bouts.map(({ bout, start_unix_s }) => ({ ...bout, start_unix_s })),
    ...alerts.map(({ alert, start_unix_s }) => ({ ...alert, start_unix_s })),
  ];
  const others = SIDES.map((side, i) => {
    const begin_s = are_timed[i] ? first_s[i]! : -Infinity;
    return records.filter((record) => record.side === side && (record.start_unix_s ?? Infinity) >= begin_s);
  });
  const numbered = (stored: StoredStep, i: number) => {
    const before = others[i]!.filter(({ number }) => number < stored.step.step);
    return { ...stored, number: stored.step.step - before.length, start_s: start_s(stored) };
  };
  const is_apart = are_timed.every(Boolean) && Math.max(...first_s) > Math.min(...last_s);
  // With older steps of the other foot, no stride of the foot that walked last would contain one of them, and `wire.gait` would
  // omit all of its strides as unpaired.
  const measured = feet.map((steps, i) => (is_apart && last_s[i] !== Math.max(...last_s) ? [] : steps));
  return wire.gait(measured.map((steps, i) => steps.map((step) => numbered(step, i))), has_common_clock, stride_m);
}
