/** Storage of the wearer's steps, load bouts and alerts across visits of the page. */

/** A stored step, load bout or alert. `start_unix_s` is that of `StoredStep`, `StoredBout` or `StoredAlert`. */
export interface StepRecord {
  /** The encoded message. */
  message: Uint8Array;
  start_unix_s: number | null;
}

/** A storage of steps, load bouts and alerts. */
export interface StepStorage {
  load(): Promise<StepRecord[]>;
  add(record: StepRecord): Promise<void>;
  clear(): Promise<void>;
}

/** Accepts steps without storing them. It is used for the steps of a recording, which must not be shown at the next visit. */
export class TemporaryStorage implements StepStorage {
  load = () => Promise.resolve([]);
  add = () => Promise.resolve();
  clear = () => Promise.resolve();
}

/** Is used if the browser has no database. Adding a step fails, so that the step is not acknowledged and remains on the insole. */
export class NoStorage implements StepStorage {
  load = () => Promise.resolve([]);
  add = () => Promise.reject(new Error("This browser has no database."));
  clear = () => Promise.resolve();
}

/** Stores steps in the browser's database. */
export class DatabaseStorage implements StepStorage {
  private constructor(private readonly database: IDBDatabase) {}

  static open(): Promise<DatabaseStorage> {
    const request = indexedDB.open("plantar", 1);
    request.onupgradeneeded = () => request.result.createObjectStore("steps", { autoIncrement: true });
    return done(request).then((database) => new DatabaseStorage(database));
  }

  load(): Promise<StepRecord[]> {
    return done(this.store("readonly").getAll() as IDBRequest<StepRecord[]>);
  }

  async add(record: StepRecord): Promise<void> {
    const store = this.store("readwrite");
    store.add(record);
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

/** The error of a database operation. */
const failed = (error: DOMException | null) => error ?? new Error("The browser's database failed.");

/** Resolves with the result of a request. */
function done<T>(request: IDBRequest<T>): Promise<T> {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(failed(request.error));
  });
}

/** Resolves when a transaction is stored. */
function complete(transaction: IDBTransaction): Promise<void> {
  return new Promise((resolve, reject) => {
    transaction.oncomplete = () => resolve();
    transaction.onabort = () => reject(failed(transaction.error));
  });
}
