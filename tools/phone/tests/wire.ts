/** Loads the WebAssembly of the page, which decodes messages, for tests, and provides the computed walk and messages. */

import { readFileSync } from "node:fs";
import type { ToHost } from "../src/generated/messages";
import type { Step } from "../src/generated/quantities";
import { entries } from "../src/stream_file";
import { Wire } from "../src/wire";

const read = (path: string) => new Uint8Array(readFileSync(new URL(path, import.meta.url)));

export const loadWire = () =>
  Wire.load(Promise.resolve(new Response(read("../src/phone_wire.wasm"), { headers: { "content-type": "application/wasm" } })));

/** The stream file of the computed walk. */
export const walk = read("../public/walk.plantar");

/** The messages of one insole of the computed walk. */
export const messagesOf = (insole: number) =>
  [...entries(walk)].filter((entry) => entry.insole === insole).map(({ message }) => message);

/** A decoded hello of a left insole with one cell. */
export function hello(major: number): ToHost {
  const board = { firmware: "9", board: "test", side: "left", cells: 1, rate_hz: 100 } as const;
  return { kind: "hello", major, minor: 0, ...board, has_effective_areas: false, has_parameters: true, reset: "power", fault: null };
}

/** A decoded live frame with the same measured force on each region. */
export function live(values: Partial<Extract<ToHost, { kind: "live" }>> = {}, measured_n = 0): ToHost {
  const region = { area_mm2: 0, deformation_mm: 0, model_n: 0, measured_n, saturated: false, clamped: false, masked: false };
  const centre = { centre_x_mm: null, centre_y_mm: null };
  return { kind: "live", sequence: 0, t_s: 0, ...centre, regions: Array.from({ length: 8 }, () => ({ ...region })), ...values };
}

/** A decoded step without regions. */
export function step(values: Partial<Step> = {}): Step {
  const times = { start_s: 0, duration_s: 0.6, sample_s: 0.01, boots_since: 0, start_unix_s: null };
  const contact_rule = { area: "contact area", rule: "counted", on_kpa: 10, off_kpa: 7.5, full_kpa: 0 } as const;
  const first = { foot_first_peak_n: 0, foot_first_peak_time_s: 0, foot_valley_n: null, foot_valley_time_s: null };
  const second = { foot_second_peak_n: null, foot_second_peak_time_s: null, foot_force_integral_n_s: 0 };
  const points = { x_10_mm: 0, y_10_mm: 0, x_30_mm: 0, y_30_mm: 0, x_50_mm: 0, y_50_mm: 0, x_70_mm: 0, y_70_mm: 0 };
  const gait_line = { ...points, x_90_mm: 0, y_90_mm: 0, length_mm: 0, width_mm: 0, velocity_mm_s: 0 };
  const indices = { cop_excursion_index_percent: 0.1, arch_index_percent: 0 };
  const foot = { foot_force_peak_n: 0, ...first, ...second, gait_line, ...indices };
  return { side: "left", step: 0, ...times, bridged_frames: 0, contact_rule, foot, regions: {}, ...values };
}
