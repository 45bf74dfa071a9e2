// @ts-check
import { Alignment, firstDifference } from "./compare.js";
import { ControlBar } from "./control.js";
import { byId, h, secs, setText, words } from "./html.js";
import { fillHelp, listen } from "./keys.js";
import { keepLink, linkTo, readLink } from "./link.js";
import { Panel } from "./panel.js";
import { ask, Run } from "./run.js";
import { Timeline } from "./timeline.js";

const LIVE = /** @type {Record<string, string>} */ ({ on: "● live", lost: "○ reconnecting", gone: "○ the connection is lost", ended: "■ the run is over" });

/** The state of the page: which runs, which moment, what is selected. */
class View {
  constructor() {
    /** @type {Run[]} */ this.runs = [];
    /** @type {Panel[]} */ this.panels = [];
    /** @type {Alignment | null} */ this.alignment = null;
    this.t = 0;
    this.isPlaying = false;
    this.follows = false;
    this.speed = 1;
    /** @type {string | null} */ this.node = null;
    this.run = 0;
    this.frame = 0;
    this.last = 0;
    this.isStale = false;
  }

  /** Seconds that can be shown. */
  get duration() {
    const [first, second] = this.runs;
    if (!first) return 0;
    return second && this.alignment ? Math.max(first.duration, this.alignment.toFirst(second.duration)) : first.duration;
  }

  get align() {
    return this.alignment?.by ?? "time";
  }

  /** The page's time of a moment of a run. @param {Run} run @param {number} t */
  timeOf(run, t) {
    return run === this.runs[1] && this.alignment ? this.alignment.toFirst(t) : t;
  }

  /** Goes to a moment at once. @param {number} t */
  seek(t) {
    this.t = Math.max(0, Math.min(this.duration, Number.isFinite(t) ? t : 0));
    this.follows = false;
    this.#showPlaying();
    this.#draw();
  }

  /** @param {1 | -1} direction */
  step(direction) {
    this.pause();
    this.seek(this.runs[0].stepFrom(this.t, direction));
  }

  /** @param {1 | -1} direction */
  change(direction) {
    this.pause();
    this.seek(this.runs[0].changeFrom(this.t, direction));
  }

  play() {
    this.follows = false;
    if (this.t >= this.duration - 1e-6 && !this.runs[0].live) this.t = 0;
    this.isPlaying = true;
    this.last = performance.now();
    this.#showPlaying();
    this.#next();
  }

  /** Holds the page at this moment, also one that follows a run. */
  pause() {
    this.isPlaying = false;
    this.follows = false;
    this.#showPlaying();
    this.invalidate();
  }

  toggle() {
    if (this.isPlaying || this.follows) this.pause();
    else this.play();
  }

  goLive() {
    if (!this.runs[0].live) return;
    this.pause();
    this.follows = true;
    this.#showPlaying();
    this.invalidate();
  }

  #showPlaying() {
    const button = byId("play");
    const moves = this.isPlaying || this.follows;
    button.dataset.playing = String(moves);
    setText(button, moves ? "❚❚" : "▶");
    button.setAttribute("aria-label", moves ? "Pause" : "Play");
  }

  /** Draws in the next frame. */
  invalidate() {
    this.isStale = true;
    this.#next();
  }

  #next() {
    if (this.frame !== 0) return;
    this.frame = requestAnimationFrame((now) => {
      this.frame = 0;
      if (this.isPlaying) {
        this.t = Math.min(this.duration, this.t + ((now - this.last) / 1000) * this.speed);
        this.last = now;
        if (this.t >= this.duration && !this.runs[0].live) this.pause();
        this.isStale = true;
      }
      if (this.follows) this.t = this.duration;
      if (this.isStale) this.#draw();
      if (this.isPlaying) this.#next();
    });
  }

  #draw() {
    this.isStale = false;
    this.panels.forEach((panel, i) => panel.show(i === 1 && this.alignment ? this.alignment.toSecond(this.t) : this.t));
    this.timeline?.draw();
    byId("go-live").hidden = !this.runs[0]?.live || this.follows;
    keepLink(() => linkTo(this.t, this.run, this.node));
  }

  /** @param {number} run @param {string | null} path */
  select(run, path) {
    [this.run, this.node] = [run, path];
    this.panels.forEach((panel, i) => panel.select(i === run || this.runs[i].byNode.has(path ?? "") ? path : null));
    this.control?.showNode();
    keepLink(() => linkTo(this.t, this.run, this.node));
  }

  focusSearch() {
    byId("search").focus();
  }

  leaveSearch() {
    byId("search").value = "";
    for (const panel of this.panels) panel.tree.search("");
    byId("search").blur();
  }

  help() {
    const dialog = byId("help");
    if (dialog.open) dialog.close();
    else dialog.showModal();
  }

  theme() {
    const root = document.documentElement;
    const isDark = root.dataset.theme === "dark";
    root.dataset.theme = isDark ? "light" : "dark";
    try {
      localStorage.setItem("theme", root.dataset.theme);
    } catch {
      // Without a store the choice lasts as long as the page.
    }
    this.restyle();
  }

  /** Draws everything in the colours of now. */
  restyle() {
    // Before there is something to draw, the address must stay as it is.
    if (!this.timeline) return;
    this.timeline.draw(true);
    for (const panel of this.panels) panel.resize();
    this.invalidate();
  }
}

/** @param {string} text */
function say(text) {
  const notice = byId("notice");
  notice.hidden = text === "";
  setText(notice, text);
}

/** The user's own choice, or null. */
function keptTheme() {
  try {
    return localStorage.getItem("theme");
  } catch {
    // A browser may forbid it.
    return null;
  }
}

/** Shows the chosen theme; without a choice the system's, also when that changes. @param {View} view */
function followTheme(view) {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const show = () => {
    document.documentElement.dataset.theme = keptTheme() ?? (dark.matches ? "dark" : "light");
    view.restyle();
  };
  show();
  dark.addEventListener("change", show);
}

/** @param {View} view */
function showHeader(view) {
  const [first, second] = view.runs;
  const header = first.header ?? first.metadata;
  const instruction = header.instruction || first.name;
  setText(byId("instruction"), second ? `${first.name}  ·  ${second.name}` : `“${instruction}”`);
  document.title = `${instruction} · SayFuncGrasp`;
  const scenario = String(header.scenario ?? "").split("/").at(-1)?.replace(/\.ya?ml$/, "") ?? "";
  setText(byId("about"), second ? `“${instruction}”` : [scenario, header.seed !== undefined ? `seed ${header.seed}` : "", secs(first.duration, 1)].filter(Boolean).join(" · "));
  const verdict = first.latest("/verdict", Infinity);
  const chip = byId("verdict");
  chip.hidden = !verdict || Boolean(second);
  if (verdict) {
    chip.dataset.outcome = verdict.outcome;
    setText(chip, `${verdict.outcome === "success" ? "✓" : "✗"} ${words(verdict.outcome)}`);
  }
}

/** @param {View} view */
function compare(view) {
  const [first, second] = view.runs;
  if (!second) return;
  view.alignment = new Alignment(first, second);
  byId("compare").hidden = false;
  byId("align").addEventListener("change", (/** @type {any} */ event) => {
    if (view.alignment) view.alignment.by = event.target.value;
    view.timeline?.draw(true);
    view.seek(view.t);
  });
  const button = byId("first-difference");
  const difference = firstDifference(first, second);
  button.disabled = difference === null;
  button.dataset.t = difference ? String(difference.t) : "";
  button.title = difference?.text ?? "";
  setText(button, difference ? `First difference at ${secs(difference.t)}` : "No difference in the tree");
  button.addEventListener("click", () => {
    if (!difference) return;
    view.pause();
    say(difference.text);
    view.seek(difference.t);
  });
}

/** @param {View} view @param {boolean} hasControl */
function follow(view, hasControl) {
  const run = view.runs[0];
  const chip = byId("live-state");
  const showState = (/** @type {string} */ state) => {
    chip.hidden = false;
    chip.dataset.live = state;
    document.body.dataset.live = String(run.live);
    setText(chip, LIVE[state] ?? state);
    if (state === "gone") say("sfg has ended or cannot be reached. What came until then stays here; sfg view shows the recording.");
    if (state === "ended") say("");
  };
  if (hasControl) {
    view.control = new ControlBar({
      selected: () => view.node,
      say,
      onState: () => {
        view.panels[0].tree.marks = view.control?.marks() ?? new Map();
        view.invalidate();
      },
    });
  }
  run.onChange = ({ control, state }) => {
    if (state) showState(state);
    if (control) view.control?.show(control);
    showHeader(view);
    view.invalidate();
  };
  if (readLink().t === null) view.goLive();
  run.follow();
}

async function begin() {
  const view = new View();
  followTheme(view);
  fillHelp(byId("help-keys"));
  const [info, abouts] = await Promise.all([ask("api/info").then((r) => r.json()), ask("api/runs").then((r) => r.json())]);
  view.runs = abouts.slice(0, 2).map((/** @type {any} */ about, /** @type {number} */ i) => new Run(i, about));
  await Promise.all(view.runs.map((run) => run.load()));
  const main = byId("runs");
  main.classList.toggle("two", view.runs.length === 2);
  compare(view);
  view.panels = view.runs.map((run, i) => new Panel(main, run, {
    onSeek: (t) => {
      view.pause();
      view.seek(view.timeOf(run, t));
    },
    onSelect: (path) => view.select(i, path),
  }));
  view.timeline = new Timeline(view);
  const notes = view.runs.map((run) => run.note).filter(Boolean);
  if (notes.length > 0) say(notes.join(" "));
  showHeader(view);
  document.body.dataset.live = String(view.runs[0].live);
  connectButtons(view);
  const link = readLink();
  view.seek(link.t ?? (view.runs[0].live ? view.duration : 0));
  if (link.node !== null) view.select(Math.min(link.run, view.panels.length - 1), link.node);
  await Promise.all(view.panels.map((panel) => panel.mount()));
  if (view.runs[0].live) follow(view, info.control);
  addEventListener("hashchange", () => {
    const { t, run, node } = readLink();
    if (t !== null) view.seek(t);
    if (node !== view.node) view.select(run, node);
  });
  listen(view);
  // The one handle for tests and the console.
  /** @type {any} */ (window).sfg = view;
  document.body.dataset.state = "ready";
}

/** @param {View} view */
function connectButtons(view) {
  /** @type {Record<string, () => void>} */
  const actions = {
    play: () => view.toggle(), "step-back": () => view.step(-1), "step-forward": () => view.step(1), "previous-change": () => view.change(-1),
    "next-change": () => view.change(1), "go-live": () => view.goLive(), theme: () => view.theme(), "help-button": () => view.help(),
  };
  for (const [id, action] of Object.entries(actions)) byId(id).addEventListener("click", action);
  byId("speed").addEventListener("change", (/** @type {any} */ event) => (view.speed = Number(event.target.value)));
  byId("search").addEventListener("input", (/** @type {any} */ event) => {
    for (const panel of view.panels) panel.tree.search(event.target.value);
  });
  addEventListener("resize", () => view.panels.forEach((panel) => panel.resize()));
}

begin().catch((error) => {
  document.body.dataset.state = "error";
  byId("runs").replaceChildren(h("p", { class: "failure" }, `The run cannot be shown: ${error instanceof Error ? error.message : error}`));
});
