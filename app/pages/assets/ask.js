// Asking the service: what it refuses is said where it was asked, and decisions ask once.

const PLACES = 1;

export class Refusal extends Error {
  constructor(detail, errors, status) {
    super(detail);
    this.errors = errors ?? [];
    this.status = status;
  }
}

export async function send(method, path, content, accept = "application/json") {
  const options = { method, headers: { Accept: accept }, cache: "no-store" };
  if (content !== undefined) {
    const isFile = content instanceof ArrayBuffer;
    options.headers["Content-Type"] = isFile ? "application/octet-stream" : "application/json";
    options.body = isFile || typeof content === "string" ? content : JSON.stringify(content);
  }
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Refusal("The service was not reached. Nothing has changed that it did not say.");
  }
  if (answer.ok) {
    if (answer.status === 204) return null;
    return accept === "application/json" ? answer.json() : answer.blob();
  }
  const problem = await answer.json().catch(() => ({}));
  throw new Refusal(problem.detail ?? `The service answered ${answer.status}.`, problem.errors, answer.status);
}

function element(tag, text, kind) {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

export function list(lines) {
  const made = element("ul");
  made.append(...lines.map((line) => element("li", line)));
  return made;
}

const sentence = (words) => words.charAt(0).toUpperCase() + words.slice(1);

export function refused(place, what, error) {
  const box = element("div", "", "refused");
  box.role = "alert";
  box.append(element("b", `${what} `), element("span", sentence(error.message)));
  if (error.errors?.length) box.append(list(error.errors.map((one) => `${one.field}: ${one.message}`)));
  if (error.status === 409) {
    // Somebody else was first, and this page does not show it yet.
    const again = element("a", "Show how it is now");
    again.href = location.href;
    const line = element("p");
    line.append(again);
    box.append(line);
  }
  place.replaceChildren(box);
}

export function told(place, words) {
  place.replaceChildren(element("p", words));
}

// One question with what it changes and the way back; its button repeats the verb. Where it
// destroys, leaving things as they are comes first: Enter twice destroys nothing.
export function askOnce(place, words, lines, verb, act, destroys = false) {
  const opener = document.activeElement;
  const box = element("div", "", "asked");
  const buttons = element("div", "", "buttons");
  const yes = element("button", verb, destroys ? "" : "first");
  const no = element("button", "Leave it as it is", destroys ? "first" : "");
  yes.type = no.type = "button";
  no.dataset.leave = "";
  no.addEventListener("click", () => {
    place.replaceChildren();
    (opener.isConnected ? opener : document.getElementById(opener.id))?.focus();
  });
  yes.addEventListener("click", async () => {
    yes.disabled = no.disabled = true;
    try {
      await act();
    } catch (error) {
      refused(place, `Not done: ${verb}.`, error);
    }
  });
  buttons.append(...(destroys ? [no, yes] : [yes, no]));
  box.append(element("p", words));
  if (lines.length) box.append(list(lines));
  box.append(buttons);
  place.replaceChildren(box);
  (destroys ? no : yes).focus();
}

// The zone in which this page writes times.
const ZONE = document.documentElement.dataset.zone;
const WRITTEN = { timeZone: ZONE, hourCycle: "h23", year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit", second: "2-digit" };

function parts(time) {
  return Object.fromEntries(new Intl.DateTimeFormat("en-GB", { ...WRITTEN, timeZoneName: "short" }).formatToParts(new Date(time)).map((one) => [one.type, one.value]));
}

// A moment as the page writes it, such as 2026-03-02 07:00:00 CET.
export function dayAndTime(time) {
  const at = parts(time);
  return `${at.year}-${at.month}-${at.day} ${at.hour}:${at.minute}:${at.second} ${at.timeZoneName}`;
}

export const timeOfDay = (time) => dayAndTime(time).slice(11);

// What a field for a time holds, and the moment that is meant, in UTC as the service takes it.
export const typedOf = (time) => dayAndTime(time).slice(0, 19).replace(" ", "T");

export function momentOf(typed) {
  const asUtc = Date.parse(`${typed}Z`);
  if (Number.isNaN(asUtc)) return null;
  // The zone's clock is ahead by what it shows beside what was typed; twice, for the hour at which it changes.
  let moment = asUtc;
  for (let i = 0; i < 2; i += 1) moment = asUtc - (Date.parse(`${typedOf(moment)}Z`) - moment);
  return new Date(moment).toISOString();
}

const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;
const THOUSANDS = /^[+-]?[1-9]\d{0,2},\d{3}$/;

// A number as people type it, with a decimal point or comma, whatever the browser's language is.
// Gives null for what is none, and for a comma of which nobody knows whether it parts thousands.
export function numberOf(text) {
  const plain = text.trim().replace("−", "-");
  if (THOUSANDS.test(plain)) return null;
  const written = plain.includes(".") ? plain : plain.replace(",", ".");
  return NUMBER.test(written) ? Number(written) : null;
}

export function signed(value) {
  const text = Math.abs(value).toFixed(PLACES);
  if (Number(text) === 0) return text;
  return (value > 0 ? "+" : "−") + text;
}

// What a preview says: the largest change now and its place, and where it was larger before.
export function changeWords(preview) {
  const [then] = preview.recorded.changes;
  if (!then) return changeNow(preview);
  const at = then.position_mm === null ? "" : ` at ${then.component.at(-1)} ${then.position_mm}`;
  const when = dayAndTime(then.time);
  return (
    `${changeNow(preview)} At the worst of ${preview.recorded.count} recorded readings (${when}) it would have changed ` +
    `${then.component} by ${signed(then.change)} ${then.unit}${at}.`
  );
}

function changeNow(preview) {
  if (preview.not_compared) return `What it changes now is not known: ${preview.not_compared}.`;
  const [largest, ...others] = preview.changes;
  if (!largest || largest.change === 0) return "At the present temperatures it changes nothing.";
  const at = largest.position_mm === null ? "" : ` at ${largest.component.at(-1)} ${largest.position_mm}`;
  const rest = others.filter((one) => one.change !== 0).length;
  return (
    `The error in the live table changes now: ${largest.component} by ${signed(largest.change)} ${largest.unit}${at}` +
    (rest ? `, ${rest} more components by less.` : ", nothing else.")
  );
}

export function lossLines(preview) {
  return preview.loses.map((one) => `It would lose ${one.text}.`);
}
