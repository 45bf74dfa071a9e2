// @ts-check
/**
 * An element with attributes and content; text is never read as markup.
 * @param {string} tag
 * @param {Record<string, string>} [attributes]
 * @param {string | Node | (string | Node)[]} [content]
 * @returns {HTMLElement}
 */
export function element(tag, attributes = {}, content = []) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...(Array.isArray(content) ? content : [content]));
  return made;
}

/** Names already in use on the page get a number, so that two views can stand side by side. @param {string} id */
export function freeId(id) {
  let free = id;
  for (let n = 2; document.getElementById(free); n += 1) free = `${id}-${n}`;
  return free;
}

/** Loads the style sheet of the views once. */
export function loadStyle() {
  const href = new URL("views.css", import.meta.url).href;
  if ([...document.styleSheets].some((sheet) => sheet.href === href) || document.querySelector("link[data-views]")) return;
  document.head.append(element("link", { rel: "stylesheet", href, "data-views": "" }));
}
