/** The wearer's settings, stored by the browser. */

import { store, stored } from "./browser_storage";

/** The key under which the browser stores the settings. */
const KEY = "plantar.settings";
const GRAVITY_M_S2 = 9.80665;
export const KG_PER_LB = 0.45359237;

/** The settings that the wearer can change. */
export interface Settings {
  /** `null` if the wearer has not stated it. */
  body_mass_kg: number | null;
  mass_unit: "kg" | "lb";
  force_unit: "N" | "%BW";
  /** European shoe size, a whole number. */
  shoe_size: number;
  /** Whether an alert sounds. */
  alert_sound: boolean;
  /** Whether an alert lets the phone vibrate. */
  alert_vibration: boolean;
  /** Whether the screen stays on while alerts are on. */
  alert_screen: boolean;
  /** Mean length of a stride, cm; `null` if the wearer has not stated it. */
  stride_cm: number | null;
}

const DEFAULTS: Settings = {
  body_mass_kg: null,
  mass_unit: "kg",
  force_unit: "N",
  shoe_size: 42,
  alert_sound: true,
  alert_vibration: true,
  alert_screen: false,
  stride_cm: null,
};

/** The smallest and the largest value that the wearer can state; those of the mass are also the ones of the command line. */
export const LIMITS = {
  body_mass_kg: { min: 10, max: 300 },
  stride_cm: { min: 10, max: 600 },
} as const;

/** The smallest and the largest shoe size, as of the command line. */
export const SHOE_SIZES = { min: 20, max: 52 } as const;

/** True if the wearer can state this value. False for NaN. */
export const isWithinLimits = (key: keyof typeof LIMITS, value: number) => value >= LIMITS[key].min && value <= LIMITS[key].max;

/**
 * The stored settings. Missing or invalid settings have their defaults, but a shoe size that is out of range becomes the nearest
 * one within the range. `storage` may throw, as `localStorage` does if the browser stores nothing for this site.
 */
export function loadSettings(storage: () => Storage): Settings {
  try {
    const saved = JSON.parse(stored(storage, KEY) ?? "{}") as Partial<Record<keyof Settings, unknown>>;
    const stated = (key: keyof typeof LIMITS) => {
      const value = saved[key];
      return typeof value === "number" && isWithinLimits(key, value) ? value : DEFAULTS[key];
    };
    /** The stored value if it is one of `values`, otherwise the default. */
    const oneOf = <Key extends keyof Settings>(key: Key, ...values: Settings[Key][]): Settings[Key] =>
      values.find((value) => value === saved[key]) ?? DEFAULTS[key];
    const { shoe_size } = saved;
    return {
      body_mass_kg: stated("body_mass_kg"),
      mass_unit: oneOf("mass_unit", "kg", "lb"),
      force_unit: oneOf("force_unit", "N", "%BW"),
      shoe_size: Number.isInteger(shoe_size)
        ? Math.min(SHOE_SIZES.max, Math.max(SHOE_SIZES.min, shoe_size as number)) : DEFAULTS.shoe_size,
      alert_sound: oneOf("alert_sound", false, true),
      alert_vibration: oneOf("alert_vibration", false, true),
      alert_screen: oneOf("alert_screen", false, true),
      stride_cm: stated("stride_cm"),
    };
  } catch {
    return { ...DEFAULTS };
  }
}

/** Stores the settings. If the browser does not allow it, they apply until the page is closed. */
export const saveSettings = (storage: () => Storage, settings: Settings) => store(storage, KEY, JSON.stringify(settings));

/** Body weight; `null` without a body mass. */
export const weight_n = ({ body_mass_kg }: Settings) => (body_mass_kg === null ? null : body_mass_kg * GRAVITY_M_S2);

/** A force in % of body weight; `null` without a body mass. */
export function percentOfWeight(force_n: number, settings: Settings): number | null {
  const weight = weight_n(settings);
  return weight === null ? null : (100 * force_n) / weight;
}

/** Adopts the settings that the wearer changes in another tab, and calls `changed`. */
export function followSettings(settings: Settings, changed: () => void): void {
  addEventListener("storage", ({ key }) => {
    if (key !== KEY) return;
    Object.assign(settings, loadSettings(() => localStorage));
    changed();
  });
}
