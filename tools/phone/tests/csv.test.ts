import { readFileSync } from "node:fs";
import { beforeAll, expect, test, vi } from "vitest";
import { PART_ROWS, daysCsv, liveCsv, stepsCsv } from "../src/csv";
import { Insoles } from "../src/insoles";
import { Recorder } from "../src/recorder";
import type { StoredStep } from "../src/step_store";
import { type Entry, MAX_MESSAGE, entries, entry } from "../src/stream_file";
import { ReplayTransport } from "../src/transport/replay";
import type { TransportEvents } from "../src/transport/transport";
import type { Wire } from "../src/wire";
import { loadWire, messagesOf, walk } from "./wire";

let wire: Wire;
beforeAll(async () => {
  wire = await loadWire();
});

/** An encoded `time` message. It consists of the message number, which is 6, and two varints. */
function timeMessage(host_us: number, device_us: number): Uint8Array {
  const varint = (value: number): number[] => (value < 128 ? [value] : [(value % 128) | 128, ...varint(Math.floor(value / 128))]);
  return Uint8Array.of(6, ...varint(host_us), ...varint(device_us));
}

/** The computed walk without its time messages. */
const withoutTimes = () => [...entries(walk)].filter(({ message }) => wire.decode(message)?.kind !== "time");

/** The lines of the CSV file with live frames. */
async function liveRows(recorded: Iterable<Entry>): Promise<string[]> {
  const text = await new Blob([...liveCsv(recorded, wire)]).text();
  return text.trimEnd().split("\n");
}

const cells = (row: string) => row.trimEnd().split(",");

test("a live row has the time of arrival, the side, the insole's time, and seven values for each region", async () => {
  const rows = await liveRows(withoutTimes());
  const head = cells(rows[0]!);
  expect(head.slice(0, 5)).toEqual(["unix_s", "t_s", "side", "sequence", "device_t_s"]);
  expect(head).toHaveLength(5 + 8 * 7);
  expect(rows.every((row) => cells(row).length === head.length)).toBe(true);
  const frames = [...entries(walk)].filter(({ message }) => wire.decode(message)?.kind === "live");
  expect(rows).toHaveLength(1 + frames.length);
  const right = cells(rows.find((row) => row.includes("right"))!);
  // The right foot of the computed walk starts half a stride later.
  expect([right[0], right[1], right[3], right[4]]).toEqual(["", "0.525", "0", "0"]);
});

test("the times of both feet are those of the browser's clock if the recording contains time messages", async () => {
  const recorded = withoutTimes();
  // The page sent its requests 1000 s after the start of 1970. At this time, the clock of the left insole showed 0.5 s and the
  // clock of the right insole 0.1 s.
  const answers: [0 | 1, number][] = [[0, 500_000], [1, 100_000]];
  const times = answers.map(([insole, device_us]) => ({ t_ms: 0, insole, message: timeMessage(1_000_000_000, device_us) }));
  const rows = (await liveRows([...recorded, ...times])).slice(1).map(cells);
  for (const [side, device_s] of [["left", 0.5], ["right", 0.1]] as const) {
    const first = rows.find((row) => row[2] === side)!;
    expect(Number(first[0])).toBeCloseTo(1000 - device_s + Number(first[4]), 5);
  }
});

test("after a restart of the insole, the times are those of its new clock", async () => {
  const left = withoutTimes().filter(({ insole }) => insole === 0);
  const session = (host_us: number) => [...left, { t_ms: 0, insole: 0 as const, message: timeMessage(host_us, 500_000) }];
  const rows = (await liveRows([...session(1_000_000_000), ...session(2_000_000_000)])).slice(1).map(cells);
  const count = rows.length / 2;
  for (const [row, host_s] of [[rows[0]!, 1000], [rows[count]!, 2000]] as const) {
    expect(Number(row[0])).toBeCloseTo(host_s - 0.5 + Number(row[4]), 5);
  }
});

test("a long recording is exported in parts, so that few decoded frames are in memory at once", async () => {
  const [first, ...frames] = withoutTimes().filter(({ message }) => ["hello", "live"].includes(wire.decode(message)!.kind));
  const recorded = [first!, ...Array.from({ length: 20 }, () => frames).flat()];
  const live = recorded.filter(({ message }) => message[0] === frames.at(-1)!.message[0]).length;
  expect(live).toBeGreaterThan(2 * PART_ROWS);
  const decode = vi.spyOn(wire, "decode");
  const parts = liveCsv(recorded, wire);
  const blobs = [parts.next().value as Blob];
  expect(decode.mock.calls.length).toBeLessThan(1.1 * PART_ROWS);
  decode.mockRestore();
  blobs.push(...parts);
  const rows = (await new Blob(blobs).text()).trimEnd().split("\n");
  expect([blobs.length, rows.length]).toEqual([Math.ceil((1 + live) / PART_ROWS), 1 + live]);
});

test("a step has one row for each region", () => {
  const steps = messagesOf(0).flatMap((message): StoredStep[] => {
    const decoded = wire.decode(message);
    return decoded?.kind === "step" ? [{ step: decoded.step, start_unix_s: null }] : [];
  });
  const rows = stepsCsv(steps);
  const head = cells(rows[0]!);
  expect(rows).toHaveLength(1 + 8 * steps.length);
  const heel = Object.fromEntries(cells(rows[1]!).map((cell, i) => [head[i], cell]));
  const expected = steps[0]!.step.regions["heel"]!;
  expect(heel).toMatchObject({
    side: "left",
    region: "heel",
    foot_force_peak_n: String(steps[0]!.step.foot.foot_force_peak_n),
    measured_force_peak_n: String(expected.measured_force_peak_n),
    ellipse_r_a_mm: String(expected.ellipse_at_peak!.r_a_mm),
    clamped: expected.clamped ? "1" : "0",
  });
});

test("a quantity that does not exist has an empty cell", () => {
  const decoded = messagesOf(0).map((message) => wire.decode(message)).find((message) => message?.kind === "step");
  if (decoded?.kind !== "step") throw new Error("the recording has a step");
  const { heel } = decoded.step.regions;
  const step = { ...decoded.step, regions: { ...decoded.step.regions, heel: { ...heel!, model_force_peak_n: null } } };
  const [head, row] = stepsCsv([{ step, start_unix_s: null }]).map(cells);
  expect(row![head!.indexOf("model_force_peak_n")]).toBe("");
  expect(row![head!.indexOf("measured_force_peak_n")]).toBe(String(heel!.measured_force_peak_n));
});

test("a recording begins with the hello messages and ends when it is stopped", () => {
  const recorder = new Recorder();
  const [hello, frame] = messagesOf(1);
  recorder.add(1, frame!, 5);
  recorder.start(1000, [[1, hello!]]);
  recorder.add(1, frame!, 1020);
  recorder.stop();
  recorder.add(1, frame!, 1030);
  expect([...recorder]).toEqual([
    { t_ms: 0, insole: 1, message: hello },
    { t_ms: 20, insole: 1, message: frame },
  ]);
});

test("an incomplete message at the end of a file is omitted", () => {
  const first = { t_ms: 1, insole: 0 as const, message: Uint8Array.of(1, 2, 3) };
  const bytes = Uint8Array.of(...entry(first), ...entry({ ...first, t_ms: 2 }));
  for (let length = entry(first).length; length < bytes.length; length += 1) {
    expect([...entries(bytes.subarray(0, length))]).toEqual([first]);
  }
});

test("a file that is not a recording is refused", () => {
  const bytes = entry({ t_ms: 1, insole: 0, message: Uint8Array.of(1, 2, 3) });
  // This byte is the index of the insole; there are two insoles.
  bytes[4] = 9;
  expect(() => new ReplayTransport(bytes, {} as TransportEvents)).toThrow("not a recording");
});

test("an entry with an impossible length is reported as damage, even if it is the last one", () => {
  const first = entry({ t_ms: 1, insole: 0, message: Uint8Array.of(1, 2, 3) });
  for (const length of [0, MAX_MESSAGE + 1, 0xffff]) {
    const last = entry({ t_ms: 2, insole: 0, message: Uint8Array.of(4, 5) });
    new DataView(last.buffer).setUint16(5, length, true);
    expect(() => [...entries(Uint8Array.of(...first, ...last))]).toThrow(`damaged at byte ${first.length}`);
  }
  const longest = { t_ms: 3, insole: 0 as const, message: new Uint8Array(MAX_MESSAGE) };
  expect([...entries(entry(longest))]).toEqual([longest]);
});

test("the length of the longest message is that of the firmware", () => {
  const codec = readFileSync(new URL("../../../src/protocol/codec.rs", import.meta.url), "utf8");
  expect(Number(/MAX_MESSAGE: usize = (\d+)/.exec(codec)?.[1])).toBe(MAX_MESSAGE);
});

test("a message of an impossible length is counted as damaged and is not recorded", () => {
  const recorder = new Recorder();
  const none = () => undefined;
  const events = { live: none, shape: none, record: none, isKnown: () => false, answer: none, message: none };
  const insoles = new Insoles(wire, recorder, events);
  insoles.use({ location: "in a test", is_replay: false, can_lose_records: true, send: none, close: none });
  recorder.start(0, []);
  const [hello] = messagesOf(0);
  const received = [hello!, new Uint8Array(0), new Uint8Array(MAX_MESSAGE + 1)];
  for (const message of received) insoles.transportEvents.message(0, message);
  expect([...recorder].map(({ message }) => message)).toEqual([hello]);
  expect(insoles.sessions[0]?.damaged).toBe(2);
});

test("the sum of the integrals of a day is exported without the digits of its rounding errors", () => {
  const none = { steps: 0, bouts: 0, alerts: 0, integral_n_s: 0, peak_n: 0 };
  const left = { ...none, steps: 3, integral_n_s: 11039.800000000001, peak_n: 800 };
  const rows = daysCsv([{ day: "2026-01-01", left, right: none }]);
  expect(rows.slice(1)).toEqual(["2026-01-01,left,3,0,0,11039.8,800\n", "2026-01-01,right,0,0,0,0,0\n"]);
});
