/**
 * A message is divided into fragments, and each Bluetooth value contains one fragment. The first byte of a fragment is a header:
 * bit 7 marks the last fragment of a message, and bits 0 to 6 are the number of the fragment, counted from 0.
 */

import { joined } from "../bytes";

/** The bit of the header that marks the last fragment. */
const LAST = 0x80;
/** The bits of the header that contain the number of the fragment. */
const NUMBER = 0x7f;

/** Joins fragments to messages. `damaged` is called once for each message that cannot be joined. */
export class Fragments {
  private fragments: Uint8Array[] = [];
  /** True after a fragment was missing, until the next message starts. Further fragments of the damaged message are ignored. */
  private is_skipping = false;

  constructor(private readonly damaged: () => void) {}

  /** Adds a fragment; returns the message if it is complete. */
  push(value: Uint8Array): Uint8Array | undefined {
    const header = value[0];
    if (header === undefined) return this.is_skipping ? undefined : this.drop();
    const number = header & NUMBER;
    if (number === 0) {
      if (this.fragments.length > 0) this.drop();
      this.is_skipping = false;
    } else if (this.is_skipping) {
      return undefined;
    } else if (number !== this.fragments.length) {
      return this.drop();
    }
    this.fragments.push(value.slice(1));
    if ((header & LAST) === 0) return undefined;
    const fragments = this.fragments;
    this.fragments = [];
    return joined(fragments);
  }

  private drop(): undefined {
    this.fragments = [];
    this.is_skipping = true;
    this.damaged();
    return undefined;
  }
}

/** Divides a message into fragments of at most `longest` bytes, including the header. */
export function* fragments(message: Uint8Array, longest: number): Generator<Uint8Array<ArrayBuffer>> {
  const payload = longest - 1;
  const count = Math.max(1, Math.ceil(message.length / payload));
  for (let i = 0; i < count; i += 1) {
    const header = (i === count - 1 ? LAST : 0) | i;
    yield Uint8Array.of(header, ...message.subarray(i * payload, (i + 1) * payload));
  }
}
