/** Insoles over Web Bluetooth, no server needed. */

import { Fragments, fragments } from "./fragments";
import { INSOLES, type Insole, type Transport, type TransportEvents } from "./transport";
import { BATTERY_LEVEL, BATTERY_SERVICE, CONTROL, LIVE, SERVICE, STEPS } from "./uuids";

/** What every Bluetooth connection carries in one value, bytes. */
const LEAST_VALUE = 20;
const RETRY_MS = 2000;

interface Connected {
  device: BluetoothDevice;
  control?: BluetoothRemoteGATTCharacteristic | undefined;
  /** Writes go one after the other. */
  writing: Promise<void>;
}

export class BluetoothTransport implements Transport {
  readonly name = "Bluetooth";
  readonly is_replay = false;
  private readonly insoles = new Map<Insole, Connected>();
  private closed = false;

  constructor(private readonly events: TransportEvents) {}

  static isSupported(): boolean {
    return "bluetooth" in navigator;
  }

  /** Lets the user choose an insole; must be called from a click. */
  async add(): Promise<void> {
    const insole = INSOLES.find((index) => !this.insoles.has(index));
    if (insole === undefined) throw new Error("Both insoles are connected.");
    const device = await navigator.bluetooth.requestDevice({
      filters: [{ services: [SERVICE] }],
      optionalServices: [BATTERY_SERVICE],
    });
    if ([...this.insoles.values()].some((known) => known.device.id === device.id)) {
      throw new Error("This insole is connected already.");
    }
    const connected: Connected = { device, writing: Promise.resolve() };
    this.insoles.set(insole, connected);
    device.addEventListener("gattserverdisconnected", () => {
      connected.control = undefined;
      if (!this.isIn(insole, connected)) return;
      this.events.closed(insole, "out of reach or switched off");
      this.reconnect(insole, connected);
    });
    try {
      await this.open(insole, connected);
    } catch (error) {
      this.insoles.delete(insole);
      // Otherwise nobody else could connect it.
      device.gatt?.disconnect();
      throw error;
    }
  }

  /** False for an insole that was given up. */
  private isIn(insole: Insole, connected: Connected): boolean {
    return !this.closed && this.insoles.get(insole) === connected;
  }

  private reconnect(insole: Insole, connected: Connected): void {
    setTimeout(() => {
      if (!this.isIn(insole, connected)) return;
      this.open(insole, connected).catch(() => this.reconnect(insole, connected));
    }, RETRY_MS);
  }

  private async open(insole: Insole, connected: Connected): Promise<void> {
    const server = await connected.device.gatt?.connect();
    if (!server) throw new Error("The insole refuses the connection.");
    const service = await server.getPrimaryService(SERVICE);
    const control = await service.getCharacteristic(CONTROL);
    for (const characteristic of [control, await service.getCharacteristic(LIVE), await service.getCharacteristic(STEPS)]) {
      const whole = new Fragments(() => this.events.damaged(insole));
      characteristic.oncharacteristicvaluechanged = () => {
        const value = characteristic.value;
        const message = value && whole.push(new Uint8Array(value.buffer, value.byteOffset, value.byteLength));
        if (message) this.events.message(insole, message);
      };
      await characteristic.startNotifications();
    }
    connected.control = control;
    this.events.opened(insole);
    // An insole without a battery service is as good.
    await this.followBattery(insole, server).catch(() => undefined);
  }

  private async followBattery(insole: Insole, server: BluetoothRemoteGATTServer): Promise<void> {
    const service = await server.getPrimaryService(BATTERY_SERVICE);
    const level = await service.getCharacteristic(BATTERY_LEVEL);
    const report = (value: DataView | undefined) => value && this.events.battery(insole, value.getUint8(0));
    report(await level.readValue());
    level.oncharacteristicvaluechanged = () => report(level.value);
    await level.startNotifications();
  }

  send(insole: Insole, message: Uint8Array): void {
    const connected = this.insoles.get(insole);
    const control = connected?.control;
    if (!connected || !control) return;
    const write = async () => {
      for (const value of fragments(message, LEAST_VALUE)) await control.writeValueWithResponse(value);
    };
    // A write that fails is a link that breaks, which is noticed elsewhere.
    connected.writing = connected.writing.then(write).catch(() => undefined);
  }

  close(): void {
    this.closed = true;
    for (const { device } of this.insoles.values()) device.gatt?.disconnect();
  }
}

/** What went wrong, for people; `undefined` where the user chose nothing. */
export function explain(error: unknown): string | undefined {
  const name = error instanceof DOMException ? error.name : "";
  if (name === "NotFoundError") return undefined;
  if (name === "SecurityError" || name === "NotAllowedError") {
    return "Bluetooth is not allowed for this page. Allow it in the browser's settings for this site, then try again.";
  }
  if (name === "NetworkError") return "The insole did not answer. Move it closer, wake it by stepping on it, and try again.";
  return error instanceof Error ? error.message : "Bluetooth failed.";
}
