/** Numbers and names as the wearer reads them. */

import { isToday } from "./days";
import type { Hello } from "./generated/messages";
import type { LiveRegion } from "./generated/quantities";
import { type Settings, percentOfWeight } from "./settings";
import { sideTitle } from "./side";

/** The message of an error. */
export const errorText = (error: unknown) => (error instanceof Error ? error.message : String(error));

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

/** The English of the reader, if the browser knows it: the page is in English, but the order of dates and the hours differ. */
const LOCALE = globalThis.navigator?.languages?.find((language) => language.startsWith("en-")) ?? "en-GB";
const TIME: Intl.DateTimeFormatOptions = { hour: "2-digit", minute: "2-digit" };

/** The options of a date as the wearer reads it. Its year is omitted if it is the present one. */
function dateOptions(date: Date): Intl.DateTimeFormatOptions {
  const is_this_year = date.getFullYear() === new Date().getFullYear();
  return { weekday: "short", day: "numeric", month: "short", ...(is_this_year ? {} : { year: "numeric" }) };
}

/** A time as the wearer reads it, or a dash for an unknown one. Its date is omitted if it is the present day. */
export function timeText(unix_s: number | null): string {
  if (unix_s === null) return "–";
  const date = new Date(unix_s * 1000);
  return date.toLocaleString(LOCALE, { ...(isToday(unix_s) ? {} : dateOptions(date)), ...TIME });
}

/** A time of the day as the wearer reads it, from minutes after midnight of this device. */
export function timeOfDayText(minutes: number): string {
  return new Date(2000, 0, 1, 0, (minutes + 1440) % 1440).toLocaleTimeString(LOCALE, TIME);
}

/** A date, YYYY-MM-DD, as the wearer reads it. */
export function dateText(day: string): string {
  const date = new Date(`${day}T12:00`);
  return date.toLocaleDateString(LOCALE, dateOptions(date));
}

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

/** A foot, and whether its insole states effective areas or contact areas. */
export type AreaRule = Pick<Hello, "side" | "has_effective_areas">;

/** True if all insoles state the same kind of area. */
const isSameArea = (rules: readonly AreaRule[]) =>
  rules.every(({ has_effective_areas }) => has_effective_areas === rules[0]?.has_effective_areas);

/** The name of the areas of these insoles. It states their contact rule, unless they have different ones. */
export function areaTitle(rules: readonly AreaRule[]): string {
  if (!isSameArea(rules)) return "Area";
  return rules[0]?.has_effective_areas ? "Effective area" : "Contact area";
}

/** How the areas of these insoles are counted. The feet are named only if their insoles have different rules. */
function areaNote(rules: readonly AreaRule[]): string {
  if (!isSameArea(rules)) {
    const name = (rule: AreaRule) => `${sideTitle(rule.side)}, ${areaTitle([rule]).toLowerCase()}`;
    const notes = rules.map((rule) => `${name(rule)}: ${areaNote([rule])}`);
    return `The areas of the feet cannot be compared. ${notes.join(" ")}`;
  }
  return rules[0]?.has_effective_areas
    ? "Each cell counts with the share of its area that the foot covers, estimated from its pressure. So the sum depends on " +
        "pressure and cell size."
    : "Cells with contact count with their whole area.";
}

/**
 * A note for the wearer on a quantity of these insoles; empty if none is needed. An insole does not know whether the scale of its
 * deformation was measured.
 */
export function quantityNote(quantity: Quantity, rules: readonly AreaRule[]): string {
  switch (quantity) {
    case "measured":
      return "The sum of the sensors. Load beside the sensors, and shear, are not part of it.";
    case "deformation":
      return (
        "Share of assumption: 100 %. The scale of the deformation follows from a typical thickness of the tissue and an assumed " +
        "compression; the share is less if they were measured for your parameters."
      );
    case "area":
      return areaNote(rules);
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

/** A number with this number of decimal digits, or a dash for `null`. */
export const numberText = (value: number | null, digits: number) => value?.toFixed(digits) ?? "–";

/** A number with this number of decimal digits, but without the sign of a number that is rounded to zero. */
export const signedText = (value: number, digits: number) => value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1");
