import { expect, test } from "vitest";
import type { Facts } from "../src/generated/messages";
import type { Insoles } from "../src/insoles";
import type { LiveView } from "../src/live_view";
import { problems, remarks, sessionProblems } from "../src/notes";
import type { Session } from "../src/session";

const FACTS = { regions: [{ name: "heel" }, { name: "hallux" }] } as Facts;

test("regions with parameters that are not known to be the wearer's are named", () => {
  const remarksWith = (typical: number[], transport = {}) => {
    const session = { state: "live", hello: { has_parameters: true }, typical, records_waiting: 0 };
    const insoles = { transport, sessions: [session], of: (side: string) => (side === "right" ? session : undefined) };
    return JSON.stringify(remarks(insoles as unknown as Insoles, undefined, FACTS));
  };
  expect(remarksWith([])).toBe("[]");
  expect(remarksWith([1])).toContain("The model values of the right foot (big toe) are computed with parameters that are not known to be yours");
  expect(remarksWith([1], { is_replay: true })).toContain("parameters that are not known to be the wearer's");
  expect(remarksWith([0, 1])).toContain("The model values of the right foot are computed with parameters that are not known to be yours");
});

test("all remarks that apply are shown", () => {
  const session = { state: "live", hello: { has_parameters: false }, typical: [], records_waiting: 200, needs_refit: true };
  const insoles = { transport: {}, sessions: [session], of: (side: string) => (side === "left" ? session : undefined) };
  const all = remarks(insoles as unknown as Insoles, [{ feet: "No alert can come now.", rest: "The next one can come in 5 minutes." }], FACTS).map((remark) => JSON.stringify(remark));
  const parts = ["The next one can come in 5 minutes.", "Your personal parameters are not on the left insole", "200 steps", "another stiffness of the left foot than at the identification"];
  expect(all).toHaveLength(parts.length);
  parts.forEach((part, i) => expect(all[i]).toContain(part));
});

test("a difference of the protocols is reported with the older side and the remedy", () => {
  const text = (major: number) => {
    const hello = { side: "left", firmware: "1.2", major, minor: 0 };
    return sessionProblems({ hello, state: "other-version", reason: "" } as unknown as Session, { major: 2, minor: 1 } as Facts)[0];
  };
  expect(text(3)).toMatch(/this page is older than the firmware 1.2 of the left insole.*reload/i);
  expect(text(1)).toMatch(/the firmware 1.2 of the left insole is older than this page.*supplier/i);
});

test("two insoles without parameters are named as insoles", () => {
  const session = { state: "live", hello: { has_parameters: false }, typical: [], records_waiting: 0 };
  const insoles = { transport: {}, sessions: [session], of: () => session };
  expect(JSON.stringify(remarks(insoles as unknown as Insoles, undefined, FACTS))).toContain("not on the left and right insoles, so");
});

test("a gap in a recording is not reported as a lost connection", () => {
  const sessions = [{ state: "lost", hello: { side: "left" }, reason: "no data for two seconds" }];
  const live_view = { saturatedRegions: [], maskedRegions: [] } as unknown as LiveView;
  const text = (is_replay: boolean) => problems({ transport: { is_replay }, sessions } as unknown as Insoles, live_view, FACTS).join();
  expect(text(false)).toMatch(/connection to the left insole is lost.*stores your steps/);
  expect(text(true)).toBe("The recording has no data of the left insole here.");
});

test("faulty cells without healthy neighbours, of which alerts may be missing, are mentioned", () => {
  const live_view = { saturatedRegions: [], maskedRegions: ["left ball, inner", "left heel"] } as unknown as LiveView;
  const text = problems({ transport: {}, sessions: [] } as unknown as Insoles, live_view, FACTS).join();
  expect(text).toMatch(/faulty here: left ball, inner; left heel.*others read 0, and alerts may be missing/);
});
