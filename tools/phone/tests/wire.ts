/** Loads the core of the page for tests, and provides the computed walk and messages. */

import { readFileSync } from "node:fs";
import type { ToHost } from "../src/generated/messages";
import type { Step } from "../src/generated/quantities";
import { entries } from "../src/stream_file";
import { Wire } from "../src/wire";

const read = (path: string) => new Uint8Array(readFileSync(new URL(path, import.meta.url)));

export const loadWire = () =>
  Wire.load(Promise.resolve(new Response(read("../src/phone_wire.wasm"), { headers: { "content-type": "application/wasm" } })));

export const walk = read("../public/walk.plantar");

/** The messages of one insole of the computed walk. */
export const messagesOf = (insole: number) =>
  [...entries(walk)].filter((entry) => entry.insole === insole).map(({ message }) => message);

/** A decoded live frame with the same measured force on each region. */
export function live(values: Partial<Extract<ToHost, { kind: "live" }>> = {}, measured_n = 0): ToHost {
  const region = { area_mm2: 0, deformation_mm: 0, model_n: 0, measured_n, saturated: false, clamped: false, masked: false };
  return { kind: "live", sequence: 0, t_s: 0, regions: Array.from({ length: 8 }, () => ({ ...region })), ...values };
}

/** A decoded step without regions. */
export function step(values: Partial<Step> = {}): Step {
  const times = { start_s: 0, duration_s: 0.6, sample_s: 0.01, starts_ago: 0, start_unix_s: null };
  const contact_rule = { rule: "counted", on_kpa: 10, off_kpa: 7.5, full_kpa: 0 } as const;
  return { side: "left", step: 0, ...times, bridged_frames: 0, contact_rule, regions: {}, ...values };
}
