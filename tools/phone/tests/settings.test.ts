import { expect, test } from "vitest";
import { type Settings, loadSettings, saveSettings } from "../src/settings";

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
  const settings: Settings = {
    body_mass_kg: 70.5,
    mass_unit: "lb",
    force_unit: "%BW",
    shoe_size: 39,
    alert_sound: true,
    alert_vibration: false,
    alert_screen: true,
    stride_cm: 150,
  };
  saveSettings(storage, settings);
  expect(loadSettings(storage)).toEqual(settings);
});

test("the shoe sizes of children and of large feet remain as they are", () => {
  for (const [stored, expected] of [[20, 20], [28, 28], [50, 50], [52, 52], [19, 20], [53, 52], [41.5, 42]]) {
    const storage = () => ({ getItem: () => JSON.stringify({ shoe_size: stored }) }) as unknown as Storage;
    expect(loadSettings(storage).shoe_size).toBe(expected);
  }
});

test("invalid stored settings have their defaults", () => {
  const invalid = { mass_unit: "stone", force_unit: 1, shoe_size: "42", alert_sound: "yes", alert_vibration: null, alert_screen: 1 };
  for (const [body_mass_kg, stride_cm] of [[9.9, 9], [301, 601], [-70, -150], ["70", null]]) {
    const storage = () => ({ getItem: () => JSON.stringify({ ...invalid, body_mass_kg, stride_cm }) }) as unknown as Storage;
    expect(loadSettings(storage)).toEqual(loadSettings(blocked));
  }
});
