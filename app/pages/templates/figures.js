// Colours in the figures are names of the style's; plotly wants the colours themselves.
const source = document.getElementById("figures").textContent;
function figures() {
  const style = getComputedStyle(document.documentElement);
  return JSON.parse(source, (_, value) =>
    typeof value === "string" && value.startsWith("var(--")
      ? style.getPropertyValue(value.slice(4, -1)).trim()
      : value);
}
const UNSEEN = "details:not([open]), [hidden]";
const drawn = new Set();
function draw() {
  for (const [id, figure] of Object.entries(figures())) {
    const place = document.getElementById(id);
    if (drawn.has(id) || place.closest(UNSEEN)) continue;
    drawn.add(id);
    Plotly.newPlot(place, figure.data, figure.layout, config);
  }
}
// plotly draws as wide as the window is; A4 between its margins has 680 px at 96 px to the inch,
// the frame of an effect 37 less.
function redraw(printing) {
  const all = figures();
  for (const id of drawn) {
    const place = document.getElementById(id);
    const {data, layout} = all[id];
    const columns = place.closest(".three") ? 3 : place.closest(".two") ? 2 : 0;
    const whole = place.closest(".effect") ? 643 : 680;
    const width = Math.floor((whole - 12 * (columns - 1)) / columns);
    const size = printing && columns ? {autosize: false, width} : {};
    // A drawing in space keeps its proportions, and the view to which a person turned it.
    const {aspectratio} = place.layout.scene ?? {};
    const kept = aspectratio ? {scene: {...layout.scene, aspectratio}} : {};
    Plotly.react(place, data, {...layout, ...size, ...kept}, config);
    if (!printing && !place.closest(UNSEEN)) Plotly.Plots.resize(place);
  }
}
draw();
addEventListener("toggle", draw, true);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraw(false));
addEventListener("beforeprint", () => {
  document.documentElement.dataset.scheme = "light";
  redraw(true);
});
addEventListener("afterprint", () => {
  delete document.documentElement.dataset.scheme;
  redraw(false);
});
