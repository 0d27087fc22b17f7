// Map of a board: its points as shapes that say how each is, never by colour alone; flip, zoom, labels where there is room.
// @ts-check
import { svg } from "./dom.js"
import { t } from "./words.js"

const LABELS_UP_TO = 400

/** Outline of a point of one kind about (x, y). @param {string} kind @param {number} x @param {number} y @param {number} r */
function outline(kind, x, y, r) {
  const at = (/** @type {number[][]} */ ...to) => to.map(([dx, dy], n) => `${n ? "L" : "M"}${x + dx * r} ${y + dy * r}`).join("")
  if (kind === "recovered") return `${at([0, -1.4], [1.4, 0], [0, 1.4], [-1.4, 0])}Z`
  if (kind === "bad") return `${at([-1.1, -1.1], [1.1, -1.1], [1.1, 1.1], [-1.1, 1.1])}Z`
  if (kind === "no_contact") return `${at([0, -1.4], [1.4, 1.1], [-1.4, 1.1])}Z`
  if (kind === "open") return `${at([-1.2, -1.2], [1.2, 1.2])}${at([1.2, -1.2], [-1.2, 1.2])}`
  if (kind === "forbidden") return `${at([-1.3, -0.35], [1.3, -0.35], [1.3, 0.35], [-1.3, 0.35])}Z`
  const radius = kind === "pass" || kind === "planned" ? r : r * 0.8
  return `M${x - radius} ${y}a${radius} ${radius} 0 1 0 ${2 * radius} 0a${radius} ${radius} 0 1 0 ${-2 * radius} 0Z`
}

/** Width and height, mm; of a board without an outline those of what is on it. @param {any} board */
function sizeOfBoard(board) {
  const reach = (/** @type {"x_um" | "y_um"} */ axis) => board.test_points.reduce((/** @type {number} */ most, /** @type {any} */ one) => Math.max(most, one[axis]), 0) / 1000
  const known = (/** @type {number | null | undefined} */ um) => (um != null && um > 0 ? um / 1000 : 0)
  return [known(board.width_um) || reach("x_um") + 2, known(board.height_um) || reach("y_um") + 2]
}

/** @param {any} board @param {(name: string) => void} onChoose */
export function makeMap(board, onChoose) {
  const [width, height] = sizeOfBoard(board), edge = Math.max(width, height) / 25
  const root = svg("svg", { class: "map", role: "group", "aria-label": t("board.map", { name: board.name }) })
  /** @type {Map<string, { node: any, label: any, point: any, kind: string }>} */
  const points = new Map()
  let flipped = false, factor = 1
  let chosen = ""

  function view() {
    const w = (width + 2 * edge) / factor, h = (height + 2 * edge) / factor
    const point = points.get(chosen)?.point
    const clamp = (/** @type {number} */ middle, /** @type {number} */ size, /** @type {number} */ whole) =>
      Math.min(Math.max(middle - size / 2, -edge), whole + edge - size)
    const x = clamp(point ? placeOf(point)[0] : width / 2, w, width), y = clamp(point ? placeOf(point)[1] : height / 2, h, height)
    root.setAttribute("viewBox", `${x} ${y} ${w} ${h}`)
  }
  /** @param {any} point */
  const placeOf = (point) => [flipped ? width - point.x_um / 1000 : point.x_um / 1000, height - point.y_um / 1000]

  /** Radius it is drawn with: its own, where that can be seen. @param {any} point */
  const sizeOf = (point) => Math.max(Math.min((point.diameter_um ?? 600) / 2000, Math.max(width, height) / 60), Math.max(width, height) / 100)

  function draw() {
    const size = Math.max(width, height)
    root.replaceChildren(svg("rect", { class: "outline", x: 0, y: 0, width, height }))
    for (const point of board.test_points) {
      const [x, y] = placeOf(point)
      const known = points.get(point.name)
      const r = sizeOf(point)
      const node = svg("path", { class: `point ${known?.kind ?? "untested"}`, d: outline(known?.kind ?? "untested", x, y, r), "stroke-width": size / 300,
        tabindex: 0, role: "button", on: { click: () => onChoose(point.name), focus: () => onChoose(point.name),
          keydown: (/** @type {any} */ event) => event.key === "Enter" && onChoose(point.name) } })
      const label = svg("text", { class: "label", x: x + r * 1.8, y: y + size / 120, "font-size": size / 42, "aria-hidden": "true" }, point.name)
      points.set(point.name, { node, label, point, kind: known?.kind ?? "untested" })
      root.append(node, label)
      name(point.name)
    }
    labels(size)
    choose(chosen)
    view()
  }
  /** Show a label only where it covers no point and no other label. @param {number} size */
  function labels(size) {
    /** @type {number[][]} */
    const taken = [...points.values()].map(({ point }) => [...placeOf(point), 0, 0]).map(([x, y]) => [x - size / 80, y - size / 80, x + size / 80, y + size / 80])
    const letter = size / 75, high = size / 50
    for (const { label, point } of points.values()) {
      const [x, y] = [Number(label.getAttribute("x")), Number(label.getAttribute("y"))]
      const box = [x, y - high, x + point.name.length * letter, y]
      const free = points.size <= LABELS_UP_TO && box[2] < width + edge && taken.every((one) => one[0] > box[2] || one[2] < box[0] || one[1] > box[3] || one[3] < box[1])
      label.classList.toggle("spare", !free)
      if (free) taken.push(box)
    }
  }
  /** @param {string} of */
  function name(of) {
    const known = points.get(of)
    known?.node.setAttribute("aria-label", [of, known.point.net, t(`verdict.${known.kind}`)].filter(Boolean).join(", "))
  }
  /** @param {string} wanted */
  function choose(wanted) {
    chosen = wanted
    for (const [other, { node, label }] of points) (node.classList.toggle("chosen", other === wanted), label.classList.toggle("chosen", other === wanted))
    if (factor > 1) view()
  }
  draw()
  return {
    root, choose,
    /** @param {string} name */
    focus: (name) => points.get(name)?.node.focus(),
    /** @param {(name: string) => string} kindOf */
    colour(kindOf) {
      for (const [of, known] of points) {
        const kind = kindOf(of)
        if (kind === known.kind) continue
        const [x, y] = placeOf(known.point)
        known.node.classList.replace(known.kind, kind)
        known.node.setAttribute("d", outline(kind, x, y, sizeOf(known.point)))
        known.kind = kind
        name(of)
      }
    },
    flip: () => ((flipped = !flipped), draw()),
    /** @param {number} times */
    zoom: (times) => ((factor = Math.min(Math.max(factor * times, 1), 32)), view()),
  }
}

/** What each shape means, for who sees the map for the first time. @param {string[]} kinds */
export const legend = (kinds) =>
  kinds.map((kind) => [svg("svg", { class: "map key", viewBox: "-2 -2 4 4", "aria-hidden": "true" }, svg("path", { class: `point ${kind}`, d: outline(kind, 0, 0, 1), "stroke-width": 0.4 })), t(`verdict.${kind}`)])
