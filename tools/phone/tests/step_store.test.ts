import { beforeAll, expect, test } from "vitest";
import type { RecordMessage } from "../src/session";
import type { StepRecord, StepStorage } from "../src/step_storage";
import { StepStore } from "../src/step_store";
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

class TestStorage implements StepStorage {
  records: StepRecord[] = [];
  is_full = false;
  load = () => Promise.resolve(this.records);
  add = async (record: StepRecord) => {
    if (this.is_full) throw new Error("full");
    this.records.push(record);
  };
  clear = () => Promise.resolve(void (this.records = []));
}

test("a step is stored once, however often it is repeated", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  for (const _ of [1, 2, 3]) for (const [step, message] of received) await store.add(step, message, null);
  expect(store.steps.map(({ step }) => step)).toEqual(received.map(([{ step }]) => step));
  expect(storage.records).toHaveLength(received.length);
});

test("stored steps are loaded at the next visit, and their repetitions are ignored", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  for (const [step, message] of received) await store.add(step, message, null);
  const next = new StepStore(wire, storage);
  await next.load();
  expect(next.steps).toEqual(store.steps);
  for (const [step, message] of received) await next.add(step, message, null);
  expect(next.steps).toHaveLength(received.length);
});

test("a step that cannot be stored is reported, is shown once, and is stored when it is repeated", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [first, message] = received[0]!;
  storage.is_full = true;
  await expect(store.add(first, message, null)).rejects.toThrow("full");
  storage.is_full = false;
  await store.add(first, message, null);
  expect(store.steps).toHaveLength(1);
  expect(storage.records).toHaveLength(1);
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
  expect(storage.records.map(({ message }) => message)).toEqual([one![1], other![1]]);
  expect(store.steps).toHaveLength(2);
});

test("a step that is repeated after a restart of the insole is recognised", async () => {
  const storage = new TestStorage();
  const store = new StepStore(wire, storage);
  const [, message] = received[0]!;
  await store.add(...decodeStep(message), null);
  // The last three bytes of the message are the number of boots since the step, which is 0, the absent start time, and the regions
  // whose tissue has changed.
  expect([...message.slice(-3)]).toEqual([0, 0, 0]);
  const [repeated, bytes] = decodeStep(Uint8Array.of(...message.slice(0, -3), 1, 0, 0));
  expect(repeated.step.starts_ago).toBe(1);
  await store.add(repeated, bytes, null);
  expect(storage.records).toHaveLength(1);
  // Here the byte before these three differs. It is the residual force of the last region, so this is another step.
  const [other, other_bytes] = decodeStep(Uint8Array.of(...message.slice(0, -4), 1, 0, 0, 0));
  await store.add(other, other_bytes, null);
  expect(storage.records).toHaveLength(2);
});

test("a step that two pages stored is shown once", async () => {
  const storage = new TestStorage();
  for (const _ of [1, 2]) {
    const store = new StepStore(wire, storage);
    for (const [step, message] of received) await store.add(step, message, null);
  }
  expect(storage.records).toHaveLength(2 * received.length);
  const next = new StepStore(wire, storage);
  await next.load();
  expect(next.steps).toHaveLength(received.length);
});
