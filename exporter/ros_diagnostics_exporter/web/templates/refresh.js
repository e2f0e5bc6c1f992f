"use strict";
// What is in <main> is replaced by what the exporter shows now: when it sends an event that something has changed, and
// every thirty seconds, for what has no event; every ten where no stream of events is open. Focus and scrolling stay;
// nothing is replaced while a form of the page is being filled in. A page that cannot be renewed says since when.
const late = document.getElementById("late");
let shown = new Date();
const place = (element) => element && element.id !== "page" &&
  (element.id || element.getAttribute("href") || "");
async function renew() {
  const page = document.getElementById("page");
  const focus = () => page.contains(document.activeElement) ? document.activeElement : null;
  const focused = focus();
  if (document.hidden || !getSelection().isCollapsed || (focused && focused.matches("input, textarea, select"))) return;
  try {
    const answer = await fetch(location.href, {cache: "no-store"});
    if (!answer.ok && answer.status !== 404) throw new Error(answer.statusText);
    const found = new DOMParser().parseFromString(await answer.text(), "text/html");
    const fresh = found.getElementById("page");
    if (fresh.innerHTML !== page.innerHTML) {
      const key = place(focus()), top = scrollY;
      page.replaceChildren(...document.adoptNode(fresh).childNodes);
      if (key) [...page.querySelectorAll("a, button")].find((each) => place(each) === key)?.focus({preventScroll: true});
      scrollTo(scrollX, top);
    }
    shown = new Date();
    late.hidden = true;
  } catch (error) {
    late.textContent = `The exporter does not answer: this is as of ${shown.toLocaleTimeString()}.`;
    late.hidden = false;
  }
}
let changes = null;
function listen() {
  if (changes) changes.close();
  // A hidden page has none: a browser opens six connections to a server at most.
  changes = document.hidden ? null : new EventSource(document.body.dataset.changes);
  if (changes) changes.onopen = changes.onmessage = renew;
}
let turns = 0;
setInterval(() => {
  turns += 1;
  if (changes && changes.readyState === EventSource.OPEN && turns % 3) return;
  renew();
  if (changes && changes.readyState === EventSource.CLOSED) listen();
}, 10000);
document.addEventListener("visibilitychange", () => { listen(); renew(); });
listen();
