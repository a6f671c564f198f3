// The deformed sample in three dimensions: drawn by a small rasteriser of its own, so that it looks the same with and
// without a graphics card. Orthographic, z up.

class View {
  constructor(place, data, number) {
    this.place = place;
    this.data = data;
    this.number = number;
    this.canvas = place.querySelector('canvas');
    this.context = this.canvas.getContext('2d');
    this.nodes = data.points.length / 3;
    this.count = this.nodes + data.edge_t.length;
    this.positions = new Float32Array(3 * this.count);
    this.values = new Float32Array(this.count);
    this.screen = new Float32Array(3 * this.count);
    this.frame = 0;
    this.field = 'displacement';
    this.mode = 'half';
    this.mesh = false;
    this.outline = outline(data.points, data.surface);
    this.bounds();
    this.home();
    this.controls();
    this.show(0);
    new ResizeObserver(() => this.paint()).observe(this.canvas.parentElement);
  }

  bounds() {
    const p = this.data.points;
    this.low = [Infinity, Infinity, Infinity];
    this.high = [-Infinity, -Infinity, -Infinity];
    for (let i = 0; i < p.length; i++) {
      this.low[i % 3] = Math.min(this.low[i % 3], p[i]);
      this.high[i % 3] = Math.max(this.high[i % 3], p[i]);
    }
    this.centre = this.low.map((l, c) => (l + this.high[c]) / 2);
    this.radius = Math.hypot(...this.low.map((l, c) => this.high[c] - l)) / 2;
  }

  home() { this.yaw = 0.35 - (this.data.azimuth || 0); this.pitch = 0.42; this.zoom = 1; this.pan = [0, 0]; }

  controls() {
    const one = (name) => this.place.querySelector(`[data-control=${name}]`);
    this.slider = one('time');
    this.slider.max = this.data.time.length - 1;
    this.slider.addEventListener('input', () => moment.set(this.data.time[+this.slider.value], 'view'));
    moment.listeners.push((time, source) => { if (source !== 'hover') this.show(nearest(this.data.time, time)); });
    one('mode').addEventListener('change', (event) => { this.mode = event.target.value; this.paint(); });
    one('field').addEventListener('change', (event) => { this.field = event.target.value; this.show(this.frame); });
    one('mesh').addEventListener('click', (event) => {
      this.mesh = !this.mesh;
      event.target.setAttribute('aria-pressed', this.mesh);
      this.paint();
    });
    one('in').addEventListener('click', () => this.magnify(1.25));
    one('out').addEventListener('click', () => this.magnify(0.8));
    one('home').addEventListener('click', () => { this.home(); this.paint(); });
    one('play').addEventListener('click', (event) => this.play(event.target));
    this.pointers();
  }

  magnify(by) { this.zoom = Math.min(12, Math.max(0.4, this.zoom * by)); this.paint(); }

  play(button) {
    this.playing = !this.playing;
    button.textContent = this.playing ? 'Pause' : 'Play';
    const next = () => {
      if (!this.playing) return;
      moment.set(this.data.time[(this.frame + 1) % this.data.time.length], 'view');
      setTimeout(() => requestAnimationFrame(next), 90);
    };
    next();
  }

  /// One pointer turns, two zoom and shift; the wheel zooms once the picture has the focus.
  pointers() {
    const down = new Map();
    const place = (event) => [event.clientX, event.clientY];
    const spread = () => { const [a, b] = [...down.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    this.canvas.addEventListener('pointerdown', (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, place(event));
    });
    this.canvas.addEventListener('pointermove', (event) => {
      const before = down.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
      const wide = down.size === 2 ? spread() : 0;
      down.set(event.pointerId, place(event));
      if (down.size === 2) {
        this.zoom = Math.min(12, Math.max(0.4, this.zoom * spread() / Math.max(wide, 1)));
        this.pan = [this.pan[0] + dx / 2, this.pan[1] + dy / 2];
      } else if (event.shiftKey) {
        this.pan = [this.pan[0] + dx, this.pan[1] + dy];
      } else {
        this.yaw += 0.008 * dx;
        this.pitch = Math.min(1.57, Math.max(-1.57, this.pitch + 0.008 * dy));
      }
      this.paint(true);
    });
    const up = (event) => { down.delete(event.pointerId); this.paint(); };
    this.canvas.addEventListener('pointerup', up);
    this.canvas.addEventListener('pointercancel', up);
    this.canvas.addEventListener('wheel', (event) => {
      if (document.activeElement !== this.canvas && !event.ctrlKey) return;
      event.preventDefault();
      this.magnify(Math.exp(-0.0012 * event.deltaY));
    }, { passive: false });
    this.canvas.addEventListener('keydown', (event) => {
      const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (turn) {
        event.preventDefault();
        this.yaw += 0.1 * turn[0];
        this.pitch = Math.min(1.57, Math.max(-1.57, this.pitch + 0.1 * turn[1]));
        this.paint();
      } else if (event.key === '+' || event.key === '=') this.magnify(1.25);
      else if (event.key === '-') this.magnify(0.8);
    });
  }

  /// Shows a moment.
  show(frame) {
    this.frame = frame;
    const [low, high] = this.take();
    this.slider.value = frame;
    this.slider.setAttribute('aria-valuetext', `${this.data.time[frame].toFixed(2)} s`);
    this.place.querySelector('[data-show=moment]').textContent =
      `${this.data.time[frame].toFixed(2)} s, ${minus((1e3 * this.data.depth[frame]).toFixed(2))} mm`;
    this.legend(low, high);
    this.paint();
  }

  /// Takes the positions and colours of the present moment; what the ends of the colour scale stand for.
  take() {
    const { points, displacement, displacement_unit: unit, edge_a, edge_b, edge_t, jacobian } = this.data;
    const base = 3 * this.nodes * this.frame, p = this.positions, v = this.values;
    const ratio = this.field === 'jacobian' && jacobian;
    const other = this.data[this.field === 'strain' || this.field === 'stress' ? this.field : ''];
    const [low, high] = this.limits();
    for (let i = 0; i < this.nodes; i++) {
      let square = 0;
      for (let c = 0; c < 3; c++) {
        const u = unit * displacement[base + 3 * i + c];
        p[3 * i + c] = points[3 * i + c] + u;
        square += u * u;
      }
      v[i] = ratio ? this.data.jacobian_low + this.data.jacobian_unit * jacobian[this.nodes * this.frame + i]
        : other ? this.data[`${this.field}_unit`] * other[this.nodes * this.frame + i] : Math.sqrt(square);
    }
    for (let e = 0; e < edge_t.length; e++) {
      const [a, b, t, i] = [edge_a[e], edge_b[e], edge_t[e], this.nodes + e];
      for (let c = 0; c < 3; c++) p[3 * i + c] = p[3 * a + c] + t * (p[3 * b + c] - p[3 * a + c]);
      v[i] = v[a] + t * (v[b] - v[a]);
    }
    for (let i = 0; i < this.count; i++) v[i] = (v[i] - low) / (high - low);
    return [low, high];
  }

  /// What the ends of the colour scale stand for, over all moments.
  limits() {
    if (this.field === 'jacobian') return [1 - this.data.jacobian_span, 1 + this.data.jacobian_span];
    if (this.data[`${this.field}_max`]) return [0, this.data[`${this.field}_max`]];
    return [0, this.data.displacement_max || 1e-9];
  }

  legend(low, high) {
    const named = this.field === 'region';
    this.place.querySelector('.scale').hidden = named;
    const names = this.place.querySelector('[data-show=regions]');
    names.hidden = !named;
    if (named) {
      names.replaceChildren(...this.data.regions.map(({ name, colour }) => {
        const [item, mark] = [document.createElement('li'), document.createElement('i')];
        mark.className = 'band';
        mark.style.background = `rgb(${colour})`;
        item.append(mark, name);
        return item;
      }));
    }
    const stops = this.field === 'jacobian' ? DIVERGING : SEQUENTIAL;
    this.colours = table(stops);
    const ends = { strain: () => ['0', `≥ ${this.number(high, 3)}`], stress: () => ['0 Pa', `≥ ${this.number(high, 3)} Pa`] }[this.field];
    const [from, to] = ends ? ends() : this.field === 'jacobian' ? [`≤ ${this.number(low, 3)}`, `≥ ${this.number(high, 3)}`] : ['0 mm', `${this.number(1e3 * high, 3)} mm`];
    const scale = this.place.querySelector('.scale');
    scale.children[0].textContent = from;
    scale.children[1].style.background = `linear-gradient(90deg, ${stops.map((s) => `rgb(${s})`).join(',')})`;
    scale.children[2].textContent = to;
    const words = { jacobian: 'Volume ratio J: below 1 compressed, above 1 stretched', strain: 'Equivalent strain', stress: 'Von Mises stress' };
    scale.children[3].textContent = words[this.field] || 'Displacement since the start';
  }

  paint(moving) {
    cancelAnimationFrame(this.due);
    this.due = requestAnimationFrame(() => this.render(moving));
  }

  render(moving) {
    const wide = this.canvas.parentElement.clientWidth;
    if (!wide) return;
    const tall = Math.round(Math.min(0.78 * wide, 460));
    // Finer than the display while nothing moves: the browser's scaling then smooths the edges.
    const fine = moving ? 1 : Math.max(2, Math.min(devicePixelRatio || 1, 3));
    const [w, h] = [Math.round(wide * fine), Math.round(tall * fine)];
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w;
      this.canvas.height = h;
      this.canvas.style.height = `${tall}px`;
      this.image = this.context.createImageData(w, h);
      this.pixels = new Uint32Array(this.image.data.buffer);
      this.depths = new Float32Array(w * h);
    }
    this.pixels.fill(0);
    this.depths.fill(-Infinity);
    this.scale = this.zoom * fine * Math.min(wide, 1.18 * tall) / (2.05 * this.radius);
    this.middle = [w / 2 + fine * this.pan[0], h / 2 + fine * this.pan[1]];
    const [yaw, pitch] = [this.yaw - 0.5, this.pitch + 0.25];
    this.towards = [-Math.sin(yaw) * Math.cos(pitch), -Math.cos(yaw) * Math.cos(pitch), Math.sin(pitch)];
    this.project(this.positions, this.screen);
    const parts = this.mode === 'half' ? ['half', 'cut'] : ['surface'];
    for (const part of parts) {
      const region = this.field === 'region' && this.data.region[part];
      this.fill(this.data[part], this.screen, this.positions, this.values, part === 'cut' ? 0.12 : 0.42, region);
    }
    this.instrument();
    this.context.putImageData(this.image, 0, 0);
    this.annotate(fine, tall);
  }

  /// Screen x, y and nearness of each point.
  project(points, screen) {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    for (let i = 0; i < points.length; i += 3) {
      const x = points[i] - this.centre[0], y = points[i + 1] - this.centre[1], z = points[i + 2] - this.centre[2];
      const right = cy * x - sy * y, away = sy * x + cy * y;
      screen[i] = this.middle[0] + this.scale * right;
      screen[i + 1] = this.middle[1] - this.scale * (cp * z + sp * away);
      screen[i + 2] = sp * z - cp * away;
    }
  }

  /// Fills triangles; `values` in 0..1 take the colour scale, `values` null the instrument's grey. With `region`, that of each
  /// triangle, they take their region's colour.
  fill(triangles, screen, points, values, contrast, region) {
    const [w, h] = [this.canvas.width, this.canvas.height];
    const { pixels, depths, colours, mesh } = this;
    const edge = mesh && values ? 0.9 * this.canvas.width / this.canvas.clientWidth : 0;
    for (let k = 0; k < triangles.length; k += 3) {
      const [i, j, l] = [triangles[k], triangles[k + 1], triangles[k + 2]];
      const ax = screen[3 * i], ay = screen[3 * i + 1], bx = screen[3 * j], by = screen[3 * j + 1], cx = screen[3 * l], cy = screen[3 * l + 1];
      const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
      if (Math.abs(area) < 1e-6) continue;
      const left = Math.max(0, Math.ceil(Math.min(ax, bx, cx))), right = Math.min(w - 1, Math.floor(Math.max(ax, bx, cx)));
      const top = Math.max(0, Math.ceil(Math.min(ay, by, cy))), bottom = Math.min(h - 1, Math.floor(Math.max(ay, by, cy)));
      if (left > right || top > bottom) continue;
      const shade = 1 - contrast * (1 - this.light(points, i, j, l));
      const az = screen[3 * i + 2], bz = screen[3 * j + 2], cz = screen[3 * l + 2];
      const [av, bv, cv] = values ? [values[i], values[j], values[l]] : [0, 0, 0];
      const inverse = 1 / area;
      // Distance to an edge in px is its weight times the triangle's height over it.
      const [ha, hb, hc] = edge ? [Math.hypot(cx - bx, cy - by), Math.hypot(ax - cx, ay - cy), Math.hypot(bx - ax, by - ay)].map((s) => Math.abs(area) / (s || 1)) : [0, 0, 0];
      const da = (by - cy) * inverse, db = (cy - ay) * inverse;
      for (let y = top; y <= bottom; y++) {
        let a = ((bx - left) * (cy - y) - (by - y) * (cx - left)) * inverse - da;
        let b = ((cx - left) * (ay - y) - (cy - y) * (ax - left)) * inverse - db;
        for (let x = left; x <= right; x++) {
          a += da;
          b += db;
          const c = 1 - a - b;
          if (a < -1e-4 || b < -1e-4 || c < -1e-4) continue;
          const z = a * az + b * bz + c * cz, at = y * w + x;
          if (z <= depths[at]) continue;
          depths[at] = z;
          let red = 150, green = 158, blue = 168;
          if (region) {
            [red, green, blue] = this.data.regions[region[k / 3]].colour;
          } else if (values) {
            const v = a * av + b * bv + c * cv;
            const n = 3 * (v <= 0 ? 0 : v >= 1 ? 255 : (255 * v) | 0);
            red = colours[n]; green = colours[n + 1]; blue = colours[n + 2];
          }
          const s = edge && Math.min(a * ha, b * hb, c * hc) < edge ? 0.7 * shade : shade;
          pixels[at] = 0xff000000 | (blue * s) << 16 | (green * s) << 8 | (red * s);
        }
      }
    }
  }

  /// How much a triangle faces a light beside the viewer, 0 to 1.
  light(p, i, j, l) {
    const ax = p[3 * i], ay = p[3 * i + 1], az = p[3 * i + 2];
    const ux = p[3 * j] - ax, uy = p[3 * j + 1] - ay, uz = p[3 * j + 2] - az;
    const vx = p[3 * l] - ax, vy = p[3 * l + 1] - ay, vz = p[3 * l + 2] - az;
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    const [tx, ty, tz] = this.towards;
    return Math.abs(x * tx + y * ty + z * tz) / (Math.sqrt(x * x + y * y + z * z) || 1);
  }

  instrument() {
    const tool = this.data.instrument;
    if (!tool) return;
    const depth = this.data.depth[this.frame], along = tool.axis, needle = this.data.needle;
    if (needle) {
      const size = needle.length / this.data.depth.length;
      const tube = bent(needle.subarray(this.frame * size, (this.frame + 1) * size), tool.radius, this.high[2] + 0.012);
      const seen = new Float32Array(tube.points.length);
      this.project(tube.points, seen);
      this.fill(tube.triangles, seen, tube.points, null, 0.6);
      return;
    }
    const { points, triangles } = shape({ ...tool, x: 0, y: 0 }, 0, this.mode === 'half' && tool.kind !== 'needle', Math.max(0, depth));
    placed(points, along, [tool.x + depth * along[0], tool.y + depth * along[1], this.high[2] + depth * along[2]]);
    const screen = new Float32Array(points.length);
    this.project(points, screen);
    this.fill(triangles, screen, points, null, 0.6);
  }

  /// Outline of the undeformed sample and a bar of known length.
  annotate(fine, tall) {
    const ink = getComputedStyle(this.place).getPropertyValue('--muted');
    const c = this.context;
    const screen = new Float32Array(this.data.points.length);
    this.project(this.data.points, screen);
    c.strokeStyle = ink;
    c.globalAlpha = 0.45;
    c.lineWidth = fine;
    c.setLineDash([3 * fine, 4 * fine]);
    c.beginPath();
    for (const [i, j] of this.outline) { c.moveTo(screen[3 * i], screen[3 * i + 1]); c.lineTo(screen[3 * j], screen[3 * j + 1]); }
    c.stroke();
    c.setLineDash([]);
    c.globalAlpha = 1;
    const length = [0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005].find((l) => l * this.scale < 110 * fine) || 0.0005;
    const y = (tall - 12) * fine;
    c.beginPath();
    c.moveTo(12 * fine, y);
    c.lineTo(12 * fine + length * this.scale, y);
    c.lineWidth = 2 * fine;
    c.stroke();
    c.fillStyle = ink;
    c.font = `${12 * fine}px system-ui, sans-serif`;
    c.fillText(`${1e3 * length} mm`, 12 * fine, y - 6 * fine);
  }
}
