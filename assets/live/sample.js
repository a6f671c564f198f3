// The sample as it is now: the report's view, with frames that come in and a plane of cut that can be moved.

/// Axis across which the plane lies, and the sign of the side that is kept.
const PLANES = { front: [1, 1], side: [0, 1], level: [2, -1] };
/// Ends of the colour scale, mm: a scale that followed each frame would make colours mean nothing.
const STEPS_MM = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500];

/// Region of each triangle of the surface: that of the cell that it is a face of.
function regionOfSurface({ surface, cells, region_of_cell }) {
  const key = (i, j, k) => [i, j, k].sort((a, b) => a - b).join();
  const place = new Map();
  for (let k = 0; k < surface.length; k += 3) place.set(key(surface[k], surface[k + 1], surface[k + 2]), k / 3);
  const found = new Uint8Array(surface.length / 3);
  for (let c = 0; c < cells.length; c += 4) {
    const [i, j, k, l] = cells.subarray(c, c + 4);
    for (const face of [[i, j, k], [i, j, l], [i, k, l], [j, k, l]]) {
      const at = place.get(key(...face));
      if (at !== undefined) found[at] = region_of_cell[c / 4];
    }
  }
  return found;
}

class LiveSample extends View {
  /// `model` as decode.js gives it.
  constructor(place, model) {
    const none = { half: new Uint32Array(), cut: new Uint32Array(), edge_a: [], edge_b: [], edge_t: [] };
    const { points, about } = model;
    super(place, {
      ...model, ...none, time: [0], depth: [0], instrument: about.instrument,
      displacement: new Int16Array(points.length), displacement_unit: about.unit_m, displacement_max: 1e-3 * STEPS_MM[0],
      regions: about.regions, region: { surface: about.regions ? regionOfSurface(model) : [], half: [], cut: [] },
    }, figures);
  }

  controls() {
    const one = (name) => this.place.querySelector(`[data-control=${name}]`);
    const field = one('field');
    field.hidden = !this.data.regions;
    field.onchange = () => { this.field = field.value; this.legendFor = null; this.renew(); };
    this.plane = one('plane');
    this.slider = one('at');
    this.plane.onchange = () => { this.slider.value = 50; this.cut(); };
    this.slider.oninput = () => this.cut();
    one('mesh').onclick = (event) => {
      this.mesh = !this.mesh;
      event.target.setAttribute('aria-pressed', this.mesh);
      this.paint();
    };
    one('in').onclick = () => this.magnify(1.25);
    one('out').onclick = () => this.magnify(0.8);
    one('home').onclick = () => { this.home(); this.paint(); };
    this.pointers();
    this.tip = [this.data.instrument?.x || 0, this.data.instrument?.y || 0, this.high[2]];
    this.axis = [0, 0, -1];
    this.targets = this.data.about.target_references_m;
  }

  show() { this.cut(); }

  /// Cuts where the controls say; the middle of the slider is the instrument's axis.
  cut() {
    const d = this.data, [axis, sign] = PLANES[this.plane.value] || [];
    this.mode = axis === undefined ? 'whole' : 'half';
    this.slider.disabled = this.mode === 'whole';
    const part = this.slider.value / 50 - 1;
    if (this.mode === 'half') {
      const entry = [d.instrument?.x || 0, d.instrument?.y || 0, this.centre[2]][axis];
      this.at = entry + part * (part < 0 ? entry - this.low[axis] : this.high[axis] - entry) * 0.999;
      const { of, ...mesh } = cutMesh(d, axis, sign, this.at);
      Object.assign(d, mesh);
      if (d.regions) Object.assign(d.region, { half: of.half.map((k) => d.region.surface[k]), cut: of.cut.map((k) => d.region_of_cell[k]) });
      this.slider.setAttribute('aria-valuetext', `${'xyz'[axis]} ${minus((1e3 * this.at).toFixed(1))} mm`);
    }
    this.place.querySelector('[data-show=at]').textContent = this.mode === 'half' ? `${'xyz'[axis]} = ${minus((1e3 * this.at).toFixed(1))} mm` : '';
    this.count = this.nodes + d.edge_t.length;
    this.positions = new Float32Array(3 * this.count);
    this.values = new Float32Array(this.count);
    this.screen = new Float32Array(3 * this.count);
    this.renew();
  }

  /// Takes a frame.
  frame_in({ depth, tip, axis, targets, displacement }) {
    if (displacement.length !== this.data.points.length) return;
    Object.assign(this, { tip, axis, targets });
    this.data.displacement = displacement;
    this.data.depth[0] = depth;
    this.renew(true);
    // Finer once it stands still.
    clearTimeout(this.still);
    this.still = setTimeout(() => this.paint(), 400);
  }

  renew(moving) {
    let [low, high] = this.take();
    const most = this.most();
    if (1e3 * most > 1.001e3 * high) {
      this.data.displacement_max = 1e-3 * (STEPS_MM.find((mm) => mm >= 1e3 * most) || 1e3 * most);
      [low, high] = this.take();
    }
    if (high !== this.legendFor) this.legend(low, high);
    this.legendFor = high;
    this.paint(moving);
  }

  /// Largest displacement of the frame, m.
  most() {
    const u = this.data.displacement;
    let square = 0;
    for (let i = 0; i < u.length; i += 3) square = Math.max(square, u[i] * u[i] + u[i + 1] * u[i + 1] + u[i + 2] * u[i + 2]);
    return this.data.displacement_unit * Math.sqrt(square);
  }

  /// A run that starts again has a scale of its own.
  restart() { this.data.displacement_max = 1e-3 * STEPS_MM[0]; }

  /// Where the instrument is, turned to its axis; of one that is broad, the part that the cut leaves.
  instrument() {
    const tool = this.data.instrument;
    if (!tool) return;
    const local = shape({ ...tool, x: 0, y: 0 }, 0, false, Math.max(0, this.data.depth[0]));
    const p = placed(local.points, this.axis, this.tip);
    if (tool.kind === 'needle' || this.mode === 'whole') this.solid(p, local.triangles);
    else this.behind(p, local.triangles);
  }

  solid(points, triangles) {
    const screen = new Float32Array(points.length);
    this.project(points, screen);
    this.fill(triangles, screen, points, null, 0.6);
  }

  /// The part on the side of the cut that is kept.
  behind(points, surface) {
    const part = cutMesh({ points, surface, cells: [] }, ...PLANES[this.plane.value], this.at);
    const corner = (e, c) => (1 - part.edge_t[e]) * points[3 * part.edge_a[e] + c] + part.edge_t[e] * points[3 * part.edge_b[e] + c];
    const more = Array.from(part.edge_t, (_, e) => [corner(e, 0), corner(e, 1), corner(e, 2)]).flat();
    this.solid(Float32Array.from([...points, ...more]), part.half);
  }

  annotate(fine, tall) {
    super.annotate(fine, tall);
    if (!this.targets.length) return;
    const c = this.context, screen = new Float32Array(3 * this.targets.length);
    this.project(Float32Array.from(this.targets.flat()), screen);
    const style = getComputedStyle(this.place);
    c.font = `${12 * fine}px system-ui, sans-serif`;
    this.targets.forEach((_, k) => {
      const [x, y] = [screen[3 * k], screen[3 * k + 1]];
      c.beginPath();
      c.arc(x, y, 5 * fine, 0, 2 * Math.PI);
      c.lineWidth = 4 * fine;
      c.strokeStyle = style.getPropertyValue('--card');
      c.stroke();
      c.lineWidth = 2 * fine;
      c.strokeStyle = style.getPropertyValue(`--t${k % 6}`);
      c.stroke();
      c.lineWidth = 3 * fine;
      c.strokeStyle = style.getPropertyValue('--card');
      c.strokeText(this.data.about.targets[k], x + 9 * fine, y + 4 * fine);
      c.fillStyle = style.getPropertyValue('--ink');
      c.fillText(this.data.about.targets[k], x + 9 * fine, y + 4 * fine);
    });
  }
}
