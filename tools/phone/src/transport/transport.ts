/** A transport carries complete messages of the protocol between the page and up to two insoles, in both directions. */

/** The indices of the insoles. */
export const INSOLES = [0, 1] as const;
/** Index of an insole on its transport. The index does not depend on the foot, which the insole reports in its hello. */
export type Insole = (typeof INSOLES)[number];

/** Events of a transport. */
export interface TransportEvents {
  /**
   * The link of an insole is open, but no message has arrived over it yet. `plantar serve` and a recording have one link for
   * both indices, so both are reported, even if there is only one insole.
   */
  opened(insole: Insole): void;
  /** A message arrived. `bytes` is the encoded message. */
  message(insole: Insole, bytes: Uint8Array): void;
  /**
   * The link broke, the insole did not accept this phone, or `plantar serve` could not be reached. `reason` is a phrase for the
   * wearer. The transport tries to open the link again, unless the first attempt to connect an insole over Bluetooth has failed.
   */
  closed(insole: Insole, reason: string): void;
  /** A message could not be received, because one of its fragments is missing or damaged. */
  damaged(insole: Insole): void;
  /** The insole reported the charge of its battery. */
  battery(insole: Insole, percent: number): void;
}

/** A transport. */
export interface Transport {
  /** Completes the sentence "Waiting for an insole ..." for the wearer, for example by "over Bluetooth". */
  readonly location: string;
  /** True if the messages come from a recording. Their steps must not be stored as the wearer's steps. */
  readonly is_replay: boolean;
  /** True if no insole is connected, and none is awaited. Absent for transports that always await insoles. */
  readonly is_idle?: boolean;
  /** True if the insoles are connected by radio, so that it helps to hold the phone closer to them. */
  readonly is_radio?: boolean;
  /**
   * True if the page must detect missing records, and request them again. Not for `plantar serve`: while its link is open, no
   * record is lost, and it may not have those that are missing after an interruption any more. A recording answers no requests.
   */
  readonly can_lose_records: boolean;
  /** Sends an encoded message. A message to an insole that is not connected is dropped. */
  send(insole: Insole, message: Uint8Array): void;
  close(): void;
}
