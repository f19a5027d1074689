import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Facts } from "../src/generated/messages";
import type { Insoles } from "../src/insoles";
import { remarks } from "../src/notes";
import { entry } from "../src/stream_file";
import { ReplayTransport } from "../src/transport/replay";
import type { TransportEvents } from "../src/transport/transport";
import { WebSocketTransport } from "../src/transport/websocket";

beforeEach(() => void vi.useFakeTimers());
afterEach(() => void vi.useRealTimers());

/** Transport events that are logged as texts, in the order of their occurrence. */
function logEvents() {
  const log: string[] = [];
  const events: TransportEvents = {
    opened: (insole) => log.push(`opened ${insole}`),
    closed: (insole) => log.push(`closed ${insole}`),
    message: (insole, bytes) => log.push(`${insole}: ${bytes.join()}`),
    damaged: (insole) => log.push(`damaged ${insole}`),
    battery: (insole, percent) => log.push(`battery ${insole} ${percent}`),
  };
  return { log, events };
}

test("a recording is played at its own speed, in a loop", () => {
  const { log, events } = logEvents();
  const message = (value: number) => Uint8Array.of(value);
  const file = Uint8Array.from([
    ...entry({ t_ms: 0, insole: 0, message: message(1) }),
    ...entry({ t_ms: 50, insole: 1, message: message(2) }),
  ]);
  const replay = new ReplayTransport(file, events, () => Date.now());
  vi.advanceTimersByTime(45);
  expect(log).toEqual(["opened 0", "opened 1", "0: 1"]);
  vi.advanceTimersByTime(5);
  expect(log.at(-1)).toBe("1: 2");
  vi.advanceTimersByTime(5);
  expect(log.slice(-2)).toEqual(["1: 2", "0: 1"]);
  replay.close();
  const length = log.length;
  vi.advanceTimersByTime(1000);
  expect(log).toHaveLength(length);
});

/** Replaces the browser's WebSocket. */
class Socket {
  static readonly OPEN = 1;
  static all: Socket[] = [];
  readyState = 1;
  sent: Uint8Array[] = [];
  onopen?: () => void;
  onclose?: (() => void) | null;
  onmessage?: (event: { data: ArrayBuffer }) => void;
  constructor(readonly url: string) {
    Socket.all.push(this);
  }
  send = (bytes: Uint8Array) => void this.sent.push(bytes);
  close = () => this.onclose?.();
}

test("messages on the socket begin with the index of the insole, and a broken socket is opened again", () => {
  vi.stubGlobal("WebSocket", Socket);
  const { log, events } = logEvents();
  const transport = new WebSocketTransport("ws://localhost/insoles", events);
  const [first] = Socket.all;
  first!.onopen!();
  first!.onmessage!({ data: Uint8Array.of(1, 7, 8).buffer });
  // Messages of a third insole are ignored.
  first!.onmessage!({ data: Uint8Array.of(2, 7, 8).buffer });
  transport.send(1, Uint8Array.of(5));
  expect(first!.sent).toEqual([Uint8Array.of(1, 5)]);
  first!.close();
  expect(log).toEqual(["opened 0", "opened 1", "1: 7,8", "closed 0", "closed 1"]);
  vi.advanceTimersByTime(1000);
  expect(Socket.all).toHaveLength(2);
  transport.close();
  vi.advanceTimersByTime(5000);
  expect(Socket.all).toHaveLength(2);
  vi.unstubAllGlobals();
});

test("the page waits for an insole of plantar serve, which can run on another computer", () => {
  vi.stubGlobal("WebSocket", Socket);
  const transport = new WebSocketTransport("ws://192.168.0.2/insoles", logEvents().events);
  const text = (state: string, reason = "") => {
    const insoles = { transport, sessions: [{ state, reason, records_waiting: 0 }], of: () => undefined };
    return JSON.stringify(remarks(insoles as unknown as Insoles, undefined, { regions: [] } as unknown as Facts));
  };
  expect(text("waiting")).toContain("Waiting for an insole of plantar serve.");
  expect(text("closed", "plantar serve does not answer")).toContain("plantar serve: plantar serve does not answer.");
  transport.close();
  vi.unstubAllGlobals();
});
