// A file, or a version, is shown with what it would change; only a button stores or activates. The
// service reads the file, judges and draws; here its answers are put in their place.

const drop = document.getElementById("drop");
const preview = document.getElementById("preview");
const state = document.getElementById("upload-state");
const file = document.getElementById("file");
const choose = document.getElementById("choose");
const machine = encodeURIComponent(drop.dataset.machine);
const api = `/v1/machines/${machine}`;
const beside = document.getElementById("beside");
const LOOK_BACK_S = 900;
let chosen = null;
let asked = 0;
let opener = choose;

// On a small screen, or among many versions, the active one would lie behind the edge.
const active = document.querySelector("#timeline .active");
if (active) {
  const room = active.closest(".scroll");
  room.scrollLeft += Math.max(active.getBoundingClientRect().right - room.getBoundingClientRect().right, 0);
}

function element(name, words, className = "") {
  const made = document.createElement(name);
  made.textContent = words;
  made.className = className;
  return made;
}

function say(title, lines = [], kind = "limited") {
  const box = element("div", "", `consequence ${kind}`);
  const words = element("div", "");
  const list = element("ul", "");
  list.append(...lines.map((line) => element("li", line)));
  words.append(element("h3", title));
  if (lines.length) words.append(list);
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
  const problem = await answer.json().catch(() => ({}));
  const [lines, first] = place(problem.errors ?? []);
  if (!problem.errors?.length) lines.push(problem.detail ?? `The service answered ${answer.status}.`);
  if (first) lines.push("What the file does not say is asked above.");
  const sure = answer.status < 500 || !changes ? "Nothing has changed." : "Whether something has changed shows the page when the service answers again.";
  say(title, [...lines, sure]);
  first?.focus();
}

async function ask(title, address, options = {}, changes = true) {
  try {
    const answer = await fetch(address, { cache: "no-store", ...options });
    if (answer.ok) return answer;
    await refused(title, answer, changes);
  } catch {
    say(title, [changes ? "The service was not reached. Whether something has changed shows the page when it is back." : "The service was not reached."]);
  }
  return null;
}

async function show(title, address, options) {
  const mine = ++asked;
  const answer = await ask(title, address, options, false);
  if (!answer || mine !== asked) return;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  if (mine !== asked) return;
  preview.replaceChildren(document.adoptNode(page.getElementById("found")));
  preview.focus();
}

function content() {
  return { method: "POST", headers: { "Content-Type": "application/octet-stream" }, body: chosen.bytes };
}

// What is stated beside the file, as the service takes it.
function stated() {
  const found = new URLSearchParams({ name: chosen.name });
  for (const name of ["method", "label"]) {
    const value = beside.elements[name].value.trim();
    if (value) found.set(name, value);
  }
  const axis = beside.elements.axis.value;
  if (axis) found.set("axis", "XYZ".includes(axis) ? axis.toLowerCase() : axis);
  const time = beside.elements.measured_at.value;
  if (time) found.set("measured_at", `${time}Z`);
  for (const one of beside.querySelectorAll("[data-sensor]")) {
    if (one.value.trim()) found.append("temperature", `${one.dataset.sensor}=${one.value.trim()}`);
  }
  return found;
}

async function look() {
  clearWrong();
  chosen.stated = stated();
  await show(`${chosen.name} was not stored.`, `/machines/${machine}/maps/preview?${chosen.stated}`, content());
}

async function take(one) {
  opener = choose;
  chosen = { name: one.name.slice(-200), bytes: await one.arrayBuffer(), stated: null };
  drop.classList.add("small");
  beside.reset();
  beside.hidden = false;
  document.getElementById("then-said").textContent = "";
  state.textContent = `${chosen.name}: nothing is stored yet`;
  await look();
}

async function takeReading() {
  const said = document.getElementById("then-said");
  const time = Date.parse(`${beside.elements.measured_at.value}Z`);
  if (Number.isNaN(time)) {
    said.textContent = "State the time first.";
    beside.elements.measured_at.focus();
    return;
  }
  const range = new URLSearchParams({
    from: new Date(time - LOOK_BACK_S * 1000).toISOString(),
    to: new Date(time).toISOString(),
  });
  const answer = await ask("The readings were not read.", `${api}/readings?${range}`, {}, false);
  if (!answer) return;
  const last = (await answer.json()).at(-1);
  if (!last) {
    said.textContent = `No reading is stored in the ${LOOK_BACK_S / 60} min before that time.`;
    return;
  }
  for (const one of beside.querySelectorAll("[data-sensor]")) one.value = last.temperatures_c[one.dataset.sensor] ?? "";
  said.textContent = `Reading of ${last.time.slice(0, 19).replace("T", " ")} UTC, ${Math.round((time - Date.parse(last.time)) / 1000)} s before.`;
  preview.replaceChildren();
}

async function store(acceptLosses) {
  const address = `${api}/error-maps/from-file?${chosen.stated}&accept_losses=${acceptLosses}`;
  const answer = await ask(`${chosen.name} was not stored.`, address, content());
  if (!answer) return;
  const stored = await answer.json();
  state.textContent = `${chosen.name}: stored`;
  beside.hidden = true;
  const waits = stored.activated === false;
  say(`Map ‘${stored.label}’ is stored${waits ? `; v${stored.model_version} waits.` : "."}`, stored.warnings ?? [], "fine");
  dispatchEvent(new Event("thermap-changed"));
}

async function activate(version) {
  const answer = await ask(`v${version} was not activated.`, `${api}/models/${version}/activate`, { method: "POST" });
  if (!answer) return;
  say(`v${version} is active.`, ["Every other version can be activated again."], "fine");
  dispatchEvent(new Event("thermap-changed"));
}

async function withdraw(map) {
  const answer = await ask("The map was not withdrawn.", `${api}/error-maps/${map}`, { method: "DELETE" });
  if (!answer) return;
  say("The map is out of use.", ["Older versions keep it: activating one of them is the way back."], "fine");
  dispatchEvent(new Event("thermap-changed"));
}

// What somebody else has changed meanwhile makes what is shown another thing than what would be done.
new MutationObserver(() => {
  const found = document.getElementById("found");
  const timeline = document.getElementById("timeline");
  if (!found || !timeline || found.dataset.active === timeline.dataset.active || found.querySelector(".meanwhile")) return;
  if ("isDone" in found.dataset) return;
  for (const one of found.querySelectorAll("[data-do]:not([data-do=discard])")) one.disabled = true;
  const words = `Meanwhile v${timeline.dataset.active} became active: show again what this would change.`;
  found.querySelector(".decide").before(element("p", words, "meanwhile"));
}).observe(document.getElementById("answer"), { childList: true, subtree: true });

function discard() {
  asked += 1;
  chosen = null;
  file.value = "";
  state.textContent = "nothing is stored yet";
  drop.classList.remove("small");
  beside.hidden = true;
  preview.replaceChildren();
  (document.getElementById(opener.id) ?? choose).focus();
}

document.addEventListener("click", async (event) => {
  const button = event.target.closest("button");
  if (button?.dataset.activate || button?.dataset.withdraw) opener = button;
  if (button?.dataset.activate) {
    const version = button.dataset.activate;
    await show(`v${version} was not activated.`, `/machines/${machine}/maps/preview/${version}`);
    return;
  }
  if (button?.dataset.withdraw) {
    await show("The map was not withdrawn.", `/machines/${machine}/maps/withdrawal/${button.dataset.withdraw}`);
    return;
  }
  if (!button?.dataset.do) return;
  const found = document.getElementById("found");
  found.dataset.isDone = "";
  for (const one of found.querySelectorAll("button")) one.disabled = true;
  if (button.dataset.do === "discard") discard();
  else if (button.dataset.do === "activate") await activate(found.dataset.version);
  else if (button.dataset.do === "withdraw") await withdraw(found.dataset.map);
  else await store(button.dataset.do === "store-all");
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
file.addEventListener("change", () => file.files[0] && take(file.files[0]));
for (const name of ["dragenter", "dragover"]) {
  drop.addEventListener(name, (event) => {
    event.preventDefault();
    drop.classList.add("over");
  });
}
drop.addEventListener("dragleave", () => drop.classList.remove("over"));
drop.addEventListener("drop", (event) => {
  event.preventDefault();
  drop.classList.remove("over");
  const one = event.dataTransfer.files[0];
  if (one) take(one);
});
