// Screen Wall: state, verdict and alerts, to be read from five metres; it has no button and takes no order.
// @ts-check
import { el, show } from "./dom.js"
import { stateOf } from "./header.js"
import { verdictOf } from "./run.js"
import { get } from "./ask.js"
import { KIND_OF_VERDICT, kindOf, markOf } from "./verdict.js"
import { cause, clock, t, tOr, watchWords } from "./words.js"

/** More would leave no room for the verdict; their number is said. */
const MOST_ALERTS = 2
/** Letters that fit into one line at full size. */
const LONG = 12

/** @param {any} box */
export function open(box) {
  const parts = { state: el("section", { class: "wall-state", role: "status" }), verdict: el("section", { class: "wall-verdict" }), alerts: el("section", { class: "wall-alerts" }) }
  box.replaceChildren(el("h1", { class: "hidden" }, t("screen.wall")), parts.state, parts.verdict, parts.alerts)
  let done = { mark: "", verdict: "" }
  /** @param {any} app */
  return function update(app) {
    const { station, live } = app
    const { word, kind } = stateOf(station, live)
    const run = station.run, running = station.job?.op === "run" && run?.state === "unfinished"
    const mark = run && !running && run.state === "done" ? run.id : ""
    if (mark !== done.mark) {
      done = { mark, verdict: "" }
      if (mark) get("/run", { id: mark }).then((found) => ((done.verdict = verdictOf(found.points, found.run.plan.tests.length)), update(app)), () => undefined)
    }
    parts.state.className = `wall-state ${kind}`
    show(parts.state, [word, live && station.fault, station.name, live, station.heard_at, app.language], () => [
      el("p", { class: wide("wall-word", t(`state.${word}`)) }, t(`state.${word}`)), el("p", { class: "wall-name" }, station.name),
      el("p", { class: "wall-reason" }, live ? (station.fault ? cause(station.fault) : "") : t("lost.since", { at: clock(station.heard_at) }))])
    const last = station.results?.[0]
    show(parts.verdict, [last?.id, run, running, done.verdict, station.point?.at, live, app.language], () => (running || done.verdict ? ofRun(run, running, done.verdict, station) : ofJob(last)))
    const alerts = station.alerts ?? []
    show(parts.alerts, [alerts, live, app.language], () => alerts.length
      ? [el("p", { class: "wall-count" }, t("alerts.count", { n: alerts.length })), ...alerts.slice(0, MOST_ALERTS).map((/** @type {any} */ one) =>
          el("p", { class: `wall-alert ${one.severity}` }, `${one.severity === "serious" ? "\u25A0" : "\u25B2"} ${watchWords(one).what}`))]
      : [el("p", { class: "wall-count" }, t("alerts.none"))])
  }
}

/** @param {any} run @param {boolean} running @param {string} verdict @param {any} station */
function ofRun(run, running, verdict, station) {
  const point = station.point?.run === run.id ? station.point : null
  return [el("p", { class: "wall-name" }, `${run.board_id} · ${run.plan}`),
    el("p", { class: `wall-big ${running ? "" : verdict}` }, running ? t("run.of", { done: run.done, total: run.points }) : t(`run.${verdict}`)),
    el("progress", { max: run.points, value: run.done, "aria-label": t("run.of", { done: run.done, total: run.points }) }),
    el("p", { class: "wall-last" }, ...(running && point ? [markOf(KIND_OF_VERDICT[point.verdict]), ` ${point.point}: ${t(`verdict.${KIND_OF_VERDICT[point.verdict]}`)}`] : [clock(run.ended_at)]))]
}

/** A long word has smaller letters. @param {string} name @param {string} text */
const wide = (name, text) => (text.length > LONG ? `${name} long` : name)

/** @param {any} last */
function ofJob(last) {
  const said = last ? `${last.test_point ?? ""} ${t(`verdict.${kindOf(last)}`)}`.trim() : ""
  if (!last) return [el("p", { class: wide("wall-big", t("no_result")) }, t("no_result"))]
  return [el("p", { class: "wall-name" }, tOr(`op.${last.op}`, last.op)), el("p", { class: wide("wall-big", said) }, markOf(kindOf(last)), ` ${said}`), el("p", { class: "wall-last" }, clock(last.finished_at))]
}
