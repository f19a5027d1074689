import { beforeEach, expect, test, vi } from "vitest";
import type { FootResult, RegionResult } from "../src/identify_core";
import type { Foot, IdentifySession, Phase } from "../src/identify_session";
import { drawIdentify, regionRow, startProblems } from "../src/identify_view";
import type { Insoles } from "../src/insoles";
import { element } from "./elements";

vi.mock("../src/dom", async () => (await import("./elements")).dom);

/** The row of a fitted region with this interval of the stiffness and this predicted error, as JSON. */
function row(jacobian: [number | null, number | null], predicted: number | null = 6): string {
  const intervals_95 = { stiffness_pa: { jacobian, at_bound: false, is_identifiable: true } };
  const nrmse_percent = { fitted: 5, predicted, floor: 1 };
  const region = { fitted: true, warnings: [], identified: { stiffness_pa: 20_000 }, uncertainty: { intervals_95 }, nrmse_percent };
  return JSON.stringify(regionRow("heel", region as unknown as RegionResult));
}

test("the interval of a stiffness is shown with its ends in kPa, also if its upper end is infinite", () => {
  expect(row([9_500, 41_200])).toContain("9.5 to 41");
  expect(row([9_500, null])).toContain("9.5 to ∞");
});

test("no error on new steps is shown for a region that was fitted to one step", () => {
  expect(row([9_500, 41_200])).toContain("6 %");
  const one_step = row([9_500, 41_200], null);
  expect(one_step).toContain("from one step");
  expect(one_step).not.toContain(" %");
});

/** The view of a session in this phase, as JSON. `has_stored` is that of the view's state, and `needs_reload` of the session. */
function view(phase: Phase, feet: Partial<Foot>[] = [], has_stored = false, needs_reload = false, is_elsewhere = false): string {
  const result = { fitted: 1, steps: [], regions: {} } as unknown as FootResult;
  const all = feet.map((foot) => ({ refusal: "", is_refusal_final: false, unstored: "", checked: new Map(), result, ...foot }));
  const session = { phase, feet: all, needs_reload, problems: () => [], comments: () => [], pushable: () => all };
  const insoles = { of: () => undefined };
  const state = { insoles: insoles as unknown as Insoles, shoe_size: 42, has_stored, is_elsewhere, now_ms: 0 };
  drawIdentify(session as unknown as IdentifySession, state);
  return element("identify-body").content;
}

beforeEach(() => void (element("identify-body").content = ""));

test.each(["result", "verify", "done"] as const)("parameters that an insole did not accept can be sent again: %s", (phase) => {
  const send = '"data-action":"push"';
  const failed = view(phase, [{ side: "left", sent: "failed" }, { side: "right", sent: "failed", refusal: "busy" }]);
  expect(failed).toContain("The left insole did not answer");
  expect(failed).toContain("The right insole did not accept the parameters: busy.");
  expect(failed.split(send)).toHaveLength(2);
  const lost = view(phase, [{ side: "left", sent: "confirmed", unstored: "low supply" }]);
  expect(lost).toContain("The left insole will lose your parameters when it restarts: low supply.");
  expect(lost.split(send)).toHaveLength(2);
  if (phase !== "result") expect(view(phase, [{ side: "left", sent: "confirmed" }])).not.toContain(send);
});

test("sending parameters again is not the main action if they would be refused again, and they can be saved", () => {
  const refused = { sent: "failed", refusal: "no changes", is_refusal_final: true } as const;
  const both = view("result", [{ side: "left", ...refused }, { side: "right", ...refused }]);
  expect(both).toContain("The left insole did not accept the parameters: no changes.");
  const main = '"data-action":"push","class":"primary"';
  expect(both).toContain('"data-action":"push"');
  expect(both).not.toContain(main);
  expect(both).toContain('"data-action":"export-left"');
  expect(view("result", [{ side: "left", ...refused }, { side: "right", sent: "failed" }])).toContain(main);
});

test("the wearer knows before the session that an insole will not accept the result", () => {
  const session = { state: "live", hello: { rate_hz: 100 }, rate_hz: () => 100, refuses_changes: true };
  const insoles = { of: (side: string) => (side === "left" ? session : undefined) } as unknown as Insoles;
  expect(startProblems({ insoles, now_ms: 0 }).join()).toMatch(/left insole will not accept the result.*--accept-parameters/);
});

test("before the session, the wearer knows when not to walk", () => {
  expect(view("closed")).toMatch(/open wound or a cast.*rail or a companion.*stop at any time/);
});

test("an interrupted session can be deleted without an insole", () => {
  expect(view("closed", [], true)).toContain('"data-action":"discard"');
  expect(view("closed")).not.toContain('"data-action":"discard"');
});

test("the view begins with an interrupted session, which can be continued or deleted", () => {
  const actions = (text: string) => [...text.matchAll(/"data-action":"(\w+)"/g)].map(([, action]) => action);
  const of = (side: string) => (side === "left" ? { state: "live" } : undefined);
  const insoles = { of } as unknown as Insoles;
  drawIdentify({ phase: "closed" } as IdentifySession, { insoles, shoe_size: 42, has_stored: true, is_elsewhere: false, now_ms: 0 });
  const { content } = element("identify-body");
  expect(content).toMatch(/^\[\["p",\{"class":"note"\},"A session was interrupted/);
  expect(actions(content)).toEqual(["resume", "discard", "start"]);
  // Without an insole, the first action connects one.
  expect(actions(view("closed", [], true))).toEqual(["connect", "discard"]);
});

test("after a failure of the computation, the main action reloads the page, and the session is not deleted", () => {
  const primary = (text: string) => [...text.matchAll(/"data-action":"(\w+)","class":"primary"/g)].map(([, action]) => action);
  expect(primary(view("failed", [], false, true))).toEqual(["reload"]);
  expect(primary(view("failed"))).toEqual(["close"]);
});

test("the advice to hold the phone closer is given only for a radio link, and no advice for a recording", () => {
  const session = { state: "live", hello: { rate_hz: 100 }, rate_hz: () => 2 };
  const of = (side: string) => (side === "left" ? session : undefined);
  const problems = (transport = {}) => startProblems({ insoles: { transport, of } as unknown as Insoles, now_ms: 0 });
  const slow = "Only 2 of 100 frames per second arrive from the left insole.";
  expect([problems(), problems({ is_radio: true }), problems({ is_replay: true })]).toEqual([[slow], [`${slow} Hold the phone closer.`], []]);
});

test("a recording is not called a connection", () => {
  const insoles = { transport: { is_replay: true }, of: () => ({ state: "live" }) } as unknown as Insoles;
  drawIdentify({ phase: "closed" } as IdentifySession, { insoles, shoe_size: 42, has_stored: false, is_elsewhere: false, now_ms: 0 });
  expect(element("identify-body").content).toContain("This is a recording of both feet.");
  expect(element("identify-body").content).not.toContain("connected");
});

test("an insole that rests is not reported as one that is out of reach", () => {
  const problems = (is_resting: boolean) => {
    const session = { state: "live", hello: { rate_hz: 100 }, rate_hz: () => 2, is_resting };
    const of = (side: string) => (side === "left" ? session : undefined);
    return startProblems({ insoles: { of } as unknown as Insoles, now_ms: 0 }).join();
  };
  expect(problems(false)).toMatch(/2 of 100 frames/);
  expect(problems(true)).toBe("The left insole rests, because it is not loaded. Stand on it.");
});

test("a session that is open in another tab can be neither continued nor deleted nor replaced", () => {
  const elsewhere = view("closed", [], true, false, true);
  expect(elsewhere).toContain("An identification is open in another tab. Finish or close it there.");
  expect(elsewhere).not.toContain("data-action");
});
