// Screen Plan: the tests of one plan as a table: add, take out, change limits; check it, store it as a new version, run it.
// @ts-check
import { get, post } from "./ask.js"
import { confirm, inWords } from "./dialogs.js"
import { el } from "./dom.js"
import { makeMap } from "./map.js"
import { number, t, tOr } from "./words.js"

const METHODS = ["continuity", "resistance", "fres", "voltage", "diode", "capacitance", "contact", "insert"]
const UNLIMITED = ["contact", "insert"]
/** Line of the first test in what the station reads. */
const FIRST_LINE = 3
const SHOWN = 200
const PREFIXES = /** @type {[number, string][]} */ ([[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "u"], [1e-9, "n"], [1e-12, "p"]])

/** A limit as a plan writes it; none is an empty text. @param {number | null | undefined} value @param {string | undefined} unit */
export function limitText(value, unit) {
  if (value == null || !unit) return ""
  const [factor, prefix] = PREFIXES.find(([one]) => Math.abs(value) >= one) ?? [1, ""]
  return `${Number((value / factor).toPrecision(15))} ${prefix}${unit}`
}

/** @param {any} box @param {any} app @param {string} [wanted] name of a plan; none: a new one */
export function open(box, app, wanted) {
  let now = app, board = /** @type {any} */ (null), tests = /** @type {any[]} */ ([]), shown = SHOWN, changed = false, busy = false
  let stored = "", wrong = new Map(), map = /** @type {any} */ (null)
  const name = el("input", { name: "plan_name", maxlength: 64, required: "", pattern: "[A-Za-z0-9][A-Za-z0-9_.+\\-]{0,63}", autocomplete: "off", value: wanted ?? "", on: { input: () => touch() } })
  const known = el("datalist", { id: "points-and-nets" })
  const add = el("input", { name: "add", maxlength: 120, list: "points-and-nets", autocomplete: "off" })
  const said = el("p", { class: "said", role: "alert", id: "plan-said" }), state = el("p", { class: "what", id: "plan-state", role: "status" })
  const rows = el("tbody"), mapBox = el("div"), more = el("button", { type: "button", on: { click: () => ((shown += SHOWN), list()) } }, t("more_rows"))
  const check = order("check_plan", () => send("check_plan")), store = order("store_plan", () => confirm(t("plan.ask", { name: name.value }), "order.store_plan", () => send("store_plan")))
  const start = el("button", { type: "button", id: "plan-start", on: { click: () => ((now.planToRun = stored), (location.hash = "run")) } }, t("plan.start"))
  box.replaceChildren(el("div", { class: "two table-first" },
    el("section", { class: "panel", id: "plan" }, el("div", { class: "filter" }, el("label", {}, t("plan"), name)), state, said,
      el("form", { class: "filter", on: { submit: (/** @type {Event} */ event) => (event.preventDefault(), insert()) } }, el("label", {}, t("plan.add_what"), add, known), el("button", { id: "plan-add" }, t("plan.add"))),
      el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": t("plan.tests") }, el("table", {}, el("thead", {}, el("tr", {}, ...["field.test_point", "plan.method", "plan.low", "plan.high"].map((key) => el("th", { scope: "col" }, t(key))), el("th", {}, el("span", { class: "hidden" }, t("plan.out"))))), rows), more),
      el("div", { class: "orders" }, check, store, start)), el("section", { class: "panel" }, mapBox, el("p", { class: "quiet" }, t("plan.how")))))

  /** @param {string} what @param {() => void} does */
  function order(what, does) {
    return el("button", { type: "button", id: what.replace("_", "-"), class: "order", on: { click: () => name.reportValidity() && does() } }, t(`order.${what}`))
  }
  function touch() {
    changed = true
    said.textContent = ""
    update(now)
  }
  /** @param {any} test one of the station's */
  const row = (test) => ({ ...test, limits: undefined, low: limitText(test.limits?.low, test.limits?.unit), high: limitText(test.limits?.high, test.limits?.unit) })

  async function load() {
    try {
      const [found, plan] = await Promise.all([get("/board"), wanted ? get("/plan", { name: wanted }) : null])
      board = found
      tests = plan ? plan.plan.plan.tests.map(row) : []
      stored = plan ? wanted ?? "" : ""
      state.textContent = plan ? t("plan.version", { n: plan.plan.version, by: plan.plan.stored_by }) : t("plan.new")
      const points = board.test_points ?? []
      known.replaceChildren(...[...new Set(points.flatMap((/** @type {any} */ one) => [one.name, one.net]).filter(Boolean))].map((value) => el("option", { value })))
      if (points.length) {
        map = makeMap(board, (one) => (map.choose(one), (add.value = one)))
        mapBox.replaceChildren(map.root)
      }
    } catch (error) {
      said.textContent = inWords(/** @type {any} */ (error).error)
    }
    list()
  }
  /** Add a point, or the point of a net that is most accessible. */
  function insert() {
    const wanted = add.value.trim(), points = board?.test_points ?? []
    const point = points.find((/** @type {any} */ one) => one.name === wanted) ?? points.find((/** @type {any} */ one) => one.net === wanted)
    if (!point) return (said.textContent = t("board.not_found", { what: wanted }))
    const last = tests.at(-1)
    tests.push({ point: point.name, net: point.net, method: last?.method ?? "continuity", low: last?.low ?? "", high: last?.high ?? (last ? "" : "5 ohm") })
    shown = Math.max(shown, tests.length)
    add.value = ""
    touch()
    list()
    rows.lastElementChild?.scrollIntoView({ block: "nearest" })
  }
  function list() {
    rows.replaceChildren(...tests.slice(0, shown).flatMap((test, n) => {
      const input = (/** @type {"low" | "high"} */ end) => {
        const field = el("input", { name: end, maxlength: 40, value: test[end], disabled: UNLIMITED.includes(test.method) && test.method === "insert", "aria-label": `${test.point}: ${t(`plan.${end}`)}`,
          on: { input: () => ((test[end] = field.value), touch()) } })
        return field
      }
      const method = el("select", { "aria-label": `${test.point}: ${t("plan.method")}`, on: { change: () => ((test.method = method.value), touch(), list()) } }, ...METHODS.map((one) => el("option", { value: one }, tOr(`method.${one}`, one))))
      method.value = test.method
      return [wrong.has(n) ? el("tr", { class: "wrong" }, el("td", { class: "said", colspan: 5 }, `\u25BC ${wrong.get(n)}`)) : null, el("tr", { "data-test": test.point }, el("td", {}, el("b", {}, test.point), el("div", { class: "quiet" }, test.net ?? "")),
        el("td", {}, method), el("td", {}, input("low")), el("td", {}, input("high")),
        el("td", {}, el("button", { type: "button", "aria-label": `${t("plan.out")}: ${test.point}`, on: { click: () => (tests.splice(n, 1), wrong.clear(), touch(), list()) } }, "\u2715")))].filter((one) => one !== null)
    }))
    more.hidden = tests.length <= shown
    map?.colour((/** @type {string} */ one) => (tests.some((test) => test.point === one) ? "planned" : "untested"))
    update(now)
  }
  /** @param {string} what */
  async function send(what) {
    busy = true
    update(now)
    wrong.clear()
    const wire = (/** @type {string} */ text) => text.trim().replace(",", ".") || null
    const table = tests.map(({ point, method, low, high, theta_deg, look, touches, second_site, note }) => ({ point, method, low: method === "insert" ? null : wire(low), high: method === "insert" ? null : wire(high), theta_deg, look, touches, second_site, note }))
    try {
      await post("/plan", { order: what, name: name.value, board: board?.name, tests: table })
      if (what === "store_plan") {
        changed = false
        stored = name.value
        const kept = await get("/plan", { name: stored })
        tests = kept.plan.plan.tests.map(row)
        state.textContent = t("plan.stored", { n: kept.plan.version })
      } else state.textContent = t("plan.good", { n: number(tests.length, 0) })
      said.textContent = ""
    } catch (error) {
      const facts = /** @type {any} */ (error).error ?? { name: "no_page" }
      const mistakes = /** @type {any[]} */ (facts.detail?.mistakes ?? [])
      for (const { line, what } of mistakes) if (line !== null && line >= FIRST_LINE) wrong.set(line - FIRST_LINE, what)
      const others = mistakes.filter(({ line }) => line === null || line < FIRST_LINE).map(({ what }) => what)
      said.textContent = [inWords(facts), ...others].join(" ")
      shown = Math.max(shown, ...[...wrong.keys()].map((n) => n + 1))
    }
    busy = false
    list()
    if (said.textContent) (rows.querySelector(".wrong") ?? said).scrollIntoView({ block: "nearest" })
  }
  /** @param {any} app */
  function update(app) {
    now = app
    const ready = app.live && !busy && tests.length > 0
    check.disabled = !ready
    store.hidden = !app.may("maintain")
    store.disabled = !ready || !(changed || name.value !== stored)
    start.disabled = !stored || changed || name.value !== stored
  }
  load()
  return update
}
