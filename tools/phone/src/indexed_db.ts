/** Promises of the operations of the browser's database. */

/** The error to report for a failed operation. `error` is the browser's reason; `null` if it states none. */
export const failed = (error: DOMException | null) => error ?? new Error("The browser's database failed.");

/** Resolves with the result of a request. */
export function done<T>(request: IDBRequest<T>): Promise<T> {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(failed(request.error));
  });
}

/** Resolves when a transaction is stored. */
export function complete(transaction: IDBTransaction): Promise<void> {
  return new Promise((resolve, reject) => {
    transaction.oncomplete = () => resolve();
    transaction.onabort = () => reject(failed(transaction.error));
  });
}
