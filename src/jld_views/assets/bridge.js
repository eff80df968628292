// @ts-check
/** A widget of anywidget: between the page of a notebook, in its frame, and the kernel. */

/** @param {{model: any, el: HTMLElement}} given */
function render({ model, el }) {
  const name = model.get("page");
  const place = () => document.querySelector(`[data-jld="${name}"]`) ?? el;
  const frame = () => place().querySelector("iframe");
  const tell = (/** @type {any} */ message) => frame()?.contentWindow?.postMessage(message, "*");
  let alive = false;

  const heard = (/** @type {MessageEvent} */ event) => {
    if (!event.source || event.source !== frame()?.contentWindow) return;
    if (event.data?.jld === "ready" && alive) tell({ jld: "connected" });
    if (event.data?.jld === "solve") model.send({ kind: "solve", ...event.data.state });
  };
  const answered = (/** @type {any} */ content) => {
    if (content.kind === "answer") tell({ ...content, jld: "answer" });
    if (content.kind === "hello") {
      alive = true;
      if (frame()) tell({ jld: "connected" });
      else model.send({ kind: "page" });
    }
    if (content.kind === "page" && !frame()) {
      const made = document.createElement("iframe");
      made.title = "interactive page";
      made.style.cssText = `width: 100%; border: 1px solid #888; height: ${content.height}px`;
      made.srcdoc = content.html;
      place().append(made);
    }
  };
  window.addEventListener("message", heard);
  model.on("msg:custom", answered);
  // no kernel answers where a notebook is only looked at
  model.send({ kind: "hello" });
  return () => {
    window.removeEventListener("message", heard);
    model.off("msg:custom", answered);
  };
}

export default { render };
