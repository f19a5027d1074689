/** Two simulated insoles behind a WebSocket such as that of `plantar serve`. They play a recorded walk at a chosen speed. */

import type { Page, WebSocketRoute } from "playwright-core";
import { type Entry, entries } from "../../src/stream_file";

/** First bytes of the requests and answers that the insoles use. */
const [CONNECT, STREAM, ACKNOWLEDGE, SET_IDENTIFIED_TISSUE] = [0, 1, 2, 20];
const TISSUE = 4;
/**
 * Number of bytes of the force laws: six f32 for each of eight regions. In a message with parameters they follow the identifier
 * of the parameters, an integer of variable length.
 */
const FORCE_LAWS_BYTES = 8 * 6 * 4;
/** Longest real time that one tick of the timer counts. */
const MOST_TICK_MS = 20;
/** The speed of a walk that waits: 1 % of real time. The page still receives frames, so the connection is not lost. */
export const WAITING = 0.01;

/** An integer of variable length, as messages contain it. */
export const varint = (value: number): number[] => (value < 128 ? [value] : [(value % 128) + 128, ...varint(Math.floor(value / 128))]);

/** The insoles of a recording. */
export class FakeInsoles {
  /** The requests with parameters, each with the index of the insole that received it. */
  readonly parameter_requests: [number, Uint8Array][] = [];
  /** The acknowledgements, each as the index of the insole that received it and the bytes of the number. */
  readonly acknowledged: [number, Uint8Array][] = [];
  /** All requests, each with the index of the insole that received it. */
  readonly requests: [number, number[]][] = [];
  /** False: the link is open, but no messages arrive. */
  is_connected = true;
  /** Time of the walk at which the insoles wait, ms. */
  wait_at_ms = Infinity;
  /** The messages of the walk, without the hello messages. */
  private readonly messages: Entry[];
  private readonly hellos: Entry[];
  /** Index of the message that is sent next. */
  private next = 0;
  /** Time of the walk so far. */
  private elapsed_ms = 0;
  private timer: ReturnType<typeof setInterval> | undefined;
  /** The connection of the page that is open. */
  private socket: WebSocketRoute | undefined;

  /** `speed` is the speed of the walk relative to real time. `only` names the index of the only insole. */
  constructor(
    file: Uint8Array,
    public speed: number,
    only?: number,
  ) {
    const used = [...entries(file)].filter(({ insole }) => only === undefined || insole === only);
    // The first message of each insole is its hello.
    this.hellos = [0, 1].flatMap((index) => used.find(({ insole }) => insole === index) ?? []);
    this.messages = used.filter((item) => !this.hellos.includes(item));
  }

  /** Answers the connections of a page. */
  async serve(page: Page): Promise<void> {
    await page.routeWebSocket(/\/insoles$/, (socket) => {
      this.socket = socket;
      socket.onMessage((data) => this.receive(socket, new Uint8Array(data as Buffer)));
    });
  }

  private receive(socket: WebSocketRoute, [insole, ...request]: Uint8Array): void {
    const hello = this.hellos.find((entry) => entry.insole === insole);
    if (!this.is_connected || !hello) return;
    this.requests.push([insole!, request]);
    if (request[0] === CONNECT) this.send(socket, hello);
    if (request[0] === STREAM && this.timer === undefined) this.play();
    if (request[0] === ACKNOWLEDGE) this.acknowledged.push([insole!, Uint8Array.from(request.slice(1))]);
    if (request[0] === SET_IDENTIFIED_TISSUE) {
      this.parameter_requests.push([insole!, Uint8Array.from(request)]);
      // In the last byte of the identifier, an integer of variable length, the highest bit is 0.
      const last = request.findIndex((byte, index) => index > 0 && byte < 0x80);
      this.send(socket, { ...hello, message: Uint8Array.of(TISSUE, ...request.slice(1, last + 1 + FORCE_LAWS_BYTES)) });
    }
  }

  private send(socket: WebSocketRoute, { insole, message }: Entry): void {
    socket.send(Buffer.from([insole, ...message]));
  }

  private play(): void {
    let last_ms = performance.now();
    this.timer = setInterval(() => {
      const now_ms = performance.now();
      const speed = this.elapsed_ms < this.wait_at_ms ? this.speed : WAITING;
      // On a busy machine, the walk becomes slower instead of arriving in bursts.
      if (this.is_connected) this.elapsed_ms += speed * Math.min(now_ms - last_ms, MOST_TICK_MS);
      last_ms = now_ms;
      for (let due = this.messages[this.next]; due && due.t_ms <= this.elapsed_ms; due = this.messages[this.next]) {
        this.next += 1;
        if (this.socket) this.send(this.socket, due);
      }
    }, 5);
  }

  /** Sends a message of an insole. */
  answer(insole: Entry["insole"], message: Uint8Array): void {
    if (this.socket) this.send(this.socket, { t_ms: 0, insole, message });
  }

  /** Ends the walk. */
  stop(): void {
    clearInterval(this.timer);
    this.timer = undefined;
  }
}
