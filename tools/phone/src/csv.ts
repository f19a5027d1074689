/** CSV with units in the column names. */

import type { StoredStep } from "./steps";
import { INSOLES } from "./transport/transport";
import type { Entry } from "./stream_file";
import type { Side, StepRegion, Wire } from "./wire";

type Cell = string | number | boolean | null;

const line = (cells: readonly Cell[]) => cells.map((cell) => (cell === null ? "" : Number(cell) === cell ? cell : String(cell))).join(",") + "\n";

const LIVE_COLUMNS = ["area_mm2", "deformation_mm", "model_n", "measured_n", "saturated", "clamped", "masked"] as const;

/** A row a live frame: `unix_s` is when it was scanned, on the browser's clock for both feet, empty where it was not asked for;
 * `t_s` is when it arrived, and `device_t_s` the insole's own. */
export function liveCsv(recorded: Iterable<Entry>, wire: Wire): string[] {
  const names = wire.facts.regions.map(({ name }) => name);
  const rows = [line(["unix_s", "t_s", "side", "sequence", "device_t_s", ...names.flatMap((name) => LIVE_COLUMNS.map((c) => `${name}_${c}`))])];
  const sides = new Map<number, Side>();
  const all = [...recorded].map(({ t_ms, insole, message }) => ({ t_ms, insole, decoded: wire.decode(message) }));
  const axes = INSOLES.map(wire.recordedAxis);
  axes.forEach((axis) => axis.clear());
  for (const { insole, decoded } of all) if (decoded?.kind === "time") axes[insole]?.answer(decoded);
  for (const { t_ms, insole, decoded } of all) {
    if (decoded?.kind === "hello") sides.set(insole, decoded.side);
    if (decoded?.kind !== "live") continue;
    const values = decoded.regions.flatMap((region) => LIVE_COLUMNS.map((column) => Number(region[column])));
    const unix_s = axes[insole]?.unix_s(decoded.t_s) ?? null;
    rows.push(line([unix_s, t_ms / 1000, sides.get(insole) ?? "", decoded.sequence, decoded.t_s, ...values]));
  }
  return rows;
}

const STEP_COLUMNS = [
  "measured_force_peak_n",
  "model_force_peak_n",
  "measured_force_integral_n_s",
  "model_force_integral_n_s",
  "area_peak_mm2",
  "deformation_peak_mm",
  "deformation_rate_peak_mm_s",
  "contact_time_s",
  "time_to_peak_s",
  "model_error_nrmse_percent",
  "saturated",
  "clamped",
  "masked_cells",
] as const satisfies readonly (keyof StepRegion)[];
const ELLIPSE_COLUMNS = ["x_mm", "y_mm", "r_a_mm", "r_b_mm", "angle_deg"] as const;

/** A row a step and region. */
export function stepsCsv(steps: readonly StoredStep[]): string[] {
  const head = ["start_unix_s", "side", "step", "start_s", "contact_time_foot_s", "peak_force_foot_n", "region", ...STEP_COLUMNS];
  const rows = [line([...head, ...ELLIPSE_COLUMNS.map((column) => `ellipse_${column}`)])];
  for (const { step, peak_n, start_unix_s } of steps) {
    for (const [name, region] of Object.entries(step.regions)) {
      const values = STEP_COLUMNS.map((column) => Number(region[column]));
      const ellipse = ELLIPSE_COLUMNS.map((column) => region.ellipse_at_peak?.[column] ?? null);
      rows.push(line([start_unix_s, step.side, step.step, step.start_s, step.duration_s, peak_n, name, ...values, ...ellipse]));
    }
  }
  return rows;
}
