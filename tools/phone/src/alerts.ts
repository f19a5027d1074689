/**
 * Alerts of the insoles: the request to unload a region, and the load of the day. A pause is a time without alerts: that after
 * each alert, or one that the wearer requests, which the protocol calls a snooze.
 */

import { store, stored } from "./browser_storage";
import { PhoneCues, ScreenWakeLock } from "./cues";
import { isToday } from "./days";
import { type Node, byId, fill } from "./dom";
import { regionTitle, timeOfDayText, timeText } from "./format";
import type { Hello } from "./generated/messages";
import type { Alert, DailyLoad, DailyRegion, Side } from "./generated/quantities";
import type { Insoles } from "./insoles";
import type { InsoleAnswer, Session } from "./session";
import { type Settings, saveSettings } from "./settings";
import { SIDES, sideTitle } from "./side";
import { type StoredAlert, newestFirst } from "./step_store";
import type { Wire } from "./wire";

/** An alert is shown for this time after the insole last reported load on its regions; the alert itself is such a report. */
const FRESH_MS = 300_000;
/** An alert that is older than this when it arrives is only listed. */
const LONGEST_AGE_S = 86_400;
/** Interval of the signals of an alert that is shown, and their number. */
const SIGNAL_INTERVAL_MS = 45_000;
const SIGNALS = 7;
/** A foot of which the wearer wants alerts is reported if its insole was not connected for this time. */
const ABSENT_MS = 120_000;
/** Duration of a snooze. The text of the button in index.html states it, too. */
const SNOOZE_MIN = 30;
/** A pause counts as confirmed if the rest of it that the insole reports is shorter than expected by at most this, s. */
const PAUSE_TOLERANCE_S = 30;
/** Number of alerts in the table. */
const ROWS = 10;
/** Longest time that the insoles need to answer a change of the switch. During this time, the switch is not updated. */
const ANSWER_MS = 3000;
/** Durations of the vibrations of an alert and of the pauses between them, beginning with a vibration. */
const VIBRATION_MS = [400, 200, 400, 200, 400];
/** Vibration and tone for a foot without alerts. They differ from those of an alert, which asks to unload the foot. */
const GAP_VIBRATION_MS = [100];
const GAP_TONE_HZ = [440];

/** The key under which the browser stores when the wearer last closed alerts. */
const CLOSED_KEY = "plantar.alerts_closed_unix_s";

/** The key under which the browser stores the feet of which the wearer wants alerts, separated by commas. */
const WANTED_KEY = "plantar.alerts_wanted";

/** The key under which the browser stores the end of the pause of a foot, as a time of `Date.now()`. */
const pauseKey = (side: Side) => `plantar.alerts_paused_until_ms.${side}`;

/** The key under which the browser stores all starts of the day that this page has sent to insoles, separated by commas. */
const DAY_STARTS_KEY = "plantar.day_starts_min";

/** All starts of the day that this page has sent to insoles, minutes from midnight UTC. */
const ownDayStarts = () => (stored(() => localStorage, DAY_STARTS_KEY) ?? "").split(",");

/** True for the default start of the day, midnight UTC, and for one that this page has sent before. */
const isOwnDayStart = (day_start_min: number) => day_start_min === 0 || ownDayStarts().includes(String(day_start_min));

/** Minutes from midnight UTC to midnight of the phone's time zone. */
const dayStartMinutes = () => (new Date().getTimezoneOffset() + 1440) % 1440;

/**
 * Age of an alert, s. `start_unix_s` is the time of the alert, s since 1970; `null` if it is unknown. `t_s` is the present time
 * on the insole's clock; `undefined` before the first live frame.
 */
function ageOf_s(alert: Alert, start_unix_s: number | null, t_s: number | undefined): number {
  if (start_unix_s !== null) return Date.now() / 1000 - start_unix_s;
  // Without a known time, an alert from before a restart of the insole may be hours old.
  if (alert.boots_since > 0) return Infinity;
  // An alert that may be new counts as new, because a wearer who does not see it does not unload the region.
  return t_s === undefined ? 0 : t_s - alert.start_s;
}

/** True if this load of the day reports a pause of at least `rest_s` seconds, within {@link PAUSE_TOLERANCE_S}. */
const isPaused = (daily: DailyLoad | undefined, rest_s: number) => (daily?.snoozed_s ?? 0) >= rest_s - PAUSE_TOLERANCE_S;

/** True if the load of the day of an insole is that of today. A load that arrived before midnight is not. */
const isOfToday = ({ daily_unix_s }: Session) => isToday(daily_unix_s);

/** An alert that the wearer has not closed. Its times are those of `Date.now()`. */
interface OpenAlert {
  alert: Alert;
  raised_ms: number;
  /** When its foot was last reported to be under sustained load, as `follow` describes; -Infinity once it is not any more. */
  loaded_ms: number;
  /** The load of the day that was known when the alert arrived. It may not contain the load of the alert yet. */
  before: DailyLoad | undefined;
  /** Number of its signals so far. */
  signals: number;
}

/** A time without alerts, as two sentences: of which feet, and until when. */
export interface Pause {
  feet: string;
  /** Changes often; empty if no alert comes on this day. */
  rest: string;
}

/** Shows alerts until their regions are relieved or the wearer closes them. */
export class Alerts {
  private readonly cues = new PhoneCues();
  private readonly screen = new ScreenWakeLock();
  /** The alerts that the wearer has not closed, oldest first. */
  private open: OpenAlert[] = [];
  /** Time of `performance.now()` of the last signal. */
  private signalled_ms = -Infinity;
  /** The feet of which the wearer wants alerts. */
  private wanted: readonly Side[] = [];
  /** The sessions with insoles that the wearer has asked for alerts and that have not confirmed it yet. */
  private asked = new Set<Session>();
  /** When the insole of a foot was last connected in this visit, as a time of `performance.now()`. */
  private readonly connected_ms = new Map<Side, number>();
  /** For each foot of which no alerts can come although the wearer wants them, why, and what to do. */
  private gaps = new Map<Side, string>();
  /** The feet in `gaps` that were signalled since their alerts could last come. */
  private readonly signalled_gaps = new Set<Side>();
  /**
   * The last change of the switch by the wearer: its new state, and the sessions whose insoles were asked for it. `update`
   * removes the connected sessions whose insoles have accepted it.
   */
  private change: { is_on: boolean; sessions: Session[] } = { is_on: false, sessions: [] };
  /** Runs until the insoles must have answered the last change of the switch. */
  private answer_timer: ReturnType<typeof setTimeout> | undefined;
  /** Why an insole refused this change, as a phrase; empty if none did. */
  private refusal = "";
  /** The sessions of which the insoles have refused this change, so that their former rules remain in force. */
  private readonly refused = new Set<Session>();
  /** The ends of the pauses that the insole of the foot has not confirmed yet, as times of `Date.now()`. */
  private readonly pauses = new Map<Side, number>();
  /** For each session, its load of the day when a pause was last sent to the insole. The next load may confirm the pause. */
  private readonly known_at_pause = new WeakMap<Session, DailyLoad | undefined>();
  /** The last start of the day, minutes from midnight UTC, that {@link followTimeZone} sent after a hello. */
  private readonly asked_day_start = new WeakMap<Hello, number>();
  /** True once the alerts of the last visit were shown. */
  private is_restored = false;

  constructor(
    private readonly wire: Wire,
    private readonly insoles: Insoles,
    private readonly settings: Settings,
  ) {
    this.load();
  }

  /** Loads the pauses and the wish for alerts that this page or another tab has stored. */
  private load(): void {
    this.wanted = SIDES.filter((side) => stored(() => localStorage, WANTED_KEY)?.includes(side));
    for (const side of SIDES) {
      const end_ms = Number(stored(() => localStorage, pauseKey(side)) ?? 0);
      if (end_ms > 0) this.pauses.set(side, end_ms);
      else this.pauses.delete(side);
    }
  }

  /** Forgets the pause of a foot: the insole has confirmed it, or it has ended. */
  private forgetPause(side: Side): void {
    this.pauses.delete(side);
    store(() => localStorage, pauseKey(side), "");
  }

  /** Stores of which feet the wearer wants alerts. */
  private want(sides: readonly Side[]): void {
    this.wanted = sides;
    store(() => localStorage, WANTED_KEY, sides.join());
  }

  /** Forgets the wish for alerts, so that neither a foot without alerts nor a refusal is named any more. */
  withdraw(): void {
    this.asked.clear();
    this.change.sessions = [];
    this.want([]);
  }

  /** Forgets the pauses, the alerts that are shown and the wish for alerts: the data of their wearer are deleted. */
  forget(): void {
    this.withdraw();
    SIDES.forEach((side) => this.forgetPause(side));
    this.hide();
  }

  /** Connects the buttons. */
  listen(): void {
    byId("alert-close").onclick = () => this.close();
    byId("alert-snooze").onclick = () => {
      // The alert of a recording must not pause the insoles of the wearer.
      if (!this.insoles.transport?.is_replay) this.pause();
      this.close();
    };
    // The wearer has closed or paused the alerts in another tab.
    addEventListener("storage", ({ key }) => {
      this.load();
      if (key === CLOSED_KEY) this.hide();
    });
    const alerts = byId("alerts-on", HTMLInputElement);
    // Neither on nor off, until the insoles have reported which of both applies.
    alerts.indeterminate = true;
    alerts.onchange = () => {
      const sessions = this.connected();
      this.withdraw();
      this.change = { is_on: alerts.checked, sessions };
      this.refusal = "";
      this.refused.clear();
      this.asked = new Set(alerts.checked ? sessions : []);
      // The wearer hears and feels what an alert is like. After this touch, the browser allows sound.
      if (alerts.checked) this.signal();
      else this.close();
      for (const session of sessions) {
        if (session.alert_rules) this.setRules(session, session.alert_rules, alerts.checked);
      }
      clearTimeout(this.answer_timer);
      this.answer_timer = setTimeout(() => {
        this.answer_timer = undefined;
        // Rules that an insole could not store are in force although it has answered with a refusal.
        this.unchanged().forEach((session) => session.send(this.wire.getAlertRules()));
      }, ANSWER_MS);
    };
    this.showSettings();
    for (const [key, box] of this.boxes()) {
      box.onchange = () => {
        this.settings[key] = box.checked;
        saveSettings(() => localStorage, this.settings);
        if (box.checked && key !== "alert_screen") this.signal();
      };
    }
    // A hidden page cannot vibrate, so the wearer may not have noticed the signal.
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden && this.shown.some(({ signals }) => signals < SIGNALS)) this.signal();
    });
  }

  /** The boxes of the settings that concern alerts. */
  private boxes() {
    const keys = ["alert_sound", "alert_vibration", "alert_screen"] as const;
    return keys.map((key) => [key, byId(key.replace("_", "-"), HTMLInputElement)] as const);
  }

  /** Shows the settings, which may have been changed in another tab. */
  showSettings(): void {
    for (const [key, box] of this.boxes()) box.checked = this.settings[key];
  }

  /** The insole of a session answered a request. */
  answered(answer: InsoleAnswer, session: Session): void {
    const is_awaited = this.answer_timer !== undefined && this.change.sessions.includes(session);
    if (answer.kind !== "refused" || !is_awaited) return;
    this.refusal = answer.reason;
    // Rules that the insole could only not store are in force, which its answer to this request confirms.
    if (answer.is_not_stored) session.send(this.wire.getAlertRules());
    else this.refused.add(session);
  }

  /**
   * Shows a new alert, with sound and vibration if the wearer has allowed them. `start_unix_s` and `t_s` are those of
   * {@link ageOf_s}.
   */
  raise(alert: Alert, start_unix_s: number | null, t_s: number | undefined): void {
    this.add(alert, ageOf_s(alert, start_unix_s, t_s));
    this.signalIfDue();
    this.draw();
  }

  /** Adds an alert of this age to those that the wearer has not closed. */
  private add(alert: Alert, age_s: number): void {
    const raised_ms = Date.now() - 1000 * age_s;
    const added = { alert, raised_ms, loaded_ms: raised_ms, before: this.insoles.of(alert.side)?.daily, signals: 0 };
    const all = [...this.open, added].filter(this.isCurrent).sort((a, b) => a.raised_ms - b.raised_ms);
    // A dose is reported once a day, so a later alert does not replace it.
    this.open = all.filter(({ alert: { side, dose } }, i) => {
      return dose.length > 0 || all.slice(i + 1).every((later) => later.alert.side !== side);
    });
  }

  /** False for an alert that is too old, or of an insole that reports that its alerts are off. */
  private readonly isCurrent = ({ alert, raised_ms }: OpenAlert): boolean => {
    const { state, has_alerts } = this.insoles.of(alert.side) ?? {};
    return Date.now() - raised_ms <= 1000 * LONGEST_AGE_S && !(state === "live" && has_alerts === false);
  };

  /**
   * The alerts that are shown: those of a foot that is still under sustained load, as far as it is known. A dose only grows, so
   * an alert about one is shown until its day ends.
   */
  private get shown(): OpenAlert[] {
    return this.open.filter(({ alert, raised_ms, loaded_ms }) =>
      alert.dose.length > 0 ? isToday(raised_ms / 1000) : Date.now() - loaded_ms <= FRESH_MS,
    );
  }

  /**
   * Follows the load of the regions of the alerts, repeats the signal, and notices that alerts cannot come. To be called a few
   * times a second, also while the page is hidden.
   */
  follow(): void {
    this.open = this.open.filter(this.isCurrent);
    const { shown } = this;
    for (const open of this.open) {
      const session = this.insoles.of(open.alert.side);
      const daily = this.present(open.alert.side);
      if (open.alert.dose.length > 0 || !session || !daily || daily === open.before) continue;
      // An alert that is shown names each further region under sustained load, and remains until all are relieved.
      const is_loaded = daily.sustained.some((name) => shown.includes(open) || open.alert.sustained.includes(name));
      // A load that begins again is shown without a signal: if it lasts, the insole raises its next alert.
      if (!is_loaded) open.signals = SIGNALS;
      open.loaded_ms = is_loaded ? 1000 * session.daily_unix_s : -Infinity;
    }
    this.signalIfDue();
    this.findGaps();
    if (this.settings.alert_screen && this.are_on) this.screen.hold();
    else this.screen.release();
  }

  /** True if the wearer wants alerts, or an insole raises them; false for a recording, and before insoles are awaited. */
  private get are_on(): boolean {
    if (this.insoles.transport?.is_replay ?? true) return false;
    return this.wanted.length > 0 || this.connected().some(({ has_alerts }) => has_alerts);
  }

  /** Finds the feet of which no alerts can come although the wearer wants them, and signals a new one once. */
  private findGaps(): void {
    this.gaps = new Map();
    if (this.insoles.transport?.is_replay ?? true) return;
    const now_ms = performance.now();
    const live = SIDES.filter((side) => this.insoles.of(side)?.state === "live");
    live.forEach((side) => this.connected_ms.set(side, now_ms));
    // Once alerts are wanted, they are wanted of each insole that has them.
    const confirmed = live.filter((side) => {
      const session = this.insoles.of(side);
      return session?.has_alerts && (this.asked.delete(session) || this.wanted.length > 0) && !this.wanted.includes(side);
    });
    if (confirmed.length > 0) this.want([...this.wanted, ...confirmed]);
    if (this.wanted.length === 0) return;
    for (const side of SIDES.filter((side) => this.wanted.includes(side) || live.includes(side))) {
      const { state, has_alerts } = this.insoles.of(side) ?? {};
      // An insole that was not connected in this visit is not missed.
      const since_ms = this.connected_ms.get(side) ?? now_ms;
      if (state === "live" && has_alerts === false && this.answer_timer === undefined) {
        this.gaps.set(side, "they are off on its insole. Turn them on in the settings.");
      } else if (now_ms - since_ms > ABSENT_MS) {
        this.gaps.set(side, state === "other-host" ? "another phone or program receives them. Disconnect the insole there."
          : "its insole is not connected. Check that it is near and charged, or connect it again.");
      }
      if (has_alerts && state === "live") this.signalled_gaps.delete(side);
    }
    const found = [...this.gaps.keys()].filter((side) => !this.signalled_gaps.has(side));
    found.forEach((side) => this.signalled_gaps.add(side));
    if (found.length === 0) return;
    if (this.settings.alert_sound) this.cues.tone(GAP_TONE_HZ);
    if (this.settings.alert_vibration) this.cues.vibrate(GAP_VIBRATION_MS);
  }

  /** Notes on what prevents alerts, or their sound, and what to do. */
  problems(): Node[] {
    const note = (text: string, ...more: Node[]): Node => ["p", { class: "note", "data-key": text }, text, ...more];
    const withdraw: Node = ["button", { "data-action": "withdraw-alerts" }, "Stop these messages"];
    const is_mute = this.are_on && this.settings.alert_sound && !this.cues.is_sound_allowed;
    const refused = this.unchanged().filter((session) => this.refused.has(session));
    // The wearer may have left the settings since the change.
    const refusals = this.refusals(refused).join(" ");
    return [
      ...(is_mute ? [note("Touch the page once, to allow the sound of alerts.")] : []),
      ...(refusals ? [note(refusals, withdraw)] : []),
      ...[...this.gaps].map(([side, why]) => note(`No alerts of the ${side} foot: ${why}`, withdraw)),
    ];
  }

  /** Shows the alerts of the last visit that the wearer has not closed. The browser may have ended the page in the background. */
  restore(alerts: readonly StoredAlert[]): void {
    if (this.is_restored) return;
    this.is_restored = true;
    const closed_s = Number(stored(() => localStorage, CLOSED_KEY) ?? 0) || 0;
    for (const { alert, start_unix_s } of alerts) {
      if (start_unix_s !== null && start_unix_s > closed_s) this.add(alert, ageOf_s(alert, start_unix_s, undefined));
    }
    this.signalIfDue();
    this.draw();
  }

  /** Signals an alert that is new or was signalled some time ago, until the number of signals is reached. */
  private signalIfDue(): void {
    const due = this.shown.filter(({ signals }) => signals < SIGNALS);
    const is_repetition_due = performance.now() - this.signalled_ms >= SIGNAL_INTERVAL_MS;
    if (due.some(({ signals }) => signals === 0 || is_repetition_due)) this.signal();
  }

  private signal(): void {
    this.signalled_ms = performance.now();
    for (const open of this.shown) open.signals += 1;
    if (this.settings.alert_sound) this.cues.tone();
    if (this.settings.alert_vibration) this.cues.vibrate(VIBRATION_MS);
  }

  private close(): void {
    // A browser that stores nothing for this site shows an alert of the last minutes again at the next visit. The alert of a
    // recording must not close one of the wearer in another tab.
    if (!this.insoles.transport?.is_replay) store(() => localStorage, CLOSED_KEY, String(Date.now() / 1000));
    this.hide();
  }

  private hide(): void {
    this.open = [];
    this.draw();
  }

  private draw(): void {
    const { shown } = this;
    const banner = byId("alert");
    const appears = banner.hidden && shown.length > 0;
    banner.hidden = shown.length === 0;
    fill("alert-text", shown.map(({ alert, raised_ms }): Node => {
      // No further alert can come for some time, so a region that is under sustained load now is added to this one.
      const named = shown.flatMap(({ alert: other }) => (other.side === alert.side ? other.sustained : []));
      const later = this.present(alert.side)?.sustained.filter((name) => !named.includes(name)) ?? [];
      const regions = later.map((name) => regionTitle(name).toLowerCase()).join("; ");
      const added = regions ? [` Now also under sustained load: ${regions}.`] : [];
      const end = alert.dose.length > 0 ? ""
        : this.insoles.of(alert.side)?.state === "live" ? " This message goes when the foot was unloaded for long enough."
        : " The insole is not connected, so this page cannot see whether the foot is unloaded.";
      return ["p", {}, alert.advice, ...added, " ", ["small", {}, `Raised at ${timeText(raised_ms / 1000)}.${end}`]];
    }));
    // On a low screen the alert is not sticky.
    if (appears) banner.scrollIntoView({ block: "nearest" });
  }

  /** The load of the day of a foot, unless its insole is not connected: what it reported before may not be true any more. */
  private present(side: Side): DailyLoad | undefined {
    const session = this.insoles.of(side);
    return session?.state === "live" ? session.daily : undefined;
  }

  /** Pauses the alerts of both feet: a wearer who has no time to unload one foot has none for the other. */
  private pause(): void {
    const end_ms = Date.now() + SNOOZE_MIN * 60_000;
    for (const side of SIDES) {
      this.pauses.set(side, end_ms);
      store(() => localStorage, pauseKey(side), String(end_ms));
      const session = this.insoles.of(side);
      if (session?.state === "live") this.sendPause(session, SNOOZE_MIN * 60);
    }
  }

  /** Sends a pause, unless the insole has paused its alerts for this time already, as after an alert. */
  private sendPause(session: Session, rest_s: number): void {
    this.known_at_pause.set(session, session.daily);
    if (!isPaused(session.daily, rest_s)) session.send(this.wire.snoozeAlerts(rest_s));
  }

  /**
   * Sends the pauses to the insoles that are connected now, and again to one that has not received the request: it reports a
   * shorter pause, or none. A second insole for a foot may be another person's, and receives none. To be called a few times a
   * second, also while the page is hidden.
   */
  sendPauses(): void {
    for (const [side, end_ms] of this.pauses) {
      const rest_s = Math.ceil((end_ms - Date.now()) / 1000);
      const session = this.insoles.of(side);
      // A pause with a later end was requested before the clock of this device was set back.
      if (rest_s <= 0 || rest_s > SNOOZE_MIN * 60) this.forgetPause(side);
      else if (session?.state === "live" && session.daily) {
        const is_sent = this.known_at_pause.has(session);
        if (is_sent && this.known_at_pause.get(session) === session.daily) continue;
        if (is_sent && isPaused(session.daily, rest_s)) this.forgetPause(side);
        else this.sendPause(session, rest_s);
      }
    }
  }

  /** The feet of which no alert can come now, and until when. */
  pauseTexts(): Pause[] {
    const isComplete = (side: Side) => {
      const per_day = this.insoles.of(side)?.per_day ?? 0;
      return per_day > 0 && (this.present(side)?.alerts ?? 0) >= per_day;
    };
    const complete = SIDES.filter(isComplete).map((side): Pause => {
      return { feet: `The largest number of alerts of a day is reached: no more of the ${side} foot come today.`, rest: "" };
    });
    const rest_s = (side: Side) => {
      const reported_s = this.present(side)?.snoozed_s ?? 0;
      return Math.max(reported_s, ((this.pauses.get(side) ?? 0) - Date.now()) / 1000);
    };
    const paused = SIDES.filter((side) => rest_s(side) > 0 && !isComplete(side));
    if (paused.length === 0) return complete;
    const min = Math.ceil(Math.min(...paused.map(rest_s)) / 60);
    return [...complete, {
      feet: paused.length === 1 ? `No alert of the ${paused[0]} foot can come now.` : "No alert can come now.",
      rest: `The next one can come in ${min} ${min === 1 ? "minute" : "minutes"}: alerts pause after each alert, and when you ask for it.`,
    }];
  }

  /**
   * Sends the start of the wearer's day to insoles with the default, midnight UTC, or with the one that this page has sent
   * before: the time zone of this device may have changed, or its daylight-saving time. A start that somebody else has chosen
   * remains. To be called a few times a second, also while the page is hidden.
   */
  followTimeZone(): void {
    const present_min = dayStartMinutes();
    for (const session of this.connected()) {
      const { hello, alert_rules, has_alerts, day_start_min } = session;
      if (!hello || !alert_rules || has_alerts === undefined || day_start_min === undefined || day_start_min === present_min) continue;
      // An insole that refuses this, or did not receive it, is asked again after its next hello.
      if (!isOwnDayStart(day_start_min) || this.asked_day_start.get(hello) === present_min) continue;
      this.asked_day_start.set(hello, present_min);
      this.setRules(session, alert_rules, has_alerts);
    }
  }

  /**
   * Turns the alerts of an insole on or off, and begins its day at midnight of this device, unless somebody else has chosen the
   * start of the day.
   */
  private setRules(session: Session, alert_rules: Uint8Array, is_on: boolean): void {
    const { day_start_min = 0 } = session;
    // This browser may have lost the starts that it has sent.
    const is_own = day_start_min === dayStartMinutes() || isOwnDayStart(day_start_min);
    if (!is_own) return session.send(this.wire.setAlerts(alert_rules, is_on, day_start_min));
    const day_starts = new Set([...ownDayStarts(), String(dayStartMinutes())]);
    store(() => localStorage, DAY_STARTS_KEY, [...day_starts].join(","));
    session.send(this.wire.setAlerts(alert_rules, is_on, dayStartMinutes()));
  }

  /** Sentences on loads of the day that are not of the whole day of this device, or not of the present. */
  private dayNotes(): string[] {
    if (this.insoles.transport?.is_replay) return [];
    return SIDES.flatMap((side) => {
      const session = this.insoles.of(side);
      if (!session?.daily || !isOfToday(session)) return [];
      const { day_start_min, daily_unix_s } = session;
      const is_other = day_start_min !== undefined && day_start_min !== dayStartMinutes();
      const start = (day_start_min ?? 0) - dayStartMinutes();
      return [
        ...(is_other ? [`The day of the ${side} insole begins at ${timeOfDayText(start)}.`] : []),
        ...(session.state === "live" ? [] : [`The values of the ${side} foot are those of ${timeText(daily_unix_s)}.`]),
      ];
    });
  }

  private connected(): Session[] {
    return this.insoles.sessions.filter(({ state }) => state === "live");
  }

  /** The connected sessions whose insoles did not accept the last change of the switch. */
  private unchanged(): Session[] {
    const { is_on, sessions } = this.change;
    return this.connected().filter((session) => sessions.includes(session) && session.has_alerts !== is_on);
  }

  /** True until each insole has accepted or refused the last change of the switch, or must have. */
  private get is_waiting(): boolean {
    return this.answer_timer !== undefined && this.unchanged().some((session) => !this.refused.has(session));
  }

  /** Sentences on these insoles, which did not accept the last change of the switch. */
  private refusals(unchanged: readonly Session[]): string[] {
    const state = this.change.is_on ? "off" : "on";
    const sentences = unchanged.map(
      ({ hello }) => `The ${hello?.side} insole did not accept the change: its alerts are ${state}.`,
    );
    return sentences.length > 0 && this.refusal ? [...sentences, `The reason: ${this.refusal}.`] : sentences;
  }

  /** Updates the load of the day, and the switch of the alerts. To be called a few times a second. */
  update(): void {
    const sessions = this.connected();
    const alerts = byId("alerts-on", HTMLInputElement);
    const is_replay = this.insoles.transport?.is_replay ?? false;
    const are_reported = sessions.length > 0 && sessions.every(({ has_alerts }) => has_alerts !== undefined);
    const is_known = are_reported && !is_replay;
    alerts.disabled = !is_known;
    if (!is_known) {
      // The switch remains in its last known state.
      fill("alerts-note", [
        is_replay ? "This is a recording. Connect your insoles to change this."
        : sessions.length === 0 ? "No insole is connected. Connect your insoles to change this."
        : "The insole has not reported yet whether its alerts are on.",
      ]);
    } else if (this.is_waiting) fill("alerts-note", ["The insole has not answered yet."]);
    else {
      const with_alerts = sessions.filter(({ has_alerts }) => has_alerts);
      alerts.checked = with_alerts.length > 0 && with_alerts.length === sessions.length;
      // The alerts of an insole that was connected later, or that refused the change, may differ: the wearer must know.
      alerts.indeterminate = with_alerts.length > 0 && with_alerts.length < sessions.length;
      const only = with_alerts[0]?.hello?.side ?? "";
      const partly = alerts.indeterminate ? [`Alerts are on for the ${only} foot only.`] : [];
      const unchanged = this.unchanged();
      // The other connected insoles have accepted the change, so a later difference has another cause.
      const is_open = (session: Session) => unchanged.includes(session) || !sessions.includes(session);
      this.change.sessions = this.change.sessions.filter(is_open);
      fill("alerts-note", [[...partly, ...this.refusals(unchanged)].join(" ")]);
    }
    if (this.open.length > 0 || !byId("alert").hidden) {
      // An alert can concern further regions now, or none any more.
      this.draw();
      // The element that has the focus must not be behind the alert.
      document.documentElement.style.setProperty("--alert", `${byId("alert").offsetHeight}px`);
    }
    const feet = SIDES.map((side) => this.insoles.of(side));
    const daily = feet.map((session) => (session && isOfToday(session) ? session.daily : undefined));
    const present = SIDES.map((side) => this.present(side));
    byId("today").hidden = daily.every((load) => !load);
    const cell = (value: (region: DailyRegion) => string, name: string, mark: readonly string[] = []) =>
      daily.map((load, foot): Node => {
        const region = load?.regions[name];
        return ["td", {}, region ? value(region) + (mark[foot] ?? "") : "–"];
      });
    const minutes = ({ sustained_s }: DailyRegion) => (sustained_s / 60).toFixed(0);
    const dose = ({ dose_kpa_s }: DailyRegion) => dose_kpa_s.toFixed(0);
    // From the toes to the heel, as in the live view.
    const names = this.wire.facts.regions.map(({ name }) => name).reverse();
    fill(byId("today").querySelector("tbody"), names.map((name): Node => {
      const mark = present.map((load) => (load?.sustained.includes(name) ? " ●" : ""));
      return ["tr", {}, ["th", { scope: "row" }, regionTitle(name)], ...cell(minutes, name, mark), ...cell(dose, name)];
    }));
    const raised = daily.reduce((sum, load) => sum + (load?.alerts ?? 0), 0);
    const pauses = is_replay ? [] : this.pauseTexts().flatMap(({ feet, rest }) => [feet, rest]);
    fill("today-note", [[`Alerts today: ${raised}.`, ...pauses, ...this.dayNotes()].filter(Boolean).join(" ")]);
  }
}

/** Lists the last alerts. */
export function drawAlerts(alerts: readonly StoredAlert[]): void {
  byId("alert-list").hidden = alerts.length === 0;
  fill(byId("alert-list").querySelector("tbody"), newestFirst(alerts).slice(0, ROWS).map(({ alert, start_unix_s }): Node => {
    const regions = [...new Set([...alert.sustained, ...alert.dose])].map(regionTitle);
    const foot: Node = ["td", { class: alert.side }, sideTitle(alert.side)];
    return ["tr", {}, foot, ["td", {}, timeText(start_unix_s)], ["td", {}, regions.join("; ")]];
  }));
}
