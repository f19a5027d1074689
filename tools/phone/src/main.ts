import "./style.css";
import { App } from "./app";
import { RELOAD, byId, fill } from "./dom";
import { errorText } from "./format";
import wasm from "./phone_wire.wasm?url";
import { Wire } from "./wire";

try {
  const wire = await Wire.load(fetch(wasm));
  await new App(wire).start();
} catch (error) {
  const problem = `The page could not start. Reload it, or use another browser. The reason: ${errorText(error)}`;
  fill("notes", [["p", { class: "note" }, problem, RELOAD]]);
  byId("notes").onclick = () => location.reload();
  throw error;
}

if (import.meta.env.PROD && "serviceWorker" in navigator) {
  // If the registration fails, the page works, but not offline.
  navigator.serviceWorker.register("./sw.js").catch(() => undefined);
}
