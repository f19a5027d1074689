import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { type Node, fill } from "../src/dom";

/** Replaces the browser's elements and texts, as far as `fill` needs them. */
class FakeElement {
  private children: FakeElement[] = [];
  private readonly attributes = new Map<string, string>();
  constructor(readonly name: string) {}
  get id(): string {
    return this.getAttribute("id") ?? "";
  }
  getAttribute = (key: string) => this.attributes.get(key) ?? null;
  setAttribute = (key: string, value: string) => void this.attributes.set(key, value);
  append = (...children: FakeElement[]) => void this.children.push(...children);
  focus = () => void (page.activeElement = this);
  contains(other: FakeElement | null): boolean {
    return other === this || this.children.some((child) => child.contains(other));
  }
  replaceChildren(...children: FakeElement[]): void {
    if (this.contains(page.activeElement)) page.activeElement = null;
    this.children = children;
  }
  /** The first element with this `#id` or `[data-action="..."]`. */
  querySelector(selector: string): FakeElement | null {
    if ([`#${this.id}`, `[data-action="${this.getAttribute("data-action")}"]`].includes(selector)) return this;
    return this.children.map((child) => child.querySelector(selector)).find((found) => found !== null) ?? null;
  }
  text = (): string => this.name + this.children.map((child) => child.text()).join("");
}
class FakeSelect extends FakeElement {}

const create = (name: string) => (name === "select" ? new FakeSelect(name) : new FakeElement(name));
/** Replaces the document of the page. */
const page = { activeElement: null as FakeElement | null, createElement: create, createTextNode: create };

beforeEach(() => {
  vi.stubGlobal("document", page);
  vi.stubGlobal("HTMLSelectElement", FakeSelect);
});
afterEach(() => void vi.unstubAllGlobals());

/** An element with this content, and a function that fills in another content. */
function filled(content: Node[]) {
  const element = new FakeElement("");
  const refill = (nodes: Node[]) => fill(element as unknown as Element, nodes);
  refill(content);
  return { element, refill };
}

const identified: Record<string, string>[] = [{ id: "a" }, { "data-action": "a" }];
test.each(identified)("a button with %o has the focus again", (attributes) => {
  const { element, refill } = filled([["button", attributes, "1"]]);
  const button = () => element.querySelector("id" in attributes ? "#a" : '[data-action="a"]')!;
  const before = button();
  before.focus();
  refill([["p", {}, "2"], ["button", attributes, "3"]]);
  expect(element.text()).toBe("p2button3");
  expect(page.activeElement).toBe(button());
  expect(button()).not.toBe(before);
});

test("the focus does not move to an element that did not have it", () => {
  const { element, refill } = filled([["button", { "data-action": "a" }, "1"], ["button", { "data-action": "b" }, "1"]]);
  element.querySelector('[data-action="b"]')!.focus();
  refill([["button", { "data-action": "a" }, "1"]]);
  expect(page.activeElement).toBeNull();
});

test("the content around a select that has the focus remains until the focus has left it", () => {
  const { element, refill } = filled([["select", { id: "size" }], "1"]);
  const select = element.querySelector("#size")!;
  select.focus();
  const changed: Node[] = [["select", { id: "size" }], "2"];
  refill(changed);
  expect(element.querySelector("#size")).toBe(select);
  page.activeElement = null;
  refill(changed);
  expect(element.text()).toBe("select2");
});
