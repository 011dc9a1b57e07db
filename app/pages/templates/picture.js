// Once all is drawn, the words that stand in for it go.
document.getElementById("not-drawn").remove();
// Without perspective plotly cuts off what is wider than a narrow window.
const [picture] = drawn;
const place = document.getElementById(picture);
const shape = place.clientWidth / place.clientHeight / 1.6;
if (shape < 1) {
  const {x, y, z} = place.layout.scene.aspectratio;
  const scale = {x: x * shape, y: y * shape, z: z * shape};
  Plotly.relayout(place, {"scene.aspectratio": scale});
}
// Letters stay as large in a narrow window: what is said there is less, and does not collide.
function fit() {
  const {narrow} = place.layout.meta;
  if (place.clientWidth < narrow.below_px) Plotly.relayout(place, narrow.changes);
}
fit();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", fit);
addEventListener("afterprint", fit);
