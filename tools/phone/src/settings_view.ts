/** The settings view: the wearer, the connected insoles, recording and export. */

import { PART_ROWS, boutsCsv, daysCsv, liveCsv, stepsCsv } from "./csv";
import { dayOf, midnight_unix_s } from "./days";
import { type Node, byId, download, fill } from "./dom";
import { errorText } from "./format";
import { NOT_DELETED } from "./identify_controller";
import type { Insoles } from "./insoles";
import type { Recorder } from "./recorder";
import type { Session } from "./session";
import { KG_PER_LB, LIMITS, type Settings, isWithinLimits, saveSettings } from "./settings";
import { sideTitle } from "./side";
import type { Records, StepStore } from "./step_store";
import type { Wire } from "./wire";

/** What a deletion on this device does not change. A next wearer must not take this load for the own one. */
export const INSOLES_COUNT = "The insoles still count the load of today, and this page still shows it.";
const NOT_EXPORTED = "The browser could not save this file. Choose \"Export recording\" instead.";

/**
 * The number that the wearer has entered for a setting, with a decimal point or comma: Chromium drops the comma in a field of
 * type "number", so that 65,5 becomes 655. `factor` converts the number to the unit of the setting: `KG_PER_LB` for pounds.
 * Returns `null` if the field is empty, and `undefined` if its content is no number or out of range, which the note below the
 * field then states.
 */
function enteredNumber(field: HTMLInputElement, key: keyof typeof LIMITS, factor: number, unit: string): number | null | undefined {
  const text = field.value.trim();
  const value = Number(text.replace(",", ".")) * factor;
  const is_valid = isWithinLimits(key, value);
  const { min, max } = LIMITS[key];
  const is_empty = text === "";
  const limits = `Enter ${Math.ceil(min / factor)} to ${Math.floor(max / factor)} ${unit}. Other values are not used.`;
  fill(`${field.id}-note`, is_valid || is_empty ? [] : [limits]);
  field.setAttribute("aria-invalid", String(!is_valid && !is_empty));
  return is_valid ? value : is_empty ? null : undefined;
}

/** Removes the note that the content of a field is not valid. */
function clearError(field: HTMLInputElement): void {
  fill(`${field.id}-note`, []);
  field.setAttribute("aria-invalid", "false");
}

/**
 * Shows the wearer's settings in the form, and stores each change of the form. `changed` is called after each change. Returns a
 * function that shows the settings after a change in another tab.
 */
export function listenToSettings(settings: Settings, changed: () => void): () => void {
  const mass = byId("mass", HTMLInputElement);
  const stride = byId("stride", HTMLInputElement);
  const mass_unit = byId("mass-unit", HTMLSelectElement);
  const force_unit = byId("force-unit", HTMLSelectElement);
  const kg_factor = () => (settings.mass_unit === "lb" ? KG_PER_LB : 1);
  const showMass = () => (mass.value = settings.body_mass_kg === null ? "" : (settings.body_mass_kg / kg_factor()).toFixed(1));
  const showForceNote = () => {
    const is_missing = settings.force_unit === "%BW" && settings.body_mass_kg === null;
    fill("force-unit-note", is_missing ? ["Enter your body mass. Until then, forces are shown in newtons."] : []);
  };
  const show = () => {
    mass_unit.value = settings.mass_unit;
    force_unit.value = settings.force_unit;
    stride.value = settings.stride_cm === null ? "" : settings.stride_cm.toFixed(0);
    showMass();
    showForceNote();
    [mass, stride].forEach(clearError);
  };
  show();
  const save = () => {
    showForceNote();
    saveSettings(() => localStorage, settings);
    changed();
  };
  // While the wearer types, the value is not complete.
  for (const field of [mass, stride]) field.oninput = () => clearError(field);
  // A typing error does not delete the last valid value.
  mass.onchange = () => {
    const entered = enteredNumber(mass, "body_mass_kg", kg_factor(), settings.mass_unit);
    if (entered === undefined) return;
    settings.body_mass_kg = entered;
    save();
  };
  stride.onchange = () => {
    const entered = enteredNumber(stride, "stride_cm", 1, "cm");
    if (entered === undefined) return;
    settings.stride_cm = entered;
    save();
  };
  mass_unit.onchange = () => {
    settings.mass_unit = mass_unit.value === "lb" ? "lb" : "kg";
    showMass();
    clearError(mass);
    save();
  };
  force_unit.onchange = () => {
    settings.force_unit = force_unit.value === "%BW" ? "%BW" : "N";
    save();
  };
  return show;
}

/**
 * Connects the buttons that record, export and delete. `clear` deletes what is stored, and `failed` is called with a sentence for
 * the wearer if the browser's storage cannot be read or changed.
 */
export function listenToExport(
  wire: Wire,
  recorder: Recorder,
  insoles: Insoles,
  store: () => StepStore,
  clear: () => Promise<void>,
  failed: (problem: string) => void,
): void {
  const record = byId("record", HTMLButtonElement);
  record.onclick = () => {
    if (recorder.isRecording) recorder.stop();
    else if (!recorder.is_unsaved || confirm("The last recording was not exported. Replace it by a new one?")) {
      recorder.start(performance.now(), insoles.hellos);
      // The recording then contains how the parameters were identified.
      for (const session of insoles.sessions) if (session.state === "live") session.requestIdentified();
    }
    updateRecording(recorder, insoles);
  };
  byId("export-stream").onclick = () => {
    recorder.is_unsaved = false;
    download("walk.plantar", "application/octet-stream", recorder.file());
  };
  const nameOf = (what: string, since_unix_s: number | undefined) => {
    // The steps of a recording must not be mistaken for those of the wearer.
    const origin = insoles.transport?.is_replay ? "recording" : "plantar";
    return `${origin}_${what}${since_unix_s === undefined ? "" : `_from_${dayOf(since_unix_s)}`}.csv`;
  };
  /** Saves a file by `save`, which calls its argument with the number of records so far; shows `problem` if this fails. */
  const prepare = (id: string, problem: string, save: (progress: (records: number) => void) => Promise<void>) => {
    const button = byId(id, HTMLButtonElement);
    // One file at a time: the button shows the progress of the present one.
    if (button.getAttribute("aria-busy") === "true") return;
    const title = button.textContent;
    button.setAttribute("aria-busy", "true");
    save((records) => fill(button, [`Preparing the file: ${records} records`]))
      .catch(() => failed(problem))
      .finally(() => {
        button.setAttribute("aria-busy", "false");
        fill(button, [title]);
      });
  };
  byId("export-live").onclick = () => prepare("export-live", NOT_EXPORTED, (progress) => exportLive(recorder, wire, progress));
  const exportRecords = (id: string, what: string, csv: (records: Records) => string[]) => {
    const since_unix_s = periodStart_unix_s();
    prepare(id, "The browser cannot read the stored steps. Reload the page and try again.", (progress) =>
      exportCsv(store(), nameOf(what, since_unix_s), since_unix_s, csv, progress),
    );
  };
  byId("export-bouts").onclick = () => exportRecords("export-bouts", "load_bouts", ({ bouts }) => boutsCsv(bouts));
  byId("export-steps").onclick = () => exportRecords("export-steps", "steps", ({ steps }) => stepsCsv(steps));
  byId("export-days").onclick = () => {
    const since_unix_s = periodStart_unix_s();
    const days = [...store().days.values()].filter(({ day }) => since_unix_s === undefined || day >= dayOf(since_unix_s));
    download(nameOf("days", since_unix_s), "text/csv", daysCsv(days));
  };
  byId("clear").onclick = () => {
    const what = "all steps and loads that are stored on this device, and those of an interrupted identification";
    if (!confirm(`Delete ${what}? Export the steps first if you need them. ${INSOLES_COUNT}`)) return;
    clear().catch((error: unknown) => {
      const is_elsewhere = errorText(error) === NOT_DELETED;
      failed(is_elsewhere ? NOT_DELETED : "The browser could not delete the steps. Reload the page and try again.");
    });
  };
}

/** The start of the chosen period, s since 1970; `undefined` if everything is to be exported. */
function periodStart_unix_s(): number | undefined {
  const days = Number(byId("export-period", HTMLSelectElement).value);
  return days === 0 ? undefined : midnight_unix_s(days - 1);
}

/**
 * Saves the records of a period as a CSV file, or all of them without `since_unix_s`. `csv` returns the header line and the
 * lines of a part of the records. `progress` is called with the number of records of all kinds that were read.
 */
async function exportCsv(
  store: StepStore,
  name: string,
  since_unix_s: number | undefined,
  csv: (records: Records) => string[],
  progress: (records: number) => void,
): Promise<void> {
  const blobs: Blob[] = [];
  let read = 0;
  // Each part is a blob of its own, because a browser can hold blobs on the disk instead of in memory.
  for await (const records of store.parts()) {
    const exported = since_unix_s === undefined ? records : records.since(since_unix_s);
    blobs.push(new Blob(csv(exported).slice(blobs.length === 0 ? 0 : 1)));
    read += records.steps.length + records.bouts.length + records.alerts.length;
    progress(read);
  }
  download(name, "text/csv", blobs);
}

/** Saves the recording as a CSV file, in parts as {@link exportCsv}. `progress` is called with the number of rows. */
async function exportLive(recorder: Recorder, wire: Wire, progress: (rows: number) => void): Promise<void> {
  // Messages that are recorded from now on are not in the file.
  const recorded = recorder.file();
  const { length } = recorded;
  const blobs: Blob[] = [];
  for (const blob of liveCsv(recorder, wire)) {
    // Each part before this one is full, and the first has the header line.
    if (blobs.length > 0) progress(blobs.length * PART_ROWS - 1);
    blobs.push(blob);
    // The page receives messages between the parts.
    await new Promise((resolve) => setTimeout(resolve));
  }
  download("plantar_live.csv", "text/csv", blobs);
  if (recorder.file() === recorded && recorded.length === length) recorder.is_unsaved = false;
}

/** Updates the details of the insoles and the state of the buttons. To be called a few times a second. */
export function updateSettingsView(insoles: Insoles, recorder: Recorder, now_ms: number): void {
  fill("insoles", insoles.sessions.flatMap((session) => insoleDetails(session, now_ms)));
  updateRecording(recorder, insoles);
}

/** The details of one insole; none before its hello. */
function insoleDetails(session: Session, now_ms: number): Node[] {
  const { hello, counter, status, damaged, battery_percent } = session;
  if (!hello) return [];
  const details = [
    session.is_resting && session.state === "live" ? "Rests until it is loaded"
      : `${session.rate_hz(now_ms).toFixed(0)} of ${hello.rate_hz.toFixed(0)} frames per second`,
    `${counter.received} frames received, ${counter.lost} lost; ${damaged} damaged messages`,
    `Firmware ${hello.firmware}, ${hello.board} board, ${hello.cells} cells`,
  ];
  if (battery_percent !== undefined) details.push(`Battery ${battery_percent} %`);
  if (status && status.records_dropped > 0) {
    details.push(
      `${status.records_dropped} steps, load bouts and alerts were lost, because the insole's memory was full, or because ` +
        "it could not store them (low battery, or a fault of its memory), or because plantar serve had to delete them before " +
        "this page received them.",
    );
  }
  const title: Node = ["dt", { class: hello.side }, sideTitle(hello.side)];
  return [["div", {}, title, ...details.map((detail): Node => ["dd", {}, detail])]];
}

/** Updates the buttons that record and export. */
function updateRecording(recorder: Recorder, insoles: Insoles): void {
  const record = byId("record", HTMLButtonElement);
  record.disabled = !insoles.transport;
  record.className = recorder.isRecording ? "primary" : "";
  // A screen reader would speak the time again with each change.
  const time: Node = ["span", { "aria-hidden": "true" }, ` (${recorder.seconds().toFixed(0)} s)`];
  fill("record", recorder.isRecording ? ["Stop recording", time] : ["Record live values"]);
  for (const id of ["export-live", "export-stream"]) byId(id, HTMLButtonElement).disabled = recorder.isEmpty;
}
