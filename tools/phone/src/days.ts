/** The loads of each day as totals. They are stored, so that the page can show them without reading all records. */

import type { Bout, Side } from "./generated/quantities";
import { type RecordMessage, recordOf } from "./session";

/** The load of one record. */
export interface DayLoad {
  /** Local date of the record, YYYY-MM-DD. */
  day: string;
  side: Side;
  kind: RecordMessage["kind"];
  /** Integral of the force on the foot over the time of the record, N s; 0 for an alert. */
  integral_n_s: number;
  /** Largest force on the foot in a step, N; 0 for a load bout or an alert. */
  peak_n: number;
}

/** The loads of one foot on a day. */
export interface FootTotals {
  steps: number;
  bouts: number;
  alerts: number;
  /** Sum of the integrals of all records, N s. */
  integral_n_s: number;
  /** Largest force in all steps, N. */
  peak_n: number;
}

/** The loads of both feet on a day. */
export interface DayTotals {
  /** Local date, YYYY-MM-DD. */
  day: string;
  left: FootTotals;
  right: FootTotals;
}

/** The local date of a time, YYYY-MM-DD. */
export function dayOf(unix_s: number): string {
  const date = new Date(unix_s * 1000);
  const digits = (value: number, count: number) => String(value).padStart(count, "0");
  return `${digits(date.getFullYear(), 4)}-${digits(date.getMonth() + 1, 2)}-${digits(date.getDate(), 2)}`;
}

/** True if a time is of the present local day. */
export const isToday = (unix_s: number) => dayOf(unix_s) === dayOf(Date.now() / 1000);

/** Midnight of the local day that lies this number of days before today, s since 1970. */
export function midnight_unix_s(days_ago: number): number {
  const date = new Date();
  // The days when summer time begins or ends do not have 24 hours.
  date.setDate(date.getDate() - days_ago);
  return date.setHours(0, 0, 0, 0) / 1000;
}

/** The load of a record. A record without a time belongs to the day on which it arrived. */
export function loadOf(message: RecordMessage, start_unix_s: number | null, arrived_unix_s: number): DayLoad {
  const { side } = recordOf(message).record;
  const load = { day: dayOf(start_unix_s ?? arrived_unix_s), side, kind: message.kind, integral_n_s: 0, peak_n: 0 };
  switch (message.kind) {
    case "step":
      return { ...load, integral_n_s: message.step.foot.foot_force_integral_n_s, peak_n: message.step.foot.foot_force_peak_n };
    case "bout":
      return { ...load, integral_n_s: boutIntegral_n_s(message.bout) };
    case "alert":
      return load;
  }
}

/** Integral of the force on the foot over the time of a load bout, N s. */
export const boutIntegral_n_s = ({ regions }: Bout) =>
  Object.values(regions).reduce((sum, region) => sum + region.measured_force_integral_n_s, 0);

const NO_LOAD: FootTotals = { steps: 0, bouts: 0, alerts: 0, integral_n_s: 0, peak_n: 0 };

/** Adds a load to the totals of its day. `days` contains the totals by date. */
export function addLoad(days: Map<string, DayTotals>, { day, side, kind, integral_n_s, peak_n }: DayLoad): void {
  const totals = days.get(day) ?? { day, left: NO_LOAD, right: NO_LOAD };
  const foot = totals[side];
  const count = (of: DayLoad["kind"]) => Number(kind === of);
  const added: FootTotals = {
    steps: foot.steps + count("step"),
    bouts: foot.bouts + count("bout"),
    alerts: foot.alerts + count("alert"),
    integral_n_s: foot.integral_n_s + integral_n_s,
    peak_n: Math.max(foot.peak_n, peak_n),
  };
  days.set(day, { ...totals, [side]: added });
}
