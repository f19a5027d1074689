import { expect, test } from "vitest";
import type { RegionResult } from "../src/identify_core";
import { regionRow } from "../src/identify_view";

/** The row of a fitted region with this interval of the stiffness, as JSON. */
function row(jacobian: [number | null, number | null]): string {
  const intervals_95 = { stiffness_pa: { jacobian, at_bound: false, told: true } };
  const nrmse_percent = { fitted: 5, predicted: 6, floor: 1 };
  const region = { fitted: true, identified: { stiffness_pa: 20_000 }, uncertainty: { intervals_95 }, nrmse_percent };
  return JSON.stringify(regionRow("heel", region as unknown as RegionResult));
}

test("the interval of a stiffness is shown with its ends in kPa, also if its upper end is infinite", () => {
  expect(row([9_500, 41_200])).toContain("9.5 to 41");
  expect(row([9_500, null])).toContain("9.5 to ∞");
});
