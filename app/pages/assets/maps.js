// A file, or a version, is shown with what it would change; only a button stores or activates. The
// service reads the file, judges and draws; here its answers are put in their place.

const drop = document.getElementById("drop");
const preview = document.getElementById("preview");
const state = document.getElementById("upload-state");
const file = document.getElementById("file");
const choose = document.getElementById("choose");
const machine = encodeURIComponent(drop.dataset.machine);
const api = `/v1/machines/${machine}`;
let chosen = null;
let asked = 0;

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

async function refused(answer) {
  const problem = await answer.json().catch(() => ({}));
  const lines = (problem.errors ?? []).map((one) => one.message);
  return lines.length ? lines : [problem.detail ?? `The service answered ${answer.status}.`];
}

async function ask(title, address, options = {}) {
  try {
    const answer = await fetch(address, { cache: "no-store", ...options });
    if (answer.ok) return answer;
    say(title, [...(await refused(answer)), "Nothing has changed."]);
  } catch {
    say(title, ["The service was not reached. Whether something has changed shows the page when it is back."]);
  }
  return null;
}

async function show(title, address, options) {
  const mine = ++asked;
  const answer = await ask(title, address, options);
  if (!answer || mine !== asked) return;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  if (mine !== asked) return;
  preview.replaceChildren(document.adoptNode(page.getElementById("found")));
  preview.focus();
}

function content() {
  return { method: "POST", headers: { "Content-Type": "application/octet-stream" }, body: chosen.bytes };
}

async function take(one) {
  chosen = { name: one.name.slice(-200), bytes: await one.arrayBuffer() };
  drop.classList.add("small");
  state.textContent = `${chosen.name}: nothing is stored yet`;
  const name = encodeURIComponent(chosen.name);
  await show(`${chosen.name} was not stored.`, `/machines/${machine}/maps/preview?name=${name}`, content());
}

async function store(acceptLosses) {
  const address = `${api}/error-maps/from-file?name=${encodeURIComponent(chosen.name)}&accept_losses=${acceptLosses}`;
  const answer = await ask(`${chosen.name} was not stored.`, address, content());
  if (!answer) return;
  const stored = await answer.json();
  state.textContent = `${chosen.name}: stored`;
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

function discard() {
  asked += 1;
  chosen = null;
  file.value = "";
  state.textContent = "nothing is stored yet";
  drop.classList.remove("small");
  preview.replaceChildren();
  choose.focus();
}

document.addEventListener("click", async (event) => {
  const button = event.target.closest("button");
  if (button?.dataset.activate) {
    const version = button.dataset.activate;
    await show(`v${version} was not activated.`, `/machines/${machine}/maps/preview/${version}`);
    return;
  }
  if (!button?.dataset.do) return;
  const found = document.getElementById("found");
  for (const one of found.querySelectorAll("button")) one.disabled = true;
  if (button.dataset.do === "discard") discard();
  else if (button.dataset.do === "activate") await activate(found.dataset.version);
  else await store(button.dataset.do === "store-all");
});

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
