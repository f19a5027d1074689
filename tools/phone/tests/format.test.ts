import { expect, test, vi } from "vitest";
import { areaTitle, quantityNote, signedText, timeText } from "../src/format";

const LEFT = { side: "left", has_effective_areas: true } as const;
const RIGHT = { side: "right", has_effective_areas: false } as const;

test("the name of an area and its note state the contact rule of the insoles", () => {
  expect([areaTitle([]), areaTitle([RIGHT])]).toEqual(["Contact area", "Contact area"]);
  expect(areaTitle([LEFT])).toBe("Effective area");
  const counted = "Cells with contact count with their whole area.";
  expect([quantityNote("area", []), quantityNote("area", [RIGHT])]).toEqual([counted, counted]);
  const both = [LEFT, { ...RIGHT, has_effective_areas: true }];
  expect(areaTitle(both)).toBe("Effective area");
  expect(quantityNote("area", both)).toMatch(/^Each cell counts with the share of its area that the foot covers/);
});

test("if the insoles have different contact rules, the name states none, and the note that of each foot", () => {
  expect(areaTitle([LEFT, RIGHT])).toBe("Area");
  expect(quantityNote("area", [LEFT, RIGHT])).toBe(
    "The areas of the feet cannot be compared. Left, effective area: Each cell counts with the share of its area that " +
      "the foot covers, estimated from its pressure. So the sum depends on pressure and cell size. " +
      "Right, contact area: Cells with contact count with their whole area.",
  );
  expect(quantityNote("model", [LEFT, RIGHT])).toBe("");
});

test("the sign of a number that is rounded to zero is omitted", () => {
  expect([-0.04, 0, -0.06, -10].map((value) => signedText(value, 1))).toEqual(["0.0", "0.0", "-0.1", "-10.0"]);
  expect(signedText(-0.4, 0)).toBe("0");
});

test("a time of another day has its date", () => {
  vi.useFakeTimers({ now: new Date(2026, 0, 2, 12) });
  const text = (day: number) => timeText(new Date(2026, 0, day, 10, 42).getTime() / 1000);
  expect(text(2)).toMatch(/^10:42/);
  expect(text(1)).toMatch(/Jan.*10:42/);
  vi.useRealTimers();
});
