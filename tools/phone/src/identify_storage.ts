/** Storage of the messages of a guided session, so that the session can continue after the page was closed or reloaded. */

import { type IdentifyStorage } from "./identify_session";
import { committed, openDatabase, resultOf } from "./indexed_db";

const DATABASE = "plantar-identify";
const STORE = "messages";

/** Stores parts of a stream file in the browser's database. */
export class DatabaseIdentifyStorage implements IdentifyStorage {
  private constructor(private readonly database: IDBDatabase) {}

  /** Opens the database. {@link openDatabase} describes `blocked`. */
  static async open(blocked: (is_blocked: boolean) => void): Promise<DatabaseIdentifyStorage> {
    const create = ({ result }: IDBOpenDBRequest) => result.createObjectStore(STORE, { autoIncrement: true });
    return new DatabaseIdentifyStorage(await openDatabase(DATABASE, 1, create, blocked));
  }

  load(): Promise<Uint8Array<ArrayBuffer>[]> {
    const store = this.database.transaction(STORE, "readonly").objectStore(STORE);
    return resultOf(store.getAll() as IDBRequest<Uint8Array<ArrayBuffer>[]>);
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
    return committed(transaction);
  }
}
