import { expect, test } from "vitest";
import { TemporaryStorage } from "../src/step_storage";
import type { StoredStep } from "../src/step_store";
import { cadence_per_min, footMeasures, symmetryIndex } from "../src/walk";
import { step } from "./wire";

function stored(values: Parameters<typeof step>[0]): StoredStep {
  return { step: step(values), start_unix_s: null };
}

test("the symmetry index is 0 for equal feet, positive if the left value is larger, and null without two values", () => {
  expect(symmetryIndex(800, 800)).toBe(0);
  expect(symmetryIndex(900, 700)).toBe(25);
  expect(symmetryIndex(700, 900)).toBe(-25);
  expect(symmetryIndex(null, 700)).toBeNull();
  expect(symmetryIndex(0, 0)).toBeNull();
});

test("the cadence counts the steps of both feet, even if the steps of only one foot are known", () => {
  const left = [0, 1, 2, 3].map((n) => stored({ step: n, start_s: 10 + n * 1.2 }));
  const right = [0, 1, 2, 3].map((n) => stored({ side: "right", step: n, start_s: 77 + n * 1.2 }));
  expect(cadence_per_min(left)).toBeCloseTo(100);
  expect(cadence_per_min([...left, ...right])).toBeCloseTo(100);
  expect(cadence_per_min(left.slice(0, 1))).toBeNull();
});

test("intervals across a missing step, a pause or a restart are not strides", () => {
  const steps = [
    stored({ step: 0, start_s: 0 }),
    stored({ step: 1, start_s: 1 }),
    stored({ step: 3, start_s: 3 }),
    stored({ step: 4, start_s: 20 }),
    stored({ step: 5, start_s: 2 }),
  ];
  expect(cadence_per_min(steps)).toBe(120);
});

test("means are computed from the last 20 steps", () => {
  const steps = Array.from({ length: 30 }, (_, n) => {
    const values = stored({ step: n, duration_s: n < 10 ? 9 : 0.6 });
    values.step.foot.foot_force_peak_n = n < 10 ? 100 : 790 + 20 * (n % 2);
    return values;
  });
  const left = footMeasures(steps, "left");
  expect(left).toEqual({ count: 30, peak_n: 800, impulse_n_s: 0, contact_s: expect.closeTo(0.6) });
  expect(footMeasures(steps, "right")).toEqual({ count: 0, peak_n: null, impulse_n_s: null, contact_s: null });
});

test("a temporary storage contains no steps of earlier visits", async () => {
  expect(await new TemporaryStorage().load()).toEqual([]);
});
