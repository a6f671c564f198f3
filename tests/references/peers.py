"""Processor time to a force within 1 %: the twin beside an implicit finite-element solver that shares no code with it, in one run.

The peer is static, axisymmetric, at finite strain: triangles that grow linearly from the singular edges (gmsh), exact tangent, Newton
with halving where an element turns inside out, Pardiso with one symbolic factorisation for each run. Two elements:

    P2-P1   quadratic displacements, linear pressure that may jump where the modulus does (Taylor-Hood)
    P1      linear displacements alone, which lock at nu = 0.49

    W = mu/2 (J^-2/3 I1 - 3) + kappa/2 (J - 1)^2,     p = kappa (J - 1), weakly for P2-P1

`one` is a solution from rest at the last depth, in the fewest of 1, 2, 4 .. 64 equal load steps whose force more steps confirm within 0.1 %,
since with too few Newton may end in another equilibrium (other tries are not counted). `path` is the way there in 50 answers, each from
the line through the last two, or from the last where that turns elements inside out, which it mostly does ahead of the needle. There the tip
passes one row of elements with each answer. Counted is processor time, user and system, on one thread,
of assembly and solution: no mesh, no table of a mesh. The twin's is that of its process less `build_s`: its start is in it. Twin
and peer take turns. Errors are against bags/reference/, for layers against layers.csv, whose pressure jumps (1.1 % above the former).

    pip install gmsh numpy pypardiso scikit-fem scipy
    export OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1; python peers.py needle_twin [case ...] > peers.md   # some minutes
"""
import functools, json, resource, subprocess, sys, tempfile, time
from pathlib import Path
import gmsh
import numpy as np
from pypardiso import PyPardisoSolver
from scipy.sparse import csr_matrix
from skfem import Basis, ElementTriP1, ElementTriP2, MeshTri

MU, NU, H, RADIUS, DISC, A, CD = 1678.0, 0.49, 17.0, 15.0, 5.0, 0.5, 0.4  # Pa, mm
BULK = 2 * (1 + NU) / (3 * (1 - 2 * NU))  # kappa / mu
ONE, LAYERS = ((H, MU),), ((10.0, MU), (15.0, 0.5 * MU), (H, 3 * MU))  # upper end, modulus
REGION = ('[materials.{0}]\nmodel = "neo_hookean"\nshear_modulus_pa = {1}\n[[regions]]\nname = "{0}"\nmaterial = "{0}"\nshape = "layer"\n'
          'from_depth_m = {2}\nto_depth_m = {3}\n')
REGIONS = REGION.format('stiff', 3 * MU, 0.0, 0.002) + REGION.format('soft', 0.5 * MU, 0.002, 0.007)
ROOT, NO_WALL = Path(__file__).parents[2], ['--set', 'instrument.wall_contact=false']
NEEDLE = 'bags/reference/needle_force_capture_radius_0.50mm.csv'
CASES = {  # kind, depth mm, layers, table and its columns of depth and force, scene of the twin, its keys
    'compression': ('plate', 2.5, ONE, 'bags/reference/compression_force.csv', (0, 1), 'compression', []),
    'indentation': ('disc', 4.0, ONE, 'bags/reference/indentation_force.csv', (0, 1), 'indentation', NO_WALL),
    'needle, 5 mm': ('needle', 5.0, ONE, NEEDLE, (0, 1), 'needle_insertion', []),
    'needle, 10 mm': ('needle', 10.0, ONE, NEEDLE, (0, 1), 'needle_insertion', []),
    'layers, 2 mm': ('disc', 2.0, LAYERS, 'tests/references/layers.csv', (1, 2), 'indentation', NO_WALL)}
MESHES = {  # size at the singular edges, along a needle's wall, growth, largest (mm)
    'P2-P1': ((1.6, 0.8, 0.8, 4.0), (0.8, 0.4, 0.5, 3.0), (0.4, 0.2, 0.4, 2.5), (0.2, 0.1, 0.35, 2.0), (0.1, 0.05, 0.3, 1.5)),
    'P1': ((0.2, 0.2, 0.3, 1.0), (0.1, 0.1, 0.2, 0.6), (0.05, 0.05, 0.12, 0.4))}


def mesh(kind, depth, layers, size, rows):
    """Half plane (r, z). rows: so many rows of elements in what the needle fills, which is left out without."""
    edge, wall, growth, largest = size
    tip, interfaces = H - depth, [z for z, _ in layers[:-1]]
    corners = {'plate': [(RADIUS, H, 1), (RADIUS, 0, 1)], 'disc': [(DISC, H, 1)], 'needle': [(A, H, 1), (A, tip, 1)]}[kind]
    corners += [] if kind == 'plate' else [(RADIUS, 0, 4)]

    def local(dim, tag, r, z, *_):
        sizes = [k * edge + growth * np.hypot(r - a, z - b) for a, b, k in corners] + [4 * edge + growth * abs(z - i) for i in interfaces]
        if kind == 'needle':
            sizes.append((depth / rows if rows else wall) + growth * np.hypot(max(r - A, 0), max(tip - z, 0)))
        return min(largest, *sizes)

    gmsh.initialize()
    gmsh.option.setNumber('General.Terminal', 0)
    gmsh.option.setNumber('Mesh.MeshSizeExtendFromBoundary', 0)
    occ, levels = gmsh.model.occ, [0.0, *interfaces, H]
    parts = [(2, occ.addRectangle(0, a, 0, RADIUS, b - a)) for a, b in zip(levels, levels[1:])]
    tools = [(0, occ.addPoint(a, b, 0)) for a, b, _ in corners] + ([(2, occ.addRectangle(0, tip, 0, A, depth))] if kind == 'needle' else [])
    filled = occ.fragment(parts, tools)[1][-1][0][1]
    occ.synchronize()
    if rows:
        for _, c in gmsh.model.getBoundary([(2, filled)], oriented=False):
            upright = np.ptp(np.array(gmsh.model.getBoundingBox(1, c)).reshape(2, 3)[:, 1]) > 0.5 * depth
            gmsh.model.mesh.setTransfiniteCurve(c, rows + 1 if upright else 3)
        gmsh.model.mesh.setTransfiniteSurface(filled)
    gmsh.model.mesh.setSizeCallback(local)
    gmsh.model.mesh.generate(2)
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    t = np.argsort(tags)[np.searchsorted(np.sort(tags), gmsh.model.mesh.getElementsByType(2)[1])].reshape(-1, 3)
    gmsh.finalize()
    p = xyz.reshape(-1, 3)[:, :2]
    if kind == 'needle' and not rows:
        t = t[(p[t, 0].mean(axis=1) > A) | (p[t, 1].mean(axis=1) < tip)]
    used, t = np.unique(t, return_inverse=True)
    return MeshTri(np.ascontiguousarray(p[used].T), np.ascontiguousarray(t.reshape(-1, 3).T))


class Body:
    """State x: displacements u_r, u_z of each node, then pressures. Components of gradients in the order rr, rz, zr, zz, tt."""

    def __init__(self, m, layers, mixed):
        S, Q = (Basis(m, e(), intorder=4 if mixed else 2) for e in (ElementTriP2 if mixed else ElementTriP1, ElementTriP1))
        at = lambda basis: np.array([np.broadcast_to(np.array(f[0]), S.dx.shape) for f in basis.basis]).transpose(1, 2, 0)
        r, z = S.global_coordinates() + np.zeros((1, 1, 1))
        self.X, self.nu, self.w, e = S.doflocs, 2 * S.N, 2 * np.pi * r * S.dx, len(r)
        self.B = np.zeros((*r.shape, 5, 2 * S.Nbfun))
        self.B[:, :, 0:2, 0::2] = self.B[:, :, 2:4, 1::2] = np.array([np.array(f[0].grad) for f in S.basis]).transpose(2, 3, 1, 0)
        self.B[:, :, 4, 0::2] = at(S) / r[..., None]
        region = np.searchsorted([z for z, _ in layers], z.mean(axis=1))
        self.mu = np.array([mu for _, mu in layers])[region][:, None]
        self.u = np.stack([2 * S.element_dofs.T, 2 * S.element_dofs.T + 1], axis=2).reshape(e, -1)
        self.M = at(Q)[..., :3 if mixed else 0]  # shape functions of the pressure
        own, q = np.unique((Q.element_dofs.T * 64 + region[:, None])[:, :self.M.shape[2]], return_inverse=True)
        self.p, self.size = self.nu + q.reshape(e, -1), self.nu + len(own)
        self.dofs = np.concatenate([self.u, self.p], axis=1)
        i, j = (np.repeat(self.dofs, self.dofs.shape[1], axis=1).ravel(), np.tile(self.dofs, self.dofs.shape[1]).ravel())
        self.upper = np.nonzero(i <= j)[0]
        keys, self.to = np.unique(i[self.upper] * self.size + j[self.upper], return_inverse=True)
        self.A = csr_matrix((np.zeros(len(keys)), keys % self.size, np.searchsorted(keys // self.size, np.arange(self.size + 1))), (self.size,) * 2)
        self.diagonal = np.searchsorted(keys, np.arange(self.size) * (self.size + 1))
        self.solver, self.analysed = PyPardisoSolver(mtype=-2), False

    def strain(self, x):
        """F and its determinant."""
        F = np.matmul(self.B.reshape(len(self.u), -1, self.u.shape[1]), x[self.u][..., None]).reshape(self.B.shape[:3])
        F[..., [0, 3, 4]] += 1
        return F, (F[..., 0] * F[..., 3] - F[..., 1] * F[..., 2]) * F[..., 4]

    def system(self, x, F, J, tangent=True):
        """Residual, and the tangents of the elements."""
        e, n = self.u.shape
        a, b, c, d, t = np.moveaxis(F, -1, 0)
        C = np.stack([d * t, -c * t, -b * t, a * t, a * d - b * c], axis=-1)  # dJ/dF
        kappa, I1, m, mixed, B = BULK * self.mu, (F * F).sum(axis=-1), self.mu * J ** (-2 / 3), self.M.size > 0, self.B.reshape(e, -1, n)
        p = np.matmul(self.M, x[self.p][:, :, None])[..., 0] if mixed else kappa * (J - 1)
        s, wM = p - m * I1 / (3 * J), self.w[..., None] * self.M
        r = np.concatenate([np.matmul((self.w[..., None] * (m[..., None] * F + s[..., None] * C)).reshape(e, 1, -1), B)[:, 0],
                            np.matmul((J - 1 - p / kappa)[:, None, :], wM)[:, 0]], axis=1)
        R = np.bincount(self.dofs.ravel(), r.ravel(), self.size)
        if not tangent:
            return R
        CF = C[..., :, None] * ((-2 / 3 * m / J)[..., None] * F)[..., None, :]
        T = C[..., :, None] * ((5 / 9 * m * I1 / J**2 + (0 if mixed else kappa))[..., None] * C)[..., None, :] + CF + CF.swapaxes(-1, -2)
        for i, j, v in ((0, 3, t), (0, 4, d), (1, 2, -t), (1, 4, -c), (2, 4, -b), (3, 4, a)):  # d2J/dF2
            T[..., i, j] += s * v
            T[..., j, i] += s * v
        T[..., range(5), range(5)] += m[..., None]
        K = np.zeros((e, *2 * self.dofs.shape[1:]))
        K[:, :n, :n] = np.matmul(B.swapaxes(1, 2), np.matmul(self.w[..., None, None] * T, self.B).reshape(e, -1, n))
        K[:, :n, n:] = np.matmul(np.matmul(C[:, :, None, :], self.B)[:, :, 0].swapaxes(1, 2), wM)
        K[:, n:, :n] = K[:, :n, n:].swapaxes(1, 2)
        K[:, n:, n:] = np.matmul(-self.M.swapaxes(1, 2) / kappa[..., None], wM)
        return R, K

    def newton(self, x, held, want, close):
        """From x to rest with x[held] = want[held], to a last change below `close`; None if it fails."""
        F, J = self.strain(x)
        for _ in range(25 if J.min() > 0 else 0):
            R, K = self.system(x, F, J)
            self.iterations += 1
            todo, free = np.where(held, want - x, 0.0), (~held)[self.dofs].astype(float)
            rhs = -R - np.bincount(self.dofs.ravel(), np.matmul(K, todo[self.dofs][:, :, None]).ravel(), self.size)
            rhs[held] = MU * todo[held]
            K *= free[:, :, None]
            K *= free[:, None, :]
            self.A.data[:] = np.bincount(self.to, K.ravel()[self.upper], len(self.A.data))
            self.A.data[self.diagonal[held]] = MU
            self.solver.set_phase(23 if self.analysed else 13)
            step, self.analysed, part = self.solver._call_pardiso(self.A, rhs).ravel(), True, 1.0
            while (state := self.strain(x + part * step))[1].min() <= 0 and part > 0.02:
                part *= 0.5
            x, (F, J), largest = x + part * step, state, np.abs(step[:self.nu]).max()
            if part == 1 and largest < close:
                return x
            if J.min() <= 0 or not largest < 1e3:
                return None


@functools.lru_cache(1)
def body_of(case, element, level, rows):
    kind, depth, layers = CASES[case][:3]
    return Body(mesh(kind, depth, layers, MESHES[element][level], rows), layers, element == 'P2-P1')


def implicit(case, element, level, steps, rows=0):
    """To the last depth in equal load steps. With rows the needle's tip goes there, without it is there from the start."""
    body, (kind, depth), last, begun = body_of(case, element, level, rows), CASES[case][:2], None, time.process_time()
    x, body.iterations, (r, z) = np.zeros(body.size), 0, body.X
    if body.analysed:
        body.solver.free_memory(everything=True)
        body.analysed = False
    for k in range(1, steps + 1):
        tip, part = (depth * k / steps, 1.0) if rows else (depth, k / steps)
        on = {'plate': z > H - 1e-6, 'disc': (z > H - 1e-6) & (r < DISC + 1e-6), 'needle': (r < A + 1e-6) & (z > H - tip - 1e-6)}[kind]
        held, want = np.zeros(body.size, bool), np.zeros(body.size)
        held[:body.nu:2], held[1:body.nu:2] = on | (z < 1e-6) | (r < 1e-6), on | (z < 1e-6)
        want[1:body.nu:2] = np.where(on, part * (-CD * (tip - H + z) if kind == 'needle' else -tip), 0.0)
        close = 1e-3 * np.abs(want).max()
        now = body.newton(2 * x - last, held, want, close) if last is not None else None
        now = body.newton(x, held, want, close) if now is None else now
        found = {'size': int((~held).sum()), 'steps': steps, 'force': None, 'why': f'no convergence at {depth * k / steps:.2f} mm, {steps} steps'}
        if now is None:
            return found
        x, last = now, x
        force = -1e-6 * body.system(x, *body.strain(x), tangent=False)[1:body.nu:2][on].sum()
    return {**found, 'force': force, 'cpu': time.process_time() - begun, 'took': body.iterations}


def at_once(case, element, level):
    """The run from rest in the fewest steps whose force the next run that converges confirms."""
    good = []
    for n in (1, 2, 4, 8, 16, 32, 64):
        run = implicit(case, element, level, n)
        good += [run] if run['force'] else []
        if run['force'] and len(good) > 1 and abs(good[-2]['force'] / run['force'] - 1) < 1e-3:
            return min(good[-2], implicit(case, element, level, good[-2]['steps']), key=lambda run: run['cpu'])
    forces = ', '.join(f'{run["steps"]}: {1e3 * run["force"]:.1f}' for run in good)
    return {**run, 'force': None, 'why': f'other equilibria with other steps (steps: mN) {forces}' if good else run['why']}



def twin(program, case, keys, rate, folder):
    """The twin's way to the last depth at 1 mm/s and so many poses per second."""
    _, depth, layers, *_, scene, own = CASES[case]
    if layers is LAYERS:
        text = subprocess.run([program, 'scene', 'show', scene], capture_output=True, text=True, check=True).stdout
        (scene := Path(folder) / 'layers.toml').write_text(f'{text}\n{REGIONS}')
    command = [program, 'solve', '--scene', scene, '--threads', '1', '--json', '--depth-m', str(1e-3 * depth), '--pose-hz', str(rate), *own]
    command, spent = command + [word for key in keys for word in ('--set', f'discretisation.{key}')], []
    for _ in range(1 if 'dimension=full' in keys else 2):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        said = json.loads(done.stdout)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime - said['timing']['build_s'])
    subprocess.run([*command, '--out', folder], capture_output=True)
    if done.returncode:
        print(case, keys, f'{rate:g} Hz:', done.stderr, file=sys.stderr)
    at, force = np.genfromtxt(Path(folder) / 'force.csv', delimiter=',', skip_header=1)[-1, 1:3]
    assert abs(1e3 * at - depth) < 1e-6, at
    return {'size': said['nodes'], 'force': force, 'cpu': min(spent), 'steps': said['poses'] - 1, 'took': said['steps'], 'warned': done.returncode}


def main():
    print('| case | method | nodes (twin) or unknowns | error of the force | CPU s in all | answers | steps | CPU ms per answer |\n|' + 8 * '---|')
    for case in sys.argv[2:] or CASES:
        kind, depth, _, table, columns, scene, _ = CASES[case]
        rows = np.genfromtxt(ROOT / table, delimiter=',', skip_header=1, usecols=columns)[:2 if 'layers' in table else None]
        reference = rows[np.abs(rows[:, 0] - 1e-3 * depth).argmin(), 1]
        text = subprocess.run([sys.argv[1], 'scene', 'show', scene], capture_output=True, text=True, check=True).stdout
        spacing = float(text.split('spacing_m = ')[1].split()[0])

        def tell(method, found, answers):
            method += ' (it warns)' if found.get('warned') else ''
            cells = f'none: {found.get("why")} | | | |'
            if found['force']:
                off, n = found['force'] / reference - 1, answers or found['steps']
                cells = f'{100 * off:+.2f} % | {found["cpu"]:.3f} | {n} | {found["took"]} | {1e3 * found["cpu"] / n:.3f}'
            print(f'| {case} | {method} | {found["size"]} | {cells} |', flush=True)

        with tempfile.TemporaryDirectory() as folder:
            clouds = [('mmls', 1, 1000), ('mmls', 1, 50 / depth), *(('mls', by, 1000) for by in (1, 2)), *(('tet4', by, 1000) for by in (1, 2, 4))]
            jobs = [(f'twin {m}, spacing / {by}, {hz:g} Hz', [f'method={m}', f'spacing_m={spacing / by}'], hz) for m, by, hz in clouds]
            jobs += [('twin mmls in three dimensions, 1000 Hz', ['dimension=full'], 1000)] if case in list(CASES)[:3] else []
            ours = [lambda job=job: tell(job[0], twin(sys.argv[1], case, *job[1:], folder), 0) for job in jobs]
            way = {'steps': 50, 'rows': 50 if kind == 'needle' else 0}
            theirs = [lambda e=e, l=l: tell(f'implicit {e}, one', at_once(case, e, l), 1) for e in MESHES for l in range(len(MESHES[e]))]
            paths = [(e, l) for e in MESHES for l in range(4 if e == 'P2-P1' else 2)]
            theirs += [lambda e=e, l=l: tell(f'implicit {e}, path', implicit(case, e, l, **way), 0) for e, l in paths]
            for i in range(max(len(ours), len(theirs))):
                for job in (*ours[i:i + 1], *theirs[i:i + 1]):
                    job()


if __name__ == '__main__':
    main()
