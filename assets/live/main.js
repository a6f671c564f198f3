// Takes what the node says and shows it. One frame is asked for at a time, after the last one was drawn, so a slow page gets fewer.

const byId = (id) => document.getElementById(id);
const show = (name, text) => {
  const element = document.querySelector(`[data-show=${name}]`);
  if (element.textContent !== text) element.textContent = text;
};
/// Whoever opened the address that the node has printed may command.
const token = new URLSearchParams(location.hash.slice(1)).get('token');
const calm = matchMedia('(prefers-reduced-motion: reduce)');
/// Between two drawings of the curves, ms, and of the sample where motion is to be reduced.
const CURVES_MS = 200, CALM_MS = 1000;

const state = { curves: new Curves(), charts: [], sample: null, model: null, frozen: false, drawn: 0, socket: null };

/// Words (u32) at the head of a binary message, see src/live/frame.rs.
function decode(buffer) {
  const head = new Uint32Array(buffer, 0, 1)[0];
  return head === 1 ? decodeModel(buffer) : decodeFrame(buffer, state.model?.about.targets.length || 0);
}

function decodeModel(buffer) {
  const [, text, points, surface, cells] = new Uint32Array(buffer, 0, 5);
  const about = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, text)));
  let at = 20 + text;
  const next = (Type, n) => { const part = new Type(buffer, at, n); at += 4 * n; return part; };
  const mesh = { points: next(Float32Array, 3 * points), surface: next(Uint32Array, 3 * surface), cells: next(Uint32Array, 4 * cells) };
  return { about, ...mesh, region_of_cell: new Uint8Array(buffer, at) };
}

function decodeFrame(buffer, n) {
  const f = new Float32Array(buffer, 4, 7 + 3 * n);
  const targets = Array.from({ length: n }, (_, k) => [...f.slice(7 + 3 * k, 10 + 3 * k)]);
  return { depth: f[0], tip: [...f.slice(1, 4)], axis: [...f.slice(4, 7)], targets, displacement: new Int16Array(buffer, 32 + 12 * n) };
}

function binary(buffer) {
  const message = decode(buffer);
  if (message.about) return takeModel(message);
  state.frame = message;
  drawSample();
}

/// Draws the newest frame, unless the picture stands still, and seldom where motion is to be reduced.
function drawSample() {
  if (!state.sample || !state.frame || state.frozen) return;
  const wait = calm.matches ? CALM_MS - (performance.now() - (state.drawnSample ?? -Infinity)) : 0;
  clearTimeout(state.laterSample);
  if (wait > 0) {
    state.laterSample = setTimeout(drawSample, wait);
    return;
  }
  state.drawnSample = performance.now();
  state.sample.frame_in(state.frame);
  showTargets(state.frame.targets);
  state.frame = null;
}

function takeModel(model) {
  // It comes again with each connection. Another one is another node's: the page starts anew.
  if (state.model && state.model.about.model_id !== model.about.model_id) location.reload();
  if (state.model) return;
  state.model = model;
  const place = byId('sample');
  place.hidden = !model.surface.length;
  state.sample = place.hidden ? null : new LiveSample(place, model);
  byId('targets').hidden = !model.about.targets.length;
  byId('targets').querySelector('tbody').replaceChildren(...model.about.targets.map((name) => {
    const row = document.createElement('tr');
    for (const text of [name, '', '']) row.append(Object.assign(document.createElement('td'), { textContent: text }));
    [...row.children].slice(1).forEach((cell, k) => { cell.className = 'number'; cell.dataset.name = ['moved by', 'x, y, z in mm'][k]; });
    return row;
  }));
  showTargets(model.about.target_references_m);
  show('scene', `${model.about.scene.replaceAll('_', ' ')}, live`);
  document.title = `${model.about.scene}, live`;
}

function showTargets(places) {
  byId('targets').querySelectorAll('tbody tr').forEach((row, k) => {
    const from = state.model.about.target_references_m[k], to = places[k];
    row.children[1].textContent = `${figures(1e3 * Math.hypot(...to.map((x, c) => x - from[c])), 3)} mm`;
    row.children[2].textContent = to.map((x) => minus((1e3 * x).toFixed(2))).join(', ');
  });
}

const PHASES = ['approach', 'indentation', 'penetration', 'retraction'];
const HEALTH = [['good', 'The prediction is valid'], ['warn', 'Valid, with a warning'], ['bad', 'Not valid'], ['warn', 'No valid prediction at present']];

function showHealth(level, words, reasons) {
  const box = byId('health');
  box.className = `verdict ${level}`;
  box.querySelector('strong').textContent = words;
  const list = reasons.map((reason) => Object.assign(document.createElement('li'), { textContent: reason }));
  box.querySelector('ul').replaceChildren(...list);
}

function takeStatus(s) {
  const [level, words] = HEALTH[s.health] || HEALTH[2];
  const key = JSON.stringify([s.health, s.reasons]);
  // A list that is written again is read out again.
  if (key !== state.health) showHealth(level, words, s.reasons);
  state.health = key;
  show('phase', s.poses_answered ? PHASES[s.phase] : '–');
  show('region', s.region ? `in ${s.region}` : 'outside the sample');
  show('pace', s.real_time_factor > 0 ? `${figures(s.real_time_factor, 3)}×` : '–');
  show('steps', `${figures(s.steps_per_pose, 3)} steps per pose, ${figures(s.pose_rate_hz, 3)} poses per second`);
  show('latency', s.poses_answered ? `${figures(1e3 * s.latency_p50_s, 2)} ms` : '–');
  show('latency99', s.poses_answered ? `99 % within ${figures(1e3 * s.latency_p99_s, 2)} ms; ${s.poses_coalesced} skipped` : 'from pose to force');
  show('recorded', s.recorded ? 'This run is being recorded.' : 'The node itself records nothing (-p record:=FOLDER would).');
  state.curves.band = s.residual_band_n;
}

/// Three figures, but no more than two decimals: a hundredth of a millinewton is below what a load cell reads.
function newtons(value) {
  const rounded = Math.abs(value) < 0.005 ? 0 : Math.round(100 * value) / 100;
  return figures(rounded, 3);
}

function takeFigures(f) {
  state.figures = f;
  if (state.frozen) return;
  if (state.curves.take(f)) state.sample?.restart();
  const p = f.point;
  if (p) {
    const [unit, factor] = Math.abs(p.predicted_n) < 1 ? ['mN', 1e3] : ['N', 1];
    show('force', `${newtons(factor * p.predicted_n)} ${unit}`);
    show('measured', p.measured_n === null ? 'no load cell heard' : `measured ${newtons(factor * p.measured_n)}, residual ${newtons(factor * (p.predicted_n - p.measured_n))} ${unit}`);
    show('spring', f.spring ? `so far ${f.spring}` : '');
    show('depth', `${minus((1e3 * p.depth_m).toFixed(2))} mm`);
    show('time', `at ${p.time_s.toFixed(1)} s of this run`);
  }
  const said = f.events.map((e) => `${e.time_s.toFixed(2)} s, ${minus((1e3 * e.depth_m).toFixed(2))} mm: ${e.kind}${e.text ? ` ${e.kind === 'mark' ? '' : 'into '}${e.text}` : ''}`);
  if (said.join() !== state.said) {
    state.said = said.join();
    byId('events').replaceChildren(...said.reverse().map((text) => Object.assign(document.createElement('li'), { textContent: text })));
  }
  byId('none').hidden = said.length > 0;
}

function drawCurves() {
  const now = performance.now(), rows = state.curves.rows.length;
  if (state.frozen || rows < 2 || state.curves.rows.at(-1) === state.newest) return;
  if (now - state.drawn < CURVES_MS) {
    // The last of a run is drawn too, though nothing comes after it.
    clearTimeout(state.later);
    state.later = setTimeout(drawCurves, CURVES_MS);
    return;
  }
  [state.drawn, state.newest] = [now, state.curves.rows.at(-1)];
  const options = state.curves.options();
  if (!state.charts.length) {
    byId('waiting').hidden = true;
    state.charts = ['force-depth', 'force-time'].map((id, i) => {
      byId(id).hidden = false;
      return new Chart(byId(id), options[i]);
    });
  }
  state.charts.forEach((chart, i) => chart.renew(options[i]));
  byId('measured').hidden = options[0].panels.length < 2;
  byId('band').hidden = !options[0].panels[0].fans.length;
  byId('band').lastChild.data = state.curves.bandName ?? '';
}

function takeReply(reply) {
  show('reply', `${reply.done ? 'Done' : 'Not done'}: ${reply.message}`);
}

const TAKE = { status: takeStatus, figures: takeFigures, reply: takeReply };

/// Says that the page is ready for more, once what came is drawn; a page that nobody sees asks once a second.
function ask() {
  if (state.asking) return;
  state.asking = true;
  const next = () => {
    state.asking = false;
    clearTimeout(timer);
    cancelAnimationFrame(frame);
    if (state.socket?.readyState === WebSocket.OPEN) state.socket.send('{"ask":"next"}');
  };
  const frame = requestAnimationFrame(next), timer = setTimeout(next, 1000);
}

function connect() {
  const socket = new WebSocket(`ws://${location.host}/stream`);
  socket.binaryType = 'arraybuffer';
  state.socket = socket;
  socket.onopen = () => { state.ended = false; show('connection', 'connected'); document.body.classList.remove('lost'); ask(); };
  socket.onmessage = ({ data }) => {
    if (typeof data === 'string') {
      const message = JSON.parse(data);
      TAKE[message.kind]?.(message);
      if (message.kind === 'reply') return;
    } else binary(data);
    drawCurves();
    ask();
  };
  socket.onclose = ({ code }) => {
    // 1001: the server goes away, and says so. What is tried again after that fails without a word.
    state.ended ||= code === 1001;
    document.body.classList.add('lost');
    show('connection', 'not connected');
    const why = state.ended ? 'The twin has ended' : 'The node is not reached, or as many look as it has seats';
    showHealth('bad', `${why}: what stands here is the last that was heard`, []);
    state.health = '';
    setTimeout(connect, 1000);
  };
}

function commands() {
  const may = Boolean(token);
  byId('commands').hidden = !may;
  byId('readonly').hidden = may;
  const send = (request) => {
    if (state.socket?.readyState !== WebSocket.OPEN) return show('reply', 'Not done: not connected');
    state.socket.send(JSON.stringify({ ...request, token }));
  };
  byId('tare').onclick = () => send({ ask: 'tare' });
  byId('reset').onclick = () => send({ ask: 'reset' });
  byId('mark').onsubmit = (event) => {
    event.preventDefault();
    send({ ask: 'mark', text: byId('text').value });
    byId('text').value = '';
  };
  byId('freeze').onclick = (event) => {
    state.frozen = !state.frozen;
    event.target.setAttribute('aria-pressed', state.frozen);
    if (!state.frozen && state.figures) takeFigures(state.figures);
    drawSample();
    drawCurves();
    show('frozen', state.frozen ? 'Picture and curves stand still; the twin goes on.' : '');
  };
}

commands();
connect();
