/** Runs the identification in a Web Worker, so that a fit, which takes some seconds, does not block the page. */

import { type Collected, type FootResult, IdentifyCore } from "./identify_core";
import wasm from "./phone_identify.wasm?url";
import { entries } from "./stream_file";
import type { Insole } from "./transport/transport";

/** A request of the page. */
export type Request =
  | { kind: "clear" }
  /** Adds the messages in this part of a stream file. */
  | { kind: "add"; bytes: Uint8Array }
  /** Fits the parameters to the steps of one insole. */
  | { kind: "identify"; insole: Insole; size: number };

/** An answer of the worker. */
export type Answer =
  /** Sent after messages were added or removed, if the number of steps may have changed. */
  | { kind: "collected"; insoles: Collected[] }
  /** The fit of a region is complete. */
  | { kind: "fitted"; region: number }
  | { kind: "result"; insole: Insole; result: FootResult }
  /** A request failed. `reason` is a sentence for the wearer. */
  | { kind: "failed"; reason: string; needs_reload: boolean };

const scope = self as unknown as { postMessage(answer: Answer): void; onmessage: (event: MessageEvent<Request>) => void };
const cannot_load = new Error("The computation could not be loaded.");
const core = IdentifyCore.load(fetch(wasm), (region) => scope.postMessage({ kind: "fitted", region })).catch(() => {
  throw cannot_load;
});

async function execute(request: Request): Promise<void> {
  const loaded = await core;
  switch (request.kind) {
    case "clear":
      loaded.clear();
      return scope.postMessage({ kind: "collected", insoles: loaded.collected() });
    case "add": {
      let has_steps = false;
      for (const { insole, message } of entries(request.bytes)) has_steps = loaded.add(insole, message) || has_steps;
      if (has_steps) scope.postMessage({ kind: "collected", insoles: loaded.collected() });
      return;
    }
    case "identify":
      return scope.postMessage({ kind: "result", insole: request.insole, result: loaded.identify(request.insole, request.size) });
  }
}

scope.onmessage = ({ data }) => {
  execute(data).catch((error: unknown) => {
    // The errors of the WebAssembly module are sentences for the wearer; the messages of its traps are not.
    const isSentence = error instanceof Error && !(error instanceof WebAssembly.RuntimeError);
    const reason = isSentence ? error.message : "The computation failed.";
    scope.postMessage({ kind: "failed", reason, needs_reload: !isSentence || error === cannot_load });
  });
};
