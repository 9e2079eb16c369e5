'use strict';
// Looks up the numbers of `python -m turning_shop advise --page` in the table that page.py computed, and draws them.
const data = JSON.parse(document.getElementById('data').textContent);
const at = [...data.advice[0].at]; // the step of each slider

// --- table ------------------------------------------------------------------------------------------------------------------------

const table = Object.fromEntries(Object.entries(data.table).map(([name, { shape, numbers }]) => {
  const bytes = Uint8Array.from(atob(numbers), (character) => character.charCodeAt(0));
  return [name, { shape, numbers: new Float32Array(bytes.buffer) }];
}));

/** A quantity at steps of the sliders. It has length 1 along axes that do not matter. */
function look(name, steps) {
  const { shape, numbers } = table[name];
  let index = 0;
  shape.forEach((length, axis) => { index = index * length + (length === 1 ? 0 : steps[axis]); });
  return numbers[index];
}

/** The steps that differ from those chosen by speed and feed alone. */
const elsewhere = (speed, feed) => [speed, feed, ...at.slice(2)];
const isAllowed = (steps) => look('thrust_force_share', steps) <= 1 && look('power_share', steps) <= 1;

/** The steps of least cost within limits, at the other sliders; null if there are none. */
function cheapest() {
  let best = null;
  for (const feed of feeds.keys())
    for (const speed of speeds.keys()) {
      const steps = elsewhere(speed, feed);
      if (isAllowed(steps) && (!best || look('cost', steps) < look('cost', best))) best = steps;
    }
  return best;
}

// --- map --------------------------------------------------------------------------------------------------------------------------

const map = document.getElementById('map');
const [speeds, feeds] = data.axes.map((axis) => axis.values);
const margin = { left: 68, right: 14, top: 10, bottom: 46 };

function scale(values, from, to) {
  const low = values[0], high = values.at(-1);
  const span = high - low || 1;
  const along = (value) => from + (to - from) * (value - low) / span;
  along.invert = (pixel) => low + span * (pixel - from) / (to - from);
  return along;
}

function scales() {
  return {
    x: scale(speeds, margin.left, map.clientWidth - margin.right),
    y: scale(feeds, map.clientHeight - margin.bottom, margin.top),
  };
}

/** Paths of the area where values at the steps are at most a level, and of the line where they equal it, cell by cell. */
function contour(values, level, x, y) {
  let area = '', line = '';
  for (let j = 0; j + 1 < feeds.length; j++)
    for (let i = 0; i + 1 < speeds.length; i++) {
      const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
      const polygon = [], crossings = [];
      corners.forEach(([a, b], k) => {
        const [c, d] = corners[(k + 1) % 4];
        const here = values[b][a] - level, next = values[d][c] - level;
        const point = (share) =>
          `${x(speeds[a] + share * (speeds[c] - speeds[a])).toFixed(1)} ${y(feeds[b] + share * (feeds[d] - feeds[b])).toFixed(1)}`;
        if (here <= 0) polygon.push(point(0));
        if ((here <= 0) !== (next <= 0)) {
          crossings.push(point(Number.isFinite(here - next) ? here / (here - next) : 1));
          polygon.push(crossings.at(-1));
        }
      });
      if (polygon.length) area += `M${polygon.join('L')}Z`;
      for (let k = 0; k < crossings.length; k += 2) line += `M${crossings[k]}L${crossings[k + 1]}`;
    }
  return { area, line };
}

/** Round numbers between two, at most about `count`. */
function ticks(low, high, count) {
  if (high <= low) return [low];
  const power = 10 ** Math.floor(Math.log10((high - low) / count));
  const step = power * [1, 2, 5, 10].find((factor) => (high - low) / (power * factor) <= count);
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, i) => Number(((first + i) * step).toPrecision(6)));
}

function element(name, attributes, text = '') {
  const made = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

/** A quantity at all speeds and feeds, at the other sliders. */
const rows = (name) => feeds.map((_, feed) => speeds.map((_, speed) => look(name, elsewhere(speed, feed))));

function drawMap(best) {
  if (!map.clientWidth) return; // not laid out yet, or hidden: the observer below draws it when it has a size
  const { x, y } = scales();
  const [left, right, bottom, top] = [x(speeds[0]), x(speeds.at(-1)), y(feeds[0]), y(feeds.at(-1))];
  const force = rows('thrust_force_share'), power = rows('power_share'), lives = rows('tool_life');
  const worst = force.map((row, j) => row.map((share, i) => Math.max(share, power[j][i])));
  const drawn = [
    element('rect', { class: 'over', x: left, y: top, width: right - left, height: bottom - top }),
    element('path', { class: 'allowed', d: contour(worst, 1, x, y).area }),
  ];
  const labels = [], middle = Math.floor(feeds.length / 2);
  for (const level of [0.5, 1, 2, 5, 10, 20, 50, 100, 200].filter((life) => life < data.longest_life)) {
    const { line } = contour(lives, level, x, y);
    if (line) drawn.push(element('path', { class: 'line life', d: line }));
    const i = speeds.findIndex((_, k) => k && (lives[middle][k - 1] > level) !== (lives[middle][k] > level));
    const place = x(speeds[i]);
    if (i > 0 && place > left + 15 && place < right - 15 && labels.every((other) => Math.abs(other.place - place) > 40))
      labels.push({ place, made: element('text', { class: 'life', x: place, y: y(feeds[middle]), 'text-anchor': 'middle' }, String(level)) });
  }
  for (const [values, kind] of [[force, 'force'], [power, 'power']])
    drawn.push(element('path', { class: `line ${kind}`, d: contour(values, 1, x, y).line }));
  const box = data.measured;
  document.getElementById('measured').hidden = !box;
  document.getElementById('measured').textContent = data.origins === 'measured' ? 'measured range' : 'range of the catalogue';
  if (box) {
    const [a, b] = box.cutting_speed.map(x), [c, d] = box.feed.map(y);
    drawn.push(element('rect', { class: 'measured', x: a, y: d, width: b - a, height: c - d }));
  }
  drawn.push(...labels.map((label) => label.made));
  const ofSpeed = unitOf('m/min'), ofFeed = unitOf('mm/rev');
  for (const value of ticks(ofSpeed.factor * speeds[0], ofSpeed.factor * speeds.at(-1), map.clientWidth / 70))
    drawn.push(element('text', { x: x(value / ofSpeed.factor), y: bottom + 18, 'text-anchor': 'middle' }, String(value)));
  for (const value of ticks(ofFeed.factor * feeds[0], ofFeed.factor * feeds.at(-1), 8))
    drawn.push(element('text', { x: left - 6, y: y(value / ofFeed.factor) + 4, 'text-anchor': 'end' }, String(value)));
  drawn.push(element('text', { x: (left + right) / 2, y: bottom + 38, 'text-anchor': 'middle' }, `cutting speed [${ofSpeed.name}]`));
  drawn.push(element('text', { transform: `translate(14 ${(top + bottom) / 2}) rotate(-90)`, 'text-anchor': 'middle' },
    `feed [${ofFeed.name}]`));
  if (best) drawn.push(element('rect', { class: 'cheapest', x: -6, y: -6, width: 12, height: 12,
    transform: `translate(${x(speeds[best[0]])} ${y(feeds[best[1]])}) rotate(45)` }));
  drawn.push(element('circle', { class: 'here', cx: x(speeds[at[0]]), cy: y(feeds[at[1]]), r: 9 }));
  map.replaceChildren(...drawn);
}

// --- sliders and numbers ----------------------------------------------------------------------------------------------------------

const inputs = [];

/** A number with three digits or all before the point. */
function shown(value) {
  return Math.abs(value) >= 100 ? String(Math.round(value)) : String(Number(value.toPrecision(3)));
}

/** The unit in which a metric one is shown: its name, and its factor over the metric one. */
function unitOf(metric) {
  return data.units[metric] ?? { name: metric, factor: 1 };
}

/** A metric quantity in the unit in which it is shown. */
function quantity(value, metric) {
  const { name, factor } = unitOf(metric);
  return `${shown(factor * value)} ${name}`.trim();
}

/** An amount of money, as advise.py prints it. */
function money(value) {
  return value >= 1 ? value.toFixed(2) : String(Number(value.toPrecision(3)));
}

function choose(steps) {
  steps.forEach((step, axis) => {
    const { values, unit } = data.axes[axis];
    at[axis] = step;
    inputs[axis].slider.value = step;
    inputs[axis].output.textContent = quantity(values[step], unit);
    inputs[axis].slider.ariaValueText = inputs[axis].output.textContent;
  });
  update();
}

/** Rows of the table of results: name, label and unit. */
const RESULTS = [
  ['thrust_force', 'thrust force (feed and back force)', 'N'],
  ['power', 'power', 'kW'],
  ['tool_life', 'tool life', 'min'],
  ['parts', 'change after', 'parts'],
  ['minutes', 'cutting time to the change', 'min'],
  ['cycle_time', 'time per part', 'min'],
  ['removal_rate', 'removal rate', 'cm3/min'],
  ['mean_removal_rate', 'removal rate, changes included', 'cm3/min'],
  ['spindle_speed', 'spindle speed', 'rev/min'],
  ['cost', 'cost of a part', data.unit],
];

/** The 95 % interval of a quantity; null if nothing is known of its law. */
function interval(name) {
  if (name === 'cost') {
    const ends = [look('cost_low', at), look('cost_high', at)];
    return Number.isFinite(ends[0]) ? ends : null;
  }
  if (!(`${name}_factor` in table)) return null;
  const factor = look(`${name}_factor`, at), value = look(name, at);
  return Number.isFinite(factor) && Number.isFinite(value) ? [value / factor, value * factor] : null;
}

function resultRow([name, label, metric]) {
  const row = document.createElement('tr');
  const [head, value, ends] = ['th', 'td', 'td'].map((tag) => row.appendChild(document.createElement(tag)));
  const { name: unitName, factor } = unitOf(metric);
  const text = name === 'cost' ? money : (number) => shown(factor * number);
  head.textContent = label;
  head.scope = 'row';
  value.className = 'value';
  value.dataset.name = name;
  const number = look(name, at);
  value.textContent = Number.isFinite(number) ? `${text(number)} ${unitName.replace('3/', '³/')}` : 'not limited by wear';
  if (`${name}_share` in table && look(`${name}_share`, at) > 0)
    value.textContent += `, ${Math.round(100 * look(`${name}_share`, at))} % of what is allowed`;
  ends.textContent = interval(name)?.map(text).join(' to ') ?? '';
  return row;
}

function update() {
  const best = cheapest();
  const over = [['thrust force', 'thrust_force_share'], ['power', 'power_share']].filter(([, name]) => look(name, at) > 1);
  const verdict = document.getElementById('verdict');
  verdict.textContent = `${over.length ? `Above what is allowed: ${over.map(([name]) => name).join(', ')}` : 'Within limits'}`
    + ` · change after ${shown(look('parts', at))} parts · ${money(look('cost', at))} ${data.unit} a part`
    + (look('extrapolated', at) ? ` · * extrapolated: not ${data.origins} there` : '');
  verdict.className = over.length ? 'bad' : '';
  document.getElementById('results').replaceChildren(...RESULTS.map(resultRow));
  const advice = document.getElementById('cheapest');
  if (best) {
    const go = document.createElement('button');
    go.type = 'button';
    go.textContent = 'choose it';
    go.addEventListener('click', () => choose(best));
    advice.replaceChildren(`Cheapest of these steps within limits: ${quantity(speeds[best[0]], 'm/min')}, `
      + `${quantity(feeds[best[1]], 'mm/rev')}, ${money(look('cost', best))} ${data.unit} a part `, go);
  } else advice.textContent = 'No speed and feed keep the limits.';
  drawMap(best);
}

function makeSlider({ name, label, values }, axis) {
  const box = document.createElement('div');
  box.className = 'slider';
  const title = box.appendChild(document.createElement('label'));
  title.textContent = label;
  title.htmlFor = name;
  const output = box.appendChild(document.createElement('strong')); // not an output, which screen readers would announce with the verdict
  const slider = box.appendChild(document.createElement('input'));
  Object.assign(slider, { type: 'range', id: name, min: 0, max: values.length - 1, step: 1, disabled: values.length === 1 });
  slider.addEventListener('input', () => choose(at.map((step, other) => other === axis ? Number(slider.value) : step)));
  inputs.push({ slider, output });
  return box;
}

const form = document.getElementById('sliders');
form.append(...data.axes.map(makeSlider));
for (const { aim, at: steps } of data.advice) {
  const button = document.createElement('button');
  button.type = 'button';
  button.textContent = aim;
  button.addEventListener('click', () => choose(steps));
  document.getElementById('advice').append(button);
}
map.addEventListener('click', (event) => {
  const { x, y } = scales(), box = map.getBoundingClientRect();
  const nearest = (values, value) => values.reduce((best, other, step) => Math.abs(other - value) < Math.abs(values[best] - value) ? step : best, 0);
  choose(elsewhere(nearest(speeds, x.invert(event.clientX - box.left)), nearest(feeds, y.invert(event.clientY - box.top))));
});
form.addEventListener('submit', (event) => event.preventDefault());
choose(at);
new ResizeObserver(update).observe(map);
