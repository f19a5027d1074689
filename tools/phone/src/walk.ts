/** Measures of a walk, computed from its steps. */

import type { Side, Step } from "./generated/quantities";
import { SIDES } from "./side";
import type { StoredStep } from "./step_store";

/** Longest duration of a stride. If the time between two steps of one foot is longer, the wearer stood in between. */
const LONGEST_STRIDE_S = 2.5;
/** Measures are averaged over this number of the last steps of each foot. */
export const LATEST = 20;

/** The steps of one foot. */
export const stepsOf = (steps: readonly StoredStep[], side: Side) => steps.filter(({ step }) => step.side === side);

/** Force-time integral of the whole foot in one step. */
export const impulse_n_s = (step: Step) =>
  Object.values(step.regions).reduce((sum, region) => sum + region.measured_force_integral_n_s, 0);

/** The mean; `null` if there are no values. */
export function mean(values: readonly number[]): number | null {
  return values.length === 0 ? null : values.reduce((sum, value) => sum + value, 0) / values.length;
}

/** The symmetry index 200 (L - R) / (L + R), %. It is 0 for equal feet and positive if the value of the left foot is larger. */
export function symmetryIndex(left: number | null, right: number | null): number | null {
  if (left === null || right === null || left + right === 0) return null;
  return (200 * (left - right)) / (left + right);
}

/** Steps of both feet per minute, computed from strides. Two steps of a foot form a stride if their numbers are consecutive. */
export function cadence_per_min(steps: readonly StoredStep[]): number | null {
  const strides_s = SIDES.flatMap((side) => {
    const latest = stepsOf(steps, side).slice(-LATEST);
    return latest.slice(1).flatMap(({ step }, i) => {
      const before = latest[i]?.step;
      if (!before || step.step !== before.step + 1) return [];
      const stride_s = step.start_s - before.start_s;
      return stride_s > 0 && stride_s <= LONGEST_STRIDE_S ? [stride_s] : [];
    });
  });
  const stride_s = mean(strides_s);
  return stride_s === null ? null : 120 / stride_s;
}

/** Measures of one foot. All except `count` are means over the last {@link LATEST} steps; `null` if there are none. */
export interface FootMeasures {
  /** Number of all stored steps of the foot. */
  count: number;
  /** Peak force on the whole foot. */
  peak_n: number | null;
  /** Force-time integral of the whole foot. */
  impulse_n_s: number | null;
  /** Stance time. */
  contact_s: number | null;
}

/** The measures of a foot. */
export function footMeasures(steps: readonly StoredStep[], side: Side): FootMeasures {
  const all = stepsOf(steps, side);
  const latest = all.slice(-LATEST);
  return {
    count: all.length,
    peak_n: mean(latest.map(({ step }) => step.foot.foot_force_peak_n)),
    impulse_n_s: mean(latest.map(({ step }) => impulse_n_s(step))),
    contact_s: mean(latest.map(({ step }) => step.duration_s)),
  };
}
