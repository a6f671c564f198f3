"""A flexible needle in a block, moved sideways by its driver: linear finite elements of the first harmonic about the axis.

Displacements (u_r cos t, u_t sin t, u_z cos t) and pressure (p cos t) of Q2-Q1 elements in the half plane, nearly incompressible linear elasticity;
an Euler-Bernoulli beam of cubic elements, clamped in the driver, whose lateral displacement is that of the tissue on the needle's wall and on the
face of its tip. Along the axis tissue stands on both. The block is the cylinder of the presets, bonded below.

    pip install numpy scipy; python beam_in_block.py > beam_in_block.csv
"""
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

MU, NU = 1678.0, 0.49
R, RADIUS, HEIGHT = 5e-4, 0.015, 0.017  # needle, block, m
DEPTH, LENGTH = 0.008, 0.020  # of the tip, and from the clamp to the tip, m
BEAMS = 12  # elements of the beam in the block

GAUSS = list(zip([-np.sqrt(0.6), 0.0, np.sqrt(0.6)], [5 / 9, 8 / 9, 5 / 9]))


def graded(a, b, n, first):
    """n steps from a to b, the first of them about so long."""
    low, high = 1.0 + 1e-9, 3.0
    for _ in range(100):
        q = 0.5 * (low + high)
        low, high = (q, high) if first * (q**n - 1) / (q - 1) < abs(b - a) else (low, q)
    steps = np.concatenate([[0.0], np.cumsum(q ** np.arange(n))])
    return a + (b - a) * steps / steps[-1]


def with_middles(x):
    fine = np.empty(2 * len(x) - 1)
    fine[::2], fine[1::2] = x, 0.5 * (x[1:] + x[:-1])
    return fine


def quadratic(x):
    return np.array([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2]), np.array([x - 0.5, -2 * x, x + 0.5])


def hermite(t, h):
    return [1 - 3 * t**2 + 2 * t**3, h * (t - 2 * t**2 + t**3), 3 * t**2 - 2 * t**3, h * (t**3 - t**2)]


def element(r, z):
    """Stiffness of nine nodes' displacements, of their volume with four pressures, and of these."""
    stiffness, volume, compress = np.zeros((27, 27)), np.zeros((27, 4)), np.zeros((4, 4))
    hr, hz, o = (r[1] - r[0]) / 2, (z[1] - z[0]) / 2, np.zeros(9)
    lame = 2 * MU * NU / (1 - 2 * NU)
    for x, wx in GAUSS:
        for y, wy in GAUSS:
            (a, da), (b, db) = quadratic(x), quadratic(y)
            at = r[0] + hr * (1 + x)
            n, nr, nz = (np.outer(*v).ravel() for v in ((a, b), (da / hr, b), (a, db / hz)))
            q = np.outer([(1 - x) / 2, (1 + x) / 2], [(1 - y) / 2, (1 + y) / 2]).ravel()
            strain = np.array([
                np.concatenate([nr, o, o]), np.concatenate([n / at, n / at, o]), np.concatenate([o, o, nz]),
                np.concatenate([-n / at, nr - n / at, o]), np.concatenate([nz, o, nr]), np.concatenate([o, nz, -n / at]),
            ])
            w = wx * wy * hr * hz * at * np.pi
            stiffness += w * strain.T @ np.diag(MU * np.array([2, 2, 2, 1, 1, 1])) @ strain
            volume += w * np.outer(strain[:3].sum(0), q)
            compress += w * np.outer(q, q) / lame
    return stiffness, volume, compress


def solve(bending, nr, nz):
    """Lateral displacements of tip and needle at the surface over that of the driver, and force over it, N/m."""
    inner, tip = max(4, nr // 8), HEIGHT - DEPTH
    r = np.concatenate([np.linspace(0, R, inner + 1)[:-1], graded(R, RADIUS, nr, R / inner)])
    below, above = graded(tip, 0.0, nz, R / inner), graded(tip, HEIGHT, nz, R / inner)
    z = np.concatenate([below[::-1][:-1], above])
    face = nz
    fr, fz = with_middles(r), with_middles(z)
    nodes, width = len(fr) * len(fz), len(fz)
    cells = [(i, j) for i in range(len(r) - 1) for j in range(len(z) - 1) if not (i < inner and j >= face)]
    corner = {}
    rows, columns, values = [], [], []

    def add(a, b, matrix):
        rows.append(np.repeat(a, len(b)))
        columns.append(np.tile(b, len(a)))
        values.append(np.asarray(matrix).ravel())

    used = np.zeros(nodes, bool)
    for i, j in cells:
        own = np.array([(2 * i + a) * width + 2 * j + b for a in range(3) for b in range(3)])
        used[own] = True
        u = np.concatenate([own, nodes + own, 2 * nodes + own])
        p = 3 * nodes + np.array([corner.setdefault((i + a, j + b), len(corner)) for a in (0, 1) for b in (0, 1)])
        stiffness, volume, compress = element(r[i : i + 2], z[j : j + 2])
        add(u, u, stiffness), add(u, p, -volume), add(p, u, -volume.T), add(p, p, -compress)
    beam = 3 * nodes + len(corner)
    # coarser than the tissue's elements: with those the stiff beam's rounding errors decide
    zb = np.concatenate([np.linspace(tip, HEIGHT, BEAMS + 1), np.linspace(HEIGHT, tip + LENGTH, 7)[1:]])
    for k, h in enumerate(np.diff(zb)):
        own = beam + 2 * k + np.arange(4)
        add(own, own, bending / h**3 * np.array([
            [12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
            [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]))
    size = beam + 2 * len(zb)
    matrix = sp.csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(size, size))

    given, slave = {}, {}
    for n in range(nodes):
        i, j = divmod(n, width)
        if not used[n] or j == 0:
            given.update({n: 0.0, nodes + n: 0.0, 2 * nodes + n: 0.0})
        elif (i == 2 * inner and j >= 2 * face) or (j == 2 * face and i <= 2 * inner):
            k = min(max(np.searchsorted(zb, fz[j]) - 1, 0), len(zb) - 2)
            h = zb[k + 1] - zb[k]
            at = list(zip(beam + 2 * k + np.arange(4), hermite((fz[j] - zb[k]) / h, h)))
            slave[n], slave[nodes + n] = at, [(dof, -v) for dof, v in at]
            given[2 * nodes + n] = 0.0
        elif i == 0:
            slave[nodes + n], given[2 * nodes + n] = [(n, -1.0)], 0.0
    clamp = beam + 2 * (len(zb) - 1)
    given.update({clamp: 1.0, clamp + 1: 0.0})
    free = np.array([n for n in range(size) if n not in given and n not in slave])
    place = {dof: k for k, dof in enumerate(free)}
    fixed = np.zeros(size)
    fixed[list(given)] = list(given.values())
    entries = [(dof, k, 1.0) for dof, k in place.items()]
    for dof, masters in slave.items():
        for master, share in masters:
            if master in place:
                entries.append((dof, place[master], share))
            else:
                fixed[dof] += share * fixed[master]
    a, b, v = zip(*entries)
    reduce = sp.csr_matrix((v, (a, b)), shape=(size, len(free)))
    u = reduce @ spsolve((reduce.T @ matrix @ reduce).tocsc(), -reduce.T @ (matrix @ fixed)) + fixed
    surface = beam + 2 * BEAMS
    return u[beam], u[surface], (matrix @ u)[clamp]


if __name__ == "__main__":
    print("bending_stiffness_n_m2,tip_over_driver,surface_over_driver,force_over_driver_n_per_m")
    for bending in (2.5e-6, 2.5e-5, 2.5e-4):
        coarse, fine = solve(bending, 20, 18), solve(bending, 36, 32)
        apart = max(abs(a - b) for a, b in zip(coarse[:2], fine[:2]))
        assert apart < 1e-3 and abs(coarse[2] / fine[2] - 1) < 2e-3, (coarse, fine)
        print(f"{bending},{fine[0]:.5f},{fine[1]:.5f},{fine[2]:.4f}")
