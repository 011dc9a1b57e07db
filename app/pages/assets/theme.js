// Before the first paint: the theme that was chosen, and the far view.
const chosen = localStorage.getItem("thermap-theme");
if (chosen) document.documentElement.dataset.theme = chosen;
// Times are written in the zone of this clock: where the service does not know it yet, it is asked again.
const zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
if (zone && !document.cookie.split("; ").includes(`thermap-zone=${zone}`)) {
  document.cookie = `thermap-zone=${zone}; path=/; max-age=31536000; SameSite=Lax`;
  if (document.cookie.includes(`thermap-zone=${zone}`) && document.documentElement.dataset.zone !== zone) location.reload();
}
if (localStorage.getItem("thermap-far")) document.documentElement.dataset.view = "far";
