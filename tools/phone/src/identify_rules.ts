/** The rules of a guided session: how many steps it needs, why a step is not used, and whether a result is confirmed. */

import type { Step } from "./generated/quantities";
import type { Collected, FootResult } from "./identify_core";

/** Number of good steps of each foot that a session collects. */
export const TARGET_STEPS = 30;
/** With fewer good steps, the wearer is warned that the result is less certain. */
export const RELIABLE_STEPS = 10;
/** With fewer good steps, a foot is not fitted, because too few steps remain to predict each step from the others. */
export const MIN_STEPS = 3;
/** Number of steps of each foot on which the result is checked. */
export const CHECK_STEPS = 10;
/**
 * A region with a smaller peak force in all steps is not fitted (`MIN_FORCE_N` in tools/fit/src/screen.rs). The check ignores a
 * region in the steps in which its peak force is smaller.
 */
const LOADED_N = 3;
/** The check succeeds if the measured error is at most this multiple of the predicted error plus {@link TOLERANCE_PERCENT}. */
const TOLERANCE_FACTOR = 1.3;
const TOLERANCE_PERCENT = 1;

/** The reasons why steps of a foot were not used, as sentences for the wearer. `is_radio` is that of the transport. */
export function exclusions({ side, excluded }: Collected, is_radio: boolean): string[] {
  const sentence = (count: number, reason: string) =>
    count > 0 ? [`Not used: ${count} ${side} ${count === 1 ? "step" : "steps"} ${reason}`] : [];
  return [
    ...sentence(excluded.broken, `with lost data.${is_radio ? " Hold the phone closer to your feet." : ""}`),
    ...sentence(excluded.partial, "with too little load. Walk straight, at your usual pace."),
    ...sentence(excluded.before, "from before this session."),
  ];
}

/** Errors of the model (NRMSE), mean over the fitted regions for which the fit predicts an error. */
export interface Check {
  /** The error that the fit predicts. */
  predicted_percent: number;
  /** The error that the insole measured on the steps of the check. */
  measured_percent: number;
  /** True if the measured error confirms the result, see {@link TOLERANCE_FACTOR}. */
  is_confirmed: boolean;
}

/**
 * Compares the insole's own model error in these steps with the result. As in a fit, a region is left out in the steps in which
 * it is hardly loaded, or has a saturated cell: its measured force is then only a lower bound. A region that was fitted to a
 * single step is left out, because this fit predicts no error. `undefined` if no region remains.
 */
export function check(result: FootResult, steps: readonly Step[]): Check | undefined {
  const predicted_percent: number[] = [];
  const measured_percent: number[] = [];
  for (const [name, fit] of Object.entries(result.regions)) {
    if (!fit.fitted || fit.nrmse_percent.predicted === null) continue;
    const all = steps.flatMap((step) => step.regions[name] ?? []);
    const regions = all.filter((region) => region.measured_force_peak_n >= LOADED_N && !region.saturated);
    const errors_percent = regions.flatMap((region) => region.model_error_nrmse_percent ?? []);
    if (errors_percent.length === 0) continue;
    predicted_percent.push(fit.nrmse_percent.predicted);
    measured_percent.push(mean(errors_percent));
  }
  if (predicted_percent.length === 0) return undefined;
  const errors = { predicted_percent: mean(predicted_percent), measured_percent: mean(measured_percent) };
  const limit_percent = TOLERANCE_FACTOR * errors.predicted_percent + TOLERANCE_PERCENT;
  return { ...errors, is_confirmed: errors.measured_percent <= limit_percent };
}

const mean = (values: readonly number[]) => values.reduce((sum, value) => sum + value, 0) / values.length;
