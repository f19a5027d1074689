/** Connects insoles over Web Bluetooth, without a server. */

import type { Gatt } from "../generated/messages";
import { Reconnect } from "../reconnect";
import { Fragments, fragments } from "./fragments";
import { INSOLES, type Insole, type Transport, type TransportEvents } from "./transport";

/** Length of the longest value, bytes, that can be written with the smallest ATT MTU. Web Bluetooth does not report the MTU. */
const VALUE_BYTES = 20;
/** Interval between two readings of the battery. */
const BATTERY_MS = 60_000;
/** No insole was chosen: the wearer cancelled the choice, or the phone or the browser showed no list. The errors are equal. */
export const NONE_CHOSEN =
  'No insole was chosen. If no list appeared, allow Bluetooth ("Nearby devices", on older phones also Location) for the ' +
  "browser in the phone's settings.";
const NO_SERVICE =
  "The insole does not offer what this page needs. Update its firmware with plantar update, then try again.";
/** An insole does not let a phone that is not paired subscribe to its characteristics. */
const NOT_PAIRED =
  "The insole did not accept this phone. It pairs only within a minute after it is switched on: switch it off for some seconds, " +
  "then on, and try again at once. If this phone was paired with it before, first remove the insole in the phone's Bluetooth settings.";
/**
 * Reasons for a lost connection, as phrases for the wearer. A phone that connects again was paired before, so if the insole does
 * not accept it now, it is no longer paired.
 */
const OUT_OF_REACH = "out of reach or switched off";
const NO_LONGER_PAIRED =
  "it does not accept this phone any more: remove the insole in the phone's Bluetooth settings, then switch it off for some seconds, and on";
/** An insole that has lost the bond ends each link. A poor radio link also breaks, and the browser reports no difference. */
const BREAKS_AT_ONCE =
  "each new link breaks at once: hold the phone closer or, if that does not help, remove the insole in the phone's Bluetooth " +
  "settings, then switch it off for some seconds, and on";
/** Number of successive links that broke before the page could subscribe, from which on they count as broken at once. */
const BROKEN_LINKS = 2;

/** An insole that the wearer chose. */
interface Connected {
  device: BluetoothDevice;
  reconnect: Reconnect;
  /** The reason to report if the link breaks. */
  reason: string;
  /** Number of links since the last one over which the page could subscribe. */
  links: number;
  /** The characteristic to which requests are written, except those for parameters; `undefined` while there is no connection. */
  control?: BluetoothRemoteGATTCharacteristic | undefined;
  /** The characteristic to which requests for parameters are written; `undefined` while there is no connection. */
  parameters?: BluetoothRemoteGATTCharacteristic | undefined;
  /** The charge of the battery; `undefined` while there is no connection, and if the insole does not measure it. */
  battery?: BluetoothRemoteGATTCharacteristic | undefined;
  /** Time at which the last reading of the battery was requested, by `performance.now()`. */
  battery_requested_ms: number;
  /** Resolves after the last write or reading. The next one waits for it, because operations must not overlap. */
  operating: Promise<void>;
  /** The requests that wait to be written, by kind, which is the first byte of the encoded request. */
  waiting: Map<number, Uint8Array>;
}

/** The insoles that the wearer chose. */
export class BluetoothTransport implements Transport {
  readonly location = "over Bluetooth";
  readonly is_replay = false;
  readonly is_radio = true;
  readonly can_lose_records = true;
  private readonly insoles = new Map<Insole, Connected>();

  constructor(
    private readonly gatt: Gatt,
    private readonly events: TransportEvents,
  ) {}

  get is_idle(): boolean {
    return this.insoles.size === 0;
  }

  static isSupported(): boolean {
    return "bluetooth" in navigator;
  }

  /** Lets the wearer choose an insole. Browsers allow this only in the handler of a click. */
  async choose(): Promise<BluetoothDevice> {
    this.freeIndex();
    const options = { filters: [{ services: [this.gatt.service] }], optionalServices: ["battery_service"] };
    const device = await navigator.bluetooth.requestDevice(options).catch(async (error: unknown) => {
      if (nameOf(error) !== "NotFoundError") throw error;
      // The error is the same without an adapter, or if a setting blocks Bluetooth. Some browsers cannot state whether it is so.
      const is_available = await navigator.bluetooth.getAvailability?.();
      const off = "Bluetooth is off, or not allowed for this page. Switch it on or allow it, then try again.";
      throw new Error(is_available === false ? off : NONE_CHOSEN);
    });
    if ([...this.insoles.values()].some((known) => known.device.id === device.id)) {
      throw new Error("This insole is connected already. Choose the other one.");
    }
    return device;
  }

  /** The index of the next insole. Throws an error if there is none. */
  private freeIndex(): Insole {
    const insole = INSOLES.find((index) => !this.insoles.has(index));
    if (insole === undefined) throw new Error("Both insoles are connected already. Reload the page to connect other ones.");
    return insole;
  }

  /** Connects a chosen insole. */
  async connect(device: BluetoothDevice): Promise<void> {
    const insole = this.freeIndex();
    const reconnect = new Reconnect(() => this.open(insole, connected));
    const connected: Connected = {
      device, reconnect, reason: OUT_OF_REACH, links: 0,
      battery_requested_ms: 0, operating: Promise.resolve(), waiting: new Map(),
    };
    this.insoles.set(insole, connected);
    device.addEventListener("gattserverdisconnected", () => {
      connected.control = undefined;
      connected.parameters = undefined;
      connected.battery = undefined;
      if (this.insoles.get(insole) !== connected) return;
      this.events.closed(insole, connected.reason);
      reconnect.later();
    });
    try {
      await this.open(insole, connected);
    } catch (error) {
      this.remove(insole, connected);
      throw nameOf(error) === "NotFoundError" ? new Error(NO_SERVICE) : error;
    }
  }

  /** Disconnects an insole, so that another program can connect to it. */
  private remove(insole: Insole, { device, reconnect }: Connected): void {
    this.insoles.delete(insole);
    reconnect.stop();
    device.gatt?.disconnect();
  }

  /** Opens the link, and subscribes to the messages of the insole. */
  private async open(insole: Insole, connected: Connected): Promise<void> {
    const server = await connected.device.gatt?.connect();
    if (!server) throw new Error("The insole refused the connection. Close other programs that use it, then try again.");
    connected.links += 1;
    if (connected.links >= BROKEN_LINKS && connected.reason === OUT_OF_REACH) connected.reason = BREAKS_AT_ONCE;
    const service = await server.getPrimaryService(this.gatt.service);
    const control = await service.getCharacteristic(this.gatt.control);
    const live = await service.getCharacteristic(this.gatt.live);
    const parameters = await service.getCharacteristic(this.gatt.parameters);
    for (const characteristic of [control, live, await service.getCharacteristic(this.gatt.steps), parameters]) {
      const joiner = new Fragments(() => this.events.damaged(insole));
      characteristic.oncharacteristicvaluechanged = () => {
        const value = characteristic.value;
        const message = value && joiner.push(new Uint8Array(value.buffer, value.byteOffset, value.byteLength));
        if (message) this.events.message(insole, message);
      };
      await characteristic.startNotifications().catch((error: unknown) => {
        // If the link broke, the error is no refusal by the insole.
        if (!server.connected) throw error;
        // The insole also ends the link of a phone that does not pair. The reason remains until the phone has paired.
        connected.reason = NO_LONGER_PAIRED;
        this.events.closed(insole, connected.reason);
        throw new Error(NOT_PAIRED);
      });
    }
    [connected.reason, connected.links] = [OUT_OF_REACH, 0];
    // The battery service is optional. The link counts as open only after its operations, because the page then sends requests,
    // and Android rejects operations that overlap.
    await this.findBattery(insole, connected, server).catch(() => undefined);
    if (!server.connected) throw new DOMException("The link broke.", "NetworkError");
    connected.operating = Promise.resolve();
    connected.waiting = new Map();
    connected.control = control;
    connected.parameters = parameters;
    this.events.opened(insole);
  }

  /** Finds the characteristic with the charge of the battery, and reads it for the first time. */
  private async findBattery(insole: Insole, connected: Connected, server: BluetoothRemoteGATTServer): Promise<void> {
    connected.battery_requested_ms = performance.now();
    const service = await server.getPrimaryService("battery_service");
    connected.battery = await service.getCharacteristic("battery_level");
    await this.readBattery(insole, connected);
  }

  /** Reports the charge of the battery. An insole does not notify of its changes. */
  private async readBattery(insole: Insole, connected: Connected): Promise<void> {
    const value = await connected.battery?.readValue();
    if (value) this.events.battery(insole, value.getUint8(0));
  }

  send(insole: Insole, message: Uint8Array): void {
    const connected = this.insoles.get(insole);
    const kind = message[0] ?? -1;
    const isOfParameters = this.gatt.parameter_requests.includes(kind);
    const channel = isOfParameters ? connected?.parameters : connected?.control;
    if (!connected || !channel) return;
    // This needs no timer, because the page sends several requests per second to an insole that it uses.
    if (performance.now() - connected.battery_requested_ms >= BATTERY_MS) {
      connected.battery_requested_ms = performance.now();
      this.enqueue(connected, () => this.readBattery(insole, connected));
    }
    const { waiting } = connected;
    // A request replaces a waiting one of the same kind, so that few wait when a poor link recovers. A later request of a kind
    // makes the earlier one unnecessary: for example, an acknowledgement covers all earlier records.
    const is_queued = waiting.has(kind);
    waiting.set(kind, message);
    if (is_queued) return;
    this.enqueue(connected, async () => {
      const latest = waiting.get(kind)!;
      waiting.delete(kind);
      for (const value of fragments(latest, VALUE_BYTES)) await channel.writeValueWithResponse(value);
    });
  }

  /** Executes an operation on the characteristics of an insole after those before it. */
  private enqueue(connected: Connected, operation: () => Promise<void>): void {
    // An operation fails if the insole refuses it, or if the link breaks. In the second case, the handler of
    // `gattserverdisconnected` opens the link again.
    connected.operating = connected.operating.then(operation).catch(() => undefined);
  }

  close(): void {
    for (const [insole, connected] of this.insoles) this.remove(insole, connected);
  }
}

/** The name of an error of the browser; empty for other errors. */
const nameOf = (error: unknown) => (error instanceof DOMException ? error.name : "");

/** The message for the wearer after an error. */
export function explain(error: unknown): string {
  const name = nameOf(error);
  if (name === "SecurityError" || name === "NotAllowedError") {
    return "Bluetooth is not allowed for this page. Allow it in the browser's settings for this site, then try again.";
  }
  if (name === "NetworkError") {
    return "The insole did not answer. Move it closer, wake it by stepping on it, and try again. If that does not help, and " +
      "this phone was paired with it before, remove the insole in the phone's Bluetooth settings, switch it off for some " +
      "seconds, then on, and try again at once.";
  }
  return error instanceof Error ? error.message : "Bluetooth failed. Switch Bluetooth off and on, then try again.";
}
