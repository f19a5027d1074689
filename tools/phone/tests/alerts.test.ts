import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Alerts } from "../src/alerts";
import type { ToHost } from "../src/generated/messages";
import type { Alert, Side } from "../src/generated/quantities";
import type { Insoles } from "../src/insoles";
import { Session } from "../src/session";
import { loadSettings } from "../src/settings";
import type { Wire } from "../src/wire";
import { element } from "./elements";
import { hello, loadWire } from "./wire";

vi.mock("../src/dom", async () => (await import("./elements")).dom);

const wire = await loadWire();
/** Replaces the document of the page. */
const page = Object.assign(new EventTarget(), { hidden: false });
const vibrate = vi.fn();

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("document", page);
  vi.stubGlobal("HTMLInputElement", Object);
  vi.stubGlobal("navigator", { vibrate });
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

/** The session with an insole, its requests, and a function that passes it a message. */
function connect(side: Side) {
  let next: ToHost;
  const sent: Uint8Array[] = [];
  const core = Object.assign(Object.create(wire), { decode: () => next }) as Wire;
  const send = (_: unknown, message: Uint8Array) => sent.push(message);
  const transport = { location: "", is_replay: false, can_lose_records: true, send, close: () => undefined };
  const session = new Session(side === "left" ? 0 : 1, core, () => transport, () => undefined);
  const receive = (message: ToHost) => {
    next = message;
    session.receive(new Uint8Array(1), performance.now());
  };
  receive({ ...hello(wire.facts.major), side } as ToHost);
  return { session, sent, receive };
}

/** The alerts of the page with two insoles, which do not raise alerts yet. */
function start() {
  const [left, right] = [connect("left"), connect("right")];
  const sessions = [left.session, right.session];
  const insoles = { sessions, of: (side: Side) => sessions.find((session) => session.hello?.side === side) };
  const settings = loadSettings(() => ({ getItem: () => null }) as unknown as Storage);
  const alerts = new Alerts(wire, insoles as unknown as Insoles, settings);
  alerts.listen();
  for (const { receive } of [left, right]) receive({ kind: "alert_rules", is_on: false });
  alerts.update();
  return { alerts, left, right };
}

const [box, note] = [element("alerts-on"), element("alerts-note")];

/** The wearer turns the alerts on. The left insole accepts this, and the right one answers with a refusal. */
function turnOn({ alerts, left, right }: ReturnType<typeof start>): void {
  expect([box.disabled, box.checked]).toEqual([false, false]);
  box.checked = true;
  box.onchange();
  left.receive({ kind: "alert_rules", is_on: true });
  right.receive({ kind: "refused", reason: "busy", is_other_host: false, is_not_stored: false });
  const count = left.sent.length;
  vi.advanceTimersByTime(3000);
  // The insole that has accepted the change is not asked again.
  expect([left.sent.length, right.sent.at(-1)]).toEqual([count, wire.getAlertRules()]);
  alerts.update();
  // Until the insole answers, the last known rules are shown.
  expect([box.disabled, box.indeterminate]).toEqual([false, true]);
}

test("an insole that did not accept a change of the switch is named, with what is in force there", () => {
  const all = start();
  turnOn(all);
  all.right.receive({ kind: "alert_rules", is_on: false });
  all.alerts.update();
  expect([box.disabled, box.indeterminate]).toEqual([false, true]);
  const refused = "The right insole did not accept the change: its alerts are off.";
  expect(note.content).toBe(JSON.stringify([`Alerts are on for the left foot only. ${refused}`]));
});

test("a change by another host is not reported as one that an insole did not accept", () => {
  const all = start();
  turnOn(all);
  all.right.receive({ kind: "alert_rules", is_on: true });
  all.alerts.update();
  all.left.receive({ kind: "alert_rules", is_on: false });
  all.alerts.update();
  expect(note.content).toBe(JSON.stringify(["Alerts are on for the right foot only."]));
});

test("the reason of a refusal is that of an insole that was asked", () => {
  const all = start();
  box.checked = true;
  box.onchange();
  const other = connect("left").session;
  all.alerts.answered({ kind: "refused", reason: "busy", is_other_host: false, is_not_stored: false }, all.right.session);
  all.alerts.answered({ kind: "refused", reason: "of another request", is_other_host: false, is_not_stored: false }, other);
  vi.advanceTimersByTime(3000);
  all.alerts.update();
  expect(note.content).toContain("The reason: busy.");
});

test("rules that an insole could not store, but that are in force, are shown as in force", () => {
  const all = start();
  turnOn(all);
  all.right.receive({ kind: "alert_rules", is_on: true });
  all.alerts.update();
  expect([box.disabled, box.checked, box.indeterminate]).toEqual([false, true, false]);
  expect(note.content).toBe(JSON.stringify([""]));
});

test("the alerts of the insole of each foot are paused, but not those of a second insole for a foot", () => {
  const { alerts, left, right } = start();
  const other = connect("left");
  other.session.state = "same-foot";
  alerts["insoles"].sessions.push(other.session);
  element("alert-snooze").onclick();
  const pause = wire.snoozeAlerts(30 * 60);
  expect([left.sent.at(-1), right.sent.at(-1)]).toEqual([pause, pause]);
  expect(other.sent).not.toContainEqual(pause);
});

test("a signal in a hidden page is repeated when the page becomes visible, unless the wearer has closed the alert", () => {
  const { alerts } = start();
  const setHidden = (hidden: boolean) => {
    page.hidden = hidden;
    page.dispatchEvent(new Event("visibilitychange"));
  };
  setHidden(true);
  alerts.raise({ side: "left", starts_ago: 0, start_s: 0, advice: "Unload your left foot." } as Alert, null, undefined);
  expect(vibrate).toHaveBeenCalledTimes(1);
  setHidden(false);
  expect(vibrate).toHaveBeenCalledTimes(2);
  element("alert-close").onclick();
  setHidden(true);
  setHidden(false);
  expect(vibrate).toHaveBeenCalledTimes(2);
});

test("a pause is sent to an insole that is connected later, with the rest of its duration", () => {
  const { alerts, left, right } = start();
  const [rest, whole] = [20, 30].map((minutes) => JSON.stringify(wire.snoozeAlerts(minutes * 60)));
  const pauses = ({ sent }: typeof left) =>
    sent.map((message) => JSON.stringify(message)).filter((message) => message === rest || message === whole);
  left.session.closed("out of reach");
  element("alert-snooze").onclick();
  expect([pauses(left), pauses(right)]).toEqual([[], [whole]]);
  vi.advanceTimersByTime(10 * 60_000);
  left.receive({ ...hello(wire.facts.major), side: "left" } as ToHost);
  alerts.sendPauses();
  alerts.sendPauses();
  expect([pauses(left), pauses(right)]).toEqual([[rest], [whole]]);
});
