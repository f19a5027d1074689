/** Measures of a walk. The core of the page computes them from the steps of both feet. */

import type { Gait, Side } from "./generated/quantities";
import { type Settings } from "./settings";
import { SIDES } from "./side";
import type { StoredBout, StoredStep } from "./step_store";
import type { Wire } from "./wire";

/** The measures are computed from this number of the last steps of each foot. */
export const LATEST = 100;

/** The steps of one foot. */
export const stepsOf = (steps: readonly StoredStep[], side: Side) => steps.filter(({ step }) => step.side === side);

/** The measures of both feet. The feet are compared only if the times of all steps are on the clock of the browser. */
export function gaitOf(wire: Wire, steps: readonly StoredStep[], bouts: readonly StoredBout[], settings: Settings): Gait {
  const feet = SIDES.map((side) => stepsOf(steps, side).slice(-LATEST));
  const has_common_clock = feet.flat().every(({ start_unix_s }) => start_unix_s !== null);
  const start_s = ({ step, start_unix_s }: StoredStep) => (has_common_clock ? (start_unix_s ?? 0) : step.start_s);
  const stride_m = (settings.stride_cm ?? 0) / 100;
  // Steps and load bouts are counted together. Successive steps have successive numbers without the bouts between them.
  const number = ({ step }: StoredStep) =>
    step.step - bouts.filter(({ bout }) => bout.side === step.side && bout.number < step.step).length;
  const timed = (stored: StoredStep) => ({ ...stored, number: number(stored), start_s: start_s(stored) });
  return wire.gait(feet.map((steps) => steps.map(timed)), has_common_clock, stride_m);
}
