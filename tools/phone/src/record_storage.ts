/** Storage of the wearer's steps, load bouts and alerts across visits of the page. */

import { type DayLoad, type DayTotals, addLoad } from "./days";
import { committed, failureOf, openDatabase, resultOf } from "./indexed_db";

/** A stored step, load bout or alert. */
export interface StoredRecord {
  /** The encoded message. */
  message: Uint8Array;
  /** Its start, or the time of the alert, on the browser's clock, s since 1970; `null` if it is unknown. */
  start_unix_s: number | null;
  /** True if `start_unix_s` is exact enough to compare a step with those of the other foot; only for steps. */
  is_comparable?: boolean | undefined;
}

/** A record to store. */
export interface NewRecord extends StoredRecord {
  /** Equal for all repetitions of a record, and for no other record. */
  key: string;
  load: DayLoad;
}

/** A storage of steps, load bouts and alerts. */
export interface RecordStorage {
  /** The last records, at most this number, oldest first. */
  latest(count: number): Promise<StoredRecord[]>;
  /** All records in parts, oldest first. */
  parts(): AsyncIterable<StoredRecord[]>;
  /** The totals of all days, oldest first. */
  days(): Promise<DayTotals[]>;
  /** Stores all of these records, or none of them. Ignores those that are stored already. */
  add(records: readonly NewRecord[]): Promise<void>;
  /** Deletes all records and totals. */
  clear(): Promise<void>;
}

/** Holds records until the page is closed. It is used for the steps of a recording, which must not be shown at the next visit. */
export class TemporaryStorage implements RecordStorage {
  /** The records by their keys, oldest first. */
  readonly records = new Map<string, NewRecord>();

  latest = (count: number) => Promise.resolve([...this.records.values()].slice(-count));

  async *parts(): AsyncGenerator<StoredRecord[]> {
    yield [...this.records.values()];
  }

  days = () => Promise.resolve(totalsOf([...this.records.values()]));

  add(records: readonly NewRecord[]): Promise<void> {
    for (const record of records) if (!this.records.has(record.key)) this.records.set(record.key, record);
    return Promise.resolve();
  }

  clear(): Promise<void> {
    this.records.clear();
    return Promise.resolve();
  }
}

/**
 * The storage that is used if the browser's database is missing, or cannot be opened or read. Adding a record fails, so that the
 * record is not acknowledged and remains on the insole.
 */
export class NoStorage extends TemporaryStorage {
  override add(): Promise<void> {
    return Promise.reject(failureOf(null));
  }
}

const DATABASE = "plantar";
/** The records in the order in which they were stored, with their keys as an index. */
const RECORDS = "records";
/** The totals of each day. */
const DAYS = "days";
/** The records of version 1 of the database, which had no keys and no totals. */
const RECORDS_1 = "steps";
/** Number of records that are read at once. The page does not respond while they are decoded, which takes less than 0.1 s. */
const PART_RECORDS = 200;

/** Number of the last records of version 2 of the database that get keys of the present form: more than can arrive again. */
const CONVERTED = 1000;

/** Stores records in the browser's database. */
export class DatabaseStorage implements RecordStorage {
  private constructor(private readonly database: IDBDatabase) {}

  /**
   * Opens the database. `keyed` returns a record with its key and load; `undefined` for a record of another protocol version,
   * which remains stored, but is not counted. {@link openDatabase} describes `blocked`.
   */
  static async open(
    keyed: (record: StoredRecord) => NewRecord | undefined,
    blocked: (is_blocked: boolean) => void,
  ): Promise<DatabaseStorage> {
    const create = ({ result: database, transaction }: IDBOpenDBRequest) => {
      if (transaction && database.objectStoreNames.contains(RECORDS)) return void shortenKeys(transaction, keyed);
      database.createObjectStore(RECORDS, { autoIncrement: true }).createIndex("key", "key", { unique: true });
      database.createObjectStore(DAYS, { keyPath: "day" });
      if (transaction && database.objectStoreNames.contains(RECORDS_1)) upgrade(database, transaction, keyed);
    };
    return new DatabaseStorage(await openDatabase(DATABASE, 3, create, blocked));
  }

  async latest(count: number): Promise<StoredRecord[]> {
    const records = this.database.transaction(RECORDS, "readonly").objectStore(RECORDS);
    return resultOf(records.getAll(await rangeOfLast(records, count)) as IDBRequest<StoredRecord[]>);
  }

  async *parts(): AsyncGenerator<StoredRecord[]> {
    // The records that were not read yet; `null` for all.
    let range: IDBKeyRange | null = null;
    for (;;) {
      const records = this.database.transaction(RECORDS, "readonly").objectStore(RECORDS);
      const [values, keys] = await Promise.all([
        resultOf(records.getAll(range, PART_RECORDS) as IDBRequest<StoredRecord[]>),
        resultOf(records.getAllKeys(range, PART_RECORDS)),
      ]);
      if (values.length === 0) return;
      yield values;
      range = IDBKeyRange.lowerBound(keys[keys.length - 1], true);
    }
  }

  days(): Promise<DayTotals[]> {
    return resultOf(this.database.transaction(DAYS, "readonly").objectStore(DAYS).getAll() as IDBRequest<DayTotals[]>);
  }

  async add(records: readonly NewRecord[]): Promise<void> {
    // An acknowledgement lets the insole delete a record, so the record must be on the disk before the promise resolves.
    const transaction = this.database.transaction([RECORDS, DAYS], "readwrite", { durability: "strict" });
    const [stored, days] = [transaction.objectStore(RECORDS).index("key"), transaction.objectStore(DAYS)];
    const found = await Promise.all(records.map(({ key }) => resultOf(stored.getKey(key))));
    const added = records.filter((_, i) => found[i] === undefined);
    const totals = new Map<string, DayTotals>();
    for (const day of new Set(added.map(({ load }) => load.day))) {
      const before = await resultOf(days.get(day) as IDBRequest<DayTotals | undefined>);
      if (before) totals.set(day, before);
    }
    for (const record of added) {
      store(transaction, record);
      addLoad(totals, record.load);
    }
    for (const day of totals.values()) days.put(day);
    await committed(transaction);
  }

  async clear(): Promise<void> {
    const transaction = this.database.transaction([RECORDS, DAYS], "readwrite");
    for (const name of [RECORDS, DAYS]) transaction.objectStore(name).clear();
    await committed(transaction);
  }
}

/** Adds a record without its load, which the totals of its day contain. */
function store(transaction: IDBTransaction, { key, message, start_unix_s, is_comparable }: NewRecord): void {
  transaction.objectStore(RECORDS).add({ key, message, start_unix_s, is_comparable });
}

/**
 * Gives the last records of version 2 of the database their present keys: in that version, a key was the whole message in
 * hexadecimal digits. Earlier records cannot arrive again, and to change them all would take minutes. A record that cannot be
 * changed, as on a full disk, remains as it is.
 */
async function shortenKeys(transaction: IDBTransaction, keyed: (record: StoredRecord) => NewRecord | undefined): Promise<void> {
  const store = transaction.objectStore(RECORDS);
  const range = await rangeOfLast(store, CONVERTED);
  const [records, places] = await Promise.all([
    resultOf(store.getAll(range) as IDBRequest<StoredRecord[]>),
    resultOf(store.getAllKeys(range)),
  ]);
  for (const [i, record] of records.entries()) {
    const key = keyed(record)?.key;
    if (key !== undefined) store.put({ ...record, key }, places[i]).onerror = (event) => event.preventDefault();
  }
}

/** Moves the records of version 1 of the database to the present version. */
function upgrade(database: IDBDatabase, transaction: IDBTransaction, keyed: (record: StoredRecord) => NewRecord | undefined): void {
  const keys = new Set<string>();
  const days = new Map<string, DayTotals>();
  const request = transaction.objectStore(RECORDS_1).openCursor();
  request.onsuccess = () => {
    const cursor = request.result;
    if (cursor) {
      const record = keyed(cursor.value as StoredRecord);
      if (!record) transaction.objectStore(RECORDS).add(cursor.value);
      // If two pages were open in one browser, they may have stored a record twice.
      else if (!keys.has(record.key)) {
        keys.add(record.key);
        addLoad(days, record.load);
        store(transaction, record);
      }
      cursor.continue();
      return;
    }
    for (const totals of days.values()) transaction.objectStore(DAYS).put(totals);
    database.deleteObjectStore(RECORDS_1);
  };
}

/** The totals of the days of these records, oldest first. */
function totalsOf(records: readonly NewRecord[]): DayTotals[] {
  const days = new Map<string, DayTotals>();
  for (const { load } of records) addLoad(days, load);
  return [...days.values()].sort((a, b) => a.day.localeCompare(b.day));
}

/** The range of the last `count` records; `null`, which stands for all records, if there are at most `count`. */
function rangeOfLast(records: IDBObjectStore, count: number): Promise<IDBKeyRange | null> {
  return new Promise((resolve, reject) => {
    const request = records.openKeyCursor(null, "prev");
    let is_advanced = false;
    request.onsuccess = () => {
      const cursor = request.result;
      if (!cursor || is_advanced) return resolve(cursor && IDBKeyRange.lowerBound(cursor.key, true));
      is_advanced = true;
      cursor.advance(count);
    };
    request.onerror = () => reject(failureOf(request.error));
  });
}
