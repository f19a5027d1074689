/** Draws both soles on a canvas. */

import type { Sole } from "./generated/messages";
import type { Ellipse, Live, Side } from "./generated/quantities";
import { type Path, type Point } from "./pressure_path";
import { colourOf } from "./scale";
import { SIDES } from "./side";

/**
 * Distance of each sole from the middle and from the bottom of the canvas, and least distance from its top. The least distance
 * from the left or the right edge is 1.5 times this distance.
 */
const MARGIN_MM = 10;

/** The content of the picture of one sole. */
export interface SolePicture {
  live: Live | undefined;
  /** Text that is shown instead of loads. */
  text: string;
  /** Contact ellipses of the regions in contact. */
  ellipses: Ellipse[];
  sole: Sole;
  /** Path of the centre of pressure. */
  path: Path;
}

/** Colours of the page that are also used on the canvas. */
interface Ink {
  back: string;
  text: string;
  line: string;
  sole: string;
}

/** The canvas with both soles. */
export class Soles {
  private readonly context: CanvasRenderingContext2D;
  /** The shapes of each sole that was drawn, so that they are made once. */
  private readonly shapes = new WeakMap<Sole, { outline: Path2D; regions: Path2D[] }>();
  private ink: Ink = { back: "", text: "", line: "", sole: "" };
  private palette: readonly string[] = [];
  /** Size of the canvas on the page; 0 while it is not displayed. */
  private width = 0;
  private height = 0;
  /** The text of {@link appearanceOf} for each sole when it was drawn last. */
  private readonly drawn: Record<Side, string> = { left: "", right: "" };

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d")!;
  }

  /** Reads the colours of the page and the size of the canvas again. */
  measure(palette: readonly string[]): void {
    const style = getComputedStyle(document.documentElement);
    const colour = (name: string) => style.getPropertyValue(`--${name}`).trim();
    this.ink = { back: colour("back"), text: colour("text"), line: colour("line"), sole: colour("sole") };
    this.palette = palette;
    const { width, height } = this.canvas.getBoundingClientRect();
    // A resolution of more than two pixels per CSS pixel takes more time to draw and looks no different.
    const ratio = Math.min(2, window.devicePixelRatio);
    this.width = width;
    this.height = height;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    // A resized canvas is empty.
    for (const side of SIDES) this.drawn[side] = "";
  }

  /** False while the canvas is not displayed. */
  get isVisible(): boolean {
    return this.width > 0;
  }

  /** Draws the soles whose appearance has changed. */
  draw(pictures: Record<Side, SolePicture>, scale_end_n: number): void {
    if (!this.isVisible) return;
    const size_mm = [0, 1].map((axis) => Math.max(...SIDES.map((side) => extent_mm(pictures[side].sole, axis)))) as Point;
    for (const side of SIDES) {
      const colours = pictures[side].live?.regions.map(({ measured_n }) => colourOf(measured_n, scale_end_n, this.palette)) ?? [];
      const appearance = [...size_mm, appearanceOf(pictures[side], colours)].join();
      if (appearance === this.drawn[side]) continue;
      this.drawn[side] = appearance;
      this.drawHalf(side, pictures[side], size_mm, colours);
    }
  }

  /** Draws one sole in its half of the canvas. Both soles are drawn at the same scale, at which the larger one fits. */
  private drawHalf(side: Side, picture: SolePicture, [width_mm, length_mm]: Point, colours: readonly string[]): void {
    const { context: c, width, height } = this;
    const [x_mm, y_mm] = picture.sole.from_mm;
    const scale = Math.min(width / (2 * width_mm + 5 * MARGIN_MM), height / (length_mm + 2 * MARGIN_MM));
    // In foot coordinates x points to the lateral side, so a left foot is mirrored.
    const mirror = side === "left" ? -1 : 1;
    c.save();
    c.beginPath();
    c.rect(side === "left" ? 0 : width / 2, 0, width / 2, height);
    c.clip();
    c.clearRect(0, 0, width, height);
    c.translate(width / 2 + mirror * MARGIN_MM * scale, height - MARGIN_MM * scale);
    c.scale(mirror * scale, -scale);
    c.translate(-x_mm, -y_mm);
    this.drawSole(picture, colours, 1 / scale);
    c.restore();
    if (picture.text) {
      const x = width / 2 + mirror * (MARGIN_MM + width_mm / 2) * scale;
      this.drawText(picture.text, x, height / 2, width_mm * scale * 0.7);
    }
  }

  /** Draws one sole in foot coordinates, mm; `px` is the size of a CSS pixel. */
  private drawSole({ live, ellipses, sole, path }: SolePicture, colours: readonly string[], px: number): void {
    const { context: c, ink } = this;
    const { outline, regions } = this.shapesOf(sole);
    regions.forEach((region, i) => {
      c.fillStyle = colours[i] ?? ink.sole;
      c.fill(region);
    });
    c.strokeStyle = ink.line;
    c.lineWidth = 1.5 * px;
    c.stroke(outline);
    if (!live) return;
    c.lineJoin = "round";
    // The ellipse of a hollow contact, such as that of the two edges of the heel, can extend beyond the sole.
    c.save();
    c.clip(outline);
    c.beginPath();
    for (const { x_mm, y_mm, r_a_mm, r_b_mm, angle_deg } of ellipses) {
      const angle = (angle_deg * Math.PI) / 180;
      c.moveTo(x_mm + r_a_mm * Math.cos(angle), y_mm + r_a_mm * Math.sin(angle));
      c.ellipse(x_mm, y_mm, r_a_mm, r_b_mm, angle, 0, 2 * Math.PI);
    }
    this.strokeWithHalo(2 * px);
    c.restore();
    this.drawPath(path, px);
    live.regions.forEach(({ saturated, clamped }, i) => {
      const centre = sole.regions[i]?.centre_mm;
      if (centre && (saturated || clamped)) this.drawFlag(centre, saturated, px);
    });
  }

  private shapesOf(sole: Sole): { outline: Path2D; regions: Path2D[] } {
    let shapes = this.shapes.get(sole);
    if (!shapes) {
      shapes = { outline: polygon(sole.outline_mm), regions: sole.regions.map(({ outline_mm }) => polygon(outline_mm)) };
      this.shapes.set(sole, shapes);
    }
    return shapes;
  }

  /** Draws the path of the centre of pressure, with a disc at its last point. */
  private drawPath(path: Path, px: number): void {
    const { context: c } = this;
    const last = path.at(-1);
    if (!last) return;
    c.beginPath();
    path.forEach(({ at_mm: [x, y] }) => c.lineTo(x, y));
    this.strokeWithHalo(3.5 * px);
    c.beginPath();
    c.arc(...last.at_mm, 6 * px, 0, 2 * Math.PI);
    c.fillStyle = this.ink.text;
    c.fill();
    this.stroke(this.ink.back, 2 * px);
  }

  /** Draws a triangle: filled for a saturated sensor, open for a clamped model. */
  private drawFlag([x, y]: Point, is_saturated: boolean, px: number): void {
    const { context: c, ink } = this;
    c.beginPath();
    c.moveTo(x, y + 10 * px);
    c.lineTo(x - 10 * px, y - 7 * px);
    c.lineTo(x + 10 * px, y - 7 * px);
    c.closePath();
    c.fillStyle = is_saturated ? ink.text : ink.back;
    c.fill();
    this.strokeWithHalo(2 * px);
  }

  /**
   * Strokes the current path in the colour of the text, over a wider line in the colour of the background, so that the line is
   * visible on a region of any colour.
   */
  private strokeWithHalo(width: number): void {
    this.stroke(this.ink.back, 2.2 * width);
    this.stroke(this.ink.text, width);
  }

  private stroke(colour: string, width: number): void {
    this.context.strokeStyle = colour;
    this.context.lineWidth = width;
    this.context.stroke();
  }

  /** Draws a text centred at (x, y), in lines that are at most `width` wide if their words allow it. */
  private drawText(text: string, x: number, y: number, width: number): void {
    const { context: c } = this;
    c.fillStyle = this.ink.text;
    c.font = "600 15px system-ui, sans-serif";
    c.textAlign = "center";
    const lines: string[] = [];
    for (const word of text.split(" ")) {
      const longer = `${lines.at(-1) ?? ""} ${word}`.trim();
      if (lines.length > 0 && c.measureText(longer).width <= width) lines[lines.length - 1] = longer;
      else lines.push(word);
    }
    lines.forEach((line, i) => c.fillText(line, x, y + (i - (lines.length - 1) / 2) * 20));
  }
}

/** A text that is equal for pictures with the same appearance. */
function appearanceOf({ live, text, ellipses, sole, path }: SolePicture, colours: readonly string[]): string {
  const flags = live?.regions.map(({ saturated, clamped }) => (saturated ? 2 : clamped ? 1 : 0)) ?? [];
  const shapes = live ? ellipses.flatMap(({ x_mm, y_mm, r_a_mm, r_b_mm, angle_deg }) => [x_mm, y_mm, r_a_mm, r_b_mm, angle_deg]) : [];
  return [text, ...sole.from_mm, sole.outline_mm.length, ...colours, ...flags, ...shapes, path.length, path.at(0)?.t_s, path.at(-1)?.t_s].join();
}

/** Width (axis 0) or length (axis 1) of a sole. */
const extent_mm = ({ from_mm, to_mm }: Sole, axis: number) => (to_mm[axis] ?? 0) - (from_mm[axis] ?? 0);

/** A closed polygon for drawing. */
function polygon(points: readonly Point[]): Path2D {
  const path = new Path2D();
  points.forEach(([x, y]) => path.lineTo(x, y));
  path.closePath();
  return path;
}
