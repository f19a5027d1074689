/** Notes to the wearer: problems, and remarks that require no action. */

import type { Pause } from "./alerts";
import type { Node } from "./dom";
import { regionTitle } from "./format";
import type { Facts } from "./generated/messages";
import type { Insoles } from "./insoles";
import type { LiveView } from "./live_view";
import type { Session } from "./session";
import { SIDES } from "./side";

/** From this number of stored records on, their arrival takes so long that a remark states it. */
const MANY_RECORDS = 100;

/** A remark. Its first text is its key, so that a screen reader speaks it only when it appears or changes. */
const remark = (...content: Node[]): Node => ["p", { class: "note remark", "data-key": String(content[0]) }, ...content];

/** Problems that affect the measurement. */
export function problems(insoles: Insoles, live_view: LiveView, facts: Facts): string[] {
  const notes = insoles.sessions.flatMap((session) => sessionProblems(session, facts, insoles.transport?.is_replay));
  const { saturatedRegions: saturated, maskedRegions: masked } = live_view;
  if (saturated.length > 0) {
    notes.push(`The sensor reached its limit here: ${saturated.join("; ")}. The true forces are higher than the ones shown (▲).`);
  }
  if (masked.length > 0) {
    notes.push(
      `Some sensor cells are faulty here: ${masked.join("; ")}. Healthy neighbours replace them (~), if there are any; ` +
        "others read 0, and alerts may be missing.",
    );
  }
  return notes;
}

const capitalised = (text: string) => text.charAt(0).toUpperCase() + text.slice(1);

/** The problems of one session. `is_replay` is that of its transport. */
export function sessionProblems({ hello, state, reason }: Session, facts: Facts, is_replay = false): string[] {
  if (!hello) return [];
  const insole = `The ${hello.side} insole`;
  switch (state) {
    case "other-version": {
      const firmware = `the firmware ${hello.firmware} of the ${hello.side} insole`;
      const protocols = `(protocols ${facts.major}.${facts.minor} and ${hello.major}.${hello.minor})`;
      return hello.major > facts.major
        ? [`This page is older than ${firmware} ${protocols}. Connect to the internet, and reload the page.`]
        : [`${capitalised(firmware)} is older than this page ${protocols}. Ask the supplier of the insole for an update.`];
    }
    case "same-foot":
      return [`Both insoles are for the ${hello.side} foot. Reload the page, and connect one for each foot.`];
    case "lost":
      if (is_replay) return [`The recording has no data of the ${hello.side} insole here.`];
      return [
        `The connection to the ${hello.side} insole is lost (${reason}). The page tries to connect again. ` +
          "The insole stores your steps until then.",
      ];
    case "other-host":
      return [
        `Another phone or program is connected to the ${hello.side} insole, and receives its steps now. ` +
          "The page continues at most about half a minute after that phone or program has disconnected.",
      ];
    case "live":
      if (!hello.fault) return [];
      if (hello.cells === 0) {
        return [`${insole} cannot measure. Restart it. If that does not help, report this text to its supplier: ${hello.fault}`];
      }
      // After any other reset, the previous run did not end with a fault, so `fault` is one of this start.
      const is_restarted = ["panic", "watchdog"].includes(hello.reset);
      const what = is_restarted ? "restarted after a fault. If this happens often"
        : "measures, but reports a fault. If it remains after a restart";
      return [`${insole} ${what}, report this text to its supplier: ${hello.fault}`];
    case "closed":
    case "waiting":
      return [];
  }
}

/** Remarks on the regions of which the parameters are not known to be the wearer's. */
function typicalParameters(insoles: Insoles, facts: Facts): Node[] {
  return SIDES.flatMap((side) => {
    const { hello, typical = [] } = insoles.of(side) ?? {};
    if (!hello?.has_parameters || typical.length === 0) return [];
    const regions = typical.length < facts.regions.length ? typical.map((i) => regionTitle(facts.regions[i]?.name ?? "")) : [];
    const where = regions.length > 0 ? ` (${regions.join("; ").toLowerCase()})` : "";
    const owner = insoles.transport?.is_replay ? "the wearer's" : "yours";
    const values = `The model values of the ${side} foot${where}`;
    return [remark(`${values} are computed with parameters that are not known to be ${owner}.`)];
  });
}

/** Remarks that require no action. `pauses` states times without alerts, see `Alerts.pauseTexts`. */
export function remarks(insoles: Insoles, pauses: readonly Pause[] = [], facts: Facts): Node[] {
  const { transport, sessions } = insoles;
  const leave: Node = ["button", { "data-action": "leave-recording" }, "Leave the recording"];
  if (transport?.is_replay) {
    return [
      ["p", { id: "recording-note", class: "note remark" }, "This is a recording.", leave],
      ...typicalParameters(insoles, facts),
    ];
  }
  // Screen readers announce each change of these notes. Numbers that change often are not announced.
  const counting = (text: string): Node => ["span", { "aria-hidden": "true" }, text];
  const without_parameters = SIDES.filter((side) => insoles.of(side)?.hello?.has_parameters === false);
  const waiting = sessions.reduce((sum, session) => sum + session.records_waiting, 0);
  const changed = SIDES.filter((side) => insoles.of(side)?.state === "live" && insoles.of(side)?.needs_refit);
  const is_waiting = transport && !transport.is_idle && sessions.every(({ state }) => state === "closed" || state === "waiting");
  const reason = sessions.find((session) => session.state === "closed" && session.reason)?.reason;
  const bare = without_parameters.join(" and ") + (without_parameters.length > 1 ? " insoles" : " insole");
  return [
    ...pauses.map(({ feet, rest }) => remark(feet, counting(` ${rest}`))),
    ...(without_parameters.length > 0
      ? [remark(`Your personal parameters are not on the ${bare}, so no model values are shown.`)]
      : []),
    ...typicalParameters(insoles, facts),
    ...(waiting >= MANY_RECORDS
      ? [remark("Stored steps are arriving.", counting(` ${waiting} steps, load bouts and alerts are still to come.`))]
      : []),
    ...(changed.length > 0
      ? [
          remark(
            `The insole measures another stiffness of the ${changed.join(" and ")} foot than at the identification. Most often it ` +
              "has moved, the shoe is another one, or the sensor has become warmer. Check that it lies flat in the shoe. If " +
              'this message remains, choose "Identify my tissue" in the settings.',
          ),
        ]
      : []),
    ...(is_waiting ? [remark(`Waiting for an insole ${transport.location}${reason ? `: ${reason}` : ""}.`)] : []),
  ];
}
