/** A way to insoles: whole wire messages, unframed, in both directions. */

export const INSOLES = [0, 1] as const;
/** Which insole of a transport; which foot it is on, its hello says. */
export type Insole = (typeof INSOLES)[number];

export interface TransportEvents {
  /** The way to an insole is open; it has not said anything yet. */
  opened(insole: Insole): void;
  message(insole: Insole, bytes: Uint8Array): void;
  /** The way is closed, with words for people. The transport tries again by itself where it can. */
  closed(insole: Insole, reason: string): void;
  /** A message arrived in pieces that do not fit. */
  damaged(insole: Insole): void;
  battery(insole: Insole, percent: number): void;
}

export interface Transport {
  /** For people. */
  readonly name: string;
  /** True where what it brings is played and not to be kept as the wearer's. */
  readonly is_replay: boolean;
  send(insole: Insole, message: Uint8Array): void;
  close(): void;
}
