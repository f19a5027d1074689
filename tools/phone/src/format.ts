/** Numbers and names as the wearer reads them. */

import type { LiveRegion } from "./generated/quantities";
import { type Settings, percentOfWeight } from "./settings";

/** The titles of the regions by their names in messages. */
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

/** The quantities that the table of regions can show. */
export const QUANTITIES = ["measured", "model", "deformation", "area"] as const;
export type Quantity = (typeof QUANTITIES)[number];

/**
 * A quantity of a region with its unit, and with one of the marks that the live view explains (▲, ~, △) if it applies. `null`
 * if the quantity requires the wearer's parameters and the insole has none.
 */
export function quantityText(region: LiveRegion, quantity: Quantity, has_parameters: boolean, settings: Settings): string | null {
  const needs_parameters = quantity === "model" || quantity === "deformation";
  if (needs_parameters && !has_parameters) return null;
  const text = {
    measured: () => forceText(region.measured_n, settings)[0],
    model: () => forceText(region.model_n, settings)[0],
    deformation: () => `${region.deformation_mm.toFixed(1)} mm`,
    area: () => `${(region.area_mm2 / 100).toFixed(1)} cm²`,
  }[quantity]();
  const is_clamped = needs_parameters && region.clamped;
  return region.saturated ? `${text} ▲` : region.masked ? `${text} ~` : is_clamped ? `${text} △` : text;
}

/**
 * A note for the wearer on a quantity; empty if none is needed. An insole does not know whether the scale of its deformation
 * was measured.
 */
export function quantityNote(quantity: Quantity, has_effective_areas: boolean): string {
  switch (quantity) {
    case "measured":
      return "The sum of the sensors. Load beside the sensors, and shear, are not part of it.";
    case "deformation":
      return (
        "Share of assumption: 100 %. The scale of the deformation follows from a typical thickness of the tissue and an assumed " +
        "compression; the share is less if they were measured for your parameters."
      );
    case "area":
      return has_effective_areas
        ? "Each cell counts with the share of its area that the foot covers, estimated from its pressure. So the sum depends on " +
          "pressure and cell size."
        : "Cells with contact count with their whole area.";
    case "model":
      return "";
  }
}

/** The unit in which forces are shown. */
export const unitOf = (settings: Settings) => (settings.force_unit === "%BW" && settings.body_mass_kg !== null ? "%BW" : "N");

/**
 * Two texts: the force in the chosen unit, and in the other unit. Without a body mass, the first is in newtons and the second is
 * empty. `space` is inserted before the unit; if it is empty, the unit is omitted, too.
 */
export function forceText(force_n: number, settings: Settings, space = " "): [string, string] {
  const text = (value: number, unit: string) => value.toFixed(0) + (space === "" ? "" : space + unit);
  const newtons = text(force_n, "N");
  const share = percentOfWeight(force_n, settings);
  if (share === null) return [newtons, ""];
  const percent = text(share, "%BW");
  return unitOf(settings) === "%BW" ? [percent, newtons] : [newtons, percent];
}

/** A number with this number of decimal digits and this unit, or a dash for `null`. */
export const numberText = (value: number | null, digits: number, unit = "") =>
  value === null ? "–" : `${value.toFixed(digits)}${unit && " "}${unit}`;
