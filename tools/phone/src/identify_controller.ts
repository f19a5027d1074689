/** Connects the guided session with the insoles, the worker, the storage and the buttons of its view. */

import { PhoneCues, ScreenLock } from "./cues";
import { byId, download, fill } from "./dom";
import type { Live, Side, Step } from "./generated/quantities";
import { IdentifySession, type IdentifyStorage } from "./identify_session";
import { DatabaseIdentifyStorage } from "./identify_storage";
import { drawIdentify } from "./identify_view";
import type { Answer, Request } from "./identify_worker";
import type { Insoles } from "./insoles";
import { type InsoleAnswer, totalForce } from "./session";
import { type Settings, saveSettings } from "./settings";
import { SIDES } from "./side";

/** The storage that is used if the browser has no database. It stores nothing. */
const NO_STORAGE: IdentifyStorage = {
  load: () => Promise.resolve([]),
  add: () => Promise.reject(new Error("This browser has no database.")),
  clear: () => Promise.resolve(),
};

/** The storage for the session of a recording. It stores nothing, because the wearer cannot continue it at the next visit. */
const RECORDING: IdentifyStorage = { ...NO_STORAGE, add: () => Promise.resolve() };

/** The question before the stored messages of an interrupted session are deleted. */
const DELETE_STORED = "Delete the steps of the interrupted session?";

/** The guided session of the page. */
export class IdentifyController {
  private readonly session: IdentifySession;
  private storage: IdentifyStorage = NO_STORAGE;
  /** The messages of a session that was interrupted before this visit. */
  private stored: Uint8Array<ArrayBuffer>[] = [];
  private worker: Worker | undefined;
  private readonly screen = new ScreenLock();

  constructor(
    private readonly insoles: Insoles,
    private readonly settings: Settings,
  ) {
    const storage: IdentifyStorage = {
      load: () => this.storage.load(),
      add: (part) => this.storage.add(part),
      clear: () => this.storage.clear(),
    };
    this.session = new IdentifySession({
      solve: (request) => this.solve(request),
      send: (side, message) => insoles.of(side)?.send(message),
      cues: new PhoneCues(),
      storage,
      size: () => settings.shoe_size,
    });
    byId("identify-open").onclick = () => this.show();
    byId("identify-body").onclick = ({ target }) => {
      const action = target instanceof Element ? target.closest<HTMLElement>("[data-action]")?.dataset["action"] : undefined;
      if (action) this.act(action);
    };
    byId("identify-body").onchange = ({ target }) => {
      if (!(target instanceof HTMLSelectElement)) return;
      settings.shoe_size = Number(target.value);
      saveSettings(() => localStorage, settings);
    };
  }

  /** To be called when a recording is played instead of insoles. */
  useRecording(): void {
    this.storage = RECORDING;
    this.stored = [];
  }

  /**
   * Ends the session of a recording, loads the messages of an interrupted session of the wearer, and offers to continue it.
   * `openDatabase` describes `blocked`.
   */
  async load(blocked: (is_blocked: boolean) => void): Promise<void> {
    if (this.storage === RECORDING) this.session.close();
    this.storage = await DatabaseIdentifyStorage.open(blocked).catch(() => NO_STORAGE);
    this.stored = await this.storage.load().catch(() => []);
    if (this.has_stored) this.show();
  }

  /** True if the messages of a session that was interrupted before this visit are stored. */
  get has_stored(): boolean {
    return this.stored.length > 0;
  }

  /** True while the insoles are to answer that they use the new parameters. A refusal does not name its request. */
  get awaits_answer(): boolean {
    return this.session.phase === "push";
  }

  /** Deletes the stored messages, unless they are those of a running session. */
  async deleteStored(): Promise<void> {
    if (!["closed", "done", "failed"].includes(this.session.phase)) return;
    await this.storage.clear();
    this.stored = [];
  }

  /** Looks whether another tab has deleted the messages of the interrupted session, which is then no longer offered. */
  async reload(): Promise<void> {
    const stored = await this.storage.load().catch(() => this.stored);
    // Meanwhile, the wearer may have continued the session, or begun another one.
    if (this.has_stored) this.stored = stored;
  }

  /** Opens the view of the guided session. */
  private show(): void {
    document.body.dataset["view"] = "identify";
    document.querySelectorAll("nav button").forEach((button) => button.removeAttribute("aria-current"));
    scrollTo(0, 0);
    this.draw();
    this.focusHeading();
  }

  /** Moves the focus to the heading: the button that had it is not visible any more. */
  private focusHeading(): void {
    byId("identify").querySelector("h2")?.focus();
  }

  /** Passes a request to the worker, which is started if it does not run. */
  private solve(request: Request): void {
    if (!this.worker) {
      this.worker = new Worker(new URL("./identify_worker.ts", import.meta.url), { type: "module" });
      this.worker.onmessage = ({ data }: MessageEvent<Answer>) => {
        if (data.kind === "failed") this.endWorker();
        this.session.answer(data, performance.now());
      };
      const reason = "The computation could not start.";
      this.worker.onerror = () => {
        this.endWorker();
        this.session.answer({ kind: "failed", reason, needs_reload: true }, performance.now());
      };
    }
    this.worker.postMessage(request);
  }

  /** Ends a worker that has failed; the next request starts another one. */
  private endWorker(): void {
    this.worker?.terminate();
    this.worker = undefined;
  }

  /** The hello messages of the connected insoles by foot. */
  private hellos(): Map<Side, Uint8Array> {
    return new Map(SIDES.flatMap((side): [Side, Uint8Array][] => {
      const session = this.insoles.of(side);
      const hello = session?.state === "live" ? this.insoles.hellos.get(session.insole) : undefined;
      return hello ? [[side, hello]] : [];
    }));
  }

  /** Executes the action of a button of the view. */
  private act(action: string): void {
    const { session } = this;
    switch (action) {
      case "start":
        // The last insole may have been disconnected since the view was drawn.
        if (this.hellos().size === 0) return this.draw();
        if (this.has_stored && !confirm(DELETE_STORED)) return;
        session.start(this.hellos(), performance.now(), Date.now());
        this.stored = [];
        break;
      case "discard":
        // If the deletion fails, the session is still offered.
        if (confirm(DELETE_STORED)) void this.deleteStored().catch(() => undefined);
        break;
      case "resume":
        if (this.hellos().size === 0) return;
        session.resume(this.stored, this.hellos(), performance.now(), Date.now());
        this.stored = [];
        break;
      case "finish":
        session.finishWalk();
        break;
      case "push":
        session.push(performance.now());
        break;
      case "skip":
        session.finish();
        break;
      case "close":
        if (session.phase !== "done" && !confirm("End the session and delete its steps?")) return;
        session.close();
        document.querySelector<HTMLButtonElement>("nav [data-to=live]")?.click();
        break;
      case "connect":
        document.querySelector<HTMLButtonElement>("nav [data-to=settings]")?.click();
        byId("add").scrollIntoView({ block: "center" });
        byId("add").focus();
        break;
      case "reload":
        return location.reload();
      case "export":
        download("identification.plantar", "application/octet-stream", session.file());
        break;
      default:
        this.exportParameters(action);
    }
    this.draw();
    if (document.activeElement === document.body) this.focusHeading();
  }

  private exportParameters(action: string): void {
    const foot = this.session.feet.find(({ side }) => action === `export-${side}`);
    if (foot?.result) download(`parameters_${foot.side}.toml`, "application/toml", [foot.result.parameters]);
  }

  /** Handles an encoded message of an insole. */
  message(side: Side, bytes: Uint8Array): void {
    this.session.message(side, bytes, Date.now());
  }

  live(side: Side, live: Live): void {
    const force_n = (other: Side) => {
      const last = this.insoles.of(other)?.live;
      return last ? totalForce(last) : 0;
    };
    this.session.live(side, live, performance.now(), force_n);
  }

  step(side: Side, step: Step, key: string): void {
    this.session.step(side, step, key, performance.now());
  }

  insoleAnswer(side: Side, answer: InsoleAnswer): boolean {
    return this.session.insoleAnswer(side, answer, performance.now());
  }

  /** To be called a few times a second. */
  tick(now_ms: number): void {
    this.session.tick(now_ms, SIDES.filter((side) => this.insoles.of(side)?.state !== "live"));
    const needs_screen = this.session.isCollecting || this.session.phase === "verify";
    if (needs_screen) this.screen.hold();
    else this.screen.release();
    fill("identify-open", [["closed", "done", "failed"].includes(this.session.phase) ? "Identify my tissue" : "Continue the identification"]);
    if (!document.hidden && document.body.dataset["view"] === "identify") this.draw();
  }

  private draw(): void {
    const state = { insoles: this.insoles, shoe_size: this.settings.shoe_size, has_stored: this.has_stored };
    drawIdentify(this.session, { ...state, now_ms: performance.now() });
  }
}
