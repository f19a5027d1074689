/** The steps of the wearer, each once: a step is stored before it is acknowledged, and ignored when the insole repeats it. */

import type { Step } from "./generated/quantities";
import type { ForceSample, StepMessage } from "./session";
import type { StepRecord, StepStorage } from "./step_storage";
import type { Wire } from "./wire";

export interface StoredStep {
  step: Step;
  /** Largest total force of the foot in the live frames; `null` where too many of these are missing. */
  peak_n: number | null;
  /** First contact on the browser's clock; `null` where the insole's clock was not known. */
  start_unix_s: number | null;
}

export class StepStore {
  readonly steps: StoredStep[] = [];
  /** Keys of the steps that an insole may repeat, oldest first. */
  private readonly recent = new Set<string>();
  /** Steps that are not in the storage yet, oldest first. */
  private readonly pending: StepRecord[] = [];
  private storing = Promise.resolve();

  constructor(
    private readonly wire: Wire,
    private readonly storage: StepStorage,
  ) {}

  /** Loads the steps of earlier visits. */
  async load(): Promise<void> {
    const keys = new Set<string>();
    for (const { message, peak_n, start_unix_s } of await this.storage.load()) {
      const decoded = this.wire.decode(message);
      // Steps of another protocol version stay in the storage. Two pages in one browser store a step twice.
      if (decoded?.kind !== "step" || keys.has(decoded.key)) continue;
      keys.add(decoded.key);
      this.steps.push({ step: decoded.step, peak_n, start_unix_s });
      this.remember(decoded.key);
    }
  }

  /** Takes a step and its encoded message; resolves once it and all before it are stored, whether it is new or not. */
  add(
    { key, step }: StepMessage,
    message: Uint8Array,
    history: readonly ForceSample[],
    start_unix_s: number | null,
  ): Promise<void> {
    if (!this.recent.has(key)) {
      const peak_n = peakForce(step, history);
      this.steps.push({ step, peak_n, start_unix_s });
      this.pending.push({ message: message.slice(), peak_n, start_unix_s });
      this.remember(key);
    }
    this.storing = this.storing.catch(() => undefined).then(() => this.storePending());
    return this.storing;
  }

  async clear(): Promise<void> {
    this.steps.length = 0;
    this.pending.length = 0;
    await this.storage.clear();
  }

  /** In their order, because an acknowledged step stands for all before it. */
  private async storePending(): Promise<void> {
    for (let next = this.pending[0]; next; next = this.pending[0]) {
      await this.storage.add(next);
      if (this.pending[0] === next) this.pending.shift();
    }
  }

  private remember(key: string): void {
    this.recent.add(key);
    // Each foot can repeat no more than its queue.
    const [oldest] = this.recent;
    if (oldest !== undefined && this.recent.size > 2 * this.wire.facts.step_queue) this.recent.delete(oldest);
  }
}

/** The peak force of the whole foot. A step has the peaks of its regions only, which are not at the same time. */
export function peakForce(step: Step, history: readonly ForceSample[]): number | null {
  const end_s = step.start_s + step.duration_s;
  const within = history.filter(({ t_s }) => t_s >= step.start_s - 1e-6 && t_s <= end_s + 1e-6);
  // The peak may be among the missing frames where more than a tenth is missing.
  const expected = step.duration_s / step.sample_s;
  if (within.length < 0.9 * expected) return null;
  return within.reduce((peak, { force_n }) => Math.max(peak, force_n), 0);
}
