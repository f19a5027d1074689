import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { IdentifyController } from "../src/identify_controller";
import { DatabaseIdentifyStorage } from "../src/identify_storage";
import type { Side } from "../src/generated/quantities";
import type { Insoles } from "../src/insoles";
import { loadSettings } from "../src/settings";
import { element } from "./elements";

vi.mock("../src/dom", async () => (await import("./elements")).dom);

/** A button of the view, as the target of a click. */
class Button {
  constructor(readonly dataset: { action: string }) {}
  closest = () => this;
}

/** The stored messages of a session that the browser stores. */
let stored: Uint8Array<ArrayBuffer>[];

beforeEach(() => {
  stored = [Uint8Array.of(1)];
  const storage = { load: async () => stored, add: async () => undefined, clear: async () => void (stored = []) };
  vi.spyOn(DatabaseIdentifyStorage, "open").mockResolvedValue(storage as unknown as DatabaseIdentifyStorage);
  vi.stubGlobal("document", { body: { dataset: {} }, querySelectorAll: () => [] });
  vi.stubGlobal("window", {});
  vi.stubGlobal("scrollTo", () => undefined);
  vi.stubGlobal("confirm", () => true);
  vi.stubGlobal("Element", Button);
  vi.stubGlobal("Worker", class { postMessage = () => undefined; });
});

afterEach(() => {
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
});

/** A controller that has loaded the interrupted session, and a function that clicks a button of its view. */
async function load(session?: { state: string; insole: number }) {
  const of = (side: Side) => (side === "left" ? session : undefined);
  const insoles = { sessions: [], of, hellos: new Map([[0, new Uint8Array(1)]]) } as unknown as Insoles;
  const controller = new IdentifyController(insoles, loadSettings(() => ({ getItem: () => null }) as unknown as Storage));
  await controller.load(() => undefined);
  expect(controller.has_stored).toBe(true);
  const act = (action: string) => element("identify-body").onclick({ target: new Button({ action }) });
  return { controller, act };
}

test("an interrupted session is deleted on request of the page", async () => {
  const { controller } = await load();
  await controller.deleteStored();
  expect([controller.has_stored, stored]).toEqual([false, []]);
});

test("an interrupted session that another tab has deleted is no longer offered", async () => {
  const { controller } = await load();
  stored = [];
  await controller.reload();
  expect(controller.has_stored).toBe(false);
});

test("the wearer deletes an interrupted session without an insole", async () => {
  const { controller, act } = await load();
  act("discard");
  await vi.waitFor(() => expect([controller.has_stored, stored]).toEqual([false, []]));
});

test("the messages of a running session are not deleted", async () => {
  const { controller, act } = await load({ state: "live", insole: 0 });
  act("start");
  stored = [Uint8Array.of(2)];
  await controller.deleteStored();
  expect(stored).toEqual([Uint8Array.of(2)]);
});

test("a session does not begin without an insole", async () => {
  const { controller, act } = await load();
  act("start");
  expect([controller.has_stored, stored.length]).toEqual([true, 1]);
});
