/**
 * The colours of loads. Their lightness (in the colour space OKLCH) is linear in load, so that equal differences of load look
 * equal, also to people who do not distinguish the colours.
 */

/** Number of colours. */
const COLOURS = 64;
/** Round forces at which a scale may end. */
const ENDS_N = [50, 100, 150, 200, 250, 300, 400, 500, 600, 700, 800, 1000, 1200, 1500, 2000, 3000, 5000];

/** The colours from no load to the largest load. The first colour is close to the background of the page, dark or light. */
export function colours(is_dark: boolean): string[] {
  return Array.from({ length: COLOURS }, (_, i) => {
    const load = i / (COLOURS - 1);
    const light = is_dark ? load : 1 - load;
    const lightness = 0.28 + 0.66 * light;
    const chroma = 0.07 + 0.1 * Math.sin(Math.PI * light);
    // From dark purple through red and orange to light yellow.
    const hue = (300 + 160 * light) % 360;
    return `oklch(${lightness.toFixed(3)} ${chroma.toFixed(3)} ${hue.toFixed(1)})`;
  });
}

/** The colour of a force on a scale from 0 to `end_n`. */
export function colourOf(force_n: number, end_n: number, palette: readonly string[]): string {
  const index = Math.round(Math.min(1, Math.max(0, force_n / end_n)) * (palette.length - 1));
  return palette[index] ?? "transparent";
}

/** The smallest round force that is at least `force_n`. */
export const scaleEnd_n = (force_n: number) => ENDS_N.find((end) => end >= force_n) ?? Math.ceil(force_n / 1000) * 1000;
