// Screen Run: start a plan on a board, watch it, pause, go on; the verdict of each point; the board's own at the end.
// @ts-check
import { get, jobKey, post } from "./ask.js"
import { confirm, inWords, tell } from "./dialogs.js"
import { el, show } from "./dom.js"
import { legend, makeMap } from "./map.js"
import { KIND_OF_VERDICT, markOf, reading, why } from "./verdict.js"
import { cause, clock, cure, day, number, t, tOr } from "./words.js"

const VERDICTS = Object.keys(KIND_OF_VERDICT)

/** @param {any} box @param {any} app @param {string} [wanted] id of a run of before; none: the newest */
export function open(box, app, wanted) {
  const parts = { head: el("section", { class: "panel", id: "run-head", role: "status" }), start: el("section", { class: "panel", id: "run-start" }),
    map: el("section", { class: "panel" }), list: el("section", { class: "panel below" }) }
  box.replaceChildren(el("div", { class: "two" }, el("div", { class: "stack" }, parts.head, parts.list), el("div", { class: "stack" }, parts.start, parts.map)))
  const seen = { run: /** @type {any} */ (null), points: /** @type {any[]} */ ([]), said: "", loading: "" }
  const start = { plans: /** @type {any[] | null} */ (null), board: "", plan: "" }
  let filter = ""
  let map = /** @type {any} */ (null)
  let now = app

  async function load(/** @type {string} */ id) {
    if (seen.loading === id) return
    seen.loading = id
    try {
      Object.assign(seen, await get("/run", { id }), { said: "" })
    } catch (error) {
      Object.assign(seen, { run: null, points: [], said: /** @type {any} */ (error).error?.name === "unknown_run" ? t("run.none") : inWords(/** @type {any} */ (error).error) })
    }
    seen.loading = ""
    update(now)
  }
  /** Take what is new from the station, and ask for the whole where something is missing. @param {any} station */
  function follow(station) {
    const live = station.run
    if (wanted) return seen.run?.id === wanted || seen.said || load(wanted)
    if (!live) return (seen.said = t("run.none"))
    if (seen.run?.id !== live.id) return load(live.id)
    const point = station.point
    if (point?.run === live.id && live.done === seen.points.length + 1 && !seen.points.some((one) => one.at === point.at && one.point === point.point))
      seen.points.push({ ...point, pictures_id: point.pictures ? `${point.job}.${point.point}` : null })
    else if (live.done !== seen.points.length || live.state !== seen.run.state || live.stopped_by !== seen.run.stopped_by) load(live.id)
  }

  get("/board").then((board) => {
    if (!board.test_points?.length) return
    map = makeMap(board, (name) => (map.choose(name), parts.list.querySelector(`[data-point="${CSS.escape(name)}"]`)?.scrollIntoView({ block: "nearest" })))
    parts.map.replaceChildren(map.root, el("ul", { class: "legend" }, ...legend([...new Set(Object.values(KIND_OF_VERDICT))]).map((one) => el("li", {}, ...one))))
    update(now)
  }, () => undefined)
  if (app.may("operate")) get("/plans").then((found) => ((start.plans = found.plans ?? []), update(now)), (error) => ((start.plans = []), (seen.said = inWords(error.error)), update(now)))

  /** @param {any} app */
  function update(app) {
    now = app
    const { station } = app
    follow(station)
    const running = station.job?.op === "run"
    const failed = station.results?.find((/** @type {any} */ one) => one.op === "run")
    show(parts.head, [seen.run?.id, seen.run?.state, seen.run?.stopped_by, seen.points.length, seen.said, running, app.live, station.job?.progress?.doing, app.me.role, app.language],
      () => head(seen, running && !wanted, app))
    show(parts.start, [start.plans, running, !!station.job, !!station.fault, station.run?.id, station.run?.state, failed?.id, app.live, app.me.role, app.language], () => (wanted ? back() : form(start, app, running, failed)))
    show(parts.list, [seen.run?.id, seen.points.length, filter, app.language], () => [filters(), list()])
    map?.colour((/** @type {string} */ name) => KIND_OF_VERDICT[seen.points.findLast((one) => one.point === name)?.verdict] ?? "untested")
  }
  function filters() {
    const some = VERDICTS.filter((one) => seen.points.some((point) => point.verdict === one))
    const pick = (/** @type {string} */ value, /** @type {string} */ text, /** @type {number} */ n) =>
      el("button", { type: "button", "aria-pressed": String(filter === value), on: { click: () => ((filter = value), update(now)) } }, `${text} ${n}`)
    return el("div", { class: "filter" }, pick("", t("all"), seen.points.length),
      ...some.map((one) => pick(one, t(`verdict.${KIND_OF_VERDICT[one]}`), seen.points.filter((point) => point.verdict === one).length)))
  }
  function list() {
    const shown = seen.points.filter((one) => !filter || one.verdict === filter).reverse()
    if (!shown.length) return el("p", { class: "quiet" }, t("run.no_point"))
    return el("div", { class: "scroll" }, el("table", { id: "verdicts", "aria-label": t("run.verdicts") }, el("tbody", {}, ...shown.map((one) =>
      el("tr", { "data-point": one.point }, el("td", {}, markOf(KIND_OF_VERDICT[one.verdict])),
        el("td", {}, el("a", { class: "button", href: `#point/${encodeURIComponent(one.point)}` }, one.point)),
        el("td", {}, t(`verdict.${KIND_OF_VERDICT[one.verdict]}`), why(one) ? el("div", { class: "quiet" }, why(one)) : null),
        el("td", { class: "number" }, reading(one.readings.at(-1))), el("td", { class: "number late" }, clock(one.at)))))))
  }
  return update
}

/** How the run stands, in the largest type. @param {any} seen @param {boolean} running @param {any} app */
function head(seen, running, app) {
  const { run, points } = seen
  // A job that has begun and a run that is over: which run begins, the station has not told yet.
  if (!run || (running && run.state !== "unfinished")) return [el("h2", {}, t("screen.run")), el("p", { class: "quiet" }, seen.said || t("run.loading"))]
  const total = run.plan.tests.length
  const count = (/** @type {string} */ verdict) => points.filter((/** @type {any} */ one) => one.verdict === verdict).length
  const facts = [t("run.recovered", { n: count("pass_recovered") })]
  const spent = points.reduce((/** @type {number} */ sum, /** @type {any} */ one) => sum + one.seconds, 0)
  if (running && points.length) facts.push(t("run.left", { s: number(Math.round((spent / points.length) * (total - points.length)), 0) }))
  else if (points.length) facts.push(t("run.pace", { s: number(spent / points.length, 1) }))
  const verdict = running ? "running" : run.state === "done" ? verdictOf(points, total) : run.state
  return [
    el("h2", {}, `${run.board_id} · ${run.plan.name}${run.plan_version ? ` v${run.plan_version}` : ""}`),
    el("p", { class: `big ${verdict}`, id: "run-verdict" }, running ? t("run.of", { done: points.length, total }) : t(`run.${verdict}`)),
    el("progress", { max: total, value: points.length, "aria-label": t("run.of", { done: points.length, total }) }),
    el("p", { class: "what" }, running ? "" : `${t("run.of", { done: points.length, total })}. `, facts.join(", ")),
    el("p", { class: "quiet" }, running ? (app.station.job?.progress?.doing ? t("run.doing", { what: app.station.job.progress.doing }) : "")
      : [run.stopped_by && tOr(`run.why.${run.stopped_by}`, run.stopped_by), day(run.ended_at ?? run.begun_at)].filter(Boolean).join(" · ")),
    running && app.may("operate") ? el("div", { class: "orders" }, el("button", { type: "button", id: "pause", class: "order", disabled: !app.live,
      on: { click: (/** @type {any} */ event) => ((event.currentTarget.disabled = true), post("/order", { order: "pause" }).catch(tell)) } }, t("order.pause"))) : null,
  ]
}

/** PASS only where every point passed; FAIL where one speaks against the board; else nobody knows. @param {any[]} points @param {number} total */
export function verdictOf(points, total) {
  const kinds = points.map((one) => one.verdict)
  if (kinds.some((one) => one === "fail" || one === "open_confirmed")) return "fail"
  return kinds.length === total && kinds.every((one) => one === "pass_first" || one === "pass_recovered") ? "pass" : "unknown"
}

const back = () => [el("a", { class: "button", href: "#run" }, t("run.newest"))]

/** What a person gives to begin a run. @param {any} start @param {any} app @param {boolean} running @param {any} failed */
function form(start, app, running, failed) {
  const { station } = app
  if (!app.may("operate")) return [el("p", { class: "quiet" }, t("run.operator"))]
  if (running) return [el("p", { class: "quiet" }, t("run.under_way"))]
  if (!start.plans) return [el("p", { class: "quiet" }, t("run.loading"))]
  if (app.planToRun) ((start.plan = app.planToRun), (app.planToRun = ""))
  const left = station.run?.state === "unfinished" ? station.run : failed?.error?.name === "run_unfinished" ? { board_id: start.board } : null
  if (!start.board) start.board = left?.board_id ?? station.run?.board_id ?? ""
  const usable = start.plans.filter((/** @type {any} */ plan) => plan.fits && (!plan.learned || plan.approved))
  const board = el("input", { name: "board_id", maxlength: 64, required: "", value: start.board, autocomplete: "off", on: { input: () => (start.board = board.value.trim()) } })
  const plan = el("select", { name: "plan", on: { change: () => (start.plan = plan.value) } }, ...usable.map((/** @type {any} */ one) => el("option", { value: one.name }, `${one.name} (${one.tests})`)))
  if (usable.some((/** @type {any} */ one) => one.name === start.plan)) plan.value = start.plan
  const send = (/** @type {string} */ how) => post("/order", { order: "run", id: jobKey("run"), board_id: start.board, plan: plan.value, how }).catch(tell)
  const button = (/** @type {string} */ how, /** @type {boolean} */ off) => el("button", { type: "button", id: `run-${how}`, class: "order", disabled: off || !app.live,
    on: { click: () => (board.reportValidity() ? confirm(t(`run.ask.${how}`, { board: start.board, plan: plan.value }), `order.run.${how}`, () => send(how)) : undefined) } }, t(`order.run.${how}`))
  const align = () => post("/order", { order: "align", id: jobKey("align"), board_id: start.board }).catch(tell)
  const busy = !!(station.job || station.fault)
  return [
    el("h2", {}, t("run.start")),
    failed?.error && failed.error.name !== "cancelled" ? el("p", { class: "said", role: "alert", id: "run-error" }, `${cause(failed.error)}. ${cure(failed.error)}`) : null,
    el("div", { class: "filter" }, el("label", {}, t("field.board_id"), board), el("label", {}, t("plan"), plan)),
    usable.length ? null : el("p", { class: "quiet" }, t("run.no_plan")),
    left ? el("p", { class: "what" }, t("run.unfinished_on", { board: left.board_id })) : null,
    el("div", { class: "orders" }, failed?.error?.name === "not_aligned" ? el("button", { type: "button", id: "run-align", class: "order", disabled: busy || !app.live,
      on: { click: () => board.reportValidity() && confirm(t("run.ask.align", { board: start.board }), "order.align", align) } }, t("order.align")) : null, left ? button("resume", busy) : null, button(left ? "abandon" : "begin", busy || !usable.length),
      usable.length ? el("button", { type: "button", id: "plan-edit", on: { click: () => (location.hash = `plan/${encodeURIComponent(plan.value)}`) } }, t("plan.edit")) : null,
      el("a", { class: "button", id: "plan-new", href: "#plan" }, t("plan.make"))),
  ]
}
