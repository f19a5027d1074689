/**
 * The core of the page, as WebAssembly: decodes and encodes messages, computes the shapes of soles and the measures of walking,
 * converts the times of insoles, counts lost frames, and detects lost records.
 */

import type { Facts, LayoutCell, Sole, ToHost } from "./generated/messages";
import type { Gait, Step } from "./generated/quantities";
import { INSOLES, type Insole } from "./transport/transport";

/** The exports of tools/phone/wire, which describes them. Those that write to the shared buffer return the length written. */
interface Exports {
  memory: WebAssembly.Memory;
  resize_buffer(length: number): number;
  result(): number;
  decode(): number;
  facts(): number;
  connect(): number;
  stream(live: boolean): number;
  stream_ellipses(every: number): number;
  get_setup_cells(first: number): number;
  sole(): number;
  acknowledge(number: number): number;
  get_status(): number;
  get_identified(): number;
  get_alert_rules(): number;
  set_alerts(is_on: boolean, day_start_min: number): number;
  get_daily_load(): number;
  snooze_alerts(snoozed_s: number): number;
  get_time(unix_us: number): number;
  set_clock(unix_us: number): number;
  clock_mapping_clear(index: number): void;
  clock_mapping_answer(index: number, asked_us: number, device_us: number): void;
  clock_mapping_unix_us(index: number, device_us: number): number;
  clock_mapping_is_comparable(index: number, device_us: number): number;
  are_feet_comparable(comparable: number, steps: number): number;
  counter_clear(index: number): void;
  counter_new_session(index: number): void;
  counter_frame(index: number, sequence: number): void;
  counter_due(index: number, live_due: number): void;
  counter_received(index: number): number;
  counter_lost(index: number): number;
  order_accepts(index: number, number: number, damaged: number): number;
  order_repeat(index: number, number: number): void;
  order_is_retransmission_due(index: number): number;
  order_begin(index: number): void;
  order_interrupt(index: number): void;
  gait_step(foot: number, number: number, start_s: number, duration_s: number, peak_n: number, integral_n_s: number): void;
  gait_measures(has_common_clock: boolean, stride_m: number): number;
}

/** Converts times of an insole's clock to times of the browser's clock, so that the times of both feet can be compared. */
export class ClockMapping {
  constructor(
    private readonly core: Exports,
    private readonly index: number,
  ) {}

  /** Removes the answers received so far. */
  clear(): void {
    this.core.clock_mapping_clear(this.index);
  }

  /** Adds a time message of the insole: the page's time in the request, and the insole's time when the request arrived. */
  answer({ host_us, device_us }: { host_us: number; device_us: number }): void {
    this.core.clock_mapping_answer(this.index, host_us, device_us);
  }

  /** The time, s since 1970, at which the insole's clock showed `device_s`; `null` before the first answer. */
  unix_s(device_s: number): number | null {
    const unix_us = this.core.clock_mapping_unix_us(this.index, Math.round(device_s * 1e6));
    return Number.isNaN(unix_us) ? null : unix_us / 1e6;
  }

  /** True if {@link unix_s} of this time is exact enough to compare it with that of the other insole. */
  is_comparable(device_s: number): boolean {
    return Boolean(this.core.clock_mapping_is_comparable(this.index, Math.round(device_s * 1e6)));
  }
}

/** Counts the received and the lost live frames of an insole. */
export class LiveCounter {
  constructor(
    private readonly core: Exports,
    private readonly index: number,
  ) {}

  clear(): void {
    this.core.counter_clear(this.index);
  }

  /**
   * To be called when a session begins. The gap between its first sequence number and the last one of the session before is no
   * loss, and the insole counts the frames that are due from 0 again.
   */
  newSession(): void {
    this.core.counter_new_session(this.index);
  }

  /** Counts a live frame. A gap in the sequence numbers counts as lost frames. */
  frame(sequence: number): void {
    this.core.counter_frame(this.index, sequence);
  }

  /** Compares the received frames with the insole's own count of the frames of this session, which reveals further losses. */
  due(live_due: number): void {
    this.core.counter_due(this.index, live_due);
  }

  get received(): number {
    return this.core.counter_received(this.index);
  }

  get lost(): number {
    return this.core.counter_lost(this.index);
  }
}

/** Detects records of an insole that were lost on the way. An acknowledgement of a record also covers all earlier ones. */
export class RecordOrder {
  constructor(
    private readonly core: Exports,
    private readonly index: number,
  ) {}

  /**
   * Returns true if the record with this number, which has not arrived before, can be used. Otherwise records before it are
   * missing, and the insole must first send all its unacknowledged records again. `damaged` is the number of damaged messages
   * that have arrived.
   */
  accepts(number: number, damaged: number): boolean {
    return Boolean(this.core.order_accepts(this.index, number, damaged));
  }

  /**
   * To be called for a record that has arrived before. The insole sends it together with those after it, so the next record must
   * have the next number.
   */
  repeat(number: number): void {
    this.core.order_repeat(this.index, number);
  }

  /** True from the detection of a gap until the insole begins to send its unacknowledged records again. */
  get is_retransmission_due(): boolean {
    return Boolean(this.core.order_is_retransmission_due(this.index));
  }

  /** To be called when a session begins, in which the insole sends all its unacknowledged records, oldest first. */
  begin(): void {
    this.core.order_begin(this.index);
  }

  /** To be called when another host receives the records. The next one that arrives here can have any number. */
  interrupt(): void {
    this.core.order_interrupt(this.index);
  }
}

/** Encodes, decodes and computes by the functions of the core. */
export class Wire {
  readonly facts: Facts;
  private readonly text = new TextDecoder();

  constructor(private readonly core: Exports) {
    this.facts = this.json(core.facts()) as Facts;
  }

  static async load(module: Response | Promise<Response>): Promise<Wire> {
    const { instance } = await WebAssembly.instantiateStreaming(module);
    return new Wire(instance.exports as unknown as Exports);
  }

  /** Decodes a message. Returns `undefined` for bytes that are no message of this version, or one that the page does not use. */
  decode(bytes: Uint8Array): ToHost | undefined {
    this.write(bytes);
    return this.json(this.core.decode()) as ToHost | undefined;
  }

  /** The sole of an insole with these cells; `undefined` if they cannot be drawn. */
  sole(cells: readonly LayoutCell[]): Sole | undefined {
    this.write(new TextEncoder().encode(JSON.stringify(cells)));
    return this.json(this.core.sole()) as Sole | undefined;
  }

  connect = () => this.request(this.core.connect());
  stream = (live: boolean) => this.request(this.core.stream(live));
  streamEllipses = (every: number) => this.request(this.core.stream_ellipses(every));
  getSetupCells = (first: number) => this.request(this.core.get_setup_cells(first));
  acknowledge = (number: number) => this.request(this.core.acknowledge(number));
  getStatus = () => this.request(this.core.get_status());
  getIdentified = () => this.request(this.core.get_identified());
  getAlertRules = () => this.request(this.core.get_alert_rules());
  /**
   * Turns alerts on or off. `rules` is the insole's message with its present rules. To turn them off, the number of alerts in a
   * day becomes 0; to turn them on, it becomes the recommended one if it was 0. The wearer's day begins `day_start_min` minutes
   * after midnight UTC. The other values remain.
   */
  setAlerts(rules: Uint8Array, is_on: boolean, day_start_min: number): Uint8Array {
    this.write(rules);
    return this.request(this.core.set_alerts(is_on, day_start_min));
  }

  getDailyLoad = () => this.request(this.core.get_daily_load());
  snoozeAlerts = (snoozed_s: number) => this.request(this.core.snooze_alerts(snoozed_s));
  getTime = (unix_us: number) => this.request(this.core.get_time(unix_us));
  setClock = (unix_us: number) => this.request(this.core.set_clock(unix_us));
  /** The clock mapping of a connected insole. */
  clockMapping = (insole: Insole) => new ClockMapping(this.core, insole);
  /** The clock mapping of an insole in a recording. */
  recordedClockMapping = (insole: Insole) => new ClockMapping(this.core, INSOLES.length + insole);
  counter = (insole: Insole) => new LiveCounter(this.core, insole);
  order = (insole: Insole) => new RecordOrder(this.core, insole);

  /**
   * The measures of both feet, from the steps of the left and of the right foot. `number` counts the steps of a foot, without
   * its other records, and `start_s` is the time of the heel strike. `has_common_clock` states whether the times of both feet can
   * be compared. `stride_m` is the mean length of a stride; 0 if it is unknown.
   */
  gait(feet: readonly (readonly { step: Step; number: number; start_s: number }[])[], has_common_clock: boolean, stride_m: number): Gait {
    feet.forEach((steps, foot) => {
      for (const { step, number, start_s } of steps) {
        const { foot_force_peak_n, foot_force_integral_n_s } = step.foot;
        this.core.gait_step(foot, number, start_s, step.duration_s, foot_force_peak_n, foot_force_integral_n_s);
      }
    });
    return this.json(this.core.gait_measures(has_common_clock, stride_m)) as Gait;
  }

  /** True if a foot with `steps` steps, of which `comparable` have comparable times, can be compared by these with the other foot. */
  areFeetComparable(comparable: number, steps: number): boolean {
    return Boolean(this.core.are_feet_comparable(comparable, steps));
  }

  private write(bytes: Uint8Array): void {
    const address = this.core.resize_buffer(bytes.length);
    new Uint8Array(this.core.memory.buffer, address, bytes.length).set(bytes);
  }

  private request(length: number): Uint8Array {
    return this.read(length).slice();
  }

  /** The JSON value that the core has written; `undefined` if it has written nothing. */
  private json(length: number): unknown {
    return length === 0 ? undefined : JSON.parse(this.text.decode(this.read(length)));
  }

  private read(length: number): Uint8Array {
    // The view is created each time, because the memory may have grown, which invalidates earlier views.
    return new Uint8Array(this.core.memory.buffer, this.core.result(), length);
  }
}
