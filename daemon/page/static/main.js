// The page: one connection, one header, one screen at a time.
// @ts-check
import * as alerts from "./alerts.js"
import { post, useToken } from "./ask.js"
import * as audit from "./audit.js"
import * as board from "./board.js"
import { close, login, mustRead, tell } from "./dialogs.js"
import { byId, el } from "./dom.js"
import { showHeader } from "./header.js"
import * as history from "./history.js"
import { follow } from "./link.js"
import * as plan from "./plan.js"
import * as point from "./point.js"
import * as run from "./run.js"
import * as service from "./service.js"
import * as station from "./station.js"
import * as teach from "./teach.js"
import * as wall from "./wall.js"
import * as watches from "./watches.js"
import { cause, cure, other, speak, t } from "./words.js"

/** @type {Record<string, { open: (box: any, app: any, of?: string) => (app: any) => void, role: string, inside?: string }>} inside: it has no name of its own above, but is a part of that screen */
const SCREENS = {
  station: { ...station, role: "observe" }, run: { ...run, role: "observe" }, board: { ...board, role: "observe" }, point: { ...point, role: "observe" },
  alerts: { ...alerts, role: "observe" }, watches: { ...watches, role: "observe" }, teach: { ...teach, role: "maintain" }, history: { ...history, role: "observe" },
  service: { ...service, role: "observe" }, audit: { ...audit, role: "maintain" }, wall: { ...wall, role: "observe" },
  plan: { ...plan, role: "operate", inside: "run" },
}
const ROLES = ["observe", "operate", "maintain"]
const OF_THE_BOARD = ["board", "run", "point"]
const ALIVE_EVERY_MS = 60_000
/** So many screens have a button in the one row that a low window has; the others come by "More". */
const FIRST_SCREENS = 5

/** @type {any} */
const app = {
  station: {}, me: { name: null, role: null, token: null }, linked: null, live: false, outdated: false, stopped: false, language: "en",
  /** @param {string} role */
  may: (role) => ROLES.indexOf(app.me.role) >= ROLES.indexOf(role),
}
let screen = ""
/** @type {(app: any) => void} */
let update = () => undefined
let edition = ""
let acted = 0
/** @type {{ again: () => void } | undefined} */
let link
const loggedIn = () => link?.again()

function refresh() {
  app.live = app.linked && app.station.live === true
  const fault = app.station.fault?.name
  if (fault === "emergency_stop") app.stopped = true
  else if (app.live && !fault) app.stopped = false
  showHeader(app)
  showScreens()
  const asked = location.hash.slice(1), [name, of] = asked.split("/")
  const shown = app.me.role ? (Object.hasOwn(SCREENS, name) && app.may(SCREENS[name].role) ? asked : "station") : ""
  if (shown !== screen) go(shown, shown && name === shown.split("/")[0] ? of : undefined)
  if (screen) update(app)
  readInterrupted()
}

/** @param {string} whole @param {string} [of] what of the screen, such as the name of a point */
function go(whole, of) {
  const name = whole.split("/")[0]
  screen = whole
  document.body.classList.toggle("wall", name === "wall")
  const box = byId("screen")
  box.replaceChildren()
  box.scrollTop = 0
  update = name ? SCREENS[name].open(box, app, of && plain(of)) : () => undefined
  if (!name) box.append(el("p", { class: "panel" }, t("please_login")))
  showScreens()
}

/** @param {string} of as it stands in the address */
function plain(of) {
  try {
    return decodeURIComponent(of)
  } catch {
    return of
  }
}

function showScreens() {
  const names = app.me.role ? Object.keys(SCREENS).filter((name) => app.may(SCREENS[name].role) && !SCREENS[name].inside) : []
  const mark = JSON.stringify([names, screen, app.language])
  const nav = byId("screens")
  byId("title").textContent = screen ? t(`screen.${screen.split("/")[0]}`) : t("login")
  if (nav.mark === mark) return
  nav.mark = mark
  nav.setAttribute("aria-label", t("screens"))
  const shown = screen.split("/")[0], now = SCREENS[shown]?.inside ?? shown
  nav.replaceChildren(...names.map((name, n) => el("button", { type: "button", class: n < FIRST_SCREENS ? null : "rest", "aria-current": name === now ? "page" : null,
    "aria-keyshortcuts": `Alt+${n + 1}`, on: { click: () => (location.hash = name) } }, t(`screen.${name}`))))
  const more = byId("more"), far = names.indexOf(now) >= FIRST_SCREENS
  more.hidden = names.length <= FIRST_SCREENS
  more.classList.toggle("far", far)
  more.textContent = `${far ? t(`screen.${now}`) : t("more_screens")} \u25BE`
  showMore(false)
}

/** @param {boolean} all show every screen's button, where a low window has one row */
function showMore(all) {
  byId("bar").classList.toggle("all", all)
  byId("more").setAttribute("aria-expanded", String(all))
}

/** A job that a stop of the daemon cut off has to be read by a person. */
function readInterrupted() {
  const last = app.station.results?.[0]
  if (!app.may("operate") || last?.error?.name !== "interrupted" || localStorage.getItem("read") === last.id) return
  if (byId("dialog").open) return
  mustRead(cause(last.error), `${last.test_point ?? ""} ${last.id}. ${cure(last.error)}`, () => localStorage.setItem("read", last.id))
}

/** @param {any} message */
function take(message) {
  if (message.me) {
    const was = app.me.role
    if (edition && edition !== message.me.edition) return location.reload()
    edition = message.me.edition
    app.me = message.me
    useToken(app.me.token)
    if (!app.me.role) app.station = {}
    if (!app.me.role && was) close()
    if (was !== app.me.role) screen = "\0"
    if (!app.me.role && was) login(loggedIn)
  }
  const board = app.station.board_revision
  if (message.station) Object.assign(app.station, message.station)
  // Another board lies there: what was drawn is of the one before.
  if (board && board !== app.station.board_revision && OF_THE_BOARD.includes(screen.split("/")[0])) screen = "\0"
}

function moved() {
  if (!app.me.name || Date.now() - acted < ALIVE_EVERY_MS) return
  acted = Date.now()
  post("/alive").catch(() => undefined)
}

async function start() {
  await speak()
  app.language = document.documentElement.lang
  byId("stop").addEventListener("click", () => post("/order", { order: "stop" }).catch(tell))
  byId("log").addEventListener("click", () => (app.me.name ? post("/logout").catch(tell) : login(loggedIn)))
  byId("alert-count").addEventListener("click", () => (location.hash = "alerts"))
  byId("tile").addEventListener("click", () => (location.hash = "station"))
  byId("more").addEventListener("click", () => showMore(!byId("bar").classList.contains("all")))
  byId("language").addEventListener("click", async () => {
    await speak(other())
    app.language = document.documentElement.lang
    screen = "\0"
    refresh()
  })
  addEventListener("hashchange", refresh)
  addEventListener("pointerdown", moved)
  addEventListener("keydown", (event) => {
    moved()
    if (event.key === "Escape" && screen === "wall") location.hash = "station"
    if (event.key === "Escape") showMore(false)
    if (!event.altKey || event.ctrlKey) return
    const button = event.key === "s" ? byId("stop") : byId("screens").children[Number(event.key) - 1]
    if (button && !button.disabled && !button.hidden) (event.preventDefault(), button.click())
  })
  link = follow({
    onMessage: (message) => (take(message), refresh()),
    onLink: (linked) => ((app.linked = linked), refresh()),
  })
  refresh()
}

start()
