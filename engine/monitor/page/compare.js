// @ts-check
/** @typedef {import("./run.js").Run} Run */
/** @typedef {"time" | "tick" | "stage"} Align */

/** Places two runs side by side: which moment of the second belongs to a moment of the first. */
export class Alignment {
  /** @param {Run} first @param {Run} second */
  constructor(first, second) {
    this.first = first;
    this.second = second;
    /** @type {Align} */
    this.by = "time";
    this.key = "";
    /** @type {[number, number][]} */
    this.pairs = [];
  }

  /** The moment of the second run for t of the first. @param {number} t */
  toSecond(t) {
    return this.#through(t, 0, 1);
  }

  /** The moment of the first run for t of the second. @param {number} t */
  toFirst(t) {
    return this.#through(t, 1, 0);
  }

  #through(/** @type {number} */ t, /** @type {0 | 1} */ from, /** @type {0 | 1} */ to) {
    const pairs = this.#fixed();
    if (pairs.length === 0) return t;
    let i = 0;
    while (i + 1 < pairs.length && pairs[i + 1][from] <= t) i += 1;
    const [a, b] = [pairs[i], pairs[i + 1]];
    if (!b || t <= a[from]) return Math.max(0, a[to] + (t - a[from]));
    const span = b[from] - a[from];
    return a[to] + (span > 0 ? (t - a[from]) / span : 0) * (b[to] - a[to]);
  }

  /** Moments that belong together. */
  #fixed() {
    const key = `${this.by} ${this.first.version} ${this.second.version}`;
    if (key === this.key) return this.pairs;
    this.key = key;
    this.pairs = [];
    if (this.by === "tick") {
      const times = new Map(this.second.ticks.map(({ t, tick }) => [tick, t]));
      for (const { t, tick } of this.first.ticks) {
        const other = times.get(tick);
        if (other !== undefined) this.pairs.push([t, other]);
      }
    } else if (this.by === "stage") {
      this.pairs = stagePairs(this.first, this.second);
    }
    return this.pairs;
  }
}

/** The n-th start of a leaf in one run belongs to the n-th in the other, in the order of both. @param {Run} first @param {Run} second */
function stagePairs(first, second) {
  /** @type {Map<string, number[]>} */
  const starts = new Map();
  for (const { path, from } of second.spans()) {
    const list = starts.get(path);
    if (list) list.push(from);
    else starts.set(path, [from]);
  }
  /** @type {[number, number][]} */
  const pairs = [[0, 0]];
  for (const { path, from } of first.spans()) {
    const other = starts.get(path)?.shift();
    const last = pairs[pairs.length - 1];
    if (other !== undefined && from > last[0] && other > last[1]) pairs.push([from, other]);
  }
  pairs.push([Math.max(first.duration, pairs[pairs.length - 1][0]), Math.max(second.duration, pairs[pairs.length - 1][1])]);
  return pairs;
}

/**
 * The first change of a status that is another one in the other run or comes in another tick.
 * @param {Run} first @param {Run} second
 * @returns {{t: number, text: string} | null} null when every change is the same
 */
export function firstDifference(first, second) {
  const [a, b] = [first.transitions, second.transitions].map((list) => /** @type {any[]} */ (list));
  const text = (/** @type {any} */ change) => (change ? `${change.node.split("/").at(-1)} ${change.to}${change.reason ? ` (${change.reason})` : ""}` : "nothing more");
  for (let i = 0; i < Math.max(a.length, b.length); i += 1) {
    const [x, y] = [a[i], b[i]];
    if (x && y && x.node === y.node && x.to === y.to && x.reason === y.reason && x.tick === y.tick) continue;
    const [t, tSecond] = [x?.t ?? first.duration, y?.t ?? second.duration];
    const when = (/** @type {any} */ change, /** @type {number} */ at) => `${text(change)} at ${at.toFixed(2)} s`;
    // Up to the earlier of the two both are the same.
    return { t: Math.min(t, tSecond), text: `A: ${when(x, t)} · B: ${when(y, tSecond)}` };
  }
  return null;
}
