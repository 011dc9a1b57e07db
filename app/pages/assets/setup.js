// Which sensor each component follows: chosen, shown with what it would change, and then assigned.
import { askOnce, changeWords, counted, lossLines, refused, send, sendVersion, t } from "./ask.js";
import "./upload.js";

const room = document.getElementById("sensors-of-components");
const said = document.getElementById("assign-said");
const assign = document.getElementById("assign");
const { api } = room.dataset;

function chosen() {
  const found = {};
  for (const one of room.querySelectorAll("[type=radio]:checked:not([data-current])")) found[one.dataset.code] = one.value;
  return found;
}

function marked() {
  for (const one of room.querySelectorAll("[data-changed]")) delete one.dataset.changed;
  for (const one of room.querySelectorAll("[type=radio]:checked:not([data-current])")) one.dataset.changed = "";
  assign.disabled = !Object.keys(chosen()).length;
  said.replaceChildren();
}

async function show() {
  const wanted = chosen();
  assign.disabled = true;
  try {
    const preview = await sendVersion("PUT", `${api}?preview=true`, wanted);
    const count = Object.keys(wanted).length;
    askOnce(
      said,
      `${counted(count, "%(count)s component would follow another sensor.", "%(count)s components would follow another sensor.")} ${changeWords(preview)}`,
      lossLines(preview),
      t("Assign"),
      async () => {
        await send("PUT", `${api}?accept_losses=true`, wanted);
        location.reload();
      },
      preview.loses.length > 0,
    );
  } catch (error) {
    refused(said, t("Not assigned."), error);
  }
  assign.disabled = false;
}

if (assign) {
  room.addEventListener("change", marked);
  assign.addEventListener("click", show);
  marked();
}

room.addEventListener("click", (event) => {
  const { all } = event.target.dataset;
  if (all === undefined) return;
  for (const row of event.target.closest("tbody").querySelectorAll("tr:not(.group)")) row.querySelectorAll("[type=radio]")[Number(all)].checked = true;
  marked();
});

document.getElementById("propose")?.addEventListener("click", () => {
  for (const one of room.querySelectorAll("[data-proposed]")) one.checked = true;
  marked();
  assign.focus();
});

// Where the service is, the page knows better than who wrote it.
for (const one of document.querySelectorAll("#feeding pre")) one.textContent = one.textContent.replace("ORIGIN", location.origin);
document.getElementById("feeding").addEventListener("click", async (event) => {
  if (!("copy" in event.target.dataset)) return;
  const text = event.target.previousElementSibling;
  getSelection().selectAllChildren(text);
  await navigator.clipboard?.writeText(text.textContent).catch(() => null);
  event.target.textContent = t("Copied");
});

// A map that was stored shows its components here: the matrix is made anew.
addEventListener("thermap-changed", ({ detail }) => {
  if (detail?.path === "error-maps" && !document.getElementById("waiting-files")?.children.length) setTimeout(() => location.reload(), 1500);
});
