// A machine over time. The service sums up and computes; here it is drawn, in one picture whose
// charts share their axis of time. The address holds what is shown.
import { dayAndTime, fill, inReadersUnit, marked, position as placed, refused, send, t, typedOf, valueOf } from "./ask.js";

const LIVE_MS = 10000;
const SHORTEST_S = 60;
const LONGEST_S = 3660 * 86400;
const LEFT = 64;
const RIGHT = 12;
const ROW = 132;
const GAP = 30;
const STRIP = 26;
const STEPS_S = [10, 30, 60, 300, 600, 1800, 3600, 10800, 21600, 43200, 86400, 172800, 604800, 1209600, 2629800, 7889400, 15778800, 31557600];
const SVG = "http://www.w3.org/2000/svg";

const place = document.getElementById("drawing");
const choices = document.getElementById("choices");
const machine = document.getElementById("charts").dataset.machine;
const address = `/v1/machines/${encodeURIComponent(machine)}/history`;
const ZONE = document.documentElement.dataset.zone;
const LANGUAGE = document.documentElement.lang === "en" ? "en-GB" : document.documentElement.lang;
const asTime = (options) => {
  const format = new Intl.DateTimeFormat(LANGUAGE, { timeZone: ZONE, ...options });
  return (s) => format.format(new Date(1000 * s));
};
const fullTime = (s) => dayAndTime(1000 * s);
const clock = asTime({ hour: "2-digit", minute: "2-digit" });
const clockS = asTime({ hour: "2-digit", minute: "2-digit", second: "2-digit" });
const day = asTime({ day: "numeric", month: "short" });
const month = asTime({ month: "short", year: "numeric" });
// By how much the zone's clock is ahead of UTC.
const ahead = (s) => Math.round(Date.parse(`${typedOf(1000 * s)}Z`) / 1000 - Math.floor(s));

const view = { since: 0, until: 0, isLive: true };
let found = null;
let rows = [];
let cursor = null;
let asked = 0;
let dragFrom = null;

// ---- what is shown ---------------------------------------------------------------------------

function readAddress() {
  const stated = new URLSearchParams(location.hash.slice(1));
  const span = Math.min(Math.max(Number(stated.get("span")) || 86400, SHORTEST_S), LONGEST_S);
  const to = Date.parse(stated.get("to") ?? "") / 1000;
  view.isLive = Number.isNaN(to);
  view.until = view.isLive ? Date.now() / 1000 : to;
  view.since = view.until - span;
  const sensors = stated.getAll("sensor");
  const boxes = [...choices.querySelectorAll("[name=sensor]")];
  const isStated = sensors.length > 0 || stated.has("component") || stated.has("residuals");
  choices.residuals.checked = stated.has("residuals");
  boxes.forEach((box, i) => { box.checked = isStated ? sensors.includes(box.value) : i < 4; });
  choices.component.value = stated.get("component") ?? "";
  if (choices.component.selectedIndex < 0) choices.component.value = "";
  placeAt(stated.get("position") ?? choices.component.selectedOptions[0].dataset.position);
}

// A position in mm, as the address and the page state it.
function placeAt(mm) {
  fill(choices.position, mm && Number.isFinite(Number(mm)) ? Number(mm) : null);
}

function chosen() {
  const option = choices.component.selectedOptions[0];
  const sensors = [...choices.querySelectorAll("[name=sensor]:checked")].map((box) => box.value);
  return { sensors, component: option.value, axis: option.dataset.axis ?? "", position: valueOf(choices.position) };
}

function writeAddress() {
  const { sensors, component, axis, position } = chosen();
  const stated = new URLSearchParams({ span: Math.round(view.until - view.since) });
  if (!view.isLive) stated.set("to", new Date(1000 * view.until).toISOString());
  for (const sensor of sensors) stated.append("sensor", sensor);
  if (component) stated.set("component", component);
  if (component && axis && position !== null) stated.set("position", position);
  if (choices.residuals.checked) stated.set("residuals", "true");
  history.replaceState(null, "", `#${stated}`);
}

function question(points) {
  const { sensors, component, axis, position } = chosen();
  const query = new URLSearchParams({ points });
  query.set("from", new Date(1000 * view.since).toISOString());
  query.set("to", new Date(1000 * view.until).toISOString());
  for (const sensor of sensors) query.append("sensor", sensor);
  if (component) query.set("component", component);
  if (component && axis && position !== null) query.set("position_mm", position);
  if (choices.residuals.checked) query.set("residuals", "true");
  return query;
}

async function load() {
  asked += 1;
  const mine = asked;
  if (view.isLive) {
    const span = view.until - view.since;
    view.until = Date.now() / 1000;
    view.since = view.until - span;
  }
  writeAddress();
  controls();
  const query = question(Math.max(100, Math.min(1500, Math.round(place.clientWidth - LEFT - RIGHT))));
  try {
    const answer = await send("GET", `${address}?${query}`);
    if (mine !== asked) return;
    found = answer;
    document.getElementById("said").replaceChildren();
    draw();
    marks();
  } catch (error) {
    if (mine === asked) refused(document.getElementById("said"), t("Not shown."), error);
  }
}

function show(since, until, isLive = false) {
  const middle = (since + until) / 2;
  const span = Math.min(Math.max(until - since, SHORTEST_S), LONGEST_S);
  view.until = isLive ? Date.now() / 1000 : middle + span / 2;
  view.since = view.until - span;
  view.isLive = isLive;
  cursor = null;
  load();
}

function controls() {
  const span = view.until - view.since;
  const until = view.isLive ? t("now") : fullTime(view.until);
  document.getElementById("range").textContent = t("%(since)s to %(until)s", { since: fullTime(view.since), until });
  for (const button of document.querySelectorAll("[data-span]")) {
    button.setAttribute("aria-pressed", String(Math.abs(Number(button.dataset.span) / span - 1) < 0.01));
  }
  document.getElementById("live").setAttribute("aria-pressed", String(view.isLive));
  document.getElementById("along").textContent = chosen().axis;
  choices.position.disabled = !chosen().axis;
  const query = question(2000);
  document.getElementById("json").href = `${address}?${query}`;
  query.set("format", "csv");
  document.getElementById("csv").href = `${address}?${query}`;
}

// ---- drawing ---------------------------------------------------------------------------------

function node(tag, attributes, text) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

// The numbers of every chart in one form: parts that are joined, each with its bins.
function chartsOf(answer) {
  const origin = Date.parse(answer.since) / 1000;
  const degrees = (value) => inReadersUnit(value, "°C")[0];
  const [, unit] = inReadersUnit(0, "°C");
  const charts = answer.sensors.map((one) => ({
    name: one.sensor, unit, digits: 2, wide: answer.bin_s,
    bins: one.after_s.map((s, i) => ({ s: origin + s, low: degrees(one.low_c[i]), high: degrees(one.high_c[i]), mean: degrees(one.mean_c[i]), count: one.count[i], gap: one.gap_s[i] > Math.max(one.max_age_s, 0) ? one.gap_s[i] : 0 })),
  }));
  const course = answer.compensation;
  if (course) {
    const at = course.position_mm === null ? "" : ` ${t("at")} ${placed(course.position_mm)} ${inReadersUnit(0, "mm")[1]}`;
    const bins = [];
    course.after_s.forEach((s, i) => {
      const value = course.values[i];
      const isFar = bins.length && origin + s - bins.at(-1).s > 3 * answer.bin_s + 120;
      if (value === null) return;
      bins.push({ s: origin + s - answer.bin_s / 2, low: value, high: value, mean: value, gap: isFar || (i && course.values[i - 1] === null) ? 1 : 0 });
    });
    charts.push({ name: `${t("Compensation")} ${course.component}${at}`, unit: course.unit, digits: 1, wide: answer.bin_s, bins });
  }
  const left = answer.checks.filter((check) => check.left_um !== null);
  if (choices.residuals.checked) {
    const bins = left.map((check) => ({ s: Date.parse(check.time) / 1000, low: check.left_um, high: check.left_um, mean: check.left_um, gap: 1 }));
    charts.push({ name: t("What is left of checks, root mean square"), unit: "µm", digits: 2, wide: 0, bins });
  }
  return charts;
}

function partsOf(bins) {
  const parts = [];
  for (const bin of bins) {
    if (!parts.length || bin.gap) parts.push([]);
    parts.at(-1).push(bin);
  }
  return parts;
}

function ticksOf(low, high, about) {
  const raw = (high - low) / about;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1) ticks.push(i * step);
  return [ticks, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}

function timeTicks(width) {
  const span = view.until - view.since;
  const most = Math.max(2, width / 90);
  const step = STEPS_S.find((s) => span / s <= most) ?? STEPS_S.at(-1);
  const shift = ahead(view.until);
  const ticks = [];
  for (let s = Math.ceil((view.since + shift) / step) * step - shift; s <= view.until; s += step) ticks.push(s);
  const isMidnight = (s) => (s + ahead(s)) % 86400 === 0;
  return [ticks, step < 60 ? clockS : step < 86400 ? (s) => (isMidnight(s) ? day(s) : clock(s)) : step < 2629800 ? day : month];
}

const number = (value, digits) => marked(value.toFixed(digits).replace("-", "−"));

function draw() {
  if (!found) return;
  const width = Math.max(280, place.clientWidth);
  const inner = width - LEFT - RIGHT;
  const charts = chartsOf(found);
  const height = charts.length * (ROW + GAP) + STRIP + 30;
  const svg = node("svg", { width, height, viewBox: `0 0 ${width} ${height}`, "font-family": "inherit", "aria-hidden": "true" });
  const x = (s) => LEFT + ((s - view.since) / (view.until - view.since)) * inner;
  const inside = (s) => Math.min(Math.max(x(s), LEFT), LEFT + inner);
  const [ticks, words] = timeTicks(inner);
  rows = charts.map((chart, i) => ({ ...chart, top: GAP * (i + 1) + ROW * i - 6 }));
  for (const row of rows) drawRow(svg, row, x, inside, inner, ticks);
  const stripTop = rows.length * (ROW + GAP) + 8;
  drawMarks(svg, x, inner, stripTop);
  let edge = 0;
  for (const s of ticks) {
    if (x(s) - edge < 50 || x(s) > width - 24) continue;
    edge = x(s);
    svg.append(node("text", { x: x(s), y: stripTop + STRIP + 14, "text-anchor": "middle", class: "t" }, words(s)));
  }
  const line = node("line", { id: "cursor", y1: 0, y2: stripTop + STRIP, class: "cursor", visibility: "hidden" });
  const span = node("rect", { id: "dragged", y: 0, height: stripTop + STRIP, class: "drag", visibility: "hidden" });
  svg.append(span, line);
  svg.prepend(node("style", {}, styles()));
  place.replaceChildren(svg);
  const gaps = rows.some((row) => row.bins.some((bin) => bin.gap));
  const wide = found.bin_s > 1 ? `${t("Line: mean of %(time)s; band: lowest to highest.", { time: lasting(found.bin_s) })} ` : "";
  const warnings = [...found.notes, ...(found.compensation?.warnings ?? [])].join("; ");
  const version = found.compensation?.model_version ? `${t("Compensation: by v%(version)s, which is active now, of the mean temperatures.", { version: found.compensation.model_version })} ` : "";
  document.getElementById("legend").textContent = `${wide}${gaps ? `${t("Thick line below: no readings for longer than the sensor's age limit.")} ` : ""}${version}${t("Dashed: versions and changes; bar: alarms; rings: checks. Drag to zoom in.")} ${warnings}`;
  showCursor();
}

function styles() {
  const own = getComputedStyle(document.documentElement);
  const of = (name) => own.getPropertyValue(name).trim();
  return `svg{background:${of("--plot")}} .t{font-size:12px;fill:${of("--ink-2")}} .h{font-size:13px;font-weight:600;fill:${of("--ink")}}
.g{stroke:${of("--line")}} .b{fill:${of("--band")}} .m{fill:none;stroke:${of("--ink")};stroke-width:1.6;stroke-linejoin:round} .d{fill:${of("--ink")}}
.x{stroke:${of("--mid")};stroke-width:4} .v{stroke:${of("--line-2")};stroke-dasharray:4 4} .a{fill:${of("--lim")};stroke:${of("--lim-edge")}} .n{fill:${of("--no")}}
.c{fill:none;stroke:${of("--ink")};stroke-width:1.6} .cb{fill:${of("--ink")}} .cursor{stroke:${of("--focus")};stroke-width:1.5} .drag{fill:${of("--focus")};fill-opacity:.15}`;
}

function drawRow(svg, row, x, inside, inner, ticks) {
  const lows = row.bins.map((bin) => bin.low);
  const highs = row.bins.map((bin) => bin.high);
  let [low, high] = row.bins.length ? [lows.reduce((a, b) => Math.min(a, b)), highs.reduce((a, b) => Math.max(a, b))] : [0, 1];
  const pad = Math.max((high - low) * 0.08, row.unit.startsWith("°") ? 0.05 : 0.1);
  [low, high] = [low - pad, high + pad];
  const y = (value) => row.top + ROW - ((value - low) / (high - low)) * ROW;
  svg.append(node("text", { x: LEFT, y: row.top - 6, class: "h" }, `${row.name}, ${row.unit}${row.bins.length ? "" : row.wide ? `: ${t("no readings in this time")}` : `: ${t("no check in this time that can be compared")}`}`));
  if (row.bins.length) {
    const [values, digits] = ticksOf(low, high, 4);
    for (const value of values) {
      svg.append(node("line", { x1: LEFT, x2: LEFT + inner, y1: y(value), y2: y(value), class: "g" }));
      svg.append(node("text", { x: LEFT - 6, y: y(value) + 4, "text-anchor": "end", class: "t" }, number(value, digits)));
    }
  }
  for (const s of ticks) svg.append(node("line", { x1: x(s), x2: x(s), y1: row.top, y2: row.top + ROW, class: "g" }));
  const middle = (bin) => inside(bin.s + row.wide / 2);
  for (const part of partsOf(row.bins)) {
    const up = part.map((bin) => `${middle(bin).toFixed(1)},${y(bin.high).toFixed(1)}`);
    const down = part.map((bin) => `${middle(bin).toFixed(1)},${y(bin.low).toFixed(1)}`).reverse();
    if (part.some((bin) => bin.high > bin.low)) {
      const edge = row.wide / 2;
      const points = part.length > 1 ? [...up, ...down] : [-edge, edge].flatMap((d, i) => (i ? [part[0].high, part[0].low] : [part[0].low, part[0].high]).map((v) => `${inside(part[0].s + edge + d).toFixed(1)},${y(v).toFixed(1)}`));
      svg.append(node("polygon", { points: points.join(" "), class: "b" }));
    }
    if (part.length > 1) svg.append(node("polyline", { points: part.map((bin) => `${middle(bin).toFixed(1)},${y(bin.mean).toFixed(1)}`).join(" "), class: "m" }));
    else svg.append(node("circle", { cx: middle(part[0]), cy: y(part[0].mean), r: row.wide ? 2 : 4, class: "d" }));
  }
  for (const [i, bin] of row.bins.entries()) {
    if (bin.gap < 2) continue;
    const from = i ? row.bins[i - 1].s + row.wide : view.since;
    const until = Math.max(bin.s, from) === from ? bin.s + row.wide : bin.s;
    svg.append(node("line", { x1: inside(from), x2: Math.max(inside(until), inside(from) + 2), y1: row.top + ROW, y2: row.top + ROW, class: "x" }));
  }
}

function drawMarks(svg, x, inner, top) {
  svg.append(node("line", { x1: LEFT, x2: LEFT + inner, y1: top + STRIP, y2: top + STRIP, class: "g" }));
  for (const event of found.events) {
    const at = Date.parse(event.time) / 1000;
    if (event.kind === "alarm") {
      const end = event.until ? Date.parse(event.until) / 1000 : view.until;
      const worst = ["no-model", "no-reading", "sensor-fault", "outside-maps"].includes(event.details.state);
      svg.append(node("rect", { x: x(at), y: top + (worst ? 0 : 8), width: Math.max(2, x(Math.min(end, view.until)) - x(at)), height: 7, class: worst ? "n" : "a" }));
    } else svg.append(node("line", { x1: x(at), x2: x(at), y1: 0, y2: top + STRIP, class: "v" }));
  }
  for (const check of found.checks) svg.append(node("circle", { cx: x(Date.parse(check.time) / 1000), cy: top + 20, r: 5, class: check.status === "beyond" ? "cb" : "c" }));
}

function lasting(s) {
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.round(s / 60)} min`;
  return s < 86400 ? `${Math.round(s / 3600)} h` : `${Math.round((10 * s) / 86400) / 10} d`;
}

// ---- the cursor ------------------------------------------------------------------------------

const timeAt = (px) => view.since + ((px - LEFT) / (Math.max(280, place.clientWidth) - LEFT - RIGHT)) * (view.until - view.since);

function showCursor() {
  const line = document.getElementById("cursor");
  const readout = document.getElementById("readout");
  if (!line) return;
  line.setAttribute("visibility", cursor === null ? "hidden" : "visible");
  if (cursor === null) {
    readout.replaceChildren();
    return;
  }
  const width = Math.max(280, place.clientWidth) - LEFT - RIGHT;
  const px = LEFT + ((cursor - view.since) / (view.until - view.since)) * width;
  line.setAttribute("x1", px);
  line.setAttribute("x2", px);
  const list = document.createElement("dl");
  const entry = (name, value) => {
    const row = document.createElement("div");
    const term = document.createElement("dt");
    const said = document.createElement("dd");
    term.textContent = name;
    said.textContent = value;
    row.append(term, said);
    list.append(row);
  };
  entry(t("At"), fullTime(cursor));
  for (const row of rows) {
    const near = (view.until - view.since) / 100;
    const bin = row.bins.find((one) => (row.wide ? one.s <= cursor && cursor < one.s + row.wide : Math.abs(one.s - cursor) < near));
    const range = bin && bin.high > bin.low ? ` (${t("%(since)s to %(until)s", { since: number(bin.low, row.digits), until: number(bin.high, row.digits) })})` : "";
    entry(row.name, bin ? `${number(bin.mean, row.digits)} ${row.unit}${range}` : t("none"));
  }
  readout.replaceChildren(list);
}

function moveCursor(by) {
  const step = Math.max(found?.bin_s ?? 0, (view.until - view.since) / 200);
  cursor = cursor === null ? (view.since + view.until) / 2 : cursor + by * step;
  cursor = Math.min(Math.max(cursor, view.since), view.until);
  showCursor();
}

// ---- what is asked for -----------------------------------------------------------------------

function zoom(factor) {
  const span = (view.until - view.since) * factor;
  const at = cursor ?? (view.isLive ? view.until : (view.since + view.until) / 2);
  const share = (at - view.since) / (view.until - view.since);
  show(at - share * span, at + (1 - share) * span, view.isLive && cursor === null);
}

function move(share) {
  const by = (view.until - view.since) * share;
  const until = view.until + by;
  show(view.since + by, until, until >= Date.now() / 1000);
}

const ACTS = { earlier: () => move(-0.5), later: () => move(0.5), closer: () => zoom(0.5), wider: () => zoom(2), live: () => show(view.since, view.until, true) };
for (const [id, act] of Object.entries(ACTS)) document.getElementById(id).addEventListener("click", act);
for (const button of document.querySelectorAll("[data-span]")) {
  button.addEventListener("click", () => {
    const span = Number(button.dataset.span);
    if (view.isLive) show(view.until - span, view.until, true);
    else show((view.since + view.until - span) / 2, (view.since + view.until + span) / 2);
  });
}
choices.addEventListener("submit", (event) => event.preventDefault());
choices.addEventListener("change", (event) => {
  if (event.target.name === "component") placeAt(event.target.selectedOptions[0].dataset.position);
  load();
});

place.addEventListener("keydown", (event) => {
  const acts = { ArrowLeft: () => moveCursor(event.shiftKey ? -10 : -1), ArrowRight: () => moveCursor(event.shiftKey ? 10 : 1), Home: () => moveCursor(-1e6), End: () => moveCursor(1e6) };
  const act = acts[event.key];
  if (!act || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  event.stopPropagation();
  act();
});
const pixel = (event) => event.clientX - place.getBoundingClientRect().left;
place.addEventListener("pointerdown", (event) => {
  if (event.button === 0 && event.pointerType !== "touch") dragFrom = pixel(event);
});
place.addEventListener("pointermove", (event) => {
  cursor = Math.min(Math.max(timeAt(pixel(event)), view.since), view.until);
  showCursor();
  const span = document.getElementById("dragged");
  if (dragFrom === null || !span) return;
  span.setAttribute("visibility", "visible");
  span.setAttribute("x", Math.min(dragFrom, pixel(event)));
  span.setAttribute("width", Math.abs(pixel(event) - dragFrom));
});
addEventListener("pointerup", (event) => {
  const from = dragFrom;
  dragFrom = null;
  if (from === null) return;
  document.getElementById("dragged")?.setAttribute("visibility", "hidden");
  const ends = [timeAt(from), timeAt(pixel(event))].sort((a, b) => a - b);
  if (Math.abs(pixel(event) - from) > 8) show(Math.max(ends[0], view.since), Math.min(ends[1], view.until));
});
place.addEventListener("dblclick", () => zoom(2));
new ResizeObserver(draw).observe(place);
addEventListener("hashchange", () => { readAddress(); load(); });
setInterval(() => { if (view.isLive && !document.hidden && dragFrom === null) load(); }, LIVE_MS);

function marks() {
  const lines = [
    ...found.events.map((event) => [event.time, event.text + (event.until ? `, ${t("until %(time)s", { time: fullTime(Date.parse(event.until) / 1000) })}` : ""), `/machines/${encodeURIComponent(machine)}/events`]),
    ...found.checks.map((check) => [check.time, `${t("Check “%(label)s”:", { label: check.label })} ${check.status}. ${check.summary} ${check.why_not}`, `/machines/${encodeURIComponent(machine)}/loop`]),
  ].sort((a, b) => Date.parse(b[0]) - Date.parse(a[0]));
  const table = document.createElement("table");
  for (const [time, words, where] of lines) {
    const row = table.insertRow();
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = fullTime(Date.parse(time) / 1000);
    const link = document.createElement("a");
    link.href = where;
    link.textContent = words;
    row.append(head);
    row.insertCell().append(link);
  }
  const nothing = document.createElement("p");
  nothing.textContent = t("Nothing.");
  document.getElementById("marks").replaceChildren(lines.length ? table : nothing);
}

document.getElementById("picture").addEventListener("click", async (event) => {
  event.preventDefault();
  const svg = place.querySelector("svg");
  if (!svg) return;
  const copy = svg.cloneNode(true);
  for (const id of ["cursor", "dragged"]) copy.querySelector(`#${id}`)?.remove();
  copy.setAttribute("font-family", "sans-serif");
  const title = `${document.getElementById("machine-name").textContent}, ${document.getElementById("range").textContent}`;
  copy.setAttribute("height", Number(svg.getAttribute("height")) + 24);
  copy.setAttribute("viewBox", `0 -24 ${svg.getAttribute("width")} ${Number(svg.getAttribute("height")) + 24}`);
  copy.append(node("text", { x: LEFT, y: -8, class: "t" }, title));
  const image = new Image();
  image.src = URL.createObjectURL(new Blob([new XMLSerializer().serializeToString(copy)], { type: "image/svg+xml" }));
  await image.decode();
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [2 * image.width, 2 * image.height];
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  URL.revokeObjectURL(image.src);
  const blob = await new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = `${machine}-history.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
});

readAddress();
load();
