// @ts-check
import { byId, secs, setText, STATUS, words } from "./html.js";

const LANE = 22;
const GAP = 3;
const AXIS = 18;
/** Bands narrower than this have no room for a name, pixels. */
const MIN_LABEL = 34;
/** Bands closer than this are one moment to the eye, pixels. */
const MIN_WIDTH = 2;
const MAX_LANES = 4;

/** @typedef {import("./run.js").Run} Run */

/** The bar at the bottom: what ran when, where the moment is, play and steps. */
export class Timeline {
  /**
   * @param {any} view the page's state: `t`, `duration`, `runs`, `timeIn(run)`, `seek(t)`
   */
  constructor(view) {
    this.view = view;
    this.canvas = /** @type {HTMLCanvasElement} */ (byId("timeline"));
    this.scrub = /** @type {HTMLInputElement} */ (byId("scrub"));
    this.tip = byId("timeline-tip");
    /** @type {{x: number, y: number, width: number, span: any, run: Run}[]} */
    this.boxes = [];
    this.drawn = "";
    this.static = document.createElement("canvas");
    this.scrub.addEventListener("input", () => view.seek(Number(this.scrub.value)));
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      view.seek(this.#timeAt(event));
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) view.seek(this.#timeAt(event));
      this.#hover(event);
    });
    this.canvas.addEventListener("pointerleave", () => (this.tip.hidden = true));
    new ResizeObserver(() => this.draw(true)).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw(true));
  }

  #timeAt(/** @type {PointerEvent} */ event) {
    const box = this.canvas.getBoundingClientRect();
    return Math.max(0, Math.min(1, (event.clientX - box.left) / box.width)) * this.view.duration;
  }

  #hover(/** @type {PointerEvent} */ event) {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const hit = this.boxes.findLast((b) => x >= b.x - 2 && x <= b.x + b.width + 2 && y >= b.y && y <= b.y + LANE);
    const lines = [secs(this.#timeAt(event))];
    if (hit) {
      const { name, from, to, status, reason } = hit.span;
      lines.push(`${words(name)}: ${STATUS[status]?.text ?? status} · ${secs(to - from)}${reason ? ` · ${reason}` : ""}`);
    }
    setText(this.tip, lines.join("  "));
    this.tip.hidden = false;
    this.tip.style.left = `${Math.min(Math.max(x, 60), box.width - 60)}px`;
  }

  /** Draws the moment; the bands only when they have changed. @param {boolean} [anew] */
  draw(anew = false) {
    const { view } = this;
    const duration = Math.max(view.duration, 1e-3);
    this.scrub.max = String(duration);
    if (document.activeElement !== this.scrub || Number(this.scrub.value) !== view.t) this.scrub.value = String(view.t);
    this.scrub.setAttribute("aria-valuetext", `${view.t.toFixed(2)} seconds of ${duration.toFixed(2)}`);
    const tick = view.runs[0]?.tickAt(view.t) ?? 0;
    setText(byId("time"), `${view.t.toFixed(2)} / ${secs(view.duration)}`);
    setText(byId("tick"), `tick ${tick}`);
    byId("tick").dataset.tick = String(tick);
    const ratio = devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.#height()];
    if (width === 0) return;
    const key = `${width}x${height}@${ratio} ${duration} ${view.runs.map((/** @type {Run} */ run) => run.version)} ${view.align}`;
    if (anew || key !== this.drawn) {
      this.drawn = key;
      this.canvas.style.height = `${height}px`;
      for (const canvas of [this.canvas, this.static]) [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
      this.#bands(width, height, ratio, duration);
    }
    const context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    context.drawImage(this.static, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const style = getComputedStyle(document.documentElement);
    context.fillStyle = style.getPropertyValue("--ink");
    const x = (view.t / duration) * width;
    context.fillRect(Math.min(Math.max(x - 0.75, 0), width - 1.5), 0, 1.5, height);
    context.beginPath();
    context.moveTo(x - 5, 0);
    context.lineTo(x + 5, 0);
    context.lineTo(x, 7);
    context.fill();
  }

  #height() {
    const runs = this.view.runs.length;
    return AXIS + runs * Math.max(...this.view.runs.map((/** @type {Run} */ run) => this.#lanes(run).n)) * (LANE + GAP) + (runs - 1) * 4;
  }

  /** Spans side by side where they overlap. @param {Run} run */
  #lanes(run) {
    if (this.cache?.has(run) && this.cache.get(run).version === run.version) return this.cache.get(run);
    const free = [0];
    const placed = run.spans().map((span) => {
      let lane = free.findIndex((until) => until <= span.from + 1e-6);
      if (lane < 0 && free.length < MAX_LANES) lane = free.push(0) - 1;
      if (lane < 0) lane = free.length - 1;
      free[lane] = Math.max(free[lane], span.to);
      return { span, lane };
    });
    const made = { version: run.version, placed, n: free.length };
    (this.cache ??= new WeakMap()).set(run, made);
    return made;
  }

  #bands(/** @type {number} */ width, /** @type {number} */ height, /** @type {number} */ ratio, /** @type {number} */ duration) {
    const context = /** @type {CanvasRenderingContext2D} */ (this.static.getContext("2d"));
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const style = getComputedStyle(document.documentElement);
    /** @type {Map<string, string>} */
    const colours = new Map();
    const colour = (/** @type {string} */ name) => {
      let value = colours.get(name);
      if (value === undefined) colours.set(name, (value = style.getPropertyValue(`--${name}`).trim()));
      return value;
    };
    context.font = `11px ${style.getPropertyValue("--sans")}`;
    context.textBaseline = "middle";
    this.boxes = [];
    const runs = this.view.runs;
    const rows = (height - AXIS - (runs.length - 1) * 4) / runs.length;
    runs.forEach((/** @type {Run} */ run, /** @type {number} */ i) => {
      const top = i * (rows + 4);
      const labels = [];
      const drawn = new Set();
      let lastMark = -Infinity;
      for (const { span, lane } of this.#lanes(run).placed) {
        const from = this.view.timeOf(run, span.from);
        const to = this.view.timeOf(run, span.to);
        const x = (from / duration) * width;
        const box = { x, y: top + 2 + lane * (LANE + GAP), width: Math.max(((to - from) / duration) * width, MIN_WIDTH), span, run };
        // Bands that share their pixels are one to the eye.
        const key = `${lane} ${span.status} ${Math.round(box.x)}`;
        if (box.width <= MIN_WIDTH && drawn.has(key)) continue;
        drawn.add(key);
        this.boxes.push(box);
        context.fillStyle = colour(`band-${span.status}`) || colour("band-idle");
        context.beginPath();
        context.roundRect(box.x, box.y, Math.max(box.width - 1, 1.5), LANE, box.width > 8 ? 3 : 0);
        context.fill();
        if (box.width >= MIN_LABEL) labels.push(box);
        if (span.status === "failure" && box.width < MIN_LABEL && box.x - lastMark > 12) {
          labels.push({ ...box, mark: true });
          lastMark = box.x;
        }
      }
      for (const box of labels) {
        const isMark = "mark" in box;
        context.save();
        context.beginPath();
        context.rect(box.x, box.y, isMark ? 40 : box.width - 4, LANE);
        context.clip();
        context.fillStyle = isMark ? colour("failure") : colour("band-ink");
        if (!isMark) context.fillText(`${STATUS[box.span.status]?.glyph ?? "■"} ${words(box.span.name)}`, box.x + 5, box.y + LANE / 2 + 0.5);
        else context.fillText("✗", box.x + 3, box.y + LANE / 2 + 0.5);
        context.restore();
      }
    });
    this.#axis(context, width, height, duration, colour);
  }

  #axis(/** @type {CanvasRenderingContext2D} */ context, /** @type {number} */ width, /** @type {number} */ height, /** @type {number} */ duration, /** @type {(name: string) => string} */ colour) {
    const target = (80 / width) * duration;
    const step = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300].find((s) => s >= target) ?? 600;
    context.fillStyle = colour("soft");
    for (let t = 0; t <= duration; t += step) {
      const x = (t / duration) * width;
      context.fillRect(x, height - AXIS + 2, 1, 4);
      context.textAlign = x < 12 ? "left" : x > width - 16 ? "right" : "center";
      context.fillText(`${Number(t.toFixed(2))}`, x, height - 6);
    }
    context.textAlign = "left";
  }
}
