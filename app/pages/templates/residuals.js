const choice = document.getElementById("choice");
const blocks = [...document.querySelectorAll(".component")];
function show() {
  for (const block of blocks) {
    block.hidden = choice.value ? block.id !== choice.value : !block.classList.contains("open");
  }
  draw();
  for (const id of drawn) {
    const place = document.getElementById(id);
    if (!place.closest(UNSEEN)) Plotly.Plots.resize(place);
  }
}
function follow() {
  const block = document.getElementById(location.hash.slice(1));
  if (!blocks.includes(block)) return;
  if (block.hidden) {
    choice.value = block.id;
    show();
  }
  block.scrollIntoView();
}
if (choice) {
  choice.addEventListener("change", () => {
    history.replaceState(null, "", location.pathname + location.search);
    show();
  });
  addEventListener("hashchange", follow);
  show();
  follow();
}
