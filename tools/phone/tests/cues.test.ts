import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { PhoneCues, ScreenWakeLock } from "../src/cues";

/** The wake locks that the browser has granted. */
let locks: { released: boolean; release: () => Promise<void> }[];
let is_refused: boolean;
let requests: number;
/** Replaces the document of the page. */
const page = { hidden: false };

beforeEach(() => {
  vi.useFakeTimers();
  [locks, is_refused, requests, page.hidden] = [[], false, 0, false];
  const request = async () => {
    requests += 1;
    if (is_refused) throw new Error("The battery is low.");
    const lock = { released: false, release: async () => void (lock.released = true) };
    locks.push(lock);
    return lock;
  };
  vi.stubGlobal("navigator", { wakeLock: { request } });
  vi.stubGlobal("document", page);
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

/** Keeps the screen on for this number of tenths of a second. */
async function hold(screen: ScreenWakeLock, count: number): Promise<void> {
  for (let i = 0; i < count; i++) {
    screen.hold();
    await vi.advanceTimersByTimeAsync(100);
  }
}

/** The number of wake locks that are in force. */
const held = () => locks.filter(({ released }) => !released).length;

test("the screen wake lock is requested again after the page was hidden", async () => {
  const screen = new ScreenWakeLock();
  await hold(screen, 10);
  expect([held(), requests]).toEqual([1, 1]);
  page.hidden = true;
  for (const lock of locks) lock.released = true;
  await hold(screen, 10);
  expect(requests).toBe(1);
  page.hidden = false;
  await hold(screen, 10);
  expect([held(), requests]).toEqual([1, 2]);
});

test("a refused request is repeated, but not with each call", async () => {
  const screen = new ScreenWakeLock();
  is_refused = true;
  await hold(screen, 50);
  expect(requests).toBeGreaterThan(1);
  expect(requests).toBeLessThan(5);
  is_refused = false;
  await hold(screen, 50);
  expect(held()).toBe(1);
});

test("the screen wake lock ends with `release`, also if the browser grants it only afterwards", async () => {
  const screen = new ScreenWakeLock();
  await hold(screen, 1);
  screen.release();
  screen.hold();
  screen.release();
  await vi.advanceTimersByTimeAsync(100);
  expect(held()).toBe(0);
});

test("tones that the browser does not allow do not sound later, all at once", async () => {
  const allow: (() => void)[] = [];
  let sounds = 0;
  const node = { connect: () => node, start: () => (sounds += 1), stop: () => undefined };
  vi.stubGlobal("OscillatorNode", function () { return node; });
  vi.stubGlobal("GainNode", function () { return node; });
  class FakeAudio {
    state = "suspended";
    currentTime = 0;
    resume = () => (this.state === "running" ? Promise.resolve() : new Promise<void>((resolve) => allow.push(resolve)));
    constructor() {
      allow.push(() => (this.state = "running"));
    }
  }
  vi.stubGlobal("AudioContext", FakeAudio);
  const cues = new PhoneCues();
  cues.tone();
  await vi.advanceTimersByTimeAsync(45_000);
  cues.tone();
  await vi.advanceTimersByTimeAsync(45_000);
  allow.forEach((resolve) => resolve());
  await vi.advanceTimersByTimeAsync(1);
  expect([sounds, cues.is_sound_allowed]).toEqual([0, true]);
  cues.tone();
  await vi.advanceTimersByTimeAsync(1);
  // A signal has two tones.
  expect(sounds).toBe(2);
  cues.tone([440]);
  await vi.advanceTimersByTimeAsync(1);
  expect(sounds).toBe(3);
});
