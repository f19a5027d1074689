/**
 * The identification as WebAssembly in Node.js. It is compared with `plantar fit`: `PLANTAR` is the path of the command line, and
 * `PLANTAR_WALK` that of a computed walk of 60 steps of each foot. `cargo xtask test` sets both. `PLANTAR_FIGURES` is a folder
 * for a file with the duration of the fit and the largest difference.
 */

import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { beforeAll, expect, test } from "vitest";
import { type FootResult, IdentifyCore } from "../src/identify_core";
import { type Entry, entries, entry } from "../src/stream_file";
import type { Insole } from "../src/transport/transport";
import type { Wire } from "../src/wire";
import { loadWire, walk } from "./wire";

const { PLANTAR: plantar, PLANTAR_WALK: long_walk, PLANTAR_FIGURES: figures } = process.env;
if (!plantar || !long_walk) console.log("skipped: set PLANTAR and PLANTAR_WALK (`cargo xtask test` does)");

const fitted: number[] = [];
let core: IdentifyCore;
let wire: Wire;
beforeAll(async () => {
  const bytes = readFileSync(new URL("../src/phone_identify.wasm", import.meta.url));
  const response = new Response(new Uint8Array(bytes), { headers: { "content-type": "application/wasm" } });
  wire = await loadWire();
  core = await IdentifyCore.load(response, (region) => fitted.push(region));
});

function add(messages: Iterable<Entry>): void {
  for (const { insole, message } of messages) core.add(insole, message);
}

test("the steps of both feet are counted once if they are added twice, and can be removed", () => {
  core.clear();
  for (const { insole, message } of [...entries(walk), ...entries(walk)]) core.add(insole, message);
  expect(core.collected().map(({ side, good, rate_hz }) => [side, good, rate_hz])).toEqual([["left", 6, 100], ["right", 6, 100]]);
  core.clear();
  expect(core.collected().map(({ good }) => good)).toEqual([0, 0]);
});

test("a step that lacks more than three successive frames is not used, and other bytes are ignored", () => {
  core.clear();
  const lost = (t_ms: number) => t_ms > 1900 && t_ms < 1950;
  // At this time, the left foot is on the ground in its second step. The record of the step arrives later.
  add([...entries(walk)].filter(({ insole, t_ms }) => insole === 0 && !lost(t_ms)));
  const [left] = core.collected();
  expect([left!.good, left!.excluded]).toEqual([5, { broken: 1, partial: 0, before: 0 }]);
  expect(core.add(0, Uint8Array.of(255, 1, 2))).toBe(false);
  expect(core.add(0, new Uint8Array())).toBe(false);
});

test("a fit reports each region, and returns the parameter file and the request that sends the parameters", () => {
  core.clear();
  fitted.length = 0;
  add(entries(walk));
  const result = core.identify(1, 42);
  expect(fitted.sort()).toEqual([0, 1, 2, 3, 4, 5, 6, 7]);
  expect(result.fitted).toBe(8);
  expect(result.parameters).toContain('side = "right"');
  expect(wire.facts.gatt.parameter_requests).toContain(result.message[0]);
  // Another shoe size gives other parameters, with another identifier, which is not 0 either.
  const other_size_id = core.identify(1, 40).tissue_id;
  expect([0, result.tissue_id]).not.toContain(other_size_id);
});

/** The numbers in a value, with their paths. */
function* numbers(value: unknown, path = ""): Generator<[string, number]> {
  if (typeof value === "number") yield [path, value];
  else if (value !== null && typeof value === "object") {
    for (const [key, item] of Object.entries(value)) yield* numbers(item, `${path}.${key}`);
  }
}

test.skipIf(!plantar || !long_walk)("the parameters of sixty steps equal those of plantar fit", () => {
  const all = [...entries(new Uint8Array(readFileSync(long_walk!)))];
  const folder = mkdtempSync(join(tmpdir(), "plantar-"));
  let worst = { fit_wasm_s: 0, fit_wasm_equal: 0 };
  core.clear();
  add(all);
  try {
    for (const insole of [0, 1] satisfies Insole[]) {
      const path = (name: string) => join(folder, name);
      const [stream, json, toml] = [path("walk.plantar"), path("fit.json"), path("fit.toml")];
      writeFileSync(stream, Buffer.concat(all.filter((item) => item.insole === insole).map(entry)));
      const run = spawnSync(plantar!, ["fit", stream, "--json", json, "--out", toml]);
      expect(run.status, run.stderr.toString()).toBe(0);
      const native = JSON.parse(readFileSync(json, "utf8")) as FootResult;
      const start_ms = performance.now();
      const result = core.identify(insole, 42);
      const duration_s = (performance.now() - start_ms) / 1000;
      expect(result.steps.length).toBe(60);
      let largest_difference = 0;
      for (const [name, region] of Object.entries(native.regions)) {
        const ours = result.regions[name]!;
        if (!region.fitted || !ours.fitted) throw new Error(`${name} was not fitted`);
        // These keys only: the others contain intervals from resampled steps, which only `plantar fit` computes.
        for (const key of ["identified", "ellipsoid", "nrmse_percent"] as const) {
          const found = new Map(numbers(ours[key]));
          for (const [path, value] of numbers(region[key])) {
            // Infinite values have no ratio, so equal values are compared first.
            const difference = value === found.get(path) ? 0 : Math.abs((found.get(path) ?? Infinity) / value - 1);
            // The predicted error is the mean of sixty fits, each to all steps but one. The steps have no noise, so a fit
            // may end at another point of a flat minimum if WebAssembly and native code round differently.
            const is_prediction = path.startsWith(".predicted");
            if (!is_prediction) largest_difference = Math.max(largest_difference, difference);
            expect(difference, `${name}.${key}${path}`).toBeLessThan(is_prediction ? 1e-2 : 1e-6);
          }
        }
        expect(ours.verdict).toBe(region.verdict);
      }
      worst = {
        fit_wasm_s: Math.max(worst.fit_wasm_s, duration_s),
        fit_wasm_equal: Math.max(worst.fit_wasm_equal, largest_difference),
      };
    }
    console.log(`fit_wasm_s ${worst.fit_wasm_s.toFixed(2)}, fit_wasm_equal ${worst.fit_wasm_equal.toExponential(1)}`);
    if (figures) writeFileSync(join(figures, "identification.json"), JSON.stringify(worst));
  } finally {
    rmSync(folder, { recursive: true });
  }
}, 180_000);
