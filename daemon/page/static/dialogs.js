// Dialogs: login, a second question before the head moves, a note to an alert, an error.
// @ts-check
import { Refused, get, post } from "./ask.js"
import { byId, el } from "./dom.js"
import { cause, cure, t } from "./words.js"

const dialog = byId("dialog")

/** @param {string} title @param {(said: HTMLElement) => any[]} make */
function open(title, make) {
  const said = el("p", { class: "said", role: "alert" })
  dialog.replaceChildren(el("form", { method: "dialog", "aria-label": title, on: { submit: stop } }, el("h2", {}, title), ...make(said)))
  if (!dialog.open) dialog.showModal()
}
/** @param {Event} event */
const stop = (event) => event.preventDefault()
export const close = () => dialog.open && dialog.close()
const closer = (word = "cancel") => el("button", { type: "button", on: { click: close } }, t(word))

/** @param {any} error */
export const inWords = (error) => [cause(error), cure(error)].filter(Boolean).join(". ")

/** @param {any} error */
export function tell(error) {
  const facts = error instanceof Refused ? error.error : { name: "no_page" }
  open(t("refused"), () => [el("p", { class: "what" }, cause(facts)), el("p", {}, cure(facts)), closer("close")])
}

/** @param {() => void} done */
export function login(done) {
  open(t("login"), (said) => {
    const name = el("input", { name: "name", autocomplete: "username", required: "", maxlength: 48 })
    const secret = el("input", { name: "secret", type: "password", autocomplete: "current-password", required: "" })
    const go = el("button", {}, t("login"))
    go.addEventListener("click", async () => {
      go.disabled = true
      try {
        await post("/login", { name: name.value, secret: secret.value })
        close()
        done()
      } catch (error) {
        const facts = error instanceof Refused ? error.error : { name: "no_page" }
        said.textContent = t(`login.${facts.name}`, facts)
        secret.value = ""
        secret.focus()
      }
      go.disabled = false
    })
    return [el("label", {}, t("name"), name), el("label", {}, t("secret"), secret), said, el("div", { class: "orders" }, go, closer())]
  })
}

/** Ask a second time, at another place than the first touch was. @param {string} question @param {string} word @param {() => void} then */
export function confirm(question, word, then) {
  open(question, () => [
    el("div", { class: "orders" }, closer(), el("button", { type: "button", id: "confirm", on: { click: () => (close(), then()) } }, t(word))),
  ])
}

/** @param {string} title @param {(note: string) => Promise<any>} send @param {string} [word] what the text is called; then it is wanted */
export function noteTo(title, send, word) {
  open(title, (said) => {
    const note = el("textarea", { name: "note", rows: 3, maxlength: 500 })
    const go = el("button", { type: "button" }, t("save"))
    if (word) note.required = true
    go.addEventListener("click", () => note.reportValidity() && send(note.value).then(close, (/** @type {any} */ error) => (said.textContent = inWords(error.error))))
    return [el("label", {}, t(word ?? "note"), note), said, el("div", { class: "orders" }, go, closer())]
  })
}

/** The pictures that are kept under an id; those that cannot be had say why. @param {string} id */
export function picturesOf(id) {
  const pictures = el("div", { class: "pictures" })
  get("/pictures", { id }).then(
    (kept) => pictures.append(...(kept.pictures.length ? kept.pictures.map((/** @type {string} */ which) => figure(id, which)) : [el("p", { class: "quiet" }, t("picture.none"))])),
    (error) => pictures.append(inWords(error.error)))
  return pictures
}

/** @param {string} id @param {string} which */
function figure(id, which) {
  const [when, what] = which.split("-")
  const said = `${t(`picture.${when}`)}: ${t(`picture.${what}`)}`
  const image = el("img", { src: `/picture?${new URLSearchParams({ id, which })}`, alt: said, loading: "lazy" })
  image.addEventListener("error", () => image.replaceWith(el("p", { class: "quiet" }, t("picture.gone"))))
  return el("figure", {}, image, el("figcaption", {}, said))
}

/** All that is known of one result, with its pictures. @param {string} id @param {string} title @param {string} text */
export function details(id, title, text) {
  open(title, () => [el("p", {}, text), el("p", { class: "quiet" }, id), picturesOf(id), closer("close")])
}

/** @param {string} title @param {string} text @param {() => void} then */
export function mustRead(title, text, then) {
  open(title, () => [el("p", {}, text), el("button", { type: "button", on: { click: () => (close(), then()) } }, t("have_read"))])
}
