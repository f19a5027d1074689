/** Messages over Bluetooth values: each value begins with a byte, bit 7 set on the last piece, bits 0 to 6 its number. */

const LAST = 0x80;
const NUMBER = 0x7f;

/** Puts messages together. */
export class Fragments {
  private pieces: Uint8Array[] = [];
  /** Waiting for the start of a message after a piece was missing. */
  private skipping = false;

  constructor(private readonly damaged: () => void) {}

  /** The message that this value completes. */
  push(value: Uint8Array): Uint8Array | undefined {
    const head = value[0];
    if (head === undefined) return this.drop();
    const number = head & NUMBER;
    if (number === 0) {
      if (this.pieces.length > 0) this.drop();
      this.skipping = false;
    } else if (this.skipping) {
      return undefined;
    } else if (number !== this.pieces.length) {
      return this.drop();
    }
    this.pieces.push(value.slice(1));
    if ((head & LAST) === 0) return undefined;
    const pieces = this.pieces;
    this.pieces = [];
    const message = new Uint8Array(pieces.reduce((sum, piece) => sum + piece.length, 0));
    let at = 0;
    for (const piece of pieces) {
      message.set(piece, at);
      at += piece.length;
    }
    return message;
  }

  private drop(): undefined {
    this.pieces = [];
    this.skipping = true;
    this.damaged();
    return undefined;
  }
}

/** A message in values of at most `most` bytes. */
export function* fragments(message: Uint8Array, most: number): Generator<Uint8Array<ArrayBuffer>> {
  const payload = most - 1;
  const count = Math.max(1, Math.ceil(message.length / payload));
  for (let i = 0; i < count; i += 1) {
    const head = (i === count - 1 ? LAST : 0) | i;
    yield Uint8Array.of(head, ...message.subarray(i * payload, (i + 1) * payload));
  }
}
