// Draws what was recorded of a policy, and of a second one over it. Names go into the page as text only.

const ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
const GAP = ALPHABET.length ** 2 - 1;
const DIGIT = new Map([...ALPHABET].map((letter, place) => [letter, place]));
const HEIGHT = 170, LEFT = 48, RIGHT = 10, TOP = 8, BOTTOM = 36;

function unpack(text, [low, high]) {
  const values = [];
  for (let place = 0; place < text.length; place += 2) {
    const level = ALPHABET.length * DIGIT.get(text[place]) + DIGIT.get(text[place + 1]);
    values.push(level === GAP ? NaN : low + (level / (GAP - 1)) * (high - low));
  }
  return values;
}

function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

function drawing(name, attributes, text = "") {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

// A name among other text: what it is written from right to left stays within it.
const named = text => element("bdi", { textContent: text });
const isolated = text => `\u2068${text}\u2069`;
const written = (value, digits = 4) => Number(value.toPrecision(digits)).toLocaleString("en", { maximumSignificantDigits: digits, useGrouping: false }).replace("-", "\u2212");

function ticks(low, high, most) {
  const span = high - low, power = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10, 20].map(factor => factor * power).find(size => span / size < most);
  const first = Math.ceil(low / step), count = Math.floor(high / step) - first + 1;
  return Array.from({ length: count }, (_, place) => (first + place) * step);
}

const present = values => values.filter(value => !isNaN(value));
const least = values => present(values).reduce((low, value) => Math.min(low, value), Infinity);
const most = values => present(values).reduce((high, value) => Math.max(high, value), -Infinity);

// What is drawn of a policy on a draw: its series as numbers.
function courseOf(data, policy, draw) {
  const packed = data.policies[policy]?.courses[draw];
  if (!packed) return null;
  const series = Object.fromEntries(Object.entries(packed.series).map(([name, text]) => [name, unpack(text, data.ranges[name])]));
  return { label: data.policies[policy].label, intervals: packed.intervals, series };
}

function panel(subject, courses, axis, axisName, width) {
  const xs = courses.flatMap(course => [least(course.series[axis]), most(course.series[axis])]);
  const values = courses.flatMap(course => [...course.series[subject.series], ...(subject.reference ? course.series[subject.reference] : [])]);
  const ends = [...present(values), ...(subject.limit === null ? [] : [subject.limit]), ...(subject.fromZero ? [0] : [])];
  const room = 0.05 * (most(ends) - least(ends)) || 1;
  const [low, high] = [subject.fromZero ? 0 : least(ends) - room, most(ends) + room];
  const [start, end] = [least([0, ...xs]), most(xs)];
  const x = value => LEFT + ((value - start) / (end - start || 1)) * (width - LEFT - RIGHT);
  const y = value => HEIGHT - BOTTOM - ((value - low) / (high - low)) * (HEIGHT - TOP - BOTTOM);

  const title = `${subject.heading} [${subject.unit}]`;
  const extent = course => {
    const seen = course.series[subject.series];
    return `${course.label} from ${written(least(seen))} to ${written(most(seen))}`;
  };
  const limit = subject.limit === null ? "" : `; limit ${written(subject.limit)}`;
  const label = `${title} over ${axisName}: ${courses.map(extent).join("; ")}${limit}`;
  const svg = drawing("svg", { viewBox: `0 0 ${width} ${HEIGHT}`, height: HEIGHT, role: "img", "aria-label": label });
  for (const tick of ticks(low, high, 4)) {
    svg.append(drawing("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y(tick), y2: y(tick) }));
    svg.append(drawing("text", { x: LEFT - 6, y: y(tick) + 4, "text-anchor": "end" }, written(tick)));
  }
  for (const tick of ticks(start, end, Math.max(2, Math.floor(width / 80)))) {
    svg.append(drawing("line", { class: "grid", x1: x(tick), x2: x(tick), y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM + 4 }));
    svg.append(drawing("text", { x: x(tick), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, written(tick)));
  }
  svg.append(drawing("text", { x: width - RIGHT, y: HEIGHT - 5, "text-anchor": "end" }, axisName));
  const line = (course, name, look) => {
    let moves = "", joined = false;
    course.series[name].forEach((value, place) => {
      if (!isNaN(value)) moves += `${joined ? "L" : "M"}${x(course.series[axis][place]).toFixed(1)} ${y(value).toFixed(1)}`;
      joined = !isNaN(value);
    });
    svg.append(drawing("path", { class: look, d: moves }));
  };
  if (subject.reference) line(courses[0], subject.reference, "followed");
  courses.forEach((course, place) => line(course, subject.series, place ? "second" : "first"));
  if (subject.limit !== null) {
    svg.append(drawing("path", { class: "limit", d: `M${LEFT} ${y(subject.limit)}H${width - RIGHT}` }));
  }
  return element("figure", {}, element("figcaption", { textContent: title }), svg);
}

function key(look, ...words) {
  const sample = drawing("svg", { class: "key", viewBox: "0 0 35 8", "aria-hidden": "true" });
  sample.append(drawing("path", { class: look, d: "M0 4H35" }));
  const item = element("li", {}, ...words);
  item.prepend(sample);
  return item;
}

// The greatest and the last values, for those who do not see the charts.
function numbers(subjects, courses) {
  const told = subjects.map(subject => ({ ...subject, what: subject.series === "wear" ? "at the end" : "greatest" }));
  const heads = ["policy", "time [min]", "path [mm]", ...told.map(each => `${each.heading}, ${each.what} [${each.unit}]`)];
  const body = courses.map(({ label, series }) => element("tr", {},
    element("th", { scope: "row" }, named(label)),
    ...[series.minutes, series.path].map(values => element("td", { textContent: written(values.at(-1)) })),
    ...told.map(each => element("td", { textContent: written(each.series === "wear" ? series.wear.at(-1) : most(series[each.series]), 3) }))));
  return element("div", { className: "narrow" }, element("table", { className: "numbers" },
    element("caption", { textContent: "The same in numbers" }),
    element("thead", {}, element("tr", {}, ...heads.map(text => element("th", { scope: "col", textContent: text })))),
    element("tbody", {}, ...body)));
}

function choice(words, entries, chosen) {
  const select = element("select", {}, ...entries.map(([value, text]) => new Option(text, value, false, String(value) === String(chosen))));
  return [element("label", {}, `${words} `, select), select];
}

// Fills an opened row. The charts are drawn anew when something is chosen or the width changes.
function showCourses(place, data) {
  const first = Number(place.dataset.policy), recorded = policy => data.policies[policy]?.courses ?? [];
  const draws = data.draws.map((draw, number) => [number, draw]).filter(([number]) => recorded(first)[number]);
  const others = data.policies.flatMap((policy, number) => policy && number !== first ? [[number, isolated(policy.label)]] : []);
  const [drawLabel, draw] = choice("Draw", draws, draws[0][0]);
  const [secondLabel, second] = choice("Second policy", [["", "none"], ...others], data.second === first ? "" : data.second);
  const [axisLabel, axis] = choice("Along", Object.entries(data.axes), "minutes");
  const choices = element("div", { className: "choose" }, drawLabel, secondLabel, axisLabel), output = element("div");
  choices.setAttribute("role", "group");
  choices.setAttribute("aria-label", "What is drawn");
  place.append(choices, output);
  const redraw = () => {
    const courses = [courseOf(data, first, draw.value), second.value === "" ? null : courseOf(data, Number(second.value), draw.value)].filter(Boolean);
    const legend = courses.map((course, number) => key(number ? "second" : "first", named(course.label)));
    legend.push(key("limit", "limit; of wear, the end of the edge"));
    if (data.subjects.some(subject => subject.reference)) legend.push(key("followed", "reference"));
    const panels = element("div", { className: "panels" });
    const thinned = courses.filter(course => course.series.minutes.length < course.intervals);
    const note = [
      second.value !== "" && courses.length < 2 ? "Nothing was recorded of the second policy on this draw." : "",
      thinned.length ? `Of ${thinned.map(course => course.intervals).join(" and ")} intervals some ${thinned[0].series.minutes.length} are drawn: of neighbours those with the least and the greatest load.` : "",
    ].join(" ").trim();
    output.replaceChildren(element("ul", { className: "legend" }, ...legend), panels, element("p", { className: "note", textContent: note }), numbers(data.subjects, courses));
    const columns = getComputedStyle(panels).gridTemplateColumns.split(" ");
    const width = Math.max(200, Math.floor(parseFloat(columns[0]) || 0));
    panels.append(...data.subjects.map(subject => panel(subject, courses, axis.value, data.axes[axis.value], width)));
  };
  for (const select of [draw, second, axis]) select.addEventListener("change", redraw);
  let drawn = 0;
  new ResizeObserver(() => {
    if (!place.clientWidth || place.clientWidth === drawn) return;
    drawn = place.clientWidth;
    redraw();
  }).observe(place);
}
