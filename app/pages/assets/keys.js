// Keys that are written on the buttons, and the list of all of them. They can be switched off.

import { t } from "./ask.js";

const KEPT = "thermap-keys";
const FIXED = [
  ["↑ ↓", t("row"), "[data-row]"],
  ["Enter", t("open"), "[data-row]"],
  ["Esc", t("back"), "[data-back]"],
  ["1–7", t("pages of the machine"), "[data-page]"],
  ["T", t("whole table"), "#whole"],
  ["F", t("far view"), "table.machines"],
];

export const areOff = () => localStorage.getItem(KEPT) === "off";

const listed = document.getElementById("keys-list");

function lines() {
  const fixed = FIXED.filter(([, , where]) => document.querySelector(where));
  const buttons = [...document.querySelectorAll("[data-key]")].map((one) => [
    one.dataset.key.toUpperCase(),
    (one.labels?.[0] ?? one).firstChild.textContent.trim(),
  ]);
  return [...fixed, ...buttons, ["?", t("all keys and words")]];
}

function show() {
  const rows = lines().map(([key, words]) => {
    const row = document.createElement("li");
    const name = document.createElement("kbd");
    name.textContent = key;
    row.append(name, ` ${words}`);
    return row;
  });
  listed.querySelector("ul").replaceChildren(...rows);
  listed.querySelector("input").checked = !areOff();
  listed.showModal();
}

listed.querySelector("input").addEventListener("change", (event) => {
  localStorage.setItem(KEPT, event.target.checked ? "on" : "off");
});
listed.querySelector("button").addEventListener("click", () => listed.close());
document.getElementById("keys").addEventListener("click", show);
document.getElementById("logout")?.addEventListener("click", async () => {
  await fetch("/logout", { method: "POST", redirect: "manual" }).catch(() => null);
  location.assign("/login");
});

document.addEventListener("keydown", (event) => {
  if (listed.open || areOff() || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest("input:not([type=checkbox], [type=file]), textarea, select")) return;
  const target = document.querySelector(`[data-key="${CSS.escape(event.key.toLowerCase())}"]:not(:disabled)`);
  if (event.key === "?") show();
  else if (target) target.click();
  else return;
  event.preventDefault();
});
