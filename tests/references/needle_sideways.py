"""Lateral force of a kinematic needle, by finite elements: an independent reference for the twin's sideways motion.

A needle of capture radius a is in a cylinder to depth D by the incremental rule u = -C_D (D - z) along the axis, nothing
sideways (axisymmetric, finite strain, Taylor-Hood elements, Newton). A small lateral motion or lean of what is captured is the
first Fourier mode on that state,

    u = (f_r cos t, f_t sin t, f_z cos t),  p = q cos t,

with the exact tangent of the deformed state: a linear problem in the half plane. Tissue ahead of the tip is free.

    pip install scikit-fem scipy; python needle_sideways.py DEPTH_MM LEVEL     # level 0 to 2: finer meshes
"""
import sys
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu
from skfem import *

MU, NU, H, RADIUS, A, CD = 1678.0, 0.49, 17.0, 15.0, 0.5, 0.4  # Pa, mm
KAPPA = 2 * MU * (1 + NU) / (3 * (1 - 2 * NU))


def graded(lo, hi, at, smallest, growth, largest):
    """Points from lo to hi, dense at `at`."""
    def side(length):
        x, h = [0.0], smallest
        while x[-1] < length:
            x.append(x[-1] + h)
            h = min(h * growth, largest)
        return np.array(x) * length / x[-1]
    parts = []
    if at > lo:
        parts.append(at - side(at - lo)[::-1])
    if hi > at:
        parts.append(at + side(hi - at)[(1 if parts else 0):])
    return np.concatenate(parts)


def mesh(depth, smallest, growth):
    r = graded(0, RADIUS, A, smallest, growth, 1.5)
    low = graded(0, H - depth, H - depth, smallest, growth, 1.5)
    half = 0.5 * depth
    high = np.concatenate([graded(H - depth, H - half, H - depth, smallest, growth, 0.5),
                           graded(H - half, H, H, 2 * smallest, growth, 0.5)[1:]])
    m = MeshQuad.init_tensor(r, np.concatenate([low, high[1:]]))
    centre = m.p[:, m.t].mean(axis=1)
    return m.remove_elements(np.nonzero((centre[0] < A) & (centre[1] > H - depth))[0])


def law(F, p):
    """First Piola-Kirchhoff stress, its tangent, and dP/dp = J F^-T."""
    Ft = np.moveaxis(F, (0, 1), (-2, -1))
    J = np.linalg.det(Ft)
    G = np.moveaxis(np.linalg.inv(Ft).swapaxes(-1, -2), (-2, -1), (0, 1))
    I1, m, eye = np.einsum('ij...,ij...', F, F), MU * J ** (-2 / 3), np.eye(3)
    P = m * (F - I1 / 3 * G) + p * J * G
    GG = np.einsum('il...,kj...->ijkl...', G, G)
    T = m * (-2 / 3 * np.einsum('kl...,ij...->ijkl...', G, F - I1 / 3 * G)
             + np.einsum('ik,jl->ijkl', eye, eye)[..., None, None]
             - 2 / 3 * np.einsum('kl...,ij...->ijkl...', F, G) + I1 / 3 * GG)
    T = T + p * J * (np.einsum('kl...,ij...->ijkl...', G, G) - GG)
    return P, T, J * G, J


def gradient(u, r):
    """Of the axisymmetric mode (u_r, u_z)."""
    g, o = u.grad, 0 * r
    return np.array([[g[0, 0], o, g[0, 1]], [o, u[0] / r, o], [g[1, 0], o, g[1, 1]]])


def first_mode(u, r):
    """Of (f_r, g, f_z), f_t = g - f_r; entries with cos and with sin do not meet in the energy."""
    d = u.grad
    return np.array([[d[0, 0], -u[1] / r, d[0, 1]],
                     [d[1, 0] - d[0, 0], u[1] / r, d[1, 1] - d[0, 1]],
                     [d[2, 0], -u[2] / r, d[2, 1]]])


def solve(K, f, x, fixed):
    free = np.setdiff1d(np.arange(K.shape[0]), fixed)
    y = x.copy()
    K = K.tocsr()
    rhs = f - K @ x
    y[free] += splu(K[free][:, free].tocsc()).solve(rhs[free])
    return y


def component(W, S, y, c):
    """Component c of a vector field, as a scalar field of basis S."""
    z = np.zeros(S.N)
    for kind in ('nodal_dofs', 'facet_dofs', 'interior_dofs'):
        z[getattr(S, kind)[0]] = y[getattr(W, kind)[c]]
    return z


def run(depth, smallest, growth):
    m = mesh(depth, smallest, growth)
    quad = dict(intorder=5)
    V, Q = Basis(m, ElementVector(ElementQuad2()), **quad), Basis(m, ElementQuad1(), **quad)
    on = lambda x: (x[0] < A + 1e-9) & (x[1] > H - depth - 1e-9)
    n = V.N
    X = V.doflocs
    held = np.nonzero(on(X))[0]
    uz = np.zeros(n, bool)
    uz[V.get_dofs(elements=np.arange(m.nelements)).all('u^2')] = True
    base, axis = np.nonzero(X[1] < 1e-9)[0], np.nonzero((X[0] < 1e-9) & ~uz)[0]
    fixed = np.unique(np.concatenate([held, base, axis]))

    u, p = np.zeros(n), np.zeros(Q.N)

    def fields():
        r = V.global_coordinates()[0]
        F = gradient(V.interpolate(u), r) + np.eye(3)[..., None, None]
        return r, law(F, np.array(Q.interpolate(p)))

    def system(T, G, grad, basis, weight):
        """Tangent of displacement and pressure; `grad` of each local shape function against the tangent at each point."""
        r = basis.global_coordinates()[0]
        points = lambda x: np.moveaxis(x.reshape(x.shape[:-2] + (-1,)), -1, 0)  # one row per point of integration
        B = points(np.array([grad(f[0], r) for f in basis.basis])).reshape(r.size, len(basis.basis), 9)
        N = points(np.array([np.array(f[0]) for f in Q.basis]))
        w = (weight * r * basis.dx).reshape(-1, 1, 1)
        sum_up = lambda x: x.reshape(r.shape + x.shape[1:]).sum(axis=1)
        Ke = sum_up(w * (B @ points(T).reshape(-1, 9, 9) @ B.swapaxes(1, 2)))
        Be = sum_up(w * (B @ points(G).reshape(-1, 9, 1)) @ N[:, None, :])
        Me = sum_up(-w / KAPPA * N[:, :, None] * N[:, None, :])
        d, q = basis.element_dofs.T, Q.element_dofs.T + basis.N
        parts = [(Ke, d, d), (Be, d, q), (Be.swapaxes(1, 2), q, d), (Me, q, q)]
        rows = [np.broadcast_to(i[:, :, None], e.shape).ravel() for e, i, j in parts]
        cols = [np.broadcast_to(j[:, None, :], e.shape).ravel() for e, i, j in parts]
        n = basis.N + Q.N
        return coo_matrix((np.concatenate([e.ravel() for e, _, _ in parts]), (np.concatenate(rows), np.concatenate(cols))), shape=(n, n)).tocsr()

    steps = int(np.ceil(depth / 0.2))
    for k in range(1, steps + 1):
        d = depth * k / steps
        want = np.zeros(n)
        # the captured length grows with the depth; on the way the last state is as good as any
        want[held] = np.where(uz[held], -CD * np.maximum(0, (X[1][held] - (H - depth))) * k / steps, 0.0)
        if k > 1:  # the state goes on as it did
            u, p, last = 2 * u - last[0], 2 * p - last[1], (u, p)
        else:
            last = (u, p)
        for it in range(12):
            r, (P, T, G, J) = fields()
            K = system(T, G, gradient, V, 2 * np.pi)
            R = np.concatenate([
                LinearForm(lambda b, w: 2 * np.pi * r * np.einsum('ij...,ij...', gradient(b, r), P)).assemble(V),
                LinearForm(lambda b, w: 2 * np.pi * r * (J - 1 - np.array(Q.interpolate(p)) / KAPPA) * b).assemble(Q)])
            x = np.zeros(n + Q.N)
            x[fixed] = (want - u)[fixed]
            dx = solve(K, -R, x, fixed)
            u, p = u + dx[:n], p + dx[n:]
            if np.abs(dx[:n]).max() < 1e-7:
                break
    r, (P, T, G, J) = fields()
    R = LinearForm(lambda b, w: 2 * np.pi * r * np.einsum('ij...,ij...', gradient(b, r), P)).assemble(V)
    axial = -R[held[uz[held]]].sum() * 1e-6

    W = Basis(m, ElementVector(ElementQuad2(), 3), **quad)
    S = Basis(m, ElementQuad2(), **quad)
    K = system(T, G, first_mode, W, np.pi)
    Y = W.doflocs
    part = np.zeros(W.N, int)
    for c in range(3):
        part[W.get_dofs(elements=np.arange(m.nelements)).all(f'u^{c + 1}')] = c
    held, base = np.nonzero(on(Y))[0], np.nonzero(Y[1] < 1e-9)[0]
    axis = np.nonzero((Y[0] < 1e-9) & (part > 0))[0]
    axis_p = W.N + np.nonzero(Q.doflocs[0] < 1e-9)[0]
    fixed = np.unique(np.concatenate([held, base, axis, axis_p]))
    unit = np.zeros(W.N + Q.N)
    unit[held[part[held] == 0]] = 1.0
    out = {'axial_N': axial, 'elements': m.nelements}
    tip = H - depth
    places = {'ahead 0.5': (1e-6, tip - 0.5), 'ahead 1': (1e-6, tip - 1), 'beside x': (1.5, tip + 2), 'beside y': (1.5, tip + 1.5)}
    for name, shift in (('sideways', lambda z: 1 + 0 * z), ('lean', lambda z: z - tip)):
        x = np.zeros(W.N + Q.N)
        x[held] = np.where(part[held] == 0, shift(Y[1][held]), 0.0)
        y = solve(K, 0 * x, x, fixed)
        out[name] = {'F_N_per_mm': -(unit @ (K @ y)) * 1e-6}
        of = lambda c: component(W, S, y, c)
        at = lambda q: [float((S.probes(np.array([q]).T) @ of(c))[0]) for c in range(3)]
        for place, q in places.items():
            fr, g, fz = at(q)
            out[name][place] = (fr, 0.0, fz) if 'y' not in place else (fr - g, 0.0, 0.0)
    return out


if __name__ == '__main__':
    depth = float(sys.argv[1])
    for smallest, growth in [((0.08, 1.5), (0.05, 1.35), (0.03, 1.25), (0.02, 1.2))[int(sys.argv[2])]]:
        for key, value in run(depth, smallest, growth).items():
            print(key, value)
