// Requests of a tab beside its connection: orders, the person, what is looked up.
// @ts-check

/** @type {string | null} */
let token = null
/** @param {string | null} now */
export const useToken = (now) => (token = now)

/** An answer that is a refusal: `error` has name, and from the daemon cause and cure. */
export class Refused extends Error {
  /** @param {any} error @param {number} status */
  constructor(error, status) {
    super(error.name)
    this.error = error
    this.status = status
  }
}

/** @param {string} path @param {any} body */
export async function post(path, body = {}) {
  return taken(() =>
    fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json", ...(token ? { "X-Token": token } : {}) },
      body: JSON.stringify(body),
    }),
  )
}

/** @param {string} path @param {Record<string, any>} [query] */
export async function get(path, query = {}) {
  const asked = new URLSearchParams(Object.entries(query).filter(([, value]) => value !== "" && value != null))
  return taken(() => fetch(`${path}?${asked}`))
}

/** @param {() => Promise<Response>} send */
async function taken(send) {
  let response
  try {
    response = await send()
  } catch {
    throw new Refused({ name: "no_page" }, 0)
  }
  const body = await response.json().catch(() => ({}))
  if (!response.ok) throw new Refused(body.error ?? { name: "no_page" }, response.status)
  return body
}

/** A key for a job, so that an order that is sent twice is carried out once. @param {string} op */
export const jobKey = (op) =>
  `${op}-${Array.from(crypto.getRandomValues(new Uint8Array(8)), (byte) => byte.toString(16).padStart(2, "0")).join("")}`
