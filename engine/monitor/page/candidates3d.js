// @ts-check
/** Candidate palm poses in the scene: which are drawn, in which colour, and which one lies under the pointer. */
import { matrixOf, multiply, scaling } from "./mathx.js";
import { CHOSEN, css, REJECTED, scoreColour, scoreGradient, TOUCH } from "./palette.js";
import { palmGlyph } from "./scene_parts.js";
import { element } from "./dom.js";

/** How near to a palm the pointer takes it, CSS pixels. */
const REACH_PX = 14;
/** Names of terms that are no shares of one. */
const UNIT = /_(m|mm|rad|deg|secs|n|nm|newtons|weights)$/;

/** Whether a candidate cannot be executed; one that merely ranked lower could. @param {any} candidate */
export function isUnusable(candidate) {
  return Boolean(candidate.rejected) && candidate.rejected.why !== "ranked_lower";
}

/** The candidates of one `/candidates` message, ready to be drawn. */
export class Candidates {
  /** @param {import("./gl.js").Renderer} renderer */
  constructor(renderer) {
    this.renderer = renderer;
    this.glyphs = { left: palmGlyph(renderer, "left"), right: palmGlyph(renderer, "right") };
    /** @type {any} */ this.message = null;
    /** @type {any[]} */ this.list = [];
    this.low = 0;
    this.high = 1;
  }

  /** @param {any} message or null */
  set(message) {
    if (message === this.message) return;
    this.message = message;
    this.list = message?.candidates ?? [];
    const scores = this.list.map((candidate) => candidate.stability);
    this.low = Math.min(...scores, 1);
    this.high = Math.max(...scores, 0);
    if (this.high - this.low < 1e-6) [this.low, this.high] = [0, 1];
  }

  get chosen() {
    return this.message?.chosen ?? null;
  }

  /** @param {number} idx */
  byIdx(idx) {
    return this.list.find((candidate, at) => (candidate.idx ?? at) === idx) ?? null;
  }

  /** @param {number | null} marked @returns {import("./gl.js").Item[]} */
  items(marked) {
    return this.list.map((candidate, at) => {
      const idx = candidate.idx ?? at;
      const isChosen = idx === this.chosen;
      const isMarked = idx === marked;
      const unusable = isUnusable(candidate);
      const scale = (isChosen ? 1.5 : this.chosen === null ? 0.75 : 0.6) * (isMarked ? 1.2 : 1);
      const settled = this.chosen !== null;
      let alpha = unusable ? 0.3 : settled ? 0.45 : 0.9;
      if (isChosen || isMarked) alpha = 1;
      return {
        mesh: this.glyphs[candidate.hand_side === "right" ? "right" : "left"],
        model: multiply(matrixOf(candidate.base_from_palm), scaling([scale, scale, scale])),
        colour: isChosen ? CHOSEN : unusable ? REJECTED : scoreColour(candidate.stability, this.low, this.high),
        alpha,
        glow: isMarked ? 0.9 : isChosen ? 0.35 : 0.1,
        castsShadow: false,
        shinesThrough: isChosen || isMarked,
      };
    });
  }

  /**
   * The candidate under a point of the canvas, the nearest one; of two as near the one in front.
   * @param {number} x @param {number} y
   * @param {(point: number[]) => {x: number, y: number, depth?: number} | null} project
   */
  pick(x, y, project) {
    /** @type {{candidate: any, away: number, depth: number} | null} */
    let best = null;
    for (const candidate of this.list) {
      const at = project(candidate.base_from_palm.translation);
      if (!at) continue;
      const away = Math.hypot(at.x - x, at.y - y);
      const depth = at.depth ?? 0;
      if (away > REACH_PX) continue;
      if (!best || away < best.away - 0.5 || (away < best.away + 0.5 && depth < best.depth)) best = { candidate, away, depth };
    }
    return best?.candidate ?? null;
  }

  /** What the tooltip says. @param {any} candidate @returns {Node[]} */
  describe(candidate) {
    const idx = candidate.idx ?? this.list.indexOf(candidate);
    const isChosen = idx === this.chosen;
    const nodes = [element("div", { class: "tip-title" }, `Palm pose ${idx + 1} of ${this.list.length}`)];
    if (isChosen) nodes.push(element("div", { class: "tip-state chosen" }, "✓ chosen"));
    else if (isUnusable(candidate)) nodes.push(element("div", { class: "tip-state rejected" }, `✕ rejected: ${candidate.rejected.text}`));
    else if (candidate.rejected) nodes.push(element("div", { class: "tip-state" }, `○ ${candidate.rejected.text}`));
    const rows = [{ name: "stability", value: candidate.stability }, ...(candidate.terms ?? [])];
    const table = element("div", { class: "tip-terms" });
    for (const [at, { name, value }] of rows.entries()) {
      const bar = element("span", { class: "tip-bar" });
      if (!UNIT.test(name)) {
        const fill = element("span");
        fill.style.width = `${Math.round(100 * Math.max(0, Math.min(1, value)))}%`;
        if (at === 0) fill.style.background = css(scoreColour(value, this.low, this.high));
        bar.append(fill);
      } else {
        bar.classList.add("none");
      }
      table.append(element("span", {}, name.replaceAll("_", " ")), bar, element("span", { class: "tip-value" }, number(value)));
    }
    nodes.push(table);
    return nodes;
  }

  /** The legend: the scale of scores with its ends and what the other colours mean. @param {boolean} isTouching @returns {HTMLElement} */
  legend(isTouching) {
    const bar = element("span", { class: "legend-bar" });
    bar.style.background = scoreGradient();
    const swatch = (/** @type {number[]} */ colour) => {
      const dot = element("span", { class: "legend-dot" });
      dot.style.background = css(colour);
      return dot;
    };
    const nRejected = this.list.filter(isUnusable).length;
    const row = element("div", { class: "scene-legend" });
    if (this.list.length > 0) {
      row.append(element("span", {}, "stability"), element("span", { class: "num" }, number(this.low)), bar,
        element("span", { class: "num" }, number(this.high)));
    }
    if (isTouching) row.append(swatch(TOUCH), element("span", {}, "touches something"));
    if (this.chosen !== null) row.append(swatch(CHOSEN), element("span", {}, "chosen"));
    if (nRejected > 0) row.append(swatch(REJECTED), element("span", {}, `rejected (${nRejected})`));
    return row;
  }
}

/** @param {number} value */
function number(value) {
  return Number.isFinite(value) ? value.toFixed(Math.abs(value) >= 10 ? 1 : 2) : "–";
}
