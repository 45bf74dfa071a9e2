// @ts-check
/** Colours of the views. Components 0 to 1, sRGB. */

/** From low to high score: blues that get lighter, in order without colour vision too, and apart from all other marks. */
const SCORE = [
  [0.22, 0.2, 0.46], [0.2, 0.33, 0.7], [0.18, 0.52, 0.88], [0.4, 0.76, 0.96], [0.78, 0.95, 1.0],
];

export const REJECTED = [0.66, 0.38, 0.36];
export const CHOSEN = [0.1, 0.82, 0.36];
export const KEY_POINT = [0.95, 0.16, 0.5];
export const PATH = [0.1, 0.62, 0.9];
export const TRAIL = [0.98, 0.62, 0.14];
export const TOUCH = [1.0, 0.55, 0.1];
export const TABLE = [0.66, 0.55, 0.43];
export const GRAIN = [0.2, 0.5, 0.95];

/** @param {number} value @param {number} low @param {number} high @returns {number[]} */
export function scoreColour(value, low, high) {
  const share = Math.max(0, Math.min(1, (value - low) / Math.max(high - low, 1e-9)));
  const at = share * (SCORE.length - 1);
  const k = Math.min(Math.floor(at), SCORE.length - 2);
  return SCORE[k].map((x, i) => x + (SCORE[k + 1][i] - x) * (at - k));
}

/** The scale as a CSS gradient, from left to right. */
export function scoreGradient() {
  return `linear-gradient(to right, ${SCORE.map(css).join(", ")})`;
}

/** @param {number[]} colour */
export function css(colour) {
  return `rgb(${colour.map((x) => Math.round(255 * x)).join(" ")})`;
}

/** A recorded colour, 0 to 255. @param {number[] | null | undefined} colour @param {number[]} otherwise */
export function colourOf(colour, otherwise) {
  return colour && colour.length >= 3 ? colour.slice(0, 3).map((x) => x / 255) : otherwise;
}

const LIGHT = {
  background: [0.955, 0.962, 0.972], line: [0.55, 0.6, 0.68], sky: [0.5, 0.54, 0.61], ground: [0.3, 0.28, 0.27], shade: 0.26,
};
const DARK = {
  background: [0.075, 0.086, 0.106], line: [0.42, 0.48, 0.58], sky: [0.3, 0.34, 0.43], ground: [0.12, 0.11, 0.11], shade: 0.6,
};

/**
 * Whether an element lies on a dark page, however the page came by its colours.
 * @param {HTMLElement} element
 */
export function isDark(element) {
  for (let at = /** @type {HTMLElement | null} */ (element); at; at = at.parentElement) {
    const parts = getComputedStyle(at).backgroundColor.match(/[\d.]+/g)?.map(Number) ?? [];
    if (parts.length >= 3 && (parts[3] ?? 1) > 0.5) {
      const scale = getComputedStyle(at).backgroundColor.startsWith("color(") ? 1 : 255;
      return (0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]) / scale < 0.45;
    }
  }
  return matchMedia("(prefers-color-scheme: dark)").matches;
}

/** @param {HTMLElement} element */
export function lightOf(element) {
  return isDark(element) ? DARK : LIGHT;
}

/**
 * Calls `onChange` whenever the page's colours may have changed.
 * @param {() => void} onChange
 * @returns {() => void} stops it
 */
export function watchColours(onChange) {
  const media = matchMedia("(prefers-color-scheme: dark)");
  media.addEventListener("change", onChange);
  const observer = new MutationObserver(onChange);
  for (const element of [document.documentElement, document.body]) observer.observe(element, { attributes: true });
  return () => {
    media.removeEventListener("change", onChange);
    observer.disconnect();
  };
}
