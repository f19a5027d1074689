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
