import { afterEach, expect, test, vi } from "vitest";
import { DatabaseIdentifyStorage } from "../src/identify_storage";
import { DatabaseStorage } from "../src/record_storage";

afterEach(() => void vi.unstubAllGlobals());

type Blocked = (is_blocked: boolean) => void;

test.each([
  ["steps", (blocked: Blocked) => DatabaseStorage.open(() => undefined, blocked)],
  ["guided sessions", (blocked: Blocked) => DatabaseIdentifyStorage.open(blocked)],
])("the database of %s reports that another tab blocks it, and makes way for a newer version", async (_, open) => {
  const database: { close: () => void; onversionchange?: () => void } = { close: vi.fn() };
  const request: { result: unknown; onblocked?: () => void; onsuccess?: () => void } = { result: database };
  vi.stubGlobal("indexedDB", { open: () => request });
  const reported: boolean[] = [];
  const opened = open((is_blocked) => reported.push(is_blocked));
  request.onblocked?.();
  expect(reported).toEqual([true]);
  request.onsuccess?.();
  await opened;
  expect(reported).toEqual([true, false]);
  database.onversionchange?.();
  expect(database.close).toHaveBeenCalledOnce();
});
