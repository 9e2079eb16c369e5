// What happens on which event.

const form = document.querySelector("form"), sections = [...document.querySelectorAll("main > section")];
const tools = document.querySelector(".tools"), tasks = document.querySelector(".tasks"), theme = document.querySelector(".theme");
form.hidden = theme.hidden = false;
for (const table of document.querySelectorAll(".sortable")) labelCells(table, table.querySelector(".heads"));

const wide = matchMedia("(min-width: 40rem)");
const unfold = () => { tools.open = tasks.open = wide.matches; };
wide.addEventListener("change", unfold);
unfold();
if (!wide.matches) {
  for (const box of form.querySelectorAll("[name=columns]")) box.checked = box.dataset.onPhones !== undefined;
}

function showSection() {
  const place = (() => { try { return decodeURIComponent(location.hash.slice(1)); } catch { return ""; } })();
  const chosen = sections.find(section => place === section.id || place.startsWith(`${section.id}/`)) ?? document.getElementById(document.querySelector("main").dataset.opens);
  for (const section of sections) section.hidden = section !== chosen;
  for (const link of document.querySelectorAll("nav a")) {
    if (decodeURIComponent(link.hash.slice(1)) === chosen.id) {
      link.setAttribute("aria-current", "page");
    } else link.removeAttribute("aria-current");
  }
  form.hidden = !chosen.classList.contains("leaderboard");
  if (!form.hidden) filterPolicies(chosen, form);
  const policy = place.slice(chosen.id.length + 1);
  const head = [...chosen.querySelectorAll(".policy th")].find(each => each.dataset.value === policy);
  const button = head?.querySelector(".open[aria-expanded=false]");
  if (!button) return;
  toggle(button);
  const box = head.closest(".wide");
  if (box.scrollHeight <= box.clientHeight) { // on a phone the page scrolls alone
    head.scrollIntoView();
    return;
  }
  box.scrollIntoView();
  box.scrollTop += head.getBoundingClientRect().top - box.getBoundingClientRect().top - box.querySelector("thead").offsetHeight;
}

const dataOf = new Map();
async function dataFor(section) {
  const data = JSON.parse(section.querySelector(":scope > script")?.textContent ?? "null");
  if (data) data.levels = await unpack(data.packed);
  return data;
}

async function toggle(button) {
  const detail = document.getElementById(button.getAttribute("aria-controls")), opens = detail.hidden;
  button.setAttribute("aria-expanded", String(opens));
  detail.hidden = !opens;
  const section = button.closest("section"), place = detail.querySelector(".trajectories");
  history.replaceState(null, "", opens ? detail.querySelector("a").hash : `#${encodeURI(section.id)}`);
  if (!opens || place.dataset.drawn) return;
  place.dataset.drawn = "yes";
  if (!dataOf.has(section)) dataOf.set(section, dataFor(section));
  const data = await dataOf.get(section);
  if (data?.policies[place.dataset.policy]) showTrajectories(place, data);
}

// Copy what stands before a button: a link's address or a text.
async function copy(button) {
  const source = button.previousElementSibling, words = button.textContent;
  const box = element("textarea", { className: "copied", value: source.href ?? source.textContent, readOnly: true, ariaLabel: words });
  const done = await (async () => navigator.clipboard.writeText(box.value))().then(() => true, () => {
    button.after(box); // a page from a file may lack the clipboard: select the text
    box.select();
    return document.execCommand("copy");
  });
  button.textContent = done ? "Copied" : "Selected: copy with Ctrl+C";
  if (done) box.remove();
  else box.addEventListener("blur", () => box.remove());
  setTimeout(() => { button.textContent = words; }, 3000);
}

document.addEventListener("click", event => {
  const button = event.target.closest("button");
  if (button?.matches(".open")) toggle(button);
  else if (button?.matches(".copy")) copy(button);
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
tasks.addEventListener("click", event => {
  if (event.target.closest("a")) tasks.open = wide.matches;
});

const remembered = () => { try { return localStorage.getItem("theme") ?? ""; } catch { return ""; } };
function setTheme(name) {
  if (name) document.documentElement.dataset.theme = name;
  else delete document.documentElement.dataset.theme;
}
theme.value = remembered();
setTheme(theme.value);
theme.addEventListener("change", () => {
  setTheme(theme.value);
  try { localStorage.setItem("theme", theme.value); } catch { /* a page may be forbidden to keep anything */ }
});
showSection();
