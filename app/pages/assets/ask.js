// Asking the service: what it refuses is said where it was asked, and decisions ask once.

const PLACES = 1;

// What the page's language says, by the English messages; nothing where the page is English.
const SAID = JSON.parse(document.getElementById?.("messages")?.textContent ?? "{}");
const PLURALS = new Intl.PluralRules(document.documentElement.lang || "en");
const FORMS = ["zero", "one", "two", "few", "many", "other"].filter((form) => PLURALS.resolvedOptions().pluralCategories.includes(form));

const filled = (pattern, values) => pattern.replace(/%\((\w+)\)s|%%/g, (place, name) => (name ? values[name] : "%"));

export function t(message, values = {}) {
  return filled(SAID[message]?.[0] || message, values);
}

// A message of so many things, as %(count)s.
export function counted(count, one, more, values = {}) {
  const forms = SAID[one] ?? [one, more];
  return filled(forms[Math.min(FORMS.indexOf(PLURALS.select(count)), forms.length - 1)], { count, ...values });
}

// What was not recognised, and stays in English.
const english = new Set();

// The service answers in English: what it says is said anew, each text as a whole or not at all.
export async function saidAnew(texts) {
  if ((document.documentElement.lang || "en") === "en" || !texts.length) return texts;
  try {
    const asked = new URLSearchParams(texts.map((text) => ["text", text]));
    const answer = await fetch(`/said?${asked}`, { headers: { Accept: "application/json" }, cache: "no-store" });
    const said = answer.ok ? await answer.json() : texts.map(() => null);
    return texts.map((text, i) => said[i] ?? (english.add(text), text));
  } catch {
    return texts;
  }
}

// Reads a refusal: why, and what is wrong with which field.
export async function problemOf(answer) {
  const { detail, errors = [] } = await answer.json().catch(() => ({}));
  const [why, ...messages] = await saidAnew([detail ?? "", ...errors.map((one) => one.message)]);
  const strung = (texts) => errors.map((one, i) => `${one.field}: ${texts[i]}`).join("; ");
  // What only strings the fields together is said with their words, however the fields are named.
  const isStrung = errors.length > 0 && detail === strung(errors.map((one) => one.message));
  const words = isStrung ? strung(messages) : detail ? why : t("The service answered %(status)s.", { status: answer.status });
  return { detail: words, errors: errors.map((one, i) => ({ ...one, message: messages[i] })) };
}

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
    throw new Refusal(t("The service was not reached. Nothing has changed that it did not say."));
  }
  if (answer.ok) {
    if (answer.status === 204) return null;
    return accept === "application/json" ? answer.json() : answer.blob();
  }
  const problem = await problemOf(answer);
  throw new Refusal(problem.detail, problem.errors, answer.status);
}

// The same, where the answer is a version or its preview: what the service says of it is said anew.
export async function sendVersion(method, path, content) {
  const found = await send(method, path, content);
  const [why, next, ...losses] = await saidAnew([found.not_compared ?? "", found.next_step ?? "", ...found.loses.map((one) => one.text)]);
  const loses = found.loses.map((one, i) => ({ ...one, text: losses[i] }));
  return { ...found, not_compared: why || null, next_step: next || null, loses };
}

function element(tag, text, kind) {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  if (english.has(text)) made.lang = "en";
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
  const why = element("span", sentence(error.message));
  box.append(element("b", `${what} `), why);
  if (english.has(error.message)) why.lang = "en";
  if (error.errors?.length) {
    const lines = list(error.errors.map((one) => `${one.field}: ${one.message}`));
    error.errors.forEach((one, i) => english.has(one.message) && (lines.children[i].lang = "en"));
    box.append(lines);
  }
  if (error.status === 409) {
    // Somebody else was first, and this page does not show it yet.
    const again = element("a", t("Show how it is now"));
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
  const no = element("button", t("Leave it as it is"), destroys ? "first" : "");
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
      refused(place, t("Not done: %(act)s.", { act: verb }), error);
    }
  });
  buttons.append(...(destroys ? [no, yes] : [yes, no]));
  box.append(element("p", words));
  if (lines.length) box.append(list(lines));
  box.append(buttons);
  place.replaceChildren(box);
  (destroys ? no : yes).focus();
}

// The zone in which this page writes times, its decimal mark and its units.
const { zone: ZONE, decimal: MARK = ".", temperature: DEGREES, length: LENGTH } = document.documentElement.dataset;
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
const THOUSANDS = MARK === "," ? /^[+-]?[1-9]\d{0,2}\.\d{3}$/ : /^[+-]?[1-9]\d{0,2},\d{3}$/;

export const marked = (text) => text.replace(".", MARK);

// Units of the service, each with the reader's, and how a value is read back from that.
const INCH = { unit: "in", from: (inch) => inch * 25.4, to: (mm) => mm / 25.4, digits: 3, typed: 5 };
const FAHRENHEIT = { unit: "°F", from: (f) => (f - 32) / 1.8, to: (c) => c * 1.8 + 32, digits: 2, typed: 4 };
const SAME = { from: (value) => value, to: (value) => value };

function readersUnit(unit) {
  if (unit === "mm" && LENGTH === "in") return INCH;
  return unit === "°C" && DEGREES === "°F" ? FAHRENHEIT : { ...SAME, unit };
}

const rounded = (value, digits) => Number(value.toFixed(digits));

// A value and its unit as the reader wants them.
export function inReadersUnit(value, unit) {
  const own = readersUnit(unit);
  return [own.to(value), own.unit];
}

export function position(mm) {
  const own = readersUnit("mm");
  return marked(`${own.digits ? rounded(own.to(mm), own.digits) : mm}`.replace("-", "−"));
}

// Fills a field that says its unit; the exact value stays beside what is shown.
export function fill(field, value) {
  const own = readersUnit(field.dataset.unit);
  field.value = value === null ? "" : marked(`${own.typed ? rounded(own.to(value), own.typed) : value}`);
  field.dataset.shown = field.value;
  field.dataset.si = value ?? "";
}

// What a field says, in the unit of the service: what is as it was filled is what it was filled with.
export function valueOf(field) {
  if (field.dataset.si && field.value === (field.dataset.shown ?? field.defaultValue)) return Number(field.dataset.si);
  const typed = numberOf(field.value);
  return typed === null ? null : rounded(readersUnit(field.dataset.unit).from(typed), 9);
}

// A number as people type it, with a decimal point or comma, whatever the browser's language is.
// Gives null for what is none, and for a mark of which nobody knows whether it parts thousands.
export function numberOf(text) {
  const plain = text.trim().replace("−", "-");
  if (THOUSANDS.test(plain)) return null;
  const written = plain.includes(".") ? plain : plain.replace(",", ".");
  return NUMBER.test(written) ? Number(written) : null;
}

export function signed(value) {
  const text = Math.abs(value).toFixed(PLACES);
  if (Number(text) === 0) return marked(text);
  return (value > 0 ? "+" : "−") + marked(text);
}

// What a preview says: the largest change now and its place, and where it was larger before.
export function changeWords(preview) {
  const [then] = preview.recorded.changes;
  if (!then) return changeNow(preview);
  const at = placeOf(then);
  const when = dayAndTime(then.time);
  const values = { time: when, code: then.component, size: `${signed(then.change)} ${then.unit}${at}` };
  const worst = counted(
    preview.recorded.count,
    "At the one recorded reading (%(time)s) it would have changed %(code)s by %(size)s.",
    "At the worst of %(count)s recorded readings (%(time)s) it would have changed %(code)s by %(size)s.",
    values,
  );
  return `${changeNow(preview)} ${worst}`;
}

function placeOf({ component, position_mm: mm }) {
  if (mm === null) return "";
  const place = `${component.at(-1)} ${position(mm)}${LENGTH === "in" ? " in" : ""}`;
  return ` ${t("at %(place)s", { place })}`;
}

function changeNow(preview) {
  if (preview.not_compared) return t("What it changes now is not known: %(why)s.", { why: preview.not_compared });
  const [largest, ...others] = preview.changes;
  if (!largest || largest.change === 0) return t("At the present temperatures it changes nothing.");
  const at = placeOf(largest);
  const rest = others.filter((one) => one.change !== 0).length;
  const values = { code: largest.component, size: `${signed(largest.change)} ${largest.unit}${at}` };
  if (!rest) return t("The error in the live table changes now: %(code)s by %(size)s, nothing else.", values);
  return counted(
    rest,
    "The error in the live table changes now: %(code)s by %(size)s, %(count)s more component by less.",
    "The error in the live table changes now: %(code)s by %(size)s, %(count)s more components by less.",
    values,
  );
}

export function lossLines(preview) {
  return preview.loses.map((one) => t("It would lose %(what)s.", { what: one.text }));
}
