import "./style.css";
import { App } from "./app";
import wasm from "./phone_wire.wasm?url";
import { Wire } from "./wire";

const wire = await Wire.load(fetch(wasm));
await new App(wire).start();

if (import.meta.env.PROD && "serviceWorker" in navigator) {
  // If the registration fails, the page works, but not offline.
  navigator.serviceWorker.register("./sw.js").catch(() => undefined);
}
