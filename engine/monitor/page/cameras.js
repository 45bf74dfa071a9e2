// @ts-check
import { element, loadStyle } from "./dom.js";
import { decodePng16 } from "./png16.js";

const MODES = { image: "Colour", depth: "Depth", grounding: "Grounding" };
/** Where colours of depth begin and end at most, metres. */
const DEPTH_RANGE_M = [0.3, 2.5];
/** Near to far: light and warm to dark and cold. */
const DEPTH = [[255, 236, 150], [250, 160, 60], [205, 66, 96], [110, 30, 120], [24, 16, 62]];

/** Both camera images at a moment, with the mask of the part to hold, its box and the key point; or the depth. */
export class CameraViews {
  /** @param {HTMLElement} parent @param {any} run */
  constructor(parent, run) {
    loadStyle();
    this.run = run;
    this.t = 0;
    /** @type {keyof typeof MODES} */ this.mode = "image";
    /** @type {Map<string, {canvas: HTMLCanvasElement, caption: HTMLElement, wanted: string, drawn: string}>} */
    this.views = new Map();
    this.row = element("div", { class: "row" });
    this.root = element("div", { class: "v-cameras" }, [this.#tools(), this.row]);
    parent.append(this.root);
    this.#build();
  }

  #tools() {
    const bar = element("div", { class: "view-tools", role: "toolbar", "aria-label": "Camera images" });
    for (const [mode, label] of Object.entries(MODES)) {
      const button = element("button", { type: "button", "data-mode": mode, "aria-pressed": String(mode === this.mode) }, label);
      if (mode === "grounding") button.title = "the images in which the part to hold was found";
      button.addEventListener("click", () => {
        this.mode = /** @type {keyof typeof MODES} */ (mode);
        for (const other of bar.children) other.setAttribute("aria-pressed", String(other === button));
        this.show(this.t);
      });
      bar.append(button);
    }
    return bar;
  }

  #build() {
    this.header = this.run.header;
    this.views.clear();
    const cameras = this.header?.cameras ?? [];
    if (cameras.length === 0) {
      this.row.replaceChildren(element("div", { class: "empty" }, this.header ? "This robot has no cameras." : "No images yet."));
      return;
    }
    this.row.replaceChildren(...cameras.map((/** @type {any} */ camera) => {
      const { width, height } = camera.intrinsics;
      const canvas = /** @type {HTMLCanvasElement} */ (element("canvas", {
        width: String(width), height: String(height), "data-camera": camera.name, role: "img", "aria-label": `${camera.name} camera`,
      }));
      const caption = element("figcaption");
      this.views.set(camera.name, { canvas, caption, wanted: "", drawn: "" });
      return element("figure", {}, [element("div", { class: "frame" }, canvas), caption]);
    }));
  }

  resize() {
    // The images are laid out by the style sheet.
  }

  destroy() {
    this.views.clear();
    this.root.remove();
  }

  /** Draws the moment `t`. @param {number} t */
  show(t) {
    this.t = t;
    if (this.run.header !== this.header) this.#build();
    for (const [camera, view] of this.views) this.#showView(camera, view);
  }

  /** @param {string} camera @param {{canvas: HTMLCanvasElement, caption: HTMLElement, wanted: string, drawn: string}} view */
  #showView(camera, view) {
    const masks = this.run.latest("/masks", this.t);
    const kind = this.mode === "depth" ? "depth" : "image";
    const at = this.mode === "grounding" && masks ? masks.stamp_secs : this.t;
    const url = this.run.imageUrl(camera, kind, at);
    // A mask belongs to the image it was found in; on a later one it would lie beside the thing.
    const isOfImage = masks && url === this.run.imageUrl(camera, kind, masks.stamp_secs);
    const mask = isOfImage ? masks.views?.find((/** @type {any} */ one) => one.camera === camera) ?? null : null;
    const wanted = `${kind} ${url} ${mask ? masks.stamp_secs : ""}`;
    if (wanted === view.wanted) return;
    view.wanted = wanted;
    if (!url) {
      view.canvas.getContext("2d")?.clearRect(0, 0, view.canvas.width, view.canvas.height);
      this.#caption(camera, view, "no image yet", null);
      return;
    }
    const draw = kind === "depth" ? this.#drawDepth(view.canvas, url, view, wanted) : this.#drawImage(view.canvas, url, view, wanted);
    draw.then((range) => {
      if (view.wanted !== wanted) return;
      if (mask) drawMask(view.canvas, mask);
      view.drawn = wanted;
      view.canvas.dataset.drawn = url;
      const note = mask ? "part to hold and key point" : masks && this.mode === "image" ? "later than the mask" : "";
      this.#caption(camera, view, note, range);
    }).catch(() => {
      if (view.wanted === wanted) this.#caption(camera, view, "this image cannot be shown", null);
    });
  }

  /** @param {string} camera @param {{caption: HTMLElement}} view @param {string} note @param {number[] | null} range */
  #caption(camera, view, note, range) {
    const parts = [element("b", {}, `${camera} camera`), element("span", {}, note)];
    if (range) {
      const bar = element("i");
      bar.style.background = `linear-gradient(to right, ${DEPTH.map((c) => `rgb(${c.join(" ")})`).join(", ")})`;
      parts.push(element("span", { class: "depth-scale" }, [`${range[0].toFixed(1)} m`, bar, `${range[1].toFixed(1)} m`]));
    }
    view.caption.replaceChildren(...parts);
  }

  /** @param {HTMLCanvasElement} canvas @param {string} url @param {{wanted: string}} view @param {string} wanted @returns {Promise<null>} */
  async #drawImage(canvas, url, view, wanted) {
    const image = new Image();
    image.src = url;
    await image.decode();
    if (view.wanted === wanted) canvas.getContext("2d")?.drawImage(image, 0, 0, canvas.width, canvas.height);
    return null;
  }

  /** @param {HTMLCanvasElement} canvas @param {string} url @param {{wanted: string}} view @param {string} wanted @returns {Promise<number[]>} the range of depths, metres */
  async #drawDepth(canvas, url, view, wanted) {
    const response = await fetch(url);
    if (!response.ok) throw new Error(String(response.status));
    const { width, height, values } = await decodePng16(await response.arrayBuffer());
    const [low, high] = spread(values);
    const picture = new ImageData(width, height);
    for (let i = 0; i < values.length; i += 1) {
      const share = Math.max(0, Math.min(0.9999, (values[i] / 1000 - low) / (high - low)));
      const at = share * (DEPTH.length - 1);
      const k = Math.floor(at);
      for (let c = 0; c < 3; c += 1) {
        picture.data[4 * i + c] = values[i] === 0 ? 128 : DEPTH[k][c] + (DEPTH[k + 1][c] - DEPTH[k][c]) * (at - k);
      }
      // Pixels without a return stay see-through.
      picture.data[4 * i + 3] = values[i] === 0 ? 40 : 255;
    }
    const bitmap = await createImageBitmap(picture);
    const context = canvas.getContext("2d");
    if (context && view.wanted === wanted) {
      context.clearRect(0, 0, canvas.width, canvas.height);
      context.imageSmoothingEnabled = false;
      context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
    }
    return [low, high];
  }
}

/** The depths that nearly all pixels lie between, metres. @param {Uint16Array} values */
function spread(values) {
  const counts = new Uint32Array(256);
  let n = 0;
  for (const value of values) {
    if (value === 0) continue;
    counts[Math.min(255, value >> 4)] += 1;
    n += 1;
  }
  if (n === 0) return DEPTH_RANGE_M;
  const at = (/** @type {number} */ share) => {
    let sum = 0;
    for (let k = 0; k < 256; k += 1) {
      sum += counts[k];
      if (sum >= share * n) return (k * 16) / 1000;
    }
    return DEPTH_RANGE_M[1];
  };
  const low = Math.max(0, at(0.01));
  return [low, Math.max(low + 0.1, at(0.99))];
}

/** @param {HTMLCanvasElement} canvas @param {any} mask with runs of pixels, a box and a key point */
function drawMask(canvas, mask) {
  const context = canvas.getContext("2d");
  if (!context) return;
  const [sx, sy] = [canvas.width / mask.width, canvas.height / mask.height];
  context.fillStyle = "rgb(255 140 0 / 0.5)";
  for (const [start, length] of mask.runs ?? []) {
    // A run may go on in the next row.
    for (let at = start; at < start + length;) {
      const x = at % mask.width;
      const n = Math.min(start + length - at, mask.width - x);
      context.fillRect(x * sx, Math.floor(at / mask.width) * sy, n * sx, sy);
      at += n;
    }
  }
  if (mask.box) {
    const [x0, y0, x1, y1] = mask.box;
    context.strokeStyle = "#fff";
    context.lineWidth = 3;
    context.strokeRect(x0 * sx, y0 * sy, (x1 + 1 - x0) * sx, (y1 + 1 - y0) * sy);
    context.strokeStyle = "#ff8c00";
    context.lineWidth = 1.5;
    context.strokeRect(x0 * sx, y0 * sy, (x1 + 1 - x0) * sx, (y1 + 1 - y0) * sy);
  }
  if (mask.key_point_px) {
    const [u, v] = [mask.key_point_px[0] * sx, mask.key_point_px[1] * sy];
    for (const [width, colour] of /** @type {[number, string][]} */ ([[6, "#fff"], [3, "#d81b4a"]])) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      context.moveTo(u - 11, v);
      context.lineTo(u + 11, v);
      context.moveTo(u, v - 11);
      context.lineTo(u, v + 11);
      context.stroke();
    }
  }
}
