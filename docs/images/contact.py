"""Draws deformed half planes of runs beside each other, for contact.svg: what free tissue does at an instrument's surface.

    for i in flat ball needle: needle_twin solve ... --out out/i       # the lines of docs/contact.md
    python contact.py out/flat flat 5 10  out/ball ball 5 5  out/needle flat 0.5 1.2 > contact.svg

Each panel: folder of a run in the half plane, shape, radius and depth in mm.
"""
import base64
import math
import re
import struct
import sys

WIDTH, GAP, HEIGHT = 300, 20, 270  # px
TOP = 17.0  # mm


def arrays(path):
    text = open(path).read()
    found = {}
    for kind, name, data in re.findall(r'<DataArray type="(\w+)" Name="(\w+)"[^>]*>\s*([^<]*)<', text):
        raw = base64.b64decode(data.strip())
        size = struct.unpack('<Q', raw[:8])[0]
        code = {'Float64': 'd', 'Int64': 'q', 'UInt8': 'B'}[kind]
        found[name] = struct.unpack(f'<{size // struct.calcsize(code)}{code}', raw[8:8 + size])
    points = re.search(r'<Points>\s*<DataArray[^>]*Name="(\w+)"', text).group(1)
    return found, found[points]


def edges(folder):
    """Edges within the half plane y = 0, x >= 0: reference places in mm, deformed places."""
    a, p = arrays(f'{folder}/final.vtu')
    u = a['displacement']
    flat = lambda n: abs(p[3 * n + 1]) < 1e-9 and p[3 * n] > -1e-9
    seen = set()
    start = 0
    for end in a['offsets']:
        cell = [n for n in a['connectivity'][start:end] if flat(n)]
        start = end
        seen.update((i, j) for i in cell for j in cell if i < j)
    place = lambda n: (1e3 * (p[3 * n] + u[3 * n]), 1e3 * (p[3 * n + 2] + u[3 * n + 2]))
    return [(place(i), place(j)) for i, j in seen]


def outline(shape, r, z, high):
    if shape == 'flat':
        return [(-r, high), (-r, z), (r, z), (r, high)]
    arc = [(r * math.sin(t), z + r - r * math.cos(t)) for t in (math.pi * (k / 40 - 0.5) for k in range(41))]
    return [(-r, high)] + arc + [(r, high)]


def panel(x0, folder, shape, r, depth):
    wide = 2.6 * r if r > 1 else 4 * r
    scale = 0.5 * WIDTH / wide
    z = TOP - depth
    low = z - 0.45 * HEIGHT / scale
    to = lambda q: (x0 + 0.5 * WIDTH + scale * q[0], HEIGHT - scale * (q[1] - low))
    lines = []
    for a, b in edges(folder):
        for s in (1, -1):
            (x1, y1), (x2, y2) = to((s * a[0], a[1])), to((s * b[0], b[1]))
            if max(y1, y2) > -5 and min(y1, y2) < HEIGHT + 5 and max(abs(a[0]), abs(b[0])) < 1.4 * wide:
                lines.append(f'M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}')
    steel = ' '.join(f'{x:.1f},{y:.1f}' for x, y in map(to, outline(shape, r, z, TOP + 5)))
    return (f'<svg x="{x0}" y="0" width="{WIDTH}" height="{HEIGHT}" viewBox="{x0} 0 {WIDTH} {HEIGHT}">'
            f'<polygon points="{steel}" fill="#c9ced6" stroke="#4a5568"/>'
            f'<path d="{"".join(lines)}" stroke="#b4532a" stroke-width="0.6" fill="none"/></svg>')


if __name__ == '__main__':
    given = sys.argv[1:]
    panels = [given[i:i + 4] for i in range(0, len(given), 4)]
    whole = len(panels) * (WIDTH + GAP) - GAP
    print(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {whole} {HEIGHT}" width="{whole}" height="{HEIGHT}">')
    print(f'<rect width="{whole}" height="{HEIGHT}" fill="#ffffff"/>')
    for k, (folder, shape, r, depth) in enumerate(panels):
        print(panel(k * (WIDTH + GAP), folder, shape, float(r), float(depth)))
    print('</svg>')
