// @ts-check
import { OrbitCamera } from "./camera.js";
import { Candidates } from "./candidates3d.js";
import { element, freeId, loadStyle } from "./dom.js";
import { Renderer } from "./gl.js";
import { matrixOf, multiply, transform, translation } from "./mathx.js";
import { KEY_POINT, lightOf, PATH, TOUCH, TRAIL, watchColours } from "./palette.js";
import { Kinematics } from "./robot.js";
import { clusterParts, contactPart, contactPlaces, grainPart, linkParts, objectParts, tableParts } from "./scene_parts.js";
import * as shapes from "./shapes.js";

/** The palm's way of the last seconds is drawn behind it. */
const TRAIL_SECS = 4;
const PRESETS = /** @type {Record<string, {label: string, view: Partial<import("./camera.js").View>}>} */ ({
  home: { label: "Overview", view: { azimuth: 0.72, elevation: 0.24 } },
  front: { label: "Front", view: { azimuth: 0, elevation: 0.12 } },
  side: { label: "Side", view: { azimuth: Math.PI / 2, elevation: 0.1 } },
  top: { label: "Top", view: { azimuth: Math.PI, elevation: 1.54 } },
  grasp: { label: "Grasp", view: { distance: 0.7, elevation: 0.32 } },
  palm: { label: "Palm", view: { distance: 0.75, elevation: 0.35 } },
});

/** The scene in three dimensions: robot, things, candidate palm poses, key point and paths at one moment of a run. */
export class Scene3d {
  /**
   * @param {HTMLElement} parent
   * @param {any} run
   * @param {{preset?: string}} [options]
   */
  constructor(parent, run, options = {}) {
    loadStyle();
    this.run = run;
    this.t = 0;
    this.isStale = true;
    this.frame = 0;
    /** @type {number[][] | null} */ this.shownPath = null;
    /** @type {number | null} */ this.selected = null;
    /** @type {number | null} */ this.hovered = null;
    /** @type {"auto" | "on" | "off"} */ this.showsCandidates = "auto";
    /** @type {((candidate: any) => void)[]} */ this.listeners = [];
    this.abort = new AbortController();
    this.root = element("div", { class: "v-scene" });
    this.canvas = /** @type {HTMLCanvasElement} */ (element("canvas", {
      id: freeId("scene-canvas"), tabindex: "0", role: "img",
      "aria-label": "Robot, things and palm poses. Drag or arrow keys turn, shift moves, plus and minus zoom.",
    }));
    this.tooltip = element("div", { id: freeId("scene-tooltip"), class: "scene-tooltip", role: "tooltip" });
    this.tooltip.hidden = true;
    this.legend = element("div", { class: "scene-legend-place" });
    this.root.append(this.canvas, this.#toolbar(), this.legend, this.tooltip);
    parent.append(this.root);
    this.camera = new OrbitCamera(this.canvas, () => this.#changed(false));
    try {
      this.renderer = new Renderer(this.canvas);
    } catch (error) {
      this.#explain(error instanceof Error ? error.message : String(error));
      return;
    }
    this.candidates = new Candidates(this.renderer);
    // Tests and the console reach the view through its canvas.
    Object.assign(this.canvas, { scene: this });
    this.#listen();
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.root);
    this.stopWatching = watchColours(() => this.#changed(false));
    this.preset(options.preset ?? "home");
    this.resize();
  }

  /** Says what is missing instead of an empty panel. @param {string} message */
  #explain(message) {
    this.root.replaceChildren(element("div", { class: "view-message", role: "note" }, [
      element("strong", {}, "No 3D view here"),
      element("p", {}, `This browser offers no WebGL2 (${message}). Turn on hardware acceleration, or open the page in a current Firefox, Chromium or Safari. Everything else on this page works without it.`),
    ]));
  }

  #toolbar() {
    const bar = element("div", { class: "view-tools", role: "toolbar", "aria-label": "Viewpoint" });
    for (const [name, { label }] of Object.entries(PRESETS)) {
      const button = element("button", { type: "button", "data-preset": name }, label);
      button.addEventListener("click", () => this.preset(name));
      bar.append(button);
    }
    const toggle = element("button", { type: "button", class: "apart", "data-toggle": "candidates", title: "auto: until the palm has arrived" });
    const say = () => toggle.replaceChildren(`Palm poses: ${this.showsCandidates}`);
    toggle.addEventListener("click", () => {
      this.showsCandidates = /** @type {const} */ ({ auto: "on", on: "off", off: "auto" })[this.showsCandidates];
      say();
      this.#changed(true);
    });
    say();
    bar.append(toggle);
    return bar;
  }

  #listen() {
    const options = { signal: this.abort.signal };
    this.canvas.addEventListener("pointermove", (event) => {
      if (this.camera.isDragged) return;
      const frame = this.canvas.getBoundingClientRect();
      this.#hover(event.clientX - frame.left, event.clientY - frame.top);
    }, options);
    this.canvas.addEventListener("pointerleave", () => this.#setHovered(null), options);
    this.canvas.addEventListener("pointerdown", () => this.#setHovered(null), options);
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.renderer = undefined;
      this.#explain("the graphics context was lost; reload the page");
    }, options);
  }

  // ---- what callers use ----

  /** Draws the moment `t`, seconds. @param {number} t */
  show(t) {
    this.t = t;
    this.#changed(true);
  }

  resize() {
    if (!this.renderer) return;
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.height = clientHeight;
    this.#changed(false);
  }

  destroy() {
    cancelAnimationFrame(this.frame);
    this.abort.abort();
    this.camera.destroy();
    this.observer?.disconnect();
    this.stopWatching?.();
    this.renderer?.gl.getExtension("WEBGL_lose_context")?.loseContext();
    this.renderer = undefined;
    this.root.remove();
  }

  /** World to clip space as drawn, column-major. @returns {number[]} */
  viewProjection() {
    return this.camera.viewProjection();
  }

  /** Where a point of the base frame is seen. @param {number[]} point @returns {{x: number, y: number, depth: number} | null} CSS pixels inside the canvas */
  project(point) {
    const m = this.viewProjection();
    const [x, y] = transform(m, point);
    const w = m[3] * point[0] + m[7] * point[1] + m[11] * point[2] + m[15];
    if (w <= 0) return null;
    const { clientWidth, clientHeight } = this.canvas;
    return { x: (0.5 + x / w / 2) * clientWidth, y: (0.5 - y / w / 2) * clientHeight, depth: w };
  }

  /** Where a link's frame is drawn. @param {string} name @returns {{position: number[]} | null} */
  linkPose(name) {
    this.#update();
    const idx = this.kinematics?.byName.get(name);
    return idx === undefined || !this.poses ? null : { position: [...this.poses[idx].slice(12, 15)] };
  }

  /** Marks a candidate, as when its row in a table is clicked. @param {number | null} idx */
  select(idx) {
    this.selected = idx;
    this.#changed(true);
  }

  /** @param {(candidate: any) => void} callback gets the candidate under the pointer, or null */
  onHover(callback) {
    this.listeners.push(callback);
  }

  /** One of the named viewpoints. @param {string} name */
  preset(name) {
    const preset = PRESETS[name];
    if (!preset) return;
    this.isFollowing = name === "palm";
    this.camera.isTouched = false;
    for (const button of this.root.querySelectorAll("[data-preset]")) {
      button.setAttribute("aria-pressed", String(button.getAttribute("data-preset") === name));
    }
    const isRight = this.run.header?.arm === "right";
    const table = this.run.header?.table;
    const middle = table ? [Math.min((table.low[0] + table.high[0]) / 2, table.low[0] + 0.3) - 0.28, 0.02, table.height_m + 0.13] : [0.35, 0, 0.88];
    const view = { target: middle, distance: 2.95, ...preset.view };
    if (isRight && (name === "home" || name === "side")) view.azimuth = -(view.azimuth ?? 0);
    if (this.isFollowing) {
      this.#update();
      view.target = this.#palm() ?? middle;
      view.azimuth = isRight ? -0.9 : 0.9;
    }
    if (name === "grasp") {
      this.#update();
      view.target = [...this.#graspPoint() ?? middle];
      view.azimuth = isRight ? -0.9 : 0.9;
    }
    this.presetName = name;
    this.camera.set(view);
  }

  // ---- drawing ----

  /** @param {boolean} isStale the moment changed, not only the viewpoint */
  #changed(isStale) {
    this.isStale ||= isStale;
    if (!this.renderer || this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      this.#draw();
    });
  }

  /** Builds what the header tells, once it is there. */
  #build() {
    const { renderer, run } = this;
    if (!renderer || run.header === this.header) return;
    this.header = run.header;
    if (!this.header) return;
    this.kinematics = new Kinematics(this.header);
    this.links = linkParts(renderer, this.header);
    this.objects = objectParts(renderer, this.header);
    this.table = this.header.table ? tableParts(renderer, this.header.table) : [];
    this.grains = grainPart(renderer);
    this.contacts = contactPart(renderer);
    this.marker = renderer.mesh(shapes.sphere(0.011, 20));
    if (this.presetName && !this.camera.isTouched) this.preset(this.presetName);
  }

  #palm() {
    const name = this.header?.palm_link;
    const idx = name ? this.kinematics?.byName.get(name) : undefined;
    return idx === undefined || !this.poses ? null : this.poses[idx].slice(12, 15);
  }

  /** Where the grasp is or will be: the chosen palm pose, else the key point. @returns {number[] | null} */
  #graspPoint() {
    const message = this.run.latest("/candidates", this.t);
    const chosen = message?.candidates?.find((/** @type {any} */ one) => one.idx === message.chosen) ?? message?.candidates?.[0];
    return chosen?.base_from_palm.translation ?? this.run.latest("/key_point", this.t)?.point_in_base ?? null;
  }

  /** Computes the moment: poses of links and things, marks, paths. */
  #update() {
    if (!this.isStale || !this.renderer) return;
    this.isStale = false;
    this.#build();
    const { run, t, kinematics } = this;
    if (!kinematics || !this.header) return;
    const robot = run.robotAt(t);
    /** @type {import("./gl.js").Item[]} */
    const items = [...(this.table ?? [])];
    // Just after the start the first sample is still to come; what was seen would flash up for a moment.
    const truth = run.latest("/truth", t) ?? run.between("/truth", t, t + 0.2)[0] ?? null;
    if (robot?.q) {
      this.poses = kinematics.poses(robot.q);
      this.isTouching = false;
      const touching = new Set((truth?.contacts ?? []).flatMap((/** @type {any} */ c) => [c.with, c.object]));
      for (const { link, own, item } of this.links ?? []) {
        const isTouching = touching.has(this.header.links[link].name);
        this.isTouching ||= isTouching;
        items.push({
          ...item, model: multiply(this.poses[link], own),
          colour: isTouching ? item.colour.map((x, i) => 0.45 * x + 0.55 * TOUCH[i]) : item.colour, glow: isTouching ? 0.15 : 0,
        });
      }
    }
    items.push(...this.#things(truth), ...this.#marks());
    this.items = items;
    const palm = this.isFollowing && !this.camera.isDragged ? this.#palm() : null;
    if (palm && !this.camera.isTouched) this.camera.view.target = [...palm];
  }

  /** Things and grains, or what was seen of them. @param {any} truth */
  #things(truth) {
    const { run, t, renderer } = this;
    if (!renderer) return [];
    const items = [];
    if (truth?.objects?.length) {
      for (const { object, item } of this.objects ?? []) items.push({ ...item, model: matrixOf(truth.objects[object]) });
    } else {
      const inventory = run.latest("/inventory", t);
      if (inventory !== this.inventory) {
        for (const item of this.clusters ?? []) renderer.free(item.mesh);
        this.inventory = inventory;
        this.clusters = clusterParts(renderer, inventory);
      }
      items.push(...(this.clusters ?? []));
    }
    // Grains are recorded less often than the rest.
    const list = truth?.grains ?? run.between("/truth", t - 0.35, t).findLast((/** @type {any} */ sample) => sample.grains)?.grains ?? [];
    if (this.grains && list.length > 0) {
      renderer.place(this.grains.mesh, Float32Array.from(list.flatMap((/** @type {number[]} */ p) => [p[0], p[1], p[2], this.header.grain_radius_m ?? 0.004])));
      items.push(this.grains);
    }
    const contacts = contactPlaces(truth?.contacts ?? []);
    if (this.contacts && contacts.length > 0) {
      renderer.place(this.contacts.mesh, contacts);
      items.push(this.contacts);
    }
    return items;
  }

  /** Palm poses, key point, the way to go and the way gone. */
  #marks() {
    const { run, t, renderer, candidates } = this;
    if (!renderer || !candidates) return [];
    /** @type {import("./gl.js").Item[]} */
    const items = [];
    const message = run.latest("/candidates", t);
    const since = message?.stamp_secs ?? 0;
    const isOver = run.between("/stages", since - 1e-6, t).some((/** @type {any} */ stage) => stage.stage === "reach_palm_pose");
    const shown = this.showsCandidates === "on" || (this.showsCandidates === "auto" && !isOver);
    candidates.set(shown ? message : null);
    items.push(...candidates.items(this.hovered ?? this.selected));
    this.legend.replaceChildren(...(candidates.list.length > 0 || this.isTouching ? [candidates.legend(this.isTouching ?? false)] : []));
    const keyPoint = run.latest("/key_point", t);
    if (keyPoint && !isOver && this.marker) {
      items.push({ mesh: this.marker, model: translation(keyPoint.point_in_base), colour: KEY_POINT, glow: 0.7, castsShadow: false, shinesThrough: true });
    }
    this.#path(shown ? message?.path ?? null : null, items);
    this.#trail(items);
    return items;
  }

  /** @param {number[][] | null} path @param {import("./gl.js").Item[]} items */
  #path(path, items) {
    if (path !== this.shownPath) {
      this.renderer?.free(this.pathMesh);
      this.shownPath = path;
      this.pathMesh = path && path.length > 1 ? this.renderer?.mesh(shapes.tube(path, 0.0028)) : null;
    }
    if (this.pathMesh) items.push({ mesh: this.pathMesh, model: translation([0, 0, 0]), colour: PATH, glow: 0.5, castsShadow: false });
  }

  /** @param {import("./gl.js").Item[]} items */
  #trail(items) {
    const { run, t, kinematics, renderer } = this;
    renderer?.free(this.trailMesh);
    this.trailMesh = null;
    const palm = this.header?.palm_link;
    if (!renderer || !kinematics || !palm) return;
    const points = [];
    for (let step = 40; step >= 0; step -= 1) {
      const at = t - (step / 40) * TRAIL_SECS;
      const q = at >= 0 ? run.robotAt(at)?.q : null;
      const point = q ? kinematics.position(q, palm) : null;
      if (point) points.push(point);
    }
    const first = points[0];
    if (!first || points.every((p) => Math.hypot(p[0] - first[0], p[1] - first[1], p[2] - first[2]) < 0.01)) return;
    this.trailMesh = renderer.mesh(shapes.tube(points, 0.002));
    items.push({ mesh: this.trailMesh, model: translation([0, 0, 0]), colour: TRAIL, glow: 0.4, castsShadow: false, alpha: 0.85 });
  }

  #draw() {
    const { renderer } = this;
    if (!renderer) return;
    this.#update();
    renderer.draw(this.items ?? [], this.viewProjection(), this.camera.eye(), lightOf(this.root));
    this.canvas.dataset.drawn = String(this.t);
    this.#placeTooltip();
  }

  // ---- pointing ----

  /** @param {number} x @param {number} y */
  #hover(x, y) {
    this.#update();
    const found = this.candidates?.pick(x, y, (point) => this.project(point)) ?? null;
    this.#setHovered(found ? found.idx ?? this.candidates?.list.indexOf(found) ?? null : null);
  }

  /** @param {number | null} idx */
  #setHovered(idx) {
    if (idx === this.hovered) return;
    this.hovered = idx;
    this.canvas.style.cursor = idx === null ? "" : "pointer";
    this.#changed(true);
    this.#placeTooltip();
    const candidate = idx === null ? null : this.candidates?.byIdx(idx);
    for (const listener of this.listeners) listener(candidate ?? null);
  }

  #placeTooltip() {
    const idx = this.hovered ?? this.selected;
    const candidate = idx === null ? null : this.candidates?.byIdx(idx);
    const at = candidate ? this.project(candidate.base_from_palm.translation) : null;
    this.tooltip.hidden = !at;
    if (!candidate || !at) return;
    const label = `${idx}/${this.candidates?.chosen}/${this.candidates?.list.length}`;
    if (this.tooltip.dataset.shows !== label) {
      this.tooltip.dataset.shows = label;
      this.tooltip.dataset.candidate = String(idx);
      this.tooltip.replaceChildren(...(this.candidates?.describe(candidate) ?? []));
    }
    const { offsetWidth, offsetHeight } = this.tooltip;
    const room = { x: this.root.clientWidth, y: this.root.clientHeight };
    const left = at.x + 18 + offsetWidth > room.x ? at.x - 18 - offsetWidth : at.x + 18;
    this.tooltip.style.left = `${Math.max(4, left)}px`;
    this.tooltip.style.top = `${Math.max(4, Math.min(at.y - 20, room.y - offsetHeight - 4))}px`;
  }
}
