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
 * The measures of both feet. The feet are compared only if the times of all steps are on the clock of the browser. If the steps
 * of one foot are all earlier than those of the other one, only the foot that walked last is measured.
 */
export function gaitOf(wire: Wire, { steps, bouts, alerts }: Pick<Records, "steps" | "bouts" | "alerts">, settings: Settings): Gait {
  const feet = SIDES.map((side) => stepsOf(steps, side).slice(-LATEST_STEPS));
  const has_common_clock = feet.flat().every(({ start_unix_s }) => start_unix_s !== null);
  const start_s = ({ step, start_unix_s }: StoredStep) => (has_common_clock ? (start_unix_s ?? 0) : step.start_s);
  const stride_m = (settings.stride_cm ?? 0) / 100;
  // An insole numbers steps, load bouts and alerts together. Here, the steps are numbered alone, so a gap is a missing step.
  const others = [...bouts.map(({ bout }) => bout), ...alerts.map(({ alert }) => alert)];
  const number = ({ step }: StoredStep) =>
    step.step - others.filter((other) => other.side === step.side && other.number < step.step).length;
  const timed = (stored: StoredStep) => ({ ...stored, number: number(stored), start_s: start_s(stored) });
  const first_s = feet.map((steps) => Math.min(...steps.map(start_s)));
  const last_s = feet.map((steps) => Math.max(...steps.map(start_s)));
  const is_apart = has_common_clock && Math.max(...first_s) > Math.min(...last_s);
  // With the steps of another day, no stride of this foot would contain a step of the other one.
  const measured = feet.map((steps, i) => (is_apart && last_s[i] !== Math.max(...last_s) ? [] : steps));
  return wire.gait(measured.map((steps) => steps.map(timed)), has_common_clock, stride_m);
}
