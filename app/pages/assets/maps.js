// A version is shown with what it would change; only a button activates it, or takes a map out of use.
import { t } from "./ask.js";
import { ask, element, look, openedBy, say, show } from "./upload.js";

const machine = encodeURIComponent(document.getElementById("drop").dataset.machine);
const api = `/v1/machines/${machine}`;

// On a small screen, or among many versions, the active one would lie behind the edge.
const active = document.querySelector("#timeline .active");
if (active) {
  const room = active.closest(".scroll");
  room.scrollLeft += Math.max(active.getBoundingClientRect().right - room.getBoundingClientRect().right, 0);
}

async function activate(version) {
  const answer = await ask(t("v%(version)s was not activated.", { version }), `${api}/models/${version}/activate`, { method: "POST" });
  if (!answer) return;
  say(t("v%(version)s is active.", { version }), [t("Every other version can be activated again.")], "fine");
  dispatchEvent(new Event("thermap-changed"));
}

async function withdraw(map) {
  const answer = await ask(t("The map was not withdrawn."), `${api}/error-maps/${map}`, { method: "DELETE" });
  if (!answer) return;
  say(t("The map is out of use."), [t("Older versions keep it: activating one of them is the way back.")], "fine");
  dispatchEvent(new Event("thermap-changed"));
}

// What somebody else has changed meanwhile makes what is shown another thing than what would be done.
new MutationObserver(() => {
  const found = document.getElementById("found");
  const timeline = document.getElementById("timeline");
  if (!found || !timeline || found.dataset.active === timeline.dataset.active || found.querySelector(".meanwhile")) return;
  if ("isDone" in found.dataset) return;
  for (const one of found.querySelectorAll("[data-do]:not([data-do=discard])")) one.disabled = true;
  const said = element("div", `${t("Meanwhile v%(version)s became active.", { version: timeline.dataset.active })} `, "meanwhile");
  if (found.dataset.what === "upload") {
    const again = element("button", t("Show again what it would change"));
    again.type = "button";
    again.addEventListener("click", look);
    said.append(again);
  }
  found.querySelector(".decide").before(said);
}).observe(document.getElementById("answer"), { childList: true, subtree: true });

document.addEventListener("click", async (event) => {
  const button = event.target.closest("button");
  if (button?.dataset.activate || button?.dataset.withdraw) openedBy(button);
  if (button?.dataset.activate) {
    const version = button.dataset.activate;
    await show(t("v%(version)s was not activated.", { version }), `/machines/${machine}/maps/preview/${version}`);
  } else if (button?.dataset.withdraw) {
    await show(t("The map was not withdrawn."), `/machines/${machine}/maps/withdrawal/${button.dataset.withdraw}`);
  } else if (button?.dataset.do === "activate") {
    await activate(button.closest("#found").dataset.version);
  } else if (button?.dataset.do === "withdraw") {
    await withdraw(button.closest("#found").dataset.map);
  }
});
