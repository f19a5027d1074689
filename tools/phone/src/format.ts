/** Numbers and names for people. */

import { type Settings, percentOfWeight } from "./settings";
import type { LiveRegion } from "./wire";

const TITLES: Record<string, string> = {
  heel: "Heel",
  posterior_midfoot: "Rear midfoot",
  anterior_midfoot: "Front midfoot",
  metatarsals_12: "Ball, inner",
  metatarsals_35: "Ball, outer",
  hallux: "Big toe",
  toe_2: "Second toe",
  toes_35: "Small toes",
};

export const regionTitle = (name: string) => TITLES[name] ?? name;

/** Flags of a region and what they mean. */
export const FLAGS: readonly ["saturated" | "clamped", string][] = [
  ["saturated", "the sensor is at its end, the force is at least what is shown."],
  ["clamped", "more contact than the model knows, its values are at least what is shown."],
] satisfies [keyof LiveRegion, string][];

/** The unit in which forces are shown. */
export const unitOf = (settings: Settings) => (settings.force_unit === "%BW" && settings.body_mass_kg !== null ? "%BW" : "N");

/** A force in the chosen unit, and in the other one where it is known. */
export function forceText(force_n: number, settings: Settings, space = " "): [string, string] {
  const newtons = space === "" ? force_n.toFixed(0) : `${force_n.toFixed(0)}${space}N`;
  const share = percentOfWeight(force_n, settings);
  if (share === null) return [newtons, ""];
  const percent = space === "" ? share.toFixed(0) : `${share.toFixed(0)}${space}%BW`;
  return unitOf(settings) === "%BW" ? [percent, newtons] : [newtons, percent];
}

/** A number, or a dash where there is none. */
export const numberText = (value: number | null, digits: number, unit = "") =>
  value === null ? "–" : `${value.toFixed(digits)}${unit && " "}${unit}`;
