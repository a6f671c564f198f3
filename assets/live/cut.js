// The sample cut by a plane, in the undeformed state: the cut shows the same material points at every moment. The same as
// src/report/section.rs, for a plane that is moved by hand.

/// Cuts a mesh by the plane across axis `axis` (0: x, 1: y, 2: z) at `at`, in m. Kept is the side where sign (x - at) >= 0. Corners
/// on edges come after the nodes: number n + e lies at (1 - t) a + t b. `of` are the triangle of the surface that each one of the half
/// is of, and the cell that each one of the cut is of.
function cutMesh({ points, surface, cells }, axis, sign, at) {
  const nodes = points.length / 3, height = new Float64Array(nodes);
  let span = 0;
  for (let i = 0; i < nodes; i++) span = Math.max(span, Math.abs(height[i] = sign * (points[3 * i + axis] - at)));
  // Nodes as good as on the plane count as on it: else the cut has slivers. Places come in 32 bits.
  for (let i = 0; i < nodes; i++) if (Math.abs(height[i]) < 1e-6 * span) height[i] = 0;
  const a = [], b = [], t = [], half = [], cut = [], of = { half: [], cut: [] }, corners = new Map();
  const crossing = (i, j) => {
    if (!height[i]) return i;
    if (!height[j]) return j;
    if (i > j) [i, j] = [j, i];
    const key = i * 2 ** 26 + j;
    let corner = corners.get(key);
    if (corner === undefined) {
      corner = nodes + a.length;
      corners.set(key, corner);
      a.push(i);
      b.push(j);
      t.push(height[i] / (height[i] - height[j]));
    }
    return corner;
  };
  const fan = (polygon, into, origins, origin) => {
    for (let k = 1; k + 1 < polygon.length; k++) {
      const [p, q, r] = [polygon[0], polygon[k], polygon[k + 1]];
      if (p === q || q === r || p === r) continue;
      into.push(p, q, r);
      origins.push(origin);
    }
  };
  for (let k = 0; k < surface.length; k += 3) {
    const polygon = [];
    for (let c = 0; c < 3; c++) {
      const i = surface[k + c], j = surface[k + (c + 1) % 3];
      if (height[i] >= 0) polygon.push(i);
      if (height[i] * height[j] < 0) polygon.push(crossing(i, j));
    }
    fan(polygon, half, of.half, k / 3);
  }
  for (let k = 0; k < cells.length; k += 4) {
    const below = [], above = [];
    for (let c = 0; c < 4; c++) (height[cells[k + c]] < 0 ? below : above).push(cells[k + c]);
    if (!below.length || !above.length) continue;
    // Every second row backwards: the corners of a quadrilateral come in the order of its outline.
    const rows = below.map((i, n) => { const row = above.map((j) => crossing(i, j)); return n % 2 ? row.reverse() : row; });
    fan(rows.flat(), cut, of.cut, k / 4);
  }
  return {
    half: Uint32Array.from(half), cut: Uint32Array.from(cut), of,
    edge_a: Uint32Array.from(a), edge_b: Uint32Array.from(b), edge_t: Float32Array.from(t),
  };
}
