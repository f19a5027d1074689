/** Functions that read and change the HTML document. */

/** A text, or an element: its name, its attributes and its children. */
export type Node = string | [name: string, attributes: Record<string, string>, ...children: Node[]];

/** The element of index.html with this id. Throws an error if there is none, or if it is not of this type. */
export function byId<T extends HTMLElement = HTMLElement>(id: string, type?: new () => T): T {
  const element = document.getElementById(id);
  if (!element || (type && !(element instanceof type))) throw new Error(`index.html has no element ${id} of the expected type`);
  return element as T;
}

const SVG = "http://www.w3.org/2000/svg";

/** Creates the element or text of a node, to be appended to `parent`. */
function build(node: Node, parent: Element): globalThis.Node {
  if (typeof node === "string") return document.createTextNode(node);
  const [name, attributes, ...children] = node;
  const is_svg = name === "svg" || parent.namespaceURI === SVG;
  const element = is_svg ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children.map((child) => build(child, element)));
  return element;
}

/** The content that {@link fill} wrote to each element last, as JSON. */
const filled = new WeakMap<Element, string>();

/**
 * Replaces the content of an element, given by itself or by its id, unless it is unchanged since the last call. The keyboard
 * focus remains on the element with the same id or the same `data-action`.
 */
export function fill(into: string | Element | null, nodes: readonly Node[]): void {
  const element = typeof into === "string" ? byId(into) : into;
  const content = JSON.stringify(nodes);
  if (!element || filled.get(element) === content) return;
  const focused = element.contains(document.activeElement) ? document.activeElement : null;
  // Replacing a select would close its list, so the content remains until a later call.
  if (focused instanceof HTMLSelectElement) return;
  const action = focused?.getAttribute("data-action");
  const same = focused?.id ? `#${focused.id}` : action && `[data-action="${action}"]`;
  filled.set(element, content);
  element.replaceChildren(...nodes.map((node) => build(node, element)));
  if (same) element.querySelector<HTMLElement>(same)?.focus({ preventScroll: true });
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
