// What happens on which event.

const form = document.querySelector(".tools"), sections = [...document.querySelectorAll("main > section")];
const theme = document.querySelector(".theme");
form.hidden = theme.hidden = false;

function showSection() {
  const place = (() => { try { return decodeURIComponent(location.hash.slice(1)); } catch { return ""; } })();
  const chosen = sections.find(section => section.id === place) ?? sections[0];
  for (const section of sections) section.hidden = section !== chosen;
  for (const link of document.querySelectorAll("nav a")) {
    if (decodeURIComponent(link.hash.slice(1)) === chosen.id) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  form.hidden = !chosen.classList.contains("leaderboard");
  if (!form.hidden) filterPolicies(chosen, form);
}

const dataOf = new Map();
function dataFor(section) {
  if (!dataOf.has(section)) dataOf.set(section, JSON.parse(section.querySelector("script")?.textContent ?? "null"));
  return dataOf.get(section);
}

function toggle(button) {
  const detail = document.getElementById(button.getAttribute("aria-controls")), opens = detail.hidden;
  button.setAttribute("aria-expanded", String(opens));
  detail.hidden = !opens;
  const place = detail.querySelector(".trajectories"), data = dataFor(button.closest("section"));
  if (!opens || place.dataset.drawn || !data?.policies[place.dataset.policy]) return;
  place.dataset.drawn = "yes";
  showTrajectories(place, data);
}

document.addEventListener("click", event => {
  const button = event.target.closest("th button");
  if (button?.matches(".open")) toggle(button);
  else if (button) sortBy(button.closest("th"));
});
document.addEventListener("keydown", event => {
  if (event.key !== "Escape") return;
  const row = event.target.closest?.("tr.policy, tr.detail");
  const button = (row?.matches(".detail") ? row.previousElementSibling : row)?.querySelector(".open[aria-expanded=true]");
  if (!button) return;
  toggle(button);
  button.focus();
});
form.addEventListener("input", showSection);
form.addEventListener("submit", event => event.preventDefault());
addEventListener("hashchange", showSection);

const remembered = () => { try { return localStorage.getItem("theme") ?? ""; } catch { return ""; } };
function setTheme(name) {
  if (name) document.documentElement.dataset.theme = name;
  else delete document.documentElement.dataset.theme;
}
const themes = theme.querySelector("select");
themes.value = remembered();
setTheme(themes.value);
themes.addEventListener("change", () => {
  setTheme(themes.value);
  try { localStorage.setItem("theme", themes.value); } catch { /* a page may be forbidden to keep anything */ }
});
showSection();
