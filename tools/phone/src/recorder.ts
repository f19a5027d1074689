/** Records the messages of the insoles as a stream file. */

import { type Entry, entries, entry } from "./stream_file";
import type { Insole } from "./transport/transport";

/** Holds at most one recording in memory. */
export class Recorder {
  private chunks: Uint8Array<ArrayBuffer>[] = [];
  /** Start of the running recording; `undefined` if no recording is running. */
  private start_ms: number | undefined;
  /** True if the recording contains messages that were not exported. */
  is_unsaved = false;
  /** Time of the last recorded message. */
  private end_ms = 0;

  get isRecording(): boolean {
    return this.start_ms !== undefined;
  }

  get isEmpty(): boolean {
    return this.chunks.length === 0;
  }

  /** Starts a new recording with the hello messages of the insoles, which identify the feet of the following frames. */
  start(now_ms: number, hellos: Iterable<[Insole, Uint8Array]>): void {
    this.chunks = [];
    this.is_unsaved = false;
    this.start_ms = now_ms;
    this.end_ms = now_ms;
    for (const [insole, message] of hellos) this.add(insole, message, now_ms);
  }

  stop(): void {
    this.start_ms = undefined;
  }

  /** Adds a message. Does nothing if no recording is running. */
  add(insole: Insole, message: Uint8Array, now_ms: number): void {
    if (this.start_ms === undefined) return;
    this.end_ms = now_ms;
    this.is_unsaved = true;
    this.chunks.push(entry({ t_ms: Math.round(now_ms - this.start_ms), insole, message }) as Uint8Array<ArrayBuffer>);
  }

  /** Duration of the running recording; 0 if no recording is running. */
  seconds(): number {
    return this.start_ms === undefined ? 0 : (this.end_ms - this.start_ms) / 1000;
  }

  /** The content of the stream file. */
  file(): Uint8Array<ArrayBuffer>[] {
    return this.chunks;
  }

  /** The messages so far. Those that are recorded during the iteration are not included. */
  *[Symbol.iterator](): Generator<Entry> {
    for (const chunk of [...this.chunks]) yield* entries(chunk);
  }
}
