import { beforeAll, describe, expect, test, vi } from "vitest";
import type { Status, ToHost } from "../src/generated/messages";
import type { Side, Step } from "../src/generated/quantities";
import { Insoles } from "../src/insoles";
import { sessionProblems } from "../src/notes";
import { TIMEOUT_MS } from "../src/reconnect";
import { Recorder } from "../src/recorder";
import { type RecordMessage, Session } from "../src/session";
import type { Transport } from "../src/transport/transport";
import type { Wire } from "../src/wire";
import { hello, live, loadWire, messagesOf, step } from "./wire";

let wire: Wire;
beforeAll(async () => {
  wire = await loadWire();
});

/**
 * Creates a session that logs its requests and steps. If `decode` is given, it replaces the decoding of messages. A step counts
 * as known once it was logged.
 */
function start(decode?: (bytes: Uint8Array) => ToHost | undefined) {
  const sent: Uint8Array[] = [];
  const steps: Step[] = [];
  const send = (_: unknown, message: Uint8Array) => sent.push(message);
  const transport = { location: "in a test", is_replay: false, can_lose_records: true, send, close: () => undefined };
  const requested_us: number[] = [];
  const getTime = (host_us: number) => {
    requested_us.push(host_us);
    return wire.getTime(host_us);
  };
  const core = Object.assign(Object.create(wire), { getTime, decode: decode ?? wire.decode.bind(wire) }) as Wire;
  const onRecord = (message: RecordMessage) => message.kind === "step" && steps.push(message.step);
  const isKnown = (message: RecordMessage) => message.kind === "step" && steps.includes(message.step);
  const session = new Session(0, core, () => transport, onRecord, () => undefined, () => false, isKnown);
  return { session, sent, steps, transport, requested_us };
}

/** The numbers of received and lost live frames, and of damaged messages. */
const counts = ({ counter, damaged }: Session) => ({ received: counter.received, lost: counter.lost, damaged });

test("a session sends connect requests until the insole answers, then requests the streams and the cells", () => {
  const { session, sent } = start();
  session.opened(0);
  session.tick(100);
  session.tick(500);
  expect(sent).toEqual([wire.connect(), wire.connect()]);
  session.receive(messagesOf(0)[0]!, 600);
  expect(session.state).toBe("live");
  expect(session.hello?.side).toBe("left");
  expect(sent.slice(-3)).toEqual([wire.stream(true), wire.streamEllipses(4), wire.getSetupCells(0)]);
});

test("the cells of an insole are requested part by part until all have arrived, and determine its sole", () => {
  const { session, sent } = start();
  session.opened(0);
  const [hello, ...parts] = messagesOf(0).filter((message) => ["hello", "setup_cells"].includes(wire.decode(message)?.kind ?? ""));
  session.receive(hello!, 0);
  session.receive(parts[0]!, 1);
  expect(sent.at(-1)).toEqual(wire.getSetupCells(16));
  // An answer was lost, so the request is repeated.
  session.tick(500);
  session.tick(1001);
  const cell_requests = sent.filter((request) => request[0] === wire.getSetupCells(0)[0]);
  expect(cell_requests).toEqual([0, 16, 16].map((first) => wire.getSetupCells(first)));
  // An answer that arrives again is ignored.
  session.receive(parts[0]!, 1100);
  parts.slice(1).forEach((part) => {
    expect(session.sole).toBeUndefined();
    session.receive(part, 1200);
  });
  const sole = session.sole!;
  expect(sole.regions).toHaveLength(8);
  // The cells of the computed insole cover the generic sole. The outline also includes a rim around them.
  sole.to_mm.forEach((mm, axis) => expect(Math.abs(mm - wire.facts.sole.to_mm[axis]!)).toBeLessThan(12));
});

test("the ellipses of the last frame replace those before, and a new session has none", () => {
  const { session } = start();
  session.opened(0);
  const messages = messagesOf(0);
  const ellipses = messages.map((message) => wire.decode(message)).filter((message) => message?.kind === "ellipses");
  messages.forEach((message, i) => session.receive(message, i));
  expect(ellipses.length).toBeGreaterThan(100);
  expect(ellipses.some(({ regions }) => regions.every((ellipse) => ellipse))).toBe(true);
  expect(session.ellipses).toEqual(ellipses.at(-1)?.regions);
  session.receive(messages[0]!, 0);
  expect(session.ellipses).toEqual([]);
});

test("all frames and steps of the computed walk are received", () => {
  const { session, steps, transport } = start();
  // The time messages of the recording have the clock of the computer that made it; a session accepts them only in a replay.
  transport.is_replay = true;
  session.opened(0);
  messagesOf(1).forEach((message, i) => session.receive(message, i));
  expect(session.hello?.side).toBe("right");
  const live = messagesOf(1).filter((message) => wire.decode(message)?.kind === "live");
  expect(counts(session)).toEqual({ received: live.length, lost: 0, damaged: 0 });
  expect(steps.map(({ step }) => step)).toEqual([0, 1, 2, 3, 4, 5]);
});

/** A status with these values. All other counters are 0. */
const status = (counts: Partial<Status>): ToHost => ({
  kind: "status",
  uptime_s: 1,
  frames_missed: 0,
  live_due: 0,
  live_sent: 0,
  steps: 0,
  next_record: 0,
  records_dropped: 0,
  bad_frames: 0,
  not_stored: 0,
  faults: 0,
  rezeroed: 0,
  ...counts,
});

/** A session that has received the hello, and a function that passes it a message. */
function startLive() {
  let next: ToHost;
  const { session } = start(() => next);
  const receive = (message: ToHost, now_ms = 0) => {
    next = message;
    session.receive(new Uint8Array(1), now_ms);
  };
  session.opened(0);
  receive(hello(wire.facts.major));
  return { session, receive };
}

test("gaps are counted, and a status reveals losses before the first and after the last frame", () => {
  const { session, receive } = startLive();
  for (const sequence of [2, 3, 7]) receive(live({ sequence }));
  expect(session.counter.lost).toBe(3);
  const message = status({ live_due: 9, live_sent: 9 });
  receive(message);
  expect(session.counter.lost).toBe(6);
  receive(message);
  expect(counts(session)).toEqual({ received: 3, lost: 6, damaged: 0 });
});

test("the number of stored records that are still to come is known, also when their numbers wrap", () => {
  const { session, receive } = startLive();
  const receiveStep = (number: number) => receive({ kind: "step", key: String(number), step: step({ step: number }) });
  receive(status({ next_record: 500 }));
  // Before the first record, the number of records that are still to come is unknown.
  expect(session.records_waiting).toBe(0);
  receiveStep(99);
  expect(session.records_waiting).toBe(400);
  receiveStep(499);
  expect(session.records_waiting).toBe(0);
  // The status is older than this record.
  receiveStep(500);
  expect(session.records_waiting).toBe(0);
  receiveStep(2 ** 32 - 1);
  receive(status({ next_record: 10 }));
  expect(session.records_waiting).toBe(10);
});

test("an insole has parameters as long as its last tissue message has an id other than 0", () => {
  const { session, receive } = startLive();
  const first = session.hello;
  const states = [0, 7].map((id) => {
    receive({ kind: "tissue", id });
    return session.hello?.has_parameters;
  });
  expect(states).toEqual([false, true]);
  // Another object would count as another hello of the insole.
  expect(session.hello).toBe(first);
});

test("steps that arrive before the time of the insole's clock is known are held in order, but not for long", () => {
  const walked = [0, 1, 2].map((number): ToHost => ({ kind: "step", key: String(number), step: step({ step: number }) }));
  const time = (host_us: number): ToHost => ({ kind: "time", host_us, device_us: 500_000 });
  const messages = [hello(wire.facts.major), ...walked];
  const { session, steps, requested_us } = start(([index]) => messages[index!] ?? time(requested_us.at(-1)!));
  const receive = (index: number, now_ms: number) => session.receive(Uint8Array.of(index), now_ms);
  const numbers = () => steps.map((received) => received.step);
  session.opened(0);
  receive(0, 0);
  receive(1, 10);
  receive(2, 20);
  expect(numbers()).toEqual([]);
  // A single request may have been delayed.
  receive(4, 30);
  receive(4, 31);
  expect(numbers()).toEqual([]);
  receive(4, 32);
  expect(numbers()).toEqual([0, 1]);
  expect(session.clock_mapping.unix_s(0.5)).toBeCloseTo(requested_us.at(-1)! / 1e6, 5);
  receive(3, 40);
  expect(numbers()).toEqual([0, 1, 2]);
  // In the next session, the insole does not answer the requests for the time.
  receive(0, 5000);
  receive(1, 5010);
  session.tick(5500);
  expect(numbers()).toEqual([0, 1, 2]);
  session.tick(6000);
  expect(numbers()).toEqual([0, 1, 2, 0]);
});

test("after a hello, the request for the time is sent first, because it states when it was made", () => {
  const { session, sent } = start(() => hello(wire.facts.major));
  session.opened(0);
  const before = sent.length;
  session.receive(new Uint8Array(1), 0);
  expect(sent.slice(before, before + 2).map(([kind]) => kind)).toEqual([wire.getTime(0)[0], wire.setClock(0)[0]]);
});

test("an answer to a request from before the clock was set is not used", () => {
  let host_us = 0;
  const { session, requested_us } = start(([index]) =>
    index === 0 ? hello(wire.facts.major) : { kind: "time", host_us, device_us: 500_000 });
  session.opened(0);
  session.receive(Uint8Array.of(0), 0);
  for (const [step_us, is_used] of [[-3_600_000_000, false], [3_600_000_000, false], [0, true]] as const) {
    session.clockChanged(100);
    host_us = requested_us.at(-1)! + step_us;
    session.receive(Uint8Array.of(1), 200);
    expect(session.clock_mapping.unix_s(0.5) !== null).toBe(is_used);
  }
});

test("a page that was suspended does not take the insole from another host, but takes it once that host has left", () => {
  const { session, receive, connects } = startSteps();
  receive({ kind: "refused", reason: "another host", is_other_host: true, is_not_stored: false, is_final: false });
  const before = connects();
  session.tick(60_000);
  expect([session.state, connects()]).toEqual(["other-host", before]);
  for (let now_ms = 60_250; now_ms < 62_000; now_ms += 250) session.tick(now_ms);
  expect([session.state, connects()]).toEqual(["lost", before + 2]);
});

/**
 * A session, and functions that pass it a step or a hello, each one second after the previous message, so that no step waits for
 * the time of the insole's clock.
 */
function startSteps() {
  const messages: ToHost[] = [];
  const { session, sent, steps, transport } = start(([index]) => messages[index!]);
  let now_ms = 0;
  const receive = (message: ToHost) => {
    messages.push(message);
    session.receive(Uint8Array.of(messages.length - 1), (now_ms += 1000));
  };
  const numbered = (number: number): ToHost => ({ kind: "step", key: `${number}`, step: step({ step: number }) });
  const walked = [0, 1, 2, 3, 4, 5, 6].map(numbered);
  session.opened(0);
  const begin = () => receive(hello(wire.facts.major));
  begin();
  const receiveSteps = (...numbers: number[]) => numbers.forEach((number) => receive(walked[number]!));
  const connects = () => sent.filter((message) => message[0] === wire.connect()[0]).length;
  return { session, transport, receive, begin, receiveSteps, connects, numbers: () => steps.map((received) => received.step) };
}

test("a step after a lost one is not used until the insole has sent both: its acknowledgement covers both", () => {
  const { session, begin, receiveSteps, connects, numbers } = startSteps();
  receiveSteps(0, 1, 3, 4);
  expect([numbers(), connects()]).toEqual([[0, 1], 3]);
  // The acknowledgement of step 1 has not arrived, so that step is also repeated.
  begin();
  receiveSteps(1, 2, 3, 4, 5);
  expect([numbers(), connects()]).toEqual([[0, 1, 1, 2, 3, 4, 5], 3]);
  expect(session.state).toBe("live");
});

test("a step that the insole has dropped is not awaited without end", () => {
  const { begin, receiveSteps, connects, numbers } = startSteps();
  receiveSteps(0);
  for (let repetition = 0; repetition < 8; repetition++) {
    receiveSteps(2);
    expect(numbers()).toEqual([0]);
    begin();
  }
  receiveSteps(2, 3);
  expect([numbers(), connects()]).toEqual([[0, 2, 3], 9]);
});

test("steps that another host has received are not awaited", () => {
  const { receive, begin, receiveSteps, connects, numbers } = startSteps();
  receiveSteps(0);
  receive({ kind: "refused", reason: "another host", is_other_host: true, is_not_stored: false, is_final: false });
  begin();
  receiveSteps(5, 6);
  expect([numbers(), connects()]).toEqual([[0, 5, 6], 1]);
});

test("steps that another host has not received are awaited: the insole repeats them after a known one", () => {
  const { receive, begin, receiveSteps, connects, numbers } = startSteps();
  receiveSteps(0, 1);
  receive({ kind: "refused", reason: "another host", is_other_host: true, is_not_stored: false, is_final: false });
  begin();
  receiveSteps(0, 1, 2, 4);
  expect([numbers(), connects()]).toEqual([[0, 1, 0, 1, 2], 2]);
});

test("steps that still wait for the time of the insole's clock at the next hello count as lost", () => {
  const walked = [0, 1, 2].map((number): ToHost => ({ kind: "step", key: String(number), step: step({ step: number }) }));
  const messages = [hello(wire.facts.major), ...walked];
  const { session, steps } = start(([index]) => messages[index!]);
  const receive = (index: number, now_ms: number) => session.receive(Uint8Array.of(index), now_ms);
  session.opened(0);
  receive(0, 0);
  receive(1, 2000);
  receive(0, 5000);
  receive(2, 5010);
  receive(3, 5020);
  receive(0, 6000);
  receive(3, 8000);
  expect(steps.map((received) => received.step)).toEqual([0]);
});

test("all records that arrive through plantar serve are used, because it may no longer have the missing ones", () => {
  const { transport, receiveSteps, connects, numbers } = startSteps();
  transport.can_lose_records = false;
  receiveSteps(0, 4, 6);
  expect([numbers(), connects()]).toEqual([[0, 4, 6], 1]);
});

test("a second insole for a foot is not used", () => {
  const received: unknown[] = [];
  const sent: Uint8Array[] = [];
  const transport: Transport = {
    location: "in a test",
    is_replay: false,
    can_lose_records: true,
    send: (_, message) => sent.push(message),
    close: () => undefined,
  };
  const onRecord = (message: RecordMessage) => received.push(message);
  const session = new Session(1, wire, () => transport, onRecord, () => undefined, (side) => side === "left", () => false);
  session.opened(0);
  const requests = sent.length;
  messagesOf(0).slice(0, 500).forEach((message) => session.receive(message, 10));
  expect([session.state, session.live, received.length, sent.length]).toEqual(["same-foot", undefined, 0, requests]);
  const problem = sessionProblems(session, wire.facts);
  expect(problem.join()).toMatch(/Both insoles are for the left foot/);
  // The first insole for this foot is still connected.
  session.closed("out of reach or switched off");
  expect(sessionProblems(session, wire.facts)).toEqual(problem);
});

/** The insoles of the page, with an open link to both, and functions that open both links again and pass on a hello. */
function startInsoles() {
  const none = () => undefined;
  const shape = vi.fn();
  const message = vi.fn();
  const events = { live: none, shape, record: none, isKnown: () => false, answer: none, message };
  const insoles = new Insoles(wire, new Recorder(), events);
  insoles.use({ location: "in a test", is_replay: false, can_lose_records: true, send: none, close: none });
  const open = () => ([0, 1] as const).forEach((insole) => insoles.transportEvents.opened(insole));
  open();
  const hellos = { left: messagesOf(0)[0]!, right: messagesOf(1)[0]! };
  /** The insole with this index states that it is the one for this foot. */
  const identify = (insole: 0 | 1, side: Side) => insoles.transportEvents.message(insole, hellos[side]);
  return { insoles, open, identify, shape, message, states: () => insoles.sessions.map(({ state }) => state) };
}

test("of two insoles for one foot, the one whose hello arrives later is not used, in either order", () => {
  for (const [first, second] of [[0, 1], [1, 0]] as const) {
    const { insoles, identify, shape, states } = startInsoles();
    identify(first, "left");
    shape.mockClear();
    identify(second, "left");
    // The hello of the second insole does not clear the ellipses of the first one.
    expect(shape).not.toHaveBeenCalled();
    expect([states()[first], states()[second], insoles.of("left")?.insole]).toEqual(["live", "same-foot", first]);
  }
});

test("two insoles that have changed places are both used after the links were opened again", () => {
  for (const [first, second] of [[0, 1], [1, 0]] as const) {
    const { open, identify, states } = startInsoles();
    identify(first, "left");
    identify(second, "right");
    open();
    identify(first, "right");
    identify(second, "left");
    expect(states()).toEqual(["live", "live"]);
  }
});

test("a hello after a reconnection is passed on with the foot that it names", () => {
  const { open, identify, message } = startInsoles();
  identify(0, "left");
  open();
  identify(0, "right");
  expect(message.mock.calls.map(([, side]) => side)).toEqual(["left", "right"]);
});

test("a hello without a reconnection is passed on with the foot that it names, after the insole was silent", () => {
  const { insoles, identify, message, states } = startInsoles();
  identify(0, "left");
  const begin_ms = performance.now();
  for (let passed_ms = 250; passed_ms < TIMEOUT_MS + 1000; passed_ms += 250) insoles.tick(begin_ms + passed_ms);
  expect(states()).toEqual(["lost", "waiting"]);
  identify(0, "right");
  expect(message.mock.calls.map(([, side]) => side)).toEqual(["left", "right"]);
});

test("the hello of a second insole for a foot is passed on once the first one has to send its hello again", () => {
  const { insoles, identify, message } = startInsoles();
  identify(0, "left");
  identify(1, "left");
  expect(message).toHaveBeenCalledOnce();
  insoles.transportEvents.closed(0, "out of reach");
  insoles.transportEvents.opened(0);
  identify(1, "left");
  expect([insoles.sessions[1]!.state, message.mock.calls.length]).toEqual(["live", 2]);
});

test("after two insoles have changed places, the first one to send its hello is used for its foot at once", () => {
  const { insoles, open, identify } = startInsoles();
  identify(0, "right");
  expect(insoles.of("right")?.insole).toBe(0);
  open();
  identify(1, "right");
  expect([insoles.of("right")?.insole, insoles.sessions[0]!.state]).toEqual([1, "waiting"]);
});

test("an insole with a fault at its start still measures, unless it has no cells", () => {
  let next: ToHost;
  const { session } = start(() => next);
  session.opened(0);
  const problems = (fault: string | null, cells: number, reset: string) => {
    next = { ...hello(wire.facts.major), fault, cells, reset } as ToHost;
    session.receive(new Uint8Array(1), 0);
    return sessionProblems(session, wire.facts).join();
  };
  const other_rule = "the parameters belong to another contact rule and are not used: identify or send them again";
  expect(problems(null, 240, "power")).toBe("");
  expect(problems(other_rule, 240, "power")).toMatch(/measures, but reports a fault.*identify or send them again/);
  expect(problems("src/firmware/scan.rs:1 failed", 240, "panic")).toMatch(/restarted after a fault/);
  expect(problems("cell 3 has no area", 0, "power")).toMatch(/cannot measure.*cell 3/);
});

test("the rate is the mean of the last two seconds, and at first the mean since the hello", () => {
  const { session } = start();
  session.opened(0);
  const [hello, ...messages] = messagesOf(0);
  session.receive(hello!, 1000);
  const frames = messages.filter((message) => wire.decode(message)?.kind === "live");
  frames.slice(0, 400).forEach((message, i) => {
    session.receive(message, 1010 + 10 * i);
    if (i % 50 === 49) expect(session.rate_hz(1010 + 10 * i)).toBeCloseTo(100, -1);
  });
});

test("frames that arrive together after a pause of the browser do not raise the rate above that of the insole", () => {
  const { session, receive } = startLive();
  for (let sequence = 0; sequence < 300; sequence++) receive(live({ sequence }), Math.max(3000, 10 * sequence + 1000));
  expect(session.rate_hz(3990)).toBe(100);
});

test("a page in the background collects the times of the last frames only", () => {
  const { session, receive } = startLive();
  for (let sequence = 0; sequence < 1000; sequence++) receive(live({ sequence }), 10 * sequence);
  expect(session["arrivals_ms"].length).toBeLessThanOrEqual(201);
  expect(session.rate_hz(9990)).toBeCloseTo(100, -1);
});

test("after a timeout the connection is lost and the session sends a connect request again", () => {
  const { session, sent } = start();
  session.opened(0);
  session.receive(messagesOf(0)[0]!, 0);
  // After a time in the background, in which it has requested nothing, the page does not take the insole from another host.
  session.tick(TIMEOUT_MS + 1);
  for (let now_ms = TIMEOUT_MS + 250; now_ms < TIMEOUT_MS + 1000; now_ms += 250) session.tick(now_ms);
  expect(session.state).toBe("live");
  session.tick(TIMEOUT_MS + 1000);
  expect(session.state).toBe("lost");
  expect(sent.at(-1)).toEqual(wire.connect());
});

test("a session that another host has taken waits until the insole no longer answers", () => {
  let next: ToHost = hello(wire.facts.major);
  const { session, sent } = start(() => next);
  session.opened(0);
  session.receive(new Uint8Array(1), 0);
  next = { kind: "refused", reason: "another host", is_other_host: true, is_not_stored: false, is_final: false };
  for (const now_ms of [100, 1000, 2500, 4000]) {
    session.receive(new Uint8Array(1), now_ms);
    session.tick(now_ms);
    expect(session.state).toBe("other-host");
  }
  // The session still requests the time. A connect request would take the insole from the other host.
  const connects = () => sent.filter((message) => message[0] === wire.connect()[0]).length;
  expect([connects(), sent.at(-1)?.[0]]).toEqual([1, wire.getTime(0)[0]]);
  for (let now_ms = 4250; now_ms < 4500 + TIMEOUT_MS; now_ms += 250) session.tick(now_ms);
  expect([session.state, connects()]).toEqual(["lost", 2]);
});

test("a session of another host is not ended after the link was opened again, unless the insole is silent", () => {
  let next: ToHost = hello(wire.facts.major);
  const { session, sent } = start(() => next);
  const connects = () => sent.filter((message) => message[0] === wire.connect()[0]).length;
  session.opened(0);
  session.receive(new Uint8Array(1), 0);
  next = { kind: "refused", reason: "another host", is_other_host: true, is_not_stored: false, is_final: false };
  session.receive(new Uint8Array(1), 100);
  session.closed("out of reach");
  expect(session.state).toBe("lost");
  session.opened(60_000);
  session.tick(60_250);
  session.receive(new Uint8Array(1), 60_300);
  expect([session.state, connects()]).toEqual(["other-host", 1]);
  for (let now_ms = 60_500; now_ms < 60_750 + TIMEOUT_MS; now_ms += 250) session.tick(now_ms);
  expect([session.state, connects()]).toEqual(["lost", 2]);
});

test("parameters that could not be stored are in force, and the insole is asked how they were identified", () => {
  let next: ToHost = { ...hello(wire.facts.major), has_parameters: false } as ToHost;
  const { session, sent } = start(() => next);
  const receive = (message: ToHost) => {
    next = message;
    session.receive(new Uint8Array(1), 0);
  };
  session.opened(0);
  receive(next);
  receive({ kind: "refused", reason: "full", is_other_host: false, is_not_stored: true, is_final: false });
  expect(sent.at(-1)).toEqual(wire.getIdentified());
  receive({ kind: "identified", typical: [1, 2] });
  expect([session.hello?.has_parameters, session.typical]).toEqual([true, [1, 2]]);
  // No further request is due.
  const requests = () => sent.filter((message) => message[0] === wire.getIdentified()[0]).length;
  const before = requests();
  session.tick(60_000);
  expect(requests()).toBe(before);
  // The next hello may come from another insole or firmware, for which the list of typical regions is not known yet.
  receive(hello(wire.facts.major + 1));
  expect(session.typical).toEqual([]);
});

test("requests are sent again if their answers were lost", () => {
  let next: ToHost = hello(wire.facts.major);
  const { session, sent } = start(() => next);
  session.opened(0);
  session.receive(new Uint8Array(1), 0);
  const asked = (question: Uint8Array) => sent.filter((message) => message[0] === question[0]).length;
  const questions = [wire.getIdentified(), wire.getAlertRules()];
  expect(questions.map(asked)).toEqual([1, 1]);
  next = live({ sequence: 1 });
  for (let now_ms = 0; now_ms <= 5000; now_ms += 250) {
    session.receive(new Uint8Array(1), now_ms);
    session.tick(now_ms);
  }
  expect(questions.map(asked)).toEqual([2, 2]);
});

test("lost requests for the streams are sent again until the streams arrive", () => {
  let next: ToHost = hello(wire.facts.major);
  const { session, sent, requested_us } = start(() => next);
  const requests = () => [wire.stream(true), wire.streamEllipses(0)].map(([kind]) => sent.filter((message) => message[0] === kind).length);
  const wait = (from_ms: number) => {
    for (let now_ms = from_ms; now_ms <= from_ms + 5000; now_ms += 250) {
      session.receive(new Uint8Array(1), now_ms);
      session.tick(now_ms);
    }
  };
  session.opened(0);
  session.receive(new Uint8Array(1), 0);
  expect(requests()).toEqual([1, 1]);
  next = { kind: "time", host_us: requested_us[0]!, device_us: 500_000 };
  wait(0);
  expect([session.state, requests()]).toEqual(["live", [2, 2]]);
  next = live();
  wait(5250);
  expect(requests()).toEqual([2, 3]);
  next = { kind: "ellipses", t_s: 0, regions: [null] };
  wait(10_500);
  expect(requests()).toEqual([2, 3]);
});

describe("an insole of another major version", () => {
  test("is identified, but its values are ignored", () => {
    let next: ToHost = hello(wire.facts.major + 1);
    const { session, sent } = start(() => next);
    session.opened(0);
    session.receive(new Uint8Array(1), 0);
    expect(session.state).toBe("other-version");
    next = live({}, 100);
    session.receive(new Uint8Array(1), 1);
    expect(session.live).toBeUndefined();
    session.tick(10_000);
    expect(sent).toEqual([wire.connect()]);
  });
});

test("an insole rests while it measures twice a second, but not if most of its frames are lost", () => {
  let next: ToHost = hello(wire.facts.major);
  const { session } = start(() => next);
  session.opened(0);
  session.receive(new Uint8Array(1), 0);
  const rests = (sequence: number, t_s: number) => {
    next = live({ sequence, t_s });
    session.receive(new Uint8Array(1), 0);
    return session.is_resting;
  };
  expect([rests(0, 1), rests(1, 1.01), rests(51, 1.51), rests(52, 1.52)]).toEqual([false, false, false, false]);
  expect([rests(53, 2.02), rests(60, 5.52), rests(61, 6.02)]).toEqual([true, true, true]);
  // The wearer stands on the insole.
  expect([rests(62, 6.52), rests(63, 6.53)]).toEqual([true, false]);
});

test("a new identification is recommended only after 20 successive steps that ask for it", () => {
  let number = 0;
  const regions = (refit: boolean) => ({ heel: { refit: false }, hallux: { refit } }) as unknown as Step["regions"];
  let refit = false;
  const { session } = start(() => ({ kind: "step", key: String(number), step: step({ step: number++, regions: regions(refit) }) }));
  /** Receives steps; returns after how many of them the identification was recommended, and `undefined` if it was not. */
  const walk = (count: number, asks: boolean) => {
    refit = asks;
    const recommended = Array.from({ length: count }, () => {
      session.receive(new Uint8Array(1), 10_000);
      return session.needs_refit;
    });
    return recommended.includes(true) ? recommended.indexOf(true) + 1 : undefined;
  };
  session.opened(0);
  expect([walk(5, true), walk(1, false), walk(19, true), walk(1, false), walk(25, true)]).toEqual([undefined, undefined, undefined, undefined, 20]);
  expect(walk(1, false)).toBeUndefined();
});
