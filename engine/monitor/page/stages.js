// @ts-check
import { h, secs, setText, words } from "./html.js";

/** The stages with what they decided and how long they took, and the verdict. */
export class Stages {
  /**
   * @param {HTMLElement} parent
   * @param {import("./run.js").Run} run
   * @param {{onSeek: (t: number) => void}} options
   */
  constructor(parent, run, options) {
    this.run = run;
    this.options = options;
    this.shown = "";
    /** @type {{row: HTMLElement, t: number}[]} */
    this.rows = [];
    this.body = h("tbody");
    this.verdict = h("div", { class: "verdict" });
    this.empty = h("p", { class: "empty" }, "No stage has ended yet.");
    this.table = h(
      "table", { class: "stages" },
      h("thead", {}, h("tr", {}, ...["Stage", "Took", "Result"].map((title) => h("th", { scope: "col" }, title)))), this.body,
    );
    parent.append(this.verdict, h("h3", {}, "Stages"), this.empty, this.table);
  }

  /** @param {number} t */
  show(t) {
    const stages = this.run.all("/stages");
    const verdict = this.run.latest("/verdict", Infinity);
    const shown = `${stages.length} ${verdict !== null}`;
    if (shown !== this.shown) {
      this.shown = shown;
      this.#build(stages);
      this.#judge(verdict);
    }
    for (const { row, t: at } of this.rows) row.classList.toggle("ahead", at > t + 1e-6);
    this.verdict.classList.toggle("ahead", verdict !== null && t < this.run.duration - 1.5);
  }

  #build(/** @type {import("./run.js").Timed[]} */ stages) {
    this.empty.hidden = stages.length > 0;
    this.table.hidden = stages.length === 0;
    const spans = this.run.spans();
    const took = stages.map(({ t, m }) => {
      const span = spans.findLast((s) => s.path.split("/").at(-1)?.replace(/#\d+$/, "") === m.stage && s.from <= t + 0.02 && s.to >= t - 0.02);
      return span ? span.to - span.from : 0;
    });
    const longest = Math.max(...took, 1e-3);
    this.rows = stages.map(({ t, m }, i) => {
      const jump = h("button", { type: "button", class: "link", title: `to ${t.toFixed(2)} s` }, words(m.stage));
      jump.addEventListener("click", () => this.options.onSeek(t));
      const fill = h("i");
      fill.style.width = `${(100 * took[i]) / longest}%`;
      const mark = m.failure ? h("span", { class: "bad" }, `✗ ${words(m.failure)} `) : h("span", { class: "good" }, "✓ ");
      const row = h(
        "tr", { "data-stage": m.stage, "data-failure": m.failure },
        h("th", { scope: "row" }, jump, h("span", { class: "soft" }, ` ${secs(t)}`)),
        h("td", { class: "took" }, h("span", { class: "bar", "aria-hidden": "true" }, fill), ` ${secs(took[i])}`), h("td", {}, mark, m.summary),
      );
      return { row, t };
    });
    this.body.replaceChildren(...this.rows.map(({ row }) => row));
  }

  #judge(/** @type {any} */ verdict) {
    if (!verdict) {
      this.verdict.replaceChildren(h("p", { class: "empty" }, this.run.live ? "Judged when the run is over." : "This recording has no verdict."));
      return;
    }
    const isGood = verdict.outcome === "success";
    this.verdict.dataset.outcome = verdict.outcome;
    const predicates = (verdict.predicates ?? []).map((/** @type {any} */ predicate) =>
      h(
        "li", { class: predicate.passed ? "good" : "bad", "data-passed": String(predicate.passed) }, predicate.passed ? "✓ " : "✗ ", words(predicate.predicate),
        h("span", { class: "soft" }, ` ${predicate.evaluator} · ${predicate.measured}`),
      ));
    const title = h("p", { class: isGood ? "outcome good" : "outcome bad" });
    setText(title, `${isGood ? "✓" : "✗"} ${words(verdict.outcome)}`);
    this.verdict.replaceChildren(title, h("ul", { class: "predicates" }, ...predicates));
  }
}
