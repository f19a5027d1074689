/** The path of the centre of pressure under a foot. */

import type { Live } from "./generated/quantities";

/** A point in foot coordinates: x to the lateral side, y from heel to toes. */
export type Point = [x_mm: number, y_mm: number];

/** Points of the centre of pressure with the times of their frames, oldest first. */
export type Path = { t_s: number; at_mm: Point }[];

/** Longest duration of a path. Older points are removed. */
const PATH_S = 1;
/** After a longer time without a point, which is a swing, the next point starts a new path. */
const LONGEST_GAP_S = 0.1;

/** Adds the point of a frame to a path and removes points that are too old. The path of a stance remains visible during swing. */
export function extendPath(path: Path, live: Live): void {
  const last = path.at(-1);
  if (last && (live.t_s < last.t_s || live.t_s > last.t_s + PATH_S)) path.length = 0;
  // The insole sends the centre of pressure while the foot is on the ground.
  if (live.centre_x_mm === null || live.centre_y_mm === null) return;
  if (last && live.t_s > last.t_s + LONGEST_GAP_S) path.length = 0;
  path.push({ t_s: live.t_s, at_mm: [live.centre_x_mm, live.centre_y_mm] });
  while ((path[0]?.t_s ?? Infinity) < live.t_s - PATH_S) path.shift();
}
