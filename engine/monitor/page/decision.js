// @ts-check
import { h, secs, short, words } from "./html.js";

/** The language decision, and the palm poses with what speaks for and against each. */
export class Decision {
  /**
   * @param {HTMLElement} parent
   * @param {import("./run.js").Run} run
   * @param {{onCandidate: (idx: number | null) => void}} options
   */
  constructor(parent, run, options) {
    this.run = run;
    this.options = options;
    /** @type {number | null} */
    this.selected = null;
    /** @type {any} */
    this.answerShown = undefined;
    /** @type {any} */
    this.candidatesShown = undefined;
    this.answer = h("div", { class: "decision" });
    this.candidates = h("div", { class: "candidates" });
    parent.append(h("h3", {}, "Decision"), this.answer, h("h3", {}, "Palm poses"), this.candidates);
  }

  /** @param {number} t */
  show(t) {
    const said = this.run.latest("/functionality", t);
    if (said !== this.answerShown) {
      this.answerShown = said;
      this.#answer(said);
    }
    const message = this.run.latest("/candidates", t);
    if (message !== this.candidatesShown) {
      this.candidatesShown = message;
      this.selected = null;
      this.#candidates(message);
    }
  }

  /** Marks the row of a candidate, as when it is pointed at in the scene. @param {number | null} idx */
  mark(idx) {
    for (const row of this.candidates.querySelectorAll("tr[data-candidate]")) {
      row.classList.toggle("pointed", idx !== null && /** @type {HTMLElement} */ (row).dataset.candidate === String(idx));
    }
  }

  #answer(/** @type {any} */ said) {
    const answer = said?.answer;
    const kind = answer?.act ? "act" : answer?.ask ? "ask" : answer?.refuse ? "refuse" : "none";
    this.answer.dataset.kind = kind;
    const sentence = this.run.header?.instruction ?? this.run.metadata.instruction ?? "";
    const parts = sentence ? [h("blockquote", {}, `“${sentence}”`)] : [];
    if (kind === "none") parts.push(h("p", { class: "empty" }, "No decision yet."));
    if (kind === "ask") {
      parts.push(h("p", { class: "asks" }, h("b", {}, "? Asks back: "), answer.ask.question));
      parts.push(h("ul", {}, ...answer.ask.choices.map((/** @type {string} */ choice) => h("li", {}, choice))));
    }
    if (kind === "refuse") parts.push(h("p", { class: "refuses" }, h("b", {}, "⊘ Refuses: "), answer.refuse.reason));
    if (kind === "act") {
      const act = answer.act;
      const name = (/** @type {any} */ thing) => (thing ? (thing.name ?? thing.category ?? short(thing, 60)) : null);
      const facts = /** @type {[string, string | null][]} */ ([
        ["object", name(act.object)], ["task", typeof act.task === "string" ? words(act.task) : short(act.task, 60)], ["target", name(act.target)],
        ["part to hold", words(act.affordance)], ["grasp type", words(act.grasp_type)],
      ]);
      const list = facts.filter(([, value]) => value).flatMap(([term, value]) => [h("dt", {}, term), h("dd", {}, value)]);
      list.push(h("dt", {}, "confidence"), h("dd", { class: "confidence" }, bar(act.confidence), ` ${Math.round(100 * act.confidence)} %`));
      parts.push(h("dl", {}, ...list));
      if (act.rationale?.length) parts.push(h("ol", { class: "rationale" }, ...act.rationale.map((/** @type {string} */ step) => h("li", {}, step))));
    }
    this.answer.replaceChildren(...parts);
  }

  #candidates(/** @type {any} */ message) {
    if (!message) {
      this.candidates.replaceChildren(h("p", { class: "empty" }, "None yet."));
      return;
    }
    const { candidates, chosen } = message;
    const rejected = candidates.filter((/** @type {any} */ candidate) => candidate.rejected && candidate.rejected.why !== "ranked_lower");
    const state = chosen === null || chosen === undefined ? (rejected.length ? ", none can be used" : ", not checked yet") : `, ${rejected.length} rejected, no. ${rank(candidates, chosen)} chosen`;
    const rows = candidates.map((/** @type {any} */ candidate, /** @type {number} */ i) => {
      const isChosen = candidate.idx === chosen;
      const why = candidate.rejected;
      // A better one was taken first: this one could have been used.
      const isUsable = !why || why.why === "ranked_lower";
      const verdict = isChosen ? h("span", { class: "good" }, "✓ chosen") : isUsable ? h("span", { class: "soft" }, why ? `○ ${words(why.why)}` : "·") : h("span", { class: "bad" }, `✗ ${words(why.why)}`);
      const row = h(
        "tr",
        { "data-candidate": candidate.idx, "data-rejected": why?.why, "data-chosen": isChosen, tabindex: "0", title: [why?.text, ...(candidate.terms ?? []).map((/** @type {any} */ term) => `${words(term.name)} ${short(term.value)}`)].filter(Boolean).join("\n") },
        h("td", { class: "rank" }, String(i + 1)), h("td", {}, bar(candidate.stability), ` ${candidate.stability.toFixed(2)}`),
        h("td", { class: "terms" }, terms(candidate.terms ?? [])),
        h("td", {}, verdict, isUsable ? null : h("span", { class: "why" }, why.text)),
      );
      const choose = () => {
        this.selected = this.selected === candidate.idx ? null : candidate.idx;
        for (const other of row.parentElement?.children ?? []) other.setAttribute("aria-selected", String(other === row && this.selected !== null));
        this.options.onCandidate(this.selected);
      };
      row.addEventListener("click", choose);
      row.addEventListener("keydown", (event) => {
        if (event.key !== "Enter") return;
        event.preventDefault();
        choose();
      });
      return row;
    });
    const head = h("thead", {}, h("tr", {}, ...["#", "Score", "Terms", ""].map((title) => h("th", { scope: "col" }, title))));
    this.candidates.replaceChildren(
      h("p", { class: "soft" }, `${candidates.length} proposed${state}; ${secs(message.stamp_secs)}`),
      h("div", { class: "scroll" }, h("table", {}, head, h("tbody", {}, ...rows))),
    );
  }
}

/** @param {any[]} candidates @param {number} idx */
function rank(candidates, idx) {
  return candidates.findIndex((candidate) => candidate.idx === idx) + 1;
}

/** Small upright bars, one a term. @param {{name: string, value: number}[]} list */
function terms(list) {
  const bars = list.map(({ name, value }) => {
    const fill = h("i", { title: `${words(name)} ${short(value)}` }, h("b"));
    /** @type {HTMLElement} */ (fill.firstElementChild).style.height = `${Math.max(0, Math.min(1, Math.abs(value) || 0)) * 100}%`;
    return fill;
  });
  return h("span", { class: "upright", role: "img", "aria-label": list.map(({ name, value }) => `${words(name)} ${short(value)}`).join(", ") }, ...bars);
}

/** A small bar for a share, 0 to 1. @param {number} share @param {string} [title] */
function bar(share, title) {
  const fill = h("i");
  fill.style.width = `${Math.max(0, Math.min(1, share || 0)) * 100}%`;
  return h("span", { class: "bar", title, role: title ? "img" : null, "aria-label": title, "aria-hidden": title ? null : "true" }, fill);
}
