// The page follows the service: whenever something changes it asks for itself again, and takes over
// what differs. The service writes everything; nothing is judged or computed here.

import { problemOf, t } from "./ask.js";
import { areOff } from "./keys.js";

const WAITING_MS = 5000;
const LOST_MS = 15000;
const AT_MOST_EVERY_MS = 500;
const SPOKEN_EVERY_MS = 10000;

const root = document.documentElement;
const connection = document.getElementById("connection");
let heardAt = performance.now();
let lostSince = null;
let backAt = -WAITING_MS;
let asking = false;
let isDue = false;
let askedAt = 0;
let refusal = "";
let title = document.title;
let said = null;
let spokenAt = -SPOKEN_EVERY_MS;

function takeOver(page) {
  const focused = document.activeElement?.id;
  // What is not there any more is not drawn any more, and what is there now is drawn.
  const places = (where) => [...where.querySelectorAll("main [data-live]")].map((one) => one.id).join();
  if (places(document) !== places(page)) replaceMain(page);
  for (const old of document.querySelectorAll("[data-live]")) {
    const fresh = page.getElementById(old.id);
    if (fresh && fresh.outerHTML !== old.outerHTML) {
      const opened = [...old.querySelectorAll("details[id][open]")].map((one) => one.id);
      old.className = fresh.className;
      old.innerHTML = fresh.innerHTML;
      for (const id of opened) document.getElementById(id)?.setAttribute("open", "");
    }
  }
  speak();
  title = page.querySelector("title")?.textContent ?? title;
  mark();
  if (focused && document.activeElement?.id !== focused) document.getElementById(focused)?.focus();
}

function replaceMain(page) {
  const main = document.querySelector("main");
  const opened = [...main.querySelectorAll("details[id][open]")].map((one) => one.id);
  const fresh = document.adoptNode(page.querySelector("main"));
  fresh.querySelector("#spoken").replaceWith(document.getElementById("spoken"));
  main.replaceWith(fresh);
  for (const id of opened) document.getElementById(id)?.setAttribute("open", "");
  mark();
  dispatchEvent(new CustomEvent("thermap-replaced"));
}

// A change of the verdict is read out, and not with every reading.
function speak() {
  const spoken = document.getElementById("spoken");
  const words = [...document.querySelectorAll("[data-spoken]")].map((one) => one.textContent).join(": ");
  const now = performance.now();
  if (!words || words === said || now - spokenAt < SPOKEN_EVERY_MS) return;
  if (said !== null) spoken.textContent = words;
  said = words;
  spokenAt = now;
}

// What the page shows is old as soon as the service is not heard, or answers something else.
function mark() {
  const why = document.getElementById("lost-why");
  if (lostSince !== null) why.textContent = t("the service has not been heard for 15 s.");
  else if (refusal) why.textContent = refusal;
  const isLost = lostSince !== null || refusal !== "";
  if (isLost) root.dataset.connection = "lost";
  else delete root.dataset.connection;
  document.title = isLost ? `${t("Unknown")} · ${title}` : title;
}

async function refused(answer) {
  // Who has no key any more states one; a machine that is gone has no page.
  if (answer.status === 401) location.reload();
  else if (answer.status === 404) location.assign("/");
  else {
    refusal = t("the service answers: %(answer)s.", { answer: (await problemOf(answer)).detail });
    say(t("Not answered"));
    mark();
  }
}

// What one reads and has chosen stays: such a page asks by itself for what it follows. That the
// database is away it hears here, from a small question that only the database can answer.
async function askStill() {
  try {
    const answer = await fetch(root.dataset.still, { cache: "no-store" });
    if (answer.ok) {
      refusal = "";
      mark();
    } else await refused(answer);
  } catch {
    // the connection says so by itself
  }
}

async function ask() {
  if (root.dataset.still) return;
  if (asking) {
    isDue = true;
    return;
  }
  asking = true;
  const wait = askedAt + AT_MOST_EVERY_MS - performance.now();
  if (wait > 0) await new Promise((resolve) => setTimeout(resolve, wait));
  askedAt = performance.now();
  try {
    const answer = await fetch(location.href, { cache: "no-store" });
    if (answer.ok) {
      takeOver(new DOMParser().parseFromString(await answer.text(), "text/html"));
      refusal = "";
      mark();
    } else await refused(answer);
  } catch {
    // the connection says so by itself
  }
  asking = false;
  if (isDue) {
    isDue = false;
    ask();
  }
}

function heard() {
  const now = performance.now();
  if (lostSince !== null) {
    say(t("Connected again, %(time)s s were missing", { time: Math.round((now - lostSince) / 1000) }));
    lostSince = null;
    backAt = now;
    mark();
    ask();
  } else if (refusal) say(t("Not answered"));
  else if (now - backAt > WAITING_MS) say(t("Live"));
  heardAt = now;
}

function say(words) {
  if (connection.textContent !== words) connection.textContent = words;
}

const NEWS = ["event", "watch", "analysis"];
const FOLLOWED = ["table", "status", ...NEWS].map((name) => `&kind=${name}`).join("");

function follow() {
  const source = new EventSource(`${root.dataset.stream}?min_change_um=0.05&heartbeat_s=2${FOLLOWED}`);
  for (const name of NEWS) {
    source.addEventListener(name, (event) => {
      // A page that asks by itself for what it follows knows from this when.
      dispatchEvent(new CustomEvent("thermap-news", { detail: { name, ...JSON.parse(event.data) } }));
    });
  }
  for (const name of ["table", "state", "status", "missed", ...NEWS]) {
    source.addEventListener(name, () => {
      heard();
      ask();
    });
  }
  source.addEventListener("heartbeat", heard);
  source.addEventListener("error", () => {
    // A browser gives up on some errors; we do not.
    if (source.readyState === EventSource.CLOSED) setTimeout(follow, 2000);
  });
}

setInterval(() => {
  const silentMs = performance.now() - heardAt;
  if (silentMs > LOST_MS) {
    if (lostSince === null) lostSince = heardAt;
    mark();
    say(t("No connection"));
  } else if (silentMs > WAITING_MS) say(t("Waiting"));
}, 1000);

// Ages grow although nothing comes.
setInterval(root.dataset.still ? askStill : ask, 10000);

document.getElementById("theme").addEventListener("click", () => {
  const isDark = getComputedStyle(root).colorScheme === "dark";
  // What was chosen is given up again: then the theme is the system's.
  if (root.dataset.theme) delete root.dataset.theme;
  else root.dataset.theme = isDark ? "light" : "dark";
  localStorage.setItem("thermap-theme", root.dataset.theme ?? "");
});

// Of many pages that of this one may lie behind the edge of a small screen.
document.querySelector(".bar nav [aria-current]")?.scrollIntoView({ block: "nearest", inline: "nearest" });

// Escape leaves an open question as it is; only where there is none it leaves the page.
document.addEventListener("keydown", (event) => {
  const leave = document.querySelector(".asked [data-leave], #preview [data-do=discard]");
  if (event.key !== "Escape" || !leave || document.querySelector("dialog[open]")) return;
  if (event.target.closest("input, textarea, select")) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  leave.click();
});

document.addEventListener("keydown", (event) => {
  if (areOff() || document.querySelector("dialog[open]")) return;
  if (event.target.closest("input, textarea, select") || event.ctrlKey || event.metaKey || event.altKey) return;
  const links = [...document.querySelectorAll("[data-row]")];
  const at = links.indexOf(document.activeElement);
  if (event.key === "ArrowDown" && links.length) links[Math.min(at + 1, links.length - 1)].focus();
  else if (event.key === "ArrowUp" && links.length) links[Math.max(at - 1, 0)].focus();
  else if (document.querySelector(`a[data-page="${CSS.escape(event.key)}"]`)) document.querySelector(`a[data-page="${CSS.escape(event.key)}"]`).click();
  else if (event.key === "Escape" && root.dataset.back) location.assign(root.dataset.back);
  else if (event.key.toLowerCase() === "f" && document.querySelector("table.machines")) {
    if (root.dataset.view) delete root.dataset.view;
    else root.dataset.view = "far";
    localStorage.setItem("thermap-far", root.dataset.view ?? "");
  } else if (event.key.toLowerCase() === "t" && document.getElementById("whole")) {
    const whole = document.getElementById("whole");
    whole.open = !whole.open;
    if (whole.open) whole.scrollIntoView();
  } else return;
  event.preventDefault();
});

// Another component is drawn without leaving the page, and its place in it.
document.addEventListener("click", (event) => {
  const link = event.target.closest("[data-live] a.component");
  if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
  event.preventDefault();
  history.replaceState(null, "", link.href);
  link.focus();
  ask();
});

// What a page changed itself is shown at once.
addEventListener("thermap-changed", ask);

speak();
follow();
