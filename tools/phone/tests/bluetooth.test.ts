import { afterEach, expect, test, vi } from "vitest";
import type { Facts } from "../src/generated/messages";
import type { Insoles } from "../src/insoles";
import { remarks } from "../src/notes";
import { BluetoothTransport, explain } from "../src/transport/bluetooth";
import type { TransportEvents } from "../src/transport/transport";
import { loadWire } from "./wire";

const wire = await loadWire();
const { gatt } = wire.facts;

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

const notFound = () => Promise.reject(new DOMException("", "NotFoundError"));
const ignore = () => undefined;
const events: TransportEvents = { opened: ignore, message: ignore, closed: ignore, damaged: ignore, battery: ignore };

/** The message for the wearer after an attempt to connect an insole with this browser's Bluetooth. */
async function explanation(bluetooth: object): Promise<string | undefined> {
  vi.stubGlobal("navigator", { bluetooth });
  const transport = new BluetoothTransport(gatt, events);
  const connect = transport.choose().then((device) => transport.connect(device));
  return explain(await connect.catch((error: unknown) => error));
}

test("if no insole was chosen, the permission that Android may have refused is named: the error is the same", async () => {
  const expected = /No insole was chosen. If no list appeared, allow Bluetooth \("Nearby devices",.* in the phone's settings/;
  for (const getAvailability of [async () => true, undefined]) {
    expect(await explanation({ requestDevice: notFound, getAvailability })).toMatch(expected);
  }
});

test("Bluetooth that is missing, off or blocked is reported, although the error is that of a cancelled choice", async () => {
  const expected = /Bluetooth is off, or not allowed for this page/;
  expect(await explanation({ requestDevice: notFound, getAvailability: async () => false })).toMatch(expected);
});

test("a page that must not use Bluetooth is reported", async () => {
  const requestDevice = () => Promise.reject(new DOMException("", "SecurityError"));
  expect(await explanation({ requestDevice, getAvailability: async () => true })).toMatch(/Bluetooth is not allowed/);
});

test("an insole without the services of the page is reported, although the error is that of a cancelled choice", async () => {
  const disconnect = vi.fn();
  const server = { connect: async () => ({ getPrimaryService: notFound }), disconnect };
  const device = { id: "1", gatt: server, addEventListener: ignore };
  expect(await explanation({ requestDevice: async () => device })).toMatch(/does not offer what this page needs/);
  expect(disconnect).toHaveBeenCalledOnce();
});

/** An insole whose characteristics let the page subscribe by `subscribe`. `gatt` is its link. */
function insole(subscribe: () => Promise<void>) {
  const device = Object.assign(new EventTarget(), { id: "1" });
  const characteristic = { startNotifications: subscribe, writeValueWithResponse: async () => undefined };
  const service = { getCharacteristic: async () => characteristic };
  const gatt = { connected: false, connect: async () => Object.assign(gatt, { connected: true }), disconnect: ignore,
    getPrimaryService: async (uuid: string) => (uuid === "battery_service" ? notFound() : service) };
  const end = () => {
    gatt.connected = false;
    device.dispatchEvent(new Event("gattserverdisconnected"));
  };
  return { device: Object.assign(device, { gatt }), gatt, end };
}

/** The error of Chromium if the insole requires a pairing; it is the same if the link breaks. */
const networkError = () => Promise.reject(new DOMException("", "NetworkError"));

test("an insole that refuses the pairing is reported with the remedy", async () => {
  const { device } = insole(networkError);
  const text = await explanation({ requestDevice: async () => device });
  expect(text).toMatch(/did not accept this phone.*within a minute after it is switched on.*remove the insole/);
});

test("a link that breaks during the subscription is no refused pairing", async () => {
  const broken = insole(() => {
    broken.gatt.connected = false;
    return networkError();
  });
  expect(await explanation({ requestDevice: async () => broken.device })).toMatch(/did not answer. Move it closer/);
});

/** Connects an insole. `log` lists the links of the page: "opened", or the reason why a link was lost. */
async function connectLogged(device: object) {
  const log: string[] = [];
  const logged = { ...events, opened: () => log.push("opened"), closed: (_: unknown, reason: string) => log.push(reason) };
  const transport = new BluetoothTransport(gatt, logged);
  await transport.connect(device as BluetoothDevice);
  return { transport, log };
}
const out_of_reach = "out of reach or switched off";

test("an insole that refuses the pairing when the page connects again does not count as out of reach", async () => {
  vi.useFakeTimers();
  let is_paired = true;
  const { device, end } = insole(() => (is_paired ? Promise.resolve() : networkError()));
  const { transport, log } = await connectLogged(device);
  is_paired = false;
  end();
  await vi.advanceTimersByTimeAsync(1000);
  // An insole also ends the link of a phone that is not paired.
  end();
  is_paired = true;
  await vi.advanceTimersByTimeAsync(1000);
  end();
  const refused = expect.stringMatching(/does not accept this phone any more/);
  expect(log).toEqual(["opened", out_of_reach, refused, refused, "opened", out_of_reach]);
  transport.close();
});

test("an insole that ends each new link, as one that has lost the bond, is reported with the remedy", async () => {
  vi.useFakeTimers();
  let has_bond = true;
  const lost = insole(() => {
    if (has_bond) return Promise.resolve();
    lost.end();
    return networkError();
  });
  const { transport, log } = await connectLogged(lost.device);
  has_bond = false;
  lost.end();
  // One attempt to connect per second. A single broken link has another cause more often.
  await vi.advanceTimersByTimeAsync(3000);
  has_bond = true;
  await vi.advanceTimersByTimeAsync(1000);
  lost.end();
  const breaks = expect.stringMatching(/breaks at once.*remove the insole/);
  expect(log).toEqual(["opened", out_of_reach, out_of_reach, breaks, breaks, "opened", out_of_reach]);
  transport.close();
});

test("a device without a link is reported with the remedy, and so is an error without a message", async () => {
  const device = { id: "1", addEventListener: ignore };
  expect(await explanation({ requestDevice: async () => device })).toMatch(/Close other programs/);
  expect(explain({})).toMatch(/Switch Bluetooth off and on/);
});

/** A time after which all operations that are due have ended, ms. */
const LONG_MS = 1000;

/**
 * An insole that is connected, and measures its battery. As on Android, an operation takes some time, and fails while another
 * one is in progress. `writes` lists the requests that were written; `control.hold` delays the operations until it
 * resolves, and `control.percent` is the charge of the battery. The insole refuses to notify of it, as insoles do.
 * `opened` is called when the page reports the link as open, with the number of reports of the battery so far.
 */
async function connectBusy(opened: (transport: BluetoothTransport, reports: number) => void = ignore) {
  const writes: Uint8Array[] = [];
  const control = { hold: Promise.resolve(), percent: 70 };
  let is_busy = false;
  const operate = async <T>(result: T): Promise<T> => {
    if (is_busy) await networkError();
    is_busy = true;
    await new Promise((resolve) => setTimeout(resolve, 10));
    await control.hold;
    is_busy = false;
    return result;
  };
  const characteristic = {
    startNotifications: () => operate(undefined),
    readValue: () => operate(new DataView(Uint8Array.of(control.percent).buffer)),
    // The byte before the message is the header of its only fragment.
    writeValueWithResponse: (value: Uint8Array) => operate(undefined).then(() => writes.push(value.slice(1))),
  };
  const readable = { ...characteristic, startNotifications: () => Promise.reject(new DOMException("", "NotSupportedError")) };
  const service = {
    getCharacteristic: (uuid: string) => operate(uuid === "battery_level" ? readable : { ...characteristic }),
  };
  const server = { connected: true, connect: async () => server, disconnect: ignore, getPrimaryService: () => operate(service) };
  const device = Object.assign(new EventTarget(), { id: "1", gatt: server }) as unknown as BluetoothDevice;
  const battery = vi.fn();
  const reportOpened = () => opened(transport, battery.mock.calls.length);
  const transport: BluetoothTransport = new BluetoothTransport(gatt, { ...events, battery, opened: reportOpened });
  const connected = transport.connect(device);
  await vi.advanceTimersByTimeAsync(LONG_MS);
  await connected;
  return { transport, writes, control, battery };
}

test("the battery and the requests are not accessed at the same time, because one of both would fail on Android", async () => {
  vi.useFakeTimers();
  const requests = [wire.connect(), wire.getStatus()];
  let reports_before = 0;
  const { writes, battery, transport } = await connectBusy((opened, reports) => {
    reports_before = reports;
    requests.forEach((request) => opened.send(0, request));
  });
  expect([battery.mock.calls, reports_before]).toEqual([[[0, 70]], 1]);
  expect(writes).toEqual(requests);
  transport.close();
});

test("the battery is read every minute between the requests, because an insole does not notify of its charge", async () => {
  vi.useFakeTimers();
  const { transport, writes, control, battery } = await connectBusy();
  control.percent = 9;
  const requests = Array.from({ length: 9 }, (_, i) => wire.getTime(i));
  for (const request of requests) {
    transport.send(0, request);
    await vi.advanceTimersByTimeAsync(10_000);
  }
  // The first reading was that of the connection.
  expect(battery.mock.calls).toEqual([[0, 70], [0, 9]]);
  expect(writes).toEqual(requests);
  transport.close();
});

test("a link that breaks while the battery is read does not count as open", async () => {
  const { device, gatt: link, end } = insole(() => Promise.resolve());
  const { getPrimaryService } = link;
  link.getPrimaryService = (uuid) => {
    if (uuid === "battery_service") end();
    return getPrimaryService(uuid);
  };
  const opened = vi.fn();
  const transport = new BluetoothTransport(gatt, { ...events, opened });
  const error = await transport.connect(device as unknown as BluetoothDevice).catch((error: unknown) => error);
  expect(explain(error)).toMatch(/did not answer. Move it closer/);
  expect(opened).not.toHaveBeenCalled();
});

test("requests of one kind do not pile up while a write is not answered", async () => {
  vi.useFakeTimers();
  const { transport, writes, control } = await connectBusy();
  let release = ignore as () => void;
  control.hold = new Promise((resolve) => (release = resolve));
  for (let i = 0; i < 10; i++) [wire.getTime(i), wire.connect()].forEach((request) => transport.send(0, request));
  await vi.advanceTimersByTimeAsync(LONG_MS);
  transport.send(0, wire.getTime(10));
  release();
  await vi.advanceTimersByTimeAsync(LONG_MS);
  // Of the requests that waited, the newest one of each kind was written.
  expect(writes).toEqual([wire.getTime(9), wire.connect(), wire.getTime(10)]);
  transport.close();
});

test("the page does not wait for an insole of which the first connection failed", async () => {
  const transport = new BluetoothTransport(gatt, events);
  const text = () => {
    const sessions = [{ state: "closed", records_waiting: 0 }];
    return JSON.stringify(remarks({ transport, sessions, of: ignore } as unknown as Insoles, undefined, {} as Facts));
  };
  const connected = transport.connect(insole(networkError).device as unknown as BluetoothDevice);
  expect(text()).toContain("Waiting for an insole over Bluetooth");
  await expect(connected).rejects.toThrow(/did not accept this phone/);
  expect(text()).toBe("[]");
});
