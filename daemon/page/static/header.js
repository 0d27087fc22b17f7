// Header, banner and title: what the station does now, and whether that is known at all.
// @ts-check
import { byId } from "./dom.js"
import { cause, clock, cure, t, tOr } from "./words.js"

const WORKING = { triggered: "looking", look: "looking", move: "moving", verify: "checking" }
const OWN_WORD = { emergency_stop: "emergency_stop", not_homed: "not_homed", needle_down: "needle_down" }

/** The one word for the station, and how abnormal it is. @param {any} station @param {boolean} live */
export function stateOf(station, live) {
  if (!live) return { word: "unknown", kind: "lost" }
  const fault = station.fault
  if (fault) {
    const word = OWN_WORD[/** @type {keyof typeof OWN_WORD} */ (fault.name)] ?? "fault"
    return { word, kind: word === "not_homed" ? "look" : "fault" }
  }
  if (station.lifecycle !== "ready" || station.state === "fault") return { word: "starting", kind: "" }
  if (station.contact) return { word: "holding", kind: "busy" }
  const busy = WORKING[/** @type {keyof typeof WORKING} */ (station.state)]
  return busy ? { word: busy, kind: "busy" } : { word: "ready", kind: "" }
}

/** @param {any} job */
export function jobText(job) {
  if (!job) return ""
  const op = job.op ? tOr(`op.${job.op}`, job.op) : ""
  const far = job.progress ? ` ${job.progress.done} / ${job.progress.total}` : ""
  return `${op}${far} ${job.id}`.trim()
}

/** @param {any} app */
export function showHeader(app) {
  const { station, me, live } = app
  const { word, kind } = stateOf(station, live)
  const tile = byId("tile")
  tile.className = kind
  byId("state").textContent = t(`state.${word}`)
  byId("reason").textContent = live ? (station.fault && word === "fault" ? cause(station.fault) : "") : t("lost.short")
  const told = [t(`state.${word}`), byId("reason").textContent].filter(Boolean).join(": ")
  if (byId("told").textContent !== told) byId("told").textContent = told
  byId("station-name").textContent = station.name ?? ""
  byId("job").textContent = live ? jobText(station.job) + (station.queued ? ` · ${t("waiting", { n: station.queued })}` : "") : ""
  document.title = `${t(`state.${word}`)} · ${station.name || "reprobe"}`
  document.body.classList.toggle("lost", !live)
  const alerts = station.alerts?.length ?? 0
  byId("alert-count").hidden = !alerts
  byId("alert-count").textContent = t("alerts.count", { n: alerts })
  const stop = byId("stop")
  stop.hidden = !app.may("operate")
  stop.textContent = t("stop")
  stop.disabled = !live || !(station.job || station.queued)
  byId("who").textContent = me.name ? `${me.name} · ${t(`role.${me.role}`)}` : me.role ? t("view_only") : ""
  // Before that nobody listens to them yet.
  byId("log").disabled = byId("language").disabled = false
  byId("log").textContent = me.name ? t("logout") : t("login")
  byId("language").textContent = t("other_language")
  showBanner(app, word)
}

/** Cause and cure, where a station that is there cannot be shown. @param {string} name */
const why = (name) => (["no_answer", "silent", "starting"].includes(name) ? [] : [cause({ name }), cure({ name })].map((one) => one.replace(/\.$/, "")).filter(Boolean))

/** @param {any} app @param {string} word */
function showBanner(app, word) {
  const banner = byId("banner")
  const { station } = app
  let text = ""
  if (app.outdated) text = t("outdated")
  else if (app.linked === false) text = t("lost.page", { at: clock(station.heard_at) })
  else if (!app.me.role) text = ""
  else if (!station.live) text = [t("lost.station", { at: clock(station.heard_at) }), ...why(station.lost_why)].join(". ")
  else if (word === "emergency_stop" || word === "needle_down") text = t(`banner.${word}`)
  banner.hidden = !text
  banner.classList.toggle("red", app.live)
  if (banner.textContent !== text) banner.textContent = text
}
