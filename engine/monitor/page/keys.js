// @ts-check
import { h } from "./html.js";

/** What the keys do, in the order of the help. */
export const KEYS = /** @type {[string, string][]} */ ([
  ["Space", "play or pause"], ["← →", "one tick back or ahead"], ["Shift ← →", "one second back or ahead"], ["Home End", "begin or end"],
  ["P N", "previous or next change of a status"], ["↑ ↓", "node above or below, in the tree"], ["Enter", "fold or unfold a node"], ["/", "search a node"],
  ["Esc", "leave the search"], ["T", "light or dark"], ["L", "follow the live run"], ["?", "this help"],
]);

/** Fills the help. @param {HTMLElement} list */
export function fillHelp(list) {
  list.replaceChildren(...KEYS.flatMap(([key, what]) => [h("dt", {}, ...key.split(" ").map((name) => h("kbd", {}, name))), h("dd", {}, what)]));
}

/**
 * Gives the keys their meaning.
 * @param {any} view `toggle()`, `step(1 | -1)`, `seek(t)`, `t`, `duration`, `change(1 | -1)`, `focusSearch()`, `help()`, `theme()`, `goLive()`
 */
export function listen(view) {
  addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    const target = /** @type {HTMLElement} */ (event.target);
    const isText = target.matches("input:not([type=range]), select, textarea");
    if (isText && event.key !== "Escape") return;
    // A focused button takes Space and Enter itself.
    if (event.key === " " && target.matches("button, summary")) return;
    const direction = event.key === "ArrowRight" ? 1 : -1;
    switch (event.key) {
      case " ": view.toggle(); break;
      case "ArrowLeft":
      case "ArrowRight":
        if (target.matches("canvas:not(#timeline), [role=tab]")) return;
        if (event.shiftKey) view.seek(view.t + direction);
        else view.step(direction);
        break;
      case "Home": view.seek(0); break;
      case "End": view.seek(view.duration); break;
      case "n": case "N": view.change(1); break;
      case "p": case "P": view.change(-1); break;
      case "/": view.focusSearch(); break;
      case "?": view.help(); break;
      case "t": case "T": view.theme(); break;
      case "l": case "L": view.goLive(); break;
      case "Escape":
        if (!isText) return;
        view.leaveSearch();
        break;
      default: return;
    }
    event.preventDefault();
  });
}
