// Unpacks the run and sets up charts and view.

const ARRAYS = { f32: Float32Array, i16: Int16Array, u16: Uint16Array, u32: Uint32Array, u8: Uint8Array };

/// Replaces { type, base64 } by the typed array that it stands for, at any depth.
function unpack(value) {
  if (!value || typeof value !== 'object') return value;
  if (typeof value.base64 === 'string') {
    const bytes = Uint8Array.from(atob(value.base64), (c) => c.charCodeAt(0));
    return new ARRAYS[value.type](bytes.buffer);
  }
  for (const key in value) value[key] = unpack(value[key]);
  return value;
}

const run = unpack(JSON.parse(document.getElementById('run').textContent));
const rows = run.rows, n = rows.time.length;
const scaled = (values, by) => values && values.map((v) => v * by);
const depth = scaled(rows.depth, 1e3);
const predicted = scaled(rows.predicted, run.force.factor);
const measured = scaled(rows.measured, run.force.factor);
const residual = measured && predicted.map((p, i) => p - measured[i]);
const mask = rows.has_measured;

const band = { ...run.band, low: scaled(run.band.low, run.force.factor), high: scaled(run.band.high, run.force.factor) };

function phaseAt(time) {
  // The last that has begun: times come in 32 bits, so the end of the last band says little.
  return run.phases.findLast((p) => time >= p.from)?.word ?? run.phases[0]?.word ?? '';
}

function readForce(i) {
  const unit = run.force.unit;
  const parts = [`<b>${rows.time[i].toFixed(2)}</b> s`, `depth <b>${minus(depth[i].toFixed(2))}</b> mm`, `predicted <b>${figures(predicted[i], 3)}</b> ${unit}`];
  if (measured && (!mask || mask[i])) {
    parts.push(`measured <b>${figures(measured[i], 3)}</b> ${unit}`, `residual <b>${figures(residual[i], 3)}</b> ${unit}`);
  }
  if (band.mask[i]) parts.push(`${band.name}: <b>${figures(band.low[i], 3)}</b> to <b>${figures(band.high[i], 3)}</b>`);
  const region = run.depth_regions.find((r) => rows.depth[i] > r.from && rows.depth[i] <= 1.000001 * r.to);
  return spans([...parts, phaseAt(rows.time[i]), ...(region ? [`in <b>${escaped(region.name)}</b>`] : [])]);
}

/// A series in its ways in and out: a way out is paler, and what follows the first insertion has a colour of its own.
function byWays(values, cls, colour) {
  return run.passes.map(({ from, to, back, number }) => ({
    values, mask, from, to, colour: number ? `var(--${cls === 'predicted' ? '' : `${cls}-`}again)` : colour,
    cls: `${cls}${number ? ' again' : ''}${back ? ' back' : ''}`, back: back || number > 0,
  }));
}

function forceSeries(split) {
  const line = (values, cls, colour) => (split ? byWays(values, cls, colour) : [{ values, mask, cls, colour }]);
  const series = line(predicted, 'predicted', 'var(--accent)').map((s) => ({ ...s, mask: undefined }));
  return measured ? [...line(measured, 'measured', 'var(--measured)'), ...series] : series;
}

/// The band about the force, in each of its ways where `split`.
function fans(split) {
  return split ? run.passes.map(({ from, to }) => ({ ...band, from, to })) : [band];
}

function charts() {
  const unit = run.force.unit;
  const slow = rows.latency.some((ms) => ms > 5000), perMs = slow ? 1e-3 : 1;
  const latency = scaled(rows.latency, perMs);
  const force = (split, height) => ({ title: `Force against insertion in ${unit}`, height, zero: true, series: forceSeries(split), fans: fans(split) });
  const error = (split) => ({
    title: `Predicted − measured in ${unit}`, height: 90, zero: true,
    series: split ? byWays(residual, 'residual', 'var(--residual)') : [{ values: residual, mask, cls: 'residual', colour: 'var(--residual)' }],
  });
  const bands = run.phases;
  const overTime = { x: rows.time, times: rows.time, bands, marks: run.events.map((e) => ({ x: e.time, text: e.word })) };
  new Chart(document.getElementById('force-depth'), {
    x: depth, times: rows.time, read: readForce,
    label: { x: 'Depth of the tip in mm', about: 'Predicted and measured force over depth' },
    panels: measured ? [force(true, 300), error(true)] : [force(true, 400)],
    ground: run.depth_regions.map((b) => ({ ...b, from: 1e3 * b.from, to: 1e3 * b.to })),
    bands: run.depth_phases.map((b) => ({ ...b, from: 1e3 * b.from, to: 1e3 * b.to })),
    marks: [
      ...run.events.map((e) => ({ x: 1e3 * e.depth, text: e.word })),
      ...(run.hold ? [{ x: 1e3 * run.hold.depth, text: `held for ${figures(run.hold.duration, 2)} s`, low: true }] : []),
    ],
  });
  new Chart(document.getElementById('force-time'), {
    ...overTime, read: readForce, label: { x: 'Time in s', about: 'Force, residual and depth over time' },
    panels: [force(false, 210), ...(measured ? [error(false)] : []),
      { title: 'Depth of the tip in mm', height: 80, zero: true, series: [{ values: depth, cls: 'plain', colour: 'var(--accent)' }] }],
  });
  new Chart(document.getElementById('cost'), {
    ...overTime, label: { x: 'Time in s', about: 'Explicit steps and latency of each pose over time' },
    read: (i) => `<b>${rows.time[i].toFixed(2)}</b> s · <b>${rows.steps[i]}</b> steps · answered after <b>${figures(latency[i], 3)}</b> ${slow ? 's' : 'ms'}`,
    panels: [
      { title: 'Explicit steps per pose', height: 100, zero: true, series: [{ values: rows.steps, cls: 'plain', colour: 'var(--accent)' }] },
      { title: `Latency in ${slow ? 's' : 'ms'}`, height: 100, zero: true, limits: run.period_ms === null ? [] : [run.period_ms * perMs], series: [{ values: latency, cls: 'measured', colour: 'var(--measured)' }] },
    ],
  });
  if (run.targets) targets(bands);
}

function targets(bands) {
  const { names, time, positions } = run.targets;
  const colour = (k) => `var(--t${k % 6})`;
  // lines differ by more than colour
  const dash = (k) => ['none', '8 4', '2 4', '10 3 2 3', '5 2', '1 3'][k % 6];
  const moved = names.map((_, k) => Float32Array.from(time, (_, i) => {
    const at = 3 * (i * names.length + k);
    return 1e3 * Math.hypot(...[0, 1, 2].map((c) => positions[at + c] - positions[3 * k + c]));
  }));
  new Chart(document.getElementById('targets'), {
    x: time, times: time, bands, label: { x: 'Time in s', about: 'Distance of each target from its place at the start' },
    read: (i) => spans([`<b>${time[i].toFixed(2)}</b> s`, ...names.map((_, k) => `<b style="color:${colour(k)}">${figures(moved[k][i], 3)}</b> mm`)]),
    panels: [{
      title: 'Moved from the start by, in mm', height: 160, zero: true,
      series: moved.map((values, k) => ({ values, cls: '', style: `stroke:${colour(k)};stroke-width:2;stroke-dasharray:${dash(k)}`, colour: colour(k) })),
    }],
  });
}

if (n) charts();
const view = run.view && new View(document.getElementById('sample'), run.view, figures);
if (n) {
  let peak = 0;
  for (let i = 0; i < n; i++) if (Math.abs(predicted[i]) > Math.abs(predicted[peak])) peak = i;
  moment.set(rows.time[peak], 'start');
}
document.documentElement.dataset.ready = 'yes';
