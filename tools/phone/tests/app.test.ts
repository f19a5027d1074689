import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { App } from "../src/app";
import type { Step } from "../src/generated/quantities";
import { NOT_DELETED } from "../src/identify_controller";
import { DatabaseStorage, type NewRecord, TemporaryStorage } from "../src/record_storage";
import { StepStore } from "../src/step_store";
import { drawSteps } from "../src/steps_view";
import { BluetoothTransport } from "../src/transport/bluetooth";
import { WebSocketTransport } from "../src/transport/websocket";
import { element } from "./elements";
import { loadWire, messagesOf, step } from "./wire";

vi.mock("../src/dom", async () => (await import("./elements")).dom);
vi.mock("../src/live_view");
vi.mock("../src/steps_view");

const wire = await loadWire();

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("document", { hidden: true });
  vi.stubGlobal("navigator", {});
  for (const name of ["HTMLButtonElement", "HTMLInputElement"]) vi.stubGlobal(name, Object);
});

afterEach(() => {
  vi.restoreAllMocks();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

/** A storage that can be full. */
class TestStorage extends TemporaryStorage {
  is_full = true;

  override async add(records: readonly NewRecord[]): Promise<void> {
    if (this.is_full) throw new Error("full");
    await super.add(records);
  }
}

/** A page with an insole that has sent its steps, which could not be stored. */
async function start() {
  const app = new App(wire);
  const storage = new TestStorage();
  app["store"] = new StepStore(wire, storage);
  const sent: Uint8Array[] = [];
  const send = (_: unknown, message: Uint8Array) => sent.push(message);
  const use = () => {
    const transport = { location: "", is_replay: false, can_lose_records: true, send, close: () => undefined };
    app["insoles"].use(transport);
    app["insoles"].transportEvents.opened(0);
  };
  /** Calls `tick` for these seconds. */
  const tick = async (duration_s: number) => {
    for (let i = 0; i < 10 * duration_s; i++) {
      app["tick"]();
      await vi.advanceTimersByTimeAsync(100);
    }
  };
  /** The acknowledgements since the last call. */
  const acknowledged = () => sent.splice(0).filter(([kind]) => kind === wire.acknowledge(0)[0]);
  use();
  messagesOf(0).forEach((message) => app["insoles"].transportEvents.message(0, message));
  await tick(7);
  expect(app["problem"]).toMatch(/cannot store steps.*alerts may not arrive/);
  expect(acknowledged()).toEqual([]);
  return { app, storage, use, tick, acknowledged };
}

test("steps that could not be stored are stored and acknowledged later, although no further step arrives", async () => {
  const { app, storage, tick, acknowledged } = await start();
  storage.is_full = false;
  await tick(5);
  // The computed walk has six steps of each foot.
  expect([storage.records.size, acknowledged()]).toEqual([6, [wire.acknowledge(5)]]);
  expect(app["problem"]).toBe("");
  await tick(10);
  expect(acknowledged()).toEqual([]);
});

test("steps of an insole that is no longer connected are stored, but not acknowledged to another one", async () => {
  const { storage, use, tick, acknowledged } = await start();
  use();
  storage.is_full = false;
  await tick(5);
  expect([storage.records.size, acknowledged()]).toEqual([6, []]);
});

test("while an insole is to answer to new parameters, no rules of alerts are sent, because a refusal does not name its request", async () => {
  const { app } = await start();
  const sends_rules = vi.spyOn(app["alerts"], "followTimeZone");
  const awaits_answer = vi.spyOn(app["identify"], "awaits_answer", "get").mockReturnValue(true);
  app["tick"]();
  expect(sends_rules).not.toHaveBeenCalled();
  awaits_answer.mockReturnValue(false);
  app["tick"]();
  expect(sends_rules).toHaveBeenCalledOnce();
});

test("the steps are deleted although those of an identification in another tab remain, and the wearer is informed", async () => {
  const { app, storage, tick } = await start();
  storage.is_full = false;
  await tick(5);
  const items = new Map<string, string>();
  vi.stubGlobal("localStorage", { setItem: (key: string, value: string) => items.set(key, value), getItem: () => null });
  vi.spyOn(app["identify"], "deleteStored").mockRejectedValue(new Error(NOT_DELETED));
  await expect(app["clear"]()).rejects.toThrow(NOT_DELETED);
  expect([storage.records.size, items.has("plantar.cleared_ms")]).toEqual([0, true]);
});

test("a deletion is confirmed, with what the insoles still count", async () => {
  const { app } = await start();
  vi.stubGlobal("localStorage", { setItem: () => undefined, getItem: () => null });
  vi.spyOn(app["identify"], "deleteStored").mockResolvedValue();
  await app["clear"]();
  expect(app["problem"]).toMatch(/^All steps and loads on this device are deleted\. The insoles still count the load of today/);
});

test("steps that were walked without this device are marked as having inexact times", async () => {
  const { app, storage } = await start();
  storage.is_full = false;
  const session = app["insoles"].sessions[0]!;
  session.clock_mapping.clear();
  /** The insole answers requests for its time, which were sent after its hello. */
  const answer = (count: number) => {
    const time = { kind: "time", host_us: session["clock_since_us"], device_us: 7200e6 } as const;
    const decode = vi.spyOn(wire, "decode").mockReturnValue(time);
    for (let i = 0; i < count; i++) session.receive(new Uint8Array(1), performance.now());
    decode.mockRestore();
  };
  const receive = (values: Partial<Step>) => {
    const walked = step({ step: 100, ...values });
    app["onRecord"]({ kind: "step", key: JSON.stringify(values), step: walked }, new Uint8Array(1), session);
  };
  // A single request may have been delayed.
  answer(1);
  receive({ start_s: 7198 });
  answer(2);
  // Two hours ago; one second ago; before a restart of the insole.
  const later: Partial<Step>[] = [{ start_s: 0 }, { start_s: 7199 }, { start_s: 7199, boots_since: 1, start_unix_s: 1.8e9 }];
  later.forEach(receive);
  await vi.advanceTimersByTimeAsync(1);
  const expected = [false, false, true, false];
  expect(app["store"].latest.steps.slice(-4).map(({ is_comparable }) => Boolean(is_comparable))).toEqual(expected);
  const stored = [...storage.records.values()].slice(-4);
  expect(stored.map(({ is_comparable }) => Boolean(is_comparable))).toEqual(expected);
});

test("an insole that is connected while a recording is loading does not lose its steps", async () => {
  const storage = new TestStorage();
  storage.is_full = false;
  const opened = vi.spyOn(DatabaseStorage, "open").mockResolvedValue(storage as unknown as DatabaseStorage);
  vi.stubGlobal("fetch", () => new Promise(() => undefined));
  vi.stubGlobal("location", { search: "?replay=slow.plantar" });
  // The page is not in a frame.
  vi.stubGlobal("window", { get top() { return this; } });
  const app = new App(wire);
  vi.spyOn(app as unknown as { listen(): void }, "listen").mockReturnValue();
  vi.spyOn(app["identify"], "load").mockResolvedValue();
  await app.start();
  const prototype = BluetoothTransport.prototype;
  vi.spyOn(prototype, "choose").mockResolvedValue({} as BluetoothDevice);
  let is_opened = false;
  vi.spyOn(prototype, "connect").mockImplementation(async () => void (is_opened = opened.mock.calls.length === 1));
  const send = vi.spyOn(prototype, "send");
  await app["bluetooth"]();
  expect(is_opened).toBe(true);
  const events = app["insoles"].transportEvents;
  events.opened(0);
  messagesOf(0).forEach((message) => events.message(0, message));
  await vi.advanceTimersByTimeAsync(2000);
  expect(storage.records.size).toBe(6);
  expect(send).toHaveBeenCalledWith(0, wire.acknowledge(5));
});

test("a new version of the page is offered with a warning over Bluetooth, and not during a guided session", () => {
  const app = new App(wire);
  element("alert").hidden = true;
  Object.assign(app["live_view"], { saturated: [], pictures: { left: {}, right: {} } });
  app["has_update"] = true;
  const note = () => {
    app["update"](0);
    return element("notes").content;
  };
  expect(note()).toContain('A new version of this page is ready.",["button"');
  const transport = Object.assign(Object.create(BluetoothTransport.prototype), { insoles: new Map([[0, {}]]), close: () => undefined });
  app["insoles"].transport = transport;
  expect(note()).toContain("ready. Reloading ends the connection: choose your insoles again afterwards.");
  app["identify"]["session"].phase = "stand";
  expect(note()).not.toContain("A new version");
});

test("while plantar serve has never answered, the page offers Bluetooth and the example walk", () => {
  const app = new App(wire);
  element("alert").hidden = true;
  Object.assign(app["live_view"], { saturated: [], pictures: { left: {}, right: {} } });
  const transport = Object.assign(Object.create(WebSocketTransport.prototype), { send: () => undefined, close: () => undefined });
  vi.spyOn(app as unknown as { showPersistence(): Promise<void> }, "showPersistence").mockResolvedValue();
  app["use"](transport);
  const { opened, closed, message } = app["insoles"].transportEvents;
  const is_hidden = () => {
    app["update"](0);
    return element("start").hidden;
  };
  expect(is_hidden()).toBe(true);
  for (const insole of [0, 1] as const) closed(insole, "plantar serve does not answer");
  expect(is_hidden()).toBe(false);
  opened(0);
  expect(is_hidden()).toBe(true);
  message(0, messagesOf(0)[0]!);
  for (const insole of [0, 1] as const) closed(insole, "plantar serve does not answer");
  expect(is_hidden()).toBe(true);
});

test("the wearer's stride length gives no speed to a recording, and its steps are not counted as stored", () => {
  const app = new App(wire);
  app["settings"].stride_cm = 150;
  const gait = vi.spyOn(wire, "gait");
  const drawn = (is_replay: boolean) => {
    Object.assign(app["insoles"], { transport: { is_replay } });
    app["stepsChanged"]();
    return [gait.mock.lastCall?.[2], vi.mocked(drawSteps).mock.lastCall?.[2]];
  };
  expect([drawn(true), drawn(false)]).toEqual([[0, undefined], [1.5, 0]]);
});

test("a text that only contains the word reload has no button that reloads the page", () => {
  const app = new App(wire);
  element("alert").hidden = true;
  Object.assign(app["live_view"], { saturated: [], pictures: { left: {}, right: {} } });
  const buttons = (problem: string) => {
    app["problem"] = problem;
    app["update"](0);
    return element("notes").content.includes('"data-action":"reload"');
  };
  expect([buttons("Flash: reload of page 3 failed."), buttons("It failed. Reload the page and try again.")]).toEqual([false, true]);
});
