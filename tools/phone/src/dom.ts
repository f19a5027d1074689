/** Functions that read and change the HTML document. */

/** A text, or an element: its name, its attributes and its children. */
export type Node = string | [name: string, attributes: Record<string, string>, ...children: Node[]];

/** A button that loads the page again. The installed page has no other one. */
export const RELOAD: Node = ["button", { "data-action": "reload" }, "Reload"];

/** The element of index.html with this id. Throws an error if there is none, or if it is not of this type. */
export function byId<T extends HTMLElement = HTMLElement>(id: string, type?: new () => T): T {
  const element = document.getElementById(id);
  if (!element || (type && !(element instanceof type))) throw new Error(`No element ${id} of this type`);
  return element as T;
}

const SVG = "http://www.w3.org/2000/svg";

/** The attributes with the key of a control or a note among the children of an element. Other nodes have none. */
const KEYS = ["id", "data-action", "data-key"];
/** The key of a node; empty if it has none. */
const keyOf = (node: Node) => (typeof node === "string" ? "" : (KEYS.map((name) => node[1][name]).find(Boolean) ?? ""));

/** True if a child of an element can become the element or text of a node by changes of its attributes and its content. */
function fits(child: ChildNode, node: Node): boolean {
  if (typeof node === "string") return child.nodeType === document.TEXT_NODE;
  if (!(child instanceof Element) || child.localName !== node[0]) return false;
  return (KEYS.map((name) => child.getAttribute(name)).find(Boolean) ?? "") === keyOf(node);
}

/** Creates the element or text of a node, to be inserted into `parent`. */
function build(node: Node, parent: Element): globalThis.Node {
  if (typeof node === "string") return document.createTextNode(node);
  const is_svg = node[0] === "svg" || parent.namespaceURI === SVG;
  const element = is_svg ? document.createElementNS(SVG, node[0]) : document.createElement(node[0]);
  update(element, node);
  return element;
}

/** Gives an element or text that {@link fits} a node the attributes and the content of the node. */
function update(child: globalThis.Node, node: Node): void {
  if (typeof node === "string") {
    if (child.nodeValue !== node) child.nodeValue = node;
    return;
  }
  const [, attributes, ...children] = node;
  const element = child as Element;
  for (const name of element.getAttributeNames()) {
    // The attribute `open` of a `details` element changes when the wearer opens or closes it.
    if (!(name in attributes) && name !== "open") element.removeAttribute(name);
  }
  for (const [name, value] of Object.entries(attributes)) {
    if (element.getAttribute(name) !== value) element.setAttribute(name, value);
  }
  updateChildren(element, children);
}

/** Gives an element this content. Its children that fit remain: a button that is pressed must still exist when it is released. */
function updateChildren(parent: Element, nodes: readonly Node[]): void {
  let next = parent.firstChild;
  for (const node of nodes) {
    let match = next;
    // A node with a key remains although other content before it has gone.
    if (keyOf(node)) while (match && !fits(match, node)) match = match.nextSibling;
    if (!match || !fits(match, node)) {
      parent.insertBefore(build(node, parent), next);
      continue;
    }
    removeSiblings(next, match);
    update(match, node);
    next = match.nextSibling;
  }
  removeSiblings(next, null);
}

/** Removes a child and its following siblings up to `end`, which remains; all of them if `end` is `null`. */
function removeSiblings(first: ChildNode | null, end: ChildNode | null): void {
  while (first && first !== end) {
    const gone = first;
    first = gone.nextSibling;
    gone.remove();
  }
}

/** The content that {@link fill} wrote to each element last, as JSON. */
const filled = new WeakMap<Element, string>();

/**
 * Replaces the content of an element, given by itself or by its id, unless it is unchanged since the last call; does nothing if
 * `into` is `null`. Nodes with the same id, `data-action` or `data-key` remain, with the keyboard focus, as long as their order
 * and their parents stay the same.
 */
export function fill(into: string | Element | null, nodes: readonly Node[]): void {
  const element = typeof into === "string" ? byId(into) : into;
  const content = JSON.stringify(nodes);
  if (!element || filled.get(element) === content) return;
  filled.set(element, content);
  updateChildren(element, nodes);
}

/** Saves a file as a download. */
export function download(name: string, type: string, parts: BlobPart[]): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(parts, { type }));
  link.download = name;
  link.click();
  // The browser reads the data after the click, so the data must remain available until the download has started.
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
