/** One insole's session: says hello until it is answered, keeps the latest, counts what is lost. */

import type { Insole, Transport } from "./transport/transport";
import type { Axis, Hello, Live, Status, Step, Wire } from "./wire";

/** A stream that is silent for longer is lost. */
export const SILENCE_MS = 2000;
const HELLO_MS = 500;
const STATUS_MS = 1000;
const TIME_MS = 250;
/** The live rate is counted over this time. */
const RATE_MS = 2000;
/** Sum of the forces is kept so long, to find the peak of a step. */
const HISTORY_S = 10;

export type SessionState = "closed" | "waiting" | "live" | "lost" | "other-version";

export interface Counters {
  received: number;
  lost: number;
  damaged: number;
}

export interface ForceAt {
  t_s: number;
  force_n: number;
}

export const totalForce = (live: Live) => live.regions.reduce((sum, region) => sum + region.measured_n, 0);

const unix_us = (now_ms: number) => Math.round((performance.timeOrigin + now_ms) * 1000);

export class Session {
  state: SessionState = "closed";
  hello: Hello | undefined;
  live: Live | undefined;
  status: Status | undefined;
  reason = "";
  battery_percent: number | undefined;
  /** The insole's clock against the browser's. */
  readonly axis: Axis;
  readonly counters: Counters = { received: 0, lost: 0, damaged: 0 };
  /** Total force, oldest first. */
  readonly history: ForceAt[] = [];
  private readonly arrivals_ms: number[] = [];
  private next_sequence: number | undefined;
  /** Frames of this stream, as the insole counts them. */
  private received_in_stream = 0;
  private lost_in_stream = 0;
  private greeted_ms = 0;
  private heard_ms = 0;
  private said_hello_ms = -Infinity;
  private asked_status_ms = -Infinity;
  private asked_time_ms = -Infinity;

  constructor(
    readonly insole: Insole,
    private readonly wire: Wire,
    private readonly transport: () => Transport | undefined,
    private readonly onStep: (step: Step, bytes: Uint8Array, session: Session) => void,
  ) {
    this.axis = wire.axis(insole);
    this.axis.clear();
  }

  opened(now_ms: number): void {
    this.state = "waiting";
    this.said_hello_ms = -Infinity;
    this.tick(now_ms);
  }

  closed(reason: string): void {
    this.state = this.hello ? "lost" : "closed";
    this.reason = reason;
  }

  receive(bytes: Uint8Array, now_ms: number): void {
    const message = this.wire.decode(bytes);
    if (!message) {
      // Before a hello, or from another major version, nothing is expected to make sense.
      if (this.state === "live") this.counters.damaged += 1;
      return;
    }
    this.heard_ms = now_ms;
    switch (message.kind) {
      case "hello":
        this.greeted_ms = now_ms;
        return this.greeted(message, now_ms);
      case "live":
        return this.frame(message, now_ms);
      case "step":
        // An insole of another version is shown nothing wrong.
        if (this.state !== "other-version") this.onStep(message.step, bytes, this);
        return;
      case "status":
        this.status = message;
        // Comes after all that was due: also finds what was lost before the first frame or after the last.
        this.lose(Math.max(0, message.live_due - this.received_in_stream - this.lost_in_stream));
        return;
      case "time":
        this.axis.answer(message);
        return;
      // Nothing here asks for these.
      case "tissue":
      case "refused":
    }
  }

  private greeted(hello: Hello, now_ms: number): void {
    this.hello = hello;
    this.axis.clear();
    this.arrivals_ms.length = 0;
    this.next_sequence = undefined;
    this.received_in_stream = 0;
    this.lost_in_stream = 0;
    if (hello.major !== this.wire.facts.major) {
      this.state = "other-version";
      return;
    }
    this.state = "live";
    this.send(this.wire.setClock(unix_us(now_ms)));
    this.send(this.wire.stream(true));
  }

  private frame(live: Live, now_ms: number): void {
    if (this.state === "other-version" || !this.hello) return;
    if (this.state === "lost") this.state = "live";
    if (this.next_sequence !== undefined) {
      const gap = (live.sequence - this.next_sequence) >>> 0;
      // A step back is another stream.
      this.lose(gap < 2 ** 31 ? gap : 0);
    }
    this.next_sequence = (live.sequence + 1) >>> 0;
    this.received_in_stream += 1;
    this.counters.received += 1;
    this.live = live;
    const last = this.history.at(-1);
    if (last && live.t_s < last.t_s) this.history.length = 0;
    this.history.push({ t_s: live.t_s, force_n: totalForce(live) });
    while ((this.history[0]?.t_s ?? Infinity) < live.t_s - HISTORY_S) this.history.shift();
    this.arrivals_ms.push(now_ms);
  }

  private lose(frames: number): void {
    this.lost_in_stream += frames;
    this.counters.lost += frames;
  }

  /** Live frames a second, lately. */
  rate_hz(now_ms: number): number {
    while ((this.arrivals_ms[0] ?? Infinity) < now_ms - RATE_MS) this.arrivals_ms.shift();
    // A stream that has just begun is counted from its hello.
    const counted_ms = Math.min(RATE_MS, now_ms - this.greeted_ms);
    return counted_ms > 0 ? (1000 * this.arrivals_ms.length) / counted_ms : 0;
  }

  /** Does what time brings: call it a few times a second. */
  tick(now_ms: number): void {
    if (this.state === "live" && now_ms - this.heard_ms > SILENCE_MS) {
      this.state = "lost";
      this.reason = "nothing heard for two seconds";
      // It may have restarted, and then waits for a hello.
      this.said_hello_ms = -Infinity;
    }
    const is_waiting = this.state === "waiting" || this.state === "lost";
    if (is_waiting && now_ms - this.said_hello_ms >= HELLO_MS) {
      this.said_hello_ms = now_ms;
      this.send(this.wire.connect());
    }
    if (this.state === "live" && now_ms - this.asked_status_ms >= STATUS_MS) {
      this.asked_status_ms = now_ms;
      this.send(this.wire.getStatus());
    }
    if (this.state === "live" && now_ms - this.asked_time_ms >= TIME_MS) {
      this.asked_time_ms = now_ms;
      this.send(this.wire.getTime(unix_us(performance.now())));
    }
  }

  /** The step is stored: the insole may forget it. */
  acknowledge(step: number): void {
    this.send(this.wire.acknowledge(step));
  }

  private send(message: Uint8Array): void {
    this.transport()?.send(this.insole, message);
  }
}
