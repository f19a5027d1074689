/** A link to insoles that carries whole wire messages in both directions, without framing. */

export const INSOLES = [0, 1] as const;
/** Index of an insole on its transport. Its hello reports the foot. */
export type Insole = (typeof INSOLES)[number];

export interface TransportEvents {
  /** The link to an insole is open. The insole has not sent a message yet. */
  opened(insole: Insole): void;
  message(insole: Insole, bytes: Uint8Array): void;
  /** The link broke; `reason` is for the wearer. The transport reconnects by itself if it can. */
  closed(insole: Insole, reason: string): void;
  /** A message is incomplete: a fragment is missing or damaged. */
  damaged(insole: Insole): void;
  battery(insole: Insole, percent: number): void;
}

export interface Transport {
  /** The place of the insoles, for the wearer, such as "over Bluetooth". */
  readonly place: string;
  /** True for a recording, which must not be stored as the wearer's steps. */
  readonly is_replay: boolean;
  send(insole: Insole, message: Uint8Array): void;
  close(): void;
}
