/**
 * Texts that the browser stores for this site. `storage` may throw, as `localStorage` does if the browser stores nothing for this
 * site.
 */

/** The text under a key; `null` without one. */
export function stored(storage: () => Storage, key: string): string | null {
  try {
    return storage().getItem(key);
  } catch {
    return null;
  }
}

/** Stores a text under a key. If the browser does not allow it, the text is lost with the page. */
export function store(storage: () => Storage, key: string, text: string): void {
  try {
    storage().setItem(key, text);
  } catch {
    // The page continues without it.
  }
}
