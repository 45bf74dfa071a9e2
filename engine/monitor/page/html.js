// @ts-check
// Small helpers for elements and text.

/**
 * An element with attributes and content. Text stays text: nothing of a run is ever read as markup.
 * @param {string} tag
 * @param {Record<string, string | number | boolean | null | undefined>} [attributes] false, null and undefined leave one out
 * @param {...(Node | string | null | undefined)} content
 * @returns {HTMLElement}
 */
export function h(tag, attributes = {}, ...content) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...content.filter((item) => item !== null && item !== undefined));
  return element;
}

/** The element with an id; a missing one is a mistake of the page. @param {string} id @returns {any} */
export function byId(id) {
  const element = document.getElementById(id);
  if (!element) throw new Error(`the page has no #${id}`);
  return element;
}

/** Sets text only where it changes, so that nothing is laid out anew. @param {Element} element @param {string} text */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Seconds for people: `12.34 s`. @param {number} seconds @param {number} [digits] */
export function secs(seconds, digits = 2) {
  return `${seconds.toFixed(digits)}\u202fs`;
}

/** A word of a file for people: `close_hand` becomes `close hand`. @param {string} word */
export function words(word) {
  return word.replaceAll("_", " ");
}

/** A value of JSON on one line. @param {any} value @param {number} [limit] */
export function short(value, limit = 160) {
  const text = typeof value === "string" ? value : JSON.stringify(value, (_key, v) => (typeof v === "number" && !Number.isInteger(v) ? Number(v.toPrecision(5)) : v));
  if (text === undefined) return "";
  return text.length > limit ? `${text.slice(0, limit - 1)}…` : text;
}

/** Glyph and word of each status: colour never stands alone. */
export const STATUS = /** @type {Record<string, {glyph: string, text: string}>} */ ({
  idle: { glyph: "·", text: "idle" },
  running: { glyph: "▶", text: "running" },
  success: { glyph: "✓", text: "success" },
  failure: { glyph: "✗", text: "failure" },
  skipped: { glyph: "↷", text: "skipped" },
});

/**
 * How many items of a sorted list come at or before `t`.
 * @template T @param {T[]} list @param {number} t @param {(item: T) => number} time
 */
export function countUntil(list, t, time) {
  let low = 0;
  let high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (time(list[middle]) <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}
