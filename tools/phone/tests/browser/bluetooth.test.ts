/**
 * Web Bluetooth with an insole that Chromium emulates: the page lets the wearer choose it, connects it, subscribes to its
 * characteristics, and sends a connect request. The emulation cannot send notifications, so the receipt of messages is tested
 * with the other transports.
 */

import type { CDPSession } from "playwright-core";
import { beforeAll, expect, test } from "vitest";
import type { Wire } from "../../src/wire";
import { loadWire } from "../wire";
import { PHONE, open, servedBrowser } from "./browser";

const ADDRESS = "09:09:09:09:09:09";

/** A session of the Chrome DevTools protocol, with methods and events for which Playwright has no types. */
interface Session {
  send(method: string, parameters?: object): Promise<Record<string, string>>;
  on(event: string, handler: (event: Record<string, string>) => void): void;
}
const untyped = (session: CDPSession) => session as unknown as Session;

const served = servedBrowser();
let wire: Wire;
beforeAll(async () => {
  wire = await loadWire();
});

/** Emulates an insole that accepts all operations. `operations` lists the operations on its characteristics in their order. */
async function emulateInsole(): Promise<{ operations: string[]; disconnect(): Promise<void> }> {
  const session = untyped(await served.browser.newBrowserCDPSession());
  const { gatt } = wire.facts;
  const names = new Map<string, string>();
  const operations: string[] = [];
  const add = async () => {
    const { serviceId } = await session.send("BluetoothEmulation.addService", { address: ADDRESS, serviceUuid: gatt.service });
    for (const [name, characteristicUuid, properties] of [
      ["control", gatt.control, { write: true, indicate: true }],
      ["live", gatt.live, { notify: true }],
      ["steps", gatt.steps, { notify: true }],
      ["parameters", gatt.parameters, { write: true, indicate: true }],
    ] as const) {
      const characteristic = { serviceId, characteristicUuid, properties };
      const { characteristicId } = await session.send("BluetoothEmulation.addCharacteristic", characteristic);
      // The Client Characteristic Configuration descriptor: the browser subscribes by writing to it.
      const descriptorUuid = "00002902-0000-1000-8000-00805f9b34fb";
      await session.send("BluetoothEmulation.addDescriptor", { characteristicId, descriptorUuid });
      names.set(characteristicId ?? "", name);
    }
  };
  session.on("BluetoothEmulation.gattOperationReceived", ({ address, type }) => {
    // The emulation removes the services when the connection ends, so they are added again for each discovery.
    const ready = type === "discovery" ? add() : Promise.resolve();
    void ready.then(() => session.send("BluetoothEmulation.simulateGATTOperationResponse", { address, type, code: 0 }));
  });
  session.on("BluetoothEmulation.characteristicOperationReceived", ({ characteristicId, type, data }) => {
    const bytes = data ? ` ${Buffer.from(data, "base64").toString("hex")}` : "";
    operations.push(`${names.get(characteristicId ?? "")} ${type}${bytes}`);
    void session.send("BluetoothEmulation.simulateCharacteristicOperationResponse", { characteristicId, type, code: 0 });
  });
  await session.send("BluetoothEmulation.enable", { state: "powered-on", leSupported: true });
  const peripheral = { address: ADDRESS, name: "Plantar", manufacturerData: [], knownServiceUuids: [gatt.service] };
  await session.send("BluetoothEmulation.simulatePreconnectedPeripheral", peripheral);
  const disconnect = () => session.send("BluetoothEmulation.simulateGATTDisconnection", { address: ADDRESS }).then(() => undefined);
  return { operations, disconnect };
}

test("the page subscribes to the chosen insole and sends a connect request, also after the link was lost", async () => {
  const insole = await emulateInsole();
  const page = await open(served.browser, `${served.url}?bluetooth`, { viewport: PHONE });
  const chooser = untyped(await page.context().newCDPSession(page));
  let is_chosen = false;
  chooser.on("DeviceAccess.deviceRequestPrompted", (event) => {
    const { id, devices } = event as unknown as { id: string; devices: { id: string }[] };
    const [device] = devices;
    if (!device || is_chosen) return;
    // The event occurs again whenever the list of devices grows.
    is_chosen = true;
    void chooser.send("DeviceAccess.selectPrompt", { id, deviceId: device.id });
  });
  await chooser.send("DeviceAccess.enable");
  await page.locator("#connect").click();

  // The first byte is the header of a message in a single fragment.
  const request = Buffer.from([0x80, ...wire.connect()]).toString("hex");
  // The emulation reports a subscription to indications, as of control and parameters, by the same name.
  const expected = [
    "control subscribe-to-notifications",
    "live subscribe-to-notifications",
    "steps subscribe-to-notifications",
    "parameters subscribe-to-notifications",
    `control write ${request}`,
  ];
  await expect.poll(() => insole.operations.slice(0, 5)).toEqual(expected);
  await page.getByText("Waiting for an insole over Bluetooth.").waitFor();
  await page.locator("#connect-other").waitFor();

  insole.operations.length = 0;
  await insole.disconnect();
  await expect.poll(() => insole.operations.slice(0, 5)).toEqual(expected);
  await page.close();
}, 60_000);
