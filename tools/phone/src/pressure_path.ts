/** The path of the centre of pressure under a foot. */

import type { Facts } from "./generated/messages";
import type { Live } from "./generated/quantities";

export type Point = [x_mm: number, y_mm: number];

/** Points of the centre of pressure with the times of their frames, oldest first. */
export type Path = { t_s: number; at_mm: Point }[];

/** Longest duration of a path. Older points are removed. */
const PATH_S = 1;
/** After a longer time without a point, which is a swing, the next point starts a new path. */
const LONGEST_GAP_S = 0.1;
/** Smallest total force for which the centre of pressure is computed. */
const LEAST_N = 20;

/**
 * The mean of the centres of the regions, weighted by their forces; `undefined` if the foot is hardly loaded. It is an estimate,
 * because a live frame does not contain the pressures of the cells.
 */
export function centreOfPressure(live: Live, facts: Facts): Point | undefined {
  let [force_n, x, y] = [0, 0, 0];
  live.regions.forEach((region, i) => {
    const centre = facts.regions[i]?.centre_mm;
    if (!centre) return;
    force_n += region.measured_n;
    x += region.measured_n * centre[0];
    y += region.measured_n * centre[1];
  });
  return force_n < LEAST_N ? undefined : [x / force_n, y / force_n];
}

/** Adds the point of a frame to a path and removes points that are too old. The path of a stance remains visible during swing. */
export function extendPath(path: Path, live: Live, facts: Facts): void {
  const at_mm = centreOfPressure(live, facts);
  const last = path.at(-1);
  if (last && (live.t_s < last.t_s || live.t_s > last.t_s + PATH_S)) path.length = 0;
  if (!at_mm) return;
  if (last && live.t_s > last.t_s + LONGEST_GAP_S) path.length = 0;
  path.push({ t_s: live.t_s, at_mm });
  while ((path[0]?.t_s ?? Infinity) < live.t_s - PATH_S) path.shift();
}
