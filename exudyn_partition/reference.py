"""The full FE model under the same contact rows: the reference that errors are measured against."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .algebra.complementarity import Complementarity
from .algebra.factorisation import Factorisation, one_blas_thread
from .errors import InputError, StoppedRunWarning
from .fe.model import FEModel, node_dofs
from .fe.partition import Partition
from .fe.patches import Patch
from .results.history import History, at_times
from .support.arrays import Array
from .support.checks import (
    validate_callable,
    validate_choice,
    validate_integer,
    validate_items,
    validate_number,
    validate_positive,
    validate_text,
    validate_type,
    validate_vector,
)
from .support.interrupt import interruptible
from .support.progress import Progress
from .surfaces.points import ROWS
from .surfaces.rows import ContactRows, pair_surfaces
from .surfaces.surface import Surface

_MOST_STEPS = 100_000_000  # beyond which the histories alone take gigabytes, and the run weeks


@dataclass(frozen=True, eq=False)
class FullBody:
    """One body of the full FE model.

    Parameters
    ----------
    fem : FEModel
    partition : Partition
        Its contact patch is what can touch.
    patch : int or str, optional
        Which one, if there are several.
    position : (3,) array
        Offset of the body's points in space, as referencePosition of the partition body [m].
    velocity : (3,) array
        Initial velocity [m/s].
    mass : {"consistent", "lumped"}

    Raises
    ------
    InputError
        If an argument is no such thing, or the partition is of another mesh.
    """

    fem: FEModel
    partition: Partition
    position: Array = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    velocity: Array = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    mass: str = "consistent"
    patch: int | str | None = None

    def __post_init__(self) -> None:
        validate_type("fem", self.fem, FEModel, "fe_model()")
        validate_type("partition", self.partition, Partition, "Partition.ball()")
        self.partition.check_mesh(self.fem)
        object.__setattr__(self, "position", validate_vector("position", self.position))
        object.__setattr__(self, "velocity", validate_vector("velocity", self.velocity))
        validate_choice("mass", self.mass, ("consistent", "lumped"))
        object.__setattr__(self, "patch", self.partition.patch(self.patch))

    @property
    def surface(self) -> Surface:
        """The contact patch in place."""
        return Surface.of(self.fem.points, self.contact, self.position)

    @property
    def contact(self) -> Patch:
        """The contact patch."""
        return self.partition.patches[self.partition.patch(self.patch)]


class _HHT:
    """One body's Hilber-Hughes-Taylor integration, with the contact force's own part of the acceleration implicit.

    With a = -M^-1 K ((1 - alpha) u1 + alpha u0) and c = M^-1 G' lambda1 (Kane, Repetto, Ortiz, Marsden 1999):
    u1 = u0 + h v0 + h^2 ((1/2 - beta) a0 + beta a1) + h^2/2 c,  v1 = v0 + h ((1 - gamma) a0 + gamma a1) + h c.
    A step ends with its gaps closed exactly, and contact only ever takes energy. Were c part of a, as in HHT for smooth
    forces, nodes that are closed would ring from step to step and gain energy without bound when flat faces meet.
    """

    def __init__(self, body: FullBody, G: sp.csr_matrix, step: float, alpha: float) -> None:
        fem = body.fem
        self.K = fem.stiffness
        self.M = fem.mass if body.mass == "consistent" else fem.lumped_mass_matrix
        self.step, self.alpha = step, alpha
        self.beta, self.gamma = (1 + alpha) ** 2 / 4, 0.5 + alpha
        self.factor = Factorisation(self.M + (1 - alpha) * self.beta * step**2 * self.K)
        self.G = G
        loads = G.T.toarray()
        self.answer = self.step**2 / 2 * self.factor.solve(loads)
        self.push = Factorisation(self.M).solve(loads)
        self.u = np.zeros(fem.n_dofs)
        self.v = np.tile(body.velocity, fem.n_nodes)
        self.a = np.zeros(fem.n_dofs)

    def compliance(self) -> Array:
        """Gap at the end of the step per unit contact force, (nc, nc) [m/N]."""
        return self.G @ self.answer

    def predict(self) -> Array:
        """Advance without contact; returns G u at the end of the step."""
        h = self.step
        self.u_predicted = self.u + h * self.v + h**2 * (0.5 - self.beta) * self.a
        a = -self.factor.solve(self.K @ ((1 - self.alpha) * self.u_predicted + self.alpha * self.u))
        self.u_free = self.u_predicted + self.beta * h**2 * a
        return self.G @ self.u_free

    def correct(self, lam: Array) -> None:
        """Add the contact force and finish the step."""
        h, u = self.step, self.u_free
        contact: Array | float = 0.0
        if lam.any():
            contact, u = self.push @ lam, u + self.answer @ lam
        a = ((u - self.u_predicted) / h**2 - contact / 2) / self.beta
        self.v = self.v + h * ((1 - self.gamma) * self.a + self.gamma * a + contact)
        self.u, self.a = u, a

    def energy(self) -> float:
        """Kinetic and strain energy [J]."""
        return 0.5 * float(self.v @ (self.M @ self.v) + self.u @ (self.K @ self.u))


@one_blas_thread()
def simulate(
    bodies: Sequence[FullBody],
    *,
    end_time: float,
    step: float = 1e-6,
    points: Mapping[str, tuple[int, Array]] | None = None,
    alpha: float = 0.1,
    rows: str | ContactRows = "integrated",
    progress: Progress | None = None,
) -> History:
    """Integrate two full FE bodies in contact by HHT: one factorisation a body, exact complementarity each step.

    Parameters
    ----------
    bodies : two FullBody
        Slave, whose patch nodes are kept out, and master, whose facets they face.
    end_time, step : float
        [s]
    points : dict of str to (body index, (3,) point), optional
        Where velocities are recorded: at the node nearest to the point in the body's own coordinates [m].
    alpha : float
        Numerical damping, 0 to 1/3.
    rows : {"integrated", "node-to-segment"} or ContactRows
        The same rows as a partition contact has, with the first body as slave (`contact.rows.pair_surfaces`).
    progress : callable, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    History
        The force at a time is the mean of the steps before and after it. `info` holds `time_s` (stepping), `setup_s`
        (factorisations), `step_s`, `steps`, `dofs`, `contact_nodes`, `energy_error`. After Ctrl-C it ends where the
        run was, once the factorisations are done.

    Raises
    ------
    InputError
        If there are not two bodies, a number is out of range, or given rows are of other patches.
    EmptyRegionError, PenetrationError
        If the patches do not face each other, or overlap.

    Warns
    -----
    StoppedRunWarning
        If Ctrl-C ended the run.
    """
    slave, master = bodies = _two(bodies)
    if not 0 <= validate_number("alpha", alpha) <= 1 / 3:
        raise InputError(f"alpha: expected 0 to 1/3, got {alpha!r}")
    steps = _count(end_time, step)
    points = _validate_points(points)
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    begin = time.perf_counter()
    patch_nodes = [len(body.contact.nodes) for body in bodies]
    if isinstance(rows, ContactRows):
        _validate_rows(rows, *patch_nodes)
    else:
        validate_choice("rows", rows, ROWS)
        rows = pair_surfaces(slave.surface, master.surface, rows, placed_by="position of FullBody")
    sides = []
    for body, G in zip(bodies, rows.matrices(*patch_nodes), strict=True):
        wide = G @ _selection(node_dofs(body.contact.nodes), body.fem.n_dofs)
        sides.append(_HHT(body, wide, step, alpha))
    contact = Complementarity(sides[0].compliance() + sides[1].compliance())
    nodes = {name: (index, bodies[index].fem.nearest_node(point)) for name, (index, point) in points.items()}

    t = step * np.arange(steps + 1)
    force = np.zeros(steps + 1)  # force[n] acts from t[n - 1] to t[n]
    velocity = {name: np.empty((steps + 1, 3)) for name in nodes}
    for name, (index, node) in nodes.items():
        velocity[name][0] = sides[index].v[3 * node : 3 * node + 3]
    energy = sum(side.energy() for side in sides)
    setup_s, begin = time.perf_counter() - begin, time.perf_counter()
    done = 0
    with interruptible() as interrupt:
        while done < steps and not interrupt.asked:
            n = done + 1
            gap = rows.gap + sum(side.predict() for side in sides)
            lam = contact.solve(gap)
            for side in sides:
                side.correct(lam)
            force[n] = lam.sum()
            for name, (index, node) in nodes.items():
                velocity[name][n] = sides[index].v[3 * node : 3 * node + 3]
            done = n
            if progress:
                progress(n / steps)
    if done < steps:
        message = f"interrupted by the user; the history is kept up to t = {t[done]:.6g} s of {end_time:.6g} s"
        warnings.warn(message, StoppedRunWarning, stacklevel=3)
    kept = slice(0, done + 1)
    info = {
        "label": "full FE",
        "dofs": sum(body.fem.n_dofs for body in bodies),
        "contact_nodes": len(rows),
        "step_s": step,
        "steps": done,
        "alpha": alpha,
        "time_s": time.perf_counter() - begin,
        "setup_s": setup_s,
        "energy_error": sum(side.energy() for side in sides) / energy - 1 if energy else 0.0,
    }
    return History(t[kept], at_times(t[kept], force[kept]), {name: v[kept] for name, v in velocity.items()}, info)


def _two(bodies: Sequence[FullBody]) -> tuple[FullBody, FullBody]:
    found = validate_items("bodies", bodies, FullBody, "FullBody()")
    if len(found) != 2:
        raise InputError(f"bodies: expected two, slave and master, got {len(found)}")
    return found[0], found[1]


def _count(end_time: float, step: float) -> int:
    """Number of steps."""
    end_time, step = validate_positive("end_time", end_time, "s"), validate_positive("step", step, "s")
    if step > end_time * (1 + 1e-9):
        raise InputError(f"step: expected at most the end time, {end_time:.4g} s, got {step:.4g} s")
    if end_time / step > _MOST_STEPS:
        raise InputError(
            f"step: {end_time:.4g} s in steps of {step:.4g} s are {end_time / step:.3g} steps, expected at most "
            f"{_MOST_STEPS:.3g}. Are both in seconds?"
        )
    return round(end_time / step)


def _validate_points(points: Mapping[str, tuple[int, Array]] | None) -> dict[str, tuple[int, Array]]:
    """Return the points with the number of their body."""
    expected = "points: expected a dict of name: (number of the body, 0 or 1, and a point, (3,) [m])"
    if points is None:
        return {}
    if not isinstance(points, Mapping):
        raise InputError(f"{expected}, got {type(points).__name__}")
    found = {}
    for name, entry in points.items():
        if not isinstance(entry, tuple | list) or len(entry) != 2:
            raise InputError(f"{expected}, got {entry!r} for {name!r}")
        index = validate_integer(f"points[{name!r}][0]", entry[0], 0, 1)
        found[validate_text("points", name)] = index, validate_vector(f"points[{name!r}][1]", entry[1])
    return found


def _validate_rows(rows: ContactRows, n_slave: int, n_master: int) -> None:
    """Raise if rows are of patches with other nodes."""
    of_slave, of_master = int(rows.points.nodes.max(initial=-1)), int(rows.master.max(initial=-1))
    if of_slave >= n_slave or of_master >= n_master:
        raise InputError(
            f"rows: are of other patches, with more nodes than these bodies' {n_slave} and {n_master}; make them by "
            "contact.rows.pair_surfaces of these bodies' surfaces, slave first"
        )


def _selection(dofs: Array, n: int) -> sp.csr_matrix:
    """Rows that pick `dofs` out of n."""
    return sp.csr_matrix((np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), shape=(len(dofs), n))
