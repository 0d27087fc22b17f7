// How a result, and the test of a point, is said: word, mark, numbers. Never by colour alone.
// @ts-check
import { details } from "./dialogs.js"
import { el } from "./dom.js"
import { cause, cure, number, t, tOr } from "./words.js"

/** Verdict of a point on the wire -> how it is shown. @type {Record<string, string>} */
export const KIND_OF_VERDICT = {
  pass_first: "pass", pass_recovered: "recovered", fail: "bad", open_confirmed: "open", contact_not_made: "no_contact", not_tested: "not_tested",
}
const MARKS = /** @type {Record<string, string>} */ ({ pass: "○", recovered: "◆", bad: "■", open: "✕", no_contact: "▲", not_tested: "●" })

/** @param {any} result */
export function kindOf(result) {
  if (result.op === "probe" && result.outcome in KIND_OF_VERDICT) return KIND_OF_VERDICT[result.outcome]
  if (result.ok && result.op === "run") return kindOfRun(result.detail?.summary, result.outcome)
  if (!result.ok) return result.error?.name === "cancelled" ? "not_tested" : "bad"
  return result.op === "correct" && result.moves > 0 ? "recovered" : "pass"
}

/** A run ends well as a job however its board is: what its points say counts. @param {any} summary @param {string} outcome */
function kindOfRun(summary, outcome) {
  if (!summary) return "not_tested"
  if (summary.failed || summary.opens_confirmed) return "bad"
  return outcome === "run_done" && !summary.contact_not_made && !summary.not_tested ? "pass" : "not_tested"
}

/** @param {string} kind */
export const markOf = (kind) => el("span", { class: `mark ${kind}`, role: "img", "aria-label": t(`verdict.${kind}`) }, MARKS[kind])
/** @param {any} result */
export const mark = (result) => markOf(kindOf(result))

/** @param {any} result */
export const word = (result) => (result.ok ? tOr(`outcome.${result.outcome}`, result.outcome) : cause(result.error ?? { name: "failed" }))

/** A look measures once and moves nothing: it has no error afterwards. @param {any} result */
export const numbers = (result) => {
  const [before, after] = [result.error_before_um, result.error_after_um]
  if (before == null) return ""
  return after == null ? t("before_only", { before: number(before) }) : t("before_after", { before: number(before), after: number(after) })
}

/** A button that shows all of a result. @param {any} result */
export const more = (result) => {
  const name = result.test_point ?? tOr(`op.${result.op}`, result.op)
  const text = [word(result), result.error ? cure(result.error) : "", numbers(result)].filter(Boolean).join(". ")
  return el("button", { type: "button", on: { click: () => details(result.id, name, text) } }, name)
}

const PREFIXES = /** @type {[number, string][]} */ ([[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]])

/** A measured value with its unit, three digits. @param {any} reading */
export function reading(reading) {
  if (!reading) return ""
  if (reading.overload) return t("overload")
  if (reading.value == null) return reading.said ?? ""
  const unit = reading.unit === "ohm" ? "Ω" : (reading.unit ?? "")
  const [factor, prefix] = PREFIXES.find(([one]) => Math.abs(reading.value) >= one) ?? [1, ""]
  const value = reading.value / factor
  return `${number(value, Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : 2)} ${prefix}${unit}`
}

/** What stands beside the verdict of a tested point: what helped, what was wrong. @param {any} record */
export function why(record) {
  const helped = record.recovered_by ? t("helped", { rung: tOr(`rung.${record.recovered_by}`, record.recovered_by) }) : ""
  const fault = record.cause ? tOr(`cause.${record.cause}`, record.cause) : ""
  return [helped, fault, record.reason].filter(Boolean).join("; ")
}
