/** The wearer's settings, stored by the browser. */

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
  /** European shoe size, 35 to 46. */
  shoe_size: number;
  /** Whether an alert sounds. */
  alert_sound: boolean;
  /** Whether an alert lets the phone vibrate. */
  alert_vibration: boolean;
  /** Mean length of a stride, cm; `null` if the wearer has not stated it. */
  stride_cm: number | null;
}

const DEFAULTS: Settings = {
  body_mass_kg: null,
  mass_unit: "kg",
  force_unit: "N",
  shoe_size: 42,
  alert_sound: false,
  alert_vibration: true,
  stride_cm: null,
};

/**
 * The stored settings. Missing or invalid settings have their defaults. `storage` may throw, as `localStorage` does if the
 * browser stores nothing for this site.
 */
export function loadSettings(storage: () => Storage): Settings {
  try {
    const positive = (value: unknown) => (typeof value === "number" && value > 0 ? value : null);
    const saved = JSON.parse(storage().getItem(KEY) ?? "{}") as Partial<Settings>;
    return {
      body_mass_kg: positive(saved.body_mass_kg),
      mass_unit: saved.mass_unit === "lb" ? "lb" : "kg",
      force_unit: saved.force_unit === "%BW" ? "%BW" : "N",
      shoe_size: Number.isInteger(saved.shoe_size) ? Math.min(46, Math.max(35, saved.shoe_size ?? 42)) : 42,
      alert_sound: saved.alert_sound === true,
      alert_vibration: saved.alert_vibration !== false,
      stride_cm: positive(saved.stride_cm),
    };
  } catch {
    return { ...DEFAULTS };
  }
}

/** Stores the settings. If the browser does not allow it, they apply until the page is closed. */
export function saveSettings(storage: () => Storage, settings: Settings): void {
  try {
    storage().setItem(KEY, JSON.stringify(settings));
  } catch {
    // The settings are in force nevertheless.
  }
}

/** Body weight; `null` without a body mass. */
export const weight_n = ({ body_mass_kg }: Settings) => (body_mass_kg === null ? null : body_mass_kg * GRAVITY_M_S2);

/** A force in % of body weight; `null` without a body mass. */
export function percentOfWeight(force_n: number, settings: Settings): number | null {
  const weight = weight_n(settings);
  return weight === null ? null : (100 * force_n) / weight;
}
