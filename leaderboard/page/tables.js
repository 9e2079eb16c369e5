// Sorts, filters and scales the tables that the page holds as HTML.

function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

// A phone shows a row as a card, in which every cell has its column's heading.
function labelCells(table, heads) {
  for (const row of table.tBodies[0].rows) {
    if (row.classList.contains("detail")) continue;
    for (const cell of row.cells) cell.dataset.label = heads.cells[cell.cellIndex].textContent.trim();
  }
  table.classList.add("labelled");
}

const detailOf = row => row.nextElementSibling?.classList.contains("detail") ? row.nextElementSibling : null;

function sortBy(head) {
  const button = head.querySelector("button"), table = head.closest("table");
  const column = [...head.parentElement.children].indexOf(head);
  const before = head.getAttribute("aria-sort");
  const direction = before === null ? button.dataset.first : before === "ascending" ? "descending" : "ascending";
  for (const other of table.querySelectorAll("th[aria-sort]")) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", direction);
  const sign = direction === "ascending" ? 1 : -1;
  const rows = [...table.tBodies[0].rows].filter(row => row.classList.contains("policy"));
  const keyed = rows.map(row => ({ row, detail: detailOf(row), key: row.cells[column].dataset.value }));
  const numeric = keyed.every(({ key }) => key === "" || !isNaN(key));
  const inOrder = numeric ? (a, b) => a - b : new Intl.Collator("en").compare;
  // What has no value comes last, whichever way.
  keyed.sort((a, b) => (a.key === "") - (b.key === "") || sign * inOrder(a.key, b.key));
  table.tBodies[0].append(...keyed.flatMap(({ row, detail }) => detail ? [row, detail] : [row]));
}

function filterPolicies(section, form) {
  const text = form.elements.text.value.trim().toLocaleLowerCase();
  const classes = new Set([...form.querySelectorAll("[name=class]:checked")].map(box => box.value));
  const rows = [...section.querySelectorAll("tr.policy")];
  let shown = 0;
  for (const row of rows) {
    const words = [...row.querySelectorAll("bdi")].map(each => each.textContent).join(" ");
    row.hidden = !words.toLocaleLowerCase().includes(text) || !classes.has(row.dataset.class) || (form.elements.feasible.checked && row.classList.contains("infeasible"));
    const detail = detailOf(row);
    if (detail) detail.hidden = row.hidden || row.querySelector(".open").getAttribute("aria-expanded") !== "true";
    shown += !row.hidden;
  }
  section.querySelector(".count").textContent = `${shown} of ${rows.length} policies shown`;
  section.querySelector(".nothing").hidden = shown > 0;
  for (const box of form.querySelectorAll("[name=columns]")) {
    for (const cell of section.querySelectorAll(`.${box.value}`)) cell.hidden = !box.checked;
  }
  scaleIntervals(rows.filter(row => !row.hidden));
}

// Each column's bars share a scale: that of the better half of the feasible policies and oracles that are shown, as the
// poorest lie many times farther off than the best lie apart. Where few are feasible, all count.
function scaleIntervals(rows) {
  const columns = new Map();
  for (const row of rows) {
    for (const cell of row.cells) {
      if (!cell.dataset.low || cell.hidden) continue;
      const numbers = { cell, low: Number(cell.dataset.low), high: Number(cell.dataset.high), at: Number(cell.dataset.value) };
      if (!columns.has(cell.cellIndex)) columns.set(cell.cellIndex, []);
      columns.get(cell.cellIndex).push({ ...numbers, counts: !row.classList.contains("infeasible") });
    }
  }
  for (const [column, intervals] of columns) {
    const feasible = intervals.filter(each => each.counts);
    const counted = 3 * feasible.length < intervals.length ? intervals : feasible;
    const lows = counted.map(each => each.low).sort((a, b) => a - b), highs = counted.map(each => each.high).sort((a, b) => a - b);
    const heads = intervals[0].cell.closest("table").querySelector(".heads");
    const middle = Math.floor((counted.length - 1) / 2), lowerIsBetter = heads.cells[column].querySelector("button").dataset.first === "ascending";
    const least = lowerIsBetter ? lows[0] : lows[middle], most = lowerIsBetter ? highs[Math.floor(counted.length / 2)] : highs.at(-1);
    const room = 0.05 * (most - least) || 1;
    const percent = value => 100 * (value - least + room) / (most - least + 2 * room);
    for (const { cell, low, high, at } of intervals) {
      cell.querySelector(".interval")?.remove();
      if (percent(at) < 0 || percent(at) > 100) continue; // off the scale: the numbers say it
      const [from, to] = [Math.max(percent(low), 0), Math.min(percent(high), 100)];
      const line = element("i"), bar = element("span", { className: "interval", ariaHidden: "true" }, line);
      if (percent(0) > 0 && percent(0) < 100) bar.style.setProperty("--zero", `${percent(0)}%`);
      line.style.setProperty("--low", `${from}%`);
      line.style.setProperty("--width", `${to - from}%`);
      line.style.setProperty("--at", `${100 * (percent(at) - from) / (to - from || 1)}%`);
      cell.append(bar);
    }
  }
}
