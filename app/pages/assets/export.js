// A controller's files: what they are, what to check after loading, and what they do not hold.
import { counted, inReadersUnit, list, marked, numberOf, refused, Refusal, saidAnew, send, signed, t, timeOfDay, told } from "./ask.js";

const room = document.getElementById("export");
const form = document.getElementById("options");
const said = document.getElementById("said");
const place = document.getElementById("shown");
const show = document.getElementById("show");
const download = document.getElementById("download");
const others = document.getElementById("others");

// What is no number goes as it was typed: the service says what is wrong with it.
function value(input, takes) {
  const text = input.value.trim();
  if (takes === "choice") return JSON.parse(text);
  return takes === "text" ? text : (numberOf(text) ?? text);
}

function stated() {
  const options = {};
  for (const one of form.querySelectorAll(".option")) {
    const { name, takes } = one.dataset;
    if (takes === "components") {
      const boxes = [...one.querySelectorAll("input")];
      if (!boxes.every((box) => box.checked)) options[name] = boxes.filter((box) => box.checked).map((box) => box.value);
      continue;
    }
    for (const input of one.querySelectorAll("input, select")) {
      if (!input.value.trim()) continue;
      if (!input.dataset.axis) options[name] = value(input, takes);
      else options[name] = { ...options[name], [input.dataset.axis]: value(input, takes) };
    }
  }
  return { options };
}

function hasChanged(one) {
  if (one.type === "checkbox") return one.checked !== one.defaultChecked;
  if (one instanceof HTMLSelectElement) return !one.selectedOptions[0].defaultSelected;
  return one.value.trim() !== one.defaultValue;
}

function clear() {
  for (const one of form.querySelectorAll(".wrong")) one.textContent = "";
  for (const one of form.querySelectorAll("[aria-invalid]")) one.removeAttribute("aria-invalid");
  said.replaceChildren();
}

// Says at its option what is wrong with it; gives what belongs to none.
function placed(errors) {
  const left = [];
  let first = null;
  for (const error of errors) {
    const [, name, axis] = error.field.split(".");
    const wrong = error.field.startsWith("options.") && document.getElementById(`wrong-${name}`);
    if (!wrong) {
      left.push(error);
      continue;
    }
    wrong.textContent += `${wrong.textContent ? " " : ""}${axis ? `${axis.toUpperCase()}: ` : ""}${error.message}`;
    const input = document.getElementById(`option-${name}${axis ?? ""}`) ?? wrong.parentElement.querySelector("input, select");
    if (input.type !== "checkbox") input.setAttribute("aria-invalid", "true");
    if (others?.contains(input)) others.open = true;
    first ??= input;
  }
  first?.focus();
  return left;
}

function add(tag, parent, text, kind) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  parent.append(made);
  return made;
}

// Columns that hold words are named; the others hold numbers.
function table(title, heads, words, rows, none) {
  add("h3", place, title);
  if (!rows.length) {
    add("p", place, none, "quiet");
    return;
  }
  const frame = add("div", place, undefined, "scroll");
  frame.role = "region";
  frame.ariaLabel = title;
  frame.tabIndex = 0;
  const made = add("table", frame, undefined, "whole");
  const kind = (i) => (words.includes(i) ? "words" : "");
  const head = add("tr", add("thead", made));
  heads.forEach((text, i) => {
    add("th", head, text, kind(i)).scope = "col";
  });
  const body = add("tbody", made);
  for (const row of rows) {
    const line = add("tr", body);
    row.forEach((text, i) => {
      const cell = add(i ? "td" : "th", line, text, kind(i));
      if (!i) cell.scope = "row";
    });
  }
}

function save(content, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function sentence(words) {
  return `${words[0].toUpperCase()}${words.slice(1)}.`;
}

const SIGNS = { error: t("error, actual minus nominal"), compensation: t("compensation, minus the error") };

function head(answer) {
  const at = Object.entries(answer.temperatures_c).map(([name, c]) => `${name} ${marked(inReadersUnit(c, "°C")[0].toFixed(2).replace("-", "−"))}\u00a0${inReadersUnit(c, "°C")[1]}`);
  const made = add("p", place, t("Made %(time)s with v%(version)s at %(temperatures)s. Values: %(sign)s.", { time: timeOfDay(answer.computed_at), version: answer.model_version, temperatures: at.join(", "), sign: SIGNS[answer.sign] }));
  made.tabIndex = -1;
  if (!answer.complete) add("p", place, t("The compensation table is not complete."), "caution");
  saidAnew(answer.warnings).then((warnings) => warnings.length && made.after(list(warnings.map(sentence))));
}

function shown(answer) {
  place.replaceChildren();
  head(answer);
  table(
    t("Check after loading"),
    [t("Axis"), t("to, mm"), t("direction"), t("moves"), t("by, µm"), t("shows")],
    [0, 2, 3, 5],
    answer.check.map((one) => [
      one.axis.toUpperCase(), marked(`${one.position_mm}`).replace("-", "−"), one.direction.replace("-", "−"),
      one.moved_axis.toUpperCase(), signed(one.expected_movement_um), one.component,
    ]),
    t("There is no move that would show it: the compensation is zero."),
  );
  table(
    t("Not held by this controller"),
    [t("Component"), t("largest"), t("why")],
    [0, 2],
    answer.not_held.map((one) => [one.component, `${marked(one.largest.toFixed(1))} ${one.unit}`, one.why]),
    t("It holds everything."),
  );
  table(
    t("Added by spacing and rounding"),
    [t("Component"), t("largest")],
    [0],
    answer.resampling.map((one) => [one.component, `${marked(one.largest_deviation.toFixed(1))} ${one.unit}`]),
    t("Nothing."),
  );
  add("h3", place, t("Files"));
  for (const file of answer.files) {
    const row = add("div", place, undefined, "file");
    const one = add("details", row);
    add("summary", one, `${file.name} (${file.role})`);
    const text = add("pre", one, file.content);
    text.tabIndex = 0;
    const button = add("button", row, t("Save %(file)s", { file: file.name }), "small");
    button.type = "button";
    button.addEventListener("click", () => save(new Blob([file.content], { type: "text/plain" }), file.name));
  }
  place.firstElementChild.focus();
}

async function ask(what, act) {
  clear();
  told(said, t("Making the files."));
  show.disabled = download.disabled = true;
  try {
    await act();
  } catch (error) {
    const left = error.errors?.length ? placed(error.errors) : [];
    const words = error.errors?.length && !left.length ? t("What is wrong stands at its option.") : error.message;
    refused(said, what, new Refusal(words, left.length === error.errors?.length ? [] : left));
  }
  show.disabled = download.disabled = false;
}

form?.addEventListener("submit", (event) => {
  event.preventDefault();
  place.replaceChildren();
  ask(t("No file was made."), async () => {
    const answer = await send("POST", room.dataset.path, stated());
    said.replaceChildren();
    shown(answer);
  });
});

// A zip is made anew, at the reading of its own moment, and has its own check table.
download?.addEventListener("click", () =>
  ask(t("Nothing was downloaded."), async () => {
    save(await send("POST", room.dataset.path, stated(), "application/zip"), room.dataset.name);
    told(said, t("%(file)s was made %(time)s at the reading of then. Its check table is in it: thermap-check.txt.", { file: room.dataset.name, time: timeOfDay(Date.now()) }));
  }),
);

// What is shown was made with what was stated then.
form?.addEventListener("input", () => {
  clear();
  place.replaceChildren();
  const count = others ? new Set([...others.querySelectorAll("input, select")].filter(hasChanged).map((one) => one.closest(".option"))).size : 0;
  if (others) document.getElementById("others-said").textContent = count ? counted(count, "%(count)s stated otherwise", "%(count)s stated otherwise") : t("all at the default");
});

if (form) show.disabled = download.disabled = false;
