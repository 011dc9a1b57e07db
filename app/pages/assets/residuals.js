// What two versions leave of the same checks is computed when the page is opened and when other
// versions are compared; it does not follow each reading.

import { problemOf, t } from "./ask.js";

const compare = document.getElementById("compare");
const shown = document.getElementById("residuals-shown");
let address = "";

async function show() {
  const asked = document.getElementById("pair")?.dataset.residuals;
  if (!asked || asked === address) return;
  address = asked;
  try {
    const answer = await fetch(asked, { cache: "no-store" });
    if (asked !== address) return;
    if (answer.ok) {
      const page = new DOMParser().parseFromString(await answer.text(), "text/html");
      shown.replaceChildren(document.adoptNode(page.getElementById("compared")));
      return;
    }
    shown.textContent = `${t("Not compared:")} ${(await problemOf(answer)).detail}`;
  } catch {
    shown.textContent = `${t("Not compared:")} ${t("The service was not reached.")}`;
  }
}

if (shown) {
  show();
  new MutationObserver(show).observe(compare, { childList: true, subtree: true });
}
