/** The steps, load bouts and alerts of the wearer. Each is stored before it is acknowledged, and is ignored if the insole sends it again. */

import type { Alert, Bout, Step } from "./generated/quantities";
import type { RecordMessage } from "./session";
import type { StepRecord, StepStorage } from "./step_storage";
import type { Wire } from "./wire";

/** A step, and when it arrived. */
export interface StoredStep {
  step: Step;
  /** Time of first contact on the browser's clock, s since 1970; `null` if it is unknown. */
  start_unix_s: number | null;
}

/** A load bout, and when it arrived. */
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

/** Holds all steps, load bouts and alerts that the page shows, and stores new ones. */
export class StepStore {
  readonly steps: StoredStep[] = [];
  readonly bouts: StoredBout[] = [];
  readonly alerts: StoredAlert[] = [];
  /** Keys of the records that an insole may send again, oldest first. */
  private readonly recent = new Set<string>();
  /** Records that are not in the storage yet, oldest first. */
  private readonly pending: StepRecord[] = [];
  /** The last attempt to store the pending records. The next attempt waits for its end. */
  private storing = Promise.resolve();

  constructor(
    private readonly wire: Wire,
    private readonly storage: StepStorage,
  ) {}

  /** Loads the records of earlier visits. */
  async load(): Promise<void> {
    const keys = new Set<string>();
    for (const { message, start_unix_s } of await this.storage.load()) {
      const decoded = this.wire.decode(message);
      // Those of another protocol version are not shown, but remain in the storage. If two pages were open in one browser, they may
      // have stored one twice.
      if (decoded?.kind !== "step" && decoded?.kind !== "bout" && decoded?.kind !== "alert") continue;
      if (keys.has(decoded.key)) continue;
      keys.add(decoded.key);
      this.show(decoded, start_unix_s);
      this.remember(decoded.key);
    }
  }

  /** True if this record was added before, and the insole may send it again. */
  has({ key }: RecordMessage): boolean {
    return this.recent.has(key);
  }

  /** Adds a record, unless it was added before. Resolves once this one and all earlier ones are stored. */
  add(decoded: RecordMessage, message: Uint8Array, start_unix_s: number | null): Promise<void> {
    if (!this.recent.has(decoded.key)) {
      this.show(decoded, start_unix_s);
      this.pending.push({ message: message.slice(), start_unix_s });
      this.remember(decoded.key);
    }
    this.storing = this.storing.catch(() => undefined).then(() => this.storePending());
    return this.storing;
  }

  private show(decoded: RecordMessage, start_unix_s: number | null): void {
    if (decoded.kind === "step") this.steps.push({ step: decoded.step, start_unix_s });
    else if (decoded.kind === "bout") this.bouts.push({ bout: decoded.bout, start_unix_s });
    else this.alerts.push({ alert: decoded.alert, start_unix_s });
  }

  /** Deletes all records. */
  async clear(): Promise<void> {
    this.steps.length = 0;
    this.bouts.length = 0;
    this.alerts.length = 0;
    this.pending.length = 0;
    await this.storage.clear();
  }

  /** Stores the pending records in their order, because an acknowledgement covers all earlier ones. */
  private async storePending(): Promise<void> {
    for (let next = this.pending[0]; next; next = this.pending[0]) {
      await this.storage.add(next);
      if (this.pending[0] === next) this.pending.shift();
    }
  }

  private remember(key: string): void {
    this.recent.add(key);
    // Each of the two insoles sends at most the records in its queue again.
    const [oldest] = this.recent;
    if (oldest !== undefined && this.recent.size > 2 * this.wire.facts.record_queue) this.recent.delete(oldest);
  }
}
