// Screen Who did what: orders, newest first.
// @ts-check
import { get } from "./ask.js"
import { inWords } from "./dialogs.js"
import { el } from "./dom.js"
import { day, t, tOr } from "./words.js"

/** @param {any} box */
export function open(box) {
  const rows = el("tbody")
  const said = el("p", { class: "quiet", role: "status" })
  box.replaceChildren(el("div", { class: "panel", tabindex: 0, role: "region", "aria-label": t("screen.audit") }, el("table", { id: "audit" }, el("thead", {}, el("tr", {},
    ...["when", "person", "client", "field.of", "fields", "field.outcome"].map((key) => el("th", { scope: "col" }, t(key))))), rows), said))
  get("/audit").then((found) => rows.append(...found.entries.map(line)), (error) => (said.textContent = inWords(error.error)))
  return () => undefined
}

/** @param {any} entry */
function line(entry) {
  const { what, ...told } = entry.fields
  const noted = entry.op === "note"
  const facts = [noted ? told.detail : what && tOr(`made.${what}`, what),
    ...Object.entries(told).filter(([name]) => name !== "id" && !(noted && name === "detail")).map(([name, value]) => `${tOr(`fact.${name}`, name)} ${value}`)].filter(Boolean).join(", ")
  return el("tr", {}, ...[day(entry.at), entry.by ?? "", `${entry.client} (${t(`role.${entry.role}`)})`, noted ? tOr(`note.${what}`, what) : tOr(`op.${entry.op}`, entry.op), facts,
    tOr(`outcome.${entry.outcome}`, tOr(`error.${entry.outcome}`, entry.outcome ?? ""))].map((text) => el("td", {}, text)))
}
