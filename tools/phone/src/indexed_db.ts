/** Wraps operations of the browser's database (IndexedDB) in promises. */

/** The error to report for a failed operation. `error` is the browser's reason; `null` if it states none. */
export const failureOf = (error: DOMException | null) => error ?? new Error("The browser's database failed.");

/** Resolves with the result of a request. */
export function resultOf<T>(request: IDBRequest<T>): Promise<T> {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(failureOf(request.error));
  });
}

/** Resolves when the changes of a transaction are stored. */
export function committed(transaction: IDBTransaction): Promise<void> {
  return new Promise((resolve, reject) => {
    transaction.oncomplete = () => resolve();
    transaction.onabort = () => reject(failureOf(transaction.error));
  });
}

/**
 * Opens a database. `upgrade` creates its stores if the stored version is older or if there is none. Another tab with an older
 * version of the page can block the upgrade until that tab is closed: `blocked` is then called with true. It is always called
 * with false when the attempt to open the database has ended.
 */
export async function openDatabase(
  name: string,
  version: number,
  upgrade: (request: IDBOpenDBRequest) => void,
  blocked: (is_blocked: boolean) => void,
): Promise<IDBDatabase> {
  // `indexedDB.open` throws if the browser stores nothing for this site. In an async function, the error rejects the promise.
  const request = indexedDB.open(name, version);
  request.onupgradeneeded = () => upgrade(request);
  request.onblocked = () => blocked(true);
  const database = await resultOf(request).finally(() => blocked(false));
  // A page of a newer version can upgrade the database only once this page has closed it.
  database.onversionchange = () => database.close();
  return database;
}
