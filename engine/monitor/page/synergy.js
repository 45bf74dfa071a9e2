// @ts-check
import { freeId, loadStyle } from "./dom.js";

const NS = "http://www.w3.org/2000/svg";
const MARGIN = { left: 40, right: 14, top: 12, bottom: 34 };
/** A line of more points than this is thinned: no screen shows them. */
const MAX_POINTS = 1500;

/** @param {string} tag @param {Record<string, string | number>} attributes @param {string} [text] */
function svg(tag, attributes, text) {
  const made = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  if (text !== undefined) made.textContent = text;
  return made;
}

/** The synergy plane: c1 closes, c2 shifts closure from the little finger to the thumb; the way of c up to a moment. */
export class SynergyPlane {
  /** @param {HTMLElement} parent @param {any} run */
  constructor(parent, run) {
    loadStyle();
    this.run = run;
    this.t = 0;
    this.root = document.createElement("div");
    this.root.className = "v-synergy";
    this.svg = svg("svg", { id: freeId("synergy-plane"), role: "img" });
    this.svg.append(svg("title", {}, "Synergy plane: closure c1 across, shift c2 upwards"));
    this.back = svg("g", {});
    this.way = svg("polyline", { class: "way" });
    this.set = svg("path", { class: "set" });
    this.now = svg("circle", { class: "now", r: 5.5 });
    this.front = svg("g", {});
    this.svg.append(this.back, this.way, this.front, this.set, this.now);
    this.root.append(this.svg);
    parent.append(this.root);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.root);
    this.resize();
  }

  destroy() {
    this.observer.disconnect();
    this.root.remove();
  }

  resize() {
    this.width = Math.max(this.root.clientWidth, 120);
    this.height = Math.max(this.root.clientHeight, 90);
    this.svg.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
    this.#frame();
    this.show(this.t);
  }

  /** @param {number} c1 */
  #x(c1) {
    return MARGIN.left + (c1 + 0.04) / 1.08 * ((this.width ?? 0) - MARGIN.left - MARGIN.right);
  }

  /** @param {number} c2 */
  #y(c2) {
    return MARGIN.top + ((1.08 - c2) / 2.16) * ((this.height ?? 0) - MARGIN.top - MARGIN.bottom);
  }

  /** Axes and the grasp types, drawn anew when the size, the header or the asked type changes. */
  #frame() {
    const types = this.run.header?.synergy?.grasp_types ?? [];
    this.header = this.run.header;
    const [w, h] = [this.width ?? 0, this.height ?? 0];
    const back = [];
    for (const c1 of [0, 0.25, 0.5, 0.75, 1]) {
      back.push(svg("line", { class: "gridline", x1: this.#x(c1), x2: this.#x(c1), y1: this.#y(1), y2: this.#y(-1) }));
      back.push(svg("text", { class: "tick", x: this.#x(c1), y: this.#y(-1) + 14, "text-anchor": "middle" }, String(c1)));
    }
    for (const c2 of [-1, -0.5, 0, 0.5, 1]) {
      back.push(svg("line", { class: c2 === 0 ? "zero" : "gridline", x1: this.#x(0), x2: this.#x(1), y1: this.#y(c2), y2: this.#y(c2) }));
      back.push(svg("text", { class: "tick", x: this.#x(0) - 6, y: this.#y(c2) + 3.5, "text-anchor": "end" }, String(c2).replace("-", "−")));
    }
    back.push(svg("text", { class: "axis", x: this.#x(0.5), y: h - 4, "text-anchor": "middle" }, "c₁ closes →"));
    const turned = { class: "axis", "text-anchor": "middle", transform: `translate(11 ${this.#y(0)}) rotate(-90)` };
    back.push(svg("text", turned, "c₂ towards the thumb →"));
    this.back.replaceChildren(...back);
    this.#labels(types, w);
  }

  /** Places each name where it covers neither another name nor a point. @param {any[]} types @param {number} w */
  #labels(types, w) {
    const points = types.map((type) => ({ x: this.#x(type.c_tar.c1), y: this.#y(type.c_tar.c2) }));
    /** @type {{x: number, y: number, w: number, h: number}[]} */
    const taken = points.map((p) => ({ x: p.x - 5, y: p.y - 5, w: 10, h: 10 }));
    const size = (w < 330 ? 9.5 : 11);
    const nodes = [];
    // Crowded ones first: they have the least choice.
    const crowd = (/** @type {{x: number, y: number}} */ p) => points.filter((o) => Math.abs(o.x - p.x) < 90 && Math.abs(o.y - p.y) < 26).length;
    const order = types.map((_, at) => at).sort((a, b) => crowd(points[b]) - crowd(points[a]));
    for (const at of order) {
      const p = points[at];
      const name = types[at].name.replaceAll("_", " ");
      const asked = types[at].name === this.asked ? " asked" : "";
      const box = { w: name.length * size * 0.56 + 8, h: size + 3 };
      const place = this.#free(p, box, taken);
      taken.push(place);
      const middle = { x: place.x + box.w / 2, y: place.y + box.h / 2 };
      if (Math.abs(middle.y - p.y) > 14 || Math.abs(middle.x - p.x) > box.w / 2 + 12) {
        const end = { x: Math.max(place.x, Math.min(p.x, place.x + box.w)), y: middle.y < p.y ? place.y + box.h : place.y };
        nodes.push(svg("line", { class: "leader", x1: p.x, y1: p.y, x2: end.x, y2: Math.abs(middle.y - p.y) > box.h / 2 ? end.y : middle.y }));
      }
      nodes.push(svg("circle", { class: `type${asked}`, cx: p.x, cy: p.y, r: asked ? 4.5 : 3 }));
      const label = svg("text", { class: `label${asked}`, x: place.x + 4, y: place.y + size - 0.5 }, name);
      /** @type {SVGElement} */ (label).style.fontSize = `${size}px`;
      nodes.push(label);
    }
    this.front.replaceChildren(...nodes);
  }

  /** @param {{x: number, y: number}} p @param {{w: number, h: number}} box @param {{x: number, y: number, w: number, h: number}[]} taken */
  #free(p, box, taken) {
    let best = { x: p.x + 7, y: p.y - box.h / 2, ...box };
    let least = Infinity;
    for (let ring = 0; ring < 6; ring += 1) {
      const dy = 4 + ring * 12;
      const dx = 7 + ring * 10;
      const tries = [
        [p.x + dx, p.y - box.h / 2], [p.x - dx - box.w, p.y - box.h / 2], [p.x - box.w / 2, p.y - dy - box.h], [p.x - box.w / 2, p.y + dy],
        [p.x + dx, p.y - dy - box.h], [p.x - dx - box.w, p.y - dy - box.h], [p.x + dx, p.y + dy], [p.x - dx - box.w, p.y + dy],
      ];
      for (const [x, y] of tries) {
        const place = { x, y, ...box };
        let cost = ring * 6 + 400 * this.#outside(place);
        for (const other of taken) {
          const over = [
            Math.min(place.x + box.w, other.x + other.w) - Math.max(place.x, other.x),
            Math.min(place.y + box.h, other.y + other.h) - Math.max(place.y, other.y),
          ];
          if (over[0] > 0 && over[1] > 0) cost += 40 + over[0] * over[1];
        }
        if (cost < least) [least, best] = [cost, place];
      }
      if (least < ring * 6 + 1) break;
    }
    return best;
  }

  /** Share of a place that lies outside of the drawing. @param {{x: number, y: number, w: number, h: number}} place */
  #outside(place) {
    const [w, h] = [this.width ?? 0, this.height ?? 0];
    const over = Math.max(0, this.#x(0) - 4 - place.x) + Math.max(0, place.x + place.w - w + 3);
    return over / place.w + Math.max(0, 2 - place.y) / place.h + Math.max(0, place.y + place.h - h + MARGIN.bottom) / place.h;
  }

  /** The samples up to now: from `/synergy`, or from the motors of `/robot` in older recordings. */
  #samples() {
    const flat = this.run.all("/synergy");
    if (flat?.length) return { list: flat, of: (/** @type {any} */ m) => [m.c1, m.c2] };
    return {
      list: this.run.all("/robot") ?? [],
      of: (/** @type {any} */ m) => {
        const [a, b] = m.hand?.motor_positions ?? [0, 0];
        return [(a + b) / 2, (a - b) / 2];
      },
    };
  }

  /** Draws the moment `t`. @param {number} t */
  show(t) {
    this.t = t;
    const answer = this.run.latest("/functionality", t)?.answer?.act?.grasp_type;
    if (this.run.header !== this.header || answer !== this.asked) {
      this.asked = answer;
      this.#frame();
    }
    const { list, of } = this.#samples();
    let end = 0;
    for (let low = 0, high = list.length; low < high;) {
      const middle = (low + high) >> 1;
      if (list[middle].t <= t) low = end = middle + 1;
      else high = middle;
    }
    const step = Math.max(1, Math.floor(end / MAX_POINTS));
    let points = "";
    for (let at = 0; at < end; at += step) {
      const [c1, c2] = of(list[at].m);
      points += `${this.#x(c1).toFixed(1)},${this.#y(c2).toFixed(1)} `;
    }
    const last = end > 0 ? list[end - 1].m : null;
    const now = last ? of(last) : null;
    if (now) points += `${this.#x(now[0]).toFixed(1)},${this.#y(now[1]).toFixed(1)}`;
    this.way.setAttribute("points", points.trim());
    const robot = this.run.latest("/robot", t)?.hand_command;
    const command = last && "c1_command" in last ? [last.c1_command, last.c2_command] : robot ? [robot.synergy, robot.manipulation] : null;
    for (const [node, at] of /** @type {[Element, number[] | null][]} */ ([[this.now, now], [this.set, command]])) {
      node.setAttribute("visibility", at ? "visible" : "hidden");
      if (at) node.setAttribute("transform", `translate(${this.#x(at[0])} ${this.#y(at[1])})`);
    }
    this.set.setAttribute("d", "M-9 0H9M0 -9V9M-6 0A6 6 0 1 0 6 0A6 6 0 1 0 -6 0");
    if (now) this.svg.setAttribute("data-c", `${now[0].toFixed(3)} ${now[1].toFixed(3)}`);
  }
}
