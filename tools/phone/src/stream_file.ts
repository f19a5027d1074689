/**
 * A recorded stream of messages. Each entry consists of the time in ms (u32), the index of the insole (u8), the length of the
 * message (u16) and the message. Numbers are little endian.
 */

import { INSOLES, type Insole } from "./transport/transport";

/** Length of an entry without its message, bytes. */
const HEAD_BYTES = 7;
/** Length of the longest message of the protocol, bytes: `MAX_MESSAGE` in `src/protocol/codec.rs`. */
export const MAX_MESSAGE = 560;

/** A recorded message. */
export interface Entry {
  /** Time since the start of the recording. */
  t_ms: number;
  insole: Insole;
  message: Uint8Array;
}

/** True if a message can have this length, bytes. No message is empty. */
export const isMessageLength = (length: number) => length >= 1 && length <= MAX_MESSAGE;

/**
 * The entries of a file. If the recorder was interrupted while it wrote, the last entry is incomplete; it is omitted. Throws an
 * error with a message for the wearer if the file is damaged; with the message `foreign` if its first entry is not valid.
 */
export function* entries(bytes: Uint8Array, foreign = ""): Generator<Entry> {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  for (let offset = 0; offset < bytes.length; ) {
    if (offset + HEAD_BYTES > bytes.length) return;
    const length = view.getUint16(offset + 5, true);
    const insole = INSOLES.find((index) => index === bytes[offset + 4]);
    // An entry with a damaged length must not be taken for an incomplete last entry.
    if (insole === undefined || !isMessageLength(length)) {
      throw new Error((offset === 0 && foreign) || `This recording is damaged at byte ${offset}. Use another one.`);
    }
    const start = offset + HEAD_BYTES;
    if (start + length > bytes.length) return;
    yield { t_ms: view.getUint32(offset, true), insole, message: bytes.subarray(start, start + length) };
    offset = start + length;
  }
}

/** Encodes an entry. */
export function entry({ t_ms, insole, message }: Entry): Uint8Array {
  const bytes = new Uint8Array(HEAD_BYTES + message.length);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, t_ms, true);
  view.setUint8(4, insole);
  view.setUint16(5, message.length, true);
  bytes.set(message, HEAD_BYTES);
  return bytes;
}
