// Screen Service: lamps and live picture, jogging by small steps, the settings in force, versions, lines, how to keep a copy.
// @ts-check
import { get, jobKey, post } from "./ask.js"
import { confirm, inWords, tell } from "./dialogs.js"
import { el, show } from "./dom.js"
import * as live from "./live.js"
import { cause, cure, number, t } from "./words.js"

const STEPS_UM = [10, 100, 1000], STEPS_DEG = [0.1, 1, 5]
const ALLOWED_MS = 60_000
const AXES = ["x", "y", "z", "theta"]

/** @param {any} box @param {any} app */
export function open(box, app) {
  const picture = live.open()
  const pad = app.may("maintain") ? jogPad() : null
  const parts = { about: el("section", { class: "panel below" }), settings: el("section", { class: "panel below" }), keep: el("section", { class: "panel below" }) }
  box.replaceChildren(el("div", { class: "two" }, el("div", { class: "stack" }, picture.box, parts.settings), el("div", { class: "stack" }, pad?.box, parts.about, parts.keep)))
  show(parts.keep, [app.language], () => [el("h2", {}, t("service.keep")), el("p", {}, t("service.backup")), el("p", {}, el("code", {}, "reprobe backup")), el("p", {}, t("service.bundle")), el("p", {}, el("code", {}, "reprobe bundle"))])
  const config = settingsBox(parts.settings)
  get("/config").then((found) => (config.take(found), pad?.heights(found.settings)), (error) => parts.settings.replaceChildren(el("p", { class: "said", role: "alert" }, inWords(error.error))))
  return (/** @type {any} */ now) => {
    const { station } = now
    picture.follow(now)
    pad?.follow(now)
    show(parts.about, [station.version, now.me.edition, station.links, station.touches, station.pictures, station.board_revision, now.language], () => about(now))
  }
}

/** Steps of one axis at a time: allowed for a minute after a second question, one press one step, none while anything goes on. */
function jogPad() {
  let allowed = 0, step = 1, pending = "", now = /** @type {any} */ (null), safe_um = /** @type {number | null} */ (null), timer = 0
  const said = el("p", { class: "said", role: "alert" })
  const where = el("p", { class: "what", id: "jog-z" })
  const allow = el("button", { type: "button", class: "order", id: "jog-allow", on: { click: () => confirm(t("jog.ask"), "jog.allow", () => (arm(), update())) } })
  const lift = el("button", { type: "button", class: "order", id: "jog-lift", on: { click: () => confirm(t("jog.ask_lift"), "order.lift", () => post("/order", { order: "lift", id: jobKey("lift") }).catch(tell)) } }, t("order.lift"))
  const steps = STEPS_UM.map((um, n) => el("button", { type: "button", id: `jog-step-${n}`, on: { click: () => ((step = n), update()) } }))
  const moves = AXES.flatMap((axis) => [-1, 1].map((way) => el("button", { type: "button", class: "order", id: `jog-${axis}-${way < 0 ? "minus" : "plus"}`, "data-axis": axis,
    on: { click: () => send(axis, way), keydown: (/** @type {KeyboardEvent} */ event) => event.repeat && event.preventDefault() } })))
  const box = el("section", { class: "panel", id: "jog" }, el("h2", {}, t("jog")), where, said, el("div", { class: "orders" }, allow, lift), el("div", { class: "orders" }, ...steps), el("div", { class: "pad" }, ...moves), el("p", { class: "quiet" }, t("jog.rules")))

  function arm() {
    allowed = Date.now() + ALLOWED_MS
    clearTimeout(timer)
    timer = setTimeout(update, ALLOWED_MS + 50)
  }
  /** @param {string} axis @param {number} way */
  function send(axis, way) {
    if (pending || Date.now() > allowed) return update()
    const id = (pending = jobKey("jog"))
    said.textContent = ""
    arm()
    update()
    const by = axis === "theta" ? { by_deg: way * STEPS_DEG[step] } : { by_um: way * STEPS_UM[step] }
    post("/order", { order: "jog", id, axis, ...by }).catch((error) => ((pending = ""), (said.textContent = error.error ? inWords(error.error) : ""), update()))
  }
  function update() {
    if (!now) return
    const { station } = now
    const ended = station.results?.find((/** @type {any} */ one) => one.id === pending)
    if (ended) {
      pending = ""
      if (ended.error) said.textContent = ended.error.detail?.least_z_um != null ? t(ended.error.detail.axis === "z" ? "jog.low" : "jog.lift", { mm: number(ended.error.detail.least_z_um / 1000, 2) }) : `${cause(ended.error)}. ${cure(ended.error)}`
    }
    const on = Date.now() <= allowed
    const idle = now.live && !station.job && !station.queued && !station.fault && !pending
    const z_um = station.needle?.z_um
    const high = z_um != null && (safe_um == null || z_um >= safe_um - 5)
    where.textContent = z_um == null ? t("jog.no_z") : `Z ${number(z_um / 1000, 3)} mm${safe_um == null ? "" : ` · ${t("jog.safe", { mm: number(safe_um / 1000, 3) })}`}`
    allow.textContent = t(on ? "jog.allowed" : "jog.allow")
    lift.disabled = !idle || high
    allow.disabled = !now.live || on
    steps.forEach((button, n) => {
      button.textContent = `${number(STEPS_UM[n] / 1000, 2)} mm / ${number(STEPS_DEG[n], 1)}°`
      button.setAttribute("aria-pressed", String(n === step))
    })
    moves.forEach((button, n) => {
      const axis = AXES[n >> 1]
      button.textContent = `${axis === "theta" ? "θ" : axis.toUpperCase()} ${n % 2 ? "+" : "−"}`
      button.setAttribute("aria-label", t(n % 2 ? "jog.plus" : "jog.minus", { axis: axis === "theta" ? t("jog.theta") : axis.toUpperCase() }))
      button.disabled = !on || !idle || (axis !== "z" && !high)
    })
  }
  return {
    box,
    /** @param {any} app */
    follow: (app) => ((now = app), update()),
    /** @param {any[]} settings */
    heights: (settings) => ((safe_um = settings.find((one) => one.name === "gantry.safe_z_um")?.value ?? null), update()),
  }
}

/** @param {any} box */
function settingsBox(box) {
  const find = el("input", { name: "setting", maxlength: 64, "aria-label": t("service.find"), on: { input: () => list() } })
  const rows = el("tbody")
  let settings = /** @type {any[]} */ ([])
  function list() {
    const wanted = find.value.trim().toLowerCase()
    rows.replaceChildren(...settings.filter((one) => one.name.includes(wanted)).map((one) => el("tr", {}, el("td", {}, one.name),
      el("td", { class: "number" }, one.value == null ? t("service.unset") : String(one.value)), el("td", { class: "quiet" }, t(`service.${one.source}`)))))
  }
  return {
    /** @param {any} found */
    take(found) {
      settings = found.settings
      box.replaceChildren(el("h2", {}, t("service.settings")), ...found.refused.map((/** @type {string} */ why) => el("p", { class: "said" }, `${t("service.refused")}: ${why}`)),
        el("div", { class: "filter" }, el("label", {}, t("service.find"), find)), el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": t("service.settings") }, el("table", { id: "settings" }, rows)))
      list()
    },
  }
}

/** @param {any} app */
function about(app) {
  const { station } = app
  const lines = Object.entries(station.links?.buses ?? {}).map(([name, counts]) => [t("service.line", { name }), Object.entries(counts).map(([what, n]) => `${what.replaceAll("_", " ")} ${n}`).join(", ")])
  const camera = Object.entries(station.links?.camera ?? {}).map(([what, n]) => `${what.replaceAll("_", " ")} ${n}`).join(", ")
  const facts = [["service.version", station.version], ["service.edition", app.me.edition], ["service.board", station.board_revision], ["service.touches", number(station.touches, 0)],
    ["service.pictures", station.pictures === "kept" ? t("service.kept") : station.pictures]].map(([key, value]) => [t(key), value])
  return [el("h2", {}, t("service.about")), el("dl", {}, ...[...facts, ...lines, ...(camera ? [[t("service.camera"), camera]] : [])].flatMap(([key, value]) => [el("dt", {}, key), el("dd", {}, value)]))]
}
