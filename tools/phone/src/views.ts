/** The views of the page, of which one is shown at a time. */

/** The state of the browser's history in which Back shows the live view. */
const OTHER_VIEW = "view";

/** Shows a view. From another view than the live one, Back does not leave the page, which would end a connection by Bluetooth. */
export function showView(view: string): void {
  if (view !== "live" && history.state !== OTHER_VIEW) history.pushState(OTHER_VIEW, "");
  document.body.dataset["view"] = view;
  document.querySelectorAll<HTMLElement>("nav button").forEach((button) => {
    if (button.dataset["to"] === view) button.setAttribute("aria-current", "page");
    else button.removeAttribute("aria-current");
  });
  scrollTo(0, 0);
}
