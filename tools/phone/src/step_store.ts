/**
 * The steps, load bouts and alerts of the wearer. Each is stored before it is acknowledged, and is ignored if the insole sends it
 * again.
 */

import { type DayTotals, addLoad, loadOf } from "./days";
import type { Alert, Bout, Side, Step } from "./generated/quantities";
import { type RecordMessage, recordOf } from "./session";
import { SIDES } from "./side";
import { type NewRecord, type StoredRecord, type RecordStorage, TemporaryStorage } from "./record_storage";
import type { Wire } from "./wire";

/**
 * Number of the last records that are loaded at the start. When the records of a kind in memory reach twice this number, only
 * this number of each kind remain in memory. All others remain in the storage only.
 */
const LOADED = 1000;

/** A step, and when it began. */
export interface StoredStep {
  step: Step;
  /** Time of the heel strike on the browser's clock, s since 1970; `null` if it is unknown. */
  start_unix_s: number | null;
  /** True if this time is exact enough to compare it with those of the other foot. */
  is_comparable?: boolean | undefined;
}

/** A load bout, and when it began. */
export interface StoredBout {
  bout: Bout;
  /** Time of its start on the browser's clock, s since 1970; `null` if it is unknown. */
  start_unix_s: number | null;
}

/** An alert, and when it was raised. */
export interface StoredAlert {
  alert: Alert;
  /** Its time on the browser's clock, s since 1970; `null` if it is unknown. */
  start_unix_s: number | null;
}

/**
 * These records, which are in the order of their arrival, in the order of their times, newest first. One without a known time has
 * the time of the record that arrived before it. Of records with the same time, the one that arrived last is the first.
 */
export function newestFirst<T extends { start_unix_s: number | null }>(records: readonly T[]): T[] {
  let unix_s = 0;
  const timed = records.map((record) => ({ record, unix_s: (unix_s = record.start_unix_s ?? unix_s) }));
  return timed.reverse().sort((a, b) => b.unix_s - a.unix_s).map(({ record }) => record);
}

/** Records of all kinds. */
export class Records {
  readonly steps: StoredStep[] = [];
  readonly bouts: StoredBout[] = [];
  readonly alerts: StoredAlert[] = [];

  add(decoded: RecordMessage, { start_unix_s, is_comparable }: StoredRecord): void {
    if (decoded.kind === "step") this.steps.push({ step: decoded.step, start_unix_s, is_comparable });
    else if (decoded.kind === "bout") this.bouts.push({ bout: decoded.bout, start_unix_s });
    else this.alerts.push({ alert: decoded.alert, start_unix_s });
  }

  /** The records that began at this time, s since 1970, or later. Those without a known time are not among them. */
  since(unix_s: number): Records {
    const records = new Records();
    const isLater = ({ start_unix_s }: { start_unix_s: number | null }) => start_unix_s !== null && start_unix_s >= unix_s;
    records.steps.push(...this.steps.filter(isLater));
    records.bouts.push(...this.bouts.filter(isLater));
    records.alerts.push(...this.alerts.filter(isLater));
    return records;
  }

  /** Removes all but the last `count` records of each kind. */
  trimTo(count: number): void {
    for (const records of [this.steps, this.bouts, this.alerts]) records.splice(0, Math.max(0, records.length - count));
  }
}

/** Decodes a stored record; `undefined` for a record of another protocol version. */
function decodeRecord(wire: Wire, { message }: StoredRecord): RecordMessage | undefined {
  const decoded = wire.decode(message);
  return decoded?.kind === "step" || decoded?.kind === "bout" || decoded?.kind === "alert" ? decoded : undefined;
}

/** A record with its key and its load. `arrived_unix_s` is the time of its arrival. */
function withKey(decoded: RecordMessage, record: StoredRecord, arrived_unix_s: number): NewRecord {
  return { ...record, key: decoded.key, load: loadOf(decoded, record.start_unix_s, arrived_unix_s) };
}

const now_unix_s = () => Date.now() / 1000;

/**
 * Adds the key and the load to a record that was stored without them. A record without a time counts for the present day. Returns
 * `undefined` for a record of another protocol version.
 */
export function keyedRecord(wire: Wire, record: StoredRecord): NewRecord | undefined {
  const decoded = decodeRecord(wire, record);
  return decoded && withKey(decoded, record, now_unix_s());
}

/** Holds the last steps, load bouts and alerts and the totals of all days, and stores new records. */
export class StepStore {
  /** The last records, oldest first. */
  readonly latest = new Records();
  /** The totals of all days, by date. */
  readonly days = new Map<string, DayTotals>();
  /** Keys of the last records of each foot, which can arrive again, oldest first. */
  private readonly recent: Record<Side, Set<string>> = { left: new Set(), right: new Set() };
  /** Records that are not in the storage yet, oldest first. */
  private pending: NewRecord[] = [];
  /** The last attempt to store the pending records. The next attempt waits for its end. */
  private storing = Promise.resolve();

  /**
   * `most_repeated` is the largest number of last records of a foot that can arrive again. By default, these are the records that
   * an insole holds in RAM, and the same number of earlier ones, because a restart of the insole can lose their acknowledgements.
   */
  constructor(
    private readonly wire: Wire,
    private readonly storage: RecordStorage,
    private readonly most_repeated = 2 * wire.facts.record_queue,
  ) {}

  /** The store of a recording, which is played in a loop, so that all of its records arrive again. */
  static ofRecording(wire: Wire): StepStore {
    return new StepStore(wire, new TemporaryStorage(), Infinity);
  }

  /** Loads the last records and the totals of earlier visits. */
  async load(): Promise<void> {
    this.fill(await this.storage.days(), await this.storage.latest(LOADED));
  }

  /** Shows these totals and records. */
  private fill(days: readonly DayTotals[], latest: readonly StoredRecord[]): void {
    for (const totals of days) this.days.set(totals.day, totals);
    for (const record of latest) {
      // Records of another protocol version are not shown, but remain in the storage.
      const decoded = decodeRecord(this.wire, record);
      if (!decoded) continue;
      this.latest.add(decoded, record);
      this.remember(decoded);
    }
  }

  /** Loads the records again, after another tab has deleted them. Those that could not be stored yet remain. */
  async reload(): Promise<void> {
    // Nothing is stored while days and records are read, so that both contain the same records.
    const reading = this.storing
      .catch(() => undefined)
      .then(async () => [await this.storage.days(), await this.storage.latest(LOADED)] as const);
    this.storing = reading.then(() => undefined);
    const [days, latest] = await reading;
    // From here on, no record can arrive before all of them are shown, so none is shown twice.
    this.latest.trimTo(0);
    this.days.clear();
    this.fill(days, latest);
    for (const record of this.pending) {
      const decoded = decodeRecord(this.wire, record);
      if (decoded) this.latest.add(decoded, record);
      addLoad(this.days, record.load);
    }
  }

  /** All records in parts, oldest first, including those that could not be stored. */
  async *parts(): AsyncGenerator<Records> {
    // These records can be stored before or after the last part is read.
    const pending = new Map<string, StoredRecord>(this.pending.map((record) => [record.key, record]));
    for await (const part of this.storage.parts()) yield this.decoded(part, pending);
    yield this.decoded([...pending.values()], pending);
  }

  /** Decodes the records of a part, and removes them from `pending`. */
  private decoded(part: readonly StoredRecord[], pending: Map<string, StoredRecord>): Records {
    const records = new Records();
    for (const record of part) {
      const decoded = decodeRecord(this.wire, record);
      if (!decoded) continue;
      records.add(decoded, record);
      pending.delete(decoded.key);
    }
    return records;
  }

  /** Number of records of a kind, of one foot or of both. */
  count(kind: "steps" | "bouts" | "alerts", sides: readonly Side[] = SIDES): number {
    return [...this.days.values()].flatMap((totals) => sides.map((side) => totals[side][kind])).reduce((sum, count) => sum + count, 0);
  }

  /** True if this record was added before, and is one of the last ones, which can arrive again. */
  has(decoded: RecordMessage): boolean {
    return this.recent[recordOf(decoded).record.side].has(decoded.key);
  }

  /** Adds a record, unless it was added before. Resolves once this one and all earlier ones are stored. */
  add(decoded: RecordMessage, message: Uint8Array, start_unix_s: number | null, is_comparable?: boolean): Promise<void> {
    if (!this.has(decoded)) {
      const record = withKey(decoded, { message: message.slice(), start_unix_s, is_comparable }, now_unix_s());
      this.latest.add(decoded, record);
      // Removing one record at a time would copy all others each time.
      const { steps, bouts, alerts } = this.latest;
      if (Math.max(steps.length, bouts.length, alerts.length) >= 2 * LOADED) this.latest.trimTo(LOADED);
      addLoad(this.days, record.load);
      this.pending.push(record);
      this.remember(decoded);
    }
    return this.retry();
  }

  /** Stores the records that could not be stored before. Resolves once all records are stored. */
  retry(): Promise<void> {
    this.storing = this.storing.catch(() => undefined).then(() => this.storePending());
    return this.storing;
  }

  /** Deletes all records. */
  async clear(): Promise<void> {
    this.latest.trimTo(0);
    this.days.clear();
    this.pending = [];
    await this.storage.clear();
  }

  /** Stores all pending records or none of them, because an acknowledgement covers all earlier ones. */
  private async storePending(): Promise<void> {
    const stored = this.pending;
    if (stored.length === 0) return;
    const count = stored.length;
    await this.storage.add(stored.slice());
    // Records that arrived in the meantime remain. If `clear` was called meanwhile, `pending` is another list.
    stored.splice(0, count);
  }

  private remember(decoded: RecordMessage): void {
    const recent = this.recent[recordOf(decoded).record.side];
    recent.add(decoded.key);
    const [oldest] = recent;
    if (oldest !== undefined && recent.size > this.most_repeated) recent.delete(oldest);
  }
}
