"""A second needle in layers in one dimension, to try on what was chosen with rod.py: another tissue, another friction, another way to
solve.

Tissue along the path: springs to the ground that stiffen, layers that shear each other, and dashpots beside both (Kelvin and Voigt),

    k u (1 + (u/a)^2) + c u' - (g u_z)_z = q + P delta(z - z_c)      marched in time, implicitly, by reweighted least squares

q: friction f(z) s / sqrt(s^2 + s_0^2) of the velocity s of the needle past the tissue: no stick, no memory. P: a spring that the tip pushes
through; beyond the cutting force the tip goes on by what the spring gives back, and at a membrane not until the puncture force. Cutting
forces
vary along the way by 3 % (a random walk with a memory of 0.1 mm), as those of real tissue do.

    pip install numpy scipy
    python bar.py double > bar_double.csv     # insertion, way out, the same again at 1 mm/s: depth m, force N
    python bar.py many 4 > bar_many.csv      # random tissues at 5 mm/s, as rod.py writes them; a third of the layers has no membrane:
                                              # "entered" is where the tip passes into such a one
"""
import sys

import numpy as np
from scipy.linalg import solve_banded

H, LENGTH, RADIUS = 4e-5, 0.015, 0.5e-3


class Bar:
    def __init__(self, rows, seed):
        """rows: upper boundary m, ground stiffness Pa, friction N/m, cutting N, puncture N (0: none)."""
        rows = np.array(rows)
        self.z = (np.arange(round(LENGTH / H)) + 0.5) * H
        at = np.searchsorted(rows[:, 0], self.z, side="right") - 1
        self.k, self.f, self.cutting = (rows[at, i] * s for i, s in ((1, H), (2, H), (3, 1.0)))
        noise, memory = np.random.default_rng(seed).normal(size=self.z.size), np.exp(-H / 1e-4)
        walk = np.zeros(self.z.size)
        for i in range(1, walk.size):
            walk[i] = memory * walk[i - 1] + np.sqrt(1 - memory**2) * noise[i]
        self.cutting = self.cutting * (1 + 0.03 * walk)
        stiffness = rows[at, 1]
        self.g = 2.0 * RADIUS**2 * np.minimum(stiffness[1:], stiffness[:-1]) / H
        self.a, self.tau, self.slow = 1.5e-3, 5e-3, 0.02
        self.tip_spring = 10.0 * rows[:, 1].max() * RADIUS
        self.u = np.zeros(self.z.size)
        self.cut, self.tip = 0.0, 0.0
        self.walls = [(z, p) for z, p in rows[:, [0, 4]] if p > 0]
        self.open, self.crossed, self.entered = [z for z, p in rows[:, [0, 4]] if p == 0], [], []

    def rest(self):
        self.u[:] = 0.0
        self.tip = 0.0

    def step(self, d0, d1, dt):
        speed = (d1 - d0) / dt
        if d1 <= 0:
            self.rest()
            return 0.0
        # material depth of the tip: in the channel where the tissue has gone with it, at most where it has cut
        reach = np.concatenate([[0.0], self.z + self.u])
        within = np.interp(d1, reach, np.concatenate([[0.0], self.z]))
        c = min(within, self.cut) if self.cut > 0 else 0.0
        pushes = within >= self.cut
        share = np.clip((c - self.z) / H + 0.5, 0, 1)
        i = min(int(max(c / H - 0.5, 0.0)), self.z.size - 2)
        w = np.clip((c - self.z[i]) / H, 0, 1)
        shape = np.array([1 - w, w])
        u = self.u.copy()
        low = self.slow * abs(speed)
        for _ in range(200):
            v = (u - self.u) / dt
            s = speed - v
            root = np.sqrt(s**2 + low**2)
            friction = self.f * share * s / root
            slope = self.f * share / root / dt  # root of the last try: each try comes nearer
            x = u + self.tau * v
            more = 1 + self.tau / dt
            force = self.k * (u * (1 + (u / self.a) ** 2) + self.tau * v) - friction
            force[:-1] += self.g * (x[:-1] - x[1:])
            force[1:] += self.g * (x[1:] - x[:-1])
            band = np.zeros((3, u.size))
            band[1] = self.k * (1 + 3 * (u / self.a) ** 2 + self.tau / dt) + slope
            band[1, :-1] += self.g * more
            band[1, 1:] += self.g * more
            band[0, 1:] = band[2, :-1] = -self.g * more
            gap = d1 - c - shape @ u[i : i + 2]
            push = self.tip_spring * max(gap, 0.0) if pushes else 0.0
            if push > 0:
                force[i : i + 2] -= push * shape
                band[1, i : i + 2] += self.tip_spring * shape**2
                band[0, i + 1] += self.tip_spring * shape[0] * shape[1]
                band[2, i] += self.tip_spring * shape[0] * shape[1]
            change = solve_banded((1, 1), band, -force, check_finite=False)
            u += change
            if np.abs(change).max() < 3e-9:
                break
        self.u = u
        gap = d1 - c - shape @ u[i : i + 2]
        push = self.tip_spring * max(gap, 0.0) if pushes else 0.0
        out = friction.sum() + push
        if push > 0:
            if self.walls and self.cut >= self.walls[0][0] - 1e-9:
                if push >= self.walls[0][1]:
                    self.crossed.append((d1, self.walls.pop(0)[0], push))
            elif push > (most := self.cutting[min(int(self.cut / H), self.z.size - 1)]):
                to = self.cut + (push - most) / self.tip_spring
                self.cut = min(to, self.walls[0][0]) if self.walls else to
                while self.open and self.cut >= self.open[0]:
                    self.entered.append((d1, self.open.pop(0)))
        return float(out)


def march(bar, turns, speed, dt, every):
    depth, rows, n = turns[0], [(turns[0], 0.0)], 0
    for a, b in zip(turns, turns[1:]):
        steps = round(abs(b - a) / speed / dt)
        for i in range(1, steps + 1):
            now = a + (b - a) * i / steps
            force = bar.step(depth, now, dt)
            depth, n = now, n + 1
            if n % every == 0:
                rows.append((now, force))
    return rows


def main():
    if sys.argv[1] == "double":
        bar = Bar(
            [[0.0, 9e3, 4.0, 0.008, 0.022], [0.0022, 2e4, 8.0, 0.015, 0.040], [0.0059, 6e3, 2.5, 0.005, 0.018]], 1
        )
        print("depth_m,force_n")
        for d, f in march(bar, [0.0, 0.0095, -0.001, 0.0095, -0.001], 1e-3, 5e-3, 2):
            print(f"{d:.5f},{f:.6f}")
        print(bar.crossed, file=sys.stderr)
        return
    random = np.random.default_rng(4)
    columns, said = [], []
    for n in range(int(sys.argv[2])):
        tops = np.cumsum([0.0, random.uniform(0.002, 0.0035), random.uniform(0.002, 0.0035)])
        ground = random.uniform(6e3, 2.5e4, 3)
        cut = random.uniform(0.003, 0.012, 3)
        puncture = cut + random.uniform(0.004, 0.03, 3)
        puncture[random.integers(1, 3)] = 0.0
        bar = Bar(np.stack([tops, ground, random.uniform(1, 8, 3), cut, puncture], axis=1), n)
        columns.append(march(bar, [0.0, 0.010], 5e-3, 5e-4, 4))
        said.append([[f"{at[0]:.6f}" for at in seen] for seen in (bar.crossed, bar.entered)])
    for c in range(3):
        print(",".join([f"crossing_{c}"] + [s[c] if len(s) > c else "" for s, _ in said]))
    print(",".join(["entered"] + [s[0] if s else "" for _, s in said]))
    for i, (d, _) in enumerate(columns[0]):
        print(",".join([f"{d:.5f}"] + [f"{rows[i][1]:.5f}" for rows in columns]))


if __name__ == "__main__":
    main()
