/** The two feet. */

import type { Side } from "./generated/quantities";

export const SIDES: readonly Side[] = ["left", "right"];

export const sideTitle = (side: Side) => (side === "left" ? "Left" : "Right");
