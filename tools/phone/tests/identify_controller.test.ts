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

/** The Web Locks of a browser, which its tabs share. */
class FakeLocks {
  private readonly held = new Set<string>();
  query = async () => ({ held: [...this.held].map((name) => ({ name })) });
  request = async (name: string, _options: { ifAvailable: true }, act: (lock: object | null) => unknown): Promise<void> => {
    await undefined;
    if (this.held.has(name)) return void act(null);
    this.held.add(name);
    await act({ name });
    this.held.delete(name);
  };
}

/** The messages of a guided session that the browser stores. */
let stored: Uint8Array<ArrayBuffer>[];

beforeEach(() => {
  stored = [Uint8Array.of(1)];
  const storage = { load: async () => stored, add: async () => undefined, clear: async () => void (stored = []) };
  vi.spyOn(DatabaseIdentifyStorage, "open").mockResolvedValue(storage as unknown as DatabaseIdentifyStorage);
  vi.stubGlobal("document", { body: { dataset: {} }, querySelector: () => null, querySelectorAll: () => [] });
  vi.stubGlobal("window", {});
  // A browser without Web Locks.
  vi.stubGlobal("navigator", {});
  vi.stubGlobal("scrollTo", () => undefined);
  vi.stubGlobal("history", { pushState: () => undefined });
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
  // A page that is opened later replaces the handler.
  const { onclick } = element("identify-body");
  const act = (action: string) => onclick({ target: new Button({ action }) });
  return { controller, act };
}

test("an interrupted session is deleted together with the other data of the page", async () => {
  const { controller } = await load();
  await controller.deleteStored();
  expect([controller.has_stored, stored]).toEqual([false, []]);
});

test("the button in the settings names an interrupted session", async () => {
  const { controller } = await load();
  controller.tick(0);
  expect(element("identify-open").content).toContain("Continue the identification");
  await controller.deleteStored();
  controller.tick(0);
  expect(element("identify-open").content).toContain("Identify my tissue");
});

test("an accidental touch does not end the walk before it has all steps", async () => {
  const { controller, act } = await load();
  const finish = vi.spyOn(controller["session"], "finishWalk").mockReturnValue();
  const confirm = vi.fn(() => false);
  vi.stubGlobal("confirm", confirm);
  act("finish");
  expect([confirm.mock.calls.length, finish.mock.calls.length]).toEqual([1, 0]);
  confirm.mockReturnValue(true);
  act("finish");
  expect(finish).toHaveBeenCalledOnce();
});

test("an interrupted session that another tab has deleted is no longer offered", async () => {
  const { controller } = await load();
  stored = [];
  await controller.reload();
  expect(controller.has_stored).toBe(false);
});

test("the wearer can delete an interrupted session while no insole is connected", async () => {
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

test("a session of another tab can be neither continued nor deleted, and what remains of it is offered later", async () => {
  vi.stubGlobal("navigator", { locks: new FakeLocks() });
  const insole = { state: "live", insole: 0, rate_hz: () => 100, hello: { rate_hz: 100 } };
  const first = await load(insole);
  first.act("start");
  await vi.waitFor(() => expect(stored).toEqual([]));
  // The first tab stores the messages of its session.
  stored = [Uint8Array.of(2)];
  delete document.body.dataset["view"];
  const second = await load(insole);
  expect(document.body.dataset["view"]).toBeUndefined();
  document.body.dataset["view"] = "identify";
  let now_ms = 0;
  const offered = () => {
    second.controller.tick((now_ms += 1000));
    return element("identify-body").content;
  };
  expect(offered()).toContain("An identification is open in another tab.");
  expect(offered()).not.toContain('"data-action"');
  for (const action of ["start", "resume", "discard"]) second.act(action);
  await expect(second.controller.deleteStored()).rejects.toThrow("in another tab were not deleted");
  expect([stored, second.controller["session"].phase]).toEqual([[Uint8Array.of(2)], "closed"]);
  first.act("close");
  stored = [Uint8Array.of(3)];
  first.controller.tick(1000);
  await vi.waitFor(() => expect(offered()).toContain('"data-action":"resume"'));
  expect(second.controller["stored"]).toEqual(stored);
  second.act("resume");
  await vi.waitFor(() => expect(second.controller["session"].phase).toBe("walk"));
  first.controller.tick(2000);
  await vi.waitFor(() => expect(first.controller["is_elsewhere"]).toBe(true));
});

test("a session begins without the lock in a browser that does not allow Web Locks", async () => {
  const denied = () => Promise.reject(new Error("denied"));
  vi.stubGlobal("navigator", { locks: { query: denied, request: denied } });
  const { controller, act } = await load({ state: "live", insole: 0 });
  act("start");
  expect(controller["session"].phase).toBe("stand");
});

test("a session holds the lock until it is closed, and the next one of the same tab begins", async () => {
  vi.stubGlobal("navigator", { locks: new FakeLocks() });
  const { controller, act } = await load({ state: "live", insole: 0 });
  for (const _ of [1, 2]) {
    act("start");
    await vi.waitFor(() => expect(controller["session"].phase).toBe("stand"));
    controller.tick(1000);
    expect((await navigator.locks.query()).held).toHaveLength(1);
    act("close");
  }
  controller.tick(3000);
  await vi.waitFor(async () => expect((await navigator.locks.query()).held).toEqual([]));
  expect(controller["is_elsewhere"]).toBe(false);
});

test("after a second click on a button, the session is still known as that of this tab", async () => {
  vi.stubGlobal("navigator", { locks: new FakeLocks() });
  const { controller, act } = await load({ state: "live", insole: 0 });
  for (const _ of [1, 2]) act("resume");
  await vi.waitFor(() => expect(controller["session"].phase).toBe("walk"));
  expect([controller["is_elsewhere"], controller["is_holding"]]).toEqual([false, true]);
});

test("a session is resumed from the messages that are stored at that moment, and is not resumed without any", async () => {
  vi.stubGlobal("navigator", { locks: new FakeLocks() });
  const { controller, act } = await load({ state: "live", insole: 0 });
  stored = [];
  act("resume");
  await vi.waitFor(() => expect([controller.has_stored, controller["is_holding"]]).toEqual([false, false]));
  expect(controller["session"].phase).toBe("closed");
  const other = await (stored = [Uint8Array.of(1)], load({ state: "live", insole: 0 }));
  stored = [Uint8Array.of(1), Uint8Array.of(2)];
  other.act("resume");
  await vi.waitFor(() => expect(other.controller["session"].file()).toEqual(stored));
});

test("a session begins without the lock if the request for the lock is denied", async () => {
  const request = () => Promise.reject(new Error("denied"));
  vi.stubGlobal("navigator", { locks: { query: async () => ({ held: [] }), request } });
  const { controller, act } = await load({ state: "live", insole: 0 });
  act("start");
  await vi.waitFor(() => expect(controller["session"].phase).toBe("stand"));
});

test("without Web Locks, the messages of another tab are not offered as those of an interrupted session", async () => {
  const { controller } = await load();
  await controller.deleteStored();
  stored = [Uint8Array.of(2)];
  await controller.reload();
  expect(controller.has_stored).toBe(false);
});
