/** The service worker, which vite.config.ts writes. */

import type { Plugin } from "vite";
import { expect, test } from "vitest";
import config from "../vite.config";

const plugin = (config.plugins as Plugin[]).find(({ name }) => name === "offline");

/** The source of the service worker of a page that consists of these bundled files. */
function serviceWorker(files: Record<string, string>): string {
  let worker = "";
  const bundle = Object.fromEntries(Object.entries(files).map(([name, source]) => [name, { type: "asset", source }]));
  const generate = plugin?.generateBundle as unknown as (this: object, options: object, bundle: object) => void;
  generate.call({ emitFile: ({ source }: { source: string }) => (worker = source) }, {}, bundle);
  return worker;
}

interface Asked {
  url: string;
  cache?: string;
}

/** A browser with these files in its HTTP cache, which never change, and a server with those of the present version. */
class Browser {
  readonly caches = new Map<string, Map<string, string>>();
  private server: Record<string, string> = {};
  private readonly http_cache: Record<string, string>;
  private listeners: Record<string, (event: object) => void> = {};

  constructor(first: Record<string, string>) {
    this.http_cache = first;
  }

  private fetch = ({ url, cache }: Asked) =>
    (cache === "reload" ? undefined : this.http_cache[url]) ?? this.server[url] ?? "not found";

  private open(name: string) {
    const files = this.caches.get(name) ?? new Map<string, string>();
    this.caches.set(name, files);
    return {
      addAll: async (asked: (string | Asked)[]) => {
        for (const one of asked) {
          const request = typeof one === "string" ? { url: one } : one;
          files.set(request.url, this.fetch(request));
        }
      },
      match: async (asked: string | Asked) => files.get(typeof asked === "string" ? asked : asked.url),
    };
  }

  private async dispatch(type: string, event: object = {}): Promise<unknown> {
    let result: unknown;
    const wait = (promise: unknown) => (result = promise);
    this.listeners[type]?.({ waitUntil: wait, respondWith: wait, ...event });
    return result;
  }

  /** Installs and activates the service worker of a version. */
  async update(files: Record<string, string>): Promise<void> {
    this.server = files;
    this.listeners = {};
    const scope = {
      addEventListener: (type: string, listener: (event: object) => void) => (this.listeners[type] = listener),
      skipWaiting: () => undefined,
      clients: { claim: () => undefined },
    };
    const caches = {
      open: async (name: string) => this.open(name),
      keys: async () => [...this.caches.keys()],
      delete: async (name: string) => this.caches.delete(name),
      match: async ({ url }: Asked) => [...this.caches.values()].find((cache) => cache.has(url))?.get(url),
    };
    class Request {
      constructor(readonly url: string, readonly options: object = {}) {
        Object.assign(this, options);
      }
    }
    const globals = {
      self: scope, caches, Request, location: { origin: "" }, URL: class { origin = ""; },
      fetch: async (request: Asked) => this.fetch(request),
    };
    const run = new Function(...Object.keys(globals), serviceWorker(files)) as (...values: unknown[]) => void;
    run(...Object.values(globals));
    await this.dispatch("install");
    await this.dispatch("activate");
  }

  /** The file that a page receives. */
  load = (url: string, mode = "no-cors") => this.dispatch("fetch", { request: { method: "GET", url, mode } });
}

/** The files of a version, each with the name of the version as its content: index.html, and a worker with this name. */
const version = (name: string) => ({ "index.html": name, [`worker-${name}.js`]: name });

test("an update stores the files of the server, not those of the HTTP cache", async () => {
  const browser = new Browser(version("a"));
  for (const name of ["a", "b"]) await browser.update(version(name));
  expect(await browser.load("", "navigate")).toBe("b");
});

test("a page of the previous version finds its files after an update, and older caches are deleted", async () => {
  const browser = new Browser({});
  for (const name of ["a", "b", "c"]) {
    await browser.update(version(name));
    if (name === "b") expect(await browser.load("worker-a.js")).toBe("a");
  }
  expect([...browser.caches.values()].map((files) => files.get("index.html"))).toEqual(["b", "c"]);
  expect(await browser.load("worker-b.js")).toBe("b");
  expect(await browser.load("worker-c.js")).toBe("c");
});
