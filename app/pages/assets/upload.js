// A file, or values that were typed in, are shown as they were read; only a button stores them. The
// service says which kind a file is of, reads and judges it; here its answers are put in their place.

import { dayAndTime, fill, momentOf, problemOf, saidAnew, t, valueOf } from "./ask.js";

const drop = document.getElementById("drop");
const preview = document.getElementById("preview");
const file = document.getElementById("file");
const choose = document.getElementById("choose");
const beside = document.getElementById("beside");
const override = document.getElementById("override");
const machine = encodeURIComponent(drop.dataset.machine);
const api = `/v1/machines/${machine}`;
const LOOK_BACK_S = 900;
const waiting = document.getElementById("waiting-files");
const queue = [];
let chosen = null;
let asked = 0;
let opener = choose;

export function element(name, words, className = "") {
  const made = document.createElement(name);
  made.textContent = words;
  made.className = className;
  return made;
}

export function say(title, lines = [], kind = "limited") {
  const box = element("div", "", `consequence ${kind}`);
  const words = element("div", "");
  const list = element("ul", "");
  list.append(...lines.map((line) => element("li", line)));
  words.append(element("h3", title));
  if (lines.length) words.append(list);
  if (queue.length > 1 && kind === "limited") {
    const onward = element("button", t("Leave it, next file"));
    onward.type = "button";
    onward.dataset.do = "discard";
    words.append(onward);
  }
  box.append(words);
  preview.replaceChildren(box);
  preview.focus();
}

// The element of the form in which a refused field was asked, and the one that says what is wrong.
function askedIn(field) {
  if (field.startsWith("temperatures_c.")) {
    const sensor = field.slice("temperatures_c.".length);
    const input = beside.querySelector(`[data-sensor="${CSS.escape(sensor)}"]`);
    if (input) return [input, document.getElementById(input.getAttribute("aria-describedby"))];
  }
  const name = field.startsWith("temperatures_c") ? "temperatures_c" : field;
  const said = document.getElementById(`wrong-${name}`);
  if (!said || !beside.contains(said)) return [null, null];
  return [beside.elements[name] ?? beside.querySelector("[data-sensor]"), said];
}

function clearWrong() {
  for (const one of beside.querySelectorAll(".wrong")) one.textContent = "";
  for (const one of beside.querySelectorAll("[aria-invalid]")) one.removeAttribute("aria-invalid");
}

// Says at its field what is wrong with it; gives the lines that belong to none, and the first field.
function place(errors) {
  const others = [];
  let first = null;
  for (const { field, message } of errors) {
    const [input, said] = askedIn(field);
    if (!said || !chosen) {
      others.push(field === "file" ? message : `${field}: ${message}`);
      continue;
    }
    said.textContent += `${said.textContent ? " " : ""}${message}`;
    input?.setAttribute("aria-invalid", "true");
    first ??= input;
  }
  return [others, first];
}

async function refused(title, answer, changes) {
  const problem = await problemOf(answer);
  const [lines, first] = place(problem.errors);
  if (!problem.errors.length) lines.push(problem.detail);
  if (first) lines.push(t("What the file does not say is asked above."));
  if (first || (chosen && (chosen.kind ?? drop.dataset.expected) === "map")) override.hidden = false;
  if (first) override.open = true;
  const sure = answer.status < 500 || !changes ? t("Nothing has changed.") : t("Whether something has changed shows the page when the service answers again.");
  say(title, [...lines, sure]);
  first?.focus();
}

export async function ask(title, address, options = {}, changes = true) {
  try {
    const answer = await fetch(address, { cache: "no-store", ...options });
    if (answer.ok) return answer;
    await refused(title, answer, changes);
  } catch {
    say(title, [changes ? t("The service was not reached. Whether something has changed shows the page when it is back.") : t("The service was not reached.")]);
  }
  return null;
}

export async function show(title, address, options) {
  const mine = ++asked;
  const answer = await ask(title, address, options, false);
  if (!answer || mine !== asked) return;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  if (mine !== asked) return;
  const found = document.adoptNode(page.getElementById("found"));
  for (const one of found.querySelectorAll("[data-unless]")) one.hidden = one.dataset.unless === drop.dataset.expected;
  preview.replaceChildren(found);
  override.hidden = found.dataset.what !== "upload";
  preview.focus();
}

function content(accept) {
  return { method: "POST", headers: { "Content-Type": "application/octet-stream", Accept: accept }, body: chosen.bytes };
}

// What is stated beside the file, as the service takes it.
function stated() {
  const found = new URLSearchParams({ name: chosen.name });
  if (chosen.kind) found.set("kind", chosen.kind);
  for (const name of ["method", "label"]) {
    const value = beside.elements[name].value.trim();
    if (value) found.set(name, value);
  }
  const axis = beside.elements.axis.value;
  if (axis) found.set("axis", "XYZ".includes(axis) ? axis.toLowerCase() : axis);
  const time = beside.elements.measured_at.value;
  if (time) found.set("measured_at", momentOf(time) ?? time);
  for (const one of beside.querySelectorAll("[data-sensor]")) {
    if (one.value.trim()) found.append("temperature", `${one.dataset.sensor}=${valueOf(one) ?? one.value.trim()}`);
  }
  return found;
}

export async function look() {
  clearWrong();
  chosen.stated = stated();
  await show(t("%(file)s was not stored.", { file: chosen.name }), `${api}/files?preview=true&expected=${drop.dataset.expected}&${chosen.stated}`, content("text/html"));
}

// Shows what was read; `kind` is as what the reader says that it is to be read.
export async function take(name, bytes, from = choose) {
  opener = from;
  chosen = { name: name.slice(-200), bytes, stated: null, kind: null };
  beside.reset();
  override.hidden = true;
  override.open = false;
  document.getElementById("then-said").textContent = "";
  say(t("%(file)s is being read.", { file: chosen.name }), [], "fine");
  await look();
}

const takeFile = async (one) => take(one.name, await one.arrayBuffer());

// Of several files each is shown and decided by itself, one after the other.
function takeFiles(files) {
  queue.push(...files);
  listWaiting();
  if (files.length && queue.length === files.length) takeFile(queue[0]);
}

function next() {
  queue.shift();
  listWaiting();
  if (queue.length) takeFile(queue[0]);
}

function listWaiting() {
  waiting.replaceChildren(...queue.slice(1).map((one) => element("li", t("%(file)s waits", { file: one.name }))));
}

async function takeReading() {
  const said = document.getElementById("then-said");
  const time = Date.parse(momentOf(beside.elements.measured_at.value) ?? "");
  if (Number.isNaN(time)) {
    said.textContent = t("State the time first.");
    beside.elements.measured_at.focus();
    return;
  }
  const range = new URLSearchParams({
    from: new Date(time - LOOK_BACK_S * 1000).toISOString(),
    to: new Date(time).toISOString(),
  });
  const answer = await ask(t("The readings were not read."), `${api}/readings?${range}`, {}, false);
  if (!answer) return;
  const last = (await answer.json()).at(-1);
  if (!last) {
    said.textContent = t("No reading is stored in the %(time)s min before that time.", { time: LOOK_BACK_S / 60 });
    return;
  }
  for (const one of beside.querySelectorAll("[data-sensor]")) fill(one, last.temperatures_c[one.dataset.sensor] ?? null);
  said.textContent = t("Reading of %(time)s, %(seconds)s s before.", { time: dayAndTime(last.time), seconds: Math.round((time - Date.parse(last.time)) / 1000) });
  preview.replaceChildren();
}

async function store(path, acceptLosses) {
  const isMap = path === "error-maps";
  chosen.stated.set("kind", isMap ? "map" : "check");
  if (isMap) chosen.stated.set("accept_losses", acceptLosses);
  const answer = await ask(t("%(file)s was not stored.", { file: chosen.name }), `${api}/files?${chosen.stated}`, content("application/json"));
  if (!answer) return;
  const stored = await answer.json();
  override.hidden = true;
  chosen = null;
  const { label } = stored;
  let title = t("Check ‘%(label)s’ is stored.", { label });
  if (isMap) title = t("Map ‘%(label)s’ is stored.", { label });
  if (stored.activated === false) title = t("Map ‘%(label)s’ is stored; v%(version)s waits.", { label, version: stored.model_version });
  const lines = await saidAnew([...(stored.judgement ? [stored.judgement.summary] : []), ...(stored.warnings ?? [])]);
  dispatchEvent(new CustomEvent("thermap-changed", { detail: { path, stored } }));
  if (queue.length > 1) {
    document.getElementById("stored-files").append(element("li", [title, ...lines].join(" ")));
    next();
    return;
  }
  queue.length = 0;
  say(title, lines, "fine");
  const [other, words] = isMap ? ["maps", t("Maps and versions")] : ["loop", t("Loop")];
  if (!location.pathname.endsWith(`/${other}`)) {
    const link = element("a", words);
    link.href = `/machines/${machine}/${other}`;
    preview.querySelector("h3").after(link);
  }
}

export function discard() {
  asked += 1;
  chosen = null;
  file.value = "";
  override.hidden = true;
  preview.replaceChildren();
  (document.getElementById(opener.id) ?? choose).focus();
  next();
}

// Whose button it was, to which the focus goes back; of a version that is shown there is no file.
export function openedBy(button) {
  opener = button;
}

document.addEventListener("click", async (event) => {
  const button = event.target.closest("#preview button");
  if (!button) return;
  if (button.dataset.as) {
    chosen.kind = button.dataset.as;
    await look();
    return;
  }
  if (!button.dataset.do) return;
  const found = document.getElementById("found");
  if (found) found.dataset.isDone = "";
  for (const one of found?.querySelectorAll("button") ?? []) one.disabled = true;
  const act = button.dataset.do;
  if (act === "discard") discard();
  else if (act === "store-check") await store("verifications");
  else if (act.startsWith("store")) await store("error-maps", act === "store-all");
});

// What was shown was of what is stated then: changed, it is shown anew before it can be stored.
beside.addEventListener("input", () => preview.replaceChildren());
beside.addEventListener("submit", (event) => {
  event.preventDefault();
  look();
});
document.getElementById("then").addEventListener("click", takeReading);

choose.disabled = false;
choose.addEventListener("click", () => file.click());
file.addEventListener("change", () => {
  takeFiles([...file.files]);
  file.value = "";
});

// A file may be dropped anywhere: beside a place for it a browser would open it and leave the page.
const hasFile = (event) => event.dataTransfer?.types.includes("Files");
for (const name of ["dragenter", "dragover"]) {
  document.addEventListener(name, (event) => {
    if (!hasFile(event)) return;
    event.preventDefault();
    drop.classList.add("over");
  });
}
document.addEventListener("dragleave", (event) => event.relatedTarget ?? drop.classList.remove("over"));
document.addEventListener("drop", (event) => {
  if (!hasFile(event)) return;
  event.preventDefault();
  drop.classList.remove("over");
  const files = [...event.dataTransfer.files];
  takeFiles(files);
});
