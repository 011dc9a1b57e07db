// The fleet: asks for the analyses that are missing, follows them, and cancels them. Which they are,
// and what they say together, the service says.
import { list, refused, Refusal, send, t } from "./ask.js";

const EVERY_MS = 2000;
const main = document.querySelector("main");
let timer = 0;

function ready() {
  for (const id of ["start", "cancel"]) {
    const button = document.getElementById(id);
    if (button) button.disabled = false;
  }
  clearTimeout(timer);
  if (document.querySelector("#fleet[data-going-on]")) timer = setTimeout(refresh, EVERY_MS);
}

async function refresh() {
  try {
    const answer = await fetch(location.href, { cache: "no-store" });
    if (answer.ok) {
      const page = new DOMParser().parseFromString(await answer.text(), "text/html");
      const focused = document.activeElement?.id;
      const said = document.getElementById("said").childNodes;
      const fresh = document.adoptNode(page.getElementById("fleet"));
      fresh.querySelector("#said").append(...said);
      document.getElementById("fleet").replaceWith(fresh);
      ready();
      if (focused) document.getElementById(focused)?.focus();
      return;
    }
  } catch {
    // the connection says so by itself
  }
  ready();
}

const ROUTES = {
  start: ["/v1/fleet/analyses", t("Not started on every machine.")],
  cancel: ["/v1/fleet/analyses/cancel", t("Not cancelled on every machine.")],
};

main.addEventListener("click", async (event) => {
  const asked = ROUTES[event.target.id];
  if (!asked) return;
  event.target.disabled = true;
  clearTimeout(timer);
  const said = document.getElementById("said");
  said.replaceChildren();
  const [path, words] = asked;
  try {
    const found = await send("POST", path, document.getElementById("fleet").dataset.asked);
    const wrong = Object.entries(found.refused).map(([machine, why]) => `${machine}: ${why}`);
    if (wrong.length) {
      refused(said, words, new Refusal(found.queue_full ? t("Ask again when fewer analyses wait.") : t("Nothing else was left out.")));
      said.firstChild.append(list(wrong));
    }
  } catch (error) {
    refused(said, words, error);
  }
  refresh();
});

ready();
