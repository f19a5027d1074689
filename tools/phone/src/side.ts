/** The two feet. */

import type { Side } from "./generated/quantities";

/** Both feet, in the order in which they are shown. */
export const SIDES: readonly Side[] = ["left", "right"];

export const sideTitle = (side: Side) => (side === "left" ? "Left" : "Right");
