"use strict";
// Every ten seconds what is in <main> is replaced by what the exporter shows now. Focus and scrolling stay; nothing is
// replaced while a form of the page is being filled in. A page that cannot be renewed says since when.
const late = document.getElementById("late");
let shown = new Date();
const place = (element) => element && element.id !== "page" &&
  (element.id || element.getAttribute("href") || "");
async function renew() {
  const page = document.getElementById("page");
  const focused = page.contains(document.activeElement) ? document.activeElement : null;
  if (document.hidden || !getSelection().isCollapsed || (focused && focused.matches("input, textarea, select"))) return;
  try {
    const answer = await fetch(location.href, {cache: "no-store"});
    if (!answer.ok && answer.status !== 404) throw new Error(answer.statusText);
    const found = new DOMParser().parseFromString(await answer.text(), "text/html");
    const fresh = found.getElementById("page");
    if (fresh.innerHTML !== page.innerHTML) {
      const key = place(focused);
      page.replaceChildren(...document.adoptNode(fresh).childNodes);
      if (key) [...page.querySelectorAll("a, button")].find((each) => place(each) === key)?.focus();
    }
    shown = new Date();
    late.hidden = true;
  } catch (error) {
    late.textContent = `The exporter does not answer: this is as of ${shown.toLocaleTimeString()}.`;
    late.hidden = false;
  }
}
setInterval(renew, 10000);
document.addEventListener("visibilitychange", renew);
