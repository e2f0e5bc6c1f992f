// Search in pages opened from a folder: browsers start no Worker there, so its script runs in a frame.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const element = document.createElement("iframe")
      element.hidden = true
      document.body.appendChild(element)
      const frame = element.contentWindow
      const load = (script) =>
        new Promise((loaded) => {
          const added = frame.document.createElement("script")
          added.src = script
          added.onload = loaded
          frame.document.body.appendChild(added)
        })
      frame.importScripts = (...scripts) =>
        scripts.reduce((before, each) => before.then(() => load(each)), Promise.resolve())
      frame.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }))
      this.frame = frame
      this.ready = load(url)
    }

    postMessage(data) {
      this.ready.then(() => this.frame.dispatchEvent(new MessageEvent("message", { data })))
    }
  }
}
