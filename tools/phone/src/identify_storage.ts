/** Storage of the messages of a guided session, so that the session can continue after the page was closed or reloaded. */

import { type IdentifyStorage } from "./identify_session";
import { complete, done } from "./indexed_db";

const DATABASE = "plantar-identify";
const STORE = "messages";

/** Stores parts of a stream file in the browser's database. */
export class DatabaseIdentifyStorage implements IdentifyStorage {
  private constructor(private readonly database: IDBDatabase) {}

  static async open(): Promise<DatabaseIdentifyStorage> {
    // `indexedDB.open` throws if the browser stores nothing for this site. In an async function, the error rejects the promise.
    const request = indexedDB.open(DATABASE, 1);
    request.onupgradeneeded = () => request.result.createObjectStore(STORE, { autoIncrement: true });
    return done(request).then((database) => new DatabaseIdentifyStorage(database));
  }

  load(): Promise<Uint8Array<ArrayBuffer>[]> {
    const store = this.database.transaction(STORE, "readonly").objectStore(STORE);
    return done(store.getAll() as IDBRequest<Uint8Array<ArrayBuffer>[]>);
  }

  async add(part: Uint8Array<ArrayBuffer>): Promise<void> {
    await this.change((store) => store.add(part));
  }

  async clear(): Promise<void> {
    await this.change((store) => store.clear());
  }

  /** Resolves when the change is stored. */
  private change(act: (store: IDBObjectStore) => void): Promise<void> {
    const transaction = this.database.transaction(STORE, "readwrite");
    act(transaction.objectStore(STORE));
    return complete(transaction);
  }
}
