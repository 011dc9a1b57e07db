// The flat drawing is the service's and always there. 3D is plotly's, which is large: it is loaded when
// somebody wants it, and only where WebGL works.

import { problemOf, t, timeOfDay } from "./ask.js";

const PLOTLY = "/docs-assets/plotly.min.js";
let three;
let flat;
let space;
let slices;
let why;

function hasWebGl() {
  try {
    const context = document.createElement("canvas").getContext("webgl");
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return context !== null;
  } catch {
    return false;
  }
}

function load(address) {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = address;
    script.onload = resolve;
    script.onerror = () => reject(new Error(`${address} did not come`));
    document.head.append(script);
  });
}

function show(isThree) {
  space.hidden = !isThree;
  slices.hidden = isThree;
  three.setAttribute("aria-pressed", String(isThree));
  flat.setAttribute("aria-pressed", String(!isThree));
}

async function draw() {
  three.disabled = true;
  why.textContent = t("The 3D picture is being loaded.");
  try {
    const [answer] = await Promise.all([
      fetch(space.dataset.figure, {
        method: "POST",
        headers: { Accept: "application/json", "Content-Type": "application/json" },
        body: space.dataset.asked,
        cache: "no-store",
      }),
      window.Plotly ? null : load(PLOTLY),
    ]);
    if (!answer.ok) throw new Error((await problemOf(answer)).detail);
    const figure = await answer.json();
    const drawn = figure.layout.meta?.drawn ?? t("The work volume in 3D");
    space.setAttribute("role", "img");
    space.setAttribute("aria-label", drawn);
    // Its colours are those of paper.
    // What stands around the picture on paper stands on the page.
    const margin = { l: 8, r: 8, t: 36, b: 64 };
    const layout = { ...figure.layout, title: {}, annotations: [], margin, paper_bgcolor: "#fff", autosize: true };
    delete layout.width;
    delete layout.height;
    show(true);
    await window.Plotly.react(space, figure.data, layout, { displaylogo: false, responsive: true });
    // Letters stay as large in a narrow window: what is said there is less, and does not collide.
    const { narrow } = figure.layout.meta;
    if (space.clientWidth < narrow.below_px) await window.Plotly.relayout(space, narrow.changes);
    why.textContent = `${drawn} ${t("As of %(time)s; 3D draws it anew.", { time: timeOfDay(Date.now()) })}`;
  } catch (error) {
    show(false);
    why.textContent = t("The 3D picture was not drawn: %(why)s. The flat drawing shows the same numbers.", { why: error.message });
  }
  three.disabled = false;
}

function prepare() {
  [three, flat, space, slices, why] = ["three", "flat", "space", "slices", "why"].map((id) => document.getElementById(id));
  if (!three) return;
  // While values are live the factor stays what it was when the page came.
  const address = new URL(location.href);
  if (!address.searchParams.has("times")) {
    address.searchParams.set("times", slices.dataset.times);
    history.replaceState(null, "", address);
  }
  if (hasWebGl()) {
    three.disabled = false;
    why.textContent = t("The same numbers in both drawings.");
  } else why.textContent = t("This browser has no WebGL: flat drawing, the same numbers.");
  three.addEventListener("click", draw);
  flat.addEventListener("click", () => show(false));
}

prepare();
// The table went, and came again: what was drawn of it went, too.
addEventListener("thermap-replaced", prepare);
