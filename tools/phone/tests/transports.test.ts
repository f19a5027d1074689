import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ReplayTransport } from "../src/transport/replay";
import type { TransportEvents } from "../src/transport/transport";
import { WebSocketTransport } from "../src/transport/websocket";
import { entry } from "../src/stream_file";

beforeEach(() => void vi.useFakeTimers());
afterEach(() => void vi.useRealTimers());

function heard() {
  const said: string[] = [];
  const events: TransportEvents = {
    opened: (insole) => said.push(`opened ${insole}`),
    closed: (insole) => said.push(`closed ${insole}`),
    message: (insole, bytes) => said.push(`${insole}: ${bytes.join()}`),
    damaged: (insole) => said.push(`damaged ${insole}`),
    battery: (insole, percent) => said.push(`battery ${insole} ${percent}`),
  };
  return { said, events };
}

test("a recording plays in its own time, and again", () => {
  const { said, events } = heard();
  const message = (value: number) => Uint8Array.of(value);
  const file = Uint8Array.from([
    ...entry({ t_ms: 0, insole: 0, message: message(1) }),
    ...entry({ t_ms: 50, insole: 1, message: message(2) }),
  ]);
  const replay = new ReplayTransport(file, events, () => Date.now());
  vi.advanceTimersByTime(45);
  expect(said).toEqual(["opened 0", "opened 1", "0: 1"]);
  vi.advanceTimersByTime(5);
  expect(said.at(-1)).toBe("1: 2");
  vi.advanceTimersByTime(5);
  expect(said.slice(-2)).toEqual(["1: 2", "0: 1"]);
  replay.close();
  const length = said.length;
  vi.advanceTimersByTime(1000);
  expect(said).toHaveLength(length);
});

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

test("a socket carries the insole's index before each message, and comes back when it breaks", () => {
  vi.stubGlobal("WebSocket", Socket);
  const { said, events } = heard();
  const transport = new WebSocketTransport("ws://localhost/insoles", events);
  const [first] = Socket.all;
  first!.onopen!();
  first!.onmessage!({ data: Uint8Array.of(1, 7, 8).buffer });
  // There is no third foot.
  first!.onmessage!({ data: Uint8Array.of(2, 7, 8).buffer });
  transport.send(1, Uint8Array.of(5));
  expect(first!.sent).toEqual([Uint8Array.of(1, 5)]);
  first!.close();
  expect(said).toEqual(["opened 0", "opened 1", "1: 7,8", "closed 0", "closed 1"]);
  vi.advanceTimersByTime(1000);
  expect(Socket.all).toHaveLength(2);
  transport.close();
  vi.advanceTimersByTime(5000);
  expect(Socket.all).toHaveLength(2);
  vi.unstubAllGlobals();
});
