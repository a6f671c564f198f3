// Line charts as SVG: stacked panels over one horizontal axis, phases as bands, a cursor that all charts share.

const SVG = 'http://www.w3.org/2000/svg';
/// Height of the ribbon with the names of the phases, px.
const RIBBON = 18;

function node(tag, attributes, text) {
  const element = document.createElementNS(SVG, tag);
  for (const key in attributes) element.setAttribute(key, attributes[key]);
  if (text !== undefined) element.textContent = text;
  return element;
}

/// Round numbers within [min, max], about `count` of them, and the decimals that they need.
function ticks(min, max, count) {
  const raw = (max - min) / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999999);
  const at = [];
  for (let i = Math.ceil(min / step - 1e-9); i * step <= max + 1e-9 * step; i++) at.push(i * step);
  return { at, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function minus(text) { return text.replace('-', '−'); }

/// Smallest and largest of several series, a little wider, and never of no width.
function range(series, zero) {
  let min = zero ? 0 : Infinity, max = zero ? 0 : -Infinity;
  for (const { values, mask } of series) {
    for (let i = 0; i < values.length; i++) {
      if (mask && !mask[i]) continue;
      if (values[i] < min) min = values[i];
      if (values[i] > max) max = values[i];
    }
  }
  if (min > max) { min = 0; max = 1; }
  if (max - min < 1e-12 * Math.max(1, Math.abs(max))) { max += Math.abs(max) || 1; min -= zero ? 0 : Math.abs(min); }
  const margin = 0.06 * (max - min);
  return [min === 0 ? 0 : min - margin, max === 0 ? 0 : max + margin];
}

/// Index of the entry nearest to `time` in an ascending array.
function nearest(times, time) {
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] < time) low = middle; else high = middle;
  }
  return Math.abs(times[high] - time) < Math.abs(times[low] - time) ? high : low;
}

/// The moment that every chart marks, in s, and who wants to know of it.
const moment = {
  time: 0,
  listeners: [],
  set(time, source) {
    this.time = time;
    for (const listener of this.listeners) listener(time, source);
  },
};

/// A chart in `place`: { x, times, label, panels: [{ title, height, zero, series, limits, fans }], bands, marks, read }.
/// `x` is what is drawn over, `times` the time of each entry; they are the same array in a chart over time.
class Chart {
  constructor(place, options) {
    this.place = place;
    this.options = options;
    this.readout = place.querySelector('.readout');
    this.holder = place.querySelector('.chart');
    this.index = 0;
    moment.listeners.push((time) => this.point(nearest(this.options.times, time)));
    this.draw();
    // In the next frame: drawing changes heights, which the observer would see as a loop.
    new ResizeObserver(() => requestAnimationFrame(() => this.draw())).observe(this.holder);
  }

  draw() {
    const width = Math.round(this.holder.clientWidth);
    if (!width || width === this.width) return;
    this.width = width;
    const { panels, label } = this.options;
    for (const panel of panels) this.scale(panel);
    const longest = Math.max(...panels.flatMap((panel) => panel.labels.map((text) => text.length)));
    this.left = Math.max(40, 14 + 7.4 * longest);
    this.right = width - 12;
    const gap = 34;
    const ribbon = (this.options.bands || []).length ? RIBBON : 0;
    let y = 22 + ribbon;
    for (const panel of panels) { panel.top = y; y += panel.height; panel.bottom = y; y += gap; }
    const height = y - gap + 42;
    this.svg = node('svg', { viewBox: `0 0 ${width} ${height}`, height, tabindex: 0, role: 'img', 'aria-label': label.about });
    this.drawGround();
    for (const panel of panels) this.drawPanel(panel);
    this.drawMarks();
    const bottom = panels[panels.length - 1].bottom;
    this.svg.append(node('text', { x: (this.left + this.right) / 2, y: bottom + 36, 'text-anchor': 'middle' }, label.x));
    this.drawCursor();
    this.listen();
    const focused = this.holder.contains(document.activeElement);
    this.holder.replaceChildren(this.svg);
    if (focused) this.svg.focus({ preventScroll: true });
    this.point(this.index);
  }

  /// Takes other data and marks its last moment.
  renew(options) {
    this.options = options;
    this.width = 0;
    this.index = options.times.length - 1;
    this.draw();
  }

  /// Horizontal scale with its ticks, and the phases as tints with their names in a ribbon over the first panel.
  drawGround() {
    const { x, bands = [], ground = [], panels } = this.options;
    this.x = range([{ values: x }], false);
    if (x === this.options.times) this.x = [x[0], Math.max(x[x.length - 1], x[0] + 1e-9)];
    const [top, bottom] = [panels[0].top, panels[panels.length - 1].bottom];
    for (const band of bands) {
      const [a, b] = [Math.max(this.left, this.px(band.from)), Math.min(this.right, this.px(band.to))];
      if (b <= a) continue;
      const tint = (y, height) => this.svg.append(node('rect', { x: a, y, width: b - a, height, fill: `var(--${band.word})` }));
      for (const panel of panels) tint(panel.top, panel.height);
      tint(top - RIBBON, RIBBON);
      if (b - a > 6.5 * band.word.length + 6) this.svg.append(node('text', { x: a + 4, y: top - 5 }, band.word));
    }
    for (const part of ground) this.drawGroundPart(part);
    const { at, decimals } = ticks(this.x[0], this.x[1], Math.max(3, (this.right - this.left) / 75));
    for (const value of at) {
      const place = this.px(value);
      for (const panel of panels) this.vertical(place, panel, 'rule');
      this.svg.append(node('text', { x: place, y: bottom + 17, 'text-anchor': 'middle' }, minus(value.toFixed(decimals))));
    }
  }

  /// What lies at a stretch of depths: a tint behind the curves, and a named strip along the lower edge.
  drawGroundPart(part) {
    const [a, b] = [Math.max(this.left, this.px(part.from)), Math.min(this.right, this.px(part.to))];
    if (b <= a) return;
    for (const panel of this.options.panels) {
      this.svg.append(node('rect', { x: a, y: panel.top, width: b - a, height: panel.height, fill: part.colour, opacity: 0.14 }));
      this.svg.append(node('rect', { x: a, y: panel.bottom - RIBBON, width: b - a, height: RIBBON, fill: part.colour, opacity: 0.45 }));
      if (b - a > 6.5 * part.name.length + 6) this.svg.append(node('text', { x: (a + b) / 2, y: panel.bottom - 5, 'text-anchor': 'middle' }, part.name));
    }
  }

  /// Vertical line through one panel.
  vertical(x, panel, cls) {
    const line = node('line', { class: cls, x1: x, x2: x, y1: panel.top, y2: panel.bottom });
    this.svg.append(line);
    return line;
  }

  /// Labelled moments or depths, the label on the side that has room, one below the other where they would meet.
  drawMarks() {
    const { marks = [], panels } = this.options;
    const taken = [];
    for (const mark of marks) {
      const place = this.px(mark.x);
      for (const panel of panels) this.vertical(place, panel, 'mark');
      const flip = place + 8 * mark.text.length > this.right;
      const [from, to] = flip ? [place - 8 * mark.text.length, place] : [place, place + 8 * mark.text.length];
      let row = 0;
      while (!mark.low && taken.some((t) => t.row === row && t.from < to && from < t.to)) row++;
      if (!mark.low) taken.push({ row, from, to });
      const y = mark.low ? panels[0].bottom - 8 : panels[0].top + 15 + 15 * row;
      this.svg.append(node('text', { class: 'over', x: place + (flip ? -5 : 5), y, 'text-anchor': flip ? 'end' : 'start' }, mark.text));
    }
  }

  /// Vertical range of a panel, its ticks and their labels.
  scale(panel) {
    const fans = (panel.fans || []).flatMap(({ low, high, mask }) => [{ values: low, mask }, { values: high, mask }]);
    panel.y = range([...panel.series, { values: panel.limits || [] }, ...fans], panel.zero);
    const { at, decimals } = ticks(panel.y[0], panel.y[1], panel.height / 34);
    panel.at = at;
    panel.labels = at.map((value) => minus(value.toFixed(decimals)));
  }

  drawPanel(panel) {
    panel.at.forEach((value, i) => {
      const y = this.py(panel, value);
      const cls = Math.abs(value) < 1e-12 ? 'zero' : 'rule';
      this.svg.append(node('line', { class: cls, x1: this.left, x2: this.right, y1: y, y2: y }));
      this.svg.append(node('text', { x: this.left - 6, y: y + 4, 'text-anchor': 'end' }, panel.labels[i]));
    });
    const title = panel.top - 9 - (panel === this.options.panels[0] && this.options.bands?.length ? RIBBON : 0);
    this.svg.append(node('text', { class: 'title', x: 0, y: title }, panel.title));
    for (const limit of panel.limits || []) {
      const y = this.py(panel, limit);
      this.svg.append(node('line', { class: 'limit', x1: this.left, x2: this.right, y1: y, y2: y }));
    }
    for (const fan of panel.fans || []) this.svg.append(node('path', { class: 'fan', d: this.area(panel, fan) }));
    for (const series of panel.series) this.svg.append(node('path', { class: `line ${series.cls}`, style: series.style || '', d: this.path(panel, series) }));
  }

  /// A line through the entries that are there; a short gap is bridged, a long one (2% of the time) breaks it.
  path(panel, { values, mask, from = 0, to = values.length }) {
    const { x, times } = this.options;
    const long = 0.02 * (times[times.length - 1] - times[0]);
    let d = '', last = -Infinity, lacking = false;
    for (let i = from; i < to; i++) {
      if (mask && !mask[i]) { lacking = true; continue; }
      const bridged = !lacking || times[i] - last <= long;
      d += `${d && bridged ? 'L' : 'M'}${this.px(x[i]).toFixed(1)} ${this.py(panel, values[i]).toFixed(1)}`;
      last = times[i];
      lacking = false;
    }
    return d;
  }

  /// What lies between two series.
  area(panel, { low, high, mask, from = 0, to = low.length }) {
    const kept = [];
    for (let i = from; i < to; i++) if (mask[i]) kept.push(i);
    const place = (i, values) => `${this.px(this.options.x[i]).toFixed(1)} ${this.py(panel, values[i]).toFixed(1)}`;
    const ends = [...kept.map((i) => place(i, low)), ...kept.reverse().map((i) => place(i, high))];
    return ends.length ? `M${ends.join('L')}Z` : '';
  }

  drawCursor() {
    this.lines = this.options.panels.map((panel) => this.vertical(0, panel, 'cursor'));
    this.dots = [];
    for (const panel of this.options.panels) {
      for (const series of panel.series) {
        if (series.back) continue;
        const dot = node('circle', { class: 'dot', r: 4, style: `fill:${series.colour}` });
        this.svg.append(dot);
        this.dots.push({ dot, panel, series });
      }
    }
  }

  listen() {
    const show = (event, click) => {
      const box = this.svg.getBoundingClientRect();
      const i = this.find(event.clientX - box.left, event.clientY - box.top);
      moment.set(this.options.times[i], click ? 'click' : 'hover');
    };
    this.svg.addEventListener('pointermove', (event) => show(event, false));
    this.svg.addEventListener('pointerdown', (event) => show(event, true));
    this.svg.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!step) return;
      event.preventDefault();
      const n = this.options.times.length;
      const i = Math.min(n - 1, Math.max(0, this.index + step * Math.max(1, Math.round(n / 200))));
      moment.set(this.options.times[i], 'click');
    });
  }

  /// Entry under the pointer: by time where that is the horizontal axis, else the nearest point of any curve.
  find(x, y) {
    const value = this.x[0] + (x - this.left) / (this.right - this.left) * (this.x[1] - this.x[0]);
    if (this.options.x === this.options.times) return nearest(this.options.times, value);
    let best = 0, least = Infinity;
    for (const panel of this.options.panels) {
      for (const { values, mask, back } of panel.series) {
        if (back) continue;
        for (let i = 0; i < values.length; i++) {
          if (mask && !mask[i]) continue;
          const d = (this.px(this.options.x[i]) - x) ** 2 + (this.py(panel, values[i]) - y) ** 2;
          if (d < least) { least = d; best = i; }
        }
      }
    }
    return best;
  }

  point(i) {
    this.index = i;
    if (!this.svg) return;
    const place = this.px(this.options.x[i]);
    for (const line of this.lines) { line.setAttribute('x1', place); line.setAttribute('x2', place); }
    for (const { dot, panel, series } of this.dots) {
      const shown = !series.mask || series.mask[i];
      dot.style.display = shown ? '' : 'none';
      if (shown) { dot.setAttribute('cx', place); dot.setAttribute('cy', this.py(panel, series.values[i])); }
    }
    if (this.readout) this.readout.innerHTML = this.options.read(i);
  }

  px(value) { return this.left + (value - this.x[0]) / (this.x[1] - this.x[0]) * (this.right - this.left); }
  py(panel, value) { return panel.bottom - (value - panel.y[0]) / (panel.y[1] - panel.y[0]) * (panel.bottom - panel.top); }
}
