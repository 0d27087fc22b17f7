// Screen Station: last verdict, what to do now, the last results.
// @ts-check
import { jobKey, post } from "./ask.js"
import { confirm, tell } from "./dialogs.js"
import { el, show } from "./dom.js"
import * as live from "./live.js"
import { stateOf } from "./header.js"
import { kindOf, mark, more, numbers, word } from "./verdict.js"
import { cause, clock, cure, t, tOr } from "./words.js"

/** @param {any} box @param {any} app */
export function open(box, app) {
  const picture = live.open()
  const parts = { verdict: el("section", { class: "panel" }), todo: el("section", { class: "panel" }), last: el("section", { class: "panel" }) }
  box.replaceChildren(el("div", { class: "two" }, el("div", { class: "stack" }, parts.verdict, parts.last), el("div", { class: "stack" }, picture.box, parts.todo)))
  /** @param {any} now */
  return (now) => (picture.follow(now), update(parts, now))
}

/** @param {any} parts @param {any} app */
function update(parts, app) {
  const { station, live } = app
  const last = station.results?.[0]
  show(parts.verdict, [last, app.language], () => [el("h2", {}, t("last_verdict")), ...verdict(last)])
  show(parts.last, [station.results, app.language], () => [el("h2", {}, t("last_results")), list(station.results ?? [])])
  // What a person has to do stands above the picture: a low window has room for one of them.
  parts.todo.classList.toggle("first", !live || !!station.fault)
  show(parts.todo, [station.fault, station.state, station.lifecycle, station.calibration, station.needle, station.job, live,
    app.me.role, app.stopped, app.language], () => todo(app))
}

/** @param {any} last */
function verdict(last) {
  if (!last) return [el("p", { class: "quiet" }, t("no_result"))]
  const kind = kindOf(last)
  return [
    el("p", { class: "big", id: "verdict" }, mark(last), ` ${last.test_point ? `${last.test_point}: ` : ""}${t(`verdict.${kind}`)}`),
    el("p", { class: "what" }, `${tOr(`op.${last.op}`, last.op)}: ${word(last)}`, last.error ? ` → ${cure(last.error)}` : ""),
    el("p", { class: "quiet" }, [numbers(last), clock(last.finished_at), last.board_id].filter(Boolean).join(" · ")),
  ]
}

/** @param {any[]} results */
function list(results) {
  return el("table", { "aria-label": t("last_results") }, el("tbody", {}, ...results.map((result) =>
    el("tr", {},
      el("td", {}, mark(result)), el("td", {}, more(result)), el("td", {}, word(result),
        el("div", { class: "quiet" }, [numbers(result), clock(result.finished_at)].filter(Boolean).join(" · ")))))))
}

/** What a person has to do, and the orders for it. @param {any} app */
function todo(app) {
  const { station, live } = app
  const { word: now } = stateOf(station, live)
  if (!live) return [el("h2", {}, t("do_now")), el("p", {}, t("lost.do"))]
  const out = [el("h2", {}, t("do_now"))]
  if (station.fault) {
    out.push(el("p", { class: "what" }, cause(station.fault)), el("p", {}, cure(station.fault)))
    if (now === "emergency_stop" || app.stopped) out.push(steps(now))
  } else out.push(el("p", {}, t(`do.${now}`)))
  const orders = []
  if (app.may("operate") && now === "needle_down") orders.push(order(app, "lift", "needle_down.ask"))
  if (app.may("maintain")) {
    if (station.fault && !["not_homed", "needle_down"].includes(station.fault.name)) orders.push(order(app, "reset"))
    orders.push(order(app, "home", "home.ask", station.job || (station.fault && !["not_homed", "needle_down"].includes(station.fault.name))))
  }
  if (orders.length) out.push(el("div", { class: "orders" }, ...orders))
  else if (station.fault) out.push(el("p", { class: "quiet" }, t("call_maintenance")))
  // Below the orders: in a low window the one that is wanted now must not lie below the edge.
  return [...out, ...missing(station.calibration)]
}

/** @param {string} now */
function steps(now) {
  const at = now === "emergency_stop" ? 0 : now === "not_homed" ? 2 : 1
  return el("ol", { class: "steps" }, ...["release", "reset", "home"].map((step, n) =>
    el("li", { class: n < at ? "done" : n === at ? "now" : "" }, t(`step.${step}`))))
}

/** @param {any} calibration */
function missing(calibration) {
  if (!calibration) return []
  const wanting = [!calibration.tip && "tip", !calibration.map_made_at && "map", !calibration.aligned && "aligned"].filter(Boolean)
  return wanting.length
    ? [el("h2", {}, t("missing")), el("ul", {}, ...wanting.map((what) => el("li", {}, t(`missing.${what}`))))]
    : []
}

/** A button that gives an order; with a question, what it moves is asked for a second time.
 * @param {any} app @param {string} name @param {string} [question] @param {any} [off] */
function order(app, name, question, off) {
  const send = () => post("/order", { order: name, ...(question ? { id: jobKey(name) } : {}) }).catch(tell)
  return el("button", { type: "button", id: name, class: "order", disabled: !!off || !app.live,
    on: { click: () => (question ? confirm(t(question), `order.${name}`, send) : send()) } }, t(`order.${name}`))
}
