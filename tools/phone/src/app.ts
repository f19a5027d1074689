/** The page: passes the messages of the insoles to the storage of the steps and to the views. */

import { Alerts, drawAlerts } from "./alerts";
import { store } from "./browser_storage";
import { dayOf } from "./days";
import { type Node, RELOAD, byId, fill } from "./dom";
import { errorText } from "./format";
import type { Live, Side } from "./generated/quantities";
import { IdentifyController } from "./identify_controller";
import { Insoles } from "./insoles";
import { LiveView } from "./live_view";
import { problems, remarks } from "./notes";
import { Recorder } from "./recorder";
import { type RecordMessage, type Session, recordOf } from "./session";
import { followSettings, loadSettings } from "./settings";
import { INSOLES_COUNT, listenToExport, listenToSettings, updateSettingsView } from "./settings_view";
import { SIDES } from "./side";
import { DatabaseStorage, NoStorage, type StoredRecord, type RecordStorage, TemporaryStorage } from "./record_storage";
import { StepStore, keyedRecord } from "./step_store";
import { drawBouts, drawDays, drawSteps } from "./steps_view";
import { BluetoothTransport, NONE_CHOSEN, explain } from "./transport/bluetooth";
import { ReplayTransport } from "./transport/replay";
import type { Transport } from "./transport/transport";
import { WebSocketTransport } from "./transport/websocket";
import { showView } from "./views";
import { gaitOf } from "./walk";
import type { Wire } from "./wire";

/**
 * True for localhost and IP addresses, at which `plantar serve` usually serves the page. A server with a domain name is assumed
 * to have no insoles.
 */
const isAddress = (host: string) => host === "localhost" || /^[\d.]+$|^\[/.test(host);
/** Time between two updates of the sessions and of the texts on the page. */
const UPDATE_MS = 100;
/** Least time between two updates of the steps view, which take up to 0.1 s on a slow phone. */
const STEPS_MS = 1000;
/** The key under which the browser stores the time of the last deletion of the wearer's data. Other tabs notice its change. */
const CLEARED_KEY = "plantar.cleared_ms";
/** The beginning of 2020, s since 1970. A clock that shows an earlier time was not set. */
const SET_CLOCK_UNIX_S = 1_577_836_800;
/** Interval of the attempts to store the records that could not be stored. */
const STORE_RETRY_MS = 5000;
/** The example: a recording of a computed walk. */
const COMPUTED_WALK = "./walk.plantar";
const NO_WALK = "The example walk could not be loaded. Connect this device to the internet, then try again.";
const INSECURE = "Bluetooth works only over HTTPS or at localhost.";
const RELOADING_DISCONNECTS = " Reloading ends the connection: choose your insoles again afterwards.";
const CANNOT_STORE =
  "This browser cannot store steps, because its storage is full or not allowed, or because a newer version of this page " +
  "is open in another tab. Free some storage, allow it for this site, or reload this page. Until then, the insole stores " +
  "your steps, and alerts may not arrive.";
const DELETED = `All steps and loads on this device are deleted. ${INSOLES_COUNT}`;
const OTHER_TAB =
  "An older version of this page is open in another tab. Close all other tabs of this page; this one continues then.";

/** The page. */
export class App {
  private readonly settings = loadSettings(() => localStorage);
  private readonly recorder = new Recorder();
  private readonly insoles: Insoles;
  private readonly live_view: LiveView;
  private readonly identify: IdentifyController;
  private readonly alerts: Alerts;
  private store: StepStore;
  /**
   * Resolves once the stored data that are being loaded, if any, are available. Records that arrived earlier would be stored in
   * memory only.
   */
  private loaded = Promise.resolve();
  /** True if `store` is that of the wearer, or will be once `loaded` resolves. */
  private is_of_wearer = false;
  /** The last error, as a sentence for the wearer; empty without an error. */
  private problem = "";
  private store_retried_ms = 0;
  /** The time at which the recording that is played was loaded. */
  private loaded_unix_s = 0;
  /** True if the steps view does not show the present records. */
  private is_outdated = false;
  private steps_drawn_ms = -Infinity;
  /** True if the steps view shows all days, and not only the last ones. */
  private shows_all_days = false;
  /** True if a newer version of the page is loaded with the next reload. */
  private has_update = false;
  /** True if the wearer has chosen to reload the page. */
  private is_reloading = false;
  /** The element that received the focus last; `undefined` if the focus has left it since. */
  private focused: Element | undefined;
  /** The day on which the steps view was updated last. */
  private drawn_day = "";

  constructor(private readonly wire: Wire) {
    this.live_view = new LiveView(wire.facts);
    this.store = new StepStore(wire, new TemporaryStorage());
    this.insoles = new Insoles(wire, this.recorder, {
      live: (live: Live, side: Side) => {
        this.live_view.frame(live, side);
        this.identify.live(side, live);
      },
      shape: ({ ellipses, sole }, side) => this.live_view.shape(side, ellipses, sole),
      record: this.onRecord,
      isKnown: (message) => this.store.has(message),
      answer: (answer, session) => {
        this.alerts.answered(answer, session);
        const { hello } = session;
        if (hello && this.identify.insoleAnswer(hello.side, answer)) hello.has_parameters = true;
      },
      message: (bytes, side) => this.identify.message(side, bytes),
    });
    this.identify = new IdentifyController(this.insoles, this.settings);
    this.alerts = new Alerts(wire, this.insoles, this.settings);
  }

  /**
   * Plays the recording that the address of the page names. Without one, loads the stored data and connects to the insoles of
   * `plantar serve`, or offers the choice of an insole.
   */
  async start(): Promise<void> {
    this.listen();
    void this.showPersistence((storage) => storage.persisted?.());
    const query = new URLSearchParams(location.search);
    const replay = query.get("replay");
    if (replay !== null) void this.replay(replay);
    else {
      await this.loadStored();
      if (query.has("serve") || (isAddress(location.hostname) && !query.has("bluetooth"))) this.serve();
      else byId("start").hidden = false;
    }
    setInterval(() => this.tick(), UPDATE_MS);
    this.tick();
  }

  /** Shows whether another tab blocks the browser's database. */
  private readonly databaseBlocked = (is_blocked: boolean): void => {
    if (is_blocked === (this.problem === OTHER_TAB)) return;
    this.problem = is_blocked ? OTHER_TAB : "";
    this.tick();
  };

  /** Loads what earlier visits have stored: the wearer's steps, and an interrupted guided session. */
  private loadStored(): Promise<void> {
    this.is_of_wearer = true;
    this.loaded = this.loadSteps().then(() => this.identify.load(this.databaseBlocked));
    return this.loaded;
  }

  /** Loads and shows the wearer's steps of earlier visits. */
  private async loadSteps(): Promise<void> {
    const keyed = (record: StoredRecord) => keyedRecord(this.wire, record);
    const storage: RecordStorage = await DatabaseStorage.open(keyed, this.databaseBlocked).catch(() => new NoStorage());
    const store = new StepStore(this.wire, storage);
    // A storage that cannot be read is not used: the insoles still store the steps.
    const is_loaded = await store.load().then(() => true, () => false);
    this.show(is_loaded ? store : new StepStore(this.wire, new NoStorage()));
    this.alerts.restore(this.store.latest.alerts);
  }

  /** Uses this store from now on, and shows its records. */
  private show(store: StepStore): void {
    this.store = store;
    this.stepsChanged();
  }

  /**
   * True if the page is in a frame of another page; then also shows a message. There, this page has a store of its own, and steps
   * that it acknowledges would be lost for the wearer.
   */
  private isFramed(): boolean {
    if (window.top === window) return false;
    this.inform("This page does not connect to insoles while another page shows it in a frame. Open it in a tab of its own.");
    return true;
  }

  /** Connects to the insoles of `plantar serve`. */
  private serve(): void {
    if (this.isFramed()) return;
    const url = new URL("insoles", location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    url.search = "";
    this.use(new WebSocketTransport(url.href, this.insoles.transportEvents));
  }

  /** Plays the recording at `url`. */
  private async replay(url: string): Promise<void> {
    const { transport: before } = this.insoles;
    // The wearer may connect insoles while the recording is loaded.
    const is_replaced = () => this.insoles.transport !== before;
    this.problem = "";
    try {
      await this.loaded;
      const transport = await ReplayTransport.load(url, this.insoles.transportEvents);
      if (is_replaced()) return transport.close();
      this.loaded_unix_s = Date.now() / 1000;
      this.is_of_wearer = false;
      this.show(StepStore.ofRecording(this.wire));
      this.identify.useRecording();
      this.use(transport);
    } catch (error) {
      if (is_replaced()) return;
      this.problem = url === COMPUTED_WALK ? NO_WALK : errorText(error);
      // In a temporary storage, the steps of insoles that are connected next would be acknowledged and then lost.
      await this.loadStored();
      byId("start").hidden = false;
    }
  }

  /** Lets the wearer choose an insole, and connects it over Bluetooth. */
  private async bluetooth(): Promise<void> {
    if (this.isFramed()) return;
    const { transport: before } = this.insoles;
    const { gatt } = this.wire.facts;
    const transport = before instanceof BluetoothTransport ? before : new BluetoothTransport(gatt, this.insoles.transportEvents);
    try {
      this.problem = "";
      // If the wearer cancels the choice, the insoles in use or the recording continue.
      const device = await transport.choose();
      if (transport !== this.insoles.transport) this.use(transport);
      // The data of a recording, which may still be loading, are replaced by the wearer's.
      if (!this.is_of_wearer) void this.loadStored();
      await this.loaded;
      await transport.connect(device);
    } catch (error) {
      if (this.insoles.transport === transport) byId("start").hidden = this.insoles.sessions.some(({ hello }) => hello);
      this.inform(explain(error));
    }
    this.tick();
  }

  /** Shows an error or the result of an action of the wearer, who may not see the top of the page. */
  private inform(problem: string): void {
    this.problem = problem;
    this.tick();
    byId("notes").focus();
  }

  /** Replaces the transport of the insoles. */
  private use(transport: Transport): void {
    this.insoles.use(transport);
    if (!transport.is_replay) void this.showPersistence((storage) => storage.persist?.());
    this.live_view.reset();
    byId("start").hidden = true;
  }

  /**
   * Shows whether the browser may delete the stored records, for example if the disk is nearly full. Not every browser can make
   * them persistent. `ask` asks the browser whether they are; `undefined` if it cannot answer, as over HTTP.
   */
  private async showPersistence(ask: (storage: StorageManager) => Promise<boolean> | undefined): Promise<void> {
    const { storage } = navigator as { storage?: StorageManager };
    byId("store-note").hidden = (storage && (await ask(storage)?.catch(() => false))) ?? false;
  }

  /** Stores and shows a record, and acknowledges it once it is stored. */
  private readonly onRecord = (message: RecordMessage, bytes: Uint8Array, session: Session): void => {
    if (message.kind === "step") this.identify.step(message.step.side, message.step, message.key);
    const { record, number } = recordOf(message);
    const mapping = record.boots_since === 0 ? session.clock_mapping : undefined;
    const mapped_unix_s = mapping?.unix_s(record.start_s) ?? record.start_unix_s;
    // The clock of a computed recording begins in 1970. The recording is shown as if it began when it was loaded.
    const is_computed = mapped_unix_s !== null && mapped_unix_s < SET_CLOCK_UNIX_S;
    const start_unix_s = is_computed ? this.loaded_unix_s + mapped_unix_s : mapped_unix_s;
    // An alert that the page has already stored is a repetition, because its acknowledgement was lost.
    if (message.kind === "alert" && !this.store.has(message)) this.alerts.raise(message.alert, start_unix_s, session.live?.t_s);
    const is_comparable = session.has_exact_time && mapping?.is_comparable(record.start_s);
    this.store.add(message, bytes, start_unix_s, is_comparable).then(
      () => {
        session.acknowledge(number);
        if (this.problem === CANNOT_STORE) this.problem = "";
      },
      // The record is not acknowledged, so the insole still stores it, and sends it again in its next session.
      () => {
        session.unstored = number;
        this.problem = CANNOT_STORE;
      },
    );
    this.is_outdated = true;
    this.updateExport();
  };

  /**
   * Tries to store the records that could not be stored, and acknowledges them. Once an insole has sent the few unacknowledged
   * records that it holds in RAM, it sends no further ones, so the next record cannot be awaited.
   */
  private retryStoring(now_ms: number): void {
    if (now_ms - this.store_retried_ms < STORE_RETRY_MS) return;
    this.store_retried_ms = now_ms;
    this.store.retry().then(
      () => {
        for (const session of this.insoles.sessions) {
          if (session.unstored !== undefined) session.acknowledge(session.unstored);
        }
        if (this.problem === CANNOT_STORE) this.problem = "";
      },
      () => (this.problem ||= CANNOT_STORE),
    );
  }

  /**
   * Shows the stored records and their measures. To be called after a change of the settings or the day, and after the records
   * were loaded or deleted. A new record only sets `is_outdated`; `update` then calls this function once the steps view is
   * visible and an update is due.
   */
  private stepsChanged(): void {
    const { latest, days } = this.store;
    // The width of the diagram is known only while it is visible.
    this.is_outdated = byId("steps").offsetParent === null;
    this.steps_drawn_ms = performance.now();
    this.drawn_day = dayOf(Date.now() / 1000);
    // A recording is neither of today nor stored, and the wearer's stride length is not that of its walk.
    const is_replay = this.insoles.transport?.is_replay ?? false;
    const shown = [...days.values()].filter(({ day }) => is_replay || day === this.drawn_day);
    const counts = SIDES.map((side) => shown.reduce((sum, totals) => sum + totals[side].steps, 0));
    const stride_cm = is_replay ? null : this.settings.stride_cm;
    const gait = gaitOf(this.wire, latest, { ...this.settings, stride_cm });
    drawSteps(latest.steps, counts, is_replay ? undefined : this.store.count("steps"), gait, this.settings);
    drawDays([...days.values()], this.shows_all_days, this.settings);
    drawBouts(latest.bouts);
    drawAlerts(latest.alerts);
    this.updateExport();
  }

  /** Enables the buttons that export records if there are any. */
  private updateExport(): void {
    for (const kind of ["steps", "bouts"] as const) {
      byId(`export-${kind}`, HTMLButtonElement).disabled = this.store.count(kind) === 0;
    }
    byId("export-days", HTMLButtonElement).disabled = this.store.days.size === 0;
  }

  /** Deletes the stored records, and the messages of an interrupted guided session. Rejects if some of them remain. */
  private async clear(): Promise<void> {
    this.alerts.forget();
    const deleted = await Promise.allSettled([this.store.clear(), this.identify.deleteStored()]);
    this.stepsChanged();
    // Other tabs show what remains.
    store(() => localStorage, CLEARED_KEY, String(Date.now()));
    for (const result of deleted) if (result.status === "rejected") throw result.reason;
    this.inform(DELETED);
  }

  private tick(): void {
    const now_ms = performance.now();
    this.insoles.tick(now_ms);
    this.identify.tick(now_ms);
    this.retryStoring(now_ms);
    this.alerts.sendPauses();
    this.alerts.follow();
    // `followTimeZone` may send rules of alerts. A refusal does not name its request, so while the answer to new parameters is
    // awaited, a refusal of the rules would be taken for a refusal of the parameters.
    if (!this.identify.awaits_answer) this.alerts.followTimeZone();
    // While the page is in the background, the sessions continue, but the texts are not visible.
    if (!document.hidden) this.update(now_ms);
  }

  /** True while an insole is in use over Bluetooth. */
  private get uses_bluetooth(): boolean {
    const { transport } = this.insoles;
    return transport instanceof BluetoothTransport && !transport.is_idle;
  }

  private update(now_ms: number): void {
    const { insoles, live_view } = this;
    if (insoles.transport instanceof WebSocketTransport) {
      // A plain web server at localhost has no insoles: then the page offers Bluetooth and the example walk.
      byId("start").hidden = !insoles.sessions.every(({ state, reason }) => state === "closed" && reason);
    }
    live_view.update(insoles, this.settings);
    // New records are drawn only while the steps view is visible, so that drawing them does not slow the live view.
    const is_visible = byId("steps").offsetParent !== null;
    const is_due = this.is_outdated && is_visible && now_ms - this.steps_drawn_ms >= STEPS_MS;
    if (is_due || dayOf(Date.now() / 1000) !== this.drawn_day) this.stepsChanged();
    updateSettingsView(insoles, this.recorder, now_ms);
    const is_replay = insoles.transport?.is_replay ?? false;
    byId("clear", HTMLButtonElement).disabled = is_replay || (this.store.days.size === 0 && !this.identify.has_stored);
    byId("clear-note").hidden = !is_replay;
    const linked = insoles.sessions.filter(({ state }) => state !== "closed");
    byId("connect-other").hidden = !(insoles.transport instanceof BluetoothTransport) || linked.length !== 1;
    this.alerts.update();
    fill("chips", SIDES.flatMap((side) => {
      const session = insoles.of(side);
      if (!session) return [];
      const { state } = session;
      const rate = session.is_resting ? "rests" : `${session.rate_hz(now_ms).toFixed(0)} Hz`;
      const text = state === "live" ? rate : state === "lost" ? "lost" : "…";
      return [["span", { class: side }, `${side === "left" ? "L" : "R"} ${text}`]];
    }));
    // An error of the browser or a fault of the firmware may contain the word, too.
    const reloadFor = (text: string) => (/reload th(e|is) page/i.test(text) ? [RELOAD] : []);
    const update = `A new version of this page is ready.${this.uses_bluetooth ? RELOADING_DISCONNECTS : ""}`;
    const keyed = (kind: string, text: string, ...more: Node[]): Node => ["p", { class: kind, "data-key": text }, text, ...more];
    const connected = insoles.transport?.is_replay ? [] : SIDES.filter((side) => insoles.of(side)?.state === "live");
    // Without these two texts, the wearer would not know why the page stores nothing.
    const is_lasting = [OTHER_TAB, CANNOT_STORE].includes(this.problem);
    const close: Node = ["button", { "data-action": "close-error" }, "Close this message"];
    fill("notes", [
      ...(this.problem
        ? [["div", { class: [NONE_CHOSEN, DELETED].includes(this.problem) ? "note remark" : "note" },
            this.problem, ...reloadFor(this.problem), ...(is_lasting ? [] : [close])] as Node]
        : []),
      ...this.alerts.problems(),
      ...problems(insoles, live_view, this.wire.facts).map((text) => keyed("note", text, ...reloadFor(text))),
      ...(this.has_update && !this.identify.is_running ? [keyed("note remark", update, RELOAD)] : []),
      ...connected.map((side) => keyed("spoken", `The ${side} insole is connected.`)),
      ...remarks(insoles, this.alerts.pauseTexts(), this.wire.facts),
    ]);
    this.replaceFocus();
  }

  /** Moves the focus to the heading of the guided session or to the notes if the element that had it has disappeared. */
  private replaceFocus(): void {
    const { activeElement, body } = document;
    if (activeElement !== body) return;
    if (this.focused?.getClientRects().length === 0) {
      const heading = body.dataset["view"] === "identify" ? byId("identify").querySelector("h2") : byId("notes");
      heading?.focus({ preventScroll: true });
    }
    this.focused = undefined;
  }

  /** Connects the buttons and the other events of the page. */
  private listen(): void {
    const show = (view = "live") => {
      showView(view);
      if (this.is_outdated) this.stepsChanged();
    };
    for (const button of document.querySelectorAll<HTMLButtonElement>("nav button")) {
      button.onclick = () => show(button.dataset["to"]);
    }
    addEventListener("popstate", () => show());
    addEventListener("resize", () => (this.is_outdated = true));
    addEventListener("focusin", ({ target }) => (this.focused = target instanceof Element ? target : undefined));
    // After an update of the page, its new service worker replaces the former one. On the first visit, there is no former one.
    const { serviceWorker } = navigator as { serviceWorker?: ServiceWorkerContainer };
    let former = serviceWorker?.controller;
    serviceWorker?.addEventListener("controllerchange", () => {
      this.has_update ||= Boolean(former);
      former = serviceWorker.controller;
    });
    addEventListener("click", ({ target }) => {
      if (!(target instanceof Element) || !target.closest("[data-action=reload]")) return;
      this.is_reloading = true;
      location.reload();
    });
    const is_supported = BluetoothTransport.isSupported();
    const unsupported = byId("unsupported");
    unsupported.hidden = is_supported;
    if (!isSecureContext) fill(unsupported, [INSECURE]);
    if (!is_supported) byId("add-note").append(...[...unsupported.childNodes].map((node) => node.cloneNode(true)));
    for (const id of ["connect", "connect-other", "add"]) {
      const button = byId(id, HTMLButtonElement);
      button.disabled = !is_supported;
      button.onclick = () => void this.bluetooth();
    }
    byId("days-all").onclick = () => {
      this.shows_all_days = true;
      this.stepsChanged();
      // The button has disappeared.
      byId("days").focus({ preventScroll: true });
    };
    byId("walk").onclick = () => void this.replay(COMPUTED_WALK);
    byId("notes").onclick = ({ target }) => {
      const action = target instanceof HTMLElement ? target.dataset["action"] : undefined;
      if (action === "close-error") {
        this.problem = "";
        this.tick();
      } else if (action === "withdraw-alerts") {
        this.alerts.withdraw();
        this.tick();
      } else if (action === "leave-recording") {
        const url = new URL(location.href);
        url.searchParams.delete("replay");
        location.assign(url);
      }
    };
    byId("quantity").addEventListener("change", () => this.tick());
    document.addEventListener("visibilitychange", () => this.tick());
    // The browser asks before it discards a recording, or ends a connection by Bluetooth.
    addEventListener("beforeunload", (event) => {
      const is_connected = this.uses_bluetooth && !this.is_reloading;
      this.is_reloading = false;
      if (this.recorder.is_unsaved || is_connected) event.preventDefault();
    });
    this.alerts.listen();
    const showSettings = listenToSettings(this.settings, () => {
      this.tick();
      this.stepsChanged();
    });
    followSettings(this.settings, () => {
      showSettings();
      this.alerts.showSettings();
      this.stepsChanged();
    });
    addEventListener("storage", ({ key }) => {
      if (key === CLEARED_KEY && !this.insoles.transport?.is_replay) {
        this.store.reload().then(() => this.stepsChanged(), () => undefined);
        void this.identify.reload();
      }
    });
    const failed = (problem: string) => this.inform(problem);
    listenToExport(this.wire, this.recorder, this.insoles, () => this.store, () => this.clear(), failed);
    // Until here, a tap on one of the buttons would have been lost.
    document.querySelector("nav")?.removeAttribute("inert");
  }
}
