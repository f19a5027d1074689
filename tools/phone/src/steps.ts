/** Every step once: kept before it is acknowledged, dropped when it is replayed. */

import type { ForceAt } from "./session";
import type { Step, Wire } from "./wire";

export interface StoredStep {
  step: Step;
  /** Largest sum of the regions in the live frames; `null` where these were not all received. */
  peak_n: number | null;
  /** First contact on the browser's clock; `null` where the insole's clock was not known. */
  start_unix_s: number | null;
}

/** Where steps are kept beyond this visit. */
export interface Keeper {
  load(): Promise<Kept[]>;
  add(kept: Kept): Promise<void>;
  clear(): Promise<void>;
}

export interface Kept {
  /** The wire message. */
  message: Uint8Array;
  peak_n: number | null;
  start_unix_s: number | null;
}

export class StepStore {
  readonly steps: StoredStep[] = [];
  /** What an insole may still replay, oldest first. */
  private readonly recent = new Set<string>();
  /** What is not kept yet, oldest first. */
  private readonly unkept: Kept[] = [];
  private keeping = Promise.resolve();

  constructor(
    private readonly wire: Wire,
    private readonly keeper: Keeper,
  ) {}

  /** Brings back what was kept. */
  async load(): Promise<void> {
    const all = new Set<string>();
    for (const { message, peak_n, start_unix_s } of await this.keeper.load()) {
      const decoded = this.wire.decode(message);
      // What another version kept is not understood, and left alone; two pages of one browser keep a step twice.
      if (decoded?.kind !== "step") continue;
      const content = contentOf(decoded.step);
      if (all.has(content)) continue;
      all.add(content);
      this.steps.push({ step: decoded.step, peak_n, start_unix_s });
      this.remember(content);
    }
  }

  /** Takes a step with its message; resolves once it and all before it are kept, whether it is new or not. */
  add(step: Step, message: Uint8Array, history: readonly ForceAt[], start_unix_s: number | null): Promise<void> {
    const content = contentOf(step);
    if (!this.recent.has(content)) {
      const peak_n = peakForce(step, history);
      this.steps.push({ step, peak_n, start_unix_s });
      this.unkept.push({ message: message.slice(), peak_n, start_unix_s });
      this.remember(content);
    }
    this.keeping = this.keeping.catch(() => undefined).then(() => this.keepAll());
    return this.keeping;
  }

  async clear(): Promise<void> {
    this.steps.length = 0;
    this.unkept.length = 0;
    await this.keeper.clear();
  }

  /** In their order: the insole takes one for all before it. */
  private async keepAll(): Promise<void> {
    for (let next = this.unkept[0]; next; next = this.unkept[0]) {
      await this.keeper.add(next);
      if (this.unkept[0] === next) this.unkept.shift();
    }
  }

  private remember(content: string): void {
    this.recent.add(content);
    // Of each foot no more can be replayed.
    const [oldest] = this.recent;
    if (oldest !== undefined && this.recent.size > 2 * this.wire.facts.step_queue) this.recent.delete(oldest);
  }
}

/** What a step is known by: an insole with another flash chip counts from 0 again. One that restarted since is the same. */
const contentOf = (step: Step) => JSON.stringify({ ...step, starts_ago: 0 });

/** The peak of the whole foot. A step's record has regional peaks only, and these are not at one time. */
export function peakForce(step: Step, history: readonly ForceAt[]): number | null {
  const end_s = step.start_s + step.duration_s;
  const within = history.filter(({ t_s }) => t_s >= step.start_s - 1e-6 && t_s <= end_s + 1e-6);
  // Some frames may be lost; with a tenth of them gone the peak may be too.
  const expected = step.duration_s / step.sample_s;
  if (within.length < 0.9 * expected) return null;
  return within.reduce((peak, { force_n }) => Math.max(peak, force_n), 0);
}

/** Nothing outlives the visit: for what is not a wearer's. */
export class MemoryKeeper implements Keeper {
  load = () => Promise.resolve([]);
  add = () => Promise.resolve();
  clear = () => Promise.resolve();
}

/** Where the browser keeps nothing: the insole is to keep its steps. */
export class NoKeeper implements Keeper {
  load = () => Promise.resolve([]);
  add = () => Promise.reject(new Error("This browser keeps nothing."));
  clear = () => Promise.resolve();
}

/** The browser's database. */
export class DatabaseKeeper implements Keeper {
  private constructor(private readonly database: IDBDatabase) {}

  static open(): Promise<DatabaseKeeper> {
    const request = indexedDB.open("plantar", 1);
    request.onupgradeneeded = () => request.result.createObjectStore("steps", { autoIncrement: true });
    return done(request).then((database) => new DatabaseKeeper(database));
  }

  load(): Promise<Kept[]> {
    return done(this.store("readonly").getAll() as IDBRequest<Kept[]>);
  }

  async add(kept: Kept): Promise<void> {
    const store = this.store("readwrite");
    store.add(kept);
    await complete(store.transaction);
  }

  async clear(): Promise<void> {
    const store = this.store("readwrite");
    store.clear();
    await complete(store.transaction);
  }

  private store(mode: IDBTransactionMode): IDBObjectStore {
    return this.database.transaction("steps", mode).objectStore("steps");
  }
}

function done<T>(request: IDBRequest<T>): Promise<T> {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error ?? new Error("The browser's database failed."));
  });
}

function complete(transaction: IDBTransaction): Promise<void> {
  return new Promise((resolve, reject) => {
    transaction.oncomplete = () => resolve();
    transaction.onabort = () => reject(transaction.error ?? new Error("The browser's database failed."));
  });
}
