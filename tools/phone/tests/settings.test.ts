import { expect, test } from "vitest";
import { loadSettings, saveSettings } from "../src/settings";

/** As in a browser in which the wearer has blocked the data of sites. */
const blocked = (): Storage => {
  throw new DOMException("The operation is insecure.", "SecurityError");
};

test("the settings have their defaults, and can be changed, if the browser stores nothing", () => {
  const settings = loadSettings(blocked);
  expect(settings.shoe_size).toBe(42);
  expect(() => saveSettings(blocked, { ...settings, shoe_size: 40 })).not.toThrow();
});

test("the settings are those that were stored", () => {
  const stored = new Map<string, string>();
  const storage = () =>
    ({ getItem: (key: string) => stored.get(key) ?? null, setItem: stored.set.bind(stored) }) as unknown as Storage;
  const settings = { ...loadSettings(storage), body_mass_kg: 70.5, alert_vibration: false };
  saveSettings(storage, settings);
  expect(loadSettings(storage)).toEqual(settings);
});
