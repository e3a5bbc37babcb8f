"""Parts of the extreme cases: small bodies, one impact, and what must hold after it."""

import functools
import itertools
import tempfile
from dataclasses import dataclass
from pathlib import Path

import exudyn as exu
import meshio
import netgen.occ as occ
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

import exudyn_partition as ep
from exudyn_partition.contact.formulations.choices import Compliance
from exudyn_partition.contact.normal_rows import NormalRows

RADIUS = 10e-3
PLANE = ep.RigidPlane()
UNIT = ep.Material(E=1.0, nu=0.0, rho=1.0)
SAMPLED = 25  # times at which complementarity is checked


def f_cut_of(material, size):
    """Just above the first modes of a compact body of this radius [Hz]: 150 kHz for 10 mm of steel."""
    return 0.29 * material.bar_wave_speed / size


@functools.cache
def ball_model(radius=RADIUS, material=ep.STEEL, *, up=True, h=0.025, reach=0.12, order=2, axes="normal"):
    """FE model and partition of a ball that touches z = 0 at the origin; `h` and `reach` are shares of its radius."""
    sign = 1 if up else -1
    fine = ep.Refine((0, 0, 0), 0.5 * reach * radius, h * radius)
    shape = occ.Sphere(occ.Pnt(0, 0, sign * radius), radius)
    fem = ep.fe_model(shape, material, maxh=0.35 * radius, refine=[fine], grading=0.5, order=order)
    return fem, ep.Partition.ball(fem, (0, 0, 0), reach * radius, direction=(0, 0, -sign), axes=axes)


@functools.cache
def ball(radius=RADIUS, material=ep.STEEL, *, basis="contact-adapted", cut=1.0, **model):
    """A reduced ball; `cut` is its truncation frequency over `f_cut_of`."""
    return ep.reduce(*ball_model(radius, material, **model), basis=basis, f_cut=cut * f_cut_of(material, radius))


@functools.cache
def block(material=ep.STEEL, size=0.03, *, h=0.3e-3, reach=1.4e-3, basis="contact-adapted", order=2):
    """A reduced cube below z = 0, fine around the origin."""
    shape = occ.Box(occ.Pnt(-size / 2, -size / 2, -size), occ.Pnt(size / 2, size / 2, 0))
    fine = ep.Refine((0, 0, 0), 0.8 * reach, h)
    fem = ep.fe_model(shape, material, maxh=size / 4, refine=[fine], grading=0.5, order=order)
    part = ep.Partition.ball(fem, (0, 0, 0), reach)
    return ep.reduce(fem, part, basis=basis, f_cut=f_cut_of(material, size / 2))


@functools.cache
def ball_in_units(length, mass, time):
    """`ball()` with the same mesh in other units, given by a metre, a kilogram and a second in these units."""
    fem, part = ball_model()
    E = fem.material.E * mass / length / time**2
    material = ep.Material(E=E, nu=fem.material.nu, rho=fem.material.rho * mass / length**3)
    scaled = ep.FEModel(
        points=fem.points * length, cells=fem.cells, mass=fem.mass * mass, stiffness=fem.stiffness * mass / time**2,
        cell_mass=fem.cell_mass * mass, material=material, boundaries=fem.boundaries,
    )  # fmt: skip
    return ep.reduce(scaled, part, f_cut=f_cut_of(ep.STEEL, RADIUS) / time)


def grid(x, y, z):
    """Points and hexahedra of a grid."""
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(len(x), len(y), len(z))
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    n = [len(x) - 1, len(y) - 1, len(z) - 1]
    cells = [number[i : i + n[0], j : j + n[1], k : k + n[2]].ravel() for i, j, k in corners]
    return points, np.stack(cells, axis=1)


def tetrahedra(points, hexahedra):
    """Six tetrahedra for each hexahedron of a grid, along its diagonal."""
    corner_of = {(0, 0, 0): 0, (1, 0, 0): 1, (1, 1, 0): 2, (0, 1, 0): 3, (0, 0, 1): 4, (1, 0, 1): 5, (1, 1, 1): 6,
                 (0, 1, 1): 7}  # fmt: skip
    cells = []
    for order in itertools.permutations(range(3)):
        path = [np.zeros(3, dtype=int)]
        for axis in order:
            path.append(path[-1] + np.eye(3, dtype=int)[axis])
        cells.append(hexahedra[:, [corner_of[tuple(p)] for p in path]])
    cells = np.vstack(cells)
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    flip = np.linalg.det(edges) < 0
    cells[flip] = cells[flip][:, [1, 0, 2, 3]]
    return cells


def read(points, kind, cells, material, order=None):
    """FE model of a mesh that is written to a file and read again."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "mesh.vtu"
        meshio.Mesh(points, [(kind, cells)]).write(file)
        return ep.fe_model(file, material, order=order)


def bar_model(z, material, *, side=2.0, across=2, kind="tetra", order=2, end=0.0):
    """FE model and partition of a bar with element boundaries at z, whose end at `end` touches."""
    x = np.linspace(-side / 2, side / 2, across + 1)
    points, cells = grid(x, x, np.array(z))
    if kind == "tetra":
        cells = tetrahedra(points, cells)
    fem = read(points, kind, cells, material, order if kind == "tetra" else None)
    return fem, ep.Partition.ball(fem, (0, 0, end), 0.75 * side)


@dataclass(frozen=True)
class Run:
    """Outcome of an impact: result, bodies, contacts, and the momentum that others are relative to."""

    result: ep.Result
    bodies: list
    contacts: list
    scale: float

    @functools.cached_property
    def force(self):
        """Total force of all contacts, (n,) [N]."""
        return sum(contact.force(self.result) for contact in self.contacts)

    @functools.cached_property
    def energy(self):
        """Energy of bodies and contacts [J], at all samples; at few, where contacts are solved together."""
        together = any(len(contact.group) > 1 for contact in self.contacts)
        result = self.result.at(40) if together else self.result
        return sum(item.energy(result) for item in [*self.bodies, *self.contacts])

    def velocity(self, body=0):
        """Velocity of a body's centre of mass, (n, 3) [m/s]."""
        item = self.bodies[body]
        return item.momentum(self.result) / item.body.total_mass


def strike(method, slave, master=PLANE, *, speed=1.0, gap=0.0, place=(0, 0, 0), mass=None, contact=None, body=None,
           other=None, add=None, **options):  # fmt: skip
    """A body at `gap` above the plane or body at z = 0 comes down at `speed`.

    `contact`, `body` and `other` are options of the contact and of the two bodies; `add(mbs, items, contact)` adds the
    rest of the model.
    """
    mbs = exu.SystemContainer().AddSystem()
    above = np.add(place, (0, 0, gap))
    falling = {"referencePosition": above, "initialVelocity": [0, 0, -speed]} | (body or {})
    items = [ep.CreatePartitionBody(mbs, slave, name="upper", **falling)]
    if isinstance(master, ep.ReducedBody):
        resting = {"referencePosition": place} | (other or {})
        items.append(ep.CreatePartitionBody(mbs, master, name="lower", **resting))
        master = items[1]
    made = ep.CreatePartitionContact(mbs, items[0], master, **{"rows": "node-to-segment", **(contact or {})})
    if add is not None:
        add(mbs, items, made)
    mbs.Assemble()
    for key, value in list(options.items()):
        options[key] = value(mbs) if callable(value) and key == "step" else value
    result = ep.solve_dynamic(mbs, method=method, progress=lambda share: None, **options)
    return Run(result, items, [made], (mass or slave.total_mass) * max(speed, 1e-300))


def finite(run):
    """Return how many values of the results are not finite; gaps may be infinite."""
    values = [run.force, run.energy]
    for item in run.bodies:
        values += [item.coordinates(run.result), item.coordinates_t(run.result), item.momentum(run.result)]
    for contact in run.contacts:
        values += [contact.row_forces(run.result).data, contact.force_on_slave(run.result)]
        values.append(np.where(np.isnan(contact.gap(run.result)), np.nan, 0.0))
    return float(sum(np.count_nonzero(~np.isfinite(v)) for v in values))


def complementarity(run):
    """Largest violation of lambda >= 0, w >= 0 and lambda'w = 0 by the stored forces, for w = h + F lambda.

    Values of lambda are relative to its largest, values of w to the deepest h, at some times in contact. Gaps and
    flexibility are computed again at the stored coordinates, without the solver's active set.
    """
    worst = 0.0
    for contact in run.contacts:
        gaps, result = contact.mechanics.gaps.for_run(), run.result
        q = np.hstack([item.coordinates(result) for item, _ in contact.sides])
        forces, total = contact.row_forces(result), contact.force(result)
        closed = np.flatnonzero(total > 1e-3 * total.max())
        chosen = set(closed[np.linspace(0, len(closed) - 1, SAMPLED).astype(int)]) if len(closed) else set()
        for i in range(len(q)) if gaps.moving else sorted(chosen):
            h = gaps.at(q[i])
            if i not in chosen:
                continue
            rows = np.arange(len(h))
            lam = forces[i].toarray().ravel()[gaps.row_nodes]
            if h.min() >= 0:
                worst = max(worst, lam.sum() / total.max())
                continue
            w = h + NormalRows(gaps).flexibility(rows) @ lam
            parts = [-lam.min() / lam.max(), -w.min() / -h.min(), abs(lam @ w) / (lam.sum() * -h.min())]
            worst = max(worst, *parts)
    return float(worst)


def penetration(run):
    """Deepest gap of rows at the stored coordinates [m]."""
    contact = run.contacts[0]
    q = np.hstack([item.coordinates(run.result) for item, _ in contact.sides])
    gaps = contact.mechanics.gaps.for_run()
    return float(max(-gaps.at(x).min(initial=0.0) for x in q))


def kept(run, *, energy=2e-3, momentum=None, solve=True):
    """Return what must hold in every run that finishes: name -> (value, limit)."""
    result, contact = run.result, run.contacts[0]
    total = sum(item.momentum(result) for item in run.bodies)
    if len(contact.sides) == 1 and contact.elastic:
        push = sum(c.force_on_slave(result) for c in run.contacts)
        steps = np.diff(result.t)[:, None] * (push[1:] + push[:-1]) / 2
        total = total - np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
        default = 1e-6 if result.method == "explicit" else 2e-3
    else:
        default = 1e-8
    forces = [c.row_forces(result).data for c in run.contacts]
    pull = max((-f.min() / max(f.max(), 1e-300) for f in forces if f.size), default=0.0)
    checks = {
        "unfinished": (float(result.status != "finished"), 0.0),
        "not finite": (finite(run), 0.0),
        "pulling": (float(max(pull, 0.0)), 1e-9),
        "energy": (float(abs(run.energy / run.energy[0] - 1).max()) if run.energy[0] else 0.0, energy),
    }
    if len(contact.sides) == 2 or contact.elastic:
        drift = abs(total - total[0])[:, 2].max() / run.scale
        checks["momentum"] = (float(drift), default if momentum is None else momentum)
    if solve and contact.elastic and isinstance(contact.formulation, Compliance):
        checks["complementarity"] = (complementarity(run), 1e-6)
    return checks


def error(value, reference, limit):
    """Relative error and its limit."""
    return float(abs(value / reference - 1)), limit


def hertz(run, speed, radius=RADIUS, material=ep.STEEL, other=None, *, force=0.05, bounce=0.02, mass=None):
    """Hertz's peak force, and the speed after a central impact on something heavy."""
    expected = ep.hertz.impact(mass or run.bodies[0].body.total_mass, speed, radius, np.inf, material, other).peak_force
    checks = {"peak force": error(run.force.max(), expected, force)}
    if bounce:
        checks["speed after"] = error(run.velocity()[-1, 2], speed, bounce)
    return checks


def free_flexibility(fem, node, axis=2):
    """Displacement of a node by a unit force on it while the free body accelerates [m/N], by a sparse saddle point."""
    R = fem.rigid_modes
    MR = fem.mass @ R
    dof = 3 * node + axis
    load = np.zeros(fem.n_dofs)
    load[dof] = 1.0
    load -= MR @ np.linalg.solve(R.T @ MR, R[dof])
    scale = abs(fem.stiffness).max() / abs(MR).max()
    A = sp.bmat([[fem.stiffness, scale * sp.csr_matrix(MR)], [scale * sp.csr_matrix(MR.T), None]], format="csc")
    return float(scipy.sparse.linalg.spsolve(A, np.r_[load, np.zeros(6)])[dof])
