import { readFileSync } from "node:fs";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { NOT_DELETED } from "../src/identify_controller";
import { Insoles } from "../src/insoles";
import { Recorder } from "../src/recorder";
import { loadSettings } from "../src/settings";
import { listenToExport, listenToSettings, updateSettingsView } from "../src/settings_view";
import { StepStore } from "../src/step_store";
import { element } from "./elements";
import { loadWire, messagesOf } from "./wire";

vi.mock("../src/dom", async () => (await import("./elements")).dom);

const wire = await loadWire();

// These tests run without a document, so the classes of elements that the page names must be defined.
beforeEach(() => ["HTMLButtonElement", "HTMLInputElement", "HTMLSelectElement"].forEach((name) => vi.stubGlobal(name, Object)));
afterEach(() => void vi.unstubAllGlobals());

test("the details of an insole state how many records it lost, and the possible reasons", () => {
  const none = () => undefined;
  const recorder = new Recorder();
  const events = { live: none, shape: none, record: none, isKnown: () => false, answer: none, message: none };
  const insoles = new Insoles(wire, recorder, events);
  insoles.use({ location: "in a test", is_replay: false, can_lose_records: true, send: none, close: none });
  insoles.transportEvents.opened(0);
  messagesOf(0).forEach((message) => insoles.transportEvents.message(0, message));
  /** The details when the insole has lost this number of records. */
  const details = (records_dropped: number) => {
    Object.assign(insoles.sessions[0]!, { status: { records_dropped } });
    updateSettingsView(insoles, recorder, 0);
    return element("insoles").content;
  };
  expect(details(0)).not.toContain("lost, because");
  expect(details(7)).toContain(
    "7 steps, load bouts and alerts were lost, because the insole's memory was full, or because it could not " +
      "store them (low battery, or a fault of its memory), or because plantar serve had to delete them before this page " +
      "received them.",
  );
});

test("a recording that was not exported is replaced only if the wearer agrees", () => {
  let is_confirmed = false;
  const confirm = vi.fn(() => is_confirmed);
  vi.stubGlobal("confirm", confirm);
  const recorder = new Recorder();
  const requestIdentified = vi.fn();
  const sessions = [{ state: "live", requestIdentified }, { state: "closed" }];
  const insoles = { hellos: new Map([[0, new Uint8Array(1)]]), transport: undefined, sessions } as unknown as Insoles;
  listenToExport(wire, recorder, insoles, () => StepStore.ofRecording(wire), () => Promise.resolve(), () => undefined);
  const press = () => {
    element("record").onclick();
    return recorder.isRecording;
  };
  expect([press(), press(), confirm.mock.calls.length]).toEqual([true, false, 0]);
  // Each connected insole is asked how its parameters were identified, so that the recording contains its answer.
  expect(requestIdentified).toHaveBeenCalledOnce();
  expect([press(), confirm.mock.calls.length]).toEqual([false, 1]);
  is_confirmed = true;
  expect([press(), press(), confirm.mock.calls.length]).toEqual([true, false, 2]);
  element("export-stream").onclick();
  expect([press(), press(), confirm.mock.calls.length]).toEqual([true, false, 2]);
});

test("a recording counts as saved once its file exists, unless it has grown or was replaced meanwhile", async () => {
  const recorder = new Recorder();
  const insoles = { hellos: new Map([[0, messagesOf(0)[0]]]), transport: undefined, sessions: [] } as unknown as Insoles;
  listenToExport(wire, recorder, insoles, () => StepStore.ofRecording(wire), () => Promise.resolve(), () => undefined);
  const add = () => messagesOf(0).slice(0, 10).forEach((message) => recorder.add(0, message, 0));
  const restart = () => (recorder.start(0, []), add());
  for (const [meanwhile, is_unsaved] of [[() => undefined, false], [add, true], [restart, true]] as const) {
    restart();
    element("export-live").onclick();
    expect([recorder.is_unsaved, element("export-live").content]).toEqual([true, expect.not.stringContaining("records")]);
    meanwhile();
    await vi.waitFor(() => expect(element("export-live").attributes["aria-busy"]).toBe("false"));
    expect(recorder.is_unsaved).toBe(is_unsaved);
  }
});

test("a typing error does not delete the body mass, and a change in another tab is shown", () => {
  const storage = { getItem: () => null, setItem: () => undefined } as unknown as Storage;
  vi.stubGlobal("localStorage", storage);
  const settings = loadSettings(() => storage);
  const show = listenToSettings(settings, () => undefined);
  const mass = element("mass");
  const type = (value: string) => {
    mass.value = value;
    // The first digit of a value is no value.
    mass.oninput();
    mass.onchange();
    return settings.body_mass_kg;
  };
  expect([type("80"), type("5000"), mass.attributes["aria-invalid"], type(""), type("70")]).toEqual([80, 80, "true", null, 70]);
  Object.assign(settings, { body_mass_kg: 65, force_unit: "%BW" });
  show();
  expect([mass.value, element("force-unit").value]).toEqual(["65.0", "%BW"]);
});

test("a number is accepted with a decimal comma or point, and an implausible body mass is refused", () => {
  const storage = { getItem: () => null, setItem: () => undefined } as unknown as Storage;
  vi.stubGlobal("localStorage", storage);
  const settings = loadSettings(() => storage);
  listenToSettings(settings, () => undefined);
  const type = (id: string, value: string) => {
    element(id).value = value;
    element(id).onchange();
    return [settings.body_mass_kg, settings.stride_cm, element(id).attributes["aria-invalid"]];
  };
  expect(type("mass", "65,5")).toEqual([65.5, null, "false"]);
  expect(type("mass", " 70.25 ")).toEqual([70.25, null, "false"]);
  expect(type("stride", "142,5")).toEqual([70.25, 142.5, "false"]);
  for (const value of ["5", "655", "700", "6,5,5", "65 kg", "1,234.5"]) expect(type("mass", value)).toEqual([70.25, 142.5, "true"]);
  expect(element("mass-note").content).toContain("Enter 10 to 300 kg.");
  expect(type("mass", " ")).toEqual([null, 142.5, "false"]);
  // A field of type "number" drops a comma, or hides the text that is no number.
  const page = readFileSync(new URL("../index.html", import.meta.url), "utf8");
  for (const id of ["mass", "stride"]) expect(new RegExp(`<input id="${id}"[^>]*>`).exec(page)?.[0]).not.toContain("type=");
});

test("the time of a recording is not part of the name of its button, which a screen reader would speak again and again", () => {
  const recorder = new Recorder();
  recorder.start(0, []);
  updateSettingsView({ transport: {}, sessions: [] } as unknown as Insoles, recorder, 0);
  const { content } = element("record");
  expect(JSON.parse(content)).toEqual(["Stop recording", ["span", { "aria-hidden": "true" }, " (0 s)"]]);
});

test.each([
  [new Error(NOT_DELETED), NOT_DELETED],
  [new DOMException("", "UnknownError"), "The browser could not delete the steps. Reload the page and try again."],
])("a deletion that fails is reported: %s", async (error, text) => {
  const confirm = vi.fn(() => true);
  vi.stubGlobal("confirm", confirm);
  const failed = vi.fn();
  const insoles = { hellos: new Map(), transport: undefined } as unknown as Insoles;
  listenToExport(wire, new Recorder(), insoles, () => StepStore.ofRecording(wire), () => Promise.reject(error), failed);
  element("clear").onclick();
  await vi.waitFor(() => expect(failed).toHaveBeenCalledExactlyOnceWith(text));
  expect(confirm).toHaveBeenCalledWith(expect.stringContaining("The insoles still count the load of today"));
});
