// What the 3D view is made of: colour scales, outline of the sample, shape of the instrument.

/// Colours from dark to light, even steps to the eye (viridis, its darkest end lifted so that it stands off a dark page).
const SEQUENTIAL = [[70, 32, 110], [70, 55, 130], [59, 82, 139], [44, 114, 142], [33, 145, 140], [40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37]];
/// Blue below, red above, pale at the middle.
const DIVERGING = [[33, 80, 160], [75, 130, 200], [140, 180, 222], [200, 214, 230], [236, 236, 236], [240, 208, 190], [226, 150, 118], [200, 88, 66], [160, 30, 40]];

function table(stops) {
  const colours = new Uint8Array(256 * 3);
  for (let i = 0; i < 256; i++) {
    const at = i / 255 * (stops.length - 1), k = Math.min(Math.floor(at), stops.length - 2), t = at - k;
    for (let c = 0; c < 3; c++) colours[3 * i + c] = stops[k][c] + t * (stops[k + 1][c] - stops[k][c]);
  }
  return colours;
}

/// Edges of the undeformed surface where it turns by more than 35 degrees.
function outline(points, triangles) {
  const normals = new Map();
  const edges = [];
  for (let k = 0; k < triangles.length; k += 3) {
    const t = [triangles[k], triangles[k + 1], triangles[k + 2]];
    const [a, b, c] = t.map((i) => [points[3 * i], points[3 * i + 1], points[3 * i + 2]]);
    const [u, v] = [b, c].map((q) => q.map((x, d) => x - a[d]));
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...n) || 1;
    for (let e = 0; e < 3; e++) {
      const [i, j] = [t[e], t[(e + 1) % 3]];
      const key = Math.min(i, j) * 2 ** 26 + Math.max(i, j);
      const other = normals.get(key);
      if (!other) normals.set(key, n.map((x) => x / length));
      else if (other.reduce((s, x, d) => s + x * n[d] / length, 0) < 0.82) edges.push([i, j]);
    }
  }
  return edges;
}

/// Triangles of an instrument whose tip is at height `tip`: a shaft with a cone for a needle, else a disc.
function shape(tool, tip, half, top) {
  const needle = tool.kind === 'needle', r = tool.radius, n = 24;
  const rings = needle
    ? [[tip, 0], [tip + 2 * r, r], [Math.max(top, tip) + 0.012, r], [Math.max(top, tip) + 0.012, 0]]
    : [[tip, 0], [tip, r], [tip + (tool.kind === 'plate' ? 0.0015 : 0.006), r], [tip + (tool.kind === 'plate' ? 0.0015 : 0.006), 0]];
  const points = [], triangles = [];
  const turn = half ? Math.PI : 2 * Math.PI;
  for (const [z, radius] of rings) {
    for (let j = 0; j <= n; j++) {
      points.push(tool.x + radius * Math.cos(turn * j / n), tool.y + radius * Math.sin(turn * j / n), z);
    }
  }
  for (let i = 0; i + 1 < rings.length; i++) {
    for (let j = 0; j < n; j++) {
      const a = i * (n + 1) + j, b = a + n + 1;
      triangles.push(a, a + 1, b, a + 1, b + 1, b);
    }
  }
  if (half) {
    for (let i = 0; i + 1 < rings.length; i++) {
      const a = i * (n + 1), b = a + n + 1;
      triangles.push(a, a + n, b, a + n, b + n, b);
    }
  }
  return { points: new Float32Array(points), triangles };
}

/// Triangles of a needle that bends: a tube about `places` (x, y, z of one after the other, from the clamp to the tip) up to a height, with a
/// point at its end.
function bent(places, radius, top) {
  const n = 16, last = places.length / 3 - 1, points = [], triangles = [];
  let first = last;
  while (first > 0 && places[3 * first + 2] < top) first--;
  for (let i = first; i <= last; i++) {
    const r = i === last ? 0 : radius;
    for (let j = 0; j <= n; j++) {
      const a = 2 * Math.PI * j / n;
      points.push(places[3 * i] + r * Math.cos(a), places[3 * i + 1] + r * Math.sin(a), places[3 * i + 2]);
    }
  }
  for (let i = 0; i < last - first; i++) {
    for (let j = 0; j < n; j++) {
      const a = i * (n + 1) + j, b = a + n + 1;
      triangles.push(a, b, a + 1, a + 1, b, b + 1);
    }
  }
  return { points: new Float32Array(points), triangles };
}

/// Turns the points of an upright instrument, whose tip is at (0, 0, 0), to an axis into the sample, and takes it to its place.
function placed(points, [x, y, z], tip) {
  // turns (0, 0, -1) to the axis about the line that is across both
  const k = z > 0.999999 ? 0 : 1 / (1 - z);
  for (let i = 0; i < points.length; i += 3) {
    const [a, b, c] = [points[i], points[i + 1], points[i + 2]];
    points[i] = tip[0] + a * (1 - k * x * x) - b * k * x * y - c * x;
    points[i + 1] = tip[1] - a * k * x * y + b * (1 - k * y * y) - c * y;
    points[i + 2] = tip[2] + a * x + b * y - c * z;
  }
  return points;
}
