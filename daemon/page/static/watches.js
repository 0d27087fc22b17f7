// Screen Watches: how every watch stands, how much it has learned, where its figure lies between its limits.
// @ts-check
import { get } from "./ask.js"
import { inWords } from "./dialogs.js"
import { el, show, svg } from "./dom.js"
import { monthName, number, t, tOr, unit, watchWords } from "./words.js"

/** @param {any} box */
export function open(box) {
  const life = el("section", { class: "panel" }), watches = el("section", { class: "panel" })
  box.replaceChildren(el("div", { class: "stack" }, life, watches, courses()))
  return (/** @type {any} */ { station, language }) => {
    show(life, [station.touches, language], () => [el("h2", {}, t("service.touches")), el("p", { class: "big" }, number(station.touches, 0))])
    show(watches, [station.watches, language], () => [el("h2", {}, t("watches")), el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": t("watches") }, table(station.watches ?? []))])
  }
}

/** Where a figure lies: the bar is from limit to limit, the line the usual one, the dot the figure now. @param {any} watch */
function gauge(watch) {
  const { low, high, figure, usual } = watch
  const known = [low, high, figure, usual].filter((one) => one != null)
  if (figure == null || known.length < 2) return ""
  const least = Math.min(...known), span = Math.max(...known) - least || 1
  const at = (/** @type {number} */ value) => 4 + (92 * (value - least)) / span
  return svg("svg", { class: "gauge", viewBox: "0 0 100 20", "aria-hidden": "true" },
    svg("rect", { class: "range", x: at(low ?? least), y: 7, width: Math.max(at(high ?? least + span) - at(low ?? least), 0.5), height: 6 }),
    usual == null ? null : svg("rect", { class: "usual", x: at(usual) - 1, y: 3, width: 2, height: 14 }),
    svg("circle", { class: watch.state === "alert" ? "now alert" : "now", cx: at(figure), cy: 10, r: 5 }))
}

/** @param {any[]} watches */
function table(watches) {
  const rows = [...watches].sort((a, b) => Number(b.state === "alert") - Number(a.state === "alert"))
  return el("table", {}, el("thead", {}, el("tr", {}, ...["watch", "state", "figure", "usual", "limit", "within"].map((word, n) =>
    el("th", { scope: "col", class: n > 1 && n < 5 ? "number" : null }, t(word))))),
    el("tbody", {}, ...rows.map((watch) => el("tr", { "data-watch": watch.name },
      el("td", {}, watchWords(watch).what),
      el("td", {}, watch.state === "learning" ? t("watch.learning", { share: Math.round(watch.learned * 100) }) : t(`watch.${watch.state}`)),
      el("td", { class: "number" }, watch.figure == null ? "" : `${number(watch.figure, 2)} ${unit(watch.unit)}`),
      el("td", { class: "number" }, number(watch.usual, 2)),
      el("td", { class: "number" }, [watch.low, watch.high].filter((n) => n != null).map((n) => number(n, 2)).join(" … ")), el("td", {}, gauge(watch))))))
}

/** The courses of a month, drawn by the station as in its report, when asked for. */
function courses() {
  const said = el("p", { class: "quiet", role: "status" }), drawn = el("div", { id: "charts" })
  const asked = el("input", { type: "month", name: "month", value: new Date().toISOString().slice(0, 7) })
  const button = el("button", { type: "button", id: "draw", on: { click: draw } }, t("charts.draw"))
  async function draw() {
    button.disabled = true
    said.textContent = t("charts.drawing")
    try {
      const { month, charts } = await get("/charts", { month: asked.value })
      said.textContent = charts.length ? monthName(month) : t("charts.none", { month: monthName(month) })
      drawn.replaceChildren(...charts.map(chart))
    } catch (error) {
      said.textContent = inWords(/** @type {any} */ (error).error)
    }
    button.disabled = false
  }
  return el("section", { class: "panel" }, el("h2", {}, t("charts")),
    el("div", { class: "filter" }, el("label", {}, t("charts.month"), asked), button), said, drawn)
}

/** As a picture, it can bring no script into the page. @param {any} one */
function chart(one) {
  const url = URL.createObjectURL(new Blob([one.svg], { type: "image/svg+xml" }))
  const free = () => URL.revokeObjectURL(url)
  return el("figure", {}, el("h3", {}, tOr(`charts.${one.group}`, one.title)), el("img", { class: "chart", src: url, alt: one.title, on: { load: free, error: free } }))
}
