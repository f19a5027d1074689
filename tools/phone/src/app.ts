/** Puts the page together: insoles in, pictures and words out. */

import { liveCsv, stepsCsv } from "./csv";
import { Feet, type FootPicture, extendPath } from "./feet";
import { type Node, byId, download, fill } from "./dom";
import { QUANTITIES, type Quantity, forceText, quantityText, regionTitle } from "./format";
import { Recorder } from "./recorder";
import { colours, scaleEnd_n } from "./scale";
import { Session, type SessionState, totalForce } from "./session";
import { KG_PER_LB, loadSettings, saveSettings } from "./settings";
import { DatabaseKeeper, type Keeper, MemoryKeeper, NoKeeper, StepStore } from "./steps";
import { drawSteps } from "./steps_view";
import { BluetoothTransport, explain } from "./transport/bluetooth";
import { ReplayTransport } from "./transport/replay";
import { INSOLES, type Insole, type Transport, type TransportEvents } from "./transport/transport";
import { WebSocketTransport } from "./transport/websocket";
import { type Live, SIDES, type Side, type Step, type Wire } from "./wire";

/** `plantar serve` is reached by an address or as localhost; a page with a name has no insoles behind it. */
const isAddress = (host: string) => host === "localhost" || /^[\d.]+$|^\[/.test(host);
/** Words and numbers change so often, ms; pictures with every frame of the screen. */
const WORDS_MS = 100;
/** On a sole that shows nothing. */
const WORDS: Record<SessionState, string> = {
  live: "",
  closed: "not connected",
  waiting: "waiting",
  lost: "link lost",
  "other-version": "update needed",
};
const COMPUTED_WALK = "./walk.plantar";

export class App {
  private readonly settings = loadSettings(localStorage);
  private sessions: Session[] = [];
  private readonly recorder = new Recorder();
  private readonly feet: Feet;
  private readonly pictures: Record<Side, FootPicture>;
  private readonly hellos = new Map<Insole, Uint8Array>();
  private store: StepStore;
  private transport: Transport | undefined;
  private problem = "";
  /** Largest force of a region so far, N. */
  private largest_n = 0;
  /** Where the sensor was at its end; said until the insoles change, words that come and go would move the picture. */
  private readonly saturated = new Set<string>();
  private quantity: Quantity = "measured";
  private palette: string[] = [];
  private is_dirty = true;
  private has_drawn_load = false;

  constructor(private readonly wire: Wire) {
    this.feet = new Feet(byId("feet", HTMLCanvasElement), wire.facts);
    this.store = new StepStore(wire, new MemoryKeeper());
    const empty = (): FootPicture => ({ live: undefined, words: "not connected", ellipses: [], path: [] });
    this.pictures = { left: empty(), right: empty() };
  }

  async start(): Promise<void> {
    this.listen();
    this.adopt();
    const query = new URLSearchParams(location.search);
    const replay = query.get("replay");
    if (replay !== null) await this.replay(replay);
    else {
      await this.keepSteps();
      if (query.has("serve") || (isAddress(location.hostname) && !query.has("bluetooth"))) this.serve();
      else byId("start").hidden = false;
    }
    setInterval(() => this.tick(), WORDS_MS);
    this.tick();
    requestAnimationFrame(this.frame);
  }

  /** Brings back the steps of earlier visits, where the browser keeps anything. */
  private async keepSteps(): Promise<void> {
    const keeper: Keeper = await DatabaseKeeper.open().catch(() => new NoKeeper());
    const store = new StepStore(this.wire, keeper);
    await store.load();
    this.show(store);
  }

  private show(store: StepStore): void {
    this.store = store;
    this.lastEllipses();
    this.stepsChanged();
  }

  private serve(): void {
    const url = new URL("insoles", location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    url.search = "";
    this.use(new WebSocketTransport(url.href, this.events));
  }

  private async replay(url: string): Promise<void> {
    try {
      const transport = await ReplayTransport.load(url, this.events);
      this.show(new StepStore(this.wire, new MemoryKeeper()));
      this.use(transport);
    } catch (error) {
      this.problem = error instanceof Error ? error.message : "The recording cannot be played.";
      byId("start").hidden = false;
    }
  }

  private async bluetooth(): Promise<void> {
    const transport = this.transport instanceof BluetoothTransport ? this.transport : new BluetoothTransport(this.events);
    try {
      this.problem = "";
      const was_replay = this.transport?.is_replay;
      if (transport !== this.transport) this.use(transport);
      // What is walked now is the wearer's.
      if (was_replay) await this.keepSteps();
      await transport.add();
    } catch (error) {
      this.problem = explain(error) ?? "";
      byId("start").hidden = this.sessions.some(({ hello }) => hello);
    }
    this.tick();
  }

  private use(transport: Transport): void {
    this.transport?.close();
    this.transport = transport;
    this.hellos.clear();
    this.sessions = INSOLES.map((insole) => new Session(insole, this.wire, () => this.transport, this.onStep));
    this.largest_n = 0;
    this.saturated.clear();
    byId("start").hidden = true;
  }

  private readonly events: TransportEvents = {
    opened: (insole) => this.sessions[insole]?.opened(performance.now()),
    closed: (insole, reason) => this.sessions[insole]?.closed(reason),
    damaged: (insole) => {
      const session = this.sessions[insole];
      if (session) session.counters.damaged += 1;
    },
    battery: (insole, percent) => {
      const session = this.sessions[insole];
      if (session) session.battery_percent = percent;
    },
    message: (insole, bytes) => {
      const session = this.sessions[insole];
      if (!session) return;
      const now_ms = performance.now();
      const before = { hello: session.hello, live: session.live };
      session.receive(bytes, now_ms);
      if (session.hello !== before.hello) this.hellos.set(insole, bytes.slice());
      this.recorder.take(insole, bytes, now_ms);
      if (session.live && session.hello && session.live !== before.live) this.frameArrived(session.live, session.hello.side);
    },
  };

  /** Only takes note: pictures are drawn when the screen asks. */
  private frameArrived(live: Live, side: Side): void {
    const picture = this.pictures[side];
    picture.live = live;
    extendPath(picture.path, live, this.wire.facts);
    live.regions.forEach(({ measured_n, saturated }, i) => {
      this.largest_n = Math.max(this.largest_n, measured_n);
      if (saturated) this.saturated.add(`${side} ${this.regionWords(i)}`);
    });
    this.is_dirty = true;
  }

  private readonly regionWords = (i: number) => regionTitle(this.wire.facts.regions[i]?.name ?? "").toLowerCase();

  private readonly onStep = (step: Step, message: Uint8Array, session: Session): void => {
    const start_unix_s = step.starts_ago === 0 ? session.axis.unix_s(step.start_s) : step.start_unix_s;
    this.store.add(step, message, session.history, start_unix_s).then(
      () => session.acknowledge(step.step),
      // Not acknowledged: the insole keeps it and sends it again.
      () => (this.problem = "This browser cannot keep steps: its storage is full or not allowed."),
    );
    this.lastEllipses();
    this.stepsChanged();
  };

  private lastEllipses(): void {
    for (const side of SIDES) {
      const last = this.store.steps.findLast(({ step }) => step.side === side)?.step;
      this.pictures[side].ellipses = Object.values(last?.regions ?? {}).flatMap((region) => region.ellipse_at_peak ?? []);
    }
    this.is_dirty = true;
  }

  private stepsChanged(): void {
    drawSteps(this.store.steps, this.settings);
    const is_empty = this.store.steps.length === 0;
    byId("export-steps", HTMLButtonElement).disabled = is_empty;
    byId("clear", HTMLButtonElement).disabled = is_empty;
  }

  private readonly frame = (): void => {
    requestAnimationFrame(this.frame);
    if (!this.is_dirty) return;
    this.is_dirty = false;
    this.feet.draw(this.pictures, this.scaleEnd());
    if (!this.has_drawn_load && this.largest_n > 0) {
      this.has_drawn_load = true;
      performance.mark("first-load");
    }
  };

  private readonly scaleEnd = () => scaleEnd_n(this.largest_n);

  private sessionOf(side: Side): Session | undefined {
    return this.sessions.find(({ hello }) => hello?.side === side);
  }

  private tick(): void {
    const now_ms = performance.now();
    this.sessions.forEach((session) => session.tick(now_ms));
    for (const side of SIDES) {
      const session = this.sessionOf(side);
      const picture = this.pictures[side];
      const words = session === undefined ? "not connected" : WORDS[session.state];
      if (words !== picture.words) {
        picture.words = words;
        this.is_dirty = true;
      }
      // What is not there is not shown as if it were.
      if (words !== "" && picture.live) {
        picture.live = undefined;
        picture.path.length = 0;
      }
    }
    this.words(now_ms);
  }

  private words(now_ms: number): void {
    const { settings } = this;
    fill("chips", SIDES.flatMap((side) => {
      const session = this.sessionOf(side);
      if (!session) return [];
      const says = session.state === "live" ? `${session.rate_hz(now_ms).toFixed(0)} Hz` : session.state === "lost" ? "lost" : "…";
      return [["span", { class: side }, `${side === "left" ? "L" : "R"} ${says}`]];
    }));
    fill("notes", [
      ...this.notes().map((note): Node => ["p", { class: "note" }, note]),
      ...this.calmNotes().map((note): Node => ["p", { class: "note calm" }, note]),
    ]);
    fill("totals", SIDES.map((side) => {
      const live = this.pictures[side].live;
      const [main, second] = live ? forceText(totalForce(live), settings) : ["–", ""];
      return ["div", {}, ["dt", { class: side }, side === "left" ? "Left" : "Right"], ["dd", {}, main, ["small", {}, second]]];
    }));
    fill(byId("regions").querySelector("tbody"), this.wire.facts.regions.map(({ name }, i): Node => [
      "tr",
      {},
      ["th", { scope: "row" }, regionTitle(name)],
      ...SIDES.map((side): Node => {
        const region = this.pictures[side].live?.regions[i];
        const has_parameters = this.sessionOf(side)?.hello?.has_parameters ?? false;
        return ["td", {}, (region && quantityText(region, this.quantity, has_parameters, settings)) ?? "–"];
      }),
    ]).reverse());
    byId("scale-to").textContent = forceText(this.scaleEnd(), settings)[0];
    this.linkWords(now_ms);
  }

  private notes(): string[] {
    const notes = this.problem ? [this.problem] : [];
    const { facts } = this.wire;
    for (const session of this.sessions) {
      const { hello, state } = session;
      if (!hello) continue;
      if (state === "other-version") {
        notes.push(`The ${hello.side} insole (firmware ${hello.firmware}) speaks protocol ${hello.major}.${hello.minor}, this page ${facts.major}.${facts.minor}: update the older of the two.`);
      }
      if (state === "lost") notes.push(`The link to the ${hello.side} insole is lost (${session.reason}). Trying again; steps are kept on the insole.`);
      if (state !== "live") continue;
      if (hello.last_panic) {
        const what = ["panic", "watchdog"].includes(hello.reset) ? "restarted after a fault" : "cannot measure";
        notes.push(`The ${hello.side} insole ${what}: ${hello.last_panic}`);
      }
    }
    if (this.saturated.size > 0) {
      notes.push(`The sensor reached its end: ${[...this.saturated].join(", ")}. Forces there are at least what is shown.`);
    }
    const masked = SIDES.flatMap((side) =>
      (this.pictures[side].live?.regions ?? []).flatMap(({ masked }, i) => (masked ? [`${side} ${this.regionWords(i)}`] : [])),
    );
    if (masked.length > 0) notes.push(`Faulty sensor cells are masked (~): ${masked.join(", ")}. They show what their neighbours read.`);
    return notes;
  }

  /** Nothing is wrong, but good to know. */
  private calmNotes(): string[] {
    const { transport } = this;
    if (transport?.is_replay) return ["Playing a recording."];
    const bare = SIDES.filter((side) => this.sessionOf(side)?.hello?.has_parameters === false);
    if (bare.length > 0) return [`No parameters of the wearer on the insole (${bare.join(", ")}): no model values.`];
    const is_waiting = this.sessions.every(({ state }) => state === "closed" || state === "waiting");
    return transport && is_waiting ? [`Waiting for an insole from ${transport.name}.`] : [];
  }

  private linkWords(now_ms: number): void {
    fill("link", this.sessions.flatMap((session) => {
      const { hello, counters, status } = session;
      if (!hello) return [];
      const parts = [
        `${session.rate_hz(now_ms).toFixed(0)} of ${hello.rate_hz.toFixed(0)} Hz`,
        `${counters.received} frames, ${counters.lost} lost, ${counters.damaged} damaged`,
        `firmware ${hello.firmware}, ${hello.board} board, ${hello.cells} cells`,
      ];
      if (session.battery_percent !== undefined) parts.push(`battery ${session.battery_percent} %`);
      if (status && status.steps_dropped > 0) parts.push(`${status.steps_dropped} steps were lost on the insole`);
      return [["div", {}, ["dt", { class: hello.side }, hello.side === "left" ? "Left" : "Right"], ...parts.map((part): Node => ["dd", {}, part])]];
    }));
    const record = byId("record", HTMLButtonElement);
    record.disabled = !this.transport;
    record.setAttribute("aria-pressed", String(this.recorder.isRecording));
    record.textContent = this.recorder.isRecording ? `Stop recording (${this.recorder.seconds().toFixed(0)} s)` : "Record live values";
    for (const id of ["export-live", "export-stream"]) byId(id, HTMLButtonElement).disabled = this.recorder.isEmpty;
  }

  private adopt(): void {
    this.palette = colours(matchMedia("(prefers-color-scheme: dark)").matches);
    this.feet.adopt(this.palette);
    byId("scale").style.background = `linear-gradient(to right, ${this.palette.filter((_, i) => i % 7 === 0).join(", ")})`;
    this.is_dirty = true;
  }

  private listen(): void {
    for (const button of document.querySelectorAll<HTMLButtonElement>("nav button")) {
      button.onclick = () => {
        document.body.dataset["view"] = button.dataset["to"] ?? "live";
        document.querySelectorAll("nav button").forEach((other) => other.removeAttribute("aria-current"));
        button.setAttribute("aria-current", "page");
        scrollTo(0, 0);
        this.adopt();
      };
    }
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.adopt());
    new ResizeObserver(() => this.adopt()).observe(byId("feet"));

    const is_supported = BluetoothTransport.isSupported();
    byId("unsupported").hidden = is_supported;
    for (const id of ["connect", "add"]) {
      const button = byId(id, HTMLButtonElement);
      button.disabled = !is_supported;
      button.onclick = () => void this.bluetooth();
    }
    byId("walk").onclick = () => void this.replay(COMPUTED_WALK);
    const quantity = byId("quantity", HTMLSelectElement);
    quantity.onchange = () => {
      this.quantity = QUANTITIES.find((known) => known === quantity.value) ?? "measured";
      this.tick();
    };
    this.listenToSettings();

    byId("record").onclick = () => {
      if (this.recorder.isRecording) this.recorder.stop();
      else this.recorder.start(performance.now(), this.hellos);
      this.tick();
    };
    byId("export-live").onclick = () => download("plantar_live.csv", "text/csv", liveCsv(this.recorder.entries(), this.wire));
    byId("export-stream").onclick = () => download("walk.plantar", "application/octet-stream", this.recorder.file());
    byId("export-steps").onclick = () => download("plantar_steps.csv", "text/csv", stepsCsv(this.store.steps));
    byId("clear").onclick = () => {
      if (!confirm("Delete all steps that are kept here? Export them first if you need them.")) return;
      void this.store.clear().then(() => {
        this.lastEllipses();
        this.stepsChanged();
      });
    };
  }

  private listenToSettings(): void {
    const { settings } = this;
    const mass = byId("mass", HTMLInputElement);
    const mass_unit = byId("mass-unit", HTMLSelectElement);
    const force_unit = byId("force-unit", HTMLSelectElement);
    const per_unit = () => (settings.mass_unit === "lb" ? KG_PER_LB : 1);
    const show = () => (mass.value = settings.body_mass_kg === null ? "" : (settings.body_mass_kg / per_unit()).toFixed(1));
    mass_unit.value = settings.mass_unit;
    force_unit.value = settings.force_unit;
    show();
    const changed = () => {
      saveSettings(localStorage, settings);
      this.tick();
      this.stepsChanged();
    };
    mass.oninput = () => {
      const value = mass.valueAsNumber;
      settings.body_mass_kg = value > 0 ? value * per_unit() : null;
      changed();
    };
    mass_unit.onchange = () => {
      settings.mass_unit = mass_unit.value === "lb" ? "lb" : "kg";
      show();
      changed();
    };
    force_unit.onchange = () => {
      settings.force_unit = force_unit.value === "%BW" ? "%BW" : "N";
      changed();
    };
  }
}
