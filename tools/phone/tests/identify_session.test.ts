import { beforeAll, expect, test } from "vitest";
import type { Side, Step, StepRegion } from "../src/generated/quantities";
import type { Collected, FootResult } from "../src/identify_core";
import { CHECK_STEPS, TARGET_STEPS, MIN_STEPS, check, exclusions } from "../src/identify_rules";
import { IdentifySession, type IdentifyStorage } from "../src/identify_session";
import type { Answer, Request } from "../src/identify_worker";
import { entries } from "../src/stream_file";
import type { Wire } from "../src/wire";
import { live, loadWire, step as anyStep } from "./wire";

let wire: Wire;
beforeAll(async () => {
  wire = await loadWire();
});

const HELLO = Uint8Array.of(0, 1, 2);
const MESSAGE = Uint8Array.of(1, 2, 3);
const collected = (side: Side, good: number, excluded: Partial<Collected["excluded"]> = {}): Collected => ({
  side, good, mirrored: false, rate_hz: 100, excluded: { broken: 0, partial: 0, before: 0, ...excluded },
});
const region = (values: Partial<StepRegion>): StepRegion => ({ measured_force_peak_n: 100, ...values }) as StepRegion;
/** A step in which the heel has this model error. */
const withError = (percent: number, start_s = 0): Step =>
  anyStep({ start_s, regions: { heel: region({ model_error_nrmse_percent: percent }) } });

function result(predicted: number | null): FootResult {
  const heel = { fitted: true, nrmse_percent: { fitted: 8, predicted, floor: 1 } };
  const regions = { heel, hallux: { fitted: false, reason: "never loaded" } } as unknown as FootResult["regions"];
  return { fitted: 1, steps: [], regions, message: [4, 7], tissue_id: 42, parameters: "" };
}

const refusal = (reason: string, is_not_stored = false) =>
  ({ kind: "refused", reason, is_other_host: false, is_not_stored, is_final: false }) as const;

/** Passes a live frame of a foot to the session, with the force on this foot and on the other one. */
function receiveLive(session: IdentifySession, side: Side, now_ms: number, force_n = 0, other_n = 0): void {
  const message = live({ t_s: now_ms / 1000 }, force_n / 8);
  if (message.kind === "live") session.live(side, message, now_ms, () => other_n);
}

/** Starts a session of these feet, and passes it a live frame of each. Returns it with logs of its calls to the page. `is_radio` is that of the transport. */
function start(sides: Side[] = ["left", "right"], is_radio = true) {
  const said: string[] = [];
  const solved: Request[] = [];
  const sent: [Side, Uint8Array][] = [];
  let stored: Uint8Array<ArrayBuffer>[] = [];
  const storage: IdentifyStorage = {
    load: () => Promise.resolve(stored),
    add: (part) => Promise.resolve(void stored.push(part)),
    clear: () => Promise.resolve(void (stored = [])),
  };
  const session = new IdentifySession({
    solve: (request) => solved.push(request),
    send: (side, message) => sent.push([side, message]),
    cues: { say: (text) => said.push(text), vibrate: () => undefined },
    storage,
    size: () => 42,
    isRadio: () => is_radio,
  });
  const hellos = new Map(sides.map((side) => [side, HELLO]));
  session.start(hellos, 0, 1_000_000);
  for (const side of sides) receiveLive(session, side, 0);
  const answer = (answer: Answer) => session.answer(answer, 0);
  const count = (...insoles: Collected[]) => answer({ kind: "collected", insoles });
  return { session, said, solved, sent, hellos, answer, count, stored: () => stored };
}

/** Walks until all steps of both feet are collected. */
function walk(all: ReturnType<typeof start>) {
  const { session, count } = all;
  session.step("left", anyStep(), "a", 10);
  count(collected("left", TARGET_STEPS - 1), collected("right", TARGET_STEPS - 1));
  expect(session.phase).toBe("walk");
  count(collected("left", TARGET_STEPS), collected("right", TARGET_STEPS));
}

test("after standing on both feet for three seconds, the wearer walks; a lifted foot restarts the time", () => {
  const { session, said } = start();
  const frame = (now_ms: number, other_n: number) => receiveLive(session, "left", now_ms, 400, other_n);
  frame(0, 300);
  frame(2500, 10);
  frame(2600, 300);
  frame(5500, 300);
  expect(session.phase).toBe("stand");
  frame(5600, 300);
  expect(session.phase).toBe("walk");
  expect(said.at(-1)).toContain("walk");
  expect(session.comments()).toEqual([]);
});

test("the session continues if the wearer walks too early, with a remark", () => {
  const { session } = start();
  session.step("right", anyStep({ side: "right" }), "a", 100);
  expect(session.phase).toBe("walk");
  expect(session.comments().join()).toContain("before you had stood still");
});

test("steps from before the session, which the insole has stored, do not end the phase of standing", () => {
  const { session, hellos } = start(["left"]);
  session.start(hellos, 0, 2_000_000);
  const receiveStep = (start_s: number, boots_since = 0) =>
    session.step("left", anyStep({ start_s, boots_since }), `${start_s} ${boots_since}`, 0);
  // No live frame has arrived yet.
  receiveStep(70);
  receiveLive(session, "left", 80_000);
  receiveStep(79.9);
  receiveStep(500, 1);
  expect([session.phase, session.comments()]).toEqual(["stand", []]);
  // After a restart of the insole, its clock begins again.
  receiveLive(session, "left", 1000);
  receiveStep(79.9, 1);
  expect(session.phase).toBe("stand");
  receiveStep(1);
  expect(session.phase).toBe("walk");
});

test("messages are passed on with their times and feet, and stored", () => {
  const { session, solved, stored } = start();
  session.message("right", MESSAGE, 1_000_250);
  session.tick(2000, []);
  const added = solved.flatMap((request) => (request.kind === "add" ? [...entries(request.bytes)] : []));
  expect(added.map(({ t_ms, insole }) => [t_ms, insole])).toEqual([[0, 0], [0, 1], [250, 1]]);
  expect(added.at(-1)?.message).toEqual(MESSAGE);
  expect(stored()).toEqual(session.file());
});

test("a session that was interrupted continues with its stored messages", () => {
  const before = start();
  before.session.step("left", anyStep(), "a", 10);
  const { session, solved, hellos } = start();
  solved.length = 0;
  session.resume(before.stored(), hellos, 0, 5_000_000);
  session.message("left", MESSAGE, 5_000_100);
  session.tick(2000, []);
  expect(session.phase).toBe("walk");
  expect(solved.map(({ kind }) => kind)).toEqual(["clear", "add", "add"]);
  const times = session.file().flatMap((part) => [...entries(part)].map(({ t_ms }) => t_ms));
  expect(times).toEqual([...times].sort((a, b) => a - b));
});

test("progress is spoken every ten steps, and reasons of unused steps at intervals", () => {
  const { session, said, count } = start();
  session.step("left", anyStep(), "a", 10);
  count(collected("left", 9), collected("right", 9));
  said.length = 0;
  count(collected("left", 10, { partial: 1 }), collected("right", 9));
  count(collected("left", 10, { partial: 2 }), collected("right", 9));
  expect(said).toEqual([
    `10 of ${TARGET_STEPS} with the left foot.`,
    "That step had too little load. Walk straight, at your usual pace.",
  ]);
  expect(session.comments().join()).toContain("2 left steps with too little load");
});

test("the feet are fitted one after the other, the parameters are sent until they are confirmed, and checked", () => {
  const all = start();
  const { session, solved, sent, answer } = all;
  walk(all);
  expect(session.phase).toBe("fit");
  expect(solved.at(-1)).toEqual({ kind: "identify", insole: 0, size: 42 });
  answer({ kind: "fitted", region: 0 });
  expect([session.regions_done, session.regions]).toEqual([1, 16]);
  answer({ kind: "result", insole: 0, result: result(8) });
  expect(solved.at(-1)).toEqual({ kind: "identify", insole: 1, size: 42 });
  answer({ kind: "result", insole: 1, result: result(8) });
  expect(session.phase).toBe("result");
  session.push(0);
  expect(sent).toEqual([["left", Uint8Array.of(4, 7)], ["right", Uint8Array.of(4, 7)]]);
  session.insoleAnswer("left", { kind: "tissue", id: 42 }, 10);
  // An answer with other parameters does not confirm the parameters; they are sent again.
  session.insoleAnswer("right", { kind: "tissue", id: 1 }, 10);
  expect(session.phase).toBe("push");
  session.tick(3500, []);
  expect(sent.map(([side]) => side)).toEqual(["left", "right", "right"]);
  session.insoleAnswer("right", { kind: "tissue", id: 42 }, 3600);
  expect(session.phase).toBe("verify");
  // Steps with the former parameters can arrive after the confirmation, also before its first live frame.
  session.step("left", withError(90, 2), "a", 3600);
  for (const side of ["left", "right"] as const) receiveLive(session, side, 3600);
  session.step("right", withError(90, 3.5), "b", 3600);
  expect(session.feet.map(({ checked }) => checked.size)).toEqual([0, 0]);
  for (let i = 0; i < CHECK_STEPS; i += 1) {
    expect(session.phase).toBe("verify");
    // A step that the insole sends twice counts once.
    for (const side of ["left", "left", "right"] as const) session.step(side, withError(9, 3.6), `${i}`, 4000);
  }
  expect(session.phase).toBe("done");
  expect(session.feet.map(({ check }) => check?.is_confirmed)).toEqual([true, true]);
});

test("an insole that refuses or does not answer is named, and the parameters can be sent again", () => {
  const all = start();
  const { session, answer } = all;
  walk(all);
  for (const insole of [0, 1] as const) answer({ kind: "result", insole, result: result(8) });
  session.push(0);
  session.insoleAnswer("left", refusal("The memory is full."), 10);
  for (const now_ms of [3000, 6000, 9000]) session.tick(now_ms, []);
  expect(session.phase).toBe("result");
  const answers = () => session.feet.map(({ sent, refusal }) => [sent, refusal]);
  expect(answers()).toEqual([["failed", "The memory is full."], ["failed", ""]]);
  session.push(10_000);
  session.insoleAnswer("right", { kind: "tissue", id: 42 }, 10_010);
  session.insoleAnswer("left", refusal("The memory is full."), 10_020);
  expect(session.phase).toBe("verify");
  expect(answers()).toEqual([["failed", "The memory is full."], ["confirmed", ""]]);
});

test("an insole that could not store the parameters uses them, so they are checked, and they can be sent again", () => {
  const all = start();
  const { session, sent, answer } = all;
  walk(all);
  for (const insole of [0, 1] as const) answer({ kind: "result", insole, result: result(8) });
  session.push(0);
  session.insoleAnswer("left", refusal("low supply", true), 10);
  session.insoleAnswer("right", { kind: "tissue", id: 42 }, 10);
  const answers = () => session.feet.map(({ sent, unstored }) => [sent, unstored]);
  expect([session.phase, answers()]).toEqual(["verify", [["confirmed", "low supply"], ["confirmed", ""]]]);
  // Without an answer, and after another refusal, it is known that the insole uses them nevertheless.
  session.push(20);
  for (const now_ms of [3020, 6020, 9020]) session.tick(now_ms, []);
  session.push(9030);
  session.insoleAnswer("left", refusal("busy"), 9040);
  expect([session.phase, answers()]).toEqual(["verify", [["confirmed", "low supply"], ["confirmed", ""]]]);
  sent.length = 0;
  session.push(10_000);
  expect([session.phase, sent.map(([side]) => side)]).toEqual(["push", ["left"]]);
  session.insoleAnswer("left", { kind: "tissue", id: 42 }, 10_010);
  expect([session.phase, answers()]).toEqual(["verify", [["confirmed", ""], ["confirmed", ""]]]);
});

test("the parameters are sent again to an insole that did not answer, during the check and after it", () => {
  const all = start();
  const { session, sent, answer } = all;
  walk(all);
  for (const insole of [0, 1] as const) answer({ kind: "result", insole, result: result(8) });
  const steps = (side: Side) => {
    receiveLive(session, side, 0);
    for (let i = 0; i < CHECK_STEPS; i += 1) session.step(side, withError(9), `${i}`, 0);
  };
  // Sends the parameters and waits until all attempts are over. The left insole never answers, the right one at time 0 only.
  // Returns the foot of each message.
  const pushWithoutAnswer = (now_ms: number) => {
    sent.length = 0;
    session.push(now_ms);
    if (now_ms === 0) session.insoleAnswer("right", { kind: "tissue", id: 42 }, now_ms);
    for (const wait_ms of [3000, 6000, 9000]) session.tick(now_ms + wait_ms, []);
    return sent.map(([side]) => side);
  };
  expect(pushWithoutAnswer(0)).toEqual(["left", "right", "left", "left"]);
  expect(session.phase).toBe("verify");
  expect(pushWithoutAnswer(10_000)).toEqual(["left", "left", "left"]);
  expect(session.phase).toBe("verify");
  steps("right");
  expect(session.phase).toBe("done");
  expect(pushWithoutAnswer(20_000)).toEqual(["left", "left", "left"]);
  expect(session.phase).toBe("done");
  session.push(30_000);
  session.insoleAnswer("left", { kind: "tissue", id: 42 }, 30_010);
  expect(session.phase).toBe("verify");
  steps("left");
  expect(session.phase).toBe("done");
  expect(session.feet.map(({ check }) => check?.is_confirmed)).toEqual([true, true]);
});

test("a foot without steps is named and is not fitted", () => {
  const { session, solved, answer, count } = start();
  session.step("left", anyStep(), "a", 10);
  count(collected("left", MIN_STEPS - 1), collected("right", 0));
  expect(session.canFinish).toBe(false);
  count(collected("left", MIN_STEPS), collected("right", 0));
  expect(session.problems()).toEqual(["No usable step of the right foot has arrived. Check that its insole is in the shoe, and walk straight."]);
  session.finishWalk();
  expect(solved.at(-1)).toEqual({ kind: "identify", insole: 0, size: 42 });
  answer({ kind: "result", insole: 0, result: result(8) });
  expect(session.pushable().map(({ side }) => side)).toEqual(["left"]);
});

test("a lost link is announced", () => {
  const { session, said } = start(["left"]);
  session.step("left", anyStep(), "a", 0);
  session.tick(100, ["left"]);
  session.tick(200, ["left"]);
  expect(said.filter((text) => text.includes("not connected"))).toHaveLength(1);
  expect(session.problems().join()).toContain("The left insole is not connected");
  session.tick(300, []);
  expect(said.at(-1)).toBe("The left insole is connected again. Continue to walk.");
});

test("a wearer who rests is reminded at most twice in each pause, and not asked to walk", () => {
  const { session, said } = start(["left"]);
  const rest = (from_ms: number) => {
    session.step("left", anyStep(), `${from_ms}`, from_ms);
    said.length = 0;
    for (let s = 0; s < 120; s += 1) session.tick(from_ms + 1000 * s, []);
    return said;
  };
  const reminder = "Rest if you like; your steps so far count. Continue when you are ready.";
  expect(rest(0)).toEqual([reminder, reminder]);
  expect(rest(200_000)).toEqual([reminder, reminder]);
});

test("a wearer who is to hold the phone closer to the feet is first asked to stop", () => {
  const { session, said, count } = start();
  session.step("left", anyStep(), "a", 10);
  count(collected("left", 1), collected("right", 1));
  count(collected("left", 1, { broken: 1 }), collected("right", 1));
  expect(said.at(-1)).toMatch(/^Stop walking\. Data were lost\. Hold the phone closer to your feet/);
});

test("without a radio, the wearer is not advised to hold the phone closer", () => {
  const { session, said, count } = start(["left"], false);
  session.tick(100, ["left"]);
  session.tick(200, []);
  session.step("left", anyStep(), "a", 300);
  count(collected("left", 4));
  count(collected("left", 4, { broken: 1 }));
  session.tick(400, ["left"]);
  const texts = [...said, ...session.problems(), ...session.comments()];
  expect(texts).toContain("The left insole is not connected. Stop, and wait.");
  expect(texts).toContain("The left insole is not connected. Wait until it is connected again. The session continues then.");
  expect(texts).toContain("Not used: 1 left step with lost data.");
  expect(texts.join()).not.toMatch(/phone closer/i);
});

test("a wearer who has to stand is not asked to walk when the link returns", () => {
  const { session, said } = start(["left"]);
  session.tick(100, ["left"]);
  session.tick(200, []);
  expect(said.slice(-2)).toEqual([
    "The left insole is not connected. Hold the phone closer.",
    "The left insole is connected again. Stand still on both feet.",
  ]);
});

test("a failure of the worker ends the session with its reason", () => {
  const all = start();
  walk(all);
  all.answer({ kind: "failed", reason: "Start again.", needs_reload: true });
  expect([all.session.phase, all.session.failure, all.session.needs_reload]).toEqual(["failed", "Start again.", true]);
});

test("a failure of the worker after the wearer has cancelled the session is not shown", () => {
  const { session, answer } = start();
  session.close();
  answer({ kind: "failed", reason: "Start again.", needs_reload: false });
  expect([session.phase, session.failure]).toEqual(["closed", ""]);
});

test("an insole under the wrong foot is named", () => {
  const { session, count } = start();
  session.step("left", anyStep(), "a", 10);
  count({ ...collected("left", 5), mirrored: true }, collected("right", 5));
  expect(session.problems().filter((problem) => problem.startsWith("The loads of the left insole")).length).toBe(1);
});

test("the check compares loaded fitted regions with the prediction, and excluded steps are described in words", () => {
  const unloaded = anyStep({ regions: { heel: region({ measured_force_peak_n: 2, model_error_nrmse_percent: 90 }) } });
  const confirmed = { predicted_percent: 8, measured_percent: 10, is_confirmed: true };
  expect(check(result(8), [withError(9), withError(11), unloaded])).toEqual(confirmed);
  expect(check(result(8), [withError(20)])?.is_confirmed).toBe(false);
  expect(check(result(8), [unloaded])).toBeUndefined();
  // A fit to a single step predicts no error.
  expect(check(result(null), [withError(9)])).toBeUndefined();
  const saturated = anyStep({ regions: { heel: region({ saturated: true, model_error_nrmse_percent: 90 }) } });
  expect(check(result(8), [withError(9), withError(11), saturated])).toEqual(confirmed);
  const sentences = exclusions(collected("left", 3, { broken: 1 }), true);
  expect(sentences).toEqual(["Not used: 1 left step with lost data. Hold the phone closer to your feet."]);
  expect(wire.facts.regions.map(({ name }) => name)).toEqual(expect.arrayContaining(["toes_35", "hallux"]));
});
