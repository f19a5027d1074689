/** The core's wire messages, decoded and encoded by the core itself as WebAssembly. */

import { INSOLES, type Insole } from "./transport/transport";

export type Side = "left" | "right";
export const SIDES: readonly Side[] = ["left", "right"];

export interface Hello {
  kind: "hello";
  major: number;
  minor: number;
  firmware: string;
  board: string;
  side: Side;
  cells: number;
  rate_hz: number;
  has_parameters: boolean;
  reset: string;
  last_panic: string | null;
}

export interface LiveRegion {
  area_mm2: number;
  deformation_mm: number;
  model_n: number;
  measured_n: number;
  saturated: boolean;
  clamped: boolean;
  masked: boolean;
}

export interface Live {
  kind: "live";
  sequence: number;
  /** Device time. */
  t_s: number;
  /** In the order of {@link Facts.regions}. */
  regions: LiveRegion[];
}

export interface Ellipse {
  x_mm: number;
  y_mm: number;
  r_a_mm: number;
  r_b_mm: number;
  angle_deg: number;
}

export interface StepRegion {
  measured_force_peak_n: number;
  model_force_peak_n: number;
  measured_force_integral_n_s: number;
  model_force_integral_n_s: number;
  area_peak_mm2: number;
  deformation_peak_mm: number;
  deformation_rate_peak_mm_s: number;
  contact_time_s: number;
  time_to_peak_s: number;
  ellipse_at_peak: Ellipse | null;
  model_error_nrmse_percent: number;
  saturated: boolean;
  clamped: boolean;
  masked_cells: number;
}

/** The same object as `plantar replay --json` writes. */
export interface Step {
  side: Side;
  step: number;
  start_s: number;
  duration_s: number;
  sample_s: number;
  bridged_frames: number;
  /** Starts of the insole since the one that this step was made in. */
  starts_ago: number;
  /** By the insole's own clock; only of a step from before its last start. */
  start_unix_s: number | null;
  contact_rule: { rule: string; on_kpa: number; off_kpa: number; full_kpa: number };
  regions: Record<string, StepRegion>;
}

export interface Status {
  kind: "status";
  uptime_s: number;
  frames_missed: number;
  live_due: number;
  live_sent: number;
  steps: number;
  steps_dropped: number;
  bad_frames: number;
  /** What the insole could not keep. */
  unkept: number;
  faults: number;
  rezeroed: number;
}

export type ToHost =
  | Hello
  | Live
  | { kind: "step"; step: Step }
  | Status
  | { kind: "tissue"; id: number }
  | { kind: "refused"; reason: string }
  | { kind: "time"; host_us: number; device_us: number }
  | { kind: "faults"; found: number; rezeroed: number; list: { fault: string; place: string; found_s: number }[] };

export type Point = [x_mm: number, y_mm: number];

/** What never changes while the page runs. */
export interface Facts {
  major: number;
  minor: number;
  /** Unacknowledged steps that an insole keeps. */
  step_queue: number;
  regions: { name: string; outline_mm: Point[]; centre_mm: Point }[];
  sole: { length_mm: number; width_mm: number; outline_mm: Point[] };
}

interface Exports {
  memory: WebAssembly.Memory;
  room(length: number): number;
  result(): number;
  decode(): number;
  facts(): number;
  connect(): number;
  stream(live: boolean): number;
  acknowledge(step: number): number;
  get_status(): number;
  get_time(unix_us: number): number;
  set_clock(unix_us: number): number;
  axis_clear(index: number): void;
  axis_answer(index: number, asked_us: number, device_us: number): void;
  axis_unix_us(index: number, device_us: number): number;
}

/** An insole's clock against the browser's, so that both feet share one axis. */
export class Axis {
  constructor(
    private readonly core: Exports,
    private readonly index: number,
  ) {}

  clear(): void {
    this.core.axis_clear(this.index);
  }

  answer({ host_us, device_us }: { host_us: number; device_us: number }): void {
    this.core.axis_answer(this.index, host_us, device_us);
  }

  /** Seconds since 1970 when the insole's clock showed `device_s`; `null` before the first answer. */
  unix_s(device_s: number): number | null {
    const unix_us = this.core.axis_unix_us(this.index, Math.round(device_s * 1e6));
    return Number.isNaN(unix_us) ? null : unix_us / 1e6;
  }
}

export class Wire {
  readonly facts: Facts;
  private readonly text = new TextDecoder();

  constructor(private readonly core: Exports) {
    this.facts = JSON.parse(this.text.decode(this.read(core.facts()))) as Facts;
  }

  static async load(module: Response | Promise<Response>): Promise<Wire> {
    const { instance } = await WebAssembly.instantiateStreaming(module);
    return new Wire(instance.exports as unknown as Exports);
  }

  /** The message; `undefined` where the bytes are no message of this version. */
  decode(bytes: Uint8Array): ToHost | undefined {
    const at = this.core.room(bytes.length);
    new Uint8Array(this.core.memory.buffer, at, bytes.length).set(bytes);
    const length = this.core.decode();
    return length === 0 ? undefined : (JSON.parse(this.text.decode(this.read(length))) as ToHost);
  }

  connect = () => this.request(this.core.connect());
  stream = (live: boolean) => this.request(this.core.stream(live));
  acknowledge = (step: number) => this.request(this.core.acknowledge(step));
  getStatus = () => this.request(this.core.get_status());
  getTime = (unix_us: number) => this.request(this.core.get_time(unix_us));
  setClock = (unix_us: number) => this.request(this.core.set_clock(unix_us));
  /** What is known of the clock of an insole that is connected. */
  axis = (insole: Insole) => new Axis(this.core, insole);
  /** The same of an insole in a recording. */
  recordedAxis = (insole: Insole) => new Axis(this.core, INSOLES.length + insole);

  private request(length: number): Uint8Array {
    return this.read(length).slice();
  }

  private read(length: number): Uint8Array {
    // Asked anew each time: memory may have grown or moved.
    return new Uint8Array(this.core.memory.buffer, this.core.result(), length);
  }
}
