/** CSV files with units in the column names. docs/quantities.md describes the columns. */

import type { DayTotals } from "./days";
import { BOUT_COLUMNS, ELLIPSE_COLUMNS, FOOT_COLUMNS, GAIT_COLUMNS, LIVE_COLUMNS, STEP_COLUMNS, type Side } from "./generated/quantities";
import type { ToHost } from "./generated/messages";
import type { StoredBout, StoredStep } from "./step_store";
import type { Entry } from "./stream_file";
import { SIDES } from "./side";
import { INSOLES, type Insole } from "./transport/transport";
import type { Wire } from "./wire";

type Cell = string | number | null;

/** A line of a CSV file. `null` becomes an empty cell. */
const line = (cells: readonly Cell[]) => cells.map((cell) => cell ?? "").join(",") + "\n";

/** Number of rows of a part of the CSV file with live frames. */
export const PART_ROWS = 5000;

/**
 * Returns the parts of a CSV file with one row for each live frame. Only one part is in memory at a time, apart from what the
 * browser holds of the blobs. `recorded` is iterated twice. `unix_s` is the time of the scan on the browser's clock, which is the
 * same for both feet. It is empty if the recording contains no time message of this session of the insole. `t_s` is the time of
 * arrival since the start of the recording. `device_t_s` is the time of the scan on the insole's clock.
 */
export function* liveCsv(recorded: Iterable<Entry>, wire: Wire): Generator<Blob> {
  const names = wire.facts.regions.map(({ name }) => name);
  const columns = names.flatMap((name) => LIVE_COLUMNS.map((column) => `${name}_${column}`));
  let rows = [line(["unix_s", "t_s", "side", "sequence", "device_t_s", ...columns])];
  const sides = new Map<number, Side>();
  const mappings = INSOLES.map(wire.recordedClockMapping);
  // The clock of an insole begins again at each restart, and a hello follows each restart. The clock mapping is therefore
  // computed separately for the time messages between two hellos.
  const times = INSOLES.map((): Extract<ToHost, { kind: "time" }>[][] => [[]]);
  let live_kind: number | undefined;
  for (const { insole, message } of recorded) {
    // Nearly all messages are live frames, which are decoded below.
    if (message[0] === live_kind) continue;
    const decoded = wire.decode(message);
    if (decoded?.kind === "live") live_kind = message[0];
    if (decoded?.kind === "hello") times[insole]?.push([]);
    if (decoded?.kind === "time") times[insole]?.at(-1)?.push(decoded);
  }
  const beginSession = (insole: Insole) => {
    mappings[insole]?.clear();
    for (const time of times[insole]?.shift() ?? []) mappings[insole]?.answer(time);
  };
  INSOLES.forEach(beginSession);
  for (const { t_ms, insole, message } of recorded) {
    const decoded = wire.decode(message);
    if (decoded?.kind === "hello") {
      sides.set(insole, decoded.side);
      beginSession(insole);
    }
    if (decoded?.kind !== "live") continue;
    const values = decoded.regions.flatMap((region) => LIVE_COLUMNS.map((column) => Number(region[column])));
    const unix_s = mappings[insole]?.unix_s(decoded.t_s) ?? null;
    rows.push(line([unix_s, t_ms / 1000, sides.get(insole) ?? "", decoded.sequence, decoded.t_s, ...values]));
    if (rows.length < PART_ROWS) continue;
    yield new Blob(rows);
    rows = [];
  }
  yield new Blob(rows);
}

/** Returns the lines of a CSV file with one row for each region of each step. */
export function stepsCsv(steps: readonly StoredStep[]): string[] {
  const head = ["start_unix_s", "side", "step", "start_s", "contact_time_foot_s", "region", ...STEP_COLUMNS];
  const ellipse_head = ELLIPSE_COLUMNS.map((column) => `ellipse_${column}`);
  const gait_head = GAIT_COLUMNS.map((column) => `gait_${column}`);
  const rows = [line([...head, ...ellipse_head, ...FOOT_COLUMNS, ...gait_head])];
  for (const { step, start_unix_s } of steps) {
    const foot = [...FOOT_COLUMNS.map((column) => step.foot[column]), ...GAIT_COLUMNS.map((column) => step.foot.gait_line[column])];
    for (const [name, region] of Object.entries(step.regions)) {
      // Flags are 0 or 1; quantities that do not exist have empty cells.
      const values = STEP_COLUMNS.map((column) => (region[column] === null ? null : Number(region[column])));
      const ellipse = ELLIPSE_COLUMNS.map((column) => region.ellipse_at_peak?.[column] ?? null);
      rows.push(line([start_unix_s, step.side, step.step, step.start_s, step.duration_s, name, ...values, ...ellipse, ...foot]));
    }
  }
  return rows;
}

/** Returns the lines of a CSV file with one row for each region of each load bout. */
export function boutsCsv(bouts: readonly StoredBout[]): string[] {
  const rows = [line(["start_unix_s", "side", "number", "kind", "start_s", "duration_s", "region", ...BOUT_COLUMNS])];
  for (const { bout, start_unix_s } of bouts) {
    for (const [name, region] of Object.entries(bout.regions)) {
      const values = BOUT_COLUMNS.map((column) => region[column]);
      rows.push(line([start_unix_s, bout.side, bout.number, bout.kind, bout.start_s, bout.duration_s, name, ...values]));
    }
  }
  return rows;
}

/** Returns the lines of a CSV file with one row for each foot on each day, earliest day first. */
export function daysCsv(days: readonly DayTotals[]): string[] {
  const rows = [line(["day", "side", "steps", "load_bouts", "alerts", "force_integral_n_s", "foot_force_peak_n"])];
  for (const totals of [...days].sort((a, b) => a.day.localeCompare(b.day))) {
    for (const side of SIDES) {
      const { steps, bouts, alerts, integral_n_s, peak_n } = totals[side];
      rows.push(line([totals.day, side, steps, bouts, alerts, Number(integral_n_s.toFixed(3)), peak_n]));
    }
  }
  return rows;
}
