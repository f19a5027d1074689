/** The steps of the wearer. A step is stored before it is acknowledged, and is ignored if the insole sends it again. */

import type { Step } from "./generated/quantities";
import type { StepMessage } from "./session";
import type { StepRecord, StepStorage } from "./step_storage";
import type { Wire } from "./wire";

/** A step, and when it arrived. */
export interface StoredStep {
  step: Step;
  /** Time of first contact on the browser's clock, s since 1970; `null` if it is unknown. */
  start_unix_s: number | null;
}

/** Holds all steps that the page shows, and stores new steps. */
export class StepStore {
  readonly steps: StoredStep[] = [];
  /** Keys of the steps that an insole may send again, oldest first. */
  private readonly recent = new Set<string>();
  /** Steps that are not in the storage yet, oldest first. */
  private readonly pending: StepRecord[] = [];
  /** The last attempt to store the pending steps. The next attempt waits for its end. */
  private storing = Promise.resolve();

  constructor(
    private readonly wire: Wire,
    private readonly storage: StepStorage,
  ) {}

  /** Loads the steps of earlier visits. */
  async load(): Promise<void> {
    const keys = new Set<string>();
    for (const { message, start_unix_s } of await this.storage.load()) {
      const decoded = this.wire.decode(message);
      // Steps of another protocol version are not shown, but remain in the storage. If two pages were open in one browser, they may
      // have stored a step twice.
      if (decoded?.kind !== "step" || keys.has(decoded.key)) continue;
      keys.add(decoded.key);
      this.steps.push({ step: decoded.step, start_unix_s });
      this.remember(decoded.key);
    }
  }

  /** Adds a step, unless it was added before. Resolves once this step and all earlier steps are stored. */
  add({ key, step }: StepMessage, message: Uint8Array, start_unix_s: number | null): Promise<void> {
    if (!this.recent.has(key)) {
      this.steps.push({ step, start_unix_s });
      this.pending.push({ message: message.slice(), start_unix_s });
      this.remember(key);
    }
    this.storing = this.storing.catch(() => undefined).then(() => this.storePending());
    return this.storing;
  }

  /** Deletes all steps. */
  async clear(): Promise<void> {
    this.steps.length = 0;
    this.pending.length = 0;
    await this.storage.clear();
  }

  /** Stores the pending steps in their order, because an acknowledgement covers all earlier steps. */
  private async storePending(): Promise<void> {
    for (let next = this.pending[0]; next; next = this.pending[0]) {
      await this.storage.add(next);
      if (this.pending[0] === next) this.pending.shift();
    }
  }

  private remember(key: string): void {
    this.recent.add(key);
    // Each of the two insoles sends at most the steps in its queue again.
    const [oldest] = this.recent;
    if (oldest !== undefined && this.recent.size > 2 * this.wire.facts.step_queue) this.recent.delete(oldest);
  }
}
