// Screen Teach: where the needle's end is in a frozen picture, touched five times in a loupe; how far the touches scatter.
// @ts-check
import { jobKey, post } from "./ask.js"
import { calibrations } from "./calibrations.js"
import { confirm, inWords, tell } from "./dialogs.js"
import { el, show } from "./dom.js"
import { cause, cure, number, t } from "./words.js"

const TOUCHES = 5
export const MOST_SPREAD_PX = 1.5
const ZOOM = 8, LOUPE_PX = 400

/** Middle and scatter of touches, px of the camera. @param {[number, number][]} touches */
export function scatter(touches) {
  const mean = (/** @type {number[]} */ values) => values.reduce((sum, one) => sum + one, 0) / values.length
  const middle = /** @type {[number, number]} */ ([mean(touches.map(([x]) => x)), mean(touches.map(([, y]) => y))])
  const away = touches.map(([x, y]) => Math.hypot(x - middle[0], y - middle[1]))
  return { middle, worst: Math.max(...away), sigma: touches.length > 1 ? Math.sqrt(away.reduce((sum, one) => sum + one * one, 0) / (touches.length - 1)) : 0 }
}

/** Place of the camera's picture below a pointer. `pointerup` tells fractions of a CSS pixel, `click` does not.
 * Pixel centres are at integers. @param {HTMLCanvasElement} canvas @param {{ clientX: number, clientY: number }} event @param {number} zoom canvas px a camera px @param {[number, number]} corner */
const placeOf = (canvas, event, zoom, corner) => {
  const seen = canvas.getBoundingClientRect(), scale = (seen.width / canvas.width) * zoom
  return /** @type {[number, number]} */ ([(event.clientX - seen.left) / scale + corner[0] - 0.5, (event.clientY - seen.top) / scale + corner[1] - 0.5])
}

/** @param {any} box @param {any} app */
export function open(box, app) {
  let now = app, asked = "", taught = "", picture = /** @type {ImageBitmap | null} */ (null), job = "", trouble = ""
  let touches = /** @type {[number, number][]} */ ([]), at = /** @type {[number, number]} */ ([0, 0]), old = /** @type {[number, number] | null} */ (null)
  const whole = el("canvas", { class: "teach", role: "img", "aria-label": t("teach.picture"), on: { pointerup: (/** @type {PointerEvent} */ event) => centre(placeOf(whole, event, 1, [0, 0])) } })
  const loupe = el("canvas", { class: "loupe", width: LOUPE_PX, height: LOUPE_PX, tabindex: 0, role: "application", "aria-label": t("teach.loupe"),
    on: { pointerup: (/** @type {PointerEvent} */ event) => add(placeOf(loupe, event, ZOOM, corner())), keydown: keys } })
  const parts = { take: el("section", { class: "panel" }), result: el("section", { class: "panel", "aria-live": "polite" }), made: calibrations(app) }
  const look = el("section", { class: "panel", hidden: true }, el("p", { class: "quiet" }, t("teach.first")), whole)
  const close = el("section", { class: "panel", hidden: true }, el("p", { class: "quiet" }, t("teach.then", { n: TOUCHES })), loupe)
  box.replaceChildren(el("div", { class: "two" }, el("div", { class: "stack" }, parts.take, look), el("div", { class: "stack" }, close, parts.result, parts.made)))

  const half = LOUPE_PX / ZOOM / 2
  const corner = () => /** @type {[number, number]} */ ([Math.round(at[0] - half), Math.round(at[1] - half)])
  /** @param {[number, number]} place */
  function centre(place) {
    if (!picture) return
    at = [Math.min(Math.max(place[0], half), picture.width - half), Math.min(Math.max(place[1], half), picture.height - half)]
    close.hidden = false
    draw()
  }
  /** @param {[number, number]} place */
  function add(place) {
    if (!picture || touches.length >= TOUCHES) return
    touches.push(place)
    update(now)
  }
  let cursor = /** @type {[number, number] | null} */ (null)
  /** @param {KeyboardEvent} event */
  function keys(event) {
    const step = event.shiftKey ? 1 : 1 / ZOOM
    const by = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] })[event.key]
    if (by) cursor = [(cursor ?? at)[0] + by[0], (cursor ?? at)[1] + by[1]]
    else if (event.key === "Enter") add([...(cursor ?? at)])
    else return
    event.preventDefault()
    draw()
  }
  function draw() {
    if (!picture) return
    whole.width = picture.width
    whole.height = picture.height
    const pen = whole.getContext("2d")
    pen.drawImage(picture, 0, 0)
    pen.lineWidth = picture.width / 300
    pen.strokeStyle = "#ffd24d"
    pen.strokeRect(at[0] + 0.5 - half, at[1] + 0.5 - half, 2 * half, 2 * half)
    const [left, top] = corner()
    loupe.dataset.corner = `${left},${top}`
    const close = loupe.getContext("2d")
    close.imageSmoothingEnabled = false
    close.fillRect(0, 0, LOUPE_PX, LOUPE_PX)
    close.drawImage(picture, left, top, LOUPE_PX / ZOOM, LOUPE_PX / ZOOM, 0, 0, LOUPE_PX, LOUPE_PX)
    const cross = (/** @type {[number, number]} */ place, /** @type {string} */ colour, /** @type {number} */ size) => {
      const x = (place[0] + 0.5 - left) * ZOOM, y = (place[1] + 0.5 - top) * ZOOM
      for (const [width, ink] of /** @type {[number, string][]} */ ([[4, "#000"], [1.5, colour]])) {
        close.lineWidth = width
        close.strokeStyle = ink
        close.beginPath()
        close.moveTo(x - size, y)
        close.lineTo(x + size, y)
        close.moveTo(x, y - size)
        close.lineTo(x, y + size)
        close.stroke()
      }
    }
    if (old) cross(old, "#7ab6f5", 40)
    for (const touch of touches) cross(touch, "#fff", 10)
    if (touches.length) cross(scatter(touches).middle, "#ffd24d", 22)
    if (cursor) cross(cursor, "#7dff8a", 6)
  }
  async function load(/** @type {any} */ result) {
    trouble = ""
    try {
      const response = await waited(`/picture?${new URLSearchParams({ id: result.id, which: "before-white" })}`)
      picture = await createImageBitmap(await response.blob())
      touches = []
      old = result.detail?.tip_px ?? null
      job = result.id
      look.hidden = false
      centre(old ?? [picture.width / 2, picture.height / 2])
    } catch (error) {
      trouble = inWords(/** @type {any} */ (error).error ?? { name: "unknown_picture" })
    }
    update(now)
  }
  function take() {
    asked = jobKey("look")
    post("/order", { order: "look", id: asked }).catch((error) => ((asked = ""), tell(error), update(now)))
    update(now)
  }
  function teach() {
    taught = jobKey("teach")
    post("/order", { order: "teach", id: taught, tip_px: scatter(touches).middle }).catch((error) => ((taught = ""), tell(error), update(now)))
  }

  /** @param {any} app */
  function update(app) {
    now = app
    const { station } = app
    const ended = station.results?.find((/** @type {any} */ one) => one.id === asked)
    if (ended) {
      asked = ""
      if (ended.ok) load(ended)
      else trouble = `${cause(ended.error)}. ${cure(ended.error)}`
    }
    const end = station.results?.find((/** @type {any} */ one) => one.id === taught)
    const idle = app.live && !station.job && !station.fault
    // What moved since the picture was taken, moved the needle in it: only what nothing came after may be taught.
    const fresh = !!job && station.results?.[0]?.id === job
    show(parts.take, [idle, !!asked, trouble, app.language], () => [el("h2", {}, t("teach")), el("p", {}, t("teach.how")), trouble ? el("p", { class: "said", role: "alert" }, trouble) : null,
      el("div", { class: "orders" }, el("button", { type: "button", class: "order", id: "teach-take", disabled: !idle || !!asked, on: { click: take } }, t("teach.take")))])
    show(parts.result, [touches, old, fresh, idle, job, end?.id, app.language], () => result(fresh, idle, end))
    parts.made.follow(app)
    draw()
  }
  /** @param {boolean} fresh @param {boolean} idle @param {any} end */
  function result(fresh, idle, end) {
    const out = [el("h2", {}, t("teach.touches", { n: touches.length, of: TOUCHES }))]
    if (end) out.push(el("p", { class: end.ok ? "what" : "what said", id: "taught" }, end.ok ? t("teach.taught") : refused(end.error)))
    if (!job) return [...out, el("p", { class: "quiet" }, t("teach.no_picture"))]
    if (touches.length) {
      const { middle, worst, sigma } = scatter(touches)
      const facts = [["teach.middle", `${number(middle[0], 2)} / ${number(middle[1], 2)} px`], ["teach.sigma", `${number(sigma, 2)} px`], ["teach.worst", `${number(worst, 2)} px`],
        ...(old ? [["teach.old", `${number(old[0], 2)} / ${number(old[1], 2)} px`], ["teach.moved", `${number(Math.hypot(middle[0] - old[0], middle[1] - old[1]), 2)} px`]] : [])]
      out.push(el("dl", { id: "scatter", "data-middle": JSON.stringify(middle) }, ...facts.flatMap(([key, value]) => [el("dt", {}, t(key)), el("dd", {}, value)])), plot(touches, middle))
      if (touches.length === TOUCHES && worst > MOST_SPREAD_PX) out.push(el("p", { class: "said", role: "alert" }, t("teach.far", { px: number(MOST_SPREAD_PX, 1) })))
    }
    if (!fresh && !end) out.push(el("p", { class: "said", role: "alert" }, t("teach.stale")))
    const good = touches.length === TOUCHES && scatter(touches).worst <= MOST_SPREAD_PX
    out.push(el("div", { class: "orders" }, el("button", { type: "button", id: "teach-again", disabled: !touches.length, on: { click: () => ((touches = []), update(now)) } }, t("teach.clear")),
      el("button", { type: "button", class: "order", id: "teach-tip", disabled: !good || !fresh || !idle, on: { click: () => confirm(t("teach.ask"), "teach.tip", teach) } }, t("teach.tip"))))
    return out
  }
  return update
}

/** A picture is written after its job was answered: asked for until it is there. @param {string} path */
async function waited(path) {
  for (let n = 0; ; n += 1) {
    const response = await fetch(path)
    if (response.ok) return response
    if (n === 20) throw Object.assign(new Error("no picture"), { error: (await response.json().catch(() => ({}))).error })
    await new Promise((later) => setTimeout(later, 250))
  }
}

/** The touches about their middle, with the circle they have to lie in. @param {[number, number][]} touches @param {[number, number]} middle */
function plot(touches, middle) {
  const svg = (/** @type {string} */ tag, /** @type {Record<string, any>} */ props) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", tag)
    for (const [name, value] of Object.entries(props)) node.setAttribute(name, String(value))
    return node
  }
  const root = svg("svg", { class: "scatter", viewBox: "-3 -3 6 6", role: "img", "aria-label": t("teach.plot", { n: touches.length }) })
  root.append(svg("circle", { r: MOST_SPREAD_PX, class: "limit" }), svg("path", { d: "M-3 0H3M0 -3V3", class: "axis" }),
    ...touches.map(([x, y]) => svg("circle", { cx: Math.max(-2.9, Math.min(2.9, x - middle[0])), cy: Math.max(-2.9, Math.min(2.9, y - middle[1])), r: 0.12, class: "touch" })))
  return root
}

/** Why a tip was not taught. A bright pad below the needle hides its end: that is no fault of the person who touched.
 * @param {any} error */
const refused = (error) => `${cause(error)}. ${error.name === "calibration_failed" ? t("teach.refused") : cure(error)}`
