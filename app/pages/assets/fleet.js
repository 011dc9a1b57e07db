// The fleet: asks for the analyses that are missing, machine by machine, by the route that every
// analysis has, and follows them. What they say together the service says.
import { list, refused, Refusal, send } from "./ask.js";

const EVERY_MS = 2000;
const main = document.querySelector("main");
let timer = 0;

function ready() {
  const start = document.getElementById("start");
  if (start) start.disabled = false;
  clearTimeout(timer);
  if (document.querySelector("#fleet[data-going-on]")) timer = setTimeout(refresh, EVERY_MS);
}

async function refresh() {
  try {
    const answer = await fetch(location.href, { cache: "no-store" });
    if (answer.ok) {
      const page = new DOMParser().parseFromString(await answer.text(), "text/html");
      const said = document.getElementById("said").childNodes;
      const fresh = document.adoptNode(page.getElementById("fleet"));
      fresh.querySelector("#said").append(...said);
      document.getElementById("fleet").replaceWith(fresh);
    }
  } catch {
    // the connection says so by itself
  }
  ready();
}

main.addEventListener("click", async (event) => {
  if (event.target.id !== "start") return;
  event.target.disabled = true;
  const said = document.getElementById("said");
  said.replaceChildren();
  const wrong = [];
  for (const { machine, body } of JSON.parse(document.getElementById("fleet").dataset.ask)) {
    try {
      await send("POST", `/v1/machines/${encodeURIComponent(machine)}/analyses`, body);
    } catch (error) {
      wrong.push(`${machine}: ${error.message}`);
    }
  }
  if (wrong.length) {
    refused(said, "Not started on every machine.", new Refusal("The others go on; it can be asked again."));
    said.firstChild.append(list(wrong));
  }
  refresh();
});

ready();
