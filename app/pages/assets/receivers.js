// Asks for test messages. Whether one arrived is said by the page itself, which is followed.
import { refused, send, t } from "./ask.js";

const LOOK_MS = 1000;
const LOOKS = 60;

async function shown() {
  const answer = await fetch(location.href, { cache: "no-store" });
  if (!answer.ok) return;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  const focused = document.activeElement?.id;
  document.getElementById("receivers").replaceWith(document.adoptNode(page.getElementById("receivers")));
  if (focused) document.getElementById(focused)?.focus();
}

async function isTested(name) {
  const { receivers } = await send("GET", "/v1/receivers");
  const one = receivers.find((receiver) => receiver.name === name);
  return !one || (one.tested_at !== null && one.tested_at >= one.test_asked_at);
}

document.addEventListener("click", async (event) => {
  const name = event.target.dataset.test;
  if (!name) return;
  event.target.disabled = true;
  const said = document.getElementById("said");
  said.replaceChildren();
  try {
    await send("POST", `/v1/receivers/${encodeURIComponent(name)}/test`);
    await shown();
    for (let i = 0; i < LOOKS && !(await isTested(name)); i += 1) {
      await new Promise((resolve) => setTimeout(resolve, LOOK_MS));
    }
    await shown();
  } catch (error) {
    refused(said, t("No test message was asked for."), error);
    event.target.disabled = false;
  }
});
