// Error against cost: a scatter of all rows on two logarithmic axes, filtered by clicks, read by hovering.

const SVG = 'http://www.w3.org/2000/svg';
const scenes = JSON.parse(document.getElementById('run').textContent);
const section = document.getElementById('cost');
const holder = section.querySelector('.chart'), readout = section.querySelector('.readout');
const control = (name) => section.querySelector(`[data-control=${name}]`);

/// Properties that rows are filtered by, and their words.
const FILTERS = [
  ['method', 'method', { mmls: 'MMLS', mls: 'MLS', tet4: 'linear finite elements' }],
  ['dimension', 'dimension', { axisymmetric: 'half plane', mirrored: 'half of three dimensions', full: 'three dimensions' }],
  ['cure', 'locking', { projected: 'cured', mixed: 'cured (mixed)', averaged: 'half cured', pointwise: 'not cured' }],
  ['hz', 'poses per second', {}],
  ['pace', 'steps per pose', {}],
  ['points', 'points per cell', {}],
  ['support', 'support', {}],
  ['precision', 'precision', { f32: 'single', f64: 'double' }],
  ['corrected', 'correction', { false: 'none', true: 'by a finer cloud' }],
];
const AXES = {
  pose: 'Cost of a pose in ms', second: 'Cost of a simulated second in s',
  max: 'Largest error of the force in %', rms: 'RMS error of the force in %', moved: 'Error of the displacement in %',
};
const hidden = new Set();
let pinned = null;

function node(tag, attributes, text) {
  const element = document.createElementNS(SVG, tag);
  for (const key in attributes) element.setAttribute(key, attributes[key]);
  if (text !== undefined) element.textContent = text;
  return element;
}

const scene = () => scenes[Number(control('scene').value) || 0];
const word = ([, , words], value) => words[value] || String(value);
const digits = (x, n = 3) => (x === null || x === undefined ? '–' : Number(x.toPrecision(n)).toString());
const shown = () => scene().rows.filter((row) => FILTERS.every(([key]) => !hidden.has(`${key}=${row[key]}`)));
const drawable = (row) => row[control('x').value] > 0 && row[control('y').value] > 0;

/// Rows that no other of the same rate of poses beats in both, cheapest first.
function front(rows, hz) {
  const [x, y] = [control('x').value, control('y').value];
  const sorted = rows.filter((row) => row.hz === hz).sort((a, b) => a[x] - b[x] || a[y] - b[y]);
  let least = Infinity;
  return sorted.filter((row) => row[y] < least && ((least = row[y]), true));
}

/// 1, 2, 5 times powers of ten within decades.
function ticks([min, max]) {
  const at = [];
  for (let p = Math.floor(min); p <= Math.ceil(max); p++) {
    for (const m of [1, 2, 5]) if (p + Math.log10(m) >= min && p + Math.log10(m) <= max) at.push(Number(`${m}e${p}`));
  }
  return at;
}

function decades(values, least) {
  const logs = values.map(Math.log10).concat(least);
  const [min, max] = [Math.min(...logs), Math.max(...logs)];
  return [min - 0.05 * (max - min), max + 0.05 * (max - min)];
}

function filters() {
  const place = section.querySelector('.filters');
  place.replaceChildren();
  for (const filter of FILTERS) {
    const values = [...new Set(scene().rows.map((row) => row[filter[0]]))];
    const words = Object.keys(filter[2]);
    values.sort((a, b) => (words.length ? words.indexOf(a) - words.indexOf(b) : Number(a) - Number(b) || String(a).localeCompare(String(b))));
    if (values.length < 2) continue;
    const set = document.createElement('fieldset');
    const legend = document.createElement('legend');
    legend.textContent = filter[1];
    set.append(legend);
    for (const value of values) {
      const key = `${filter[0]}=${value}`;
      const button = document.createElement('button');
      button.type = 'button';
      button.dataset.filter = key;
      button.setAttribute('aria-pressed', String(!hidden.has(key)));
      if (filter[0] === 'method') {
        const swatch = document.createElement('i');
        swatch.style.background = `var(--${value})`;
        button.append(swatch);
      }
      button.append(word(filter, value));
      button.addEventListener('click', () => {
        if (!hidden.delete(key)) hidden.add(key);
        pinned = null;
        draw();
      });
      set.append(button);
    }
    place.append(set);
  }
}

/// A mark as the picture draws it: disc in the half plane, square in space, triangle for half of it, hexagon for hexahedra, hollow for slow poses, a
/// cross if it locks, in a ring where it is corrected.
function mark(row, x, y) {
  const colour = `var(--${row.method})`, m = 5;
  if (row.cure === 'averaged' || row.cure === 'pointwise') {
    const d = row.cure === 'averaged' ? `M${x - m} ${y}h${2 * m}M${x} ${y - m}v${2 * m}` : `M${x - m} ${y - m}l${2 * m} ${2 * m}M${x - m} ${y + m}l${2 * m} ${-2 * m}`;
    return node('path', { class: 'point', d, stroke: colour, fill: 'none' });
  }
  const style = { class: 'point', stroke: colour, fill: row.hz >= 1000 ? colour : 'var(--card)', 'fill-opacity': row.hz >= 1000 ? 0.75 : 0.3 };
  const polygon = (corners) => node('polygon', { ...style, points: corners.map(([a, b]) => `${x + m * a},${y + m * b}`).join(' ') });
  const shape = () => {
    if (row.dimension === 'axisymmetric') return node('circle', { ...style, cx: x, cy: y, r: m });
    if (String(row.points).includes('hexahedra')) return polygon([0, 1, 2, 3, 4, 5].map((i) => [1.3 * Math.cos(i * Math.PI / 3), 1.3 * Math.sin(i * Math.PI / 3)]));
    if (row.dimension === 'mirrored') return polygon([[-1.2, 0.8], [1.2, 0.8], [0, -1.3]]);
    return node('rect', { ...style, x: x - m, y: y - m, width: 2 * m, height: 2 * m });
  };
  if (!row.corrected) return shape();
  const ringed = node('g', { class: 'point' }), inner = shape();
  inner.removeAttribute('class');
  ringed.append(inner, node('circle', { cx: x, cy: y, r: 1.8 * m, fill: 'none', stroke: colour }));
  return ringed;
}

/// The label beside its point where nothing is in the way, or nowhere.
function label(svg, text, [x, y], frame, taken) {
  const width = 6.6 * text.length, height = 14;
  for (const far of [10, 18, 30, 45, 65, 90, 120]) {
    for (const [dx, dy] of [[1, 0], [-1, 0], [0.8, -0.7], [0.8, 0.7], [-0.8, -0.7], [-0.8, 0.7], [0, -1], [0, 1]]) {
      const left = x + dx * far + (dx > 0 ? 0 : dx < 0 ? -width : -width / 2), top = y + dy * far - height / 2;
      const box = [left - 2, top, left + width + 2, top + height];
      const inside = box[0] > frame[0] && box[1] > frame[1] && box[2] < frame[2] && box[3] < frame[3];
      if (!inside || taken.some((t) => box[0] < t[2] && t[0] < box[2] && box[1] < t[3] && t[1] < box[3])) continue;
      taken.push(box);
      const end = [Math.min(Math.max(x, box[0]), box[2]), Math.min(Math.max(y, box[1]), box[3])];
      svg.append(node('line', { class: 'lead', x1: x, y1: y, x2: end[0], y2: end[1] }));
      svg.append(node('text', { class: 'over name', x: left, y: top + 11 }, text));
      return;
    }
  }
}

function draw() {
  filters();
  const width = Math.round(holder.clientWidth);
  if (!width) return;
  const [kx, ky] = [control('x').value, control('y').value];
  const rows = shown().filter(drawable);
  const height = Math.max(380, Math.min(620, 0.62 * width)), left = 52, right = width - 12, top = 30, bottom = height - 44;
  const frame = [left, top, right, bottom];
  const levels = ky === 'moved' ? [] : scene().levels;
  const X = decades(rows.map((row) => row[kx]), [-1, 1]);
  const Y = decades(rows.map((row) => row[ky]).concat(levels.map((level) => level.error)), [-0.5, 1]);
  const px = (v) => left + (Math.log10(v) - X[0]) / (X[1] - X[0]) * (right - left);
  const py = (v) => bottom - (Math.log10(v) - Y[0]) / (Y[1] - Y[0]) * (bottom - top);
  const svg = node('svg', { viewBox: `0 0 ${width} ${height}`, height, role: 'img', 'aria-label': `${AXES[ky]} over ${AXES[kx]}` });
  for (const v of ticks(X)) {
    svg.append(node('line', { class: 'rule', x1: px(v), x2: px(v), y1: top, y2: bottom }));
    if (width > 640 || Number.isInteger(Math.log10(v))) svg.append(node('text', { x: px(v), y: bottom + 17, 'text-anchor': 'middle' }, v));
  }
  for (const v of ticks(Y)) {
    svg.append(node('line', { class: 'rule', x1: left, x2: right, y1: py(v), y2: py(v) }));
    svg.append(node('text', { x: left - 6, y: py(v) + 4, 'text-anchor': 'end' }, v));
  }
  svg.append(node('text', { class: 'title', x: 0, y: 14 }, AXES[ky]));
  svg.append(node('text', { x: (left + right) / 2, y: bottom + 36, 'text-anchor': 'middle' }, AXES[kx]));
  const taken = [];
  const lines = kx === 'pose' ? [[10, 'real time at 100 Hz'], [1, 'real time at 1 kHz']] : [[1, 'real time']];
  for (const [at, text] of lines) {
    if (px(at) < left || px(at) > right) continue;
    svg.append(node('line', { class: 'limit', x1: px(at), x2: px(at), y1: top, y2: bottom }));
    const flip = px(at) - 6.6 * text.length < left;
    svg.append(node('text', { class: 'over', x: px(at) + (flip ? 5 : -5), y: top + 13, 'text-anchor': flip ? 'start' : 'end' }, text));
    taken.push(flip ? [px(at), top, px(at) + 7 * text.length, top + 18] : [px(at) - 7 * text.length, top, px(at), top + 18]);
  }
  for (const { error, text } of levels) {
    svg.append(node('line', { class: 'level', x1: left, x2: right, y1: py(error), y2: py(error) }));
    svg.append(node('text', { class: 'over', x: right - 4, y: py(error) - 4, 'text-anchor': 'end' }, text));
    taken.push([right - 6.8 * text.length, py(error) - 17, right, py(error)]);
  }
  const best = [];
  for (const hz of [...new Set(rows.map((row) => row.hz))]) {
    const along = front(rows, hz);
    best.push(...along);
    const points = along.map((row) => `${px(row[kx]).toFixed(1)},${py(row[ky]).toFixed(1)}`).join(' ');
    svg.append(node('polyline', { class: hz < 1000 ? 'front slow' : 'front', points }));
  }
  const marks = rows.map((row) => {
    const at = [px(row[kx]), py(row[ky])];
    const element = mark(row, at[0], at[1]);
    taken.push([at[0] - 6, at[1] - 6, at[0] + 6, at[1] + 6]);
    svg.append(element);
    return { row, at, element };
  });
  for (const { row, at } of marks) if (row.name) label(svg, row.name, at, frame, taken);
  listen(svg, marks);
  holder.replaceChildren(svg);
  table(best);
  const ended = shown().filter((row) => row.ended).length;
  section.querySelector('.note').textContent = `${rows.length} of ${scene().rows.length} runs shown` +
    (ended ? `; ${ended} ended before their depth and have no mark.` : '.') +
    ' Disc: half plane; square: three dimensions; triangle: half of it; hexagon: hexahedra; ring: corrected; filled: 1000 poses per second; hollow: fewer; cross: locking not cured; plus: half cured.';
  read(marks.find((m) => m.row === pinned) || null, marks);
}

function listen(svg, marks) {
  const nearest = (event) => {
    const box = svg.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let best = null, least = 30 ** 2;
    for (const m of marks) {
      const d = (m.at[0] - x) ** 2 + (m.at[1] - y) ** 2;
      if (d < least) { least = d; best = m; }
    }
    return best;
  };
  svg.addEventListener('pointermove', (event) => read(nearest(event) || marks.find((m) => m.row === pinned) || null, marks));
  svg.addEventListener('pointerdown', (event) => {
    const m = nearest(event);
    pinned = m ? m.row : null;
    read(m, marks);
  });
}

/// Everything that is known of a row.
function read(m, marks) {
  for (const other of marks) other.element.classList.toggle('on', other === m);
  readout.replaceChildren();
  if (!m) {
    readout.textContent = 'Hover or tap a mark to read its run; click it to keep it, click a word above to leave such runs out.';
    return;
  }
  const r = m.row;
  const name = document.createElement('b');
  name.textContent = FILTERS.slice(0, 3).map((filter) => word(filter, r[filter[0]])).join(', ') + (r.corrected ? ', corrected' : '') + (r.name ? ` (${r.name})` : '');
  readout.append(name,
    ` · ${r.nodes} nodes, ${r.integration_points} points · spacing ${digits(r.spacing)} mm, ${digits(r.edge)} mm at the edge · support ${r.support}` +
    ` · ${r.points} per cell · ${r.precision} · ${r.hz} poses per second, steps ${r.pace} (${r.steps} in all)` +
    ` · force error ${digits(r.max)} % at most, ${digits(r.rms)} % RMS · displacement ${digits(r.moved)} % · ${digits(r.pose)} ms per pose,` +
    ` ${digits(r.second)} s per simulated second, ${digits(r.factor)} times real time · worst J ${digits(r.jacobian)}` +
    (r.recoveries ? ` · went back ${r.recoveries} times` : ''));
}

function table(best) {
  const place = document.querySelector('#best .wide');
  const heads = ['method', 'dimension', 'locking', 'nodes', 'support', 'points', 'precision', 'Hz', 'steps', 'ms per pose', '× real time', 'largest error %', 'RMS %', 'displacement %'];
  const element = document.createElement('table');
  element.className = 'scroll';
  const line = (cells, tag) => {
    const tr = document.createElement('tr');
    cells.forEach((cell, i) => {
      const td = document.createElement(tag);
      if (i > 2) td.className = 'number';
      td.textContent = cell;
      tr.append(td);
    });
    return tr;
  };
  element.createTHead().append(line(heads, 'th'));
  const rows = element.createTBody();
  for (const r of best) {
    rows.append(line([...FILTERS.slice(0, 3).map((f) => word(f, r[f[0]])), r.nodes, r.support, r.points, r.precision, r.hz, r.pace, digits(r.pose), digits(r.factor), digits(r.max), digits(r.rms), digits(r.moved)], 'td'));
  }
  place.replaceChildren(element);
}

for (const name of ['scene', 'x', 'y']) {
  control(name).addEventListener('change', () => {
    pinned = null;
    if (name === 'scene') hidden.clear();
    draw();
  });
}
draw();
let drawnAt = holder.clientWidth;
new ResizeObserver(() => requestAnimationFrame(() => {
  if (holder.clientWidth === drawnAt) return;
  drawnAt = holder.clientWidth;
  draw();
})).observe(holder);
