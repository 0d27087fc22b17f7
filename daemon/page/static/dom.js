// Elements from data. Text goes in as text only: nothing here can turn a name or a note into markup.
// @ts-check

/**
 * @param {string} tag
 * @param {Record<string, any>} [props] `class`, `on` (event -> listener), properties (`disabled`, `value`...), else attributes
 * @param {...(Node | string | number | null | undefined | false)} children
 * @returns {any}
 */
export function el(tag, props = {}, ...children) {
  return fill(document.createElement(tag), props, children)
}

/** @param {string} tag @param {Record<string, any>} [props] @param {...(Node | string | null | false)} children @returns {any} */
export function svg(tag, props = {}, ...children) {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", tag), props, children)
}

/** @param {any} node @param {Record<string, any>} props @param {any[]} children */
function fill(node, props, children) {
  for (const [name, value] of Object.entries(props)) {
    if (value === null || value === undefined) continue
    if (name === "on") for (const [event, listener] of Object.entries(value)) node.addEventListener(event, listener)
    else if (name === "class") node.setAttribute("class", value)
    else if (name === "disabled" || name === "value" || name === "hidden") node[name] = value
    else node.setAttribute(name, String(value))
  }
  for (const child of children) if (child !== null && child !== undefined && child !== false) node.append(child)
  return node
}

/** Put children in the place of what a box holds, but only if what they are made of has changed: focus stays.
 * @param {any} box @param {any} facts @param {() => (Node | string | null | false)[]} make */
export function show(box, facts, make) {
  const mark = JSON.stringify(facts)
  if (box.mark === mark) return
  box.mark = mark
  box.replaceChildren(...make().filter((child) => child !== null && child !== false))
}

/** @param {string} id @returns {any} */
export const byId = (id) => document.getElementById(id)
