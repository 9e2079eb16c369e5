'use strict';
// Computes and draws the page of `python -m turning_shop advise --page`: the formulas of whatif.py, prediction.py and advise.py.
const data = JSON.parse(document.getElementById('data').textContent);
const FACTORS = ['cutting_speed', 'feed', 'depth_of_cut', 'time', 'wear', 'hardness'];
const settings = {};

// --- laws -----------------------------------------------------------------------------------------------------------------------

/** The term of wear: wear, or 1 + growth * wear in a law with a fresh edge's share. */
function wearTerm(law, wear) {
  return law.wear_growth ? 1 + law.wear_growth * wear : wear;
}

/** The response of a power law to its factors; those that are not given are 1. */
function respond(law, at) {
  let sum = law.log_coefficient;
  for (const name of FACTORS) {
    if (!law[name] || !(name in at)) continue;
    sum += law[name] * Math.log(name === 'wear' ? wearTerm(law, at.wear) : at[name]);
  }
  return Math.exp(sum);
}

/** The slope of a fitted law's log response by one of its numbers: `regressor` of fit.py. */
function regressor(known, name, at) {
  if (name === 'wear_growth') return known.law.wear * at.wear / wearTerm(known.law, at.wear);
  if (name === 'wear') return Math.log(wearTerm(known.law, at.wear));
  return Math.log(at[name] / (name === 'depth_of_cut' ? known.reference_depth_of_cut : 1));
}

/** What differs between the curves of edges: `curve_slope` of fit.py. */
function curveSlope(known, at) {
  const { law, curve_reference: reference } = known;
  if (law.wear_growth) return law.wear * law.wear_growth * at.wear / wearTerm(law, at.wear);
  return Math.log(at[law.time ? 'time' : 'wear'] / reference);
}

/** Half the width of a fitted law's 95 % interval in the response's logarithm: of a reading, or of the law itself. */
function halfWidth(known, at, ofReading = true) {
  const x = [1, ...known.terms.map((name) => regressor(known, name, at))];
  const variance = x.reduce((sum, a, i) => sum + x.reduce((row, b, j) => row + a * known.covariance[i][j] * b, 0), 0);
  const scatter = ofReading ? known.scatter ** 2 + (known.curve_scatter * curveSlope(known, at)) ** 2 : 0;
  return known.quantile * Math.sqrt(Math.max(variance, 0) + scatter);
}

/** Whether a factor lies outside the range in which a law was measured. */
function extrapolates(known, at) {
  return Object.entries(known.measured).some(
    ([name, [low, high]]) => at[name] < low * (1 - data.beyond) || at[name] > high * (1 + data.beyond));
}

/** Loads and life of a cut with the edge worn as stated. */
function cut(at) {
  const { wear, thrust_force: force, power } = data.laws;
  const { cutting_speed: speed, feed, depth_of_cut: depth, hardness } = at;
  const afterMinute = respond(wear, { cutting_speed: speed, feed, depth_of_cut: depth, hardness });
  const capacity = data.base_cutting_speed ? Math.min(speed / data.base_cutting_speed, 1) : 1;
  const loads = { thrust_force: respond(force, at), power: respond(power, at) + data.idle_power_per_speed * speed };
  const over = (load, limit) => limit === null ? 0 : load / limit; // null: no limit is stated
  const shares = [over(loads.thrust_force, data.limits.thrust_force), over(loads.power / capacity, data.limits.power)];
  // The loads that advice allows keep margins for bars and edges that vary: allowed_loads of allowed.py.
  const strains = {
    thrust_force: over(loads.thrust_force, data.allowed.thrust_force),
    power: over(loads.power / capacity, data.allowed.power),
  };
  return {
    ...loads,
    thrust_force_share: shares[0],
    power_share: shares[1],
    thrust_force_strain: strains.thrust_force,
    power_strain: strains.power,
    worst: Math.max(strains.thrust_force, strains.power),
    time: (at.wear / afterMinute) ** (1 / wear.time),
    tool_life: (data.criterion / afterMinute) ** (1 / wear.time),
    removal_rate: speed * feed * depth,
    spindle_speed: 1000 * speed / (Math.PI * data.diameter),
  };
}

/** Prices of a minute and of an edge, in money, or in minutes of machine time if there is no hourly rate. */
function prices(at) {
  const rate = (at.machine_rate + at.operator_rate) / 60;
  const minute = rate || 1;
  return { unit: rate ? data.currency : 'min', minute, edge: at.insert_price ? at.insert_price / at.edges_per_insert : data.edge_cost * minute };
}

/** Parts per edge, times and cost of a part, if the logarithm of all lives shifts: see `plan` of advise.py. */
function part(at, found, shift = 0) {
  const { minute, edge } = prices(at);
  const perMinute = at.feed * found.spindle_speed;
  const measured = data.known.wear?.origin === 'measured';
  const known = measured ? halfWidth(data.known.wear, { ...at, time: found.time }) / data.laws.wear.time : 0;
  const lasting = found.time * Math.exp(shift - Math.max(data.life_spread, known)) * perMinute / data.bar_length;
  const parts = lasting < 1 ? lasting : Math.floor(lasting * (1 + 1e-9));
  const cycle = (data.bar_length + data.approach) / perMinute + data.return_time;
  const withChange = cycle + at.edge_change_time / parts;
  const volume = Math.PI * data.diameter * at.depth_of_cut * data.bar_length / 1000;
  return {
    parts, minutes: parts * data.bar_length / perMinute, cycle_time: cycle, mean_removal_rate: volume / withChange,
    cost: minute * withChange + edge / parts,
  };
}

/** Results of settings: values, 95 % intervals of fitted laws, and whether a law is used outside its measured range. */
function results(at) {
  const found = cut(at);
  const values = { ...found, ...part(at, found) };
  const halves = {};
  for (const name of ['thrust_force', 'power']) if (data.known[name]) halves[name] = halfWidth(data.known[name], at);
  if (data.known.wear) halves.tool_life = halfWidth(data.known.wear, { ...at, time: found.tool_life }) / data.laws.wear.time;
  const intervals = {};
  for (const [name, half] of Object.entries(halves)) intervals[name] = [values[name] * Math.exp(-half), values[name] * Math.exp(half)];
  if (data.known.wear) {
    const half = halfWidth(data.known.wear, { ...at, time: found.time }, false) / data.laws.wear.time;
    intervals.cost = [part(at, found, half).cost, part(at, found, -half).cost];
  }
  const extrapolated = Object.values(data.known).some((known) => extrapolates(known, { ...at, time: found.time }));
  return { values, intervals, extrapolated };
}

/** Numbers from low to high in equal ratios. */
function ratios(low, high, count) {
  return Array.from({ length: count }, (_, i) => low * (high / low) ** (i / (count - 1)));
}

const range = Object.fromEntries(data.sliders.map((slider) => [slider.name, [slider.low, slider.high]]));

/** Speed and feed of least cost within limits, at the other settings; null if there are none. */
function cheapest() {
  let best = null;
  for (const feed of data.feeds)
    for (const speed of data.speeds) {
      const at = { ...settings, cutting_speed: speed, feed };
      const found = cut(at);
      if (found.worst > 1) continue;
      const { cost } = part(at, found);
      if (!best || cost < best.cost) best = { cutting_speed: speed, feed, cost };
    }
  return best;
}

// --- map ------------------------------------------------------------------------------------------------------------------------

const map = document.getElementById('map');
const speeds = ratios(...range.cutting_speed, 41), feeds = ratios(...range.feed, 41);
const margin = { left: 68, right: 14, top: 10, bottom: 46 };

function scale([low, high], from, to) {
  const along = (value) => from + (to - from) * (value - low) / (high - low);
  along.invert = (pixel) => low + (high - low) * (pixel - from) / (to - from);
  return along;
}

function scales() {
  return {
    x: scale(range.cutting_speed, margin.left, map.clientWidth - margin.right),
    y: scale(range.feed, map.clientHeight - margin.bottom, margin.top),
  };
}

/** Paths of the area where a table's values are at most a level, and of the line where they equal it, cell by cell. */
function contour(table, level, x, y) {
  let area = '', line = '';
  for (let j = 0; j + 1 < feeds.length; j++)
    for (let i = 0; i + 1 < speeds.length; i++) {
      const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
      const polygon = [], crossings = [];
      corners.forEach(([a, b], k) => {
        const [c, d] = corners[(k + 1) % 4];
        const here = table[b][a] - level, next = table[d][c] - level;
        const at = (share) =>
          `${x(speeds[a] + share * (speeds[c] - speeds[a])).toFixed(1)} ${y(feeds[b] + share * (feeds[d] - feeds[b])).toFixed(1)}`;
        if (here <= 0) polygon.push(at(0));
        if ((here <= 0) !== (next <= 0)) {
          crossings.push(at(here / (here - next)));
          polygon.push(crossings.at(-1));
        }
      });
      if (polygon.length) area += `M${polygon.join('L')}Z`;
      for (let k = 0; k < crossings.length; k += 2) line += `M${crossings[k]}L${crossings[k + 1]}`;
    }
  return { area, line };
}

/** Round numbers between two, at most about `count`. */
function ticks([low, high], count) {
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

/** Speed and feed between which all fitted laws were measured; null if none was fitted or the ranges do not meet. */
function measured() {
  const box = Object.fromEntries(['cutting_speed', 'feed'].map((name) => {
    const known = Object.values(data.known).map((law) => law.measured[name]).filter(Boolean);
    return [name, [Math.max(range[name][0], ...known.map((ends) => ends[0])), Math.min(range[name][1], ...known.map((ends) => ends[1]))]];
  }));
  const some = Object.keys(data.known).length && Object.values(box).every(([low, high]) => low < high);
  return some ? box : null;
}

function drawMap(best) {
  const { x, y } = scales();
  const table = feeds.map((feed) => speeds.map((speed) => cut({ ...settings, cutting_speed: speed, feed })));
  const of = (name) => table.map((row) => row.map((found) => found[name]));
  const [left, right, bottom, top] = [x(range.cutting_speed[0]), x(range.cutting_speed[1]), y(range.feed[0]), y(range.feed[1])];
  const drawn = [
    element('rect', { class: 'over', x: left, y: top, width: right - left, height: bottom - top }),
    element('path', { class: 'allowed', d: contour(of('worst'), 1, x, y).area }),
  ];
  const lives = table.map((row) => row.map((found) => Math.log10(Math.min(found.tool_life, 1e300))));
  const labels = [];
  for (let decade = Math.floor(Math.min(...lives.flat())); decade <= Math.max(...lives.flat()) && decade < 5; decade++)
    for (const digit of [1, 2, 5]) {
      const level = decade + Math.log10(digit);
      const { line } = contour(lives, level, x, y);
      if (line) drawn.push(element('path', { class: 'line life', d: line }));
      const row = 12, i = speeds.findIndex((_, k) => k && (lives[row][k - 1] - level) * (lives[row][k] - level) < 0);
      const place = x(speeds[i]);
      if (i > 0 && place > left + 15 && place < right - 15 && labels.every((other) => Math.abs(other.place - place) > 40))
        labels.push({ place, made: element('text', { class: 'life', x: place, y: y(feeds[row]), 'text-anchor': 'middle' },
          String(Number((digit * 10 ** decade).toPrecision(1)))) });
    }
  for (const [name, look] of [['thrust_force_strain', 'force'], ['power_strain', 'power']])
    drawn.push(element('path', { class: `line ${look}`, d: contour(of(name), 1, x, y).line }));
  const box = measured();
  document.getElementById('measured').hidden = !box;
  document.getElementById('measured').textContent = data.origins === 'measured' ? 'measured range' : 'range of the catalogue';
  if (box) {
    const [a, b] = box.cutting_speed.map(x), [c, d] = box.feed.map(y);
    drawn.push(element('rect', { class: 'measured', x: a, y: d, width: b - a, height: c - d }));
  }
  drawn.push(...labels.map((label) => label.made));
  const ofSpeed = unitOf('m/min'), ofFeed = unitOf('mm/rev');
  for (const value of ticks(range.cutting_speed.map((end) => ofSpeed.factor * end), map.clientWidth / 70))
    drawn.push(element('text', { x: x(value / ofSpeed.factor), y: bottom + 18, 'text-anchor': 'middle' }, String(value)));
  for (const value of ticks(range.feed.map((end) => ofFeed.factor * end), 8))
    drawn.push(element('text', { x: left - 6, y: y(value / ofFeed.factor) + 4, 'text-anchor': 'end' }, String(value)));
  drawn.push(element('text', { x: (left + right) / 2, y: bottom + 38, 'text-anchor': 'middle' }, `cutting speed [${ofSpeed.name}]`));
  drawn.push(element('text', { transform: `translate(14 ${(top + bottom) / 2}) rotate(-90)`, 'text-anchor': 'middle' },
    `feed [${ofFeed.name}]`));
  if (best) drawn.push(element('rect', { class: 'cheapest', x: -6, y: -6, width: 12, height: 12,
    transform: `translate(${x(best.cutting_speed)} ${y(best.feed)}) rotate(45)` }));
  drawn.push(element('circle', { class: 'here', cx: x(settings.cutting_speed), cy: y(settings.feed), r: 9 }));
  map.replaceChildren(...drawn);
}

// --- sliders and numbers --------------------------------------------------------------------------------------------------------

const DIGITS = { cutting_speed: 1, feed: 3, depth_of_cut: 2, wear: 3, hardness: 2, edges_per_insert: 0 };
const inputs = {};

/** A number with three digits or all before the point. */
function shown(value) {
  if (!Number.isFinite(value)) return 'too large';
  return Math.abs(value) >= 100 ? String(Math.round(value)) : String(Number(value.toPrecision(3)));
}

/** The unit in which a metric one is shown: its name, and its factor over the metric one. */
function unitOf(metric) {
  return data.units[metric] ?? { name: metric, factor: 1 };
}

/** A metric quantity in the unit in which it is shown. */
function quantity(value, metric) {
  const { name, factor } = unitOf(metric);
  return `${shown(factor * value)} ${name}`;
}

/** An amount of money, as advise.py prints it. */
function money(value) {
  return value >= 1 ? value.toFixed(2) : String(Number(value.toPrecision(3)));
}

function set(changes) {
  for (const [name, value] of Object.entries(changes)) {
    settings[name] = value;
    const { number, slider, factor } = inputs[name];
    if (Math.abs(Number(number.value) - factor * value) > 1e-9) number.value = String(Number((factor * value).toPrecision(5)));
    slider.value = Number((factor * value).toPrecision(9));
  }
  update();
}

function update() {
  const { values, intervals, extrapolated } = results(settings);
  const { unit } = prices(settings);
  const best = cheapest();
  const over = [['thrust force', values.thrust_force_strain], ['power', values.power_strain]].filter(([, strain]) => strain > 1);
  const verdict = document.getElementById('verdict');
  const costless = settings.insert_price && unit === 'min';
  const cost = costless ? 'set an hourly rate for costs' : `${money(values.cost)} ${unit} a part`;
  verdict.textContent = `${over.length ? `Above what is allowed: ${over.map(([name]) => name).join(', ')}` : 'Within limits'}`
    + ` · change after ${shown(values.parts)} parts · ${cost}${extrapolated ? ' · * extrapolated: not ' + data.origins + ' there' : ''}`;
  verdict.className = over.length ? 'bad' : '';
  const percent = (name) => data.limits[name] === null ? '' : `, ${Math.round(100 * values[`${name}_share`])} % of limit`;
  const rows = [
    ['thrust_force', 'thrust force (feed and back force)', 'N', percent('thrust_force')],
    ['power', 'power', 'kW', percent('power')],
    ['tool_life', 'tool life', 'min'],
    ['parts', 'change after', 'parts'],
    ['minutes', 'cutting time to the change', 'min'],
    ['cycle_time', 'time per part', 'min'],
    ['removal_rate', 'removal rate', 'cm3/min'],
    ['mean_removal_rate', 'removal rate, changes included', 'cm3/min'],
    ['spindle_speed', 'spindle speed', 'rev/min'],
    ...(costless ? [] : [['cost', 'cost of a part', unit]]),
  ];
  document.getElementById('results').replaceChildren(...rows.map(([name, label, of, note = '']) => {
    const row = document.createElement('tr');
    const [head, value, interval] = ['th', 'td', 'td'].map((tag) => row.appendChild(document.createElement(tag)));
    head.textContent = label;
    head.scope = 'row';
    value.className = 'value';
    value.dataset.name = name;
    const { name: unitName, factor } = unitOf(of);
    const form = name === 'cost' ? money : (number) => shown(factor * number);
    value.textContent = `${form(values[name])} ${unitName.replace('3/', '³/')}${note}`.trim();
    interval.textContent = intervals[name] ? intervals[name].map(form).join(' to ') : '';
    return row;
  }));
  const advice = document.getElementById('cheapest');
  if (best && !costless) {
    const go = document.createElement('button');
    go.type = 'button';
    go.textContent = 'choose it';
    go.addEventListener('click', () => set({ cutting_speed: best.cutting_speed, feed: best.feed }));
    advice.replaceChildren(`Cheapest within limits: ${quantity(best.cutting_speed, 'm/min')}, ${quantity(best.feed, 'mm/rev')}, `
      + `${money(best.cost)} ${unit} a part `, go);
  } else advice.textContent = best ? 'An insert has a price in money: set an hourly rate.' : 'No speed and feed keep the limits.';
  drawMap(costless ? null : best);
}

function makeSlider({ name, label, unit, low, high, value }) {
  const { name: unitName, factor } = unitOf(unit);
  const inUnit = (number) => Number((factor * number).toPrecision(9));
  const digits = (DIGITS[name] ?? 1) + (unitOf(unit).decimals ?? 0);
  const box = document.createElement('div');
  box.className = 'slider';
  const title = box.appendChild(document.createElement('label'));
  title.textContent = label;
  title.htmlFor = name;
  const number = box.appendChild(document.createElement('input'));
  Object.assign(number, { type: 'number', id: name, min: inUnit(low), max: inUnit(high), step: 'any', required: true });
  const units = box.appendChild(document.createElement('small'));
  units.textContent = unitName.replace('money', data.currency);
  const slider = box.appendChild(document.createElement('input'));
  Object.assign(slider, { type: 'range', min: inUnit(low), max: inUnit(high), step: 'any', ariaLabel: `${label}, slider` });
  number.disabled = slider.disabled = name === 'cutting_speed' && data.set_speed !== null;
  number.addEventListener('input', () => number.checkValidity() && set({ [name]: Number(number.value) / factor }));
  slider.addEventListener('input', () =>
    set({ [name]: Math.min(high, Math.max(low, Number(Number(slider.value).toFixed(digits)) / factor)) }));
  inputs[name] = { number, slider, factor };
  settings[name] = value;
  number.value = String(Number((factor * value).toPrecision(5)));
  slider.value = inUnit(value);
  return box;
}

const form = document.getElementById('sliders');
for (const [title, names] of [['Cut', ['cutting_speed', 'feed', 'depth_of_cut', 'wear', 'hardness']],
  ['Prices', ['machine_rate', 'operator_rate', 'insert_price', 'edges_per_insert', 'edge_change_time']]]) {
  const heading = document.createElement('h2');
  heading.textContent = title;
  form.append(heading, ...names.map((name) => makeSlider(data.sliders.find((slider) => slider.name === name))));
}
for (const { aim, cutting_speed, feed, wear } of data.advice) {
  const button = document.createElement('button');
  button.type = 'button';
  button.textContent = aim;
  button.addEventListener('click', () => set({ cutting_speed, feed, wear }));
  document.getElementById('advice').append(button);
}
map.addEventListener('click', (event) => {
  const { x, y } = scales(), box = map.getBoundingClientRect();
  const within = ([low, high], value) => Math.min(high, Math.max(low, value));
  const speed = Number(x.invert(event.clientX - box.left).toFixed(1)), feed = Number(y.invert(event.clientY - box.top).toFixed(3));
  set({ cutting_speed: data.set_speed ?? within(range.cutting_speed, speed), feed: within(range.feed, feed) });
});
form.addEventListener('submit', (event) => event.preventDefault());
new ResizeObserver(update).observe(map);
