import { beforeAll, expect, test } from "vitest";
import { type Kept, type Keeper, StepStore, peakForce } from "../src/steps";
import type { Step, Wire } from "../src/wire";
import { loadWire, messagesOf, step } from "./wire";

let wire: Wire;
let taken: [Step, Uint8Array][];
beforeAll(async () => {
  wire = await loadWire();
  taken = [0, 1].flatMap(messagesOf).flatMap((message): [Step, Uint8Array][] => {
    const decoded = wire.decode(message);
    return decoded?.kind === "step" ? [[decoded.step, message]] : [];
  });
});

class Shelf implements Keeper {
  kept: Kept[] = [];
  is_full = false;
  load = () => Promise.resolve(this.kept);
  add = (kept: Kept) => (this.is_full ? Promise.reject(new Error("full")) : Promise.resolve(void this.kept.push(kept)));
  clear = () => Promise.resolve(void (this.kept = []));
}

test("a step is kept once, however often it is replayed", async () => {
  const shelf = new Shelf();
  const store = new StepStore(wire, shelf);
  for (const _ of [1, 2, 3]) for (const [step, message] of taken) await store.add(step, message, [], null);
  expect(store.steps.map(({ step }) => step)).toEqual(taken.map(([step]) => step));
  expect(shelf.kept).toHaveLength(taken.length);
});

test("what was kept is there at the next visit, and still counts once", async () => {
  const shelf = new Shelf();
  const store = new StepStore(wire, shelf);
  for (const [step, message] of taken) await store.add(step, message, [], null);
  const next = new StepStore(wire, shelf);
  await next.load();
  expect(next.steps).toEqual(store.steps);
  for (const [step, message] of taken) await next.add(step, message, [], null);
  expect(next.steps).toHaveLength(taken.length);
});

test("a step that cannot be kept says so, shows once, and is kept when it comes again", async () => {
  const shelf = new Shelf();
  const store = new StepStore(wire, shelf);
  const [first, message] = taken[0]!;
  shelf.is_full = true;
  await expect(store.add(first, message, [], null)).rejects.toThrow("full");
  shelf.is_full = false;
  await store.add(first, message, [], null);
  expect(store.steps).toHaveLength(1);
  expect(shelf.kept).toHaveLength(1);
});

test("a step that cannot be kept holds up those after it", async () => {
  const shelf = new Shelf();
  const store = new StepStore(wire, shelf);
  const [one, other] = taken;
  shelf.is_full = true;
  await expect(store.add(...one!, [], null)).rejects.toThrow("full");
  await expect(store.add(...other!, [], null)).rejects.toThrow("full");
  shelf.is_full = false;
  // The later one is taken for both.
  await store.add(...other!, [], null);
  expect(shelf.kept.map(({ message }) => message)).toEqual([one![1], other![1]]);
  expect(store.steps).toHaveLength(2);
});

test("a step that comes again from an insole that restarted is known", async () => {
  const shelf = new Shelf();
  const store = new StepStore(wire, shelf);
  const [first, message] = taken[0]!;
  await store.add(first, message, [], null);
  await store.add({ ...first, starts_ago: 1 }, message, [], null);
  expect(shelf.kept).toHaveLength(1);
  await store.add({ ...first, start_s: first.start_s + 1 }, message, [], null);
  expect(shelf.kept).toHaveLength(2);
});

test("what two pages kept counts once", async () => {
  const shelf = new Shelf();
  for (const _ of [1, 2]) {
    const store = new StepStore(wire, shelf);
    for (const [step, message] of taken) await store.add(step, message, [], null);
  }
  expect(shelf.kept).toHaveLength(2 * taken.length);
  const next = new StepStore(wire, shelf);
  await next.load();
  expect(next.steps).toHaveLength(taken.length);
});

test("the peak of the foot comes from the frames of the step, if they are there", () => {
  const frames = Array.from({ length: 200 }, (_, i) => ({ t_s: i / 100, force_n: i === 150 ? 900 : i }));
  expect(peakForce(step({ start_s: 0.2, duration_s: 0.6 }), frames)).toBe(80);
  expect(peakForce(step({ start_s: 1.3, duration_s: 0.6 }), frames)).toBe(900);
  expect(peakForce(step({ start_s: 1.6, duration_s: 0.6 }), frames)).toBeNull();
});
