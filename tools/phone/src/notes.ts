/** Notes to the wearer: problems, and remarks that require no action. */

import type { Facts } from "./generated/messages";
import type { Insoles } from "./insoles";
import type { LiveView } from "./live_view";
import type { Session } from "./session";
import { SIDES } from "./side";

/** From this number of stored records on, their arrival takes so long that a remark states it. */
const MANY_RECORDS = 100;

/** Problems that affect the measurement. */
export function problems(insoles: Insoles, live_view: LiveView, facts: Facts): string[] {
  const notes = insoles.sessions.flatMap((session) => sessionProblems(session, facts));
  const { saturatedRegions: saturated, maskedRegions: masked } = live_view;
  if (saturated.length > 0) {
    notes.push(`The sensor reached its limit here: ${saturated.join(", ")}. The true forces are higher than the ones shown (▲).`);
  }
  if (masked.length > 0) {
    notes.push(`Some sensor cells are faulty here: ${masked.join(", ")}. Their neighbours replace them (~).`);
  }
  return notes;
}

/** The problems of one session. */
export function sessionProblems({ hello, state, reason }: Session, facts: Facts): string[] {
  if (!hello) return [];
  const insole = `The ${hello.side} insole`;
  switch (state) {
    case "other-version":
      return [
        `${insole} (firmware ${hello.firmware}) uses protocol ${hello.major}.${hello.minor}, but this page uses ` +
          `${facts.major}.${facts.minor}. Update the older of the two.`,
      ];
    case "same-foot":
      return [`Both insoles are for the ${hello.side} foot. Reload the page, and connect one for each foot.`];
    case "lost":
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
      return ["panic", "watchdog"].includes(hello.reset)
        ? [`${insole} restarted after a fault. If this happens often, report this text to its supplier: ${hello.fault}`]
        : [`${insole} measures, but reports a fault. If it remains after a restart, show this text to its supplier: ${hello.fault}`];
    case "closed":
    case "waiting":
      return [];
  }
}

/** Remarks that require no action. */
export function remarks(insoles: Insoles): string[] {
  const { transport, sessions } = insoles;
  if (transport?.is_replay) return ["This is a recording."];
  const without_parameters = SIDES.filter((side) => insoles.of(side)?.hello?.has_parameters === false);
  if (without_parameters.length > 0) {
    return [`Your personal parameters are not on the ${without_parameters.join(" and ")} insole, so no model values are shown.`];
  }
  const waiting = sessions.reduce((sum, session) => sum + session.records_waiting, 0);
  if (waiting >= MANY_RECORDS) {
    return [`Stored steps are arriving: ${waiting} steps, load bouts and alerts are still to come.`];
  }
  const changed = SIDES.filter((side) => insoles.of(side)?.state === "live" && insoles.of(side)?.needs_refit);
  if (changed.length > 0) {
    return [
      `The ${changed.join(" and ")} foot or its shoe has changed since your parameters were identified. ` +
        "Check that the insole lies flat in the shoe. If this message remains, choose \"Identify my tissue\" in the settings.",
    ];
  }
  const is_waiting = sessions.every(({ state }) => state === "closed" || state === "waiting");
  return transport && is_waiting ? [`Waiting for an insole ${transport.location}.`] : [];
}
