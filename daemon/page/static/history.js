// Screen History: results by point, board, operation and outcome, newest first.
// @ts-check
import { get } from "./ask.js"
import { inWords } from "./dialogs.js"
import { el } from "./dom.js"
import { mark, more, numbers, word } from "./verdict.js"
import { day, t, tOr } from "./words.js"

const FIELDS = ["test_point", "board_id", "of", "outcome"]

/** @param {any} box */
export function open(box) {
  const inputs = Object.fromEntries(FIELDS.map((name) => [name, el("input", { name, maxlength: 64 })]))
  const rows = el("tbody")
  const more = el("button", { type: "button", hidden: true, on: { click: () => load(last) } }, t("older"))
  const said = el("p", { class: "quiet", role: "status" })
  const csv = el("a", { class: "button", download: "history.csv" }, t("csv"))
  /** @type {number | undefined} */
  let last
  const asked = () => Object.fromEntries(FIELDS.map((name) => [name, inputs[name].value.trim()]))

  /** @param {number} [before] */
  async function load(before) {
    csv.href = `/history.csv?${new URLSearchParams(Object.entries(asked()).filter(([, value]) => value))}`
    try {
      const found = await get("/history", { ...asked(), before })
      if (before === undefined) rows.replaceChildren()
      rows.append(...found.results.map(line))
      last = found.results.at(-1)?.seq
      more.hidden = !found.more
      said.textContent = rows.children.length ? "" : t("no_result")
    } catch (error) {
      said.textContent = inWords(/** @type {any} */ (error).error)
    }
  }
  box.replaceChildren(
    el("form", { class: "filter", on: { submit: (/** @type {Event} */ event) => (event.preventDefault(), load()) } },
      ...FIELDS.map((name) => el("label", {}, t(`field.${name}`), inputs[name])), el("button", {}, t("find")), csv),
    el("div", { class: "panel" }, el("table", { id: "history" },
      el("thead", {}, el("tr", {}, ...["", "when", "field.of", "field.test_point", "field.board_id", "field.outcome", "error_um"].map((key) =>
        el("th", { scope: "col", class: key === "error_um" ? "number" : null }, key ? t(key) : el("span", { class: "hidden" }, t("verdict")))))), rows), said, more))
  load()
  return () => undefined
}

/** @param {any} result */
function line(result) {
  return el("tr", {}, el("td", {}, mark(result)), el("td", {}, day(result.finished_at)), el("td", {}, tOr(`op.${result.op}`, result.op)),
    el("td", {}, more(result)), el("td", {}, result.board_id ?? ""), el("td", {}, word(result)), el("td", { class: "number" }, numbers(result)))
}
