"""Force on a bonded disc or a kinematic needle in a cylinder of layers, by finite elements that share no code with the twin.

Axisymmetric, finite strain, Newton; quadratic displacements and bilinear pressures on graded quadrilaterals. The pressure jumps
with the modulus, so it is discontinuous at interfaces; `--continuous` makes it continuous there, as ordinary Taylor-Hood elements
have it, to see what that costs. W = mu/2 (J^-2/3 I1 - 3) + kappa/2 (J - 1)^2, nu = 0.49 everywhere.

    pip install scikit-fem scipy
    python layers.py disc 5.0 2.0 3 --layers 2:5034,7:839,17:1678      # radius mm, deepest mm, level 0 to 4
    python layers.py needle 0.5 10.0 2 --layers ... --every 0.25       # capture radius; one mesh for each depth

prints depth in mm, force in N, displacement on the axis at each interface in mm. Layers: depth of the lower end in mm, modulus in Pa.
"""
import argparse
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu
from skfem import Basis, ElementQuad1, ElementQuad2, ElementVector, MeshQuad

NU, H, RADIUS, CD = 0.49, 17.0, 15.0, 0.4
BULK = 2 * (1 + NU) / (3 * (1 - 2 * NU))  # kappa / mu


def graded(stops, finest, growth, largest):
    """Points through all stops, with spacing `finest[i]` at stop i."""
    out = [stops[0]]
    for (a, b), (fa, fb) in zip(zip(stops, stops[1:]), zip(finest, finest[1:])):
        samples = np.linspace(a, b, 4001)
        h = np.minimum(np.minimum(fa + growth * (samples - a), fb + growth * (b - samples)), largest)
        worth = np.concatenate([[0], np.cumsum(np.diff(samples) * (0.5 / h[1:] + 0.5 / h[:-1]))])
        n = max(1, int(np.ceil(worth[-1])))
        out.extend(np.interp(np.arange(1, n + 1) / n * worth[-1], worth, samples))
    return np.array(out)


class Body:
    def __init__(self, r, z, layers, hole, continuous):
        m = MeshQuad.init_tensor(r, z)
        centre = m.p[:, m.t].mean(axis=1)
        if hole:
            m = m.remove_elements(np.nonzero((centre[0] < hole[0]) & (centre[1] > H - hole[1]))[0])
            centre = m.p[:, m.t].mean(axis=1)
        self.region = np.searchsorted([d for d, _ in layers], H - centre[1])
        self.V = Basis(m, ElementVector(ElementQuad2()), intorder=5)
        Q = Basis(m, ElementQuad1(), intorder=5)
        of = np.zeros_like(self.region) if continuous else self.region
        self.q = np.unique(Q.element_dofs.T * 64 + of[:, None], return_inverse=True)[1].reshape(Q.element_dofs.T.shape)
        self.points = self.V.dx.shape
        self.N = np.array([np.broadcast_to(np.array(f[0]), self.points) for f in Q.basis])  # (4, elements, points)
        self.mu = np.array([mu for _, mu in layers])[self.region][:, None] * np.ones(self.points)
        self.r = self.V.global_coordinates()[0] + np.zeros(self.points)
        self.w = 2 * np.pi * self.r * self.V.dx
        self.B = np.array([self.gradient(f[0]) for f in self.V.basis])  # (18, 3, 3, elements, points)
        self.nu, self.np = self.V.N, self.q.max() + 1
        self.X = self.V.doflocs
        self.uz = np.zeros(self.nu, bool)
        self.uz[self.V.get_dofs(elements=np.arange(m.nelements)).all('u^2')] = True

    def gradient(self, u):
        g, o = np.array(u.grad), np.zeros(self.points)
        full = lambda x: x + o
        return np.array([[full(g[0, 0]), o, full(g[0, 1])], [o, full(np.array(u)[0] / self.r), o], [full(g[1, 0]), o, full(g[1, 1])]])

    def system(self, u, p):
        """Residual and tangent."""
        d, q = self.V.element_dofs.T, self.q
        F = np.einsum('kijeg,ek->ijeg', self.B, u[d]) + np.eye(3)[..., None, None]
        P_ = np.einsum('keg,ek->eg', self.N, p[q])
        Ft = np.moveaxis(F, (0, 1), (-2, -1))
        J = np.linalg.det(Ft)
        if J.min() <= 0:
            return None
        G = np.moveaxis(np.linalg.inv(Ft).swapaxes(-1, -2), (-2, -1), (0, 1))
        I1, m, eye = np.einsum('ij...,ij...', F, F), self.mu * J ** (-2 / 3), np.eye(3)
        S = m * (F - I1 / 3 * G) + P_ * J * G
        GG, kl = np.einsum('il...,kj...->ijkl...', G, G), np.einsum('ij...,kl...->ijkl...', G, G)
        T = m * (-2 / 3 * np.einsum('kl...,ij...->ijkl...', G, F - I1 / 3 * G) + np.einsum('ik,jl->ijkl', eye, eye)[..., None, None]
                 - 2 / 3 * np.einsum('kl...,ij...->ijkl...', F, G) + I1 / 3 * GG) + P_ * J * (kl - GG)
        kappa = BULK * self.mu
        B = self.B.reshape(self.B.shape[0], 9, *self.points).transpose(2, 3, 0, 1)
        TT = T.reshape(9, 9, *self.points).transpose(2, 3, 0, 1)
        N = self.N.transpose(1, 2, 0)
        w = self.w[..., None, None]
        BJG = (B @ (J * G).reshape(9, *self.points).transpose(1, 2, 0)[..., None])
        Ke = (w * (B @ TT @ B.swapaxes(-1, -2))).sum(axis=1)
        Be = (w * BJG @ N[..., None, :]).sum(axis=1)
        Me = (-w / kappa[..., None, None] * N[..., :, None] * N[..., None, :]).sum(axis=1)
        Ru = (w * (B @ S.reshape(9, *self.points).transpose(1, 2, 0)[..., None])).sum(axis=1)[..., 0]
        Rp = ((self.w * (J - 1 - P_ / kappa))[..., None] * N).sum(axis=1)
        q = q + self.nu
        size = self.nu + self.np
        R = np.bincount(np.concatenate([d.ravel(), q.ravel()]), np.concatenate([Ru.ravel(), Rp.ravel()]), size)
        parts = [(Ke, d, d), (Be, d, q), (Be.swapaxes(1, 2), q, d), (Me, q, q)]
        rows = np.concatenate([np.broadcast_to(i[:, :, None], e.shape).ravel() for e, i, j in parts])
        cols = np.concatenate([np.broadcast_to(j[:, None, :], e.shape).ravel() for e, i, j in parts])
        return R, coo_matrix((np.concatenate([e.ravel() for e, _, _ in parts]), (rows, cols)), shape=(size, size)).tocsr()

    def newton(self, u, p, fixed, want):
        free = np.setdiff1d(np.arange(self.nu + self.np), fixed)
        for it in range(14):
            s = self.system(u, p)
            if s is None:
                return None
            R, K = s
            x = np.zeros(self.nu + self.np)
            x[fixed] = (want - u)[fixed]
            x[free] = splu(K[free][:, free].tocsc()).solve((-R - K @ x)[free])
            u, p = u + x[:self.nu], p + x[self.nu:]
            if np.abs(x[:self.nu]).max() < 1e-7:
                return u, p
        return None


def drive(body, held, prescribed, steps):
    """States on the way to the prescribed displacements of the held dofs."""
    base = np.nonzero(body.X[1] < 1e-9)[0]
    axis = np.nonzero((body.X[0] < 1e-9) & ~body.uz)[0]
    fixed = np.unique(np.concatenate([held, base, axis]))
    u, p, last = np.zeros(body.nu), np.zeros(body.np), None
    for k in range(1, steps + 1):
        want = np.zeros(body.nu)
        want[held] = prescribed * k / steps
        guess = (u, p) if last is None else (2 * u - last[0], 2 * p - last[1])
        found = body.newton(*guess, fixed, want) or body.newton(u, p, fixed, want)
        if found is None:
            return
        last, (u, p) = (u, p), found
        yield k / steps, -body.system(u, p)[0][held[body.uz[held]]].sum() * 1e-6, u


def meshes(level):
    # at the singular edge, at interfaces, growth, largest (mm)
    return [(0.2, 0.5, 0.5, 1.5), (0.1, 0.25, 0.4, 1.0), (0.05, 0.15, 0.35, 1.0), (0.03, 0.1, 0.3, 0.8), (0.015, 0.05, 0.25, 0.7)][level]


def run(kind, radius, deepest, level, layers, every, continuous):
    edge, at_interface, growth, largest = meshes(level)
    interfaces = sorted(H - d for d, _ in layers if d < H - 1e-9)
    depths = [deepest] if kind == 'disc' else np.arange(every, deepest + 1e-9, every)
    for depth in depths:
        tip = H if kind == 'disc' else H - depth
        stops = {0.0: largest, H: edge if kind == 'disc' else 2 * edge, **{z: at_interface for z in interfaces}}
        near = [z for z in stops if abs(z - tip) < 1e-6]
        stops[near[0] if near else tip] = edge
        z = graded(sorted(stops), [stops[k] for k in sorted(stops)], growth, largest)
        r = graded([0.0, radius, RADIUS], [largest, edge, largest], growth, largest)
        body = Body(r, z, layers, None if kind == 'disc' else (radius, depth), continuous)
        X = body.X
        held = np.nonzero((X[0] < radius + 1e-9) & (X[1] > tip - 1e-9))[0]
        if kind == 'disc':
            prescribed = np.where(body.uz[held], -depth, 0.0)
            steps = int(round(depth / every))
        else:
            prescribed = np.where(body.uz[held], -CD * (X[1][held] - tip), 0.0)
            steps = int(np.ceil(depth / 1.0))
        for share, force, u in drive(body, held, prescribed, steps):
            if kind == 'disc' or share == 1.0:
                on_axis = [u[np.argmin(np.hypot(X[0], X[1] - i) + 1e3 * ~body.uz)] for i in interfaces]
                print(f'{depth * share:.4f},{force:.6g},' + ','.join(f'{x:.5f}' for x in on_axis), flush=True)


if __name__ == '__main__':
    parse = argparse.ArgumentParser()
    parse.add_argument('kind', choices=['disc', 'needle'])
    parse.add_argument('radius', type=float)
    parse.add_argument('deepest', type=float)
    parse.add_argument('level', type=int)
    parse.add_argument('--layers', default='17:1678')
    parse.add_argument('--every', type=float, default=0.25)
    parse.add_argument('--continuous', action='store_true')
    a = parse.parse_args()
    layers = [tuple(map(float, part.split(':'))) for part in a.layers.split(',')]
    run(a.kind, a.radius, a.deepest, a.level, layers, a.every, a.continuous)
