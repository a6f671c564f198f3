"""Tissue under the tip of an embedded needle that slips everywhere, by finite elements: how the face of the tip sinks.

The needle of shared case `needle_friction.csv` at its plateau: tip 8 mm deep, the rod's place empty, u_r = 0 on wall and face, friction
of 3 N/m along the wall and 3 mN over the face as a uniform pressure, both as dead loads (finite strain, Taylor-Hood elements, Newton).
Loads alone: nothing of the needle's motion is prescribed.

    pip install scikit-fem scipy; python needle_face.py SMALLEST_MM GROWTH > needle_face.csv    # 0.03 1.25: the shipped table
"""
import sys
import numpy as np
from scipy.sparse import coo_matrix
from skfem import *
from needle_sideways import A, H, KAPPA, gradient, law, mesh, solve

DEPTH, FRICTION, CUTTING = 8.0, 3.0, 3e-3  # mm, N/m, N
SMALLEST_STEP = 1e-4


def run(smallest, growth):
    m = mesh(DEPTH, smallest, growth)
    tip = H - DEPTH
    quad = dict(intorder=5)
    V, Q = Basis(m, ElementVector(ElementQuad2()), **quad), Basis(m, ElementQuad1(), **quad)
    X, n = V.doflocs, V.N
    uz = np.zeros(n, bool)
    uz[V.get_dofs(elements=np.arange(m.nelements)).all('u^2')] = True
    wall = (np.abs(X[0] - A) < 1e-9) & (X[1] > tip - 1e-9)
    face = (X[0] < A + 1e-9) & (np.abs(X[1] - tip) < 1e-9)
    fixed = np.unique(np.concatenate([np.nonzero(X[1] < 1e-9)[0], np.nonzero(((X[0] < 1e-9) | wall | face) & ~uz)[0]]))

    def load(where, pascal):
        basis = FacetBasis(m, V.elem, facets=m.facets_satisfying(where, boundaries_only=True), **quad)
        return LinearForm(lambda v, w: -2 * np.pi * w.x[0] * pascal * v[1]).assemble(basis)

    loads = load(lambda x: (np.abs(x[0] - A) < 1e-9) & (x[1] > tip), FRICTION * 1e-3 / (2 * np.pi * A) * 1e6)
    loads += load(lambda x: (x[0] < A) & (np.abs(x[1] - tip) < 1e-9), CUTTING / (np.pi * A * A) * 1e6)
    u, p, r = np.zeros(n), np.zeros(Q.N), V.global_coordinates()[0]

    def system(T, G):
        points = lambda x: np.moveaxis(x.reshape(x.shape[:-2] + (-1,)), -1, 0)  # one row per point of integration
        B = points(np.array([gradient(f[0], r) for f in V.basis])).reshape(r.size, len(V.basis), 9)
        N = points(np.array([np.array(f[0]) for f in Q.basis]))
        w = (2 * np.pi * r * V.dx).reshape(-1, 1, 1)
        sum_up = lambda x: x.reshape(r.shape + x.shape[1:]).sum(axis=1)
        Ke = sum_up(w * (B @ points(T).reshape(-1, 9, 9) @ B.swapaxes(1, 2)))
        Be = sum_up(w * (B @ points(G).reshape(-1, 9, 1)) @ N[:, None, :])
        Me = sum_up(-w / KAPPA * N[:, :, None] * N[:, None, :])
        d, q = V.element_dofs.T, Q.element_dofs.T + n
        parts = [(Ke, d, d), (Be, d, q), (Be.swapaxes(1, 2), q, d), (Me, q, q)]
        rows = [np.broadcast_to(i[:, :, None], e.shape).ravel() for e, i, j in parts]
        cols = [np.broadcast_to(j[:, None, :], e.shape).ravel() for e, i, j in parts]
        entries = (np.concatenate([e.ravel() for e, _, _ in parts]), (np.concatenate(rows), np.concatenate(cols)))
        return coo_matrix(entries, shape=(n + Q.N,) * 2).tocsr()

    def newton(u, p, share):
        for _ in range(9):
            F = gradient(V.interpolate(u), r) + np.eye(3)[..., None, None]
            P, T, G, J = law(F, np.array(Q.interpolate(p)))
            if not np.isfinite(P).all() or J.min() <= 0:
                return None
            R = np.concatenate([
                LinearForm(lambda b, w: 2 * np.pi * r * np.einsum('ij...,ij...', gradient(b, r), P)).assemble(V) - share * loads,
                LinearForm(lambda b, w: 2 * np.pi * r * (J - 1 - np.array(Q.interpolate(p)) / KAPPA) * b).assemble(Q)])
            dx = solve(system(T, G), -R, np.zeros(n + Q.N), fixed)
            u, p = u + dx[:n], p + dx[n:]
            if np.abs(dx[:n]).max() < 1e-8:
                return u, p
        return None

    share, step, slope = 0.0, 0.125, None
    while share < 1 - 1e-12:
        step = min(step, 1 - share)
        first = (u, p) if slope is None else (u + step * slope[0], p + step * slope[1])
        with np.errstate(all='ignore'):
            found = newton(*first, share + step)
        if found is None:
            step /= 2
            assert step > SMALLEST_STEP, f'no solution beyond {share} of the loads'
            continue
        slope = [(b - a) / step for a, b in zip((u, p), found)]
        (u, p), share, step = found, share + step, 1.5 * step
    i = np.nonzero(face & uz)[0]
    i = i[np.argsort(X[0][i])]
    return X[0][i], u[i]


if __name__ == '__main__':
    at, sunk = run(float(sys.argv[1]), float(sys.argv[2]))
    print('r_m,uz_m')
    for x in np.arange(0, A + 1e-9, 0.025):
        print(f'{1e-3 * x:.6f},{1e-3 * np.interp(x, at, sunk):.7f}')
