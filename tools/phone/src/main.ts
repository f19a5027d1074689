import "./style.css";
import wasm from "./phone_wire.wasm?url";
import { App } from "./app";
import { Wire } from "./wire";

const wire = await Wire.load(fetch(wasm));
await new App(wire).start();

if (import.meta.env.PROD && "serviceWorker" in navigator) {
  // Without it the page works as before, but not offline.
  navigator.serviceWorker.register("./sw.js").catch(() => undefined);
}
