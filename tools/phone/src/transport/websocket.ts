/**
 * Connects the insoles of the computer that serves the page. A WebSocket message consists of one byte, which is the index of the
 * insole, and a message from or to that insole.
 */

import { Reconnect } from "../reconnect";
import { INSOLES, type Insole, type Transport, type TransportEvents } from "./transport";

/** The insoles of `plantar serve`. */
export class WebSocketTransport implements Transport {
  // Not "of this computer": the browser can run on another computer, or on a phone.
  readonly location = "of plantar serve";
  readonly is_replay = false;
  readonly can_lose_records = false;
  private socket: WebSocket | undefined;
  private readonly reconnect = new Reconnect(() => this.open());

  constructor(
    private readonly url: string,
    private readonly events: TransportEvents,
  ) {
    this.open();
  }

  private open(): void {
    const socket = new WebSocket(this.url);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => INSOLES.forEach((insole) => this.events.opened(insole));
    socket.onmessage = ({ data }: MessageEvent<ArrayBuffer>) => {
      const bytes = new Uint8Array(data);
      const insole = INSOLES.find((index) => index === bytes[0]);
      if (insole !== undefined) this.events.message(insole, bytes.subarray(1));
    };
    socket.onclose = () => {
      const reason = "plantar serve does not answer; start it again if it has ended";
      INSOLES.forEach((insole) => this.events.closed(insole, reason));
      this.reconnect.later();
    };
  }

  send(insole: Insole, message: Uint8Array): void {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    this.socket.send(Uint8Array.of(insole, ...message));
  }

  close(): void {
    this.reconnect.stop();
    if (this.socket) this.socket.onclose = null;
    this.socket?.close();
  }
}
