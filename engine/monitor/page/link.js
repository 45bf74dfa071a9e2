// @ts-check
// The moment, the run and the node in the address: `#t=12.34&run=0&node=sequence/lift`.

/** @returns {{t: number | null, run: number, node: string | null}} */
export function readLink() {
  const values = new URLSearchParams(location.hash.slice(1));
  const t = Number.parseFloat(values.get("t") ?? "");
  const run = Number.parseInt(values.get("run") ?? "0", 10);
  return { t: Number.isFinite(t) ? t : null, run: Number.isInteger(run) ? run : 0, node: values.get("node") };
}

/** @param {number} t @param {number} run @param {string | null} node */
export function linkTo(t, run, node) {
  const path = node === null ? "" : `&node=${encodeURIComponent(node).replaceAll("%2F", "/")}`;
  return `#t=${t.toFixed(3).replace(/\.?0+$/, "")}&run=${run}${path}`;
}

let timer = 0;

/** Keeps the address up to date, without a new entry in the history and not at every frame. @param {() => string} link */
export function keepLink(link) {
  if (timer !== 0) return;
  timer = setTimeout(() => {
    timer = 0;
    const text = link();
    if (text !== location.hash) history.replaceState(null, "", text);
  }, 200);
}
