// Curves that grow: points are kept, bounded in number, and drawn a few times a second.

/// Points that are kept; then every second of the older half goes.
const KEPT = 2400;
/// A gap in the band that is bridged, s.
const LONGEST_S = 1;

function thinned(rows) { return rows.filter((_, i) => i >= KEPT / 2 || i % 2 === 0); }

class Curves {
  constructor() { this.clear(undefined); }

  clear(run) {
    Object.assign(this, { run, events: [], band: 0 });
    this.rows = [];
    this.bands = [];
  }

  /// Takes figures of the node; whether a new run has begun.
  take(figures) {
    const fresh = figures.run !== this.run;
    if (fresh) this.clear(figures.run);
    this.events = figures.events;
    const point = figures.point, last = this.rows.at(-1);
    if (point && (!last || point.time_s > last.time_s)) {
      this.rows.push(point);
      if (this.rows.length > KEPT) this.rows = thinned(this.rows);
    }
    const band = figures.band;
    if (band && band.name !== this.bandName) Object.assign(this, { bands: [], bandName: band.name });
    const latest = this.bands.at(-1);
    if (band && (!latest || band.time_s > latest.time_s)) {
      this.bands.push(band);
      if (this.bands.length > KEPT) this.bands = thinned(this.bands);
    }
    return fresh;
  }

  /// The band at each point: members answer later than the twin, and not every pose.
  fan(factor) {
    const low = new Float64Array(this.rows.length), high = new Float64Array(this.rows.length), mask = [];
    let k = 0;
    this.rows.forEach(({ time_s: at }, i) => {
      while (k + 1 < this.bands.length && this.bands[k + 1].time_s < at) k++;
      const [a, b] = [this.bands[k], this.bands[k + 1]];
      mask[i] = Boolean(b) && a.time_s <= at && at <= b.time_s && b.time_s - a.time_s < LONGEST_S;
      if (!mask[i]) return;
      const t = (at - a.time_s) / (b.time_s - a.time_s);
      low[i] = factor * (a.low_n + t * (b.low_n - a.low_n));
      high[i] = factor * (a.high_n + t * (b.high_n - a.high_n));
    });
    return { low, high, mask };
  }

  column(f) { return Float64Array.from(this.rows, f); }

  /// Options of both charts, in mm and in mN or N.
  options() {
    const rows = this.rows, has = rows.map((r) => r.measured_n !== null), any = has.includes(true);
    const peak = rows.reduce((most, r) => Math.max(most, Math.abs(r.predicted_n), Math.abs(r.measured_n || 0)), 0);
    const [unit, factor] = peak < 1 ? ['mN', 1e3] : ['N', 1];
    const time = this.column((r) => r.time_s), depth = this.column((r) => 1e3 * r.depth_m);
    const predicted = this.column((r) => factor * r.predicted_n), measured = this.column((r) => factor * (r.measured_n || 0));
    const residual = this.column((r) => (r.measured_n === null ? 0 : factor * (r.predicted_n - r.measured_n)));
    const line = (values, cls, colour, mask) => ({ values, cls, colour: `var(--${colour})`, mask });
    const fan = this.bands.length > 1 && this.fan(factor);
    const force = (height) => ({
      title: `Force against insertion in ${unit}`, height, zero: true, fans: fan ? [fan] : [],
      series: [...(any ? [line(measured, 'measured', 'measured', has)] : []), line(predicted, 'predicted', 'accent')],
    });
    const band = factor * this.band;
    const error = { title: `Predicted − measured in ${unit}`, height: 80, zero: true, limits: band > 0 ? [-band, band] : [], series: [line(residual, 'residual', 'residual', has)] };
    const read = (i) => {
      const r = rows[i];
      if (!r) return '';
      const parts = [`<b>${r.time_s.toFixed(2)}</b> s`, `depth <b>${minus(depth[i].toFixed(2))}</b> mm`, `predicted <b>${figures(predicted[i], 3)}</b> ${unit}`];
      if (has[i]) parts.push(`measured <b>${figures(measured[i], 3)}</b> ${unit}`, `residual <b>${figures(residual[i], 3)}</b> ${unit}`);
      if (fan && fan.mask[i]) parts.push(`${this.bandName}: <b>${figures(fan.low[i], 3)}</b> to <b>${figures(fan.high[i], 3)}</b>`);
      return spans([...parts, escaped(r.phase), ...(r.region ? [`in <b>${escaped(r.region)}</b>`] : [])]);
    };
    const marks = (f) => this.events.map((e) => ({ x: f(e), text: e.kind === 'mark' ? e.text || 'mark' : e.kind }));
    return [
      {
        x: depth, times: time, read, marks: marks((e) => 1e3 * e.depth_m),
        label: { x: 'Depth of the tip in mm', about: 'Predicted and measured force over depth, so far' },
        panels: any ? [force(260), error] : [force(340)],
      },
      {
        x: time, times: time, read, bands: this.phases(), marks: marks((e) => e.time_s),
        label: { x: 'Time in s', about: 'Force, residual and depth over time, so far' },
        panels: [force(200), ...(any ? [error] : []), { title: 'Depth of the tip in mm', height: 70, zero: true, series: [line(depth, 'plain', 'accent')] }],
      },
    ];
  }

  phases() {
    const bands = [];
    for (const { time_s: at, phase: word } of this.rows) {
      const last = bands.at(-1);
      if (last) last.to = at;
      if (last?.word !== word) bands.push({ word, from: at, to: at });
    }
    return bands;
  }
}
