import { createHash } from "node:crypto";
import type { Plugin } from "vite";
import { defineConfig } from "vitest/config";

/**
 * Writes the service worker. It caches the files that Vite bundles, the manifest and the icon. The name of the cache contains a
 * hash of the bundled files. The manifest and the icon are not part of the hash: a change of them alone does not result in a new
 * cache. The example walk is not cached.
 */
function offline(): Plugin {
  return {
    name: "offline",
    apply: "build",
    // The plugin must run after index.html was generated, because it lists that file.
    enforce: "post",
    generateBundle(_, bundle) {
      const hash = createHash("sha256");
      for (const file of Object.values(bundle)) hash.update(file.type === "chunk" ? file.code : file.source);
      const files = [...Object.keys(bundle), "manifest.webmanifest", "icon.svg"];
      const version = hash.digest("hex").slice(0, 12);
      // The files are requested again, because the HTTP cache of the browser can contain those of an older version. The names of
      // caches are in the order of creation; the newest of the old ones remains, because a page of the previous version that is
      // still open can load further files from it. Every address of the page shows index.html, whatever its query parameters are.
      const source = `const VERSION = "plantar-${version}";
const FILES = ${JSON.stringify(files)};
self.addEventListener("install", (event) => {
  const requests = FILES.map((file) => new Request(file, { cache: "reload" }));
  event.waitUntil(caches.open(VERSION).then((cache) => cache.addAll(requests)).then(() => self.skipWaiting()));
});
self.addEventListener("activate", (event) => {
  const old = (names) => names.filter((name) => name.startsWith("plantar-") && name !== VERSION).slice(0, -1);
  event.waitUntil(
    caches.keys().then((names) => Promise.all(old(names).map((name) => caches.delete(name)))).then(() => self.clients.claim()),
  );
});
self.addEventListener("fetch", (event) => {
  if (event.request.method !== "GET" || new URL(event.request.url).origin !== location.origin) return;
  const respond = async () => {
    const cache = await caches.open(VERSION);
    const file = event.request.mode === "navigate" ? "index.html" : event.request;
    return (await cache.match(file)) ?? (await caches.match(file)) ?? fetch(event.request);
  };
  event.respondWith(respond());
});
`;
      this.emitFile({ type: "asset", fileName: "sw.js", source });
    },
  };
}

/** Removes the indentation of index.html, which no element of the page shows. */
function withoutIndentation(): Plugin {
  return { name: "without-indentation", apply: "build", transformIndexHtml: (html) => html.replace(/\n\s+/g, "\n") };
}

export default defineConfig({
  base: "./",
  build: { target: "es2022", assetsInlineLimit: 0, modulePreload: { polyfill: false } },
  plugins: [offline(), withoutIndentation()],
  test: {
    include: ["tests/**/*.test.ts"],
    // The tests mostly wait for walks that are played in real time, so two test files run at once even on a computer with two
    // cores. More files at once would disturb the walks.
    maxWorkers: 2,
    testTimeout: 60_000,
    hookTimeout: 60_000,
    // The default, one second, is too short for a page on a busy computer.
    expect: { poll: { timeout: 20_000 } },
    reporters: "verbose",
  },
});
