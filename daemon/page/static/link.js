// The one connection of a tab: the station as the page sends it, and whether it is still heard.
// @ts-check

const SILENT_MS = 3000
const FIRST_MS = 250
const LONGEST_MS = 4000

/**
 * @param {{ onMessage: (message: any) => void, onLink: (linked: boolean) => void }} to
 */
export function follow(to) {
  let wait = FIRST_MS
  /** @type {boolean | null} null: nothing was heard yet, and nothing lost */
  let linked = null
  let silent = 0
  /** @type {WebSocket | undefined} */
  let socket

  /** @param {boolean} now */
  function tell(now) {
    if (now === linked) return
    linked = now
    to.onLink(now)
  }
  function heard() {
    clearTimeout(silent)
    silent = setTimeout(() => socket?.close(), SILENT_MS)
    wait = FIRST_MS
    tell(true)
  }
  function open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws"
    const mine = (socket = new WebSocket(`${scheme}://${location.host}/live`))
    silent = setTimeout(() => mine.close(), SILENT_MS)
    mine.onmessage = (event) => {
      if (mine !== socket) return
      to.onMessage(JSON.parse(event.data))
      heard()
    }
    mine.onclose = () => {
      if (mine !== socket) return
      clearTimeout(silent)
      tell(false)
      socket = undefined
      setTimeout(open, wait)
      wait = Math.min(wait * 2, LONGEST_MS)
    }
  }
  open()
  return {
    /** Connect anew, as another person. */
    again() {
      const old = socket
      socket = undefined
      clearTimeout(silent)
      old?.close()
      open()
    },
  }
}
