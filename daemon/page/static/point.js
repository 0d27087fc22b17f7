// Screen Point: one point over all boards: each test with its pictures; forbid or approve it; look or probe once more.
// @ts-check
import { get, jobKey, post } from "./ask.js"
import { confirm, inWords, noteTo, picturesOf, tell } from "./dialogs.js"
import { el, show } from "./dom.js"
import { KIND_OF_VERDICT, kindOf, mark as markOfResult, markOf, numbers, reading, why, word } from "./verdict.js"
import { day, number, t, tOr } from "./words.js"

/** @param {any} box @param {any} app @param {string} [name] */
export function open(box, app, name) {
  if (!name) return choose(box)
  const parts = { head: el("section", { class: "panel" }), tests: el("section", { class: "panel" }), marks: el("section", { class: "panel" }), results: el("section", { class: "panel" }) }
  box.replaceChildren(el("div", { class: "two" }, el("div", { class: "stack" }, parts.head, parts.tests), el("div", { class: "stack" }, parts.marks, parts.results)))
  const seen = { tests: /** @type {any[]} */ ([]), more: false, mark: /** @type {any} */ (null), results: /** @type {any[]} */ ([]), point: /** @type {any} */ (null), said: "", loads: 0, done: 0 }
  let now = app
  async function load() {
    try {
      const [told, past, board] = await Promise.all([get("/point", { name }), get("/history", { test_point: name }), get("/board")])
      Object.assign(seen, { tests: told.tests, more: told.more, mark: told.marks.find((/** @type {any} */ one) => one.point === name) ?? null,
        results: past.results, point: board.test_points?.find((/** @type {any} */ one) => one.name === name) ?? null, said: "" })
    } catch (error) {
      seen.said = inWords(/** @type {any} */ (error).error)
    }
    seen.loads += 1
    update(now)
  }
  /** @param {any} app */
  function update(app) {
    now = app
    const { station } = app
    const fresh = JSON.stringify([station.point?.point === name && station.point?.at, station.results?.find((/** @type {any} */ one) => one.test_point === name)?.id])
    if (seen.done !== /** @type {any} */ (fresh)) ((seen.done = /** @type {any} */ (fresh)), load())
    const idle = app.live && !station.job && !station.fault
    show(parts.head, [seen.loads, app.language], () => head(/** @type {string} */ (name), seen))
    show(parts.tests, [seen.loads, app.language], () => tests(seen))
    show(parts.marks, [seen.loads, idle, app.me.role, app.language], () => marks(/** @type {string} */ (name), seen, app, idle, load))
    show(parts.results, [seen.loads, app.language], () => [el("h2", {}, t("last_results")), results(seen.results)])
  }
  return update
}

/** @param {any} box */
function choose(box) {
  const names = el("div", { class: "orders" })
  box.replaceChildren(el("section", { class: "panel" }, el("h2", {}, t("board.choose")), names))
  get("/board").then((board) => names.append(...(board.test_points ?? []).map((/** @type {any} */ one) => el("a", { class: "button", href: `#point/${encodeURIComponent(one.name)}` }, one.name))),
    (error) => names.append(inWords(error.error)))
  return () => undefined
}

/** @param {string} name @param {any} seen */
function head(name, seen) {
  const { point, tests } = seen
  const bad = tests.filter((/** @type {any} */ one) => !one.verdict.startsWith("pass")).length
  const recovered = tests.filter((/** @type {any} */ one) => one.verdict === "pass_recovered").length
  return [el("p", { class: "big" }, name), seen.said ? el("p", { class: "said", role: "alert" }, seen.said) : null,
    el("p", { class: "what" }, [point?.net, point && `${number(point.x_um / 1000, 2)} / ${number(point.y_um / 1000, 2)} mm`].filter(Boolean).join(" · ")),
    el("p", { class: "quiet" }, t(tests.length === 1 ? "point.summary_one" : "point.summary", { n: tests.length, recovered, bad }))]
}

/** @param {any} seen */
function tests(seen) {
  if (!seen.tests.length) return [el("h2", {}, t("point.tests")), el("p", { class: "quiet" }, t("point.none"))]
  return [el("h2", {}, t("point.tests")), ...seen.tests.map(test)]
}

/** One test; its readings and pictures come when it is opened. @param {any} one */
function test(one) {
  const inside = el("div")
  const line = el("summary", {}, markOf(KIND_OF_VERDICT[one.verdict]), ` ${t(`verdict.${KIND_OF_VERDICT[one.verdict]}`)} · ${one.board_id ?? t("board.unnamed")} · `,
    el("span", { class: "number" }, reading(one.readings.at(-1))), el("span", { class: "quiet" }, ` ${day(one.at)}`))
  const box = el("details", { class: "test" }, line, inside)
  box.addEventListener("toggle", () => {
    if (!box.open || inside.children.length) return
    inside.append(el("dl", {}, ...[["why", why(one)], ["touches", `${one.touches} / ${one.presses}`], ["looks", one.looks], ["error_um", one.error_um == null ? "" : `${number(one.error_um)} µm`],
      ["readings", one.readings.map((/** @type {any} */ press) => `${tOr(`rung.${press.rung}`, press.rung)}: ${reading(press)}${press.contact_ohm == null ? "" : ` (${t("contact_ohm", { ohm: number(press.contact_ohm, 2) })})`}`).join(", ")]]
      .filter(([, value]) => value !== "").flatMap(([key, value]) => [el("dt", {}, t(`point.${key}`)), el("dd", {}, value)])),
    one.pictures_id ? picturesOf(one.pictures_id) : el("p", { class: "quiet" }, t("picture.none")),
    one.run ? el("a", { class: "button", href: `#run/${encodeURIComponent(one.run)}` }, t("point.run")) : "")
  })
  return box
}

/** What people said of it, and what may be ordered. @param {string} name @param {any} seen @param {any} app @param {boolean} idle @param {() => void} again */
function marks(name, seen, app, idle, again) {
  const { mark } = seen
  const forbidden = mark?.mark === "forbidden"
  const out = [el("h2", {}, t("point.use")), el("p", { class: forbidden ? "what said" : "what", id: "mark" },
    mark ? `${t(`mark.${mark.mark}`)}: ${mark.reason}` : t("mark.none"), mark ? el("span", { class: "quiet" }, ` ${mark.by}, ${day(mark.at)}`) : null)]
  if (!app.may("operate") || !seen.point) return out
  const to = forbidden ? "approved" : "forbidden"
  const write = (/** @type {string} */ note) => post("/order", { order: "mark", test_point: name, mark: to, note }).then(again)
  const move = (/** @type {string} */ op) => el("button", { type: "button", class: "order", id: `order-${op}`, disabled: !idle || (op === "probe" && forbidden),
    on: { click: () => confirm(t("point.ask", { name }), `order.${op}`, () => post("/order", { order: op, id: jobKey(op), test_point: name }).catch(tell)) } }, t(`order.${op}`))
  out.push(el("div", { class: "orders" }, el("button", { type: "button", class: "order", id: "change-mark", disabled: !app.live,
    on: { click: () => noteTo(t(`order.${to}`), write, "reason") } }, t(`order.${to}`)), ...["place", "correct", "probe"].map(move)))
  return out
}

/** @param {any[]} results */
function results(results) {
  if (!results.length) return el("p", { class: "quiet" }, t("no_result"))
  return el("table", { "aria-label": t("last_results") }, el("tbody", {}, ...results.slice(0, 12).map((one) => el("tr", {}, el("td", {}, markOfResult(one)),
    el("td", {}, tOr(`op.${one.op}`, one.op)), el("td", {}, kindOf(one) === "bad" || one.op !== "probe" ? word(one) : t(`verdict.${kindOf(one)}`)), el("td", { class: "number" }, numbers(one)), el("td", { class: "number" }, day(one.finished_at))))))
}
