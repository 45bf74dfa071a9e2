// @ts-check
import { add, cross, lookAt, multiply, normalize, perspective, subtract, times } from "./mathx.js";

const FOV_Y = (36 * Math.PI) / 180;
const NEAR = 0.03;
const FAR = 40;

/** @typedef {{target: number[], distance: number, azimuth: number, elevation: number}} View */

/**
 * A camera that circles around a point: drag turns, right drag or shift drag moves, wheel and pinch zoom, keys do the same.
 * Angles in radians, +Z is up; azimuth 0 looks at the robot's face.
 */
export class OrbitCamera {
  /**
   * @param {HTMLElement} element takes the pointer and key events
   * @param {() => void} onChange
   */
  constructor(element, onChange) {
    /** @type {View} */
    this.view = { target: [0.45, 0.08, 0.9], distance: 2.9, azimuth: 0.72, elevation: 0.33 };
    this.onChange = onChange;
    this.aspect = 1;
    this.height = 500;
    /** @type {Map<number, {x: number, y: number}>} */
    this.pointers = new Map();
    this.isTouched = false;
    this.abort = new AbortController();
    const options = { signal: this.abort.signal };
    element.addEventListener("pointerdown", (event) => this.#down(element, event), options);
    element.addEventListener("pointermove", (event) => this.#move(event), options);
    for (const name of ["pointerup", "pointercancel"]) {
      element.addEventListener(name, (event) => this.pointers.delete(/** @type {PointerEvent} */ (event).pointerId), options);
    }
    element.addEventListener("contextmenu", (event) => event.preventDefault(), options);
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(Math.max(-0.5, Math.min(0.5, event.deltaY * 0.0015))));
    }, { ...options, passive: false });
    element.addEventListener("keydown", (event) => this.#key(event), options);
  }

  destroy() {
    this.abort.abort();
  }

  get isDragged() {
    return this.pointers.size > 0;
  }

  /** @param {HTMLElement} element @param {PointerEvent} event */
  #down(element, event) {
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    try {
      element.setPointerCapture(event.pointerId);
    } catch {
      // A pointer that has already gone cannot be captured; nothing depends on it.
    }
  }

  /** @param {PointerEvent} event */
  #move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.x, event.clientY - before.y];
    if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1] ?? before;
      const spread = (/** @type {{x: number, y: number}} */ p) => Math.hypot(p.x - other.x, p.y - other.y) || 1;
      this.zoom(spread(before) / spread({ x: event.clientX, y: event.clientY }));
      this.pan(dx / 2, dy / 2);
    } else if (event.buttons === 1 && !event.shiftKey) {
      this.turn(-dx * 0.006, dy * 0.006);
    } else {
      this.pan(dx, dy);
    }
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = 0.12;
    /** @type {Record<string, () => void>} */
    const actions = event.shiftKey
      ? {
          ArrowLeft: () => this.pan(40, 0), ArrowRight: () => this.pan(-40, 0),
          ArrowUp: () => this.pan(0, 40), ArrowDown: () => this.pan(0, -40),
        }
      : {
          ArrowLeft: () => this.turn(-step, 0), ArrowRight: () => this.turn(step, 0),
          ArrowUp: () => this.turn(0, step), ArrowDown: () => this.turn(0, -step),
          "+": () => this.zoom(0.85), "=": () => this.zoom(0.85), "-": () => this.zoom(1 / 0.85),
        };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    event.stopPropagation();
    action();
  }

  /** @param {number} azimuth @param {number} elevation */
  turn(azimuth, elevation) {
    this.view.azimuth += azimuth;
    this.view.elevation = Math.max(-0.4, Math.min(1.55, this.view.elevation + elevation));
    this.#changed();
  }

  /** @param {number} factor */
  zoom(factor) {
    this.view.distance = Math.max(0.12, Math.min(15, this.view.distance * factor));
    this.#changed();
  }

  /** @param {number} dx CSS pixels @param {number} dy */
  pan(dx, dy) {
    const { right, above } = this.basis();
    const scale = (2 * this.view.distance * Math.tan(FOV_Y / 2)) / Math.max(this.height, 1);
    this.view.target = add(this.view.target, add(times(right, -dx * scale), times(above, dy * scale)));
    this.#changed();
  }

  /** @param {Partial<View>} view */
  set(view) {
    Object.assign(this.view, view);
    this.onChange();
  }

  #changed() {
    this.isTouched = true;
    this.onChange();
  }

  eye() {
    const { target, distance, azimuth, elevation } = this.view;
    const flat = distance * Math.cos(elevation);
    return add(target, [flat * Math.cos(azimuth), flat * Math.sin(azimuth), distance * Math.sin(elevation)]);
  }

  basis() {
    const back = normalize(subtract(this.eye(), this.view.target));
    const right = normalize(cross([0, 0, 1], back));
    return { back, right, above: cross(back, right) };
  }

  /** World to clip space. @returns {number[]} column-major */
  viewProjection() {
    // A narrow panel keeps the width of the scene instead of its height.
    const fov = this.aspect < 1 ? 2 * Math.atan(Math.tan(FOV_Y / 2) / this.aspect) : FOV_Y;
    return multiply(perspective(fov, this.aspect, NEAR, FAR), lookAt(this.eye(), this.view.target, [0, 0, 1]));
  }
}
