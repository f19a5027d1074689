import { expect, test } from "vitest";
import { Fragments, fragments } from "../src/transport/fragments";

const message = Uint8Array.from({ length: 282 }, (_, i) => i % 251);

function collect(values: Iterable<Uint8Array>): { messages: Uint8Array[]; damaged: number } {
  let damaged = 0;
  const joiner = new Fragments(() => (damaged += 1));
  const messages = [...values].flatMap((value) => joiner.push(value) ?? []);
  return { messages, damaged };
}

test("a message is joined from values of any size", () => {
  for (const longest of [4, 20, 100, 182, 244, 512]) {
    const values = [...fragments(message, longest)];
    expect(values.every((value) => value.length <= longest)).toBe(true);
    expect(collect([...values, ...values])).toEqual({ messages: [message, message], damaged: 0 });
  }
});

test("the header has the number of the fragment and marks the last one", () => {
  expect([...fragments(Uint8Array.of(1, 2, 3), 3)]).toEqual([Uint8Array.of(0, 1, 2), Uint8Array.of(0x81, 3)]);
  expect([...fragments(Uint8Array.of(7), 20)]).toEqual([Uint8Array.of(0x80, 7)]);
});

test("a lost fragment damages one message, is counted once, and the next message is complete", () => {
  const values = [...fragments(message, 20)];
  for (let lost = 0; lost < values.length; lost += 1) {
    const rest = values.filter((_, i) => i !== lost);
    expect(collect([...rest, ...values])).toEqual({ messages: [message], damaged: 1 });
  }
});

test("an empty value counts as damaged", () => {
  expect(collect([new Uint8Array(0)])).toEqual({ messages: [], damaged: 1 });
  // Further values of the damaged message do not count.
  expect(collect([new Uint8Array(0), new Uint8Array(0)])).toEqual({ messages: [], damaged: 1 });
});
