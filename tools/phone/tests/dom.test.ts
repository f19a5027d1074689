import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { type Node, fill } from "../src/dom";

const TEXT_NODE = 3;

/** Replaces the elements and texts of the browser, as far as `fill` needs them. */
class FakeNode {
  parent: FakeNode | null = null;
  children: FakeNode[] = [];
  private readonly attributes = new Map<string, string>();
  constructor(
    readonly localName: string,
    readonly nodeType = 1,
    public nodeValue = "",
  ) {}
  get id(): string {
    return this.getAttribute("id") ?? "";
  }
  get firstChild(): FakeNode | null {
    return this.children[0] ?? null;
  }
  get nextSibling(): FakeNode | null {
    const siblings = this.parent!.children;
    return siblings[siblings.indexOf(this) + 1] ?? null;
  }
  getAttribute = (name: string) => this.attributes.get(name) ?? null;
  getAttributeNames = () => [...this.attributes.keys()];
  setAttribute = (name: string, value: string) => void this.attributes.set(name, value);
  removeAttribute = (name: string) => void this.attributes.delete(name);
  insertBefore(child: FakeNode, next: FakeNode | null): void {
    child.parent = this;
    this.children.splice(next ? this.children.indexOf(next) : this.children.length, 0, child);
  }
  remove = () => void (this.parent!.children = this.parent!.children.filter((child) => child !== this));
  text = (): string => this.localName + this.nodeValue + this.children.map((child) => child.text()).join("");
}

beforeEach(() => {
  vi.stubGlobal("Element", FakeNode);
  const createTextNode = (text: string) => new FakeNode("", TEXT_NODE, text);
  vi.stubGlobal("document", { TEXT_NODE, createElement: (name: string) => new FakeNode(name), createTextNode });
});
afterEach(() => void vi.unstubAllGlobals());

/** An element with this content, and a function that fills in another content. */
function filled(content: Node[]) {
  const element = new FakeNode("");
  const refill = (nodes: Node[]) => fill(element as unknown as Element, nodes);
  refill(content);
  return { element, refill };
}

test.each<Record<string, string>>([{ id: "a" }, { "data-action": "a" }])("a button with %o remains when other content changes", (key) => {
  const { element, refill } = filled([["p", {}, "1"], ["p", {}, "2"], ["button", { ...key, class: "primary" }, "3"]]);
  const button = element.children[2];
  refill([["b", {}, "4"], ["button", key, "5"], ["button", { id: "c" }, "6"]]);
  expect(element.text()).toBe("b4button5button6");
  expect(element.children[1]).toBe(button);
  expect(button!.getAttributeNames()).toEqual(Object.keys(key));
  refill([["p", {}, "7"], ["p", {}, "8"], ["p", {}, "9"], ["button", key, "5"]]);
  expect(element.text()).toBe("p7p8p9button5");
  expect(element.children[3]).toBe(button);
});

test("a button does not become the button of another action", () => {
  const { element, refill } = filled([["button", { "data-action": "a" }, "1"], ["button", { "data-action": "b" }, "2"]]);
  const [, second] = element.children;
  refill([["button", { "data-action": "b" }, "2"], ["button", { "data-action": "a" }, "1"]]);
  expect(element.text()).toBe("button2button1");
  expect(element.children[0]).toBe(second);
});

test("a note remains the same element when others come and go before it, so that a screen reader does not speak it again", () => {
  const note = (key: string): Node => ["p", { "data-key": key }, key];
  const { element, refill } = filled([note("b"), note("c")]);
  const [b, c] = element.children;
  refill([note("a"), note("b"), note("c")]);
  expect(element.text()).toBe("papbpc");
  expect(element.children.slice(1)).toEqual([b, c]);
  refill([note("c")]);
  expect([element.text(), element.children[0] === c]).toEqual(["pc", true]);
});

test("the content around a select changes, but not the select", () => {
  const select = (size: string): Node => ["select", { id: "size" }, ["option", {}, size]];
  const { element, refill } = filled([select("42"), "1"]);
  const before = element.firstChild!;
  const option = before.firstChild;
  refill([["p", {}, "2"], select("42"), "3"]);
  expect(element.text()).toBe("p2selectoption423");
  expect([element.children[1], before.firstChild]).toEqual([before, option]);
});

test("details that the wearer has opened remain open", () => {
  const details = (text: string): Node => ["details", {}, ["summary", {}, text]];
  const { element, refill } = filled([details("1")]);
  element.firstChild!.setAttribute("open", "");
  refill([details("2")]);
  expect(element.firstChild!.getAttribute("open")).toBe("");
});
