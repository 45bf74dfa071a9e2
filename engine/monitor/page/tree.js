// @ts-check
import { h, secs, setText, short, STATUS, words } from "./html.js";

const ROW = 26;
/** Rows drawn beyond what is seen, so that scrolling shows no gap. */
const SPARE = 12;

/** @typedef {import("./run.js").TreeNode} TreeNode */

/** The tree with the status of each node at a moment. Only the rows in sight are in the document. */
export class TreeView {
  /**
   * @param {HTMLElement} parent
   * @param {import("./run.js").Run} run
   * @param {{onSelect: (path: string | null) => void, onSeek: (t: number) => void}} options
   */
  constructor(parent, run, options) {
    this.run = run;
    this.options = options;
    this.t = 0;
    this.query = "";
    /** @type {string | null} */
    this.selected = null;
    /** @type {Set<string>} */
    this.closed = new Set();
    /** @type {TreeNode[]} */
    this.nodes = [];
    /** @type {TreeNode[]} */
    this.visible = [];
    /** @type {Map<string, HTMLElement>} */
    this.rows = new Map();
    /** Breakpoints and forced results by path, from the gate. @type {Map<string, string>} */
    this.marks = new Map();
    this.follows = true;
    this.space = h("div", { class: "tree-space", role: "presentation" });
    this.root = h("div", { class: "tree", role: "tree", tabindex: "0", "aria-label": "Behaviour tree" }, this.space);
    this.empty = h("p", { class: "empty" }, "No node has run yet.");
    parent.append(this.root, this.empty);
    this.root.addEventListener("scroll", () => this.#draw(), { passive: true });
    this.root.addEventListener("wheel", () => (this.follows = false), { passive: true });
    this.root.addEventListener("click", (event) => this.#click(event));
    this.root.addEventListener("keydown", (event) => this.#key(event));
    this.observer = new ResizeObserver(() => this.#draw());
    this.observer.observe(this.root);
  }

  /** Draws the moment t. @param {number} t */
  show(t) {
    this.t = t;
    const nodes = this.run.nodesAt(t);
    if (nodes !== this.nodes) {
      this.nodes = nodes;
      this.#layout();
    }
    if (this.follows) this.#keepRunningInView();
    this.#draw();
  }

  /** Shows only nodes with this in their name or path, and what is above them. @param {string} query */
  search(query) {
    this.query = query.trim().toLowerCase();
    this.#layout();
    this.#draw();
    return this.visible.length;
  }

  /** @param {string | null} path */
  select(path) {
    this.selected = path;
    if (path !== null) this.reveal(path);
    this.#draw();
  }

  /** Scrolls a node into view and opens what hides it. @param {string} path @returns {boolean} whether there is such a node */
  reveal(path) {
    let node = this.nodes.find((n) => n.path === path);
    if (!node) return false;
    let isHidden = false;
    for (let parent = node.parent; parent !== null && parent !== undefined; parent = this.nodes[parent].parent) {
      isHidden = this.closed.delete(this.nodes[parent].path) || isHidden;
    }
    if (isHidden || !this.visible.includes(node)) {
      this.query = "";
      this.#layout();
    }
    this.#scrollTo(this.visible.indexOf(node));
    this.#draw();
    return true;
  }

  /** @param {string} path @param {number} t */
  statusAt(path, t) {
    return this.run.statusAt(path, t).status;
  }

  destroy() {
    this.observer.disconnect();
    this.root.remove();
    this.empty.remove();
  }

  #layout() {
    const { nodes, query } = this;
    /** @type {Set<number>} */
    const wanted = new Set();
    if (query !== "") {
      nodes.forEach((node, i) => {
        if (!node.path.split("/").at(-1)?.toLowerCase().includes(query) && !words(node.kind).includes(query)) return;
        for (let at = /** @type {number | null} */ (i); at !== null && at !== undefined; at = nodes[at].parent) wanted.add(at);
      });
    }
    const visible = [];
    for (let i = 0; i < nodes.length; ) {
      const node = nodes[i];
      if (query === "" || wanted.has(i)) visible.push(node);
      i = query === "" && this.closed.has(node.path) ? this.#after(i) : i + 1;
    }
    this.visible = visible;
    this.space.style.height = `${visible.length * ROW}px`;
    this.empty.hidden = nodes.length > 0;
    this.root.hidden = nodes.length === 0;
    for (const row of this.rows.values()) row.remove();
    this.rows.clear();
  }

  /** The first node that is not below node i; nodes stand in document order. */
  #after(/** @type {number} */ i) {
    const { depth } = this.nodes[i];
    let next = i + 1;
    while (next < this.nodes.length && this.nodes[next].depth > depth) next += 1;
    return next;
  }

  #draw() {
    const top = this.root.scrollTop;
    const first = Math.max(0, Math.floor(top / ROW) - SPARE);
    const last = Math.min(this.visible.length, Math.ceil((top + this.root.clientHeight) / ROW) + SPARE);
    const wanted = this.visible.slice(first, last);
    const paths = new Set(wanted.map((node) => node.path));
    for (const [path, row] of this.rows) {
      if (paths.has(path)) continue;
      row.remove();
      this.rows.delete(path);
    }
    // In document order, for those who read rather than look.
    let next = this.space.firstElementChild;
    wanted.forEach((node, i) => {
      let row = this.rows.get(node.path);
      if (!row) {
        row = this.#row(node);
        row.style.top = `${(first + i) * ROW}px`;
        this.rows.set(node.path, row);
      }
      if (row === next) next = next.nextElementSibling;
      else this.space.insertBefore(row, next);
      this.#update(row, node);
    });
  }

  #row(/** @type {TreeNode} */ node) {
    const hasChildren = node.children.length > 0;
    const row = h(
      "div",
      {
        class: `node${hasChildren ? " has-children" : ""}`, role: "treeitem", "data-path": node.path, "data-depth": node.depth,
        "aria-level": node.depth + 1, "aria-expanded": hasChildren ? !this.closed.has(node.path) || "false" : null, id: `node-${this.run.id}-${node.path}`,
      },
      h("span", { class: "fold", "aria-hidden": "true" }, hasChildren ? (this.closed.has(node.path) ? "▸" : "▾") : ""),
      h("span", { class: "glyph", "aria-hidden": "true" }),
      h("span", { class: "name" }, words(node.name)),
      node.kind !== node.name.replace(/#\d+$/, "") ? h("span", { class: "kind" }, words(node.kind)) : null,
      h("span", { class: "mark" }),
      h("span", { class: "reason" }),
      h("span", { class: "state-time" }),
      h("span", { class: "before" }),
    );
    row.style.paddingLeft = `${6 + Math.min(node.depth, 14) * 15}px`;
    row.title = [node.path, node.doc, ...(node.ports ?? []).map((port) => `${port.direction} ${port.name}: ${short(port.value, 80)}`)].filter(Boolean).join("\n");
    return row;
  }

  #update(/** @type {HTMLElement} */ row, /** @type {TreeNode} */ node) {
    const { status, change } = this.run.statusAt(node.path, this.t);
    if (row.dataset.status !== status) {
      row.dataset.status = status;
      setText(row.children[1], STATUS[status]?.glyph ?? "?");
    }
    const isActive = status === "running" || status === "failure";
    const since = change && (isActive || status === "success") ? secs(Math.max(0, this.t - change.t), 1) : "";
    setText(/** @type {Element} */ (row.querySelector(".state-time")), since);
    this.#before(/** @type {HTMLElement} */ (row.querySelector(".before")), node.path, status);
    const reason = status === "failure" && change?.reason ? `${change.reason}${change.detail ? `: ${change.detail}` : ""}` : "";
    const place = /** @type {HTMLElement} */ (row.querySelector(".reason"));
    setText(place, reason);
    place.title = reason;
    setText(/** @type {Element} */ (row.querySelector(".mark")), this.marks.get(node.path) ?? "");
    row.setAttribute("aria-label", `${words(node.name)}, ${STATUS[status]?.text ?? status}${since ? `, for ${since}` : ""}${reason ? `, ${reason}` : ""}`);
    row.setAttribute("aria-selected", String(node.path === this.selected));
    if (node.path === this.selected) this.root.setAttribute("aria-activedescendant", row.id);
  }

  /** How an idle node ended the last time: its parent has made it idle since. */
  #before(/** @type {HTMLElement} */ place, /** @type {string} */ path, /** @type {string} */ status) {
    const list = status === "idle" ? this.run.changesUntil(path, this.t) : [];
    const ended = list.findLast((change) => change.to === "success" || change.to === "failure");
    const begun = ended && list[list.indexOf(ended) - 1]?.to === "running" ? list[list.indexOf(ended) - 1].t : ended?.t;
    place.dataset.last = ended?.to ?? "";
    setText(place, ended ? `${STATUS[ended.to].glyph} ${secs(ended.t - (begun ?? ended.t), 1)}` : "");
    place.title = ended ? `last time: ${ended.to}${ended.reason ? ` (${ended.reason}${ended.detail ? `: ${ended.detail}` : ""})` : ""} at ${secs(ended.t)}` : "";
  }

  #keepRunningInView() {
    let deepest = -1;
    for (let i = 0; i < this.visible.length; i += 1) {
      if (this.run.statusAt(this.visible[i].path, this.t).status !== "running") continue;
      if (deepest < 0 || this.visible[i].depth > this.visible[deepest].depth) deepest = i;
    }
    if (deepest >= 0) this.#scrollTo(deepest);
  }

  #scrollTo(/** @type {number} */ i) {
    const [top, height] = [i * ROW, this.root.clientHeight];
    if (i < 0 || height === 0) return;
    if (top < this.root.scrollTop) this.root.scrollTop = Math.max(0, top - ROW);
    else if (top + ROW > this.root.scrollTop + height) this.root.scrollTop = top + 2 * ROW - height;
  }

  #click(/** @type {MouseEvent} */ event) {
    const row = /** @type {HTMLElement | null} */ (/** @type {Element} */ (event.target).closest(".node"));
    if (!row?.dataset.path) return;
    if (/** @type {Element} */ (event.target).classList.contains("fold")) this.#fold(row.dataset.path);
    else this.#choose(row.dataset.path);
  }

  #choose(/** @type {string} */ path) {
    this.selected = path;
    this.options.onSelect(path);
    this.#draw();
  }

  #fold(/** @type {string} */ path) {
    if (!this.closed.delete(path)) this.closed.add(path);
    this.#layout();
    this.#draw();
  }

  #key(/** @type {KeyboardEvent} */ event) {
    const at = this.visible.findIndex((node) => node.path === this.selected);
    const node = this.visible[at];
    const to = (/** @type {number} */ i) => {
      const next = this.visible[Math.max(0, Math.min(this.visible.length - 1, i))];
      if (next) {
        this.#choose(next.path);
        this.#scrollTo(this.visible.indexOf(next));
      }
    };
    const isOpen = node && node.children.length > 0 && !this.closed.has(node.path);
    if (event.key === "ArrowDown") to(at + 1);
    else if (event.key === "ArrowUp") to(at - 1);
    else if (event.key === "Enter" && node) this.#fold(node.path);
    else if (event.key === "ArrowLeft" && event.altKey && isOpen) this.#fold(node.path);
    else if (event.key === "ArrowRight" && event.altKey && node && !isOpen) this.#fold(node.path);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}
