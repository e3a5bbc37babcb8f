"""Bodies in floating frames in a pass back over the samples of a run.

A step turns a frame on by its velocities u in the middle of the step, R = R_before exp(h u). Adjoints of rotations
belong to small turns about the axes of the frame's node, so that they go back by::

    turn' = exp(h u) turn',    u' = h J(h u)' turn',

with J the right Jacobian of SO(3). Inertia forces of a step depend on its coordinates and middle velocities, and on the
coordinates, velocities and accelerations before it; see `inertia_forces`. Contact forces f of a body act on the
constant mass as P(z) f.

Places of the nodes of a patch are x = r + A (X + growth + Phi z), growth by products of the middle velocities. Their
ways, normals and forces are taken in the body's axes. There small changes (way of r, turn, z') move a node by the
columns [1, axes of the node x arm, Phi], as if the frame did not turn; forces push by these, but turn with it. At
constant forces g on the nodes, in the body's axes, that gives, by the ways w of the nodes without that of r::

    turn' = sum w x g,    z' = sum Phi' (g x omega)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..frames.rotations import rotation_change, rotation_matrix, skew
from ..reduction.inertia import PAIRS, PLACE
from ..support.arrays import Array
from .moving import Frames

_FIRST, _SECOND = np.array(PAIRS).T
_SMALL = 1e-2  # angle [rad] below which a series has all digits


class FramesMotion(NamedTuple):
    """How frames move in a run: n samples of nb bodies and nq coordinates.

    Parameters
    ----------
    frames : Frames
    q, v, a : (n, nq) arrays
    turning : (n, nq) array
        Velocities by which bodies grow: in the middle of the step that ends at a sample, at the start those there.
    axes, change : (n, nb, 3, 3) arrays
        Axes of the bodies in space, and their change from q = 0.
    turns, ways : (n, nb, 3, 3) arrays
        Turn of each step in the node's axes, and how it changes with its rotation vector.
    products : (n, nb, 6) array
        By which bodies grow, zero where they do not.
    """

    frames: Frames
    q: Array
    v: Array
    a: Array
    turning: Array
    axes: Array
    change: Array
    turns: Array
    ways: Array
    products: Array

    @classmethod
    def of(cls, frames: Frames, q: Array, v: Array, a: Array, h: float) -> FramesMotion:
        """Motion of a run with steps h [s]."""
        turning, n, nb = v.copy(), len(q), len(frames.rotation)
        turning[1:] -= 0.5 * h * a[1:]
        axes, change, turns, ways = np.empty((4, n, nb, 3, 3))
        products = np.zeros((n, nb, 6))
        for b in range(nb):
            rotation, back = frames.dofs[frames.places[b] + 3 :][:3], frames.node_axes[b].T
            axes[:, b] = rotation_matrix(frames.rotation[b] + q[:, rotation]) @ back
            change[:, b] = rotation_change(frames.rotation[b], q[:, rotation]) @ back
            step = h * turning[:, rotation]
            step[0] = 0.0
            turns[:, b], ways[:, b] = rotation_matrix(step), _right_jacobian(step)
            of_node = turning[:, rotation]
            omega = of_node @ back
            found = omega[:, _FIRST] * omega[:, _SECOND]
            fast = ~(np.einsum("na,na->n", of_node, of_node) <= frames.slow[b])
            products[:, b] = found * (fast & ~(abs(found) @ frames.largest[b] <= frames.least[b]))[:, None]
        return cls(frames, q, v, a, turning, axes, change, turns, ways, products)

    def dofs(self, b: int) -> Array:
        """Numbers of the coordinates of a body."""
        return self.frames.dofs[slice(*self.frames.places[b : b + 2])]

    def gone_back(self, sample: int, by_q: Array, h: float) -> tuple[Array, Array]:
        """Derivatives by coordinates of a sample, (k, nq), as those by the step's velocities and the sample before."""
        before, by_u = by_q.copy(), h * by_q
        for b in range(len(self.frames.rotation)):
            rotation = self.dofs(b)[3:6]
            before[:, rotation] = by_q[:, rotation] @ self.turns[sample, b].T
            by_u[:, rotation] = h * by_q[:, rotation] @ self.ways[sample, b]
        return before, by_u

    def by_growth(self, sample: int, b: int, by_products: Array) -> Array:
        """See `by_growth`, of a body in a sample."""
        rotation = self.dofs(b)[3:6]
        axes, products = self.frames.node_axes[b], self.products[sample, b]
        return by_growth(self.turning[sample, rotation], axes, products, by_products)


def by_growth(turning: Array, node_axes: Array, products: Array, by_products: Array) -> Array:
    """Derivatives by the angular velocity, (3,), in the node's axes, (k, 3), from those by its products, (k, 6)."""
    if not products.any():  # too slow to show
        return np.zeros((len(by_products), 3))
    found: Array = 2 * (by_products * np.where(_FIRST == _SECOND, 1.0, 0.5))[:, PLACE] @ (node_axes @ turning)
    return found @ node_axes


def _right_jacobian(ways: Array) -> Array:
    """How a turn, about the body's axes, changes with its rotation vector: (n, 3, 3) of vectors, (n, 3)."""
    angle, turn = np.linalg.norm(ways, axis=1)[:, None, None], skew(ways)
    size = np.maximum(angle, _SMALL)
    third = np.where(angle < _SMALL, 1 / 6 - angle**2 / 120 + angle**4 / 5040, (size - np.sin(size)) / size**3)
    found: Array = np.eye(3) - 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * turn + third * (turn @ turn)
    return found


class FramesBack(NamedTuple):
    """Bodies in floating frames in m samples, as the pass back takes them; see `Frames` and `FramesMotion`.

    Parameters
    ----------
    places, dofs, node_axes, tensor, inverse, numbers, integrals, cross, coupled, constant : arrays
        See `Frames`.
    axes, turns, ways, products : (m, nb, 3, 3), ..., (m, nb, 6) arrays
    q, turning, q_before, v_before, a_before : (m, nq) arrays
        Before: at the sample before.
    by_turning : (m, k, nq) array
        Derivatives of the numbers by `turning`.
    a : (k, nq) array
        Adjoint of the accelerations of a sample, from the step after it.
    u : (k, nq) array
        Room for derivatives by `turning` of the present sample.
    q_then, v_then : (k, nq) arrays
        Room for derivatives by coordinates and velocities of the sample before, beside those that all bodies have.
    pushed, moved : (k, nq) arrays
        Room for ways of coordinates that forces of contacts have, and for derivatives by coordinates, in bodies' axes.
    force : (nq,) array
        Room for generalised forces of contacts.
    """

    places: Array
    dofs: Array
    node_axes: Array
    tensor: Array
    inverse: Array
    numbers: Array
    integrals: Array
    cross: Array
    coupled: Array
    constant: Array
    axes: Array
    turns: Array
    ways: Array
    products: Array
    q: Array
    turning: Array
    q_before: Array
    v_before: Array
    a_before: Array
    by_turning: Array
    a: Array
    u: Array
    q_then: Array
    v_then: Array
    pushed: Array
    moved: Array
    force: Array

    @classmethod
    def of(cls, motion: FramesMotion, samples: slice, by_turning: Array, a: Array) -> FramesBack:
        """Those of some samples; `a`, (k, nq), is what the samples after leave."""
        f, (k, nq) = motion.frames, a.shape
        before = np.maximum(np.arange(samples.start, samples.stop) - 1, 0)
        u, q_then, v_then, pushed, moved = np.zeros((5, k, nq))
        return cls(
            f.places, f.dofs, f.node_axes, f.tensor, f.inverse, f.numbers, f.integrals, f.cross, f.coupled, f.constant,
            motion.axes[samples], motion.turns[samples], motion.ways[samples], motion.products[samples],
            motion.q[samples], motion.turning[samples], motion.q[before], motion.v[before], motion.a[before],
            by_turning, a, u, q_then, v_then, pushed, moved, np.zeros(nq),
        )  # fmt: skip

    def body(self, b: int) -> tuple[Array, Array, Array]:
        """Numbers of a body's coordinates, and its integrals, see `InertiaIntegrals`."""
        own = self.dofs[slice(*self.places[b : b + 2])]
        n = len(own) - 6
        inertia = self.numbers[self.integrals[b] :][: 6 * (n + 1) ** 2].reshape(6, n + 1, n + 1)
        return own, inertia, self.numbers[self.cross[b] :][: 3 * n * n].reshape(3, n, n)


class _Place(NamedTuple):
    """Inertia of a body at a deformation: half the derivative of J (6, n), J, C, S = J - C C' and its inverse."""

    integrals: Array
    cross: Array
    tensor: Array
    by_place: Array
    J: Array
    C: Array
    inverse: Array

    @classmethod
    def of(cls, integrals: Array, cross: Array, tensor: Array, z: Array) -> _Place:
        place = np.concatenate([[1.0], z])
        by_place, C = integrals @ place, -(cross @ z)
        J = (by_place @ place)[PLACE]
        return cls(integrals, cross, tensor, by_place[:, 1:], J, C, np.linalg.inv(J - C @ C.T))

    def by_z(self, J: Array, C: Array) -> Array:
        """Derivatives by z, (k, n), from those by J, (k, 3, 3), and C, (k, 3, n)."""
        return np.asarray(2 * _components(J) @ self.by_place + np.einsum("kai,aji->kj", C, self.cross))

    def on_mass(self, by: Array, torque: Array, force: Array) -> tuple[Array, Array, Array]:
        """Adjoint of P, (k, 3 + n), at a torque and forces: derivatives by these, by J, and by C."""
        C, omega_t = self.C, self.inverse @ (torque - self.C @ force)
        mu = (by[:, :3] @ self.tensor - by[:, 3:] @ C.T) @ self.inverse
        both = mu[:, :, None] * omega_t
        by_C = (both + both.swapaxes(1, 2)) @ C - mu[:, :, None] * force - omega_t[:, None] * by[:, None, 3:]
        return np.hstack([mu, by[:, 3:] - mu @ C]), -both, by_C


def push_masses(frames: FramesBack, s: int, y: Array) -> None:
    """Set ways by which forces of contacts push bodies, in their axes, from those by which masses are pushed, (k, nq).

    Also adds what the derivatives by coordinates have of the masses.
    """
    for b in range(len(frames.node_axes)):
        dofs, integrals, cross = frames.body(b)
        own, force = dofs[3:], frames.force[dofs]
        frames.pushed[:, dofs[:3]] = y[:, dofs[:3]] @ frames.axes[s, b]
        if not frames.constant[b]:
            here = _Place.of(integrals, cross, frames.tensor[b], frames.q[s, dofs[6:]])
            frames.pushed[:, own], by_J, by_C = here.on_mass(y[:, own], force[3:6], force[6:])
            frames.moved[:, dofs[6:]] += here.by_z(by_J, by_C)


def turn_back(frames: FramesBack, s: int, h: float, q: Array, v: Array) -> None:
    """Go back over the step that ends at sample s with turns of frames; all else adds h q to v, both (k, nq)."""
    for b in range(len(frames.node_axes)):
        rotation = frames.body(b)[0][3:6]
        turn = q[:, rotation].copy()
        q[:, rotation] = turn @ frames.turns[s, b].T
        v[:, rotation] += h * (turn @ frames.ways[s, b] - q[:, rotation])


def _components(J: Array) -> Array:
    """Sums of the entries of matrices, (k, 3, 3), that each of the six components has: (k, 6)."""
    both = J + J.swapaxes(1, 2)
    found: Array = both[:, _FIRST, _SECOND] * np.where(_FIRST == _SECOND, 0.5, 1.0)
    return found


def back_over_inertia(frames: FramesBack, s: int, y: Array, mass: Array, stiffness: Array, half_step: float) -> Array:
    """Go back over inertia forces of sample s: derivatives by its coordinates, (k, nq); see `FramesBack` for others.

    `y`, (k, nq), is the adjoint of the accelerations over the masses, which is completed. `half_step` is zero at the
    start.
    """
    found = np.zeros_like(y)
    frames.u[:], frames.q_then[:], frames.v_then[:] = frames.by_turning[s], 0.0, 0.0
    for b in range(len(frames.node_axes)):
        dofs, integrals, cross = frames.body(b)
        own, modes, rotation = dofs[3:], dofs[6:], dofs[3:6]
        y[:, dofs] += frames.a[:, dofs] / mass[dofs]
        y[:, rotation] = (mass[rotation] * y[:, rotation]) @ frames.inverse[b]
        frames.a[:, dofs] = 0.0
        K, z, u = stiffness[modes], frames.q[s, modes], frames.turning[s, own]
        here = _Place.of(integrals, cross, frames.tensor[b], z)
        start = u + half_step * frames.a_before[s, own]
        start[3:] -= half_step * K * (z - frames.q_before[s, modes])
        gained = start[3:] - frames.v_before[s, modes]
        end = start.copy()
        end[3:] += 2 * half_step * (start[:3] @ (cross @ gained))
        by_z, by_v = _over_force(here, end, y[:, own], K * z, K, coupled=bool(frames.coupled[b]))
        by_gained = 2 * half_step * np.einsum("a,kj,aji->ki", start[:3], by_v[:, 3:], cross)
        by_v[:, :3] += 2 * half_step * by_v[:, 3:] @ (cross @ gained).T
        by_v[:, 3:] += by_gained
        frames.v_then[:, modes] -= by_gained
        frames.u[:, own] += by_v
        frames.a[:, own] = half_step * by_v
        elastic = half_step * K * by_v[:, 3:]
        frames.q_then[:, modes] += elastic
        found[:, modes] += by_z - elastic
    return found


def _over_force(
    here: _Place, v: Array, y: Array, elastic: Array, stiffness: Array, *, coupled: bool
) -> tuple[Array, Array]:
    """Derivatives by z, (k, n), and by velocities v, (k, 3 + n), of y times `inertia_force`, (k, 3 + n)."""
    omega, z_t, b = v[:3], v[3:], here.by_place
    J_t, L = 2 * (b @ z_t)[PLACE], here.J @ omega + here.C @ z_t
    weights = omega[_FIRST] * omega[_SECOND] * np.where(_FIRST == _SECOND, 1.0, 2.0)
    crossed = here.cross @ z_t
    torque, force = -np.cross(omega, L) - J_t @ omega, weights @ b + 2 * omega @ crossed
    by_z, by, by_J, by_C = np.zeros((len(y), len(z_t))), y, np.zeros((len(y), 3, 3)), np.zeros((len(y), *here.C.shape))
    if coupled:
        by, by_J, by_C = here.on_mass(y, torque, force - elastic)
        by_z += stiffness * (y[:, 3:] - by[:, 3:])
    of_torque, of_force = by[:, :3], by[:, 3:]
    of_L, of_J_t = np.cross(omega, of_torque), -of_torque[:, :, None] * omega
    by_J, by_C = by_J + of_L[:, :, None] * omega, by_C + of_L[:, :, None] * z_t
    stretch = _components(of_J_t)
    by_place = 2 * stretch[:, :, None] * z_t + weights[:, None] * of_force[:, None]
    by_omega = np.cross(of_torque, L) - of_torque @ J_t + of_L @ here.J + 2 * of_force @ crossed.T
    by_omega += 2 * (of_force @ b.T)[:, PLACE] @ omega
    by_z_t = of_L @ here.C + 2 * stretch @ b + 2 * np.einsum("a,kj,aji->ki", omega, of_force, here.cross)
    by_z += np.einsum("kci,cij->kj", by_place, here.integrals[:, 1:, 1:])
    return by_z + here.by_z(by_J, by_C), np.hstack([by_omega, by_z_t])
