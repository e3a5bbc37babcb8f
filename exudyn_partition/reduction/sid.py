"""Standard input data (SID) of a flexible body, as multibody codes such as Simpack, and libraries of Modelica, read it.

The reference frame is the mean one at the centre of mass, in the axes of the mesh, so that the shapes have no linear or
angular momentum: mdCM, Ct and the constant part of Cr are zero, and Me is the identity. Linear and angular equations:

    m (a - g) = f
    J(q) w_t + C(q)' q_tt + Gr(q_t) w + w x J(q) w = tau
    q_tt + C(q) w_t + Ge(q_t) w + Oe(q) [wx^2, wy^2, wz^2, wx wy, wy wz, wx wz] + Ke q = f_q

They are those of `frames.inertia_forces` to the first order in q: quadratic parts of J, and w x C q_t, are left out.

Geometric stiffness of a force f at a frame, K0F, is minus the slope of its phi, for f_q = phi(q)' f; of a moment, K0p,
minus that of psi. That of rotation, K0w, is in the slope of Oe. Inertia balances each of these loads here, so that
those of accelerations, K0t and K0r in Ct and Cr, are in them: m (a - g) is the sum of the forces.

O. Wallrapp, Standard input data of flexible members in multibody systems (1993); R. Schwertassek and O. Wallrapp,
Dynamik flexibler Mehrkörpersysteme (1999), table 6.9.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array
from .inertia import PLACE, InertiaIntegrals

_J_ORDER = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_OE_ORDER = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
_ZERO, _DIAGONAL, _GENERAL, _IDENTITY = 0, 1, 3, 4  # structures of matrices


class Frame(NamedTuple):
    """A frame of the body where others attach.

    Parameters
    ----------
    number : int
    origin : (3,) array
        From the centre of mass, undeformed [m].
    phi, psi : (3, n) array
        Its translations and rotations by the elastic coordinates.
    of_forces, of_moments : (3, n, n) array, optional
        Geometric stiffness of unit forces and moments on it.
    """

    number: int
    origin: Array
    phi: Array
    psi: Array
    of_forces: Array | None = None
    of_moments: Array | None = None


def sid_lines(
    mass: float,
    inertia: InertiaIntegrals,
    omega: Array,
    frames: Sequence[Frame],
    names: Sequence[str],
    of_rotation: Array | None = None,
) -> Iterator[str]:
    """Lines of a file of standard input data.

    Parameters
    ----------
    mass : float
        [kg]
    inertia : InertiaIntegrals
        Of n shapes of unit modal mass.
    omega : (n,) array
        Their circular frequencies [rad/s].
    frames : sequence of Frame
    names : sequence of str
        Of the shapes.
    of_rotation : (6, n, n) array, optional
        Geometric stiffness of the centrifugal loads of products of angular velocities, in order of `PAIRS`; those of
        two axes count both.
    """
    n, first, second = len(omega), inertia.inertia[:, 0, 1:], inertia.inertia[:, 1:, 1:]
    yield f"{len(frames):5d}{n:5d}    :No. nodes, No. modes: SI units, mean axes at the centre of mass, no damping"
    yield " part"
    yield "      new modal                                 ="
    yield "           refmod"
    yield f"                mass                            = {_number(mass)}"
    yield f"                nelastq                         = {n:5d}"
    for i, name in enumerate(names):
        yield f"                ielastq ({i + 1:4d})                  = {name}"
    yield "           end refmod"
    yield "           frame"
    for frame in frames:
        yield f"                new node                        = {frame.number:7d}"
        yield "                     rframe                     =    body ref"
        yield from _matrix("origin", n, frame.origin[:, None], frame.phi[:, :, None])
        yield from _matrix("phi", n, frame.phi, None if frame.of_forces is None else -frame.of_forces)
        yield from _matrix("psi", n, frame.psi, None if frame.of_moments is None else -frame.of_moments)
        yield from _matrix("AP", n, np.eye(3), _turns(frame.psi))
        yield "                end node"
    yield "           end frame"
    moments = np.array([inertia.inertia[PLACE[pair], 0, 0] for pair in _J_ORDER])
    moment_slopes = np.array([2 * first[PLACE[pair]] for pair in _J_ORDER])
    shares = [(1 if a == b else 2, PLACE[a, b]) for a, b in _OE_ORDER]
    couplings = -inertia.cross.transpose(1, 2, 0)  # by shape, shape of q, axis
    yield from _matrix("mdCM", n, np.zeros((3, 1)), np.zeros((3, n, 1)))
    yield from _matrix("J", n, moments[:, None], moment_slopes[:, :, None])
    yield from _matrix("Ct", n, np.zeros((n, 3)))
    yield from _matrix("Cr", n, np.zeros((n, 3)), couplings)
    yield from _matrix("Me", n, np.eye(n), structure=_IDENTITY)
    yield from _matrix("Gr", n, np.hstack([2 * first[:, j][PLACE] for j in range(n)]))
    yield from _matrix("Ge", n, 2 * couplings.reshape(n, 3 * n))
    slopes = -np.stack([share * second[i] for share, i in shares], axis=2)
    if of_rotation is not None:
        slopes += np.stack([of_rotation[i] for _, i in shares], axis=2)
    yield from _matrix("Oe", n, -np.column_stack([share * first[i] for share, i in shares]), slopes)
    yield from _matrix("ksigma", n, np.zeros((n, 1)))
    yield from _matrix("Ke", n, np.diag(omega**2), structure=_DIAGONAL)
    yield from _matrix("De", n, np.zeros((n, n)))
    yield "      end modal"
    yield " end part"


def _turns(psi: Array) -> Array:
    """Rates of an orientation matrix by the coordinates, (3, n, 3), of rotations psi, (3, n)."""
    return np.cross(psi.T[:, None], np.eye(3)).transpose(2, 0, 1)


def _matrix(
    name: str, n: int, constant: Array, slopes: Array | None = None, structure: int = _GENERAL
) -> Iterator[str]:
    """Lines of a matrix, (r, c), that is linear in n coordinates with slopes (r, n, c); zeros are left out."""
    rows, columns = constant.shape
    there = constant.any() or (slopes is not None and slopes.any())
    yield f"           {name}"
    counts = {
        "order": int(slopes is not None),
        "nrow": rows,
        "ncol": columns,
        "nq": n,
        "nqn": 0,
        "structure": structure if there else _ZERO,
    }
    for key, value in counts.items():
        yield f"                          {key:22s}= {value:5d}"
    if structure != _IDENTITY:
        for i, j in np.argwhere(constant):
            yield f"                          m0({i + 1:4d},{j + 1:4d})         = {_number(constant[i, j])}"
    if slopes is not None:
        for i, k, j in np.argwhere(slopes):
            yield f"                          m1({i + 1:4d},{k + 1:4d},{j + 1:4d})    = {_number(slopes[i, k, j])}"
    yield f"           end {name}"


def _number(value: float) -> str:
    return f"{value:.15E}".replace("E", "D")
