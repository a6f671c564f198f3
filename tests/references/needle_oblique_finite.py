"""Force vector of a kinematic needle oblique or beside the axis at a large deformation coefficient, by finite elements in three dimensions.

Bodies, meshes and what is prescribed are those of needle_oblique.py, at finite strain: neo-Hookean law of the preset,

    P = mu J^(-2/3) (F - tr(F^T F) / 3 F^-T) + p J F^-T,     p = kappa (J - 1)

in Taylor-Hood tetrahedra (quadratic displacement, linear pressure), Newton with the exact tangent, C_D in steps. The end of an elastic
body does not depend on the way there. What the needle fills carries no stress and is not meshed. Forces and displacements are whole ones.

    pip install gmsh pyamg pypardiso scikit-fem scipy; python needle_oblique_finite.py > needle_oblique_finite.csv
"""
import sys
import numpy as np
from pypardiso import PyPardisoSolver
from scipy.sparse import coo_matrix, triu
from skfem import Basis, ElementTetP1, ElementTetP2, ElementVector
from needle_oblique import A, H, MU, NU, mesh

KAPPA = 2 * MU * (1 + NU) / (3 * (1 - 2 * NU))
EYE = np.eye(3)


def law(F, p):
    """First Piola-Kirchhoff stress, its tangent, and dP/dp = J F^-T, of arrays of matrices."""
    J = np.linalg.det(F)
    G = np.linalg.inv(F).swapaxes(-1, -2)
    one, two = (lambda a: a[..., None, None]), (lambda a: a[..., None, None, None, None])
    I1, m = np.einsum('...ij,...ij', F, F), MU * J ** (-2 / 3)
    shape = F - one(I1 / 3) * G
    P = one(m) * shape + one(p * J) * G
    GG = np.einsum('...ij,...kl->...ijkl', G, G)
    GT = np.einsum('...il,...kj->...ijkl', G, G)
    T = two(m) * (np.einsum('ik,jl->ijkl', EYE, EYE) + two(I1 / 3) * GT
                  - 2 / 3 * (np.einsum('...kl,...ij->...ijkl', G, shape) + np.einsum('...kl,...ij->...ijkl', F, G)))
    return P, T + two(p * J) * (GG - GT), one(J) * G, J


class TurnedInsideOut(Exception):
    pass


class Body:
    def __init__(self, m):
        quad = dict(intorder=4)
        self.V, S, self.Q = (Basis(m, e, **quad) for e in (ElementVector(ElementTetP2()), ElementTetP2(), ElementTetP1()))
        self.g = np.array([np.array(f[0].grad) for f in S.basis]).transpose(2, 3, 0, 1)  # element, point, node, direction
        self.n = np.array([np.broadcast_to(np.array(f[0]), S.dx.shape) for f in self.Q.basis]).transpose(1, 2, 0)
        self.w = S.dx
        self.dofs = np.concatenate([self.V.element_dofs, self.V.N + self.Q.element_dofs]).T

    def forces(self, x, tangent=True):
        """Residual and tangent at displacements and pressures x."""
        size, parts, R = self.V.N + self.Q.N, [], np.zeros(self.V.N + self.Q.N)
        for e in np.array_split(np.arange(len(self.dofs)), max(1, len(self.dofs) // 1500)):
            g, n, w, d = self.g[e], self.n[e], self.w[e], self.dofs[e]
            u, p = x[d[:, :30]].reshape(-1, 10, 3), np.einsum('eqa,ea->eq', n, x[d[:, 30:]])
            F = np.einsum('eai,eqaj->eqij', u, g) + EYE
            P, T, G, J = law(F, p)
            if J.min() <= 0:
                raise TurnedInsideOut
            r = np.concatenate([np.einsum('eq,eqij,eqaj->eai', w, P, g).reshape(-1, 30),
                                np.einsum('eq,eqa->ea', w * (J - 1 - p / KAPPA), n)], axis=1)
            np.add.at(R, d, r)
            if not tangent:
                continue
            K = np.zeros((len(e), 34, 34))
            Tg = np.einsum('eq,eqijkl,eqbl->eqijbk', w, T, g, optimize=True).reshape(*w.shape, 3, 3, 30)
            K[:, :30, :30] = np.einsum('eqaj,eqijb->eaib', g, Tg, optimize=True).reshape(-1, 30, 30)
            K[:, :30, 30:] = np.einsum('eq,eqij,eqaj,eqb->eaib', w, G, g, n, optimize=True).reshape(-1, 30, 4)
            K[:, 30:, :30] = K[:, :30, 30:].swapaxes(1, 2)
            K[:, 30:, 30:] = np.einsum('eq,eqa,eqb->eab', -w / KAPPA, n, n, optimize=True)
            at = [np.broadcast_to(i, K.shape).ravel() for i in (d[:, :, None], d[:, None, :])]
            parts.append(coo_matrix((K.ravel(), at), shape=(size, size)).tocsr())
        return R, sum(parts[1:], parts[0]) if tangent else None


def run(tilt, entry, depth, coefficients, level):
    slope = np.tan(tilt)
    m, captured = mesh(slope, entry, depth, *level)
    body = Body(m)
    V, Q = body.V, body.Q
    X, part = V.doflocs, np.empty(V.N, int)
    for k in range(3):
        part[V.get_dofs(elements=np.arange(m.nelements)).all(f'u^{k + 1}')] = k
    facets = m.boundary_facets()
    facets = facets[captured[m.facets[:, facets]].all(axis=0)]
    facets = facets[m.p[1, m.facets[:, facets]].mean(axis=0) > 1e-6]  # not those of the plane of symmetry
    held = V.get_dofs(facets=facets).flatten()
    base = np.nonzero(X[2] < 1e-9)[0]
    plane = np.nonzero((np.abs(X[1]) < 1e-9) & (part == 1))[0]
    fixed = np.unique(np.concatenate([held, base, plane]))
    free = np.setdiff1d(np.arange(V.N + Q.N), fixed)
    unit = np.zeros(V.N + Q.N)
    unit[held] = np.maximum(depth - (H - X[2][held]), 0) * np.array([slope, 0, -1])[part[held]]
    # y = 0 on the plane of symmetry also where it meets the needle
    unit[plane] = 0
    solver = PyPardisoSolver(mtype=-2)
    solver.set_iparm(11, 1)
    solver.set_iparm(13, 1)

    def newton(c, guess):
        """The state at C_D = c from a guess; None if there is none to be had from there."""
        x, last = guess, np.inf
        for it in range(12):
            try:
                R, K = body.forces(x)
            except TurnedInsideOut:
                return None
            step = np.zeros_like(x)
            step[fixed] = (c * unit - x)[fixed]
            rows = K[free]
            step[free] = solver.solve(triu(rows[:, free], format='csr'), -R[free] - rows[:, fixed] @ step[fixed])
            largest = np.abs(step[:V.N]).max()
            print(f'{tilt} {entry} {depth} {m.nelements}: C_D {c:.4f}, Newton {it}, step {largest:.2e} mm', file=sys.stderr, flush=True)
            if it > 3 and largest > last:
                return None
            x, last = x + step, largest
            if largest < 1e-6:
                return x
        return None

    states, by = [(0.0, np.zeros(V.N + Q.N))], 0.05
    for goal in coefficients:
        while states[-1][0] < goal - 1e-12:
            c = min(states[-1][0] + by, goal)
            # on the parabola through the last states
            guess = sum(x * np.prod([(c - d) / (e - d) for d, _ in states if d != e]) for e, x in states)
            x = newton(c, guess)
            if x is None:
                by *= 0.5
                if by < 5e-3:
                    print(f'{tilt} {entry} {depth} {m.nelements}: stopped after C_D {states[-1][0]:.4f}', file=sys.stderr, flush=True)
                    return
            else:
                states, by = [*states[-2:], (c, x)], 1.3 * by
        report(tilt, entry, depth, goal, m, V, part, held, base, states[-1][1], body.forces(states[-1][1], tangent=False)[0])


def report(tilt, entry, depth, c, m, V, part, held, base, x, R):
    X, slope = V.doflocs, np.tan(tilt)
    force = [-2e-6 * R[held[part[held] == k]].sum() for k in (0, 2)]  # of both halves, N
    base_force = [-2e-6 * R[base[part[base] == k]].sum() for k in (0, 2)]
    assert np.allclose(force, np.negative(base_force), rtol=1e-4, atol=1e-8), (force, base_force)
    tip, axis = np.array([entry + slope * depth, 0, H - depth]), np.array([slope, 0, -1]) / np.hypot(1, slope)
    points = np.array([tip + 0.5 * axis, tip + axis, tip + [2, 0, 2], tip + [-1.5, 0, 1], tip + [0, 1.5, 1]])
    f = {k: -2e-6 * R[held[part[held] == k]] for k in (0, 2)}
    down = c * np.maximum(depth - (H - X[2][held]), 0)  # forces act where the tissue is
    px, pz = X[0][held] + slope * down - tip[0], X[2][held] - down - tip[2]
    torque = 1e-3 * ((pz[part[held] == 0] * f[0]).sum() - (px[part[held] == 2] * f[2]).sum())  # about the tip, N m
    moved = (V.probes(points.T + [[0], [1e-7], [0]]) @ x[:V.N]).reshape(3, -1).T
    head = f'{tilt},{1e-3 * entry:g},{1e-3 * depth:g},{c:g},{m.nelements}'
    print(f'{head},force,,,,{force[0]:.8g},0,{force[1]:.8g}')
    print(f'{head},torque,,,,0,{torque:.8g},0')
    for place, by in zip(points, moved):
        print(head + ',point,' + ','.join(f'{1e-3 * v:.9g}' for v in [*place, *by]), flush=True)


if __name__ == '__main__':
    print('tilt_rad,entry_x_m,depth_m,coefficient,elements,what,x_m,y_m,z_m,x,y,z')
    for level in ((0.2, 0.09, 0.28), (0.14, 0.06, 0.24)):
        for tilt, entry, depth in ((0.0, 0.0, 4.0), (0.0, 0.0, 2.0), (0.0, 10.0, 4.0), (0.0, 10.0, 2.0), (0.3, 0.0, 4.0), (0.3, 6.0, 3.0)):
            run(tilt, entry, depth, (0.2, 0.3, 0.4), level)
