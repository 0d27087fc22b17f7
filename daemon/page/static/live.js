// Live picture: drawn while it is looked at; the next one is asked for after the last was drawn. Never turned or mirrored.
// @ts-check
import { post } from "./ask.js"
import { tell } from "./dialogs.js"
import { el, show } from "./dom.js"
import { clock, number, t } from "./words.js"

const AGAIN_MS = 1000
/** Side of the magnified part, of the picture's height, and the fewest pixels of the picture that it shows. */
const GLASS = 0.45, LEAST_PX = 24

export function open() {
  const canvas = el("canvas", { class: "live", role: "img", "aria-label": t("live") })
  const said = el("p", { class: "quiet", role: "status" })
  const lamps = el("div", { class: "orders" })
  const box = el("section", { class: "panel" }, canvas, said, lamps)
  let n = 0
  let station = ""
  let on = false
  let running = false

  async function run() {
    if (running) return
    running = true
    while (on && box.isConnected) {
      if (document.hidden) {
        await new Promise((seen) => document.addEventListener("visibilitychange", seen, { once: true }))
        continue
      }
      try {
        const response = await fetch(`/frame.jpg?after=${n}`)
        if (response.status !== 200) throw new Error("no picture")
        const header = JSON.parse(response.headers.get("x-frame") ?? "{}")
        const bitmap = await createImageBitmap(await response.blob())
        n = header.n
        draw(bitmap, header)
        bitmap.close()
        box.classList.remove("old")
        said.textContent = [clock(header.exposed_at), header.aim && t("live.off", { um: number(header.aim.off_um) }), station === "idle" && t("live.dark")].filter(Boolean).join(" · ")
      } catch {
        box.classList.add("old")
        said.textContent = t("live.none")
        await new Promise((later) => setTimeout(later, AGAIN_MS))
      }
    }
    running = false
  }

  /** @param {ImageBitmap} bitmap @param {any} header */
  function draw(bitmap, header) {
    if (canvas.width !== bitmap.width) canvas.width = bitmap.width
    if (canvas.height !== bitmap.height) canvas.height = bitmap.height
    const pen = canvas.getContext("2d")
    pen.drawImage(bitmap, 0, 0)
    if (header.tip_px) {
      pen.beginPath()
      circle(pen, header.tip_px, bitmap.width / 60)
      line(pen, "#7ab6f5", bitmap.width / 400)
    }
    if (header.aim) drawAim(pen, bitmap, header.aim)
  }
  return {
    box,
    /** @param {any} app */
    follow(app) {
      on = app.live
      station = app.station.state
      box.classList.toggle("old", !on)
      const idle = on && app.station.state === "idle" && !app.station.fault
      show(lamps, [app.may("operate"), idle, app.language], () => (app.may("operate") ? ["white", "red"].map((colour) => lamp(colour, idle)) : []))
      if (on) run()
    },
  }
}

/** The way from the place below the needle to the target, and the circle within which a landing is good: both are a few
 * pixels long, so they are drawn in a magnified part of the picture. @param {any} pen @param {ImageBitmap} bitmap @param {any} aim */
function drawAim(pen, bitmap, aim) {
  const [x, y] = aim.target_px, [fromX, fromY] = aim.at_px
  const span = Math.max(LEAST_PX, 3 * Math.hypot(fromX - x, fromY - y), 3 * aim.tolerance_px)
  const size = GLASS * bitmap.height, zoom = size / span
  // In the corner that lies away from the target.
  const left = x > bitmap.width / 2 ? 0 : bitmap.width - size, top = y > bitmap.height / 2 ? 0 : bitmap.height - size
  pen.save()
  pen.beginPath()
  pen.rect(left, top, size, size)
  line(pen, "#fff", bitmap.width / 300)
  pen.clip()
  pen.imageSmoothingEnabled = false
  pen.drawImage(bitmap, x + 0.5 - span / 2, y + 0.5 - span / 2, span, span, left, top, size, size)
  pen.translate(left + size / 2, top + size / 2)
  const at = /** @type {[number, number]} */ ([(fromX - x) * zoom - 0.5, (fromY - y) * zoom - 0.5]), middle = /** @type {[number, number]} */ ([-0.5, -0.5])
  const colour = Math.hypot(fromX - x, fromY - y) > aim.tolerance_px ? "#f2b01e" : "#fff"
  pen.beginPath()
  circle(pen, middle, aim.tolerance_px * zoom)
  line(pen, "#fff", size / 80)
  pen.beginPath()
  arrow(pen, at, middle, size / 14)
  line(pen, colour, size / 60)
  pen.restore()
}

/** Pixel centres are at integers; the canvas has them at halves. @param {any} pen @param {[number, number]} middle @param {number} radius */
const circle = (pen, [x, y], radius) => (pen.moveTo(x + 0.5 + radius, y + 0.5), pen.arc(x + 0.5, y + 0.5, radius, 0, 2 * Math.PI))

/** @param {any} pen @param {[number, number]} from @param {[number, number]} to @param {number} head */
function arrow(pen, [fromX, fromY], [toX, toY], head) {
  const turn = Math.atan2(toY - fromY, toX - fromX), most = Math.min(head, Math.hypot(toX - fromX, toY - fromY) / 2)
  pen.moveTo(fromX + 0.5, fromY + 0.5)
  for (const side of [0, 2.6, -2.6]) {
    if (side) pen.moveTo(toX + 0.5, toY + 0.5)
    pen.lineTo(toX + 0.5 + (side ? most * Math.cos(turn + side) : 0), toY + 0.5 + (side ? most * Math.sin(turn + side) : 0))
  }
}

/** Stroke what was drawn, with a dark edge: it has to be seen on bright copper and in the dark. @param {any} pen @param {string} colour @param {number} width */
function line(pen, colour, width) {
  for (const [style, wide] of [["#000", 2 * width], [colour, width]]) Object.assign(pen, { strokeStyle: style, lineWidth: wide }).stroke()
}

/** @param {string} colour @param {boolean} idle */
const lamp = (colour, idle) =>
  el("button", { type: "button", class: "order", disabled: !idle, on: { click: () => post("/order", { order: "light", colour }).catch(tell) } }, t(`light.${colour}`))
