"""Force vector of a kinematic needle that goes in oblique or beside the sample's axis, by finite elements in three dimensions: an
independent reference.

For a small deformation coefficient C_D the problem is linear, and its end does not depend on the way there: an isotropic cylinder on a
bonded base, in it the cylinder of the capture radius about the path, cut at the tip parallel to the top face, whose surface is displaced by

    u = C_D (d - z) (s, 0, -1)        z: depth below the top face; d: that of the tip; s: tangent of the tilt

All else is free. Half of the body, quadratic tetrahedra (a mesh of their own, by gmsh), displacements alone at nu = 0.49, conjugate
gradients with algebraic multigrid. Force, torque about the tip
and displacements are per unit of C_D.

    pip install gmsh pyamg scikit-fem scipy; python needle_oblique.py > needle_oblique.csv
"""
import gmsh
import numpy as np
import pyamg
from scipy.sparse.linalg import cg
from skfem import Basis, BilinearForm, ElementTetP2, ElementVector, MeshTet
from skfem.helpers import ddot, sym_grad, trace

MU, NU, H, RADIUS, A = 1678.0, 0.49, 17.0, 15.0, 0.5  # Pa, mm
LAM = 2 * MU * NU / (1 - 2 * NU)
FAR = 2.5  # mm


def mesh(slope, entry, depth, h, edge, growth):
    """Half of the sample without what is captured, and which nodes are on that. h, edge: size there and at its edges, mm."""
    gmsh.initialize()
    gmsh.option.setNumber('General.Terminal', 0)
    occ = gmsh.model.occ
    half = occ.intersect([(3, occ.addCylinder(0, 0, 0, 0, 0, H, RADIUS))], [(3, occ.addBox(-40, 0, -1, 80, 40, H + 2))])[0]
    up, down = 3.0, depth + 3.0
    needle = occ.addCylinder(entry - slope * up, 0, H + up, slope * (up + down), 0, -(up + down), A)
    behind = occ.addBox(-40, -40, H - depth, 80, 80, depth + 20)
    occ.cut(half, occ.intersect([(3, needle)], [(3, behind)])[0])
    occ.synchronize()
    size = lambda d, t: np.subtract(*np.array(gmsh.model.getBoundingBox(d, t)).reshape(2, 3)[::-1])
    own = lambda s: s[1] > 1e-3 and max(s[:2]) < 2 * A + slope * depth + 0.5
    faces = [t for _, t in gmsh.model.getEntities(2) if own(size(2, t))]
    edges = {e for t in faces for _, e in gmsh.model.getBoundary([(2, t)], oriented=False) if size(1, e)[1] > 1e-3}
    field = gmsh.model.mesh.field
    a, b, c = field.add('Distance'), field.add('Distance'), field.add('MathEval')
    field.setNumbers(a, 'SurfacesList', faces)
    field.setNumber(a, 'Sampling', 60)
    field.setNumbers(b, 'CurvesList', sorted(edges))
    field.setNumber(b, 'Sampling', 200)
    field.setString(c, 'F', f'min({FAR}, min({h}+{growth}*F{a}, {edge}+{growth}*F{b}))')
    field.setAsBackgroundMesh(c)
    for key in ('MeshSizeExtendFromBoundary', 'MeshSizeFromPoints', 'MeshSizeFromCurvature'):
        gmsh.option.setNumber('Mesh.' + key, 0)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.optimize('Netgen')
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    place = np.zeros(int(tags.max()) + 1, int)
    place[tags.astype(int)] = np.arange(len(tags))
    cells = place[gmsh.model.mesh.getElements(3)[2][0].astype(int)].reshape(-1, 4).T
    captured = np.zeros(len(tags), bool)
    for face in faces:
        captured[place[gmsh.model.mesh.getNodes(2, face, includeBoundary=True)[0].astype(int)]] = True
    gmsh.finalize()
    used, cells = np.unique(cells, return_inverse=True)
    return MeshTet(np.ascontiguousarray(xyz.reshape(-1, 3).T[:, used]), cells.reshape(4, -1)), captured[used]


def run(tilt, entry, depth, level):
    slope = np.tan(tilt)
    m, captured = mesh(slope, entry, depth, *level)
    V = Basis(m, ElementVector(ElementTetP2()), intorder=2)

    @BilinearForm
    def stiffness(u, v, _):
        a, b = sym_grad(u), sym_grad(v)
        return 2 * MU * ddot(a, b) + LAM * trace(a) * trace(b)

    K, X, n = stiffness.assemble(V).tocsr(), V.doflocs, np.arange(V.N)
    part = np.empty(V.N, int)
    for k in range(3):
        part[V.get_dofs(elements=np.arange(m.nelements)).all(f'u^{k + 1}')] = k
    facets = m.boundary_facets()
    facets = facets[captured[m.facets[:, facets]].all(axis=0)]
    facets = facets[m.p[1, m.facets[:, facets]].mean(axis=0) > 1e-6]  # not those of the plane of symmetry
    held = V.get_dofs(facets=facets).flatten()
    u = np.zeros(V.N)
    along = np.maximum(depth - (H - X[2][held]), 0)
    u[held] = along * np.array([slope, 0, -1])[part[held]]
    base = np.nonzero(X[2] < 1e-9)[0]
    plane = np.nonzero((np.abs(X[1]) < 1e-9) & (part == 1))[0]
    free = np.setdiff1d(n, np.concatenate([held, base, plane]))
    rigid = np.zeros((V.N, 6))
    rigid[n, part] = 1
    for k in range(3):  # rotations
        i, j = (k + 1) % 3, (k + 2) % 3
        rigid[:, 3 + k] = np.where(part == i, -X[j], np.where(part == j, X[i], 0))
    system = K[free][:, free].tocsr()
    grids = pyamg.smoothed_aggregation_solver(system, B=rigid[free], strength=('symmetric', {'theta': 0.05}), smooth='jacobi')
    u[free], info = cg(system, -(K[free] @ u), rtol=1e-8, maxiter=500, M=grids.aspreconditioner())
    assert info == 0, info
    R = K @ u
    force = [-2e-6 * R[held[part[held] == k]].sum() for k in (0, 2)]  # of both halves, N
    base_force = [-2e-6 * R[base[part[base] == k]].sum() for k in (0, 2)]
    assert np.allclose(force, np.negative(base_force), rtol=1e-4, atol=1e-6), (force, base_force)
    tip, axis = np.array([entry + slope * depth, 0, H - depth]), np.array([slope, 0, -1]) / np.hypot(1, slope)
    points = np.array([tip + 0.5 * axis, tip + axis, tip + [2, 0, 2], tip + [-1.5, 0, 1], tip + [0, 1.5, 1]])
    f = {k: -2e-6 * R[held[part[held] == k]] for k in (0, 2)}
    x, z = X[0][held[part[held] == 2]], X[2][held[part[held] == 0]]
    torque = 1e-3 * (((z - tip[2]) * f[0]).sum() - ((x - tip[0]) * f[2]).sum())  # about the tip, N m
    moved = (V.probes(points.T + [[0], [1e-7], [0]]) @ u).reshape(3, -1).T
    head = f'{tilt},{1e-3 * entry:g},{1e-3 * depth:g},{m.nelements}'
    print(f'{head},force,,,,{force[0]:.8g},0,{force[1]:.8g}', flush=True)
    print(f'{head},torque,,,,0,{torque:.8g},0', flush=True)
    for place, by in zip(points, moved):
        print(head + ',point,' + ','.join(f'{1e-3 * x:.9g}' for x in [*place, *by]), flush=True)


if __name__ == '__main__':
    print('tilt_rad,entry_x_m,depth_m,elements,what,x_m,y_m,z_m,x,y,z')
    for tilt, entry, depth in ((0.0, 0.0, 4.0), (0.3, 0.0, 4.0), (0.0, 10.0, 4.0), (0.3, 6.0, 3.0)):
        for level in ((0.2, 0.09, 0.28), (0.14, 0.06, 0.24), (0.1, 0.04, 0.2)):
            run(tilt, entry, depth, level)
