import { expect, test } from "vitest";
import type { Side } from "../src/generated/quantities";
import { loadSettings } from "../src/settings";
import type { StoredBout, StoredStep } from "../src/step_store";
import { gaitOf, whyNotCompared } from "../src/walk";
import { loadWire, step } from "./wire";

const wire = await loadWire();
const SETTINGS = loadSettings(() => ({ getItem: () => null }) as unknown as Storage);
const STRIDE_S = 1.2;

/** Steps of a foot with equal strides. The clock of the insole shows 70 s when that of the browser shows 1,800,000,000 s. */
function foot(side: Side, lag_s: number, duration_s: number, count: number): StoredStep[] {
  return Array.from({ length: count }, (_, n) => {
    const start_unix_s = 1_800_000_000 + lag_s + n * STRIDE_S;
    return { step: step({ side, step: n, start_s: start_unix_s - 1_799_999_930, duration_s }), start_unix_s, is_comparable: true };
  });
}

/** This step, recorded so many boots of the insole ago, without a time on the clock of the browser. */
const ofEarlierBoot = ({ step }: StoredStep, boots_since: number): StoredStep => ({
  step: { ...step, boots_since },
  start_unix_s: null,
  is_comparable: false,
});

const measure = (gait: ReturnType<typeof gaitOf>, key: string) => gait.measures.find((measure) => measure.key === key);

test("the measures of both feet are computed from their steps on the clock of the browser", () => {
  const steps = [...foot("left", 0, 0.8, 12), ...foot("right", 0.5, 0.7, 12)];
  const gait = gaitOf(wire, { steps, bouts: [], alerts: [] }, { ...SETTINGS, stride_cm: 150 });
  expect(gait.has_both_feet).toBe(true);
  expect(gait.strides).toEqual({ left: 11, right: 11 });
  expect(gait.cadence_per_min?.mean).toBeCloseTo(100, 3);
  expect(gait.speed_m_s).toBeCloseTo(1.25, 4);
  expect(measure(gait, "step_time_s")?.left?.mean).toBeCloseTo(0.7, 5);
  expect(measure(gait, "step_time_s")?.right?.mean).toBeCloseTo(0.5, 5);
  // The left foot lands 0.5 s before the right one, and is lifted 0.3 s after the right one has landed. The right foot is
  // lifted when the left one lands again.
  expect(measure(gait, "double_support_s")?.left?.mean).toBeCloseTo(0.3, 5);
  expect(measure(gait, "stance_time_s")?.symmetry_percent?.mean).toBeCloseTo((200 * 0.1) / 1.5, 5);
  expect(gaitOf(wire, { steps, bouts: [], alerts: [] }, SETTINGS).speed_m_s).toBeNull();
});

test("without times on the browser's clock, each foot is measured alone", () => {
  const steps = [...foot("left", 0, 0.8, 5), ...foot("right", 0.5, 0.7, 5)].map((stored) => ofEarlierBoot(stored, 0));
  const gait = gaitOf(wire, { steps, bouts: [], alerts: [] }, SETTINGS);
  expect(gait.has_both_feet).toBe(false);
  expect(gait.cadence_per_min?.mean).toBeCloseTo(100, 5);
  expect(measure(gait, "stance_time_s")?.right?.mean).toBeCloseTo(0.7, 5);
  expect(measure(gait, "step_time_s")).toMatchObject({ left: null, right: null, symmetry_percent: null });
});

test("only a load bout of the same insole explains a missing step number", () => {
  const steps = [...foot("left", 0, 0.8, 60), ...foot("right", 0.5, 0.7, 60)];
  const bout = (number: number, start_unix_s: number) =>
    ({ bout: { side: "left", number }, start_unix_s }) as unknown as StoredBout;
  const gait = (bouts: StoredBout[]) => gaitOf(wire, { steps, bouts, alerts: [] }, SETTINGS).strides;
  expect(gait([20, 45].map((number) => bout(number, 1_799_990_000)))).toEqual({ left: 59, right: 59 });
  // A bout of this insole, which has the number after that of a step, is not a missing step, either.
  for (const { step } of steps) if (step.side === "left" && step.step >= 30) step.step += 1;
  expect(gait([bout(30, 1_800_000_000 + 30 * STRIDE_S - 0.1)])).toEqual({ left: 59, right: 59 });
  expect(gait([]).left).toBe(58);
});

test("if the feet did not walk at the same time, only the foot that walked last is measured", () => {
  const day_s = 86_400;
  const before = [...foot("left", 0, 0.8, 120), ...foot("right", 0.5, 0.7, 120)];
  const today = foot("left", day_s, 0.6, 100);
  for (const { step } of today) step.step += 120;
  const gait = gaitOf(wire, { steps: [...before, ...today], bouts: [], alerts: [] }, SETTINGS);
  expect([gait.has_both_feet, gait.strides, gait.unpaired]).toEqual([false, { left: 99, right: 0 }, { left: 0, right: 0 }]);
  expect(measure(gait, "stance_time_s")?.left?.mean).toBeCloseTo(0.6, 5);
  expect(gait.cadence_per_min?.mean).toBeCloseTo(100, 3);
});

test("measures are computed from the last 100 steps of each foot", () => {
  const steps = foot("left", 0, 0.6, 150).map((stored, n) => ({ ...stored, step: { ...stored.step, duration_s: n < 50 ? 0.9 : 0.6 } }));
  const gait = gaitOf(wire, { steps, bouts: [], alerts: [] }, SETTINGS);
  expect(gait.strides).toEqual({ left: 99, right: 0 });
  expect(measure(gait, "stance_time_s")?.left).toMatchObject({ count: 99, mean: expect.closeTo(0.6) });
});

test("if only some steps of a foot have a time on the browser's clock, only those are used", () => {
  const feet = (["left", "right"] as const).map((side) => {
    const steps = foot(side, side === "left" ? 0 : 0.5, 0.7, 100);
    // The last 100 steps of each foot include those of an earlier boot. Their times are on a clock that has ended.
    return steps.map((stored, n) => (n < 60 ? ofEarlierBoot(stored, 1) : stored));
  });
  const gait = gaitOf(wire, { steps: feet.flat(), bouts: [], alerts: [] }, SETTINGS);
  expect([gait.has_both_feet, gait.strides]).toEqual([true, { left: 39, right: 39 }]);
  expect(measure(gait, "step_time_s")?.right?.mean).toBeCloseTo(0.5, 5);
  // The right foot has no time at all: the feet are not compared, and the left one is still measured by its 40 steps.
  const right = feet[1]!.map((stored) => ofEarlierBoot(stored, stored.step.boots_since));
  const apart = gaitOf(wire, { steps: [...feet[0]!, ...right], bouts: [], alerts: [] }, SETTINGS);
  expect([apart.has_both_feet, apart.strides]).toEqual([false, { left: 39, right: 39 }]);
});

test("if no step of a foot has a time on the browser's clock, only those of the newest boot are used", () => {
  const steps = foot("left", 0, 0.7, 30).map((stored, n) => ofEarlierBoot(stored, n < 10 ? 3 : n < 18 ? 2 : 1));
  const gait = gaitOf(wire, { steps, bouts: [], alerts: [] }, SETTINGS);
  expect(gait.strides).toEqual({ left: 11, right: 0 });
});

test("feet that walked without this device are not compared, because their clocks have drifted apart since", () => {
  // A symmetric walk two hours ago, with clocks that differ by 20 ppm.
  const walked = [...foot("left", 0, 0.8, 60), ...foot("right", STRIDE_S / 2 + 0.144, 0.8, 60)];
  const before = walked.map((stored) => ({ ...stored, is_comparable: false }));
  const gait = gaitOf(wire, { steps: before, bouts: [], alerts: [] }, SETTINGS);
  expect([gait.has_both_feet, gait.strides]).toEqual([false, { left: 59, right: 59 }]);
  expect(measure(gait, "step_time_s")).toMatchObject({ left: null, right: null, symmetry_percent: null });
  // Then the wearer walks with this device. Once there are ten steps of each foot, only these of the last 100 are used.
  const after = (count: number) => {
    const now = [...foot("left", 7200, 0.8, count), ...foot("right", 7200 + STRIDE_S / 2, 0.8, count)];
    for (const { step } of now) step.step += 60;
    return gaitOf(wire, { steps: [...before, ...now], bouts: [], alerts: [] }, SETTINGS);
  };
  expect([after(9).has_both_feet, after(9).strides.left]).toEqual([false, 67]);
  expect([after(10).has_both_feet, after(10).strides]).toEqual([true, { left: 9, right: 9 }]);
  expect(measure(after(10), "step_time_s")?.symmetry_percent?.mean).toBeCloseTo(0, 3);
  // Steps that are walked without it later are newer, so they are used.
  const later = walked.map((stored) => ({ step: { ...stored.step, step: stored.step.step + 60 }, start_unix_s: stored.start_unix_s! + 9e4 }));
  const last = gaitOf(wire, { steps: [...walked, ...later], bouts: [], alerts: [] }, SETTINGS);
  expect([last.has_both_feet, last.strides.left]).toEqual([false, 98]);
});

test("the reason why the feet are not compared is the one that applies", () => {
  const left = foot("left", 0, 0.8, 20);
  expect(whyNotCompared(left)).toBe("The feet are not compared, because there are no steps of the right foot.");
  expect(whyNotCompared([...left.slice(0, 1), ...foot("right", 0.5, 0.8, 1)])).toMatch(/yet, because there are too few steps so far\.$/);
  expect(whyNotCompared([...left, ...foot("right", 7200, 0.8, 20)])).toMatch(/because they walked at different times\.$/);
  const together = [...left, ...foot("right", 0.5, 0.8, 20)];
  for (const inexact of [together.map((stored) => ({ ...stored, is_comparable: false })), together.map((stored) => ofEarlierBoot(stored, 1))]) {
    expect(whyNotCompared(inexact)).toMatch(/because too few steps have exact times/);
  }
});

test("of feet that walked at different times without this device, only the one that walked last is measured", () => {
  const steps = [...foot("left", 0, 0.8, 20), ...foot("right", 7200, 0.8, 20)].map((stored) => ({ ...stored, is_comparable: false }));
  const gait = gaitOf(wire, { steps, bouts: [], alerts: [] }, SETTINGS);
  expect([gait.has_both_feet, gait.strides]).toEqual([false, { left: 0, right: 19 }]);
});
