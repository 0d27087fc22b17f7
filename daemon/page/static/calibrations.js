// Calibrations of screen Teach: each in its order, with its age and last figures, or why it is not used; and its order.
// @ts-check
import { jobKey, post } from "./ask.js"
import { confirm, tell } from "./dialogs.js"
import { el, show } from "./dom.js"
import { cause, cure, day, number, t, tOr } from "./words.js"

/** In the order in which they build upon each other. */
const MADE = ["map", "rotation", "backlash", "alignment", "surface"]
/** What can be looked at instead of the printed control point. */
const ON_A_POINT = ["map", "backlash"]
/** Figures of an answer that a person can judge by. */
const FIGURES = ["residual_um", "rms_um", "holdout_rms_um", "spread_um", "height_um", "x_um", "y_um"]

/** @param {any} app */
export function calibrations(app) {
  const point = el("input", { name: "test_point", maxlength: 64, autocomplete: "off" })
  const board = el("input", { name: "board_id", maxlength: 64, autocomplete: "off", value: app.station.run?.board_id ?? "" })
  const rows = el("div"), rest = el("div")
  const box = el("section", { class: "panel", id: "calibrations" }, el("h2", {}, t("teach.made")),
    el("div", { class: "filter" }, el("label", {}, t("calibrate.on"), point), el("label", {}, t("calibrate.board"), board)), rows, rest)

  /** @param {string} what */
  function send(what) {
    const order = what === "alignment" ? { order: "align", id: jobKey("align"), board_id: board.value.trim() }
      : { order: "calibrate", id: jobKey(what), what, ...(ON_A_POINT.includes(what) && point.value.trim() ? { test_point: point.value.trim() } : {}) }
    post("/order", order).catch(tell)
  }
  /** @param {string} what @param {boolean} idle */
  const button = (what, idle) => el("button", { type: "button", class: "order", id: `calibrate-${what}`, disabled: !idle, "aria-label": `${t("calibrate")}: ${tOr(`made.${what}`, what)}`,
    on: { click: () => {
      board.required = what === "alignment"
      if (board.reportValidity()) confirm(t("calibrate.ask", { what: tOr(`made.${what}`, what) }), "calibrate", () => send(what))
    } } }, t("calibrate"))

  /** @param {any} app */
  return Object.assign(box, { follow(/** @type {any} */ app) {
    const { station } = app
    const idle = app.live && !station.job && !station.queued && !station.fault
    const made = station.calibration?.made_at ?? {}, not = station.calibration?.not_used ?? {}
    const ends = (station.results ?? []).filter((/** @type {any} */ one) => one.op === "calibrate" || one.op === "align")
    show(rows, [made, not, ends, idle, app.language], () => [el("table", {}, el("tbody", {}, ...MADE.map((what) => {
      const end = ends.find((/** @type {any} */ one) => isOf(one, what))
      return el("tr", { "data-made": what }, el("td", {}, el("b", {}, tOr(`made.${what}`, what)),
        el("div", { class: "quiet" }, made[what] ? day(made[what]) : not[what] ? "" : t("teach.never")),
        not[what] ? el("div", { class: "said" }, `${t("calibrate.not_used")}: ${not[what]}`) : null,
        end ? el("div", { class: end.ok ? "" : "said" }, end.ok ? figures(end.detail) : `${cause(end.error)}. ${cure(end.error)}`) : null), el("td", { class: "number" }, button(what, idle)))
    })))])
    const others = Object.entries(not).filter(([what]) => !MADE.includes(what))
    show(rest, [others, app.language], () => others.map(([what, why]) => el("p", { class: "said" }, `${tOr(`made.${what}`, what)}, ${t("calibrate.not_used")}: ${why}`)))
  } })
}

/** Whether a result is of this calibration; one that failed has only its id to say so, where this page gave it. @param {any} result @param {string} what */
const isOf = (result, what) => (what === "alignment" ? result.op === "align" : result.detail?.what === what || (result.op === "calibrate" && result.id.startsWith(`${what}-`)))

/** @param {any} detail */
const figures = (detail) => FIGURES.filter((name) => typeof detail?.[name] === "number").map((name) => `${t(`calibrate.${name}`)} ${number(detail[name])} µm`).join(" · ")
