// Before the first paint: the theme that was chosen, and the far view.
const chosen = localStorage.getItem("thermap-theme");
if (chosen) document.documentElement.dataset.theme = chosen;
if (localStorage.getItem("thermap-far")) document.documentElement.dataset.view = "far";
