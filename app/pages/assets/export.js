// A controller's files: what they are, what to check after loading, and what they do not hold.
import { list, refused, send, signed, told } from "./ask.js";

const room = document.getElementById("export");
const said = document.getElementById("said");
const place = document.getElementById("shown");

function stated() {
  const options = {};
  for (const input of document.querySelectorAll("[data-option]")) {
    const text = input.value.trim();
    if (!text) continue;
    try {
      options[input.dataset.option] = JSON.parse(text);
    } catch {
      options[input.dataset.option] = text;
    }
  }
  return { options };
}

function add(tag, parent, text, kind) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  parent.append(made);
  return made;
}

function table(title, heads, rows, none) {
  add("h3", place, title);
  if (!rows.length) {
    add("p", place, none, "quiet");
    return;
  }
  const made = add("table", add("div", place, undefined, "scroll"), undefined, "whole");
  const head = add("tr", add("thead", made));
  for (const text of heads) add("th", head, text).scope = "col";
  const body = add("tbody", made);
  for (const row of rows) {
    const line = add("tr", body);
    row.forEach((text, i) => {
      const cell = add(i ? "td" : "th", line, text);
      if (!i) cell.scope = "row";
    });
  }
}

function show(answer) {
  place.replaceChildren();
  if (answer.warnings.length) place.append(list(answer.warnings));
  table(
    "Check after loading",
    ["Axis", "to, mm", "coming", "moves", "by, µm", "shows"],
    answer.check.map((one) => [
      one.axis.toUpperCase(), `${one.position_mm}`, one.direction, one.moved_axis.toUpperCase(),
      signed(one.expected_movement_um), one.component,
    ]),
    "There is no move that would show it: the compensation is zero.",
  );
  table(
    "Not held by this controller",
    ["Component", "largest", "why"],
    answer.not_held.map((one) => [one.component, `${one.largest.toFixed(1)} ${one.unit}`, one.why]),
    "It holds everything.",
  );
  table(
    "Added by spacing and rounding",
    ["Component", "largest"],
    answer.resampling.map((one) => [one.component, `${one.largest_deviation.toFixed(1)} ${one.unit}`]),
    "Nothing.",
  );
  add("h3", place, "Files");
  for (const file of answer.files) {
    const one = add("details", place);
    add("summary", one, `${file.name} (${file.role})`);
    const text = add("pre", one, file.content);
    text.tabIndex = 0;
  }
}

async function ask(what, act) {
  told(said, "Making the files.");
  try {
    await act();
    said.replaceChildren();
  } catch (error) {
    refused(said, what, error);
  }
}

document.getElementById("show")?.addEventListener("click", () =>
  ask("No file was made.", async () => show(await send("POST", room.dataset.path, stated()))),
);

document.getElementById("download")?.addEventListener("click", () =>
  ask("Nothing was downloaded.", async () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await send("POST", room.dataset.path, stated(), "application/zip"));
    link.download = room.dataset.name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }),
);
