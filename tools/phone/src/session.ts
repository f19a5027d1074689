/** The session with one insole: sends the requests, stores the latest messages, and counts received and lost frames. */

import type { Hello, LayoutCell, Sole, Status, ToHost } from "./generated/messages";
import type { DailyLoad, Ellipse, Live, Side } from "./generated/quantities";
import { CONNECT_REQUEST_MS, TIMEOUT_MS } from "./reconnect";
import type { Insole, Transport } from "./transport/transport";
import type { ClockMapping, LiveCounter, RecordOrder, Wire } from "./wire";

/** Interval of the requests for the status. */
const STATUS_MS = 1000;
/** Interval of the requests for the time of the insole. */
const TIME_MS = 250;
/** Interval of the requests for the load of the day, and for what has not arrived yet. */
const SUMMARY_MS = 5000;
/** Interval of the requests for the next cells of the insole while it does not answer. */
const CELLS_MS = 1000;
/** Number of answers after which the offset of the insole's clock is known well: a single request may have been delayed. */
const TIME_ANSWERS = 3;
/** Longest time for which records wait for the time of the insole's clock. It is shorter than {@link TIMEOUT_MS}. */
const RECORDS_WAIT_MS = 1000;
/** Highest rate of the stream of ellipses. */
const ELLIPSES_HZ = 25;
/** Number of unanswered requests after which an insole counts as silent. */
const UNANSWERED_REQUESTS = 4;
/** An insole rests if the time between two measurements is longer: it then measures twice a second, else at 20 Hz or more. */
const RESTING_S = 0.4;
/**
 * Number of successive steps that ask for a new identification after which it is recommended: 5 to 7 % of the steps of a wearer
 * who has not changed ask for it (docs/identification.md), so that 20 in succession are no chance.
 */
const REFIT_STEPS = 20;
/** Duration over which the rate of live frames is averaged. */
const RATE_MS = 2000;

/**
 * State of a session:
 * - "closed": there is no link, and the insole has never sent a hello;
 * - "waiting": the link is open, but the insole has not sent its hello;
 * - "live": the insole has sent its hello, and messages arrive;
 * - "lost": the link broke, or messages no longer arrive;
 * - "other-host": another phone or program has connected to the insole, and receives its messages instead;
 * - "other-version": the insole uses another major version of the protocol;
 * - "same-foot": the other insole, which was connected before, is for the same foot.
 */
export type SessionState = "closed" | "waiting" | "live" | "lost" | "other-host" | "other-version" | "same-foot";

/** A decoded message that contains a step, a load bout or an alert. */
export type RecordMessage = Extract<ToHost, { kind: "step" | "bout" | "alert" }>;

/** The record in a message, and its number. */
export function recordOf(message: RecordMessage) {
  switch (message.kind) {
    case "step":
      return { record: message.step, number: message.step.step };
    case "bout":
      return { record: message.bout, number: message.bout.number };
    case "alert":
      return { record: message.alert, number: message.alert.number };
  }
}

/** A decoded message by which an insole reports its parameters, or refuses a request of any kind. */
export type InsoleAnswer = Extract<ToHost, { kind: "tissue" | "refused" }>;

/** The sum of the measured forces on all regions, N. */
export const totalForce = (live: Live) => live.regions.reduce((sum, region) => sum + region.measured_n, 0);

/** Smaller changes of the clock of this device are ignored. */
const CLOCK_STEP_MS = 500;
/** The time of the clock of this device minus that of `performance.now()`, ms. */
let origin_ms = Date.now() - performance.now();

/**
 * Compares the clock of this device with `performance.now()` again. Returns true if their difference has changed:
 * `performance.now()` can stop while the device sleeps, and the clock can be set.
 */
export function followClock(): boolean {
  const present_ms = Date.now() - performance.now();
  if (Math.abs(present_ms - origin_ms) < CLOCK_STEP_MS) return false;
  origin_ms = present_ms;
  return true;
}

/** Converts a time of `performance.now()` to us since 1970. */
const unix_us = (now_ms: number) => Math.round((origin_ms + now_ms) * 1000);

/** The session with one insole. */
export class Session {
  state: SessionState = "closed";
  hello: Hello | undefined;
  live: Live | undefined;
  status: Status | undefined;
  /** Indices of the regions of which the insole's parameters are not known to be the wearer's; empty until it has answered. */
  typical: number[] = [];
  /** The load of the day, as far as it is known. */
  daily: DailyLoad | undefined;
  /** Time of this device at which it arrived, s since 1970. */
  daily_unix_s = 0;
  /** The message with the rules of alerts; `undefined` until the insole has answered. */
  alert_rules: Uint8Array | undefined;
  /** True if the insole raises alerts; `undefined` until it has answered. */
  has_alerts: boolean | undefined;
  /** Largest number of alerts in a day; `undefined` until the insole has answered. */
  per_day: number | undefined;
  /** Minutes from midnight UTC to the start of the wearer's day, by the rules of alerts. */
  day_start_min: number | undefined;
  /** The contact ellipses of the last message with ellipses, by region; null for a region without contact. */
  ellipses: (Ellipse | null)[] = [];
  /** The sole of the insole; `undefined` until its cells are known. After a reconnection it remains until they are read again. */
  sole: Sole | undefined;
  /** The reason why the connection was lost, as a phrase for the wearer. */
  reason = "";
  battery_percent: number | undefined;
  /** True while the insole rests: an insole that was not loaded for a minute measures only twice a second. */
  is_resting = false;
  /** True if a change of the insole was refused, and would be refused again. */
  refuses_changes = false;
  /** Number of damaged or unknown messages. */
  damaged = 0;
  /** Converts times of the insole's clock. */
  readonly clock_mapping: ClockMapping;
  /** Counts the live frames of the insole. */
  readonly counter: LiveCounter;
  /** Number of successive steps, up to the last one, of which the stiffness differs too much from that of the identification. */
  private refit_steps = 0;
  /** Number of the last record since the hello that could not be stored, and so is not acknowledged. */
  unstored: number | undefined;
  /** The cells of the insole that have arrived. */
  private cells: LayoutCell[] = [];
  /** Times at which the live frames of the last two seconds arrived. */
  private readonly arrivals_ms: number[] = [];
  /** Number of the last record that has arrived in this session. */
  private last_record: number | undefined;
  /** Detects lost records. */
  private readonly order: RecordOrder;
  /** Records, decoded and encoded, that wait for the time of the insole's clock. */
  private untimed: [RecordMessage, Uint8Array][] = [];
  /** Number of answers with the time of the insole's clock since the wait for it began. */
  private time_answers = 0;
  /** Time of this device at which the wait for the time of the insole's clock began. */
  private untimed_since_ms = 0;
  /**
   * The time, us since 1970, at which the time of the insole's clock was first requested by the clock of this device as it is set
   * now. Answers to earlier requests are not used.
   */
  private clock_since_us = 0;
  /** Number of requests for the time of the insole's clock since the last message. */
  private unanswered = 0;
  /**
   * True while another host has the session. A connect request would end the session of that host, so none is sent, also after
   * the link was opened again.
   */
  private is_superseded = false;
  private hello_received_ms = 0;
  private last_message_ms = 0;
  private connect_requested_ms = -Infinity;
  private status_requested_ms = -Infinity;
  private time_requested_ms = -Infinity;
  private summary_requested_ms = -Infinity;
  /** True until the insole has answered how its parameters were identified. */
  private awaits_identified = true;
  private cells_requested_ms = -Infinity;

  constructor(
    readonly insole: Insole,
    private readonly wire: Wire,
    private readonly transport: () => Transport | undefined,
    private readonly onRecord: (message: RecordMessage, bytes: Uint8Array, session: Session) => void,
    private readonly onAnswer: (answer: InsoleAnswer, session: Session) => void,
    /** True if another session has an insole for this foot. */
    private readonly isTaken: (side: Side) => boolean,
    /** True if this record has arrived before and was passed to `onRecord`. */
    private readonly isKnown: (message: RecordMessage) => boolean,
  ) {
    this.clock_mapping = wire.clockMapping(insole);
    this.clock_mapping.clear();
    this.counter = wire.counter(insole);
    this.counter.clear();
    this.order = wire.order(insole);
    this.order.interrupt();
  }

  /** To be called when the transport has opened the link. */
  opened(now_ms: number): void {
    this.state = this.is_superseded ? "other-host" : "waiting";
    // The insole has two seconds to refuse a request, before it counts as silent.
    [this.unanswered, this.last_message_ms] = [0, now_ms];
    this.connect_requested_ms = -Infinity;
    this.tick(now_ms);
  }

  /** To be called when the link broke. `reason` is a phrase for the wearer. */
  closed(reason: string): void {
    // The loss of a second insole for a foot must not be reported as that of the first one.
    if (this.state !== "same-foot") this.state = this.hello ? "lost" : "closed";
    this.reason = reason;
    // The waiting records are not acknowledged, so the insole sends them again.
    this.untimed = [];
  }

  /** To be called when the clock of this device has changed. */
  clockChanged(now_ms: number): void {
    if (this.state !== "live") return;
    this.restartClockMapping(now_ms);
    this.send(this.wire.setClock(unix_us(now_ms)));
  }

  /** Handles a message of the insole. */
  receive(bytes: Uint8Array, now_ms: number): void {
    const message = this.wire.decode(bytes);
    if (!message) {
      // Unknown messages are expected before the hello, and from an insole of another major version.
      if (this.state === "live") this.damaged += 1;
      return;
    }
    this.last_message_ms = now_ms;
    this.unanswered = 0;
    switch (message.kind) {
      case "hello":
        return this.receiveHello(message, now_ms);
      case "live":
        return this.receiveLive(message, now_ms);
      case "step":
      case "bout":
      case "alert":
        return this.receiveRecord(message, bytes, now_ms);
      case "status":
        this.status = message;
        this.counter.due(message.live_due);
        return;
      case "daily_load":
        this.daily = message.load;
        this.daily_unix_s = Date.now() / 1000;
        return;
      case "alert_rules":
        this.has_alerts = message.per_day > 0;
        this.per_day = message.per_day;
        this.day_start_min = message.day_start_min;
        this.alert_rules = bytes.slice();
        return;
      case "time":
        if (!this.isOfPresentClock(message.host_us)) return;
        this.clock_mapping.answer(message);
        this.time_answers += 1;
        if (this.has_exact_time) this.releaseUntimed(now_ms);
        return;
      case "refused":
        if (message.is_other_host) {
          if (this.state === "live") this.state = "other-host";
          this.is_superseded = this.state === "other-host";
          this.order.interrupt();
          return;
        }
        this.refuses_changes ||= message.is_final;
        // Parameters that could not be stored are in force.
        if (message.is_not_stored) this.requestIdentified();
        return this.onAnswer(message, this);
      case "tissue":
        // The object is changed and not replaced: if `hello` is another object after a message, `Insoles` stores this message as
        // the hello.
        if (this.hello) this.hello.has_parameters = message.id !== 0;
        this.requestIdentified();
        return this.onAnswer(message, this);
      case "identified":
        this.typical = message.typical;
        this.awaits_identified = false;
        // An insole that could not store its parameters does not announce them by `tissue`.
        if (this.hello && this.typical.length < this.wire.facts.regions.length) this.hello.has_parameters = true;
        return;
      case "ellipses":
        if (this.state === "live") this.ellipses = message.regions;
        return;
      case "setup_cells":
        return this.receiveCells(message.first, message.cells, now_ms);
    }
  }

  private receiveRecord(message: RecordMessage, bytes: Uint8Array, now_ms: number): void {
    // A step of another major version may have another meaning, and a second insole for a foot may be another person's.
    if (this.state === "other-version" || this.state === "same-foot") return;
    this.last_record = recordOf(message).number;
    // An insole sends its stored records before it answers requests. They are processed in order once it has sent its time.
    const is_untimed = !this.has_exact_time && now_ms - this.untimed_since_ms < RECORDS_WAIT_MS;
    if (is_untimed && !this.transport()?.is_replay) {
      this.untimed.push([message, bytes.slice()]);
      return;
    }
    this.releaseUntimed(now_ms);
    this.passOn(message, bytes, now_ms);
  }

  private releaseUntimed(now_ms: number): void {
    const untimed = this.untimed;
    this.untimed = [];
    for (const [message, bytes] of untimed) this.passOn(message, bytes, now_ms);
  }

  /** Passes a record on, unless records before it are missing; then the insole must send all of them again. */
  private passOn(message: RecordMessage, bytes: Uint8Array, now_ms: number): void {
    if (this.transport()?.can_lose_records) {
      const { number } = recordOf(message);
      if (this.isKnown(message)) this.order.repeat(number);
      else if (!this.order.accepts(number, this.damaged)) return this.requestHello(now_ms);
    }
    if (message.kind === "step") {
      const asks = Object.values(message.step.regions).some((region) => region.refit);
      this.refit_steps = asks ? this.refit_steps + 1 : 0;
    }
    this.onRecord(message, bytes, this);
  }

  /** True if the parameters should be identified again, unless the insole has moved in the shoe. */
  get needs_refit(): boolean {
    return this.refit_steps >= REFIT_STEPS;
  }

  /** Discards the known times of the insole's clock, and requests the present one. */
  private restartClockMapping(now_ms: number): void {
    this.clock_mapping.clear();
    this.time_answers = 0;
    this.clock_since_us = unix_us(performance.now());
    this.untimed_since_ms = now_ms;
    this.requestTime(now_ms);
  }

  /** True if the clock of this device was not set since a request at this time. A recording has the times of another device. */
  private isOfPresentClock(host_us: number): boolean {
    const is_replay = this.transport()?.is_replay ?? false;
    return is_replay || (host_us >= this.clock_since_us && host_us <= unix_us(performance.now()));
  }

  /** True if enough answers have arrived since the hello, or since a change of the clock of this device, for exact times. */
  get has_exact_time(): boolean {
    return this.time_answers >= TIME_ANSWERS;
  }

  private requestTime(now_ms: number): void {
    this.time_requested_ms = now_ms;
    this.unanswered += 1;
    this.send(this.wire.getTime(unix_us(performance.now())));
  }

  private receiveHello(hello: Hello, now_ms: number): void {
    this.hello = hello;
    this.is_superseded = false;
    this.hello_received_ms = now_ms;
    this.untimed = [];
    this.refuses_changes = false;
    this.last_record = undefined;
    // The insole sends its unacknowledged records again.
    this.unstored = undefined;
    this.order.begin();
    this.counter.newSession();
    this.arrivals_ms.length = 0;
    // If the insole has restarted, the last frame has a time of another clock.
    this.live = undefined;
    this.is_resting = false;
    this.ellipses = [];
    this.typical = [];
    this.awaits_identified = true;
    this.has_alerts = undefined;
    this.cells = [];
    // The insole may be that of the other foot.
    this.daily = undefined;
    if (hello.major !== this.wire.facts.major) {
      this.state = "other-version";
      return;
    }
    if (this.isTaken(hello.side)) {
      this.state = "same-foot";
      return;
    }
    this.state = "live";
    // The request for the time states when it was made, so it is sent before the other requests, which would delay it.
    this.restartClockMapping(now_ms);
    this.send(this.wire.setClock(unix_us(now_ms)));
    this.requestSummary(now_ms);
    this.requestCells(now_ms);
  }

  /**
   * Sends a connect request, unless the last one was sent just now. The insole answers with its hello, and sends all its records
   * that are not acknowledged.
   */
  private requestHello(now_ms: number): void {
    if (now_ms - this.connect_requested_ms < CONNECT_REQUEST_MS) return;
    this.connect_requested_ms = now_ms;
    this.send(this.wire.connect());
  }

  /** Requests the load of the day, and what has not arrived yet: answers and streams. */
  private requestSummary(now_ms: number): void {
    this.summary_requested_ms = now_ms;
    this.send(this.wire.getDailyLoad());
    if (this.has_alerts === undefined) this.send(this.wire.getAlertRules());
    if (this.awaits_identified) this.requestIdentified();
    // An insole without cells measures nothing.
    if (!this.hello?.cells) return;
    if (!this.live) this.send(this.wire.stream(true));
    if (this.ellipses.length === 0) this.send(this.wire.streamEllipses(Math.ceil(this.hello.rate_hz / ELLIPSES_HZ)));
  }

  /** Asks the insole how its parameters were identified. */
  requestIdentified(): void {
    this.awaits_identified = true;
    this.send(this.wire.getIdentified());
  }

  /** Requests the next part of the insole's cells. */
  private requestCells(now_ms: number): void {
    this.cells_requested_ms = now_ms;
    this.send(this.wire.getSetupCells(this.cells.length));
  }

  private receiveCells(first: number, cells: LayoutCell[], now_ms: number): void {
    // A request that was sent twice is answered twice.
    if (this.state !== "live" || !this.hello || first !== this.cells.length || first >= this.hello.cells) return;
    this.cells.push(...cells);
    if (this.cells.length < this.hello.cells) this.requestCells(now_ms);
    else this.sole = this.wire.sole(this.cells);
  }

  private receiveLive(live: Live, now_ms: number): void {
    if (this.state === "other-version" || this.state === "same-foot" || !this.hello) return;
    if (this.state === "lost") this.state = "live";
    this.counter.frame(live.sequence);
    // The time between two consecutive frames is that between two measurements, also if frames were lost before.
    if (this.live && live.sequence === this.live.sequence + 1) {
      this.is_resting = live.t_s - this.live.t_s > RESTING_S;
    }
    this.live = live;
    this.arrivals_ms.push(now_ms);
    // A page in the background does not call `rate_hz`, and would collect the times of hours.
    this.removeOldArrivals(now_ms);
  }

  private removeOldArrivals(now_ms: number): void {
    while ((this.arrivals_ms[0] ?? Infinity) < now_ms - RATE_MS) this.arrivals_ms.shift();
  }

  /** Number of records that the insole has stored and still has to send, by its last status. Record numbers wrap at 2^32. */
  get records_waiting(): number {
    if (this.state !== "live" || !this.status || this.last_record === undefined) return 0;
    const waiting = (this.status.next_record - this.last_record - 1) >>> 0;
    return waiting < 2 ** 31 ? waiting : 0;
  }

  /**
   * Live frames per second, mean over the last two seconds, but at most the rate of the insole: the frames of a longer time can
   * arrive together after a pause of the browser or of the link.
   */
  rate_hz(now_ms: number): number {
    this.removeOldArrivals(now_ms);
    // In the first two seconds, the mean is taken over the time since the hello.
    const counted_ms = Math.min(RATE_MS, now_ms - this.hello_received_ms);
    return counted_ms > 0 ? Math.min(this.hello?.rate_hz ?? 0, (1000 * this.arrivals_ms.length) / counted_ms) : 0;
  }

  /** Sends the requests that are due. To be called a few times a second. */
  tick(now_ms: number): void {
    // An insole repeats its refusal as long as another host is connected. Afterwards it sends nothing until it receives a connect
    // request. A page in the background, which has requested nothing for some time, must not take the insole from that host.
    const is_silent = this.unanswered >= UNANSWERED_REQUESTS && now_ms - this.last_message_ms > TIMEOUT_MS;
    if ((this.state === "live" || this.state === "other-host") && is_silent) {
      this.state = "lost";
      this.is_superseded = false;
      this.reason = "no data for two seconds";
      // The insole may have restarted. Then it waits for a connect request.
      this.connect_requested_ms = -Infinity;
    }
    // The insole for this foot that was connected before may have been replaced by one for the other foot.
    const is_only = this.state === "same-foot" && this.hello !== undefined && !this.isTaken(this.hello.side);
    const is_waiting = this.state === "waiting" || this.state === "lost" || is_only;
    if (is_waiting || (this.state === "live" && this.order.is_retransmission_due)) this.requestHello(now_ms);
    if (this.state === "live" && now_ms - this.status_requested_ms >= STATUS_MS) {
      this.status_requested_ms = now_ms;
      this.send(this.wire.getStatus());
    }
    if ((this.state === "live" || this.state === "other-host") && now_ms - this.time_requested_ms >= TIME_MS) {
      this.requestTime(now_ms);
    }
    if (now_ms - this.untimed_since_ms >= RECORDS_WAIT_MS) this.releaseUntimed(now_ms);
    if (this.state === "live" && now_ms - this.summary_requested_ms >= SUMMARY_MS) this.requestSummary(now_ms);
    const has_all_cells = this.cells.length >= (this.hello?.cells ?? 0);
    if (this.state === "live" && !has_all_cells && now_ms - this.cells_requested_ms >= CELLS_MS) this.requestCells(now_ms);
  }

  /** Acknowledges a record and all earlier ones, so that the insole can delete them. To be called once they are stored. */
  acknowledge(number: number): void {
    this.unstored = undefined;
    this.send(this.wire.acknowledge(number));
  }

  /** Sends an encoded message. */
  send(message: Uint8Array): void {
    this.transport()?.send(this.insole, message);
  }
}
