"""Two full FE models in contact, with the same rows as a partition contact."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence

import numpy as np

from ..algebra.blas_threads import one_blas_thread
from ..algebra.coulomb import Coulomb, friction_of
from ..errors import InputError, StoppedRunWarning
from ..fe.places import interpolation
from ..results.history import History
from ..support.arrays import Array, Vector
from ..support.checks import (
    validate_callable,
    validate_choice,
    validate_integer,
    validate_items,
    validate_number,
    validate_positive,
    validate_text,
    validate_vector,
)
from ..support.interrupt import interruptible
from ..support.progress import Progress
from ..support.warn import warn
from ..surfaces.points import ROWS, RowKind
from ..surfaces.rows import ContactRows, pair_surfaces
from .full_body import FullBody, rows_on_dofs
from .integrator import HHT
from .laws import Frictional, Frictionless
from .plastic_body import PlasticBody, plastic_step

_LOG = logging.getLogger(__name__)

_MOST_STEPS = 100_000_000  # with more, histories take gigabytes and the run takes weeks


@one_blas_thread()
def simulate(
    bodies: Sequence[FullBody],
    *,
    end_time: float,
    step: float = 1e-6,
    points: Mapping[str, tuple[int, Vector]] | None = None,
    alpha: float = 0.1,
    rows: RowKind | ContactRows = "integrated",
    friction: float | Coulomb | None = None,
    progress: Progress | None = None,
) -> History:
    """Integrate two full FE bodies in contact by HHT: one factorisation a body, exact complementarity each step.

    With friction, rows that stick do not move along the surface in a step. Rows that slip bear the coefficient times
    their normal force, against their slip. The coefficient of a row follows from its state and slip speed in the step
    before.

    Parameters
    ----------
    bodies : two FullBody
        Slave and master: the contact points of the slave must not enter the facets of the master.
    end_time, step : float
        [s]
    points : dict of str to (body index, (3,) point), optional
        Points on or in the bodies, in their own coordinates [m], whose velocities are recorded.
    alpha : float
        Numerical damping, 0 to 1/3.
    rows : {"integrated", "node-to-segment"} or ContactRows
        The same rows as a partition contact has, with the first body as slave (`surfaces.rows.pair_surfaces`).
    friction : float or Coulomb, optional
        Coefficient of friction, or Coulomb's law. Default: frictionless.
    progress : callable, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    History
        The force at a time is the mean of the steps before and after it. `info` holds `time_s` (stepping), `setup_s`
        (factorisations), `step_s`, `steps`, `dofs`, `contact_nodes`, `energy_error`. After Ctrl-C during the steps it
        ends with the last step. With friction it also has `tangential_force` and `dissipated`, which `energy_error`
        counts. With plastic flow `info` has `plastic_work_J` and the largest `plastic_strain` of each body that yields,
        and `plastic_states`, the lists of numbers of its `PlasticState` at the end.
        With friction `info` has `friction`, and for the end of the run `dissipated_J` and, for each row, `row_nodes`
        (nodes of the slave's patch), `row_states` (0 open, 1 sticks, 2 slips) and `slip_path_m`.

    Raises
    ------
    InputError
        If there are not two bodies, a number is out of range, or given rows are of other patches.
    ComplementarityError
        If forces with friction are not found, or not finite.
    EmptyRegionError, PenetrationError
        If the patches do not face each other, or overlap.

    Warns
    -----
    StoppedRunWarning
        If Ctrl-C ended the run.
    """
    slave, master = bodies = _two(bodies)
    alpha = validate_number("alpha", alpha)
    if not 0 <= alpha <= 1 / 3:
        raise InputError(f"alpha: expected 0 to 1/3, got {alpha!r}")
    steps, coulomb = _count(end_time, step), friction_of(friction)
    points = _validate_points(points)
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    begin = time.perf_counter()
    law = _law(slave, master, rows, coulomb, steps, step)
    sides = []
    for body, G in zip(bodies, law.matrices, strict=True):
        fem = body.fem
        mass = fem.mass if body.mass == "consistent" else fem.lumped_mass_matrix
        at_start = np.tile(body.velocity, fem.n_nodes)
        sides.append(HHT(mass, body.stiffness, rows_on_dofs(body, G), step, alpha=alpha, velocity=at_start))
    law.begin(sides[0].compliance() + sides[1].compliance())
    pairs = zip(bodies, sides, strict=True)
    yielding = [PlasticBody(body, side) for body, side in pairs if body.yields]
    places = {name: (index, *interpolation(bodies[index].fem.points, point)) for name, (index, point) in points.items()}

    t = step * np.arange(steps + 1)
    velocity = {name: np.empty((steps + 1, 3)) for name in places}

    def record(n: int) -> None:
        for name, (index, nodes, weights) in places.items():
            velocity[name][n] = weights @ sides[index].v.reshape(-1, 3)[nodes]

    record(0)
    energy = sum(side.energy() for side in sides) + sum(one.energy() for one in yielding)
    setup_s, begin = time.perf_counter() - begin, time.perf_counter()
    _LOG.info("reference: %d steps of %.4g s, %d contact rows, set up in %.3g s", steps, step, len(law.rows), setup_s)
    done = 0
    with interruptible() as interrupt:
        while done < steps and not interrupt.asked:
            n = done + 1
            lam = plastic_step(sides, yielding, law)
            law.record(lam, n)
            for side in sides:
                side.correct(lam)
            record(n)
            done = n
            if progress:
                progress(n / steps)
    if done < steps:
        message = f"interrupted by the user; the history is kept up to t = {t[done]:.6g} s of {end_time:.6g} s"
        warn(message, StoppedRunWarning)
    kept = slice(0, done + 1)
    info = {
        "label": "full FE",
        "dofs": sum(body.fem.n_dofs for body in bodies),
        "contact_nodes": len(law.rows),
        "step_s": step,
        "steps": done,
        "alpha": alpha,
        "time_s": time.perf_counter() - begin,
        "setup_s": setup_s,
        "energy_error": 0.0,
        **_told_of_yield(yielding),
    }
    if energy:
        after = sum(side.energy() for side in sides) + sum(one.energy() + one.work for one in yielding)
        info["energy_error"] = (after + law.dissipated) / energy - 1
    return law.history(t[kept], {name: v[kept] for name, v in velocity.items()}, info)


def _law(
    slave: FullBody,
    master: FullBody,
    rows: RowKind | ContactRows,
    friction: Coulomb | None,
    steps: int,
    step: float,
) -> Frictionless:
    """Contact of the two bodies."""
    patch_nodes = [len(body.contact.nodes) for body in (slave, master)]
    if isinstance(rows, ContactRows):
        _validate_rows(rows, *patch_nodes)
    else:
        validate_choice("rows", rows, ROWS)
        rows = pair_surfaces(slave.surface, master.surface, rows, placed_by="position of FullBody")
    if friction is None:
        return Frictionless(rows, patch_nodes, steps)
    return Frictional(rows, patch_nodes, steps, friction=friction, step=step)


def _told_of_yield(yielding: Sequence[PlasticBody]) -> dict[str, object]:
    """What `info` has of bodies that yield, at the end of the run."""
    if not yielding:
        return {}
    return {
        "plastic_work_J": [one.work for one in yielding],
        "plastic_strain": [float(one.state.equivalent.max()) for one in yielding],
        "plastic_states": [{k: v.tolist() for k, v in vars(one.state).items()} for one in yielding],
    }


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


def _validate_points(points: Mapping[str, tuple[int, Vector]] | None) -> dict[str, tuple[int, Array]]:
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
            f"rows: are of other patches, with more nodes than the {n_slave} and {n_master} of these bodies; make them "
            "by surfaces.rows.pair_surfaces of the surfaces of these bodies, slave first"
        )
