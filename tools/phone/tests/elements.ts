/** Replaces src/dom.ts in tests without a document: `vi.mock("../src/dom", async () => (await import("./elements")).dom)`. */

/** An element of the page, of any type. */
export class FakeElement {
  hidden = false;
  disabled = false;
  checked = false;
  indeterminate = false;
  /** The content that was filled in last, as JSON. */
  content = "";
  /** The value of an input field. */
  value = "";
  readonly attributes: Record<string, string> = {};
  readonly dataset: Record<string, string> = {};
  constructor(readonly id = "") {}
  onclick = (_event?: unknown): void => undefined;
  onchange = (): void => undefined;
  oninput = (): void => undefined;
  addEventListener = (): void => undefined;
  setAttribute = (name: string, value: string): void => void (this.attributes[name] = value);
  getAttribute = (name: string): string | null => this.attributes[name] ?? null;
  querySelector = (): null => null;
  focus = (): void => undefined;
  scrollIntoView = (): void => undefined;
}

const elements = new Map<string, FakeElement>();

/** The element with this id. It is created by the first call. */
export function element(id: string): FakeElement {
  const known = elements.get(id) ?? new FakeElement(id);
  elements.set(id, known);
  return known;
}

export const dom = {
  RELOAD: ["button", { "data-action": "reload" }, "Reload"],
  byId: element,
  fill(into: string | null, nodes: unknown[]): void {
    if (into !== null) element(into).content = JSON.stringify(nodes);
  },
  download: (): void => undefined,
};
