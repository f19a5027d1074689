/** Connects the guided session with the insoles, the worker, the storage and the buttons of its view. */

import { PhoneCues, ScreenWakeLock } from "./cues";
import { byId, download, fill } from "./dom";
import type { Live, Side, Step } from "./generated/quantities";
import { TARGET_STEPS } from "./identify_rules";
import { IdentifySession, type IdentifyStorage } from "./identify_session";
import { DatabaseIdentifyStorage } from "./identify_storage";
import { drawIdentify } from "./identify_view";
import type { Answer, Request } from "./identify_worker";
import { failureOf } from "./indexed_db";
import type { Insoles } from "./insoles";
import { type InsoleAnswer, totalForce } from "./session";
import { type Settings, saveSettings } from "./settings";
import { SIDES } from "./side";
import { showView } from "./views";

/** The storage that is used if the browser has no database. It stores nothing. */
const NO_STORAGE: IdentifyStorage = {
  load: () => Promise.resolve([]),
  add: () => Promise.reject(failureOf(null)),
  clear: () => Promise.resolve(),
};

/** The storage for the session of a recording. It stores nothing, because the wearer cannot continue it at the next visit. */
const RECORDING: IdentifyStorage = { ...NO_STORAGE, add: () => Promise.resolve() };

/** The name of the Web Lock that a tab holds while it has a guided session of the wearer. */
const LOCK = "plantar-identify";
/** Time between two checks of whether another tab holds this lock. */
const LOCK_MS = 1000;

/** The question before the stored messages of an interrupted session are deleted. */
const DELETE_STORED = "Delete the steps of the interrupted session?";
/** The message if stored messages were not deleted, because they are those of another tab. */
export const NOT_DELETED = "The steps of the identification in another tab were not deleted. Close it there to delete them.";

/** The guided session of the page. */
export class IdentifyController {
  private readonly session: IdentifySession;
  private storage: IdentifyStorage = NO_STORAGE;
  /** The messages of a session that was interrupted before this visit. */
  private stored: Uint8Array<ArrayBuffer>[] = [];
  private worker: Worker | undefined;
  private readonly screen = new ScreenWakeLock();
  /** The Web Locks; `undefined` if the browser has none, or does not allow them. */
  private locks: LockManager | undefined = navigator.locks;
  /** True while this tab holds the lock. */
  private is_holding = false;
  /** True if another tab has a guided session of the wearer. */
  private is_elsewhere = false;
  /** Time at which this was checked last. */
  private looked_ms = -Infinity;
  /** Releases the lock; `undefined` while this tab has no guided session. */
  private unlock: (() => void) | undefined;

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
      isRadio: () => insoles.transport?.is_radio ?? false,
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
    if (this.storage === RECORDING) {
      this.session.close();
      this.release();
    }
    this.storage = await DatabaseIdentifyStorage.open(blocked).catch(() => NO_STORAGE);
    this.stored = await this.storage.load().catch(() => []);
    await this.look();
    if (this.has_stored && !this.is_elsewhere) this.show();
  }

  /** True if the messages of a session that was interrupted before this visit are stored. */
  get has_stored(): boolean {
    return this.stored.length > 0;
  }

  /**
   * True while the answers of the insoles to the new parameters are awaited. No other request that an insole may refuse is to be
   * sent meanwhile: a refusal does not name its request.
   */
  get awaits_answer(): boolean {
    return this.session.phase === "push";
  }

  /** True while the wearer is in a guided session. */
  get is_running(): boolean {
    return !["closed", "done", "failed"].includes(this.session.phase);
  }

  /**
   * Deletes the stored messages, unless they are those of a running session of this tab. Rejects with {@link NOT_DELETED} if
   * another tab has a session.
   */
  async deleteStored(): Promise<void> {
    if (this.is_running) return;
    await this.locked(async () => {
      await this.storage.clear();
      this.stored = [];
    });
    if (this.is_elsewhere) throw new Error(NOT_DELETED);
  }

  /** Loads the messages of an interrupted session again, which another tab may have stored or deleted. */
  async reload(): Promise<void> {
    const { storage } = this;
    // Without locks, these could be the messages of a session that runs in another tab.
    if (!this.locks && !this.has_stored) return;
    const stored = await storage.load().catch(() => this.stored);
    // Meanwhile, the wearer may have continued the session, begun another one, or loaded a recording.
    if (this.session.phase === "closed" && this.storage === storage) this.stored = stored;
  }

  /**
   * Calls `act` unless another tab holds the lock, and holds the lock until the promise of `act` is settled. The session of a
   * recording, which is not stored, needs no lock; nor does a browser without locks, in which tabs are not distinguished.
   */
  private async locked(act: () => Promise<void>): Promise<void> {
    const { locks } = this;
    if (!locks || this.unlock || this.storage === RECORDING) return act();
    let is_answered = false;
    let is_granted = false;
    try {
      await locks.request(LOCK, { ifAvailable: true }, (lock) => {
        is_answered = true;
        if (lock) this.is_holding = is_granted = true;
        // After a second click, the lock is that of the first one.
        this.is_elsewhere = !this.is_holding;
        return lock ? act() : undefined;
      });
    } catch (error) {
      if (is_answered) throw error;
      this.locks = undefined;
      this.is_elsewhere = false;
      await act();
    } finally {
      if (is_granted) this.is_holding = false;
    }
  }

  /** Begins a guided session by `begin`, unless another tab has one. */
  private begin(hellos: ReadonlyMap<Side, Uint8Array>, begin: () => Promise<void> | void): void {
    // The last insole may have been disconnected since the view was drawn.
    if (hellos.size === 0) return;
    void this.locked(async () => {
      await begin();
      const is_begun = this.session.phase !== "closed";
      if (is_begun) this.stored = [];
      this.redraw();
      // If this tab still holds the lock, that of a session that has just been closed, it continues to hold it.
      if (is_begun) await new Promise<void>((resolve) => (this.unlock ??= resolve));
    });
  }

  /** Continues the interrupted session. Another tab may have changed its messages since they were loaded. */
  private async resume(hellos: ReadonlyMap<Side, Uint8Array>): Promise<void> {
    await this.reload();
    if (!this.has_stored || this.session.phase !== "closed") return;
    this.session.resume(this.stored, hellos, performance.now(), Date.now());
  }

  /**
   * Looks whether another tab has a guided session. After the end of that session, loads what remains of it. Releases the lock
   * after the end of the session of this tab.
   */
  private async look(): Promise<void> {
    const state = await this.locks?.query().catch(() => (this.locks = undefined));
    const is_other = !this.is_holding && this.storage !== RECORDING;
    const was_elsewhere = this.is_elsewhere;
    this.is_elsewhere = (is_other && state?.held?.some(({ name }) => name === LOCK)) ?? false;
    if (was_elsewhere && !this.is_elsewhere) await this.reload();
    if (this.session.phase === "closed") this.release();
  }

  /** Releases the lock. */
  private release(): void {
    this.unlock?.();
    this.unlock = undefined;
  }

  /** Opens the view of the guided session. */
  private show(): void {
    showView("identify");
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
    const hellos = this.hellos();
    switch (action) {
      case "start":
        if (!this.has_stored || hellos.size === 0 || confirm(DELETE_STORED)) {
          this.begin(hellos, () => session.start(hellos, performance.now(), Date.now()));
        }
        break;
      case "discard":
        // If the deletion fails, the session is still offered.
        if (confirm(DELETE_STORED)) void this.deleteStored().catch(() => undefined);
        break;
      case "resume":
        this.begin(hellos, () => this.resume(hellos));
        break;
      case "finish":
        if (confirm(`Finish the walk before there are ${TARGET_STEPS} steps of each foot?`)) session.finishWalk();
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
      case "export":
        download("identification.plantar", "application/octet-stream", session.file());
        break;
      default:
        this.exportParameters(action);
    }
    this.redraw();
  }

  /** Draws the view after an action, which may have removed the button that had the focus. */
  private redraw(): void {
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

  /** Handles the answer of an insole to a request. Returns true if the insole uses new parameters. */
  insoleAnswer(side: Side, answer: InsoleAnswer): boolean {
    return this.session.insoleAnswer(side, answer, performance.now());
  }

  /** To be called a few times a second. */
  tick(now_ms: number): void {
    this.session.tick(now_ms, SIDES.filter((side) => this.insoles.of(side)?.state !== "live"));
    const needs_screen = this.session.isCollecting || this.session.phase === "verify";
    if (needs_screen) this.screen.hold();
    else this.screen.release();
    if (this.session.phase === "closed" && now_ms - this.looked_ms >= LOCK_MS) {
      this.looked_ms = now_ms;
      void this.look();
    }
    const is_interrupted = this.has_stored && this.session.phase === "closed";
    fill("identify-open", [is_interrupted || this.is_running ? "Continue the identification" : "Identify my tissue"]);
    if (!document.hidden && document.body.dataset["view"] === "identify") this.draw();
  }

  private draw(): void {
    const { insoles, has_stored, is_elsewhere } = this;
    const { shoe_size } = this.settings;
    drawIdentify(this.session, { insoles, shoe_size, has_stored, is_elsewhere, now_ms: performance.now() });
  }
}
