import { afterEach, expect, test, vi } from "vitest";
import { BluetoothTransport, explain } from "../src/transport/bluetooth";
import type { TransportEvents } from "../src/transport/transport";
import { loadWire } from "./wire";

const { gatt } = (await loadWire()).facts;

afterEach(() => void vi.unstubAllGlobals());

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

test("a cancelled choice of an insole needs no message", async () => {
  expect(await explanation({ requestDevice: notFound, getAvailability: async () => true })).toBeUndefined();
});

test("a device without Bluetooth is reported, although the error is that of a cancelled choice", async () => {
  expect(await explanation({ requestDevice: notFound, getAvailability: async () => false })).toMatch(/Bluetooth is not available/);
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

test("an insole that refuses the pairing when the page connects again does not count as out of reach", async () => {
  vi.useFakeTimers();
  let is_paired = true;
  const { device, end } = insole(() => (is_paired ? Promise.resolve() : networkError()));
  vi.stubGlobal("navigator", { bluetooth: { requestDevice: async () => device } });
  const log: string[] = [];
  const logged = { ...events, opened: () => log.push("opened"), closed: (_: unknown, reason: string) => log.push(reason) };
  const transport = new BluetoothTransport(gatt, logged);
  await transport.connect(await transport.choose());
  is_paired = false;
  end();
  await vi.advanceTimersByTimeAsync(1000);
  // An insole also ends the link of a phone that is not paired.
  end();
  is_paired = true;
  await vi.advanceTimersByTimeAsync(1000);
  end();
  const refused = expect.stringMatching(/does not accept this phone any more/);
  const out_of_reach = "out of reach or switched off";
  expect(log).toEqual(["opened", out_of_reach, refused, refused, "opened", out_of_reach]);
  transport.close();
  vi.useRealTimers();
});

test("a device without a link is reported with the remedy, and so is an error without a message", async () => {
  const device = { id: "1", addEventListener: ignore };
  expect(await explanation({ requestDevice: async () => device })).toMatch(/Close other programs/);
  expect(explain({})).toMatch(/Switch Bluetooth off and on/);
});
