/** A link to insoles: whole wire messages, without a frame, in both directions. */

export const INSOLES = [0, 1] as const;
/** Index of an insole on its transport. Its hello reports the foot. */
export type Insole = (typeof INSOLES)[number];

export interface TransportEvents {
  /** The link to an insole is open; the insole has not sent anything yet. */
  opened(insole: Insole): void;
  message(insole: Insole, bytes: Uint8Array): void;
  /** The link broke, with a reason for the wearer. The transport tries again by itself where it can. */
  closed(insole: Insole, reason: string): void;
  /** Fragments of a message do not fit together. */
  damaged(insole: Insole): void;
  battery(insole: Insole, percent: number): void;
}

export interface Transport {
  /** Where the insoles are, for the wearer: "over Bluetooth". */
  readonly place: string;
  /** True for a recording, which must not be stored as the wearer's steps. */
  readonly is_replay: boolean;
  send(insole: Insole, message: Uint8Array): void;
  close(): void;
}
