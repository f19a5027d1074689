/** Web Bluetooth against an insole that Chromium's own emulation plays: choose, connect, subscribe, say hello.
 *
 * The emulation cannot push notifications, so the stream itself is tested over the other transports. */

import type { Browser, CDPSession } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { CONTROL, LIVE, SERVICE, STEPS } from "../../src/transport/uuids";
import { loadWire } from "../wire";
import { launch, open, serveFiles } from "./browser";

const ADDRESS = "09:09:09:09:09:09";

/** The domains that Playwright has no types for. */
interface Session {
  send(method: string, parameters?: object): Promise<Record<string, string>>;
  on(event: string, handler: (event: Record<string, string>) => void): void;
}
const untyped = (session: CDPSession) => session as unknown as Session;

let browser: Browser;
let files: Awaited<ReturnType<typeof serveFiles>>;
beforeAll(async () => {
  browser = await launch();
  files = await serveFiles();
});
afterAll(async () => {
  await browser.close();
  files.close();
});

/** An insole that accepts everything; what is done to its characteristics, in order. */
async function emulateInsole(): Promise<{ done: string[]; disconnect(): Promise<void> }> {
  const session = untyped(await browser.newBrowserCDPSession());
  const names = new Map<string, string>();
  const done: string[] = [];
  const add = async () => {
    const { serviceId } = await session.send("BluetoothEmulation.addService", { address: ADDRESS, serviceUuid: SERVICE });
    for (const [name, characteristicUuid, properties] of [
      ["control", CONTROL, { write: true, indicate: true }],
      ["live", LIVE, { notify: true }],
      ["steps", STEPS, { notify: true }],
    ] as const) {
      const { characteristicId } = await session.send("BluetoothEmulation.addCharacteristic", { serviceId, characteristicUuid, properties });
      // Where subscriptions are written.
      const descriptorUuid = "00002902-0000-1000-8000-00805f9b34fb";
      await session.send("BluetoothEmulation.addDescriptor", { characteristicId, descriptorUuid });
      names.set(characteristicId ?? "", name);
    }
  };
  session.on("BluetoothEmulation.gattOperationReceived", ({ address, type }) => {
    // The emulation forgets services with the connection.
    const ready = type === "discovery" ? add() : Promise.resolve();
    void ready.then(() => session.send("BluetoothEmulation.simulateGATTOperationResponse", { address, type, code: 0 }));
  });
  session.on("BluetoothEmulation.characteristicOperationReceived", ({ characteristicId, type, data }) => {
    const bytes = data ? ` ${Buffer.from(data, "base64").toString("hex")}` : "";
    done.push(`${names.get(characteristicId ?? "")} ${type}${bytes}`);
    void session.send("BluetoothEmulation.simulateCharacteristicOperationResponse", { characteristicId, type, code: 0 });
  });
  await session.send("BluetoothEmulation.enable", { state: "powered-on", leSupported: true });
  const peripheral = { address: ADDRESS, name: "Plantar", manufacturerData: [], knownServiceUuids: [SERVICE] };
  await session.send("BluetoothEmulation.simulatePreconnectedPeripheral", peripheral);
  const disconnect = () => session.send("BluetoothEmulation.simulateGATTDisconnection", { address: ADDRESS }).then(() => undefined);
  return { done, disconnect };
}

test("an insole is chosen, connected, subscribed to and greeted, and greeted again after a lost link", async () => {
  const insole = await emulateInsole();
  const page = await open(browser, `${files.url}?bluetooth`, { viewport: { width: 390, height: 844 } });
  const chooser = untyped(await page.context().newCDPSession(page));
  let is_chosen = false;
  chooser.on("DeviceAccess.deviceRequestPrompted", (event) => {
    const { id, devices } = event as unknown as { id: string; devices: { id: string }[] };
    const [device] = devices;
    if (!device || is_chosen) return;
    // The list is told again as it grows.
    is_chosen = true;
    void chooser.send("DeviceAccess.selectPrompt", { id, deviceId: device.id });
  });
  await chooser.send("DeviceAccess.enable");
  await page.locator("#connect").click();

  const hello = Buffer.from([0x80, ...(await loadWire()).connect()]).toString("hex");
  const greeting = [
    "control subscribe-to-notifications",
    "live subscribe-to-notifications",
    "steps subscribe-to-notifications",
    `control write ${hello}`,
  ];
  await expect.poll(() => insole.done.slice(0, 4), { timeout: 20_000 }).toEqual(greeting);
  await page.getByText("Waiting for an insole from Bluetooth.").waitFor();

  insole.done.length = 0;
  await insole.disconnect();
  await expect.poll(() => insole.done.slice(0, 4), { timeout: 20_000 }).toEqual(greeting);
  await page.close();
}, 60_000);
