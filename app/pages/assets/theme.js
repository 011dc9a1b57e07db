// Before the first paint: the theme that was chosen, and the far view.
const chosen = localStorage.getItem("thermap-theme");
if (chosen) document.documentElement.dataset.theme = chosen;
if (localStorage.getItem("thermap-far")) document.documentElement.dataset.view = "far";

// What this browser wants, for a year.
function want(name, value) {
  document.cookie = `thermap-${name}=${value}; path=/; max-age=31536000; SameSite=Lax`;
  return document.cookie.split("; ").includes(`thermap-${name}=${value}`);
}

// Times are written in the zone of this clock: where the service does not know it yet, it is asked again.
const zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
if (zone && !document.cookie.split("; ").includes(`thermap-zone=${zone}`)) {
  if (want("zone", zone) && document.documentElement.dataset.zone !== zone) location.reload();
}

// Language and units: a page is written anew in what was chosen.
addEventListener("click", ({ target }) => {
  if (target.id === "apply-reader") {
    for (const one of document.querySelectorAll("[data-reader]")) want(one.dataset.reader, one.value);
    location.reload();
  }
  const open = document.querySelector(".reader[open]");
  if (open && !open.contains(target)) open.open = false;
});
