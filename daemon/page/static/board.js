// Screen Board: the points of the board under test as a map, each with its last verdict, and what people forbade.
// @ts-check
import { get } from "./ask.js"
import { inWords } from "./dialogs.js"
import { el } from "./dom.js"
import { legend, makeMap } from "./map.js"
import { KIND_OF_VERDICT, kindOf, numbers, word } from "./verdict.js"
import { clock, number, t } from "./words.js"

/** @param {any} box @param {any} app */
export function open(box, app) {
  const place = el("div")
  const about = el("section", { class: "panel", "aria-live": "polite" }, el("p", { class: "quiet" }, t("board.choose")))
  const find = el("input", { name: "find", maxlength: 64 })
  let board = /** @type {any} */ (null), map = /** @type {any} */ (null), tested = /** @type {any[]} */ ([]), now = app
  /** @type {Map<string, any>} */
  let marks = new Map()
  const lastOf = (/** @type {string} */ name) => (now.station.results ?? []).find((/** @type {any} */ one) => one.test_point === name)

  /** @param {string} name */
  function kind(name) {
    if (marks.get(name)?.mark === "forbidden") return "forbidden"
    const record = tested.findLast((one) => one.point === name), last = lastOf(name)
    if (record && !(last && last.finished_at > record.at)) return KIND_OF_VERDICT[record.verdict]
    return last ? kindOf(last) : "untested"
  }
  /** @param {string} name */
  function choose(name) {
    map.choose(name)
    const point = board.test_points.find((/** @type {any} */ one) => one.name === name)
    if (!point) return
    const last = lastOf(name), mark = marks.get(name)
    about.replaceChildren(el("h2", {}, point.name), el("dl", {},
      ...pair("net", point.net), ...pair("part", [point.part, point.pin].filter(Boolean).join(" ")),
      ...pair("place", `${number(point.x_um / 1000, 2)} / ${number(point.y_um / 1000, 2)} mm`),
      ...pair("field.outcome", last ? `${word(last)} ${numbers(last)} ${clock(last.finished_at)}` : t(`verdict.${kind(name)}`)),
      ...pair(`mark.${mark?.mark}`, mark ? `${mark.by}: ${mark.reason}` : null)),
      el("div", { class: "orders" }, el("a", { class: "button", href: `#point/${encodeURIComponent(name)}` }, t("screen.point"))))
  }
  function search() {
    const wanted = find.value.trim().toLowerCase()
    const point = wanted && board?.test_points?.find((/** @type {any} */ one) => one.name.toLowerCase() === wanted || one.net?.toLowerCase() === wanted)
    if (point) map.focus(point.name)
    else about.replaceChildren(el("p", {}, t("board.not_found", { what: find.value.trim() })))
  }
  const button = (/** @type {string} */ text, /** @type {string} */ label, /** @type {() => void} */ does) =>
    el("button", { type: "button", "aria-label": label === text ? null : label, on: { click: () => map && does() } }, text)
  box.replaceChildren(
    el("form", { class: "filter", on: { submit: (/** @type {Event} */ event) => (event.preventDefault(), search()) } }, el("label", {}, t("board.find"), find),
      el("button", {}, t("find")), button(t("board.flip"), t("board.flip"), () => map.flip()),
      button("+", t("board.nearer"), () => map.zoom(2)), button("\u2212", t("board.farther"), () => map.zoom(0.5))),
    el("div", { class: "two" }, place, el("div", { class: "stack" }, about,
      el("section", { class: "panel" }, el("ul", { class: "legend" }, ...legend(["pass", "recovered", "open", "no_contact", "bad", "forbidden", "untested"]).map((one) => el("li", {}, ...one)))))))
  const colour = () => map?.colour(kind)
  get("/board").then((found) => {
    board = found
    if (board.test_points?.length) {
      map = makeMap(board, choose)
      place.replaceChildren(map.root)
      colour()
    } else about.replaceChildren(el("p", { class: "quiet" }, t("board.none")))
    const cannot = Object.entries(board.not_probeable ?? {})
    if (cannot.length) box.append(el("details", { class: "panel" }, el("summary", {}, t("board.cannot", { n: cannot.length })),
      el("ul", {}, ...cannot.map(([name, why]) => el("li", {}, `${name}: ${why}`)))))
  }, (error) => about.replaceChildren(inWords(error.error)))
  get("/marks").then((found) => ((marks = new Map(found.marks.map((/** @type {any} */ one) => [one.point, one]))), colour()), () => undefined)
  get("/run").then((found) => found.run.board.revision === now.station.board_revision && ((tested = found.points), colour()), () => undefined)
  return (/** @type {any} */ app) => ((now = app), colour())
}

/** @param {string} key @param {string | null} value */
const pair = (key, value) => (value ? [el("dt", {}, t(key)), el("dd", {}, value)] : [])
