/** Both soles on a canvas. */

import { colourOf } from "./scale";
import { type Ellipse, type Facts, type Live, type Point, SIDES, type Side } from "./wire";

/** Around and between the soles. */
const MARGIN_MM = 10;
/** How long the path of the centre of load is, s. */
const PATH_S = 1;
/** Below this total force a foot has no centre of load, N. */
const LEAST_N = 20;

export interface FootPicture {
  live: Live | undefined;
  /** Words on a sole that shows nothing. */
  words: string;
  /** At the last step's peak. */
  ellipses: Ellipse[];
  path: PathPoint[];
}

export interface PathPoint {
  t_s: number;
  at_mm: Point;
}

/** The mean of the regions' centres, weighted by their forces: an estimate, as a live frame tells no more. */
export function centreOfLoad(live: Live, facts: Facts): Point | undefined {
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

/** Adds a frame to a path and forgets what is old; a swing ends it. */
export function extendPath(path: PathPoint[], live: Live, facts: Facts): void {
  const at_mm = centreOfLoad(live, facts);
  const last = path.at(-1);
  if (last && (live.t_s < last.t_s || live.t_s > last.t_s + PATH_S)) path.length = 0;
  // The last path stays visible in swing.
  if (!at_mm) return;
  if (last && live.t_s > last.t_s + 0.1) path.length = 0;
  path.push({ t_s: live.t_s, at_mm });
  while ((path[0]?.t_s ?? Infinity) < live.t_s - PATH_S) path.shift();
}

/** Colours of the page that the canvas needs too. */
interface Ink {
  back: string;
  text: string;
  soft: string;
  line: string;
  sole: string;
}

export class Feet {
  private readonly context: CanvasRenderingContext2D;
  private readonly outline: Path2D;
  private readonly regions: Path2D[];
  private ink: Ink = { back: "", text: "", soft: "", line: "", sole: "" };
  private palette: readonly string[] = [];
  private width = 0;
  private height = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly facts: Facts,
  ) {
    const context = canvas.getContext("2d");
    if (!context) throw new Error("This browser cannot draw.");
    this.context = context;
    this.outline = rounded(facts.sole.outline_mm);
    this.regions = facts.regions.map(({ outline_mm }) => polygon(outline_mm));
  }

  /** Takes the page's colours and size. */
  adopt(palette: readonly string[]): void {
    const style = getComputedStyle(document.documentElement);
    const colour = (name: string) => style.getPropertyValue(`--${name}`).trim();
    this.ink = { back: colour("back"), text: colour("text"), soft: colour("soft"), line: colour("line"), sole: colour("sole") };
    this.palette = palette;
    const { width, height } = this.canvas.getBoundingClientRect();
    // More than two pixels a point cost time and show nothing.
    const ratio = Math.min(2, window.devicePixelRatio);
    this.width = width;
    this.height = height;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  draw(feet: Record<Side, FootPicture>, scale_end_n: number): void {
    const { context: c } = this;
    const { length_mm, width_mm } = this.facts.sole;
    c.clearRect(0, 0, this.width, this.height);
    const scale = Math.min(this.width / (2 * width_mm + 5 * MARGIN_MM), this.height / (length_mm + 2 * MARGIN_MM));
    for (const side of SIDES) {
      // The left foot's lateral side is on the left.
      const mirror = side === "left" ? -1 : 1;
      c.save();
      c.translate(this.width / 2 + mirror * MARGIN_MM * scale, this.height - MARGIN_MM * scale);
      c.scale(mirror * scale, -scale);
      this.sole(feet[side], scale_end_n, 1 / scale);
      c.restore();
      if (feet[side].words) {
        const x = this.width / 2 + mirror * (MARGIN_MM + width_mm / 2) * scale;
        this.words(feet[side].words, x, this.height / 2, width_mm * scale * 0.7);
      }
    }
  }

  /** One foot in mm; `px` is a pixel. */
  private sole({ live, ellipses, path }: FootPicture, scale_end_n: number, px: number): void {
    const { context: c, ink } = this;
    c.save();
    c.clip(this.outline);
    c.fillStyle = ink.sole;
    c.fill(this.outline);
    c.lineJoin = "round";
    this.regions.forEach((region, i) => {
      const load = live?.regions[i];
      if (load && live) {
        c.fillStyle = colourOf(load.measured_n, scale_end_n, this.palette);
        c.fill(region);
      }
      c.strokeStyle = ink.back;
      c.lineWidth = 2 * px;
      c.stroke(region);
    });
    c.restore();
    c.strokeStyle = ink.line;
    c.lineWidth = 1.5 * px;
    c.stroke(this.outline);
    if (!live) return;
    for (const { x_mm, y_mm, r_a_mm, r_b_mm, angle_deg } of ellipses) {
      c.beginPath();
      c.ellipse(x_mm, y_mm, r_a_mm, r_b_mm, (angle_deg * Math.PI) / 180, 0, 2 * Math.PI);
      this.outlined(2 * px);
    }
    this.path(path, px);
    live.regions.forEach((load, i) => {
      const centre = this.facts.regions[i]?.centre_mm;
      if (centre && (load.saturated || load.clamped)) this.flag(centre, load.saturated, px);
    });
  }

  private path(path: readonly PathPoint[], px: number): void {
    const { context: c } = this;
    const last = path.at(-1);
    if (!last) return;
    c.beginPath();
    path.forEach(({ at_mm: [x, y] }) => c.lineTo(x, y));
    this.outlined(3.5 * px);
    c.beginPath();
    c.arc(...last.at_mm, 6 * px, 0, 2 * Math.PI);
    c.fillStyle = this.ink.text;
    c.fill();
    this.outlined(0, this.ink.back, 2 * px);
  }

  /** A triangle: filled where the sensor is at its end, open where the model is. */
  private flag([x, y]: Point, is_saturated: boolean, px: number): void {
    const { context: c, ink } = this;
    c.beginPath();
    c.moveTo(x, y + 10 * px);
    c.lineTo(x - 10 * px, y - 7 * px);
    c.lineTo(x + 10 * px, y - 7 * px);
    c.closePath();
    c.fillStyle = is_saturated ? ink.text : ink.back;
    c.fill();
    this.outlined(2 * px);
  }

  /** Strokes in the text's colour over a wider line of the background's: seen on any load. */
  private outlined(width: number, halo = this.ink.back, extra = width * 1.2): void {
    const { context: c } = this;
    c.strokeStyle = halo;
    c.lineWidth = width + extra;
    c.stroke();
    if (width === 0) return;
    c.strokeStyle = this.ink.text;
    c.lineWidth = width;
    c.stroke();
  }

  private words(words: string, x: number, y: number, width: number): void {
    const { context: c } = this;
    c.fillStyle = this.ink.text;
    c.font = "600 15px system-ui, sans-serif";
    c.textAlign = "center";
    const lines: string[] = [];
    for (const word of words.split(" ")) {
      const longer = `${lines.at(-1) ?? ""} ${word}`.trim();
      if (lines.length > 0 && c.measureText(longer).width <= width) lines[lines.length - 1] = longer;
      else lines.push(word);
    }
    lines.forEach((line, i) => c.fillText(line, x, y + (i - (lines.length - 1) / 2) * 20));
  }
}

function polygon(points: readonly Point[]): Path2D {
  const path = new Path2D();
  points.forEach(([x, y]) => path.lineTo(x, y));
  path.closePath();
  return path;
}

/** A smooth line through the middles of a polygon's edges. */
function rounded(points: readonly Point[]): Path2D {
  const path = new Path2D();
  points.forEach(([x, y], i) => {
    const [next_x, next_y] = points[(i + 1) % points.length] ?? [x, y];
    const middle: Point = [(x + next_x) / 2, (y + next_y) / 2];
    if (i === 0) path.moveTo(...middle);
    else path.quadraticCurveTo(x, y, ...middle);
  });
  const [first, second] = points;
  if (first && second) path.quadraticCurveTo(...first, (first[0] + second[0]) / 2, (first[1] + second[1]) / 2);
  path.closePath();
  return path;
}
