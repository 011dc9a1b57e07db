// The form that describes a machine: drawn as it is typed, and sent as it stands.
import { Refusal, refused, send, t, valueOf } from "./ask.js";

const form = document.getElementById("machine-form");
const rows = document.getElementById("sensor-rows");
const said = document.getElementById("machine-said");
const chain = document.getElementById("chain");
const stored = form.dataset.id;
const machine = `/v1/machines/${encodeURIComponent(stored)}`;
// The form is sent whole, so that it would take back what somebody else has changed meanwhile.
const shown = stored ? send("GET", machine).catch(() => null) : null;
const STATED = ["name", "serial_number", "configuration", "axes", "sensors"];
const stated = (one) => JSON.stringify(STATED.map((field) => one?.[field]));
const LINKS = { workpiece: t("workpiece"), bed: t("bed"), tool: t("tool") };

// "XYFZ": the letters before F move the workpiece, from the bed outward, so they are drawn backwards.
function drawn() {
  const text = form.elements.configuration.value.trim().toUpperCase();
  const axes = [...text].filter((letter) => letter !== "F");
  const isOne = /^[XYZF]{2,4}$/.test(text) && text.split("F").length === 2 && new Set(axes).size === axes.length;
  const [workpiece, tool] = isOne ? text.split("F") : ["", ""];
  const links = ["workpiece", ...[...workpiece].reverse(), "bed", ...tool, "tool"];
  chain.replaceChildren(
    ...(isOne ? links : [t("X, Y, Z around one F, such as XYFZ")]).map((link) => {
      const made = document.createElement("li");
      made.textContent = ["workpiece", "bed", "tool"].includes(link) ? LINKS[link] : link;
      made.className = link === "bed" ? "bed" : isOne ? "" : "wrong";
      return made;
    }),
  );
  for (const travel of form.querySelectorAll(".travel")) travel.hidden = isOne && !axes.includes(travel.dataset.axis.toUpperCase());
}

function names() {
  return [...rows.querySelectorAll("[name=sensor]")].map((one) => one.value.trim()).filter(Boolean);
}

function offered() {
  document.getElementById("sensor-names").replaceChildren(
    ...names().map((name) => {
      const made = document.createElement("option");
      made.value = name;
      return made;
    }),
  );
}

function another(name = "") {
  const fresh = rows.lastElementChild.cloneNode(true);
  const number = rows.children.length + 1;
  for (const one of fresh.querySelectorAll("input")) {
    one.value = one.name === "sensor" ? name : "";
    one.ariaLabel = one.ariaLabel.replace(/\d+$/, number);
  }
  rows.append(fresh);
  return fresh;
}

// A column of names, as it stands in a sheet, fills one row each.
rows.addEventListener("paste", (event) => {
  const lines = event.clipboardData.getData("text").split(/\r?\n|\t/).map((line) => line.trim()).filter(Boolean);
  if (lines.length < 2 || event.target.name !== "sensor") return;
  event.preventDefault();
  const inputs = [...rows.querySelectorAll("[name=sensor]")];
  let at = inputs.indexOf(event.target);
  for (const line of lines) {
    if (at < inputs.length) inputs[at].value = line;
    else another(line);
    at += 1;
  }
  offered();
});

const asId = (name) => name.replaceAll("ß", "ss").normalize("NFKD").replace(/\p{M}/gu, "").replace(/[^A-Za-z0-9._-]+/g, "-").replace(/^[^A-Za-z0-9]+|-+$/g, "").toLowerCase().slice(0, 64);

// Travels that were typed: nothing where a number is none, which is said at its place.
function axes() {
  const found = {};
  for (const travel of form.querySelectorAll(".travel:not([hidden])")) {
    const [min, max] = travel.querySelectorAll("input");
    if (!min.value.trim() && !max.value.trim()) {
      if (stored && min.defaultValue) found[travel.dataset.axis] = null;
      continue;
    }
    const ends = [min, max].map(valueOf);
    for (const [i, one] of [min, max].entries()) {
      if (ends[i] === null) {
        one.setAttribute("aria-invalid", "true");
        document.getElementById("wrong-axes").textContent = t("Expected both ends of %(axis)s in %(unit)s, such as 0 and 500, got “%(got)s”.", { axis: travel.dataset.axis.toUpperCase(), unit: document.documentElement.dataset.length, got: one.value.trim() });
        one.focus();
        return null;
      }
    }
    [found[travel.dataset.axis]] = [{ min_mm: ends[0], max_mm: ends[1] }];
  }
  return found;
}

async function asItWasShown() {
  const now = await send("GET", machine);
  if (stated(now) === stated(await shown)) return now;
  throw new Refusal(t("The machine was changed elsewhere after this page had shown it."), [], 409);
}

async function sensors() {
  const before = stored ? (await asItWasShown()).sensors : [];
  return [...rows.rows]
    .map((row) => [...row.querySelectorAll("input")].map((one) => one.value.trim()))
    .filter(([name]) => name)
    .map(([name, standIn]) => {
      const present = before.find((one) => one.name === name) ?? { name };
      // Not stated at all, a new sensor has the usual stand-in.
      return standIn || "stand_in" in present ? { ...present, stand_in: standIn || null } : present;
    });
}

function clear() {
  for (const one of form.querySelectorAll(".wrong:not(li)")) one.textContent = "";
  for (const one of form.querySelectorAll("[aria-invalid]")) one.removeAttribute("aria-invalid");
  said.replaceChildren();
}

// What is refused is said at the field that it is about.
function place(error) {
  const others = [];
  for (const one of error.errors ?? []) {
    const [name] = one.field.split(".");
    const wrong = document.getElementById(`wrong-${name}`);
    if (!wrong) {
      others.push(one);
      continue;
    }
    wrong.textContent += `${wrong.textContent ? " " : ""}${one.message}`;
    const input = form.elements[name];
    input?.setAttribute?.("aria-invalid", "true");
    input?.focus?.();
  }
  error.errors = others;
  refused(said, t("Not stored."), error);
}

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  clear();
  const travels = axes();
  if (!travels) return;
  const button = document.getElementById("store-machine");
  button.disabled = true;
  try {
    const name = form.elements.name.value.trim();
    const serial_number = form.elements.serial_number.value.trim() || null;
    const body = { name, serial_number, configuration: form.elements.configuration.value.trim(), axes: travels, sensors: await sensors() };
    if (stored) {
      await send("PATCH", machine, body);
      location.reload();
      return;
    }
    const made = await send("POST", "/v1/machines", { ...body, id: form.elements.id.value.trim() || asId(name) });
    location.assign(`/machines/${encodeURIComponent(made.id)}/setup`);
  } catch (error) {
    place(error);
  }
  button.disabled = false;
});

form.elements.configuration.addEventListener("input", drawn);
rows.addEventListener("input", offered);
document.getElementById("more-sensors").addEventListener("click", () => another().querySelector("input").focus());
document.getElementById("store-machine").disabled = false;
drawn();
offered();
