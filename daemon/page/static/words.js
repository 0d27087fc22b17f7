// Words of the chosen language, and numbers and times as it writes them.
// @ts-check

const LANGUAGES = ["en", "de"]
/** @type {Record<string, string>} */
let words = {}
let language = "en"
/** Of numbers and dates: the reader's own, where it is of the language. */
let locale = "en"

/** @param {string} [wanted] */
export async function speak(wanted) {
  const asked = wanted ?? localStorage.getItem("language") ?? navigator.language.slice(0, 2)
  language = LANGUAGES.includes(asked) ? asked : "en"
  locale = navigator.languages.find((one) => one.split("-")[0] === language) ?? language
  words = await (await fetch(`/words/${language}.json`)).json()
  document.documentElement.lang = language
  if (wanted) localStorage.setItem("language", language)
}

export const other = () => (language === "en" ? "de" : "en")

/** @param {string} key @param {Record<string, any>} [facts] @returns {string} */
export function t(key, facts = {}) {
  return (words[key] ?? key).replace(/\{(\w+)\}/g, (_, name) => String(facts[name] ?? ""))
}

/** @param {string} key @param {string} fallback */
export const tOr = (key, fallback) => words[key] ?? fallback

/** @param {number | null | undefined} value @param {number} [digits] */
export const number = (value, digits = 1) =>
  value === null || value === undefined
    ? ""
    : new Intl.NumberFormat(locale, { maximumFractionDigits: digits, minimumFractionDigits: digits }).format(value)

/** @param {string | null} iso the station's own time */
export const clock = (iso) =>
  iso ? new Intl.DateTimeFormat(locale, { timeStyle: "medium", hourCycle: "h23" }).format(new Date(iso)) : ""

/** @param {string | null} iso */
export const day = (iso) =>
  iso
    ? new Intl.DateTimeFormat(locale, { dateStyle: "short", timeStyle: "medium", hourCycle: "h23" }).format(new Date(iso))
    : ""

/** Cause of an error in the reader's language; the daemon's sentence where there is none.
 * @param {any} error */
export function cause(error) {
  const text = tOr(`error.${error.name}`, error.message ?? error.name)
  const axis = error.detail?.axis
  return axis ? `${text} (${t("axis")} ${String(axis).toUpperCase()})` : text
}

/** @param {any} error */
export const cure = (error) => tOr(`cure.${error.name}`, error.advice ?? "")

const WATCHES_OF = /^(placement_at|bus_timeouts|bus_garbled|arrival|following|drive)_(.+)$/
const SECTOR_DEG = 45

/** What a watch follows, and what to do once it raised an alert; the daemon's words where there are none.
 * @param {{ name: string, what?: string, advice?: string }} watch */
export function watchWords(watch) {
  const [, kind, part] = WATCHES_OF.exec(watch.name) ?? [watch.name, watch.name, ""]
  const of = kind === "placement_at" ? `${Number(part)}\u2013${Number(part) + SECTOR_DEG}\u00b0` : part === "theta" ? "\u03b8" : kind.startsWith("bus") ? part : part.toUpperCase()
  const said = (/** @type {string} */ key, /** @type {string} */ fallback) => (words[`${key}.${kind}`] ? t(`${key}.${kind}`, { of }) : fallback)
  return { what: said("watch", watch.what ?? watch.name), advice: said("advice", watch.advice ?? "") }
}

/** A unit of the wire as people write it. @param {string} name */
export const unit = (name) => tOr(`unit.${name}`, name)

/** @param {string} month such as 2026-11 */
export const monthName = (month) => new Intl.DateTimeFormat(locale, { month: "long", year: "numeric", timeZone: "UTC" }).format(new Date(`${month}-01T00:00:00Z`))
