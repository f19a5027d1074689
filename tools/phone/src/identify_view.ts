/** The view of the guided session. */

import { type Node, fill } from "./dom";
import { regionTitle } from "./format";
import type { FootResult, RegionResult } from "./identify_core";
import { CHECK_STEPS, RELIABLE_STEPS, TARGET_STEPS } from "./identify_rules";
import type { Foot, IdentifySession } from "./identify_session";
import type { Insoles } from "./insoles";
import { SHOE_SIZES } from "./settings";
import { SIDES, sideTitle } from "./side";

/** Least share of an insole's frames that must arrive. Below it, the wearer is warned before the session. */
const LEAST_RATE = 0.8;
/** Below this charge of an insole's battery, the wearer is warned before the session. */
const LOW_BATTERY_PERCENT = 15;
/** An error of the model below the first value, %, is called good, and below the second one fair. */
const [GOOD_PERCENT, FAIR_PERCENT] = [10, 20];

/** The usual reason why an insole accepts no change, as a phrase. */
const REFUSED = "plantar serve was started without the option --accept-parameters";

/** The data that the view shows besides the session. */
export interface IdentifyState {
  insoles: Insoles;
  shoe_size: number;
  /** True if there are messages of an interrupted session. */
  has_stored: boolean;
  /** True if a session is open in another tab. */
  is_elsewhere: boolean;
  now_ms: number;
}

const button = (action: string, text: string, kind = ""): Node =>
  ["button", { "data-action": action, ...(kind && { class: kind }) }, text];
const soft = (text: string): Node => ["p", { class: "soft" }, text];
const note = (text: string): Node => ["p", { class: "note" }, text];
const remark = (text: string): Node => ["p", { class: "note remark" }, text];

/** Shows the session in the view. */
export function drawIdentify(session: IdentifySession, state: IdentifyState): void {
  fill("identify-body", content(session, state));
}

function content(session: IdentifySession, state: IdentifyState): Node[] {
  switch (session.phase) {
    case "closed":
      return start(state);
    case "stand":
      return [
        ["p", { class: "command", role: "status" }, "Stand still on both feet"],
        soft("After three seconds, the phone says when to walk. It speaks and vibrates, so you need not look at it."),
        ...session.problems().map(note),
        ...session.comments().map(remark),
        button("close", "Cancel"),
      ];
    case "walk":
      return walk(session);
    case "fit":
      return [
        ["p", { class: "command", role: "status" }, "You can stop"],
        ["progress", { max: String(session.regions), value: String(session.regions_done), "aria-label": "Regions computed" }],
        soft(`Computing the parameters of your tissue: ${session.regions_done} of ${session.regions} regions.`),
      ];
    case "result":
    case "push":
      return result(session, state.insoles.transport?.is_replay ?? false);
    case "verify":
      return [
        ["p", { class: "command", role: "status" }, `Walk ${CHECK_STEPS} more steps`],
        rings(
          session.feet.filter(({ sent }) => sent === "confirmed"),
          ({ checked }) => Math.min(CHECK_STEPS, checked.size),
          CHECK_STEPS,
        ),
        soft("The insoles now use your parameters, and measure how well the parameters predict your steps."),
        ...session.problems().map(note),
        ...failedTransfers(session),
        button("skip", "Finish without this check"),
      ];
    case "done":
      return done(session);
    case "failed":
      return session.needs_reload
        ? [
            note(`${session.failure} Reload the page, then continue the session.`),
            ...session.comments().map(remark),
            button("reload", "Reload the page", "primary"),
            ...exports(session),
            button("close", "Delete the session"),
          ]
        : [note(session.failure), button("close", "Start again", "primary"), ...exports(session)];
  }
}

/** The problems of each insole that the wearer should solve before the session, as sentences. */
export function startProblems({ insoles, now_ms }: Pick<IdentifyState, "insoles" | "now_ms">): string[] {
  const { is_replay, is_radio } = insoles.transport ?? {};
  return SIDES.flatMap((side) => {
    const session = insoles.of(side);
    if (!session?.hello || is_replay) return [];
    if (session.state !== "live") return [`The ${side} insole is not connected at the moment.`];
    const [rate_hz, expected_hz] = [session.rate_hz(now_ms), session.hello.rate_hz];
    const rates = `${rate_hz.toFixed(0)} of ${expected_hz.toFixed(0)}`;
    const { battery_percent } = session;
    return [
      ...(session.is_resting ? [`The ${side} insole rests, because it is not loaded. Stand on it.`]
        : rate_hz < LEAST_RATE * expected_hz
        ? [`Only ${rates} frames per second arrive from the ${side} insole.${is_radio ? " Hold the phone closer." : ""}`]
        : []),
      ...(session.refuses_changes
        ? [`The ${side} insole will not accept the result: ${REFUSED}. You can save the result as a file, and send it later.`]
        : []),
      ...(battery_percent !== undefined && battery_percent < LOW_BATTERY_PERCENT
        ? [`The battery of the ${side} insole is at ${battery_percent} %. Charge it first.`]
        : []),
    ];
  });
}

function start(state: IdentifyState): Node[] {
  const { insoles, shoe_size, has_stored, is_elsewhere } = state;
  const sides = SIDES.filter((side) => insoles.of(side)?.state === "live");
  const is_recorded = insoles.transport?.is_replay && sides.length > 0;
  const feet = is_recorded ? `This is a recording of ${sides.length === 2 ? "both feet" : `the ${sides[0]} foot`}.`
    : sides.length === 2 ? "Both insoles are connected." : sides.length === 1
    ? `Only the ${sides[0]} insole is connected. Connect the other one too, or continue with one foot.`
    : "No insole is connected. Connect your insoles, then return to this view.";
  const sizes = Array.from({ length: SHOE_SIZES.max - SHOE_SIZES.min + 1 }, (_, i) => String(SHOE_SIZES.min + i));
  const option = (size: string): Node => ["option", size === String(shoe_size) ? { selected: "" } : {}, size];
  const connect = button("connect", "Connect my insoles", "primary");
  return [
    // On a phone, the wearer sees only the beginning of this text.
    ...(is_elsewhere ? [note("An identification is open in another tab. Finish or close it there.")]
      : has_stored ? [
        note("A session was interrupted. Its steps are stored on this phone."),
        sides.length > 0 ? button("resume", "Continue that session", "primary") : connect,
        button("discard", "Delete that session"),
      ] : []),
    ["p", {},
      `Stand for a moment, then walk ${TARGET_STEPS} steps with each foot. The phone computes how stiff your tissue is ` +
        `in each region. You can then send the result to your insoles, and check it on ${CHECK_STEPS} more steps.`],
    ["ol", { class: "soft" },
      ["li", {}, "Wear the shoes with the insoles, the left one in the left shoe."],
      ["li", {}, "Carry the phone in your hand or in a pocket, with the sound on."],
      ["li", {}, "You need about one minute and a straight path."]],
    ["p", {},
      "Do not begin with an open wound or a cast, or if you were advised not to walk. A rail or a companion helps. Turn where " +
        "you like, and stop at any time."],
    ["p", { class: sides.length === 2 ? "fine" : "note" }, feet],
    ...startProblems(state).map(note),
    ["label", { for: "shoe-size" }, "Shoe size (European)"],
    ["select", { id: "shoe-size" }, ...sizes.map(option)],
    ...(is_elsewhere ? []
      : sides.length > 0 ? [button("start", has_stored ? "Start a new session" : "Start", has_stored ? "" : "primary")]
      : has_stored ? [] : [connect]),
    soft("The result describes a model of your foot. It is no diagnosis."),
  ];
}

/** A circle for each foot. It is filled by the share of the goal that the count of the foot has reached. */
function rings(feet: Foot[], count: (foot: Foot) => number, goal: number): Node {
  const radius = 42;
  const length = 2 * Math.PI * radius;
  return ["div", { class: `rings n${feet.length}` }, ...feet.map((foot): Node => {
    const steps = count(foot);
    const share = Math.min(1, steps / goal);
    const label = `${sideTitle(foot.side)} foot: ${steps} of ${goal} steps`;
    return ["div", { class: foot.side },
      ["svg", { viewBox: "0 0 100 100", role: "img", "aria-label": label },
        ["circle", { class: "track", cx: "50", cy: "50", r: String(radius) }],
        ["circle", {
          class: "share", cx: "50", cy: "50", r: String(radius), transform: "rotate(-90 50 50)",
          "stroke-dasharray": `${(share * length).toFixed(1)} ${length.toFixed(1)}`,
        }],
        ["text", { x: "50", y: "50" }, share === 1 ? "✓" : String(steps)],
        ["text", { class: "of", x: "50", y: "70" }, share === 1 ? `${steps} steps` : `of ${goal}`]],
      ["b", {}, sideTitle(foot.side)]];
  })];
}

function walk(session: IdentifySession): Node[] {
  const is_sparse = session.feet.some(({ collected }) => (collected?.good ?? 0) < RELIABLE_STEPS);
  return [
    ["p", { class: "command", role: "status" }, "Walk"],
    rings(session.feet, ({ collected }) => collected?.good ?? 0, TARGET_STEPS),
    ...session.problems().map(note),
    ...session.comments().map(remark),
    ...(session.canFinish ? [button("finish", "Finish with these steps")] : []),
    ...(session.canFinish && is_sparse ? [soft(`Fewer than ${RELIABLE_STEPS} steps of a foot make its result uncertain.`)] : []),
    button("close", "Cancel"),
  ];
}

/** A row of the table of results: the stiffness of a region with its interval, and the error of the model. */
export function regionRow(name: string, region: RegionResult): Node {
  const title: Node = ["th", { scope: "row" }, regionTitle(name)];
  if (!region.fitted) return ["tr", {}, title, ["td", { colspan: "2" }, `not determined: ${region.reason}`]];
  const kPa = (pa: number | null) => (pa === null ? "∞" : (pa / 1000).toFixed(pa < 10_000 ? 1 : 0));
  const { jacobian, at_bound } = region.uncertainty.intervals_95.stiffness_pa;
  const { predicted } = region.nrmse_percent;
  const rating = (percent: number) => (percent < GOOD_PERCENT ? "good" : percent < FAIR_PERCENT ? "fair" : "rough");
  // A fit to a single step predicts no error.
  const [error, rated] = predicted === null ? ["–", "from one step"] : [`${predicted.toFixed(0)} %`, rating(predicted)];
  const words = region.warnings.length > 0 ? `${rated}, see details` : rated;
  const range = at_bound ? "at the limit of the search" : `${kPa(jacobian[0])} to ${kPa(jacobian[1])}`;
  return ["tr", {}, title,
    ["td", {}, kPa(region.identified.stiffness_pa), ["small", {}, range]],
    ["td", {}, error, ["small", {}, words]]];
}

function resultTable({ side, collected, result }: Foot, { regions }: FootResult): Node[] {
  const rows = Object.entries(regions).map(([name, region]) => regionRow(name, region));
  const details = Object.entries(regions).flatMap(([name, region]) =>
    region.fitted ? [region.verdict, ...region.warnings].map((text): Node => ["li", {}, `${regionTitle(name)}: ${text}`]) : [],
  );
  const good = collected?.good ?? 0;
  const titles = ["Region", "Stiffness K, kPa", "Error on new steps"].map((title): Node => ["th", { scope: "col" }, title]);
  return [
    ["table", { class: "result" },
      ["caption", { class: side }, `${sideTitle(side)} foot, ${result?.steps.length ?? 0} steps`],
      ["thead", {}, ["tr", {}, ...titles]],
      ["tbody", {}, ...rows]],
    ...(good < RELIABLE_STEPS ? [note(`Only ${good} steps of the ${side} foot: its result is uncertain.`)] : []),
    ["details", {}, ["summary", {}, `Details of the ${side} foot`], ["ul", { class: "soft" }, ...details]],
  ];
}

/**
 * The insoles that have not confirmed the parameters, or could not store them, with the reasons, and the button that sends the
 * parameters again.
 */
function failedTransfers(session: IdentifySession): Node[] {
  const words = ({ side, refusal, unstored }: Foot) =>
    unstored ? `The ${side} insole will lose your parameters when it restarts: ${unstored}.`
    : refusal ? `The ${side} insole did not accept the parameters: ${refusal}.`
    : `The ${side} insole did not answer, so it may not have your parameters.` +
      (session.is_radio ? " Hold the phone closer to it." : "");
  const failed = session.feet.filter(({ sent, unstored }) => sent === "failed" || unstored);
  const notes = failed.map((foot) => note(words(foot)));
  // The same refusal would follow, unless the wearer has changed something.
  const is_final = failed.every(({ is_refusal_final }) => is_refusal_final);
  return notes.length > 0 ? [...notes, button("push", "Send again", is_final ? "" : "primary")] : [];
}

const exports = (session: IdentifySession): Node[] => [
  button("export", "Save the session"),
  ...session.pushable().map(({ side }) => button(`export-${side}`, `Save the ${side} parameters`)),
];

function result(session: IdentifySession, is_replay: boolean): Node[] {
  const unfitted = session.feet.filter(({ result }) => !result).map(({ side }) => side);
  const is_sending = session.phase === "push";
  const failed = failedTransfers(session);
  return [
    ...unfitted.map((side) => note(`There are too few steps of the ${side} foot. Its insole is left unchanged.`)),
    ...(is_replay ? [note("This is a recording, so there is no insole to send the parameters to.")]
      : is_sending ? [["p", { class: "fine" }, "Sending the parameters…"] as Node]
      : failed.length > 0 ? failed
      : session.pushable().length > 0 ? [button("push", "Send to my insoles", "primary")] : []),
    ...session.problems().map(note),
    ...session.feet.flatMap((foot) => (foot.result ? resultTable(foot, foot.result) : [])),
    soft(
      "In small print: the 95 % interval of the stiffness, from the scatter of the forces about the model and of the other " +
        "parameters among people.",
    ),
    ...session.comments().map(remark),
    ...exports(session),
    button("close", "Discard and close"),
  ];
}

function done(session: IdentifySession): Node[] {
  return [
    ["p", { class: "command", role: "status" }, "Finished"],
    ...session.feet.flatMap(({ side, check, checked, sent }): Node[] => {
      if (sent !== "confirmed") return [];
      if (!check) {
        const reason = checked.size < CHECK_STEPS
          ? "They were not checked on further steps."
          : "No step could be compared: the loads were too small or too large, or the fit predicts no error.";
        return [note(`The ${side} insole has your parameters. ${reason}`)];
      }
      const { predicted_percent, measured_percent, is_confirmed } = check;
      const expected = `${predicted_percent.toFixed(0)} % were expected.`;
      const errors = `error ${measured_percent.toFixed(0)} % on your last ${CHECK_STEPS} steps, ${expected}`;
      const words = `${sideTitle(side)} foot: ${errors}`;
      if (is_confirmed) return [["p", { class: "fine" }, words]];
      return [note(`${words} Repeat the session on a straight path at your usual pace.`)];
    }),
    ...failedTransfers(session),
    ...exports(session),
    button("close", "Close", "primary"),
  ];
}
