/** Storage of steps across visits. */

export interface StepRecord {
  /** The wire message. */
  message: Uint8Array;
  peak_n: number | null;
  start_unix_s: number | null;
}

export interface StepStorage {
  load(): Promise<StepRecord[]>;
  add(record: StepRecord): Promise<void>;
  clear(): Promise<void>;
}

/** Stores nothing across visits: for the steps of a recording. */
export class TemporaryStorage implements StepStorage {
  load = () => Promise.resolve([]);
  add = () => Promise.resolve();
  clear = () => Promise.resolve();
}

/** For a browser without a database. Adding a step fails, so that it is not acknowledged and the insole does not delete it. */
export class NoStorage implements StepStorage {
  load = () => Promise.resolve([]);
  add = () => Promise.reject(new Error("This browser has no database."));
  clear = () => Promise.resolve();
}

/** The browser's database. */
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

const failed = (error: DOMException | null) => error ?? new Error("The browser's database failed.");

function done<T>(request: IDBRequest<T>): Promise<T> {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(failed(request.error));
  });
}

function complete(transaction: IDBTransaction): Promise<void> {
  return new Promise((resolve, reject) => {
    transaction.oncomplete = () => resolve();
    transaction.onabort = () => reject(failed(transaction.error));
  });
}
