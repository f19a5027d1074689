/**
 * The guided session that identifies the wearer's tissue: the wearer stands, walks, and receives the parameters of each foot,
 * which are sent to the insoles and checked on further steps. This module has no access to the document.
 */

import { joined } from "./bytes";
import type { Live, Side, Step } from "./generated/quantities";
import type { Collected, FootResult } from "./identify_core";
import { CHECK_STEPS, type Check, TARGET_STEPS, MIN_STEPS, check, exclusions } from "./identify_rules";
import type { Answer, Request } from "./identify_worker";
import type { InsoleAnswer } from "./session";
import { totalForce } from "./session";
import { SIDES } from "./side";
import { type Entry, entry } from "./stream_file";
import type { Insole } from "./transport/transport";

/** Time for which the wearer must stand on both feet. */
const STAND_MS = 3000;
/** A foot counts as standing on the ground from this total force on. */
const STANDING_N = 50;
/** Longest time after which collected messages are passed to the worker and to the storage. */
const PASS_ON_MS = 1000;
/** Least time between two spoken remarks on steps that were not used. */
const REMARK_MS = 8000;
/** Time without a step after which the wearer is reminded to walk, and between two reminders. */
const REMIND_MS = 12_000;
/** Largest number of reminders in a pause. */
const REMINDERS = 2;
/** An insole confirms parameters within this time; otherwise they are sent again. */
const CONFIRM_MS = 3000;
/** Largest number of times that the parameters are sent. */
const ATTEMPTS = 3;
/** Number of regions of a foot. */
const REGIONS = 8;

/**
 * The phases of a guided session, in their order; "failed" can follow each of them except "closed":
 * - "closed": there is no session;
 * - "stand": the wearer has to stand still;
 * - "walk": the wearer walks, and steps are collected;
 * - "fit": the worker fits the parameters;
 * - "result": the parameters can be sent to the insoles;
 * - "push": the parameters are being sent; the phase before follows again if no insole confirms them;
 * - "verify": the wearer walks, and the parameters are checked on these steps;
 * - "done": the session is complete.
 */
export type Phase = "closed" | "stand" | "walk" | "fit" | "result" | "push" | "verify" | "done" | "failed";

/** Stores the messages of a session across visits of the page. */
export interface IdentifyStorage {
  load(): Promise<Uint8Array<ArrayBuffer>[]>;
  add(part: Uint8Array<ArrayBuffer>): Promise<void>;
  clear(): Promise<void>;
}

/** Cues for a wearer who does not look at the page. */
export interface Cues {
  say(text: string): void;
  /** Vibrates. `pattern_ms` has the durations of the vibrations and of the pauses between them, beginning with a vibration. */
  vibrate(pattern_ms: number[]): void;
}

/** The functions of the page that a guided session calls. */
export interface Host {
  /** Passes a request to the worker. */
  solve(request: Request): void;
  /** Sends an encoded message to the insole of a foot. */
  send(side: Side, message: Uint8Array): void;
  cues: Cues;
  storage: IdentifyStorage;
  /** The European shoe size. */
  size(): number;
  /** True if the insoles are connected by radio, so that it helps to hold the phone closer to them. */
  isRadio(): boolean;
}

/** One foot of the session. */
export interface Foot {
  side: Side;
  /** The steps so far; `undefined` until the worker has answered for the first time. */
  collected: Collected | undefined;
  result: FootResult | undefined;
  /** State of the transfer of the parameters. */
  sent: "no" | "waiting" | "confirmed" | "failed";
  /** The reason for which the insole refused the parameters, as a phrase; empty if it did not. */
  refusal: string;
  /** True if the insole would refuse the parameters again. */
  is_refusal_final: boolean;
  /** The reason for which the insole could not store the parameters, which it uses until it restarts; empty if it did. */
  unstored: string;
  /** True if the link is lost. */
  is_lost: boolean;
  /**
   * Smallest time of a live frame since the session began or, later, since the insole confirmed the parameters, on the insole's
   * clock; infinite before the first frame. The insole can still transmit steps from before this time.
   */
  first_frame_s: number;
  /** Steps with the new parameters, by key. */
  checked: Map<string, Step>;
  /** The result of the check; `undefined` before its end, and if the check was skipped or no step can be compared. */
  check: Check | undefined;
}

/** The index of a foot's insole in the stream file. It does not depend on the order in which insoles were connected. */
const insoleOf = (side: Side): Insole => (side === "left" ? 0 : 1);

/** A guided session. `now_ms` is a time of `performance.now()`, and `unix_ms` is a time of `Date.now()`. */
export class IdentifySession {
  phase: Phase = "closed";
  feet: Foot[] = [];
  /** Remarks on the course of the session, as sentences for the wearer. */
  readonly remarks = new Set<string>();
  /** The reason of a failure, as a sentence for the wearer. */
  failure = "";
  /** True after a failure of the computation itself: the wearer can continue the session after the page was reloaded. */
  needs_reload = false;
  /** Number of the {@link regions} whose fit has ended, also without a result. */
  regions_done = 0;
  /** The messages that were passed on to the worker and to the storage: parts of a stream file. */
  private parts: Uint8Array<ArrayBuffer>[] = [];
  /** Entries of the stream file with the messages that were not passed on yet. */
  private pending: Uint8Array[] = [];
  private start_unix_ms = 0;
  private passed_on_ms = 0;
  private stand_since_ms: number | undefined;
  /** Time of the last step or reminder. */
  private last_step_ms = 0;
  /** Number of reminders since the last step. */
  private reminders = 0;
  private remarked_ms = -Infinity;
  private sent_ms = 0;
  private attempts = 0;
  /** The phase before "push". */
  private before_push: Phase = "result";
  /** The feet whose parameters are being sent. */
  private sending: Foot[] = [];

  constructor(private readonly host: Host) {}

  /** True while messages are collected. */
  get isCollecting(): boolean {
    return this.phase === "stand" || this.phase === "walk";
  }

  /** Number of regions that are to be fitted: all of each foot with at least {@link MIN_STEPS} good steps. */
  get regions(): number {
    return REGIONS * this.fittable().length;
  }

  /** Begins a session with these feet and the hello messages of their insoles. Deletes the messages of the previous session. */
  start(hellos: ReadonlyMap<Side, Uint8Array>, now_ms: number, unix_ms: number): void {
    this.reset([...hellos.keys()]);
    this.start_unix_ms = unix_ms;
    this.phase = "stand";
    this.last_step_ms = now_ms;
    this.host.solve({ kind: "clear" });
    this.host.storage.clear().catch(() => this.cannotStore());
    for (const [side, hello] of hellos) this.collect(side, hello, unix_ms);
    this.host.cues.say("Stand still on both feet.");
  }

  /** Continues a session with its stored messages. */
  resume(parts: Uint8Array<ArrayBuffer>[], hellos: ReadonlyMap<Side, Uint8Array>, now_ms: number, unix_ms: number): void {
    this.reset([...hellos.keys()]);
    this.parts = parts;
    const end_ms = endTime_ms(parts);
    // The times of the file continue where they ended.
    this.start_unix_ms = unix_ms - end_ms;
    this.phase = "walk";
    this.last_step_ms = now_ms;
    this.host.solve({ kind: "clear" });
    for (const bytes of parts) this.host.solve({ kind: "add", bytes });
    for (const [side, hello] of hellos) this.collect(side, hello, unix_ms);
    this.remarks.add("The session was interrupted. The steps before the interruption count.");
    this.host.cues.say("Continue to walk.");
  }

  /** Ends the session and deletes its messages. */
  close(): void {
    this.reset([]);
    this.phase = "closed";
    this.host.storage.clear().catch(() => undefined);
  }

  private reset(sides: Side[]): void {
    this.feet = SIDES.filter((side) => sides.includes(side)).map((side) => ({
      side, collected: undefined, result: undefined, sent: "no", refusal: "", is_refusal_final: false, unstored: "", is_lost: false,
      first_frame_s: Infinity, checked: new Map(), check: undefined,
    }));
    this.remarks.clear();
    [this.parts, this.pending] = [[], []];
    [this.failure, this.regions_done, this.attempts] = ["", 0, 0];
    this.stand_since_ms = undefined;
    this.remarked_ms = -Infinity;
    this.reminders = 0;
  }

  private cannotStore(): void {
    this.remarks.add("This browser cannot store the session. Do not reload the page until you have finished.");
  }

  /** The stream file with all messages that were passed on. */
  file(): Uint8Array<ArrayBuffer>[] {
    return this.parts;
  }

  private foot = (side: Side) => this.feet.find((foot) => foot.side === side);

  /** Adds an encoded message of the insole of a foot. */
  message(side: Side, message: Uint8Array, unix_ms: number): void {
    if (this.isCollecting && this.foot(side)) this.collect(side, message, unix_ms);
  }

  private collect(side: Side, message: Uint8Array, unix_ms: number): void {
    const t_ms = Math.max(0, Math.round(unix_ms - this.start_unix_ms));
    this.pending.push(entry({ t_ms, insole: insoleOf(side), message }));
  }

  /** Passes the pending messages to the worker and to the storage. */
  private passOn(now_ms: number): void {
    this.passed_on_ms = now_ms;
    if (this.pending.length === 0) return;
    const part = joined(this.pending);
    this.pending = [];
    this.parts.push(part);
    this.host.solve({ kind: "add", bytes: part });
    this.host.storage.add(part).catch(() => this.cannotStore());
  }

  /** A live frame of a foot arrived. `force_n` returns the total force on a foot in its last frame, N. */
  live(side: Side, live: Live, now_ms: number, force_n: (side: Side) => number): void {
    const sender = this.foot(side);
    if (!sender) return;
    // The times begin again after a restart of the insole, and when a recording is repeated.
    sender.first_frame_s = Math.min(sender.first_frame_s, live.t_s);
    if (this.phase !== "stand") return;
    const is_standing = this.feet.every((foot) => (foot.side === side ? totalForce(live) : force_n(foot.side)) >= STANDING_N);
    if (!is_standing) this.stand_since_ms = undefined;
    else {
      this.stand_since_ms ??= now_ms;
      if (now_ms - this.stand_since_ms >= STAND_MS) this.walk(now_ms);
    }
  }

  private walk(now_ms: number): void {
    this.phase = "walk";
    this.last_step_ms = now_ms;
    this.host.cues.vibrate([200]);
    this.host.cues.say("Now walk at your usual pace. You need not look at the phone.");
  }

  /** A step of a foot arrived. `key` identifies it. */
  step(side: Side, step: Step, key: string, now_ms: number): void {
    const foot = this.foot(side);
    if (!foot) return;
    // Steps from before the session, or with the former parameters, can arrive, because the insole stores its steps until they
    // are acknowledged.
    const is_new = step.boots_since === 0 && step.start_s >= foot.first_frame_s;
    if (this.phase === "stand" && is_new) {
      this.remarks.add("You began to walk before you had stood still. That is all right.");
      this.walk(now_ms);
    }
    this.reminders = 0;
    if (this.isCollecting) {
      this.last_step_ms = now_ms;
      this.passOn(now_ms);
    } else if (this.phase === "verify" && foot.sent === "confirmed" && is_new) {
      this.last_step_ms = now_ms;
      foot.checked.set(key, step);
      this.evaluateCheck();
    }
  }

  /** To be called a few times a second. `lost` contains the feet whose link is lost. */
  tick(now_ms: number, lost: readonly Side[]): void {
    for (const foot of this.feet) {
      const is_lost = lost.includes(foot.side);
      if (is_lost !== foot.is_lost && (this.isCollecting || this.phase === "verify")) {
        const is_standing = this.phase === "stand";
        const state = `The ${foot.side} insole is ${is_lost ? "not connected" : "connected again"}.`;
        const stop = this.is_radio ? (is_standing ? "Hold the phone closer." : "Stop, and hold the phone closer.")
          : is_standing ? "Wait." : "Stop, and wait.";
        const go_on = is_standing ? "Stand still on both feet." : "Continue to walk.";
        this.host.cues.say(`${state} ${is_lost ? stop : go_on}`);
        this.host.cues.vibrate(is_lost ? [400, 200, 400] : [200]);
      }
      foot.is_lost = is_lost;
    }
    if (this.isCollecting && now_ms - this.passed_on_ms >= PASS_ON_MS) this.passOn(now_ms);
    const is_walk = this.phase === "walk" || this.phase === "verify";
    if (is_walk && this.reminders < REMINDERS && now_ms - this.last_step_ms >= REMIND_MS) {
      this.last_step_ms = now_ms;
      this.reminders += 1;
      this.host.cues.say("Rest if you like; your steps so far count. Continue when you are ready.");
    }
    if (this.phase === "push" && now_ms - this.sent_ms >= CONFIRM_MS) this.push(now_ms);
  }

  /** Handles an answer of the worker. */
  answer(answer: Answer, now_ms: number): void {
    switch (answer.kind) {
      case "collected":
        for (const foot of this.feet) this.updateCounts(foot, answer.insoles[insoleOf(foot.side)], now_ms);
        if (this.phase === "walk" && this.feet.every(({ collected }) => (collected?.good ?? 0) >= TARGET_STEPS)) {
          this.finishWalk();
        }
        return;
      case "fitted":
        this.regions_done += 1;
        return;
      case "result":
        return this.receiveResult(answer.insole, answer.result);
      case "failed":
        // The wearer may have cancelled the session before the worker answered.
        if (this.phase === "closed") return;
        this.phase = "failed";
        this.failure = answer.reason;
        this.needs_reload = answer.needs_reload;
    }
  }

  /** Stores the counts of a foot. During the walk, compares them with the previous counts, and gives cues. */
  private updateCounts(foot: Foot, collected: Collected | undefined, now_ms: number): void {
    if (!collected) return;
    const before = foot.collected;
    foot.collected = collected;
    if (this.phase !== "walk" || !before) return;
    if (Math.floor(collected.good / 10) > Math.floor(before.good / 10)) {
      this.host.cues.vibrate([100]);
      const count = `${collected.good} of ${TARGET_STEPS} with the ${foot.side} foot.`;
      this.host.cues.say(collected.good >= TARGET_STEPS ? `The ${foot.side} foot is complete.` : count);
    }
    const { excluded } = collected;
    const { excluded: previous } = before;
    const remark = excluded.broken > previous.broken
      ? (this.is_radio ? "Stop walking. Data were lost. Hold the phone closer to your feet, then continue."
        : "Data of that step were lost.")
      : excluded.partial > previous.partial ? "That step had too little load. Walk straight, at your usual pace." : "";
    if (remark && now_ms - this.remarked_ms >= REMARK_MS) {
      this.remarked_ms = now_ms;
      this.host.cues.say(remark);
    }
  }

  /** True if it helps to hold the phone closer to the insoles. */
  get is_radio(): boolean {
    return this.host.isRadio();
  }

  /** The problems that the wearer should solve, as sentences. */
  problems(): string[] {
    const missing = this.feet.filter(({ collected }) => !collected?.good);
    const is_one_sided = this.phase === "walk" && this.feet.some(({ collected }) => (collected?.good ?? 0) >= MIN_STEPS);
    const is_walking = this.isCollecting || this.phase === "verify";
    const closer = this.is_radio ? "Hold the phone closer; the" : "Wait until it is connected again. The";
    return [
      ...this.feet
        .filter(({ is_lost }) => is_lost && is_walking)
        .map(({ side }) => `The ${side} insole is not connected. ${closer} session continues then.`),
      ...(is_one_sided ? missing.map(({ side }) => missingFoot(side)) : []),
      ...this.feet.filter(({ collected }) => collected?.mirrored).map(({ side }) => mirrored(side)),
    ];
  }

  /** Sentences on the course of the session: the steps that were not used, and the {@link remarks}. */
  comments(): string[] {
    return [...this.feet.flatMap(({ collected }) => (collected ? exclusions(collected, this.is_radio) : [])), ...this.remarks];
  }

  /** The feet with enough good steps for a fit. */
  private fittable = () => this.feet.filter(({ collected }) => (collected?.good ?? 0) >= MIN_STEPS);

  /** True if the walk can end before all steps are collected. */
  get canFinish(): boolean {
    return this.phase === "walk" && this.fittable().length > 0;
  }

  /** Ends the walk and fits the feet one after the other. */
  finishWalk(): void {
    if (!this.canFinish) return;
    this.passOn(this.passed_on_ms);
    this.phase = "fit";
    this.regions_done = 0;
    this.host.cues.vibrate([200, 100, 200]);
    this.host.cues.say("That is enough. You can stop. The phone computes the result.");
    this.solveNext();
  }

  private solveNext(): void {
    const next = this.fittable().find(({ result }) => !result);
    if (next) return this.host.solve({ kind: "identify", insole: insoleOf(next.side), size: this.host.size() });
    this.phase = "result";
    this.host.cues.say("The result is ready.");
  }

  private receiveResult(insole: Insole, result: FootResult): void {
    const foot = this.feet.find(({ side }) => insoleOf(side) === insole);
    if (!foot || this.phase !== "fit") return;
    foot.result = result;
    this.solveNext();
  }

  /** The feet whose parameters can be sent: at least one region was fitted. */
  pushable = () => this.feet.filter(({ result }) => result !== undefined && result.fitted > 0);

  /** Sends the parameters to the insoles that have not confirmed them, or could not store them. */
  push(now_ms: number): void {
    if (this.phase !== "push") {
      this.attempts = 0;
      this.before_push = this.phase;
      this.sending = this.pushable().filter(({ sent, unstored }) => sent !== "confirmed" || unstored);
      for (const foot of this.sending) [foot.sent, foot.refusal, foot.is_refusal_final] = ["waiting", "", false];
    }
    this.phase = "push";
    this.sent_ms = now_ms;
    this.attempts += 1;
    for (const foot of this.sending) {
      if (foot.sent !== "waiting") continue;
      if (this.attempts > ATTEMPTS) foot.sent = withoutConfirmation(foot);
      else if (foot.result) this.host.send(foot.side, Uint8Array.from(foot.result.message));
    }
    this.continueIfSent(now_ms);
  }

  /** An insole answered a request. Returns true if it uses new parameters. */
  insoleAnswer(side: Side, answer: InsoleAnswer, now_ms: number): boolean {
    const foot = this.foot(side);
    if (!foot || this.phase !== "push" || foot.sent !== "waiting") return false;
    const is_unstored = answer.kind === "refused" && answer.is_not_stored;
    const is_in_use = is_unstored || (answer.kind === "tissue" && answer.id === foot.result?.tissue_id);
    if (is_in_use) {
      [foot.sent, foot.first_frame_s] = ["confirmed", Infinity];
      foot.unstored = is_unstored ? answer.reason : "";
    } else if (answer.kind === "refused") {
      [foot.sent, foot.refusal] = [withoutConfirmation(foot), answer.reason];
      foot.is_refusal_final = answer.is_final;
    }
    this.continueIfSent(now_ms);
    return is_in_use;
  }

  /** Once all insoles have answered, begins the check; returns to the phase before if none of them confirmed the parameters. */
  private continueIfSent(now_ms: number): void {
    if (this.sending.some(({ sent }) => sent === "waiting")) return;
    const confirmed = this.sending.filter(({ sent }) => sent === "confirmed");
    this.phase = confirmed.length > 0 ? "verify" : this.before_push;
    [this.last_step_ms, this.reminders] = [now_ms, 0];
    if (confirmed.length === 0) return;
    const [only, ...others] = confirmed;
    const owners = only && others.length === 0 ? `The ${only.side} insole has` : "The insoles have";
    this.host.cues.say(`${owners} your parameters. Walk ${CHECK_STEPS} more steps.`);
  }

  /** Ends the session without the check on further steps. */
  finish(): void {
    if (this.phase === "verify") this.complete();
  }

  /** The session is complete, and is not offered again as an interrupted one. It can still be saved. */
  private complete(): void {
    this.phase = "done";
    this.host.storage.clear().catch(() => undefined);
  }

  /** Evaluates the check once each foot with new parameters has enough steps. */
  private evaluateCheck(): void {
    const feet = this.feet.filter(({ sent }) => sent === "confirmed");
    if (feet.some(({ checked }) => checked.size < CHECK_STEPS)) return;
    for (const foot of feet) {
      if (foot.result) foot.check = check(foot.result, [...foot.checked.values()].slice(-CHECK_STEPS));
    }
    this.complete();
    this.host.cues.vibrate([200, 100, 200]);
    this.host.cues.say("Finished. Thank you.");
  }
}

/**
 * The state of a foot after a transfer that its insole did not confirm. An insole that could not store the parameters of an
 * earlier transfer still uses them.
 */
const withoutConfirmation = ({ unstored }: Foot) => (unstored ? "confirmed" : "failed");

/** The remark on a foot without usable steps. */
const missingFoot = (side: Side) =>
  `No usable step of the ${side} foot has arrived. Check that its insole is in the shoe, and walk straight.`;

/** The remark on an insole that seems to lie under the wrong foot. */
const mirrored = (side: Side) =>
  `The loads of the ${side} insole look like those of the other foot. Check that the ${side} insole is in the ${side} shoe.`;

/**
 * The time at which a continued session begins in the file: that of the first message in the last part plus {@link PASS_ON_MS},
 * about the longest time that a part covers.
 */
function endTime_ms(parts: readonly Uint8Array[]): Entry["t_ms"] {
  const last = parts.at(-1);
  return last === undefined || last.length < 4 ? 0 : new DataView(last.buffer, last.byteOffset).getUint32(0, true) + PASS_ON_MS;
}
