/** The live view: both soles with their loads, the total forces, and the table of regions. */

import { type Node, byId, fill } from "./dom";
import { QUANTITIES, type Quantity, areaTitle, forceText, quantityNote, quantityText, regionTitle } from "./format";
import type { Facts, Sole } from "./generated/messages";
import type { Ellipse, Live, Side } from "./generated/quantities";
import type { Insoles } from "./insoles";
import { extendPath } from "./pressure_path";
import { colours, scaleEnd_n } from "./scale";
import { type SessionState, totalForce } from "./session";
import type { Settings } from "./settings";
import { SIDES, sideTitle } from "./side";
import { type SolePicture, Soles } from "./soles";

const NOT_CONNECTED = "Not connected";
/** The text on a sole that shows no loads, for each state of its session. */
const TEXTS: Record<SessionState, string> = {
  live: "",
  closed: NOT_CONNECTED,
  waiting: "Waiting",
  lost: "Connection lost",
  "other-host": "Used by another device",
  "other-version": "Different version",
  "same-foot": "Same foot",
};

/** Shows the live frames and the states of the insoles. */
export class LiveView {
  private readonly soles: Soles;
  private readonly pictures: Record<Side, SolePicture>;
  /** Largest force on a region since {@link reset}. It determines the scale of the colours. */
  private largest_n = 0;
  /**
   * Regions in which a cell has been saturated since {@link reset}. They are not removed again, because the picture would move if
   * their note disappeared.
   */
  private readonly saturated = new Set<string>();
  private quantity: Quantity = "measured";
  private is_draw_requested = false;
  /** True after the first picture with a load. Its time is marked for measurements in tests. */
  private has_drawn_load = false;

  constructor(private readonly facts: Facts) {
    this.soles = new Soles(byId("soles", HTMLCanvasElement));
    const empty = (): SolePicture => ({ live: undefined, text: NOT_CONNECTED, ellipses: [], sole: facts.sole, path: [] });
    this.pictures = { left: empty(), right: empty() };
    const is_dark = matchMedia("(prefers-color-scheme: dark)");
    const measure = () => this.measure(is_dark.matches);
    is_dark.addEventListener("change", measure);
    new ResizeObserver(measure).observe(byId("soles"));
    measure();
    const quantity = byId("quantity", HTMLSelectElement);
    quantity.onchange = () => (this.quantity = QUANTITIES.find((known) => known === quantity.value) ?? "measured");
  }

  /** Resets the largest force, the saturated regions and the shapes of the soles. To be called when other insoles are used. */
  reset(): void {
    this.largest_n = 0;
    this.saturated.clear();
    for (const side of SIDES) this.shape(side, [], undefined);
  }

  /** Shows a live frame. It is drawn together with the next frame of the screen. */
  frame(live: Live, side: Side): void {
    const picture = this.pictures[side];
    picture.live = live;
    extendPath(picture.path, live);
    live.regions.forEach(({ measured_n, saturated }, i) => {
      if (measured_n > this.largest_n) this.largest_n = measured_n;
      if (saturated) this.saturated.add(this.regionText(side, i));
    });
    this.requestDraw();
  }

  /** Shows the contact ellipses of a foot within its sole, which is the generic one until the cells of the insole are known. */
  shape(side: Side, ellipses: readonly (Ellipse | null)[], sole: Sole | undefined): void {
    const picture = this.pictures[side];
    picture.ellipses = ellipses.filter((ellipse) => ellipse !== null);
    picture.sole = sole ?? this.facts.sole;
    this.requestDraw();
  }

  /** Names of the regions in which a cell has been saturated. */
  get saturatedRegions(): string[] {
    return [...this.saturated];
  }

  /** Names of the regions with masked cells in the last live frames. */
  get maskedRegions(): string[] {
    return SIDES.flatMap((side) =>
      (this.pictures[side].live?.regions ?? []).flatMap(({ masked }, i) => (masked ? [this.regionText(side, i)] : [])),
    );
  }

  /** Updates the texts of the view. To be called a few times a second. */
  update(insoles: Insoles, settings: Settings): void {
    for (const side of SIDES) this.updateState(side, insoles.of(side)?.state ?? "closed");
    fill("totals", SIDES.map((side) => {
      const live = this.pictures[side].live;
      const [main, second] = live ? forceText(totalForce(live), settings) : ["–", ""];
      return ["div", {}, ["dt", { class: side }, sideTitle(side)], ["dd", {}, main, ["small", {}, second]]];
    }));
    const rows = this.facts.regions.map(({ name }, i): Node => [
      "tr",
      {},
      ["th", { scope: "row" }, regionTitle(name)],
      ...SIDES.map((side): Node => {
        const region = this.pictures[side].live?.regions[i];
        const has_parameters = insoles.of(side)?.hello?.has_parameters ?? false;
        return ["td", {}, (region && quantityText(region, this.quantity, has_parameters, settings)) ?? "–"];
      }),
    ]);
    fill(byId("regions").querySelector("tbody"), rows.reverse());
    const rules = SIDES.flatMap((side) => insoles.of(side)?.hello ?? []);
    fill(byId("quantity").querySelector("[value=area]"), [areaTitle(rules)]);
    fill("quantity-note", [quantityNote(this.quantity, rules)]);
    fill("scale-to", [forceText(scaleEnd_n(this.largest_n), settings)[0]]);
  }

  /** Shows the state of the session with an insole. Removes the loads of the foot unless the session is live. */
  private updateState(side: Side, state: SessionState): void {
    const picture = this.pictures[side];
    const text = TEXTS[state];
    if (text === picture.text) return;
    picture.text = text;
    if (text !== "") {
      picture.live = undefined;
      picture.ellipses = [];
      picture.path.length = 0;
    }
    this.requestDraw();
  }

  private regionText(side: Side, region: number): string {
    return `${side} ${regionTitle(this.facts.regions[region]?.name ?? "").toLowerCase()}`;
  }

  /** Requests one drawing with the next frame of the screen. While a page is in the background, browsers do not execute it. */
  private requestDraw(): void {
    if (this.is_draw_requested || !this.soles.isVisible) return;
    this.is_draw_requested = true;
    requestAnimationFrame(() => {
      this.is_draw_requested = false;
      this.draw();
    });
  }

  private draw(): void {
    this.soles.draw(this.pictures, scaleEnd_n(this.largest_n));
    if (!this.has_drawn_load && this.largest_n > 0) {
      this.has_drawn_load = true;
      performance.mark("first-load");
    }
  }

  /** Adapts the picture to the size of the canvas and to the colour scheme. */
  private measure(is_dark: boolean): void {
    const palette = colours(is_dark);
    this.soles.measure(palette);
    // Every seventh of the 64 colours, from the first to the last one.
    byId("scale").style.background = `linear-gradient(to right, ${palette.filter((_, i) => i % 7 === 0).join(", ")})`;
    // A resized canvas is empty, so it is drawn immediately instead of with the next frame of the screen.
    this.draw();
  }
}
