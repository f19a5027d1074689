/** The insoles of one transport, each with its session. */

import type { Live, Side } from "./generated/quantities";
import type { Recorder } from "./recorder";
import { type InsoleAnswer, Session, type RecordMessage, followClock } from "./session";
import { isMessageLength } from "./stream_file";
import { INSOLES, type Insole, type Transport, type TransportEvents } from "./transport/transport";
import type { Wire } from "./wire";

/** Events of the insoles for the page. */
export interface InsoleEvents {
  /** A live frame arrived from the insole of this foot. */
  live(live: Live, side: Side): void;
  /** The contact ellipses or the cells of the insole of this foot arrived, or its hello, which clears the ellipses. */
  shape(session: Session, side: Side): void;
  /** A step, load bout or alert arrived. `bytes` is the encoded message. */
  record(message: RecordMessage, bytes: Uint8Array, session: Session): void;
  /** True if this record has arrived before. */
  isKnown(message: RecordMessage): boolean;
  /** An insole reported its parameters, or refused a request of any kind. A refusal because of another host is not reported. */
  answer(answer: InsoleAnswer, session: Session): void;
  /** An encoded message of the insole of this foot arrived. */
  message(bytes: Uint8Array, side: Side): void;
}

/** First byte of an encoded hello, in every major version of the protocol. */
const HELLO = 0;

/** True if the last hello of a session was for this foot, and its insole is not a second one for this foot. */
const isOf = ({ hello, state }: Session, side: Side) => hello?.side === side && state !== "same-foot";

/** True if the insole of a session is the one for this foot. While a session waits for a hello, its insole may be another one. */
const claims = (session: Session, side: Side) => isOf(session, side) && session.state !== "waiting";

/** Creates a session for each insole of the transport in use, and passes the events of the transport to the sessions. */
export class Insoles {
  sessions: Session[] = [];
  transport: Transport | undefined;
  /** The encoded hello message of each insole. */
  readonly hellos = new Map<Insole, Uint8Array>();

  constructor(
    private readonly wire: Wire,
    private readonly recorder: Recorder,
    private readonly events: InsoleEvents,
  ) {}

  /** Closes the transport in use and begins new sessions over another one. */
  use(transport: Transport): void {
    this.transport?.close();
    this.transport = transport;
    this.hellos.clear();
    const { record, answer, isKnown } = this.events;
    this.sessions = INSOLES.map((insole) => {
      const isTaken = (side: Side) => this.sessions.some((other) => other.insole !== insole && claims(other, side));
      return new Session(insole, this.wire, () => this.transport, record, answer, isTaken, isKnown);
    });
  }

  /**
   * The session with the insole of this foot; `undefined` until that insole has sent its hello. A session that waits for its
   * insole counts only if no other one has this foot.
   */
  of(side: Side): Session | undefined {
    return this.sessions.find((session) => claims(session, side)) ?? this.sessions.find((session) => isOf(session, side));
  }

  /** Sends the requests that are due. To be called a few times a second. */
  tick(now_ms: number): void {
    if (followClock()) this.sessions.forEach((session) => session.clockChanged(now_ms));
    this.sessions.forEach((session) => session.tick(now_ms));
  }

  /** Receives the events of the transport in use. */
  readonly transportEvents: TransportEvents = {
    opened: (insole) => this.sessions[insole]?.opened(performance.now()),
    closed: (insole, reason) => this.sessions[insole]?.closed(reason),
    damaged: (insole) => {
      const session = this.sessions[insole];
      if (session) session.damaged += 1;
    },
    battery: (insole, percent) => {
      const session = this.sessions[insole];
      if (session) session.battery_percent = percent;
    },
    message: (insole, bytes) => this.receive(insole, bytes, performance.now()),
  };

  private receive(insole: Insole, bytes: Uint8Array, now_ms: number): void {
    const session = this.sessions[insole];
    if (!session) return;
    // A stream file that contains a message of an impossible length would count as damaged.
    if (!isMessageLength(bytes.length)) return this.transportEvents.damaged(insole);
    const before = { hello: session.hello, live: session.live, ellipses: session.ellipses, sole: session.sole };
    const passOn = () => {
      if (session.hello && session.state !== "same-foot") this.events.message(bytes, session.hello.side);
    };
    // A hello can name another foot, so it is passed on afterwards. Any other message is passed on first: `receive` may report a
    // step, and the guided session then passes its collected messages, with that of the step, to the worker.
    const is_hello = bytes[0] === HELLO;
    if (!is_hello) passOn();
    session.receive(bytes, now_ms);
    if (is_hello && session.hello !== before.hello) passOn();
    if (session.hello !== before.hello) this.hellos.set(insole, bytes.slice());
    this.recorder.add(insole, bytes, now_ms);
    const is_new_shape = session.ellipses !== before.ellipses || session.sole !== before.sole;
    if (session.hello && session.state !== "same-foot" && is_new_shape) this.events.shape(session, session.hello.side);
    if (session.live && session.hello && session.live !== before.live) this.events.live(session.live, session.hello.side);
  }
}
