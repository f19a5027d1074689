import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Alerts, drawAlerts } from "../src/alerts";
import { PhoneCues } from "../src/cues";
import type { ToHost } from "../src/generated/messages";
import type { Alert, Side } from "../src/generated/quantities";
import type { Insoles } from "../src/insoles";
import { type InsoleAnswer, Session } from "../src/session";
import { loadSettings } from "../src/settings";
import type { Wire } from "../src/wire";
import { element } from "./elements";
import { hello, loadWire } from "./wire";

vi.mock("../src/dom", async () => (await import("./elements")).dom);

const wire = await loadWire();
/** Replaces the document of the page. */
const page = Object.assign(new EventTarget(), { hidden: false, documentElement: { style: { setProperty: () => undefined } } });
const vibrate = vi.fn();
const tone = vi.fn();
/** The contents of `localStorage`. */
const items = new Map<string, string>();
/** The page's handler of changes of `localStorage` by other tabs. */
let storageChanged: (event: { key: string }) => void;

beforeEach(() => {
  vi.useFakeTimers();
  vi.clearAllMocks();
  vi.spyOn(PhoneCues.prototype, "tone").mockImplementation(tone);
  items.clear();
  const setItem = (key: string, value: string) => void items.set(key, value);
  vi.stubGlobal("localStorage", { getItem: (key: string) => items.get(key) ?? null, setItem });
  vi.stubGlobal("addEventListener", (_: string, handler: typeof storageChanged) => void (storageChanged = handler));
  vi.stubGlobal("document", page);
  vi.stubGlobal("HTMLInputElement", Object);
  vi.stubGlobal("navigator", { vibrate });
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

/** The session with an insole, its requests, and a function that passes it a message. */
function connect(side: Side, answered: (answer: InsoleAnswer, session: Session) => void) {
  let next: ToHost;
  const sent: Uint8Array[] = [];
  const core = Object.assign(Object.create(wire), { decode: () => next }) as Wire;
  const send = (_: unknown, message: Uint8Array) => sent.push(message);
  const transport = { location: "", is_replay: false, can_lose_records: true, send, close: () => undefined };
  const [ignore, no] = [() => undefined, () => false];
  const session = new Session(side === "left" ? 0 : 1, core, () => transport, ignore, answered, no, no);
  const receive = (message: ToHost) => {
    next = message;
    session.receive(new Uint8Array(1), performance.now());
  };
  receive({ ...hello(wire.facts.major), side } as ToHost);
  return { session, sent, receive };
}

/** The message with rules of alerts for a day that begins this many minutes after midnight of this device's time zone. */
const rules = (is_on: boolean, after_min = 0): ToHost => ({
  kind: "alert_rules", per_day: is_on ? 20 : 0, day_start_min: (new Date().getTimezoneOffset() + 1440 + after_min) % 1440,
});

/** The alerts of the page with two insoles, of which the alerts are on or off. */
function start(is_on = false) {
  const answered = (answer: InsoleAnswer, session: Session): void => alerts.answered(answer, session);
  const [left, right] = [connect("left", answered), connect("right", answered)];
  const sessions = [left.session, right.session];
  const insoles = { transport: { is_replay: false }, sessions, of: (side: Side) => sessions.find((session) => session.hello?.side === side) };
  const settings = loadSettings(() => ({ getItem: () => null }) as unknown as Storage);
  const alerts = new Alerts(wire, insoles as unknown as Insoles, settings);
  alerts.listen();
  for (const { receive } of [left, right]) receive(rules(is_on));
  alerts.update();
  return { alerts, left, right };
}

const [box, note] = [element("alerts-on"), element("alerts-note")];

/** The texts of the notes. */
const problems = ({ alerts }: { alerts: Alerts }) => alerts.problems().map(([, , text]) => text);

/** An alert about sustained load of these regions, and about the dose of others. */
const alertOf = (side: Side, sustained: string[], dose: string[] = []) =>
  ({ side, boots_since: 0, start_s: 0, sustained, dose, advice: `Unload your ${side} foot.` }) as unknown as Alert;

/** The page runs for this time, and each connected insole of `loaded` reports these regions as being under sustained load. */
function run({ alerts }: { alerts: Alerts }, duration_s: number, ...loaded: [ReturnType<typeof connect>, string[]][]): void {
  for (let t_s = 0; t_s < duration_s; t_s += 1) {
    if (t_s % 5 === 0) for (const [{ session, receive }, regions] of loaded) if (session.state === "live") receive(daily(...regions));
    alerts.follow();
    if (!page.hidden) alerts.update();
    vi.advanceTimersByTime(1000);
  }
  alerts.follow();
  alerts.update();
}

/** The wearer turns the alerts on. The left insole accepts this, and the right one answers with a refusal. */
function turnOn({ alerts, left, right }: ReturnType<typeof start>): void {
  expect([box.disabled, box.checked]).toEqual([false, false]);
  box.checked = true;
  box.onchange();
  left.receive(rules(true));
  right.receive({ kind: "refused", reason: "busy", is_other_host: false, is_not_stored: false, is_final: false });
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
  all.right.receive(rules(false));
  all.alerts.update();
  expect([box.disabled, box.indeterminate]).toEqual([false, true]);
  const refused = "The right insole did not accept the change: its alerts are off. The reason: busy.";
  expect(note.content).toBe(JSON.stringify([`Alerts are on for the left foot only. ${refused}`]));
});

test("a refusal is shown as soon as it arrives, and in the notes of all views until the wearer closes it", () => {
  const all = start();
  const { alerts, left, right } = all;
  const refuse = (insole: typeof left, is_not_stored = false) =>
    insole.receive({ kind: "refused", reason: "no changes", is_other_host: false, is_not_stored, is_final: true });
  const shown = () => {
    alerts.update();
    return [box.checked, note.content, problems(all)];
  };
  const refused = ({ side }: { side: Side }) => `The ${side} insole did not accept the change: its alerts are off.`;
  box.checked = true;
  box.onchange();
  expect(shown()).toEqual([true, JSON.stringify(["The insole has not answered yet."]), []]);
  refuse(left);
  refuse(right);
  const text = `${refused({ side: "left" })} ${refused({ side: "right" })} The reason: no changes.`;
  expect(shown()).toEqual([false, JSON.stringify([text]), [text]]);
  vi.advanceTimersByTime(60_000);
  expect(shown()).toEqual([false, JSON.stringify([text]), [text]]);
  expect(JSON.stringify(alerts.problems())).toContain("withdraw-alerts");
  alerts.withdraw();
  expect(shown()).toEqual([false, JSON.stringify([""]), []]);
  // Rules that were only not stored are in force, so the insole is asked for them at once.
  box.checked = true;
  box.onchange();
  refuse(left, true);
  expect(left.sent.at(-1)).toEqual(wire.getAlertRules());
  for (const { receive } of [left, right]) receive(rules(true));
  expect(shown()).toEqual([true, JSON.stringify([""]), []]);
});

test("the regions of an alert, of which some names contain commas, are separated by semicolons", () => {
  const regions = ["metatarsals_12", "metatarsals_35"];
  const body = vi.spyOn(element("alert-list"), "querySelector").mockReturnValue("alert-rows" as never);
  drawAlerts([{ alert: alertOf("left", regions), start_unix_s: null }] as never);
  expect(element("alert-rows").content).toContain('"Ball, inner; Ball, outer"');
  body.mockRestore();
});

test("a change by another host is not reported as one that an insole did not accept", () => {
  const all = start();
  turnOn(all);
  all.right.receive(rules(true));
  all.alerts.update();
  all.left.receive(rules(false));
  all.alerts.update();
  expect(note.content).toBe(JSON.stringify(["Alerts are on for the right foot only."]));
});

test("the reason of a refusal is that of an insole that was asked", () => {
  const all = start();
  box.checked = true;
  box.onchange();
  const other = connect("left", () => undefined).session;
  all.alerts.answered({ kind: "refused", reason: "busy", is_other_host: false, is_not_stored: false, is_final: false }, all.right.session);
  all.alerts.answered({ kind: "refused", reason: "of another request", is_other_host: false, is_not_stored: false, is_final: false }, other);
  vi.advanceTimersByTime(3000);
  all.alerts.update();
  expect(note.content).toContain("The reason: busy.");
});

test("rules that are in force although the insole refused the request are shown as in force", () => {
  const all = start();
  turnOn(all);
  all.right.receive(rules(true));
  all.alerts.update();
  expect([box.disabled, box.checked, box.indeterminate]).toEqual([false, true, false]);
  expect(note.content).toBe(JSON.stringify([""]));
});

test("the alerts of the insole of each foot are paused, but not those of a second insole for a foot", () => {
  const { alerts, left, right } = start();
  const other = connect("left", () => undefined);
  other.session.state = "same-foot";
  alerts["insoles"].sessions.push(other.session);
  element("alert-snooze").onclick();
  const pause = wire.snoozeAlerts(30 * 60);
  expect([left.sent.at(-1), right.sent.at(-1)]).toEqual([pause, pause]);
  expect(other.sent).not.toContainEqual(pause);
});

test("a signal in a hidden page is repeated when the page becomes visible, unless the wearer has closed the alert", () => {
  const { alerts } = start(true);
  const setHidden = (hidden: boolean) => {
    page.hidden = hidden;
    page.dispatchEvent(new Event("visibilitychange"));
  };
  setHidden(true);
  alerts.raise(alertOf("left", ["heel"]), null, undefined);
  expect(vibrate).toHaveBeenCalledTimes(1);
  setHidden(false);
  expect(vibrate).toHaveBeenCalledTimes(2);
  element("alert-close").onclick();
  setHidden(true);
  setHidden(false);
  expect(vibrate).toHaveBeenCalledTimes(2);
});

test("an alert that the wearer has not closed is shown after the page was ended, and an alert about a dose is not replaced by a later alert", () => {
  const alert = (advice: string, dose: string[]) => ({ side: "left", boots_since: 0, start_s: 0, sustained: [], dose, advice }) as unknown as Alert;
  const stored = (age_s: number, advice: string, dose: string[] = []) => ({ alert: alert(advice, dose), start_unix_s: Date.now() / 1000 - age_s });
  const shown = () => JSON.parse(element("alert-text").content).map((node: string[]) => node[2]);
  const { alerts } = start(true);
  const all = [stored(600, "old"), stored(90, "dose", ["heel"]), stored(60, "first"), stored(30, "second")];
  alerts.restore(all as never);
  expect(shown()).toEqual(["dose", "second"]);
  element("alert-close").onclick();
  const { alerts: reloaded } = start(true);
  reloaded.restore(all as never);
  expect(shown()).toEqual([]);
});

test("an insole with a day from midnight UTC, or as this page has set it before, is asked once to follow the time zone", () => {
  const offset_min = vi.spyOn(Date.prototype, "getTimezoneOffset").mockReturnValue(420);
  const { alerts, left, right } = start();
  const counts = () => {
    for (let i = 0; i < 3; i += 1) alerts.followTimeZone();
    return [left, right].map(({ sent }) => sent.length);
  };
  const [of_left, of_right] = counts() as [number, number];
  // Somebody has chosen another time for the right insole.
  left.receive({ kind: "alert_rules", per_day: 20, day_start_min: 0 });
  right.receive({ kind: "alert_rules", per_day: 20, day_start_min: 240 });
  expect(counts()).toEqual([of_left + 1, of_right]);
  left.receive({ kind: "alert_rules", per_day: 20, day_start_min: 420 });
  expect(counts()).toEqual([of_left + 1, of_right]);
  // The wearer travels.
  offset_min.mockReturnValue(360);
  expect(counts()).toEqual([of_left + 2, of_right]);
  // The request or what it has changed was lost, and the insole connects again.
  left.receive(hello(wire.facts.major));
  const connected = left.sent.length;
  expect(counts()).toEqual([connected, of_right]);
  left.receive({ kind: "alert_rules", per_day: 20, day_start_min: 0 });
  expect(counts()).toEqual([connected + 1, of_right]);
  offset_min.mockRestore();
});

test("the switch of the alerts leaves a start of the day that somebody else has chosen", () => {
  const offset_min = vi.spyOn(Date.prototype, "getTimezoneOffset").mockReturnValue(420);
  const { right } = start();
  right.receive(rules(false, 240));
  const setAlerts = vi.spyOn(wire, "setAlerts");
  box.checked = true;
  box.onchange();
  const sent = setAlerts.mock.calls.map(([, is_on, day_start_min]) => [is_on, day_start_min]);
  expect(sent).toEqual([[true, 420], [true, 660]]);
  setAlerts.mockRestore();
  offset_min.mockRestore();
});

test("a pause that the insole has not received is sent again", () => {
  const { alerts, left } = start();
  element("alert-snooze").onclick();
  const before = left.sent.length;
  const load = (snoozed_s: number) => left.receive({ kind: "daily_load", load: { snoozed_s } } as ToHost);
  const resent = () => {
    alerts.sendPauses();
    return left.sent.length - before;
  };
  expect(resent()).toBe(0);
  load(0);
  expect([resent(), resent()]).toEqual([1, 1]);
  // The insole's own pause after an alert, which is shorter than the requested one.
  load(1190);
  expect([resent(), resent()]).toEqual([2, 2]);
  load(1799);
  expect(resent()).toBe(2);
  // The insole has confirmed it. If it reports none later, another host has ended it.
  load(0);
  expect(resent()).toBe(2);
});

test("a pause is neither sent to an insole with a longer one, nor after the clock was set back, nor for another wearer", () => {
  const { alerts, left, right } = start();
  const pauses = ({ sent }: typeof left) => sent.filter(([kind]) => kind === wire.snoozeAlerts(0)[0]).length;
  const load = (insole: typeof left, snoozed_s: number) =>
    insole.receive({ kind: "daily_load", load: { snoozed_s } } as ToHost);
  load(left, 7_200);
  element("alert-snooze").onclick();
  expect([pauses(left), pauses(right)]).toEqual([0, 1]);
  vi.setSystemTime(Date.now() - 3_600_000);
  load(right, 0);
  alerts.sendPauses();
  expect(pauses(right)).toBe(1);
  element("alert-snooze").onclick();
  expect(alerts.pauseTexts()[0]?.rest).toContain("30 minutes");
  alerts.forget();
  load(right, 0);
  alerts.sendPauses();
  expect(pauses(right)).toBe(2);
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
  // The insole may have a longer pause, which its first load of the day states.
  alerts.sendPauses();
  expect(pauses(left)).toEqual([]);
  left.receive({ kind: "daily_load", load: { snoozed_s: 0 } } as ToHost);
  alerts.sendPauses();
  alerts.sendPauses();
  expect([pauses(left), pauses(right)]).toEqual([[rest], [whole]]);
});

test("a pause applies after a reload of the page, to the insole of each foot, and also in another tab", () => {
  const pauses = ({ sent }: ReturnType<typeof connect>) => sent.filter(([kind]) => kind === wire.snoozeAlerts(0)[0]);
  const first = start();
  first.left.session.closed("out of reach");
  element("alert-snooze").onclick();
  // The alerts of the right foot were paused by another tab, too, and that pause has ended.
  items.set("plantar.alerts_paused_until_ms.right", String(Date.now()));
  vi.advanceTimersByTime(60_000);
  const { alerts, left, right } = start();
  expect(alerts.pauseTexts()).toEqual([{
    feet: "No alert of the left foot can come now.",
    rest: "The next one can come in 29 minutes: alerts pause after each alert, and when you ask for it.",
  }]);
  for (const { receive } of [left, right]) receive({ kind: "daily_load", load: { snoozed_s: 0 } } as ToHost);
  alerts.sendPauses();
  expect([pauses(left), pauses(right)]).toEqual([[wire.snoozeAlerts(29 * 60)], []]);
  items.set("plantar.alerts_paused_until_ms.right", String(Date.now() + 60_000));
  storageChanged({ key: "plantar.alerts_paused_until_ms.right" });
  alerts.sendPauses();
  expect([pauses(left).length, pauses(right)]).toEqual([1, [wire.snoozeAlerts(60)]]);
});

test("an alert of a recording pauses no insole of the wearer", () => {
  const { alerts } = start();
  Object.assign(alerts["insoles"], { transport: { is_replay: true } });
  element("alert-snooze").onclick();
  expect(alerts.pauseTexts()).toEqual([]);
});

/** The load of the day of a foot in which these regions are under sustained load. */
const daily = (...sustained: string[]) =>
  ({ kind: "daily_load", load: { snoozed_s: 0, alerts: 1, sustained, regions: { heel: { sustained_s: 60, dose_kpa_s: 0 } } } }) as unknown as ToHost;

test("a region that comes under sustained load after the alert is added to it", () => {
  const { alerts, left, right } = start(true);
  alerts.raise(alertOf("left", ["hallux"]), null, undefined);
  left.receive(daily("hallux"));
  right.receive(daily("toe_2"));
  alerts.update();
  expect(element("alert-text").content).not.toContain("Now also");
  left.receive(daily("hallux", "heel"));
  alerts.update();
  expect(element("alert-text").content).toContain(" Now also under sustained load: heel.");
  // What an insole has reported before its connection was lost may not be true any more.
  left.session.closed("out of reach");
  alerts.update();
  expect(element("alert-text").content).not.toContain("Now also");
});

test("a load of the day is not shown as that of today after midnight, and states its time without a connection", () => {
  vi.setSystemTime(new Date(2026, 0, 1, 23, 30));
  const { alerts, left } = start();
  left.receive(rules(true));
  left.receive(daily());
  alerts.update();
  expect([element("today").hidden, element("today-note").content]).toEqual([false, JSON.stringify(["Alerts today: 1."])]);
  left.session.closed("out of reach");
  vi.setSystemTime(new Date(2026, 0, 1, 23, 59));
  alerts.update();
  expect(element("today-note").content).toContain("The values of the left foot are those of 23:30.");
  vi.setSystemTime(new Date(2026, 0, 2, 0, 1));
  alerts.update();
  expect(element("today").hidden).toBe(true);
});

test("a day of an insole that does not begin at midnight of this device is named", () => {
  const { alerts, left } = start();
  left.receive(rules(true, 19 * 60));
  left.receive(daily());
  alerts.update();
  expect(element("today-note").content).toContain("The day of the left insole begins at 19:00.");
});

test("an alert states its time, and is closed when the wearer closes it in another tab", () => {
  vi.setSystemTime(new Date(2026, 0, 1, 10, 42));
  const { alerts } = start(true);
  const alert = alertOf("left", ["heel"]);
  alerts.raise(alert, Date.now() / 1000 - 60, undefined);
  expect(element("alert-text").content).toMatch(/Raised at 10:41/);
  storageChanged({ key: "plantar.settings" });
  expect(element("alert").hidden).toBe(false);
  storageChanged({ key: "plantar.alerts_closed_unix_s" });
  expect(element("alert").hidden).toBe(true);
});

test("without an insole, the switch has its last known state, and the page states why it cannot be changed", () => {
  const all = start();
  for (const { receive } of [all.left, all.right]) receive(rules(true));
  all.alerts.update();
  for (const { session } of [all.left, all.right]) session.closed("out of reach");
  all.alerts.update();
  expect([box.disabled, box.checked]).toEqual([true, true]);
  expect(note.content).toContain("No insole is connected.");
  all.left.receive({ ...hello(wire.facts.major), side: "left" } as ToHost);
  all.alerts.update();
  expect([box.disabled, box.checked]).toEqual([true, true]);
  expect(note.content).toContain("not reported yet");
  all.left.receive(rules(true));
  Object.assign(all.alerts["insoles"], { transport: { is_replay: true } });
  all.alerts.update();
  expect(box.disabled).toBe(true);
  expect(note.content).toContain("This is a recording.");
  // A page that has never known the state shows neither "on" nor "off".
  all.alerts.listen();
  all.alerts.update();
  expect(box.indeterminate).toBe(true);
});

test("the touch that turns alerts on lets the phone sound once, unless the wearer has turned the sound off", () => {
  const { alerts } = start();
  const touch = (is_on: boolean) => {
    box.checked = is_on;
    box.onchange();
    return tone.mock.calls.length;
  };
  expect([touch(true), touch(false)]).toEqual([1, 1]);
  element("alert-sound").checked = false;
  element("alert-sound").onchange();
  expect(touch(true)).toBe(1);
  expect(alerts["settings"].alert_sound).toBe(false);
});

test("the signal of an alert is repeated for about five minutes, unless the wearer closes it or the region is relieved", () => {
  const all = start(true);
  all.alerts.raise(alertOf("left", ["heel"]), null, undefined);
  run(all, 44, [all.left, ["heel"]]);
  expect(tone).toHaveBeenCalledTimes(1);
  run(all, 2, [all.left, ["heel"]]);
  expect(tone).toHaveBeenCalledTimes(2);
  run(all, 1200, [all.left, ["heel"]]);
  expect(tone).toHaveBeenCalledTimes(7);
  for (const end of [() => element("alert-close").onclick(), () => run(all, 6, [all.left, []])]) {
    all.alerts.raise(alertOf("left", ["heel"]), Date.now() / 1000, undefined);
    run(all, 6, [all.left, ["heel"]]);
    tone.mockClear();
    end();
    run(all, 300);
    expect(tone).not.toHaveBeenCalled();
  }
});

test("an alert of any age is shown exactly while its region is under sustained load, as far as the insole is connected", () => {
  const all = start(true);
  const { left, right } = all;
  const banner = element("alert");
  const text = () => element("alert-text").content;
  all.alerts.restore([{ alert: alertOf("left", ["heel", "hallux"]), start_unix_s: Date.now() / 1000 - 3 * 3600 }] as never);
  run(all, 4);
  expect(banner.hidden).toBe(true);
  // The other foot, and another region.
  run(all, 10, [left, ["toe_2"]], [right, ["heel"]]);
  expect([banner.hidden, tone.mock.calls.length]).toEqual([true, 0]);
  run(all, 20, [left, ["hallux"]]);
  expect(banner.hidden).toBe(false);
  // The banner now names the other region, too.
  run(all, 6, [left, ["toe_2"]]);
  expect([banner.hidden, text()]).toEqual([false, expect.stringContaining("Now also under sustained load: second toe.")]);
  run(all, 6, [left, []]);
  expect(banner.hidden).toBe(true);
  // A load that returns is shown, also for long, without a signal.
  run(all, 6, [left, ["toe_2"]]);
  expect(banner.hidden).toBe(true);
  tone.mockClear();
  run(all, 300, [left, ["heel"]]);
  expect([banner.hidden, tone.mock.calls.length]).toEqual([false, 0]);
  expect(text()).toContain("This message goes when the foot was unloaded for long enough.");
  // Without a connection, the last report counts for five minutes.
  left.session.closed("out of reach");
  run(all, 280);
  expect(banner.hidden).toBe(false);
  expect(text()).toContain("The insole is not connected, so this page cannot see whether the foot is unloaded.");
  expect(text()).not.toContain("This message goes");
  run(all, 30);
  expect(banner.hidden).toBe(true);
  left.receive({ ...hello(wire.facts.major), side: "left" } as ToHost);
  run(all, 6, [left, ["heel"]]);
  expect(banner.hidden).toBe(false);
});

test("an alert of the last visit is signalled if the load has lasted since then", () => {
  const all = start(true);
  all.alerts.restore([{ alert: alertOf("left", ["heel"]), start_unix_s: Date.now() / 1000 - 3600 }] as never);
  run(all, 6, [all.left, ["heel"]]);
  expect([element("alert").hidden, tone.mock.calls.length]).toEqual([false, 1]);
});

test("an alert ends when it is older than a day, or when its insole reports that alerts are off", () => {
  const all = start(true);
  const ends = [() => vi.setSystemTime(Date.now() + 86_400_000), () => all.left.receive(rules(false))];
  for (const end of ends) {
    all.alerts.raise(alertOf("left", ["heel"]), Date.now() / 1000, undefined);
    run(all, 6, [all.left, ["heel"]]);
    expect(element("alert").hidden).toBe(false);
    tone.mockClear();
    end();
    run(all, 60, [all.left, ["heel"]]);
    expect([element("alert").hidden, tone.mock.calls.length]).toEqual([true, 0]);
  }
});

test("a load of the day that arrived before the alert does not end it", () => {
  const all = start(true);
  all.left.receive(daily());
  all.alerts.raise(alertOf("left", ["heel"]), null, undefined);
  run(all, 4);
  expect(element("alert").hidden).toBe(false);
  run(all, 2, [all.left, []]);
  expect(element("alert").hidden).toBe(true);
});

test("an alert about a dose is shown until the wearer closes it or its day ends", () => {
  vi.setSystemTime(new Date(2026, 0, 1, 9));
  const all = start(true);
  const hidden = () => {
    all.alerts.update();
    return element("alert").hidden;
  };
  all.alerts.raise(alertOf("left", ["heel"], ["heel"]), Date.now() / 1000, undefined);
  run(all, 600, [all.left, []]);
  vi.setSystemTime(new Date(2026, 0, 1, 23, 59));
  expect([hidden(), tone.mock.calls.length]).toEqual([false, 7]);
  vi.setSystemTime(new Date(2026, 0, 2, 0, 1));
  expect(hidden()).toBe(true);
});

test("after the last alert of the day, no time of a next one is stated", () => {
  const { alerts, left, right } = start();
  for (const { receive } of [left, right]) receive(rules(true));
  const load = (alerts: number) => ({ kind: "daily_load", load: { snoozed_s: 1190, alerts, sustained: [], regions: {} } }) as unknown as ToHost;
  left.receive(load(20));
  right.receive(load(19));
  const complete = "The largest number of alerts of a day is reached: no more of the left foot come today.";
  expect(alerts.pauseTexts().map(({ feet }) => feet)).toEqual([complete, "No alert of the right foot can come now."]);
  right.receive(load(20));
  alerts.update();
  expect(element("today-note").content).toContain(`Alerts today: 40. ${complete} `);
  expect(element("today-note").content).not.toContain("can come");
});

test("a foot of which no alerts can come although the wearer wants them is named, and signalled once, unlike an alert", () => {
  const all = start();
  const { left, right } = all;
  box.checked = true;
  box.onchange();
  left.receive(rules(true));
  tone.mockClear();
  vibrate.mockClear();
  run(all, 4);
  // The right insole did not change its rules.
  expect(problems(all)).toEqual(["No alerts of the right foot: they are off on its insole. Turn them on in the settings."]);
  expect([tone.mock.calls, vibrate.mock.calls]).toEqual([[[[440]]], [[[100]]]]);
  right.receive(rules(true));
  run(all, 1);
  expect(problems(all)).toEqual([]);
  tone.mockClear();
  left.session.closed("out of reach");
  run(all, 115);
  expect([problems(all), tone.mock.calls.length]).toEqual([[], 0]);
  run(all, 300);
  expect(problems(all)).toEqual([expect.stringMatching(/^No alerts of the left foot: its insole is not connected. /)]);
  expect(tone.mock.calls).toEqual([[[440]]]);
  left.session.state = "other-host";
  run(all, 1);
  expect(problems(all)).toEqual([expect.stringMatching(/^No alerts of the left foot: another phone /)]);
  // After a reload of the page, the wish is known. Insoles that were not connected since then are not missed.
  expect(items.get("plantar.alerts_wanted")).toBe("left,right");
  const reloaded = start(true);
  reloaded.left.session.closed("out of reach");
  run(reloaded, 130);
  expect(problems(reloaded)).toEqual([]);
  reloaded.right.session.closed("out of reach");
  run(reloaded, 130);
  expect(problems(reloaded)).toEqual([expect.stringMatching(/^No alerts of the right foot/)]);
  const { transport } = reloaded.alerts["insoles"];
  for (const other of [{ is_replay: true }, undefined]) {
    Object.assign(reloaded.alerts["insoles"], { transport: other });
    run(reloaded, 1);
    expect(problems(reloaded)).toEqual([]);
  }
  // The wearer withdraws the wish, also without an insole.
  Object.assign(reloaded.alerts["insoles"], { transport });
  run(reloaded, 1);
  expect(JSON.stringify(reloaded.alerts.problems())).toContain("withdraw-alerts");
  reloaded.alerts.withdraw();
  run(reloaded, 1);
  expect([problems(reloaded), items.get("plantar.alerts_wanted")]).toEqual([[], ""]);
});

test("the signal of a foot without alerts neither counts as one of an alert, nor delays it", () => {
  const all = start(true);
  items.set("plantar.alerts_wanted", "left,right");
  storageChanged({ key: "plantar.alerts_wanted" });
  all.alerts.raise(alertOf("left", ["heel"]), null, undefined);
  run(all, 30, [all.left, ["heel"]]);
  all.right.receive(rules(false));
  run(all, 14, [all.left, ["heel"]]);
  expect(tone.mock.calls).toEqual([[], [[440]]]);
  run(all, 1200, [all.left, ["heel"]]);
  expect(tone.mock.calls.filter((call) => call.length === 0)).toHaveLength(7);
});

test("the wish for alerts is stored only for the feet of insoles that accept it", () => {
  const all = start();
  box.checked = true;
  box.onchange();
  run(all, 10);
  expect([items.get("plantar.alerts_wanted"), problems(all)]).toEqual(["", []]);
  all.left.receive(rules(true));
  run(all, 1);
  expect(items.get("plantar.alerts_wanted")).toBe("left");
});

test("feet of which the wearer does not want alerts are not named", () => {
  const all = start();
  all.left.session.closed("out of reach");
  run(all, 300);
  expect(all.alerts.problems()).toEqual([]);
  box.checked = true;
  box.onchange();
  box.checked = false;
  box.onchange();
  run(all, 300);
  expect([problems(all), items.get("plantar.alerts_wanted")]).toEqual([[], ""]);
});

test("while alerts are on and the page was not touched, the wearer is asked to touch it, because the browser allows no sound", () => {
  const userActivation = { hasBeenActive: false };
  vi.stubGlobal("navigator", { vibrate, userActivation });
  const { alerts, left } = start();
  expect(alerts.problems()).toEqual([]);
  left.receive(rules(true));
  expect(problems({ alerts })).toEqual(["Touch the page once, to allow the sound of alerts."]);
  userActivation.hasBeenActive = true;
  expect(alerts.problems()).toEqual([]);
});

test("the screen stays on while alerts are on, if the wearer has chosen it", async () => {
  const lock = { released: false, release: async () => void (lock.released = true) };
  const request = vi.fn(async () => lock);
  vi.stubGlobal("navigator", { vibrate, wakeLock: { request } });
  const all = start();
  element("alert-screen").checked = true;
  element("alert-screen").onchange();
  run(all, 1);
  expect([request.mock.calls.length, tone.mock.calls.length]).toEqual([0, 0]);
  all.left.receive(rules(true));
  run(all, 1);
  await vi.advanceTimersByTimeAsync(1);
  expect([request.mock.calls.length, lock.released]).toEqual([1, false]);
  all.left.receive(rules(false));
  run(all, 1);
  expect(lock.released).toBe(true);
});
