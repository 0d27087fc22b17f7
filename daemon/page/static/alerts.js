// Screen Alerts: what stands, worst first, with what to do.
// @ts-check
import { post } from "./ask.js"
import { noteTo } from "./dialogs.js"
import { el, show } from "./dom.js"
import { day, number, t, unit, watchWords } from "./words.js"

/** @param {any} box */
export function open(box) {
  const standing = el("section", { "aria-label": t("screen.alerts") })
  box.replaceChildren(standing, el("p", {}, el("a", { class: "button", href: "#watches" }, t("screen.watches"))))
  /** @param {any} app */
  return (app) => {
    const alerts = app.station.alerts ?? []
    show(standing, [alerts, app.me.role, app.live, app.language], () =>
      alerts.length ? alerts.map((/** @type {any} */ alert) => card(alert, app)) : [el("p", { class: "panel" }, t("alerts.none"))])
  }
}

/** @param {any} alert @param {any} app */
function card(alert, app) {
  const usual = alert.usual == null ? "" : ` · ${t("usual")} ${number(alert.usual, 2)}`
  const orders = []
  if (app.may("operate")) orders.push(button(alert, "acknowledge", app))
  if (app.may("maintain")) orders.push(button(alert, "mended", app))
  return el("article", { class: `panel alert ${alert.severity}`, "data-alert": alert.name },
    el("h2", {}, `${t(`severity.${alert.severity}`)}: ${watchWords(alert).what}`),
    el("dl", {},
      // What the daemon tells of itself is a fact, and has no figure.
      ...(alert.group === "daemon" ? [] : [el("dt", {}, t("figure")), el("dd", {}, `${number(alert.figure, 2)} ${unit(alert.unit)}${usual} · ${t("limit")} ${number(alert.limit, 2)}`)]),
      el("dt", {}, t("since")), el("dd", {}, day(alert.since_at)),
      el("dt", {}, t("do_now")), el("dd", {}, watchWords(alert).advice),
      el("dt", {}, t("evidence")), el("dd", {}, alert.evidence.join(", ")),
      ...(alert.acknowledged ? [el("dt", {}, t("known_by")),
        el("dd", {}, `${alert.acknowledged.by}, ${day(alert.acknowledged.at)}${alert.acknowledged.note ? `: ${alert.acknowledged.note}` : ""}`)] : [])),
    orders.length ? el("div", { class: "orders" }, ...orders) : null)
}

/** @param {any} alert @param {string} name @param {any} app */
function button(alert, name, app) {
  const send = (/** @type {string} */ note) => post("/order", { order: name, alert: alert.name, note })
  return el("button", { type: "button", disabled: !app.live, on: { click: () => noteTo(t(`order.${name}`), send) } }, t(`order.${name}`))
}
