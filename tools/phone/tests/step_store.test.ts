import { beforeAll, expect, test } from "vitest";
import type { RecordMessage } from "../src/session";
import { type NewRecord, type StoredRecord, TemporaryStorage } from "../src/record_storage";
import { StepStore, newestFirst } from "../src/step_store";
import type { Wire } from "../src/wire";
import { loadWire, messagesOf } from "./wire";

type StepMessage = Extract<RecordMessage, { kind: "step" }>;

let wire: Wire;
/** The steps of the computed walk, decoded and as messages. */
let received: [StepMessage, Uint8Array][];
beforeAll(async () => {
  wire = await loadWire();
  received = [0, 1].flatMap(messagesOf).flatMap((message) => {
    const decoded = wire.decode(message);
    return decoded?.kind === "step" ? [decodeStep(message)] : [];
  });
});

function decodeStep(message: Uint8Array): [StepMessage, Uint8Array] {
  const decoded = wire.decode(message);
  if (decoded?.kind !== "step") throw new Error("The message is not a step.");
  return [decoded, message];
}

class TestStorage extends TemporaryStorage {
  is_full = false;
  /** Runs before the records are read. */
  before_reading = (): Promise<void> => Promise.resolve();

  override async *parts(): AsyncGenerator<StoredRecord[]> {
    await this.before_reading();
    yield* super.parts();
  }

  override async add(records: readonly NewRecord[]): Promise<void> {
    if (this.is_full) throw new Error("full");
    await super.add(records);
  }
}

test("a step is stored once, however often it is repeated", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  for (const _ of [1, 2, 3]) for (const [step, message] of received) await store.add(step, message, null);
  expect(store.latest.steps.map(({ step }) => step)).toEqual(received.map(([{ step }]) => step));
  expect(storage.records.size).toBe(received.length);
});

test("a step that is repeated after many of the other foot is stored once", async () => {
  const store = new StepStore(wire, new TestStorage());
  const [first, message] = received[0]!;
  await store.add(first, message, null);
  const count = 2 * wire.facts.record_queue + 1;
  for (let number = 0; number < count; number++) {
    const other: StepMessage = { ...first, key: `right ${number}`, step: { ...first.step, side: "right", step: number } };
    await store.add(other, message, null);
  }
  await store.add(first, message, null);
  expect(store.latest.steps).toHaveLength(1 + count);
});

test("the steps of a recording that is played in a loop are counted once, however many they are", async () => {
  const store = StepStore.ofRecording(wire);
  const [[step, message]] = received as [[StepMessage, Uint8Array]];
  const count = 10 * wire.facts.record_queue;
  for (let i = 0; i < 3 * count; i++) await store.add({ ...step, key: `${i % count}` }, message, null);
  expect(store.latest.steps).toHaveLength(count);
  expect(store.count("steps")).toBe(count);
});

test("stored steps are loaded at the next visit, and their repetitions are ignored", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  for (const [step, message] of received) await store.add(step, message, null);
  const next = new StepStore(wire, storage);
  await next.load();
  expect(next.latest).toEqual(store.latest);
  for (const [step, message] of received) await next.add(step, message, null);
  expect(next.latest.steps).toHaveLength(received.length);
});

test("a step that cannot be stored is reported, is shown once, and is stored when it is repeated", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [first, message] = received[0]!;
  storage.is_full = true;
  await expect(store.add(first, message, null)).rejects.toThrow("full");
  storage.is_full = false;
  await store.add(first, message, null);
  expect(store.latest.steps).toHaveLength(1);
  expect(storage.records.size).toBe(1);
});

test("a step that cannot be stored delays the following steps", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [one, other] = received;
  storage.is_full = true;
  await expect(store.add(...one!, null)).rejects.toThrow("full");
  await expect(store.add(...other!, null)).rejects.toThrow("full");
  storage.is_full = false;
  // The acknowledgement of the later step covers both.
  await store.add(...other!, null);
  expect([...storage.records.values()].map(({ message }) => message)).toEqual([one![1], other![1]]);
  expect(store.latest.steps).toHaveLength(2);
});

test("a step that is repeated after a restart of the insole is recognised", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [, message] = received[0]!;
  await store.add(...decodeStep(message), null);
  // The last three bytes of the message are the number of boots since the step (0), the absent start time, and the regions
  // whose tissue has changed.
  expect([...message.slice(-3)]).toEqual([0, 0, 0]);
  const [repeated, bytes] = decodeStep(Uint8Array.of(...message.slice(0, -3), 1, 0, 0));
  expect(repeated.step.boots_since).toBe(1);
  await store.add(repeated, bytes, null);
  expect(storage.records.size).toBe(1);
  // Here the fourth byte from the end differs. It belongs to the counted area of the last region, so this is another step.
  const [other, other_bytes] = decodeStep(Uint8Array.of(...message.slice(0, -4), 1, 0, 0, 0));
  await store.add(other, other_bytes, null);
  expect(storage.records.size).toBe(2);
});

test("a step that two pages received is stored and counted once", async () => {
  const storage = new TestStorage();
  for (const _ of [1, 2]) {
    const store = new StepStore(wire, storage);
    for (const [step, message] of received) await store.add(step, message, null);
  }
  expect(storage.records.size).toBe(received.length);
  const next = new StepStore(wire, storage);
  await next.load();
  expect(next.latest.steps).toHaveLength(received.length);
  expect(next.count("steps")).toBe(received.length);
});

test("the totals of a day are those of its steps, also at the next visit", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const noon = (day: number) => new Date(2026, 0, day, 12).getTime() / 1000;
  // The steps alternate between two days.
  for (const [i, [step, message]] of received.entries()) await store.add(step, message, noon(1 + (i % 2)));
  const next = new StepStore(wire, storage);
  await next.load();
  for (const days of [store.days, next.days]) {
    expect([...days.keys()].sort()).toEqual(["2026-01-01", "2026-01-02"]);
    for (const [i, day] of ["2026-01-01", "2026-01-02"].entries()) {
      for (const side of ["left", "right"] as const) {
        const feet = received.filter(([{ step }], n) => n % 2 === i && step.side === side).map(([{ step }]) => step.foot);
        const totals = days.get(day)![side];
        expect(totals.steps).toBe(feet.length);
        expect(totals.integral_n_s).toBeCloseTo(feet.reduce((sum, foot) => sum + foot.foot_force_integral_n_s, 0), 6);
        expect(totals.peak_n).toBe(Math.max(...feet.map((foot) => foot.foot_force_peak_n)));
      }
    }
  }
});

test("all records are read in parts, and the oldest ones do not remain in memory", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [[step, message]] = received as [[StepMessage, Uint8Array]];
  // Only the keys of these steps differ.
  const count = 2500;
  for (let i = 0; i < count; i++) await store.add({ ...step, key: `${i}` }, message, i);
  expect(store.latest.steps.length).toBeLessThan(2000);
  expect(store.latest.steps.at(-1)?.start_unix_s).toBe(count - 1);
  expect(store.count("steps", [step.step.side])).toBe(count);
  const starts: (number | null)[] = [];
  for await (const { steps } of store.parts()) starts.push(...steps.map(({ start_unix_s }) => start_unix_s));
  expect(starts).toEqual(Array.from({ length: count }, (_, i) => i));
});

/** A store with the first received step, and its storage, which was full when the second one arrived. */
async function storeWithPendingStep() {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [one, other] = received;
  await store.add(...one!, null);
  storage.is_full = true;
  await expect(store.add(...other!, null)).rejects.toThrow("full");
  return { storage, store, one, other };
}

test("a step that cannot be stored is stored by a later attempt, although no further step arrives", async () => {
  const { storage, store } = await storeWithPendingStep();
  await expect(store.retry()).rejects.toThrow("full");
  storage.is_full = false;
  await store.retry();
  expect(storage.records.size).toBe(2);
});

test("a step that cannot be stored is exported with the others", async () => {
  const { store, one, other } = await storeWithPendingStep();
  const exported: unknown[] = [];
  for await (const { steps } of store.parts()) exported.push(...steps.map(({ step }) => step));
  expect(exported).toEqual([one![0].step, other![0].step]);
});

test("a step that is stored during an export is exported once, before and after the last part is read", async () => {
  for (const is_stored_before of [true, false]) {
    const { storage, store, one, other } = await storeWithPendingStep();
    storage.is_full = false;
    if (is_stored_before) storage.before_reading = () => store.add(...other!, null);
    const exported: unknown[] = [];
    for await (const { steps } of store.parts()) {
      exported.push(...steps.map(({ step }) => step));
      await store.add(...other!, null);
    }
    expect(exported).toEqual([one![0].step, other![0].step]);
    expect(storage.records.size).toBe(2);
  }
});

test("a record that arrives while the records are loaded again is shown once", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [[first, first_message], [second, second_message]] = [received[0]!, received[1]!];
  await store.add(first, first_message, null);
  storage.is_full = true;
  // Another tab has deleted the first step. The second one arrives meanwhile, and cannot be stored yet.
  storage.records.clear();
  const reload = store.reload();
  await expect(store.add(second, second_message, null)).rejects.toThrow("full");
  await reload;
  expect(store.latest.steps.map(({ step }) => step)).toEqual([second.step]);
  expect(store.count("steps")).toBe(1);
});

test("a record that is stored after the records were loaded again is shown and counted once", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [step, message] = received[0]!;
  const reload = store.reload();
  const added = store.add(step, message, null);
  await Promise.all([reload, added]);
  expect([store.latest.steps.length, store.count("steps"), storage.records.size]).toEqual([1, 1, 1]);
});

test("records are shown in the order of their times, and one without a time after the one that arrived before it", () => {
  // After an absence, the records of the two feet arrive one foot after the other.
  const times = [30, 10, null, 40, 20, null, 20, 35];
  const arrived = times.map((start_unix_s, number) => ({ number, start_unix_s }));
  expect(newestFirst(arrived).map(({ number }) => number)).toEqual([3, 7, 0, 6, 5, 4, 2, 1]);
  expect(arrived.map(({ start_unix_s }) => start_unix_s)).toEqual(times);
  const untimed = [0, 1].map((number) => ({ number, start_unix_s: null }));
  expect(newestFirst(untimed).map(({ number }) => number)).toEqual([1, 0]);
});
