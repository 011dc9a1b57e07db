// The loop: start, follow and cancel an analysis; adopt, go back, assign; store and delete checks.
import { askOnce, changeWords, list, lossLines, momentOf, refused, saidAnew, send, sendVersion, t, told, typedOf, valueOf } from "./ask.js";

// Not awaited here: what is pressed before it has come is answered all the same.
const uploading = document.getElementById("drop") ? import("./upload.js") : null;

const room = document.getElementById("loop");
const api = room.dataset.api;
const number = room.dataset.analysis;
const analysis = `${api}/analyses/${number}`;
const by = (id) => document.getElementById(id);
const chosen = (name) => [...document.querySelectorAll(`input[name=${name}]:checked`)].map((one) => one.value);
const shown = (id) => location.assign(id ? `?analysis=${id}` : location.pathname);

function on(id, event, act) {
  by(id)?.addEventListener(event, act);
}

// Following it

function seconds(s) {
  const whole = Math.round(s);
  return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)} min ${whole % 60} s`;
}

// What an analysis does, asked for once in the reader's language.
const DOINGS = new Map();

async function doing(words) {
  if (!DOINGS.has(words)) DOINGS.set(words, (await saidAnew([words]))[0]);
  return DOINGS.get(words);
}

let isLooking = false;
let isDue = false;
let timer = 0;

async function look() {
  let one;
  try {
    one = await send("GET", analysis);
  } catch (error) {
    refused(by("cancel-said"), t("Its progress is not known."), error);
    return;
  }
  if (one.status !== "queued" && one.status !== "running") {
    shown(number);
    return;
  }
  const percent = Math.round(100 * one.progress);
  by("running").textContent = t("Analysis %(number)s: %(doing)s, %(share)s %%.", { number, doing: await doing(one.message), share: percent });
  by("progress").value = one.progress;
  by("arc").setAttribute("stroke-dasharray", `${percent} 100`);
  if (one.started_at) {
    const soFar = (Date.now() - Date.parse(one.started_at)) / 1000;
    const time = seconds(soFar);
    const left = seconds((soFar * (1 - one.progress)) / one.progress);
    const words = one.progress > 0.05 ? t("%(time)s so far, about %(left)s left.", { time, left }) : t("%(time)s so far.", { time });
    by("so-far").textContent = soFar > 0 ? words : "";
  }
}

// The stream says when there is more to say; the timer is for when it is lost.
async function follow() {
  isDue = true;
  if (isLooking) return;
  isLooking = true;
  while (isDue) {
    isDue = false;
    await look();
  }
  isLooking = false;
  clearTimeout(timer);
  timer = setTimeout(follow, 5000);
}

if (by("progress")) {
  addEventListener("thermap-news", ({ detail }) => {
    if (detail.name === "analysis" && String(detail.analysis) === number) follow();
  });
  follow();
}

on("cancel", "click", async () => {
  by("cancel").disabled = true;
  try {
    await send("POST", `${analysis}/cancel`);
    shown(number);
  } catch (error) {
    by("cancel").disabled = false;
    refused(by("cancel-said"), t("Not cancelled."), error);
  }
});

// The numbers that were typed, null for an empty field; nothing where one is none, which is said.
function numbersIn(fields, place) {
  const wrong = fields.filter((one) => one.value.trim() && valueOf(one) === null);
  for (const one of fields) one.removeAttribute("aria-invalid");
  if (!wrong.length) return fields.map((one) => (one.value.trim() ? valueOf(one) : null));
  for (const one of wrong) one.setAttribute("aria-invalid", "true");
  const lines = wrong.map((one) => t("%(field)s: expected a number such as 5.2 or 5,2, got “%(got)s”.", { field: one.ariaLabel ?? one.labels[0].textContent.trim(), got: one.value.trim() }));
  told(place, t("Nothing was sent."));
  place.append(list(lines));
  wrong[0].focus();
  return null;
}

// Starting one

async function start(asked, place, button) {
  button.disabled = true;
  try {
    const queued = await send("POST", `${api}/analyses`, asked);
    shown(queued.id);
  } catch (error) {
    button.disabled = false;
    refused(place, t("Not started."), error);
  }
}

on("start", "click", () => {
  const kinds = chosen("kind");
  const [held, seed] = numbersIn([by("held"), by("seed")], by("checks-said")) ?? [];
  if (seed === undefined) return;
  const asked = {
    verifications: chosen("check").map(Number),
    holdout_fraction: held / 100,
    seed,
    effects: kinds.length ? kinds : null,
  };
  start(asked, by("checks-said"), by("start"));
});

for (const button of document.querySelectorAll("[data-again]")) {
  button.addEventListener("click", async () => {
    try {
      const { verifications, holdout_fraction, seed, effects } = await send("GET", analysis);
      await start({ verifications, holdout_fraction, seed, effects }, by("again-said"), button);
    } catch (error) {
      refused(by("again-said"), t("Not started."), error);
    }
  });
}

// The decision

const adopt = by("adopt");
const said = by("decision-said");

function adoption() {
  const asked = { onto_active: adopt.dataset.onto !== undefined };
  const boxes = document.querySelectorAll("input[name=effect]");
  const places = chosen("effect").map(Number);
  const isDefault = [...boxes].every((box) => box.checked === box.defaultChecked);
  if (boxes.length && !(isDefault && places.length)) asked.effects = places;
  return asked;
}

const preview = () => sendVersion("POST", `${analysis}/adopt?preview=true`, adoption());

async function price() {
  if (adopt.dataset.onto !== undefined) return;
  try {
    by("price").textContent = changeWords(await preview());
  } catch (error) {
    by("price").textContent = error.message;
  }
}

if (adopt) {
  price();
  for (const box of document.querySelectorAll("input[name=effect]")) {
    box.addEventListener("change", () => {
      said.replaceChildren();
      price();
    });
  }
  adopt.addEventListener("click", async () => {
    try {
      const found = await preview();
      const verb = t("Adopt as v%(version)s", { version: room.dataset.next });
      const back = t("v%(version)s stays as it is: going back to it undoes this.", { version: found.active_version });
      const lines = [...lossLines(found), found.activated ? back : `${t("It would be stored and wait.")} ${back}`];
      askOnce(said, changeWords(found), lines, verb, async () => {
        const made = await sendVersion("POST", `${analysis}/adopt`, adoption());
        if (made.activated === false) waits(made);
        else shown(number);
      });
    } catch (error) {
      refused(said, t("Not adopted."), error);
    }
  });
}

function waits(made) {
  askOnce(said, made.next_step, lossLines(made), t("Activate v%(version)s all the same", { version: made.model_version }), async () => {
    await send("POST", `${api}/models/${made.model_version}/activate`);
    shown(number);
  });
}

function activating(id, verb) {
  on(id, "click", async () => {
    const version = by(id).dataset.version;
    const path = `${api}/models/${version}/activate`;
    try {
      const found = await sendVersion("POST", `${path}?preview=true`);
      const back = t("v%(version)s stays stored: activating it undoes this.", { version: found.active_version });
      askOnce(said, changeWords(found), [...lossLines(found), back], verb(version), async () => {
        await send("POST", path);
        shown(number);
      });
    } catch (error) {
      refused(said, t("Not done: %(act)s.", { act: verb(version) }), error);
    }
  });
}

activating("back", (version) => t("Go back to v%(version)s", { version }));
activating("forward", (version) => t("Activate v%(version)s", { version }));

for (const button of document.querySelectorAll("[data-assign]")) {
  const place = button.closest("li").querySelector(".said");
  const asked = { [button.dataset.assign]: button.dataset.sensor };
  button.addEventListener("click", async () => {
    try {
      const found = await sendVersion("PUT", `${api}/sensor-assignment?preview=true`, asked);
      const back = t("v%(version)s stays stored: activating it undoes this.", { version: found.active_version });
      askOnce(place, changeWords(found), [...lossLines(found), back], button.textContent, async () => {
        const made = await sendVersion("PUT", `${api}/sensor-assignment`, asked);
        told(place, made.next_step ?? t("Done. Store the next check to see what it is worth."));
      });
    } catch (error) {
      refused(place, t("Not assigned."), error);
    }
  });
}

// Checks

addEventListener("thermap-changed", ({ detail }) => {
  if (detail.path === "verifications" && !detail.stored.warnings.length) shown(number);
});

on("every", "change", () => {
  for (const box of document.querySelectorAll("input[name=check]")) box.checked = by("every").checked;
});

// Values that are typed in, a row each; a row without an error is none.

const rows = document.querySelector("#typed tbody");
const field = (row, name) => row.querySelector(`[name=${name}]`);

function another() {
  const last = rows.lastElementChild;
  const row = last.cloneNode(true);
  for (const name of ["position", "error", "time"]) field(row, name).value = "";
  field(row, "direction").value = field(last, "direction").value;
  rows.append(row);
  field(row, "position").focus();
}

function observation(row, error, position) {
  const value = (name) => field(row, name).value;
  return {
    time: momentOf(value("time")) ?? value("time"),
    component: value("component").trim(),
    measured_um: error,
    // What has no position, squareness, has no approach either.
    ...(position !== null && { position_mm: position }),
    ...(position !== null && value("direction") && { direction: value("direction") }),
  };
}

if (rows) {
  on("typed-more", "click", another);
  rows.addEventListener("input", ({ target }) => {
    const time = field(target.closest("tr"), "time");
    if (target.name === "error" && !time.value) time.value = typedOf(Date.now());
  });
  // What was shown was of what was typed then.
  document.querySelector("#typed form").addEventListener("input", () => by("preview").replaceChildren());
  document.querySelector("#typed form").addEventListener("submit", async (event) => {
    event.preventDefault();
    const label = by("typed-label").value;
    const filled = [...rows.rows].filter((row) => field(row, "error").value.trim());
    const fields = [by("typed-repeatability"), ...filled.flatMap((row) => [field(row, "error"), field(row, "position")])];
    const numbers = numbersIn(fields, by("checks-said"));
    if (!numbers) return;
    const [repeatability_um, ...read] = numbers;
    const observations = filled.map((row, i) => observation(row, read[2 * i], read[2 * i + 1]));
    by("checks-said").replaceChildren();
    const check = { label, datum: by("typed-datum").value, repeatability_um, observations };
    const { take } = await uploading;
    take("typed values.json", new TextEncoder().encode(JSON.stringify(check)).buffer, by("typed-send"));
  });
}

function deleting(attribute, what, path, place) {
  for (const button of document.querySelectorAll(`[data-${attribute}]`)) {
    button.addEventListener("click", () => {
      const id = button.dataset[attribute];
      const name = button.dataset.label ?? id;
      askOnce(by(place), t("%(what)s %(name)s cannot be brought back.", { what, name }), [], t("Delete %(what)s %(name)s", { what: document.documentElement.lang === "en" ? what.toLowerCase() : what, name }), async () => {
        await send("DELETE", `${api}/${path}/${id}`);
        shown(attribute === "drop" ? null : number);
      }, true);
    });
  }
}

deleting("delete", t("Check"), "verifications", "checks-said");
deleting("drop", t("Analysis"), "analyses", "jobs-said");

// What the active model leaves of each check: asked for when it is seen, one after the other.

let turn = Promise.resolve();

async function showResiduals(cell) {
  try {
    const part = await send("GET", cell.dataset.residuals, undefined, "*/*");
    const left = new DOMParser().parseFromString(await part.text(), "text/html").getElementById("left");
    cell.textContent = left.textContent;
    cell.title = left.title;
  } catch (error) {
    cell.textContent = "–";
    cell.title = error.message;
  }
}

const watcher = new IntersectionObserver((entries) => {
  for (const entry of entries.filter((one) => one.isIntersecting)) {
    watcher.unobserve(entry.target);
    turn = turn.then(() => showResiduals(entry.target));
  }
});
for (const cell of document.querySelectorAll("[data-residuals]")) watcher.observe(cell);

// Planning: what the chosen checks could see together with the visit that is proposed.

on("plan", "click", async () => {
  const place = by("checks-said");
  by("plan").disabled = true;
  told(place, t("Planning: what these checks could see, and which visit to add."));
  try {
    let planned = [];
    if (number) {
      const { result } = await send("GET", analysis);
      planned = result?.next_visits.map((one) => one.planned) ?? [];
    }
    const plan = await send("POST", `${api}/analyses/plan`, { verifications: chosen("check").map(Number), planned });
    told(place, plan.summary);
    const further = plan.suggestions.map((one) => one.visit.sentence).filter((one) => !plan.summary.includes(one.slice(0, -1)));
    place.append(list([...further, ...plan.notes]));
  } catch (error) {
    refused(place, t("Not planned."), error);
  }
  by("plan").disabled = false;
});

// Who came for it from another page has it at once.
if (location.hash === "#plan" && by("plan") && !by("plan").disabled) by("plan").click();
if (location.hash === "#file") by("choose")?.focus();
