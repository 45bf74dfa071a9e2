// @ts-check
import { Blackboard } from "./blackboard.js";
import { Decision } from "./decision.js";
import { h, secs, setText, short, STATUS, words } from "./html.js";
import { Stages } from "./stages.js";
import { TreeView } from "./tree.js";

/** Views that draw in their own element; the page goes on without one that cannot be loaded. */
const VIEWS = /** @type {[string, string, string][]} */ ([
  ["scene", "./scene3d.js", "Scene3d"], ["cameras", "./cameras.js", "CameraViews"], ["synergy", "./synergy.js", "SynergyPlane"],
]);

/** Everything about one run. */
export class Panel {
  /**
   * @param {HTMLElement} parent
   * @param {import("./run.js").Run} run
   * @param {{onSeek: (t: number) => void, onSelect: (path: string | null) => void}} options
   */
  constructor(parent, run, options) {
    this.run = run;
    this.options = options;
    this.t = 0;
    /** @type {any} */ this.scene = null;
    /** @type {any} */ this.cameras = null;
    /** @type {any} */ this.synergy = null;
    /** @type {string | null} */ this.selected = null;
    this.shownNode = "";
    const box = (/** @type {string} */ name, /** @type {string} */ title, /** @type {Node[]} */ ...content) =>
      h("section", { class: `box box-${name}`, "aria-label": title }, ...content);
    this.title = h("h2", { class: "run-title" }, run.name);
    const treeBox = box("tree", "Behaviour tree");
    this.details = h("div", { class: "node-details", "aria-live": "off" });
    const tabs = { decision: h("div"), blackboard: h("div"), stages: h("div") };
    this.root = h(
      "section", { class: "run", "data-run": run.id, "aria-label": `Run ${run.name}` }, this.title, treeBox,
      box("scene", "Scene", h("div", { class: "mount mount-scene" })), box("cameras", "Cameras", h("div", { class: "mount mount-cameras" })),
      box("synergy", "Synergy plane", h("div", { class: "mount mount-synergy" })), box("side", "What was decided", ...this.#tabs(tabs)),
    );
    parent.append(this.root);
    this.tree = new TreeView(treeBox, run, { onSelect: options.onSelect, onSeek: options.onSeek });
    treeBox.append(this.details);
    this.decision = new Decision(tabs.decision, run, { onCandidate: (idx) => this.scene?.select(idx) });
    this.blackboard = new Blackboard(tabs.blackboard, run, { onSeek: options.onSeek, onSelect: options.onSelect });
    this.stages = new Stages(tabs.stages, run, { onSeek: options.onSeek });
  }

  /** Loads the views that draw. */
  async mount() {
    await Promise.all(VIEWS.map(async ([name, file, type]) => {
      const element = /** @type {HTMLElement} */ (this.root.querySelector(`.mount-${name}`));
      try {
        const module = await import(file);
        const view = new module[type](element, this.run, {});
        /** @type {any} */ (this)[name] = view;
        view.show(this.t);
      } catch (error) {
        element.replaceChildren(h("p", { class: "empty" }, `This view cannot be shown: ${error instanceof Error ? error.message : error}`));
      }
    }));
    this.scene?.onHover?.((/** @type {any} */ candidate) => this.decision.mark(candidate?.idx ?? null));
  }

  #tabs(/** @type {Record<string, HTMLElement>} */ bodies) {
    const names = Object.keys(bodies);
    const id = (/** @type {string} */ name) => `tab-${this.run.id}-${name}`;
    const buttons = names.map((name) => h("button", { type: "button", role: "tab", id: id(name), "aria-controls": `${id(name)}-body`, "data-tab": name }, words(name)));
    const open = (/** @type {string} */ wanted) => {
      names.forEach((name, i) => {
        buttons[i].setAttribute("aria-selected", String(name === wanted));
        buttons[i].tabIndex = name === wanted ? 0 : -1;
        bodies[name].hidden = name !== wanted;
      });
    };
    names.forEach((name, i) => {
      for (const [key, value] of Object.entries({ role: "tabpanel", id: `${id(name)}-body`, class: `tab-body tab-${name}`, "aria-labelledby": id(name), tabindex: "0" })) bodies[name].setAttribute(key, value);
      buttons[i].addEventListener("click", () => open(name));
      buttons[i].addEventListener("keydown", (event) => {
        const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
        if (step === 0) return;
        event.preventDefault();
        const next = (i + step + names.length) % names.length;
        open(names[next]);
        buttons[next].focus();
      });
    });
    open(names[0]);
    this.openTab = open;
    return [h("div", { class: "tabs", role: "tablist", "aria-label": "Details" }, ...buttons), ...Object.values(bodies)];
  }

  /** Draws the moment t of this run. @param {number} t */
  show(t) {
    this.t = t;
    this.tree.show(t);
    this.blackboard.show(t);
    this.decision.show(t);
    this.stages.show(t);
    this.#details();
    for (const view of [this.scene, this.cameras, this.synergy]) view?.show(t);
  }

  /** @param {string | null} path */
  select(path) {
    this.selected = path;
    this.tree.select(path);
    this.shownNode = "";
    this.#details();
  }

  resize() {
    for (const view of [this.scene, this.cameras, this.synergy]) view?.resize?.();
  }

  #details() {
    const node = this.selected === null ? null : this.run.nodesAt(this.t).find((n) => n.path === this.selected);
    this.details.hidden = !node;
    if (!node) return;
    const changes = this.run.changesUntil(node.path, this.t);
    const { status, change } = this.run.statusAt(node.path, this.t);
    const shown = `${node.path} ${changes.length} ${this.run.all("/tree/definition").length}`;
    if (shown !== this.shownNode) {
      this.shownNode = shown;
      const ports = (node.ports ?? []).map((port) => h("li", {}, h("span", { class: "soft" }, `${port.direction} `), `${port.name}: `, h("code", {}, short(port.value, 120))));
      const list = changes.slice(-12).reverse().map((c) => {
        const jump = h("button", { type: "button", class: "link" }, secs(c.t));
        jump.addEventListener("click", () => this.options.onSeek(c.t));
        return h("li", { "data-status": c.to }, jump, ` ${STATUS[c.to]?.glyph ?? ""} ${c.to}${c.reason ? `: ${c.reason}` : ""}`, c.detail ? h("span", { class: "soft" }, ` ${c.detail}`) : null);
      });
      this.details.replaceChildren(
        h("h3", {}, words(node.name), h("span", { class: "soft" }, ` ${node.kind === node.name ? "" : words(node.kind)}`)),
        node.doc ? h("p", {}, node.doc) : "", h("p", { class: "now" }), ports.length ? h("ul", { class: "ports" }, ...ports) : "",
        list.length ? h("ol", { class: "changes" }, ...list) : "",
      );
    }
    const now = this.details.querySelector(".now");
    if (now) setText(now, change ? `${STATUS[status]?.glyph} ${status} for ${secs(this.t - change.t)}` : "· has not run yet");
  }
}
