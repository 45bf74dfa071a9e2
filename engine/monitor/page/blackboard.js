// @ts-check
import { countUntil, h, secs, setText, short } from "./html.js";

/** An entry written this recently stands out, seconds. */
const FRESH_SECS = 0.5;

/** The blackboard at a moment: each entry's value, who wrote it when, and what it was before. */
export class Blackboard {
  /**
   * @param {HTMLElement} parent
   * @param {import("./run.js").Run} run
   * @param {{onSeek: (t: number) => void, onSelect: (path: string) => void}} options
   */
  constructor(parent, run, options) {
    this.run = run;
    this.options = options;
    /** @type {Map<string, HTMLElement>} */
    this.rows = new Map();
    /** @type {string | null} */
    this.open = null;
    this.shown = "";
    this.body = h("tbody");
    this.empty = h("p", { class: "empty" }, "Nothing has been written yet.");
    this.table = h(
      "table", { class: "blackboard" },
      h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Entry"), h("th", { scope: "col" }, "Value"), h("th", { scope: "col" }, "Written"))),
      this.body,
    );
    parent.append(this.empty, this.table);
  }

  /** @param {number} t */
  show(t) {
    let n = 0;
    for (const key of [...this.run.byKey.keys()].sort()) {
      const writes = /** @type {import("./run.js").Timed[]} */ (this.run.byKey.get(key));
      const count = countUntil(writes, t + 1e-6, (item) => item.t);
      let row = this.rows.get(key);
      if (count === 0) {
        if (row) row.hidden = true;
        continue;
      }
      n += 1;
      if (!row) row = this.#row(key);
      row.hidden = false;
      const { t: at, m } = writes[count - 1];
      const isFresh = t - at <= FRESH_SECS;
      row.dataset.changed = String(isFresh);
      const [, value, by] = row.children;
      const text = m.value === null || m.value === undefined ? "(no text form)" : JSON.stringify(m.value);
      if (row.dataset.value !== text) {
        row.dataset.value = text;
        setText(value, m.value === null || m.value === undefined ? "written" : short(m.value));
        /** @type {HTMLElement} */ (value).title = text;
      }
      setText(by, `${isFresh ? "● " : ""}${m.node ? m.node.split("/").at(-1) : "the application"} · ${secs(at)}${count > 1 ? ` · ${count}×` : ""}`);
      /** @type {HTMLElement} */ (by).title = m.node || "";
      if (this.open === key) this.#history(row, writes, count);
    }
    this.empty.hidden = n > 0;
    this.table.hidden = n === 0;
  }

  #row(/** @type {string} */ key) {
    const name = h("button", { type: "button", class: "link", "aria-expanded": "false", title: "Earlier values" }, key);
    const row = h("tr", { "data-key": key }, h("th", { scope: "row" }, name), h("td", { class: "value" }), h("td", { class: "by" }));
    name.addEventListener("click", () => {
      const isOpen = this.open === key;
      this.body.querySelector(".history")?.remove();
      for (const button of this.body.querySelectorAll("button")) button.setAttribute("aria-expanded", "false");
      this.open = isOpen ? null : key;
      this.shown = "";
      name.setAttribute("aria-expanded", String(!isOpen));
      const writes = this.run.byKey.get(key) ?? [];
      if (!isOpen) this.#history(row, writes, writes.length);
    });
    this.rows.set(key, row);
    const next = [...this.body.children].find((other) => (/** @type {HTMLElement} */ (other).dataset.key ?? "") > key);
    this.body.insertBefore(row, next ?? null);
    return row;
  }

  #history(/** @type {HTMLElement} */ row, /** @type {import("./run.js").Timed[]} */ writes, /** @type {number} */ count) {
    const shown = `${this.open} ${count} ${writes.length}`;
    if (this.shown === shown) return;
    this.shown = shown;
    this.body.querySelector(".history")?.remove();
    const items = writes.slice(-50).reverse().map(({ t, m }) => {
      const jump = h("button", { type: "button", class: "link" }, secs(t));
      jump.addEventListener("click", () => this.options.onSeek(t));
      return h("li", {}, jump, ` ${short(m.value ?? "written", 200)} `, h("span", { class: "soft" }, m.node));
    });
    row.after(h("tr", { class: "history" }, h("td", { colspan: 3 }, h("ol", {}, ...items))));
  }
}
