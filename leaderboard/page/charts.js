// Draws what was recorded of a policy, and of a second one over it. Names go into the page as text only.

const LEVELS = 4094;
const LOOKS = ["first", "second"]; // the first policy's line is solid, the second's dashed, each in its own colour
const HEIGHT = 170, LEFT = 48, RIGHT = 10, TOP = 8, BOTTOM = 36;

// The levels of all trajectories: their differences are packed, all lower bytes before all upper ones.
async function unpack(text) {
  const packed = new Blob([Uint8Array.from(atob(text), letter => letter.charCodeAt(0))]).stream();
  const bytes = new Uint8Array(await new Response(packed.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
  const levels = new Uint16Array(bytes.length / 2);
  levels.forEach((_, place) => { levels[place] = (levels[place - 1] ?? 0) + bytes[place] + 256 * bytes[levels.length + place]; });
  return levels;
}

function drawing(name, attributes, text = "", colour = "") {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (colour) made.style.setProperty("--own", colour);
  made.textContent = text;
  return made;
}

// A name among other text: what it is written from right to left stays within it.
const named = text => element("bdi", { textContent: text });
const isolated = text => `\u2068${text}\u2069`;
const written = (value, digits = 4) => Number(value.toPrecision(digits)).toLocaleString("en", { maximumSignificantDigits: digits, useGrouping: "min2" }).replace("-", "\u2212");

function ticks(low, high, most) {
  const span = high - low, power = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10, 20].map(factor => factor * power).find(size => span / size < most);
  const first = Math.ceil(low / step), count = Math.floor(high / step) - first + 1;
  return Array.from({ length: count }, (_, place) => (first + place) * step);
}

const present = values => values.filter(value => !isNaN(value));
const least = values => present(values).reduce((low, value) => Math.min(low, value), Infinity);
const most = values => present(values).reduce((high, value) => Math.max(high, value), -Infinity);

// The trajectory of a policy with a seed: its series as numbers, or null.
function trajectoryOf(data, policy, seed) {
  const found = data.policies[policy]?.trajectories[seed];
  if (!found) return null;
  const series = {};
  Object.entries(data.ranges).forEach(([name, [low, high]], place) => {
    const from = found.start + place * found.kept;
    series[name] = Array.from(data.levels.subarray(from, from + found.kept), level => level > LEVELS ? NaN : low + (level / LEVELS) * (high - low));
  });
  return { label: data.policies[policy].label, colour: data.policies[policy].colour, steps: found.steps, series };
}

// Axes, and a readout of what `read` tells where the pointer is. `share` places a value between the lowest and the highest.
function chart({ title, label, axisName, width, ends: [start, end], levels, share, read }) {
  const x = value => LEFT + ((value - start) / (end - start || 1)) * (width - LEFT - RIGHT);
  const y = value => HEIGHT - BOTTOM - share(value) * (HEIGHT - TOP - BOTTOM);
  const svg = drawing("svg", { viewBox: `0 0 ${width} ${HEIGHT}`, height: HEIGHT, role: "img", "aria-label": label });
  for (const tick of levels) {
    svg.append(drawing("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y(tick), y2: y(tick) }));
    svg.append(drawing("text", { x: LEFT - 6, y: y(tick) + 4, "text-anchor": "end" }, written(tick)));
  }
  for (const tick of ticks(start, end, Math.max(2, Math.floor(width / 80)))) {
    svg.append(drawing("line", { class: "grid", x1: x(tick), x2: x(tick), y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM + 4 }));
    svg.append(drawing("text", { x: x(tick), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, written(tick)));
  }
  svg.append(drawing("text", { x: width - RIGHT, y: HEIGHT - 5, "text-anchor": "end" }, axisName));
  const pointer = svg.appendChild(drawing("line", { class: "pointer", y1: TOP, y2: HEIGHT - BOTTOM, visibility: "hidden" }));
  const readout = element("p", { className: "readout" });
  const point = value => {
    pointer.setAttribute("visibility", value === null ? "hidden" : "visible");
    readout.replaceChildren();
    if (value === null) return;
    pointer.setAttribute("x1", x(value));
    pointer.setAttribute("x2", x(value));
    readout.append(element("span", { textContent: `at ${written(value, 3)}:` }), ...read(value));
  };
  const valueAt = event => {
    const part = (event.offsetX - LEFT) / (svg.clientWidth - LEFT - RIGHT);
    return start + Math.min(Math.max(part, 0), 1) * (end - start);
  };
  return { figure: element("figure", {}, element("figcaption", { textContent: title }), readout, svg), svg, x, y, point, valueAt };
}

// Where the pointer is in one chart, all tell their values.
function followPointer(charts) {
  for (const { svg, valueAt } of charts) {
    const follow = event => { const value = valueAt(event); for (const each of charts) each.point(value); };
    svg.addEventListener("pointermove", follow);
    svg.addEventListener("pointerdown", follow);
    svg.addEventListener("pointerleave", () => { for (const each of charts) each.point(null); });
  }
}

// The steps before which the machine stood, for a new edge or after a breakage: no line leads across.
const LONG_STOP = 20; // over the usual time between two steps that are kept
function stopsOf(minutes) {
  const gaps = minutes.map((value, place) => value - (minutes[place - 1] ?? 0));
  const usual = [...gaps].sort((a, b) => a - b)[Math.floor(gaps.length / 2)];
  return new Set(gaps.flatMap((gap, place) => gap > LONG_STOP * usual ? [place] : []));
}

function panel(subject, limit, trajectories, axis, axisName, width) {
  const xs = trajectories.flatMap(trajectory => [least(trajectory.series[axis]), most(trajectory.series[axis])]);
  const values = trajectories.flatMap(trajectory => [...trajectory.series[subject.series], ...(subject.reference ? trajectory.series[subject.reference] : [])]);
  const extents = [...present(values), ...(limit === undefined ? [] : [limit]), ...(subject.from_zero ? [0] : [])];
  const room = 0.05 * (most(extents) - least(extents)) || 1;
  const [low, high] = [subject.from_zero ? 0 : least(extents) - room, most(extents) + room];

  const title = `${subject.heading} [${subject.unit}]`;
  const extent = trajectory => {
    const seen = trajectory.series[subject.series];
    return `${trajectory.label} from ${written(least(seen))} to ${written(most(seen))}`;
  };
  const limitInWords = limit === undefined ? "" : `; limit ${written(limit)}`;
  // The values of the recorded step that is nearest.
  const read = value => {
    const of = (trajectory, name) => {
      const distances = trajectory.series[axis].map(each => Math.abs(each - value));
      const found = trajectory.series[name][distances.indexOf(least(distances))];
      return isNaN(found) ? "in air" : written(found, 3);
    };
    const told = trajectories.map((trajectory, place) => key("span", LOOKS[place], trajectory.colour, named(trajectory.label), ` ${of(trajectory, subject.series)}`));
    return subject.reference ? [...told, key("span", "followed", "", `reference ${of(trajectories[0], subject.reference)}`)] : told;
  };
  const made = chart({
    title,
    label: `${title} over ${axisName}: ${trajectories.map(extent).join("; ")}${limitInWords}`,
    axisName,
    width,
    ends: [least([0, ...xs]), most(xs)],
    levels: ticks(low, high, 4),
    share: value => (value - low) / (high - low),
    read,
  });
  const line = (trajectory, name, look) => {
    let moves = "", joined = false;
    const stops = stopsOf(trajectory.series.minutes);
    trajectory.series[name].forEach((value, place) => {
      if (stops.has(place)) joined = false;
      if (!isNaN(value)) moves += `${joined ? "L" : "M"}${made.x(trajectory.series[axis][place]).toFixed(1)} ${made.y(value).toFixed(1)}`;
      joined = !isNaN(value);
    });
    made.svg.append(drawing("path", { class: look, d: moves }, "", trajectory.colour));
  };
  if (subject.reference) line(trajectories[0], subject.reference, "followed");
  trajectories.forEach((trajectory, place) => line(trajectory, subject.series, LOOKS[place]));
  if (limit !== undefined) {
    made.svg.append(drawing("path", { class: "limit", d: `M${LEFT} ${made.y(limit)}H${width - RIGHT}` }));
  }
  return made;
}

function key(name, look, colour, ...words) {
  const sample = drawing("svg", { class: "key", viewBox: "0 0 35 8", "aria-hidden": "true" });
  sample.append(drawing("path", { class: look, d: "M0 4H35" }, "", colour));
  return element(name, {}, sample, ...words);
}

// The greatest and the last values, for those who do not see the charts.
function numbers(subjects, trajectories) {
  const told = subjects.map(subject => ({ ...subject, what: subject.series === "wear" ? "at the end" : "greatest" }));
  const heads = ["policy", "time [min]", "path [mm]", ...told.map(each => `${each.heading}, ${each.what} [${each.unit}]`)];
  const body = trajectories.map(({ label, series }) => element("tr", {},
    element("th", { scope: "row" }, named(label)),
    ...[series.minutes, series.path].map(values => element("td", { textContent: written(values.at(-1), 3) })),
    ...told.map(each => element("td", { textContent: written(each.series === "wear" ? series.wear.at(-1) : most(series[each.series]), 3) }))));
  const table = element("table", { className: "numbers" },
    element("caption", { textContent: "The same in numbers" }),
    element("thead", {}, element("tr", {}, ...heads.map(text => element("th", { scope: "col", textContent: text })))),
    element("tbody", {}, ...body));
  labelCells(table, table.tHead.rows[0]);
  return element("div", { className: "narrow" }, table);
}

function choice(words, entries, chosen) {
  const select = element("select", {}, ...entries.map(([value, text]) => new Option(text, value, false, String(value) === String(chosen))));
  return [element("label", {}, `${words} `, select), select];
}

// Fill an opened row. The charts are drawn again when something is chosen or the width changes.
function showTrajectories(place, data) {
  const first = Number(place.dataset.policy), recorded = policy => data.policies[policy]?.trajectories ?? [];
  const seeds = data.seeds.map((seed, number) => [number, seed]).filter(([number]) => recorded(first)[number]);
  const others = data.policies.flatMap((policy, number) => policy && number !== first ? [[number, isolated(policy.label)]] : []);
  const [seedLabel, seed] = choice(data.seed_name === "job" ? "Job" : "Seed", seeds, seeds[0][0]);
  const [secondLabel, second] = choice("Second policy", [["", "none"], ...others], data.second === first ? "" : data.second);
  const [axisLabel, axis] = choice("Along", Object.entries(data.axes), "minutes");
  const choices = element("div", { className: "choose" }, seedLabel, secondLabel, axisLabel), output = element("div");
  choices.setAttribute("role", "group");
  choices.setAttribute("aria-label", "What is drawn");
  place.append(choices, output);
  const redraw = () => {
    const trajectories = [trajectoryOf(data, first, seed.value), second.value === "" ? null : trajectoryOf(data, Number(second.value), seed.value)].filter(Boolean);
    const legend = trajectories.map((trajectory, number) => key("li", LOOKS[number], trajectory.colour, named(trajectory.label)));
    legend.push(key("li", "limit", "", "limit; of wear, the end of the edge"));
    if (data.subjects.some(subject => subject.reference)) legend.push(key("li", "followed", "", "reference"));
    const panels = element("div", { className: "panels" });
    const thinned = trajectories.filter(trajectory => trajectory.series.minutes.length < trajectory.steps);
    const note = [
      second.value !== "" && trajectories.length < 2 ? `The second policy was not recorded with this ${data.seed_name}.` : "",
      thinned.length ? `Drawn: ${thinned.map(({ series, steps }) => `${series.minutes.length} of ${steps}`).join(" and ")} steps, those with the least and the greatest load among neighbours.` : "",
      trajectories.some(({ series }) => stopsOf(series.minutes).size) ? "Where all lines of a policy break, the machine stands: for a new edge, or after a breakage." : "",
    ].join(" ").trim();
    output.replaceChildren(element("ul", { className: "legend" }, ...legend), panels, element("p", { className: "note", textContent: note }), numbers(data.subjects, trajectories));
    const columns = getComputedStyle(panels).gridTemplateColumns.split(" ");
    const width = Math.max(200, Math.floor(parseFloat(columns[0]) || 0));
    const drawn = data.subjects.map(subject => panel(subject, data.limits[seed.value][subject.series], trajectories, axis.value, data.axes[axis.value], width));
    panels.append(...drawn.map(each => each.figure));
    followPointer(drawn);
  };
  for (const select of [seed, second, axis]) select.addEventListener("change", redraw);
  let drawn = 0;
  new ResizeObserver(() => {
    if (!place.clientWidth || place.clientWidth === drawn) return;
    drawn = place.clientWidth;
    redraw();
  }).observe(place);
}
