"""Force on a needle that sticks, slips, cuts and punctures in layers, by a rod in one dimension that shares no code with the twin.

The tissue along the path gives as an elastic foundation whose layers shear each other (Pasternak): with u(z) its displacement,

    K u - (K l^2 u')' = q + P delta(z - c),   u'(0) = 0,   K = 8/3 mu,   l = 3/2 R

so that a point force sinks by P / (2 K l) = P / (8 mu R), as under a flat punch, and a shaft that slips by f / K. q, the friction per length,
follows a stiff spring up to the layer's f, both ways, with memory. The tip is at the material depth c + u(c) = d; it pushes with the cutting
force of the layer at most, and the front c stays at a layer's upper boundary until P reaches the puncture force. Coming out and in again
up to the front, P = 0.

    pip install numpy scipy
    python rod.py double > rod_double.csv          # insertion, retraction, second insertion, retraction: depth m, force N
    python rod.py many 20 > rod_many.csv           # random tissues: force N over depth, one column each; crossings in the first lines

Forces are without noise; they are positive against the insertion.
"""
import sys

import numpy as np
from scipy.linalg import solve_banded
from scipy.optimize import brentq

R, STEP, NODE, DEPTH = 0.5e-3, 1e-5, 2.5e-5, 0.020
STIFF, RIGID = 200.0, 2e4  # sticking and the tip against what it stands on, over mu (and R)


class Rod:
    """layers: rows of upper boundary m, shear modulus Pa, friction N/m, cutting N, puncture N (0: no membrane)."""

    def __init__(self, layers):
        self.layers = np.array(layers)
        self.z = np.arange(0.0, DEPTH + NODE / 2, NODE)
        self.n = len(self.z)
        self.top = self.layers[:, 0]
        of = lambda z: self.layers[np.clip(np.searchsorted(self.top, z, side="right") - 1, 0, None)]
        self.of = of
        node, cell = of(self.z), of(self.z[:-1] + NODE / 2)
        k = 8 / 3 * cell[:, 1]
        self.base = np.zeros((3, self.n))
        shear, mass = k * (1.5 * R) ** 2 / NODE, k * NODE
        for a, b in ((0, self.n - 1), (1, self.n)):
            self.base[1, a:b] += shear + mass / 2
        self.base[0, 1:] = -shear
        self.base[2, :-1] = -shear
        # per node: a node's part of the length, from both cells
        self.f = np.zeros(self.n)
        self.f[:-1] += cell[:, 2] * NODE / 2
        self.f[1:] += cell[:, 2] * NODE / 2
        self.ks = STIFF * node[:, 1] * NODE
        self.u = np.zeros(self.n)
        self.slip = self.z.copy()  # d - u at which a node carries nothing: where the tip came to it, then where it last slipped
        self.front, self.tip, self.entered = 0.0, 0.0, 0
        self.crossings, self.unsolved = [], 0

    def solve(self, d, c, push):
        """Displacement, friction of the nodes and push with the tip at the material depth c. push None: c + u(c) = d."""
        share = np.clip((c - self.z) / NODE + 0.5, 0.0, 1.0)
        slip = np.where(self.z < self.tip + NODE / 2, self.slip, self.z)
        j = min(int(c / NODE), self.n - 2)
        shape = np.array([1 - c / NODE + j, c / NODE - j])
        stiff = RIGID * self.of(c)[1] * R
        u, stuck, trial = self.u, np.ones(self.n, bool), np.zeros(self.n)
        for k in range(100):
            a = self.base.copy()
            b = np.where(stuck, self.ks * (d - slip), np.sign(trial) * self.f) * share
            a[1] += np.where(stuck, self.ks, 0.0) * share
            if push is None:
                a[1, j:j + 2] += stiff * shape ** 2
                a[0, j + 1] += stiff * shape[0] * shape[1]
                a[2, j] += stiff * shape[0] * shape[1]
                b[j:j + 2] += stiff * (d - c) * shape
            else:
                b[j:j + 2] += push * shape
            last, u = u, solve_banded((1, 1), a, b, check_finite=False)
            if k > 12:
                u = 0.5 * (u + last)
            trial = self.ks * (d - slip - u)
            stuck = np.abs(trial) <= self.f
            if k > 0 and np.abs(u - last).max() < 1e-9:
                break
        else:
            self.unsolved += 1
        gap = d - c - shape @ u[j:j + 2]
        trial = np.clip(self.ks * (d - slip - u), -self.f, self.f)
        return u, trial, share, (stiff * gap if push is None else push), gap

    def take(self, d, c, push):
        self.u, trial, share, push, _ = self.solve(d, c, push)
        self.slip = np.where(share > 0, d - self.u - trial / self.ks, self.z)
        self.tip = c
        return float(trial @ share + max(push, 0.0))

    def go(self, d, low, high, push):
        """Tip between two depths where it meets the tissue; None if it lies beyond."""
        gap = lambda c: self.solve(d, c, push)[4]
        if gap(high) > 0.0:
            return None
        if gap(low) <= 0.0:
            return low
        return brentq(gap, low, high, xtol=2e-8)

    def move(self, d):
        """The force at a depth."""
        if d <= 0.0:
            self.u, self.slip, self.tip = 0 * self.u, self.z.copy(), 0.0
            return 0.0
        c = self.go(d, 0.0, self.front, 0.0)
        if c is not None and self.entered:
            return self.take(d, c, 0.0)
        while True:
            c = self.front
            push = self.solve(d, c, None)[3]
            wall = self.top[self.entered] if self.entered < len(self.top) else DEPTH - NODE
            at_wall = c >= wall - 1e-12
            if push <= self.layers[self.entered - (not at_wall), 3 + at_wall]:
                return self.take(d, c, None)
            if at_wall:
                self.crossings.append((float(d), float(wall), float(push)))
                self.entered += 1
                wall = self.top[self.entered] if self.entered < len(self.top) else DEPTH - NODE
            cutting = self.layers[self.entered - 1, 3]
            c = self.go(d, self.front, wall, cutting)
            self.front = wall if c is None else c
            if c is not None:
                return self.take(d, c, cutting)


def way(*turns):
    out = [np.array([turns[0]])]
    for a, b in zip(turns, turns[1:]):
        out.append(a + np.sign(b - a) * STEP * np.arange(1, round(abs(b - a) / STEP) + 1))
    return np.concatenate(out)


def main():
    if sys.argv[1] == "double":
        rod = Rod([[0.0, 5000, 6.0, 0.010, 0.030], [0.003, 2500, 3.0, 0.006, 0.016], [0.007, 6000, 9.0, 0.014, 0.035]])
        deep = 0.0125
        print("depth_m,force_n")
        for d in way(0.0, deep, -0.001, deep, -0.001):
            force = rod.move(d)
            print(f"{d:.5f},{force:.6f}")
        print(rod.crossings, rod.unsolved, file=sys.stderr)
    else:
        random = np.random.default_rng(23)
        columns, said = [], []
        for _ in range(int(sys.argv[2])):
            tops = np.cumsum([0.0, random.uniform(0.0015, 0.003), random.uniform(0.0015, 0.003)])
            mu = random.uniform(4000, 12000, 3)
            cut = mu * R * R * random.uniform(3, 8, 3)
            puncture = cut * random.uniform(1.5, 4, 3)
            rod = Rod(np.stack([tops, mu, mu * R * random.uniform(0.5, 2, 3), cut, puncture], axis=1))
            forces = [rod.move(d) for d in way(0.0, 0.010)]
            columns.append(forces)
            said.append(rod.crossings)
        for c in range(3):
            print(",".join([f"crossing_{c}"] + [f"{s[c][0]:.6f}" if len(s) > c else "" for s in said]))
        for i, d in enumerate(way(0.0, 0.010)):
            print(",".join([f"{d:.5f}"] + [f"{f[i]:.5f}" for f in columns]))


if __name__ == "__main__":
    main()
