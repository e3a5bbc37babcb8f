"""The loops over nodes of bodies in motion: compiled if numba is there, else by NumPy.

This is the only module of `frames` that knows which. `kernels` beside it has the compiled loops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..reduction.geometric_stiffness import GeometricStiffness
from ..reduction.inertia import InertiaIntegrals
from ..support.arrays import Array, as_read_only, plain
from ..support.compiled import kernels
from .inertia import Inertia, angular_acceleration
from .kinematics import Rows, node_fields
from .rotations import rotation_change, rotation_matrix, total_moment

if TYPE_CHECKING:
    from .node_kernels import FlatNodes

LARGE = 30_000  # entries of the rows at nodes from which on those of unloaded nodes are left out


def flat_nodes(
    active: Array,
    motion: tuple[Array, Array, Rows, Array],
    frame: tuple[Array, Array, Array],
    *,
    floats: bool,
) -> FlatNodes:
    """Nodes of a patch as compiled loops take them.

    Parameters
    ----------
    active : (k,) int array
        Their numbers in the patch.
    motion : four arrays
        Their places at q = 0 and those in the body's axes, (k, 3) [m]; rows, (3k, n), and growth, (3k, 6) or empty.
        With sparse rows loops set no places.
    frame : three arrays
        Rotation vector and axes of the frame's node at q = 0, see `FloatingKinematics`, and the body's axes then.
    floats : bool
        Whether the frame floats.
    """
    compiled = kernels("frames", "node_kernels")
    assert compiled is not None, "asked for what is only done at once"
    start, arms, rows, growth = motion
    if not isinstance(rows, np.ndarray):
        active, start, arms, rows, growth = active[:0], start[:0], arms[:0], np.zeros((0, rows.shape[1])), growth[:0]
    # Loops would be compiled again for arrays of another layout, or that cannot be written to.
    arrays = [np.require(values, float, ["C", "W"]) for values in (start, arms, rows, growth, *frame)]
    found: FlatNodes = compiled.flat_nodes((np.require(active, np.int64, ["C", "W"]), *arrays), floats)
    return found


def moved_places(start: Array, rows: Rows, q: Array) -> Array:
    """Places start + rows q of nodes, (..., k, 3) [m], at coordinates q, (..., n).

    Parameters
    ----------
    start : (k, 3) array
        [m]
    rows : (3k, n) array or csr matrix
    q : (..., n) array
    """
    if q.ndim == 1 and isinstance(rows, np.ndarray) and (compiled := kernels("frames")):
        found: Array = compiled.moved_places(start, rows, q)
        return found
    return start + node_fields(rows, q)


def on_shapes(rows: Rows, forces: Array) -> Array:
    """Generalised forces, (n,), of forces on nodes, (k, 3) [N], by the nodes' rows, (3k, n)."""
    if isinstance(rows, np.ndarray) and (compiled := kernels("frames")):
        found: Array = compiled.on_shapes(rows, forces)
        return found
    generalised: Array = rows.T @ forces.ravel()
    return generalised


def places(q: Array, start: Array, rotation: Array, node_axes: Array, arms: Array, rows: Array) -> Array:
    """Places of nodes, (..., k, 3) [m], of a body in a floating frame at coordinates q, (..., 6 + n).

    They are sums of the places at q = 0 and of the ways from there, whose rounding errors are relative to the ways.

    Parameters
    ----------
    q : (..., 6 + n) array
    start : (k, 3) array
        Places at q = 0 [m].
    rotation, node_axes : (3,), (3, 3) arrays
        Rotation vector and axes of the frame's node at q = 0, see `FloatingKinematics`.
    arms : (k, 3) array
        Nodes of the undeformed body, in its axes [m].
    rows : (3k, n) array
    """
    if q.ndim == 1 and (compiled := kernels("frames")):
        found: Array = compiled.places(plain(q), start, rotation, node_axes, arms, rows)
        return found
    A, change = _axes(q, rotation, node_axes), rotation_change(rotation, q[..., 3:6]) @ node_axes.T
    way = q[..., None, :3] + node_fields(rows, q[..., 6:]) @ A.swapaxes(-1, -2) + arms @ change.swapaxes(-1, -2)
    place: Array = start + way
    return place


def in_axes(q: Array, rotation: Array, node_axes: Array, directions: Array) -> Array:
    """Directions in space, (m, 3), in the axes of a floating body at coordinates q, (6 + n,); see `places`."""
    if directions.flags.c_contiguous and (compiled := kernels("frames")):
        found: Array = compiled.in_axes(q, rotation, node_axes, as_read_only(directions))
        return found
    turned: Array = directions @ _axes(q, rotation, node_axes)
    return turned


def generalised(q: Array, rotation: Array, node_axes: Array, arms: Array, rows: Array, forces: Array) -> Array:
    """Generalised forces, (6 + n,), of forces on nodes, (k, 3) [N], of a body in a floating frame: see `places`.

    The torque is in the node's axes [N m].
    """
    if compiled := kernels("frames"):
        found: Array = compiled.generalised(q, rotation, node_axes, arms, rows, forces)
        return found
    local = forces @ _axes(q, rotation, node_axes)
    if rows.size > LARGE:
        loaded = np.flatnonzero(forces.any(axis=1))
        local, arms = local[loaded], arms[loaded]
        rows = rows.reshape(len(forces), 3, rows.shape[1])[loaded].reshape(3 * len(loaded), rows.shape[1])
    torque = total_moment(arms + node_fields(rows, q[6:]), local) @ node_axes
    return np.concatenate([forces.sum(axis=0), torque, rows.T @ local.ravel()])


def on_constant_mass(inertia: Inertia, z: Array, force: Array) -> Array:
    """Forces, (6 + n,), that act on the constant mass diag(m, J, 1) as `force`, (6 + n,), acts on the true mass.

    The true mass is that at the deformation z, (n,). See `FloatingKinematics.on_constant_mass`.
    """
    if isinstance(inertia, InertiaIntegrals) and (compiled := kernels("frames")):
        found: Array = compiled.on_constant_mass(inertia.inertia, inertia.cross, inertia.tensor, z, force)
        return found
    J, C = inertia.of_place(z)
    omega_t = angular_acceleration(J, C, force[3:6], force[6:])
    return np.concatenate([force[:3], inertia.tensor @ omega_t, force[6:] - C.T @ omega_t])


def frame_force(
    inertia: Inertia,
    elastic: Array,
    change: Array,
    coupling: bool,
    q: Array,
    q_t: Array,
    start: tuple[Array, Array],
    half_step: float,
) -> Array | None:
    """Inertia forces of a body, (6 + n,), see `InertiaForces.on_body`; None if no loop does it in one call.

    Parameters
    ----------
    inertia : Inertia
    elastic, change : (n,) arrays
        Elastic forces, of which only `coupling` asks, and what they change by since the start of a step of
        VelocityVerlet.
    coupling : bool
    q, q_t : (6 + n,) arrays
    start : two (3 + n,) arrays
        Velocities and accelerations at the start of that step.
    half_step : float
        Half of its length [s]; zero if velocities are those of the end.
    """
    if isinstance(inertia, InertiaIntegrals) and (compiled := kernels("frames")):
        integrals = inertia.inertia, inertia.cross, inertia.tensor
        found: Array = compiled.frame_force(*integrals, elastic, change, coupling, q, q_t, start, half_step)
        return found
    return None


def inertia_derivatives(inertia: Inertia, omega: Array, z: Array, z_t: Array) -> tuple[Array, Array] | None:
    """Derivatives of inertia forces, see `InertiaForces.derivatives`; None as for `frame_force`."""
    if isinstance(inertia, InertiaIntegrals) and (compiled := kernels("frames")):
        found: tuple[Array, Array] = compiled.inertia_derivatives(inertia.inertia, inertia.cross, omega, z, z_t)
        return found
    return None


def stiffening_force(stiffening: GeometricStiffness, q: Array) -> Array:
    """Forces of geometric stiffness, (n,), see `GeometricStiffness.force`, at coordinates q, (n,)."""
    if compiled := kernels("frames"):
        found: Array = compiled.stiffening_force(stiffening.states, stiffening.matrices, stiffening.motion(q))
        return stiffening.on_coordinates(found)
    return stiffening.force(q)


def stiffening_at_guess(
    stiffening: GeometricStiffness,
    tangent: Array,
    dynamic: Array,
    errors: Array,
    motion: Array,
    anchor: Array,
    at_anchor: Array,
) -> Array:
    """Forces of geometric stiffness, (k,), linear about an anchor, at the solver's guess of the end of a step.

    The anchor is a better guess: to the solver's, its errors are added as they change from step to step, by one of
    three orders, the one that was best in the step before.

    Parameters
    ----------
    stiffening : GeometricStiffness
    tangent : (k, k) array
    dynamic : (k,) array
        Dynamic stiffnesses of the motions, by which sizes of motions and forces are compared.
    errors : (3, k) array
        Of the solver's guesses of the last three steps, newest first.
    motion, anchor, at_anchor : (k,) arrays
        The solver's guess; the anchor and the force there, which are set.
    """
    if compiled := kernels("frames"):
        found: Array = compiled.stiffening_at_guess(
            stiffening.states, stiffening.matrices, tangent, dynamic, errors, motion, anchor, at_anchor
        )
        return found
    first, second, third = errors
    left = [dynamic @ error**2 for error in (first, first - second, first - 2 * second + third)]
    anchor[:] = motion + (np.zeros_like(first), first, 2 * first - second)[int(np.argmin(left))]
    at_anchor[:] = stiffening.force_on_motion(anchor)
    linear: Array = at_anchor + tangent @ (motion - anchor)
    return linear


def stiffening_in_step(
    stiffening: GeometricStiffness,
    tangent: Array,
    dynamic: Array,
    guess: Array,
    share: float,
    motion: Array,
    anchor: Array,
    at_anchor: Array,
) -> tuple[Array, bool]:
    """Forces of geometric stiffness, (k,), in a step, and whether they are linear about the anchor.

    They are, while what is missing then would change the step by at most a share of what the solver changed of its
    guess, (k,). Otherwise the anchor is set anew, to the motion. For the rest see `stiffening_at_guess`.
    """
    if compiled := kernels("frames"):
        found: tuple[Array, bool] = compiled.stiffening_in_step(
            stiffening.states, stiffening.matrices, tangent, dynamic, guess, share, motion, anchor, at_anchor
        )
        return found
    linear, force = at_anchor + tangent @ (motion - anchor), stiffening.force_on_motion(motion)
    if np.sum((force - linear) ** 2 / dynamic) <= share**2 * (dynamic @ (motion - guess) ** 2):
        return linear, True
    anchor[:], at_anchor[:] = motion, force
    return force, False


def _axes(q: Array, rotation: Array, node_axes: Array) -> Array:
    """Axes of the body in space, (..., 3, 3)."""
    axes: Array = rotation_matrix(rotation + q[..., 3:6]) @ node_axes.T
    return axes
