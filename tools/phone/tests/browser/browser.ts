/** Starts Chromium, serves the page, and opens it. */

import { spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import type { AddressInfo } from "node:net";
import { delimiter, extname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { type Browser, type BrowserContextOptions, type Page, chromium } from "playwright-core";
import { afterAll, beforeAll } from "vitest";

/** The absolute path of a file or folder in tools/phone. */
export const phonePath = (path: string) => fileURLToPath(new URL(`../../${path}`, import.meta.url));
export const DIST = phonePath("dist");

/** The path of Chromium: `PLANTAR_CHROMIUM`, or the first that `PATH` contains. */
function browserPath(): string | undefined {
  const named = process.env["PLANTAR_CHROMIUM"];
  if (named) return named;
  const folders = (process.env["PATH"] ?? "").split(delimiter);
  const names = ["chromium", "chromium-browser", "google-chrome"];
  return names.flatMap((name) => folders.map((path) => join(path, name))).find(existsSync);
}

export function launch(): Promise<Browser> {
  const executablePath = browserPath();
  if (!executablePath) throw new Error("Chromium was not found: install it, or set PLANTAR_CHROMIUM to its path");
  const quiet = ["--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"];
  const args = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--enable-features=WebBluetooth", ...quiet];
  return chromium.launch({ executablePath, args });
}

const TYPES: Record<string, string> = {
  ".html": "text/html",
  ".js": "text/javascript",
  ".css": "text/css",
  ".wasm": "application/wasm",
  ".svg": "image/svg+xml",
  ".webmanifest": "application/manifest+json",
};

/** Serves the files of the built page, without insoles. */
async function serveFiles(): Promise<{ url: string; close(): void }> {
  const server = createServer((request, response) => {
    const path = new URL(request.url ?? "/", "http://localhost").pathname;
    const file = join(DIST, path === "/" ? "index.html" : path);
    readFile(file).then(
      (bytes) => response.writeHead(200, { "content-type": TYPES[extname(file)] ?? "application/octet-stream" }).end(bytes),
      () => response.writeHead(404).end(),
    );
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  const { port } = server.address() as AddressInfo;
  return { url: `http://localhost:${port}/`, close: () => server.close() };
}

/** Starts `plantar serve` and waits until it prints the address of the page. */
export async function servePlantar(program: string, args: string[]): Promise<{ url: string; end(): Promise<void> }> {
  const child = spawn(program, ["serve", "--port", "0", "--page", DIST, ...args], { stdio: ["ignore", "pipe", "inherit"] });
  const ended = new Promise<number | null>((resolve) => child.once("exit", resolve));
  const url = new Promise<string>((resolve, reject) => {
    let output = "";
    child.once("error", reject);
    child.stdout.on("data", (text: Buffer) => {
      output += text.toString();
      const url = /http:\S+/.exec(output)?.[0];
      if (url) resolve(url);
    });
    void ended.then((status) => reject(new Error(`plantar serve ended with ${status}`)));
  });
  // On this signal, `plantar serve` also ends the emulators.
  const end = async () => {
    child.kill("SIGTERM");
    await ended;
  };
  return { url: await url, end };
}

/** Opens a page. An error in the page fails the test when the page is closed. */
export async function open(browser: Browser, url: string, options: BrowserContextOptions = {}): Promise<Page> {
  const context = await browser.newContext(options);
  const page = await context.newPage();
  const errors: string[] = [];
  page.on("pageerror", ({ message }) => errors.push(message));
  page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
  page.on("close", () => {
    if (errors.length > 0) throw new Error(errors.join("\n"));
  });
  await page.goto(url);
  return page;
}

/** Waits until a load is drawn. Returns the time from the request of the page to this drawing, ms. */
export async function firstLoad_ms(page: Page): Promise<number> {
  const mark = await page.waitForFunction(() => performance.getEntriesByName("first-load")[0]?.startTime);
  return (await mark.jsonValue()) as number;
}

/** The size of a phone's screen, CSS pixels. */
export const PHONE = { width: 390, height: 844 };

/** Starts a browser and serves the built page for the tests of a test file. Both are available from the first test on. */
export function servedBrowser(): { browser: Browser; url: string } {
  const served = {} as { browser: Browser; url: string };
  let close = (): void => undefined;
  beforeAll(async () => {
    const files = await serveFiles();
    Object.assign(served, { browser: await launch(), url: files.url });
    close = files.close;
  });
  afterAll(async () => {
    await served.browser.close();
    close();
  });
  return served;
}
