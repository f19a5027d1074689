/** Plays a recorded stream at the speed of its recording, in a loop. */

import { errorText } from "../format";
import { type Entry, entries } from "../stream_file";
import { INSOLES, type Insole, type Transport, type TransportEvents } from "./transport";

/** Interval of the checks for messages that are due. It is half of the time between frames at 100 Hz. */
const TICK_MS = 5;
const NOT_A_RECORDING = "This file is not a recording of insoles. Use a recording of this page or of plantar serve.";

/** The insoles of a recording. */
export class ReplayTransport implements Transport {
  readonly location = "in a recording";
  readonly is_replay = true;
  readonly can_lose_records = false;
  private readonly timer: ReturnType<typeof setInterval>;
  private readonly recorded: Entry[];
  /** Index of the next entry to play. */
  private next = 0;
  /** Time at which the current repetition started. */
  private start_ms: number;

  constructor(
    file: Uint8Array,
    private readonly events: TransportEvents,
    private readonly now_ms: () => number = () => performance.now(),
  ) {
    this.recorded = [...entries(file, NOT_A_RECORDING)];
    if (this.recorded.length === 0) throw new Error("The recording is empty. Use another one.");
    this.start_ms = now_ms();
    INSOLES.forEach((insole) => events.opened(insole));
    this.timer = setInterval(() => this.play(), TICK_MS);
  }

  static async load(url: string, events: TransportEvents): Promise<ReplayTransport> {
    const fail = (reason: string): never => {
      throw new Error(`The recording at ${url} cannot be loaded (${reason}). Check the address and the connection.`);
    };
    const rejected = (error: unknown) => fail(errorText(error));
    const response = await fetch(url).catch(rejected);
    if (!response.ok) fail(`status ${response.status}`);
    return new ReplayTransport(new Uint8Array(await response.arrayBuffer().catch(rejected)), events);
  }

  private play(): void {
    const elapsed_ms = this.now_ms() - this.start_ms;
    for (let due = this.recorded[this.next]; due && due.t_ms <= elapsed_ms; due = this.recorded[this.next]) {
      this.next += 1;
      this.events.message(due.insole, due.message);
    }
    if (this.next === this.recorded.length) {
      this.next = 0;
      this.start_ms = this.now_ms();
    }
  }

  send(_insole: Insole, _message: Uint8Array): void {
    // A recording cannot answer requests, so they are ignored.
  }

  close(): void {
    clearInterval(this.timer);
  }
}
