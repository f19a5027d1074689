/** Functions for the document of the page. */

/** Text, or an element with its name, attributes and children. */
export type Node = string | [name: string, attributes: Record<string, string>, ...children: Node[]];

/** The element with this id, which index.html contains. */
export function byId<T extends HTMLElement = HTMLElement>(id: string, type?: new () => T): T {
  const element = document.getElementById(id);
  if (!element || (type && !(element instanceof type))) throw new Error(`index.html lacks ${id}`);
  return element as T;
}

const SVG = "http://www.w3.org/2000/svg";

function build(node: Node, parent: Element): globalThis.Node {
  if (typeof node === "string") return document.createTextNode(node);
  const [name, attributes, ...children] = node;
  const is_svg = name === "svg" || parent.namespaceURI === SVG;
  const element = is_svg ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children.map((child) => build(child, element)));
  return element;
}

/** The last content that {@link fill} wrote to each element. */
const filled = new WeakMap<Element, string>();

/** Replaces the content of an element if it differs. */
export function fill(into: string | Element | null, nodes: readonly Node[]): void {
  const element = typeof into === "string" ? byId(into) : into;
  const content = JSON.stringify(nodes);
  if (!element || filled.get(element) === content) return;
  filled.set(element, content);
  element.replaceChildren(...nodes.map((node) => build(node, element)));
}

/** Saves a file as a download. */
export function download(name: string, type: string, parts: BlobPart[]): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(parts, { type }));
  link.download = name;
  link.click();
  // The download has started by this time.
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
