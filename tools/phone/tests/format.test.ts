import { expect, test } from "vitest";
import { areaTitle, quantityNote } from "../src/format";

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
