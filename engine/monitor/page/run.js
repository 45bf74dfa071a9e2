// @ts-check
import { countUntil } from "./html.js";

/** Rounding of times in files must not hide a message. */
const EPSILON = 1e-6;
const RECONNECT_MS = [250, 500, 1000, 2000, 4000];

/** @typedef {{t: number, m: any}} Timed */
/** @typedef {{t: number, tick: number, from: string, to: string, reason?: string, detail?: string}} Transition */
/** @typedef {{path: string, parent: number | null, kind: string, name: string, doc: string, ports: any[], depth: number, children: number[]}} TreeNode */

/** The token of the address, for every request. */
export const token = new URLSearchParams(location.search).get("token");

/** @param {string} path @param {Record<string, string | number>} [query] */
export function apiUrl(path, query = {}) {
  const url = new URL(path, location.href);
  for (const [name, value] of Object.entries(query)) url.searchParams.set(name, String(value));
  if (token !== null) url.searchParams.set("token", token);
  return url.href;
}

/** @param {string} path @returns {Promise<Response>} */
export async function ask(path) {
  const response = await fetch(apiUrl(path));
  if (response.ok) return response;
  let message = `${response.status} ${response.statusText}`;
  try {
    message = (await response.json()).error ?? message;
  } catch {
    // The status is all there is.
  }
  throw new Error(message);
}

/** One run: its messages by topic and time, loaded at once or growing while it happens. */
export class Run {
  /** @param {number} id @param {any} about as in `/api/runs` */
  constructor(id, about) {
    this.id = id;
    this.name = about.name;
    this.live = about.live;
    this.note = about.note;
    this.metadata = about.metadata ?? {};
    this.duration = 0;
    /** Grows with every batch. */
    this.version = 0;
    /** @type {(what: {control?: any, state?: string}) => void} */
    this.onChange = () => {};
    this.#clear();
  }

  #clear() {
    /** @type {Map<string, Timed[]>} */
    this.topics = new Map();
    /** @type {Map<string, Transition[]>} */
    this.byNode = new Map();
    /** @type {Transition[]} */
    this.transitions = [];
    /** @type {Map<string, Timed[]>} */
    this.byKey = new Map();
    /** @type {Map<string, {reason: string, detail: string}>} */
    this.failed = new Map();
    this.hasReasons = false;
    this.hasWrites = false;
    /** @type {{t: number, tick: number}[]} */
    this.ticks = [];
    /** @type {Map<string, number[]>} */
    this.images = new Map();
    /** @type {TreeNode[] | null} */
    this.guessed = null;
    /** @type {WeakMap<object, TreeNode[]>} */
    this.definitions = new WeakMap();
    this.next = 0;
  }

  /** Loads all there is so far. */
  async load() {
    const response = await ask(`api/runs/${this.id}/messages`);
    const next = Number(response.headers.get("x-next") ?? 0);
    const text = await response.text();
    this.#clear();
    this.#addLines(text);
    this.next = next;
  }

  /** Follows a run that happens now. */
  follow() {
    let attempt = 0;
    let isOver = false;
    const connect = () => {
      const url = apiUrl(`api/runs/${this.id}/live`, { from: this.next }).replace(/^http/, "ws");
      const socket = new WebSocket(url);
      socket.addEventListener("open", () => {
        attempt = 0;
        this.onChange({ state: "on" });
      });
      socket.addEventListener("message", async ({ data }) => {
        if (!data.startsWith("{")) {
          this.next += this.#addLines(data);
          this.onChange({});
          return;
        }
        const said = JSON.parse(data);
        if (said.control) this.onChange({ control: said.control });
        if (said.over) {
          isOver = true;
          this.live = false;
          this.onChange({ state: "ended" });
        }
        if (said.reload) {
          // Too far behind: the whole at once is faster than what was missed piece by piece.
          isOver = true;
          await this.load();
          this.onChange({});
          this.follow();
        }
      });
      socket.addEventListener("close", () => {
        if (isOver) return;
        const wait = RECONNECT_MS[attempt];
        attempt += 1;
        this.onChange({ state: wait === undefined ? "gone" : "lost" });
        if (wait !== undefined) setTimeout(connect, wait);
      });
    };
    connect();
  }

  /** @param {string} text lines `[topic, seconds, message]` @returns {number} how many */
  #addLines(text) {
    let n = 0;
    for (let begin = 0; begin < text.length; n += 1) {
      let end = text.indexOf("\n", begin);
      if (end < 0) end = text.length;
      const [topic, t, message] = JSON.parse(text.slice(begin, end));
      this.#add(topic, t, message);
      begin = end + 1;
    }
    this.version += 1;
    return n;
  }

  /** @param {string} topic @param {number} t @param {any} m */
  #add(topic, t, m) {
    if (t > this.duration) this.duration = t;
    switch (topic) {
      case "/journal": return this.#addJournal(t, m);
      case "/tree": return this.#addTransition(t, m);
      case "/image_index": return insert(getOr(this.images, `${m.kind}/${m.camera}`), t, (at) => at);
      case "/blackboard":
        if (!this.hasWrites) this.byKey.clear();
        this.hasWrites = true;
        insert(getOr(this.byKey, m.key), { t, m }, (item) => item.t);
        break;
      default:
    }
    insert(getOr(this.topics, topic), { t, m }, (item) => item.t);
  }

  /** @param {number} t @param {any} m */
  #addJournal(t, m) {
    if (!m.before && !m.halt) insert(this.ticks, { t, tick: m.tick }, (item) => item.t);
    for (const [what, path, a, b] of m.changes ?? []) {
      if (what === "failed") this.#addReason(path, t, a, b);
      // Recordings without a channel of their own for writes have them here.
      if (what === "wrote" && !this.hasWrites) {
        insert(getOr(this.byKey, a), { t, m: { stamp_secs: t, tick: m.tick, node: path, key: a, value: b } }, (item) => item.t);
      }
      if (what === "forced" || what === "postponed") insert(getOr(this.topics, "/forced"), { t, m: { what, path, a, b } }, (item) => item.t);
    }
  }

  /** The journal may come before or after the change of status that it explains. */
  #addReason(/** @type {string} */ path, /** @type {number} */ t, /** @type {string} */ reason, /** @type {string} */ detail) {
    const list = this.byNode.get(path);
    const last = list?.findLast((change) => change.to === "failure" && Math.abs(change.t - t) < EPSILON);
    if (last && last.reason === undefined) Object.assign(last, { reason, detail });
    else this.failed.set(path, { reason, detail });
  }

  /** @param {number} t @param {any} m */
  #addTransition(t, m) {
    const change = /** @type {Transition} */ ({ t, tick: m.tick, from: m.from, to: m.to, node: m.node });
    if (m.to === "failure") {
      Object.assign(change, m.reason === undefined ? this.failed.get(m.node) : { reason: m.reason, detail: m.detail });
      this.failed.delete(m.node);
    }
    insert(getOr(this.byNode, m.node), change, (item) => item.t);
    insert(this.transitions, change, (item) => item.t);
    this.guessed = null;
  }

  /** The `/run` message, or null in recordings without one. */
  get header() {
    return this.latest("/run", Infinity);
  }

  /** @param {string} topic @param {number} t newest message at or before t */
  latest(topic, t) {
    const list = this.topics.get(topic);
    if (!list) return null;
    const n = countUntil(list, t + EPSILON, (item) => item.t);
    return n > 0 ? list[n - 1].m : null;
  }

  /** Messages with a < time <= b. @param {string} topic @param {number} a @param {number} b @returns {any[]} */
  between(topic, a, b) {
    const list = this.topics.get(topic) ?? [];
    const time = (/** @type {Timed} */ item) => item.t;
    return list.slice(countUntil(list, a + EPSILON, time), countUntil(list, b + EPSILON, time)).map((item) => item.m);
  }

  /** @param {string} topic @returns {Timed[]} */
  all(topic) {
    return this.topics.get(topic) ?? [];
  }

  /** The messages around t and how far t is between them. @param {string} topic @param {number} t */
  #around(topic, t) {
    const list = this.topics.get(topic) ?? [];
    const n = countUntil(list, t + EPSILON, (item) => item.t);
    const before = list[n - 1] ?? list[0];
    const after = list[n] ?? before;
    if (!before) return null;
    const span = after.t - before.t;
    // Samples far apart are two events, not one motion.
    const share = span > 0 && span < 0.5 ? Math.max(0, Math.min(1, (t - before.t) / span)) : 0;
    return { before: before.m, after: after.m, share };
  }

  /** Joints of the whole robot, arm and hand as measured where they are. @param {number} t */
  robotAt(t) {
    const header = this.header;
    const arm = this.#around("/robot", t);
    if (!header || !arm) return arm ? { q: new Float64Array(0), sample: arm.before } : null;
    const q = Float64Array.from(header.rest_q);
    const blend = (/** @type {number[]} */ a, /** @type {number[]} */ b, /** @type {number} */ share, /** @type {number[]} */ places) => {
      places.forEach((place, i) => {
        if (i < a.length) q[place] = a[i] + (b[i] - a[i]) * share;
      });
    };
    blend(arm.before.q, arm.after.q, arm.share, header.arm_q ?? []);
    const truth = this.#around("/truth", t);
    if (truth?.before.hand_q) blend(truth.before.hand_q, truth.after.hand_q ?? truth.before.hand_q, truth.share, header.hand_q ?? []);
    else if (header.synergy?.matrix) this.#closeHand(q, header, arm.before.hand_command);
    return { q, sample: arm.before };
  }

  /** The hand where nothing measures its joints: by the synergies of its set point. */
  #closeHand(/** @type {Float64Array} */ q, /** @type {any} */ header, /** @type {any} */ command) {
    const { joints, matrix, lower, upper } = header.synergy;
    if (!command || !lower || !upper) return;
    joints.forEach((/** @type {string} */ joint, /** @type {number} */ i) => {
      const place = header.q_names.indexOf(`${header.arm}_${joint}`);
      if (place < 0 || !matrix[i]) return;
      const closed = Math.max(0, Math.min(1, matrix[i][0] * command.synergy + matrix[i][1] * command.manipulation));
      q[place] = lower[i] + closed * (upper[i] - lower[i]);
    });
  }

  /** Address of the newest image at or before t, or null. @param {string} camera @param {"image" | "depth" | "picture"} kind @param {number} t */
  imageUrl(camera, kind, t) {
    const times = this.images.get(`${kind}/${camera}`);
    if (!times) return null;
    const n = countUntil(times, t + EPSILON, (at) => at);
    return n > 0 ? apiUrl(`api/runs/${this.id}/image`, { camera, kind, t: times[n - 1] }) : null;
  }

  /** The tree as it was at t: nodes in document order. @param {number} t @returns {TreeNode[]} */
  nodesAt(t) {
    const message = this.latest("/tree/definition", t) ?? this.all("/tree/definition")[0]?.m;
    if (!message) return (this.guessed ??= guess([...this.byNode.keys()]));
    let nodes = this.definitions.get(message);
    if (!nodes) {
      nodes = linked(message.nodes);
      this.definitions.set(message, nodes);
    }
    return nodes;
  }

  /** Status of a node at t, and the change that made it so. @param {string} path @param {number} t */
  statusAt(path, t) {
    const list = this.byNode.get(path);
    const n = list ? countUntil(list, t + EPSILON, (item) => item.t) : 0;
    const change = list && n > 0 ? list[n - 1] : null;
    return { status: change?.to ?? "idle", change };
  }

  /** Changes of a node up to t. @param {string} path @param {number} t @returns {Transition[]} */
  changesUntil(path, t) {
    const list = this.byNode.get(path) ?? [];
    return list.slice(0, countUntil(list, t + EPSILON, (item) => item.t));
  }

  /** Number of the tick at t; 0 before the first. @param {number} t */
  tickAt(t) {
    const n = countUntil(this.ticks, t + EPSILON, (item) => item.t);
    return n > 0 ? this.ticks[n - 1].tick : 0;
  }

  /** Time of the next or previous tick. @param {number} t @param {1 | -1} direction */
  stepFrom(t, direction) {
    const time = (/** @type {{t: number}} */ item) => item.t;
    const at = direction > 0 ? countUntil(this.ticks, t + EPSILON, time) : countUntil(this.ticks, t - 2 * EPSILON, time) - 1;
    return this.ticks[at]?.t ?? (direction > 0 ? this.duration : 0);
  }

  /** Time of the next or previous change of a status. @param {number} t @param {1 | -1} direction */
  changeFrom(t, direction) {
    const time = (/** @type {{t: number}} */ item) => item.t;
    const list = this.transitions;
    const at = direction > 0 ? countUntil(list, t + EPSILON, time) : countUntil(list, t - 2 * EPSILON, time) - 1;
    return list[at]?.t ?? (direction > 0 ? this.duration : 0);
  }

  /** When leaves ran, for the timeline. @returns {{path: string, name: string, from: number, to: number, status: string, reason?: string}[]} */
  spans() {
    const spans = [];
    const leaves = this.nodesAt(Infinity).filter((node) => node.children.length === 0);
    for (const { path, name } of leaves) {
      let since = null;
      for (const change of this.byNode.get(path) ?? []) {
        if (change.to === "running") since = change.t;
        else if (change.from === "running" || change.to === "success" || change.to === "failure") {
          spans.push({ path, name, from: since ?? change.t, to: change.t, status: change.to === "idle" ? "halted" : change.to, reason: change.reason });
          since = null;
        }
      }
      if (since !== null) spans.push({ path, name, from: since, to: this.duration, status: "running" });
    }
    return spans.sort((a, b) => a.from - b.from || a.to - b.to);
  }
}

/** @template T @param {Map<string, T[]>} map @param {string} key @returns {T[]} */
function getOr(map, key) {
  let list = map.get(key);
  if (!list) map.set(key, (list = []));
  return list;
}

/** Keeps a list sorted; nearly always the item comes last. @template T @param {T[]} list @param {T} item @param {(item: T) => number} time */
function insert(list, item, time) {
  if (list.length === 0 || time(list[list.length - 1]) <= time(item)) list.push(item);
  else list.splice(countUntil(list, time(item), time), 0, item);
}

/** @param {any[]} nodes @returns {TreeNode[]} */
function linked(nodes) {
  /** @type {TreeNode[]} */
  const all = nodes.map((node) => ({ ...node, depth: 0, children: [] }));
  all.forEach((node, i) => {
    if (node.parent === null || node.parent === undefined) return;
    node.depth = all[node.parent].depth + 1;
    all[node.parent].children.push(i);
  });
  return all;
}

/** The tree of a recording that does not tell it: from the paths of the nodes that did something. @param {string[]} paths */
function guess(paths) {
  /** @type {Map<string, {name: string, below: Map<string, any>}>} */
  const root = new Map();
  for (const path of paths) {
    let level = root;
    for (const step of path.split("/")) {
      let node = level.get(step);
      if (!node) level.set(step, (node = { name: step, below: new Map() }));
      level = node.below;
    }
  }
  /** @type {any[]} */
  const nodes = [];
  const walk = (/** @type {Map<string, any>} */ level, /** @type {string} */ above, /** @type {number | null} */ parent) => {
    for (const [step, node] of level) {
      const path = above === "" ? step : `${above}/${step}`;
      const place = nodes.push({ path, parent, kind: step.replace(/#\d+$/, ""), name: step, doc: "", ports: [] }) - 1;
      walk(node.below, path, place);
    }
  };
  walk(root, "", null);
  return linked(nodes);
}
