"""Links under compression: the force between two interfaces of a body, compared with the load that buckles it.

An axial force softens a link against bending (P-delta). A reduced body without geometric stiffness is linear and does
not show that. Its bending stiffness is wrong by the ratio of the force and the buckling load. Both follow from the body
itself, since its static answer to forces and moments between two interfaces is exact. With geometric stiffness, what is
left out is of the order of squared slopes.

S. P. Timoshenko, J. M. Gere, Theory of Elastic Stability, 1961, sections 1.11 and 2.1.

Theory: examples/site/theory.md, "Compression and rotation".
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..support.arrays import Array
from .body import ReducedBody
from .inertia_relief import static_answers


@dataclass(frozen=True, eq=False)
class Link:
    """The part of a body between two of its interfaces.

    Parameters
    ----------
    ends : (str, str)
        Their names.
    force : (n_dofs,) array
        Static tension between them [N], by the body's coordinates without rigid motion.
    buckling_load : float
        That of Euler for a column with hinged ends [N].
    period : float
        Of the lowest bending vibration with hinged ends [s].
    """

    ends: tuple[str, str]
    force: Array
    buckling_load: float
    period: float

    def tension(self, elastic: Array) -> Array:
        """Tension, (...) [N], by coordinates (..., n_dofs) of the motion within the frame."""
        tension: Array = elastic @ self.force
        return tension


def links(body: ReducedBody) -> list[Link]:
    """Links between all pairs of a body's interfaces."""
    found = []
    interfaces = body.partition.interfaces
    if len(interfaces) < 2:
        return []
    rows = {interface.name: body.interface_rows(interface.name) for interface in interfaces}
    answer = static_answers(body.stiffness, body.mass, body.rigid, np.vstack([*rows.values()]).T)
    for i, j in combinations(range(len(interfaces)), 2):
        first, second = interfaces[i], interfaces[j]
        way = second.position - first.position
        length = float(np.linalg.norm(way))
        if length == 0:
            continue
        # Motion of the second relative to the first, and the balanced loads that do work on it.
        moved = np.eye(6)
        moved[:3, 3:] = -np.cross(np.eye(3), way)
        relative = rows[second.name] - moved @ rows[first.name]
        flexibility = relative @ (answer[:, 6 * j : 6 * j + 6] - answer[:, 6 * i : 6 * i + 6] @ moved.T)
        axis = way / length
        across = np.linalg.svd(axis[None])[2][1:]
        bending = np.linalg.eigvalsh(across @ flexibility[3:, 3:] @ across.T)[-1]  # [rad/(N m)], length / (E I)
        load = np.pi**2 / (length * bending)
        found.append(
            Link(
                (first.name, second.name),
                np.linalg.solve(flexibility, relative).T[:, :3] @ axis,
                load,
                2 * np.sqrt(length * body.total_mass / load),
            )
        )
    return found


def compression(link: Link, t: Array, elastic: Array) -> Array:
    """Mean compression over one period of bending, (n,) [N]; shorter pulses end before the link bends.

    Parameters
    ----------
    link : Link
    t : (n,) array
        [s]
    elastic : (n, n_dofs) array
        Coordinates of the motion within the frame.
    """
    return mean_over(link.period, t, -link.tension(elastic))


def mean_over(period: float, t: Array, x: Array) -> Array:
    """Means, (n,), of a quantity at times t over the last period [s]; before the start it was zero."""
    sums = np.r_[0.0, np.cumsum(np.diff(t) * _middles(x))]
    mean: Array = (sums - np.interp(t - period, t, sums)) / period
    return mean


def squared_slope(body: ReducedBody, link: Link, deformed: Array) -> Array:
    """Mean square of the slopes of a bent link, (n,) [rad2], of a body with geometric stiffness.

    It is twice the shortening by its length, which the geometric stiffness of a unit tension has.

    Parameters
    ----------
    body : ReducedBody
    link : Link
    deformed : (n, n_dofs) array
        Coordinates of the deformation alone.
    """
    first, second = (body.partition.find_interface(name).position for name in link.ends)
    length = np.linalg.norm(second - first)
    rows = [body.interface_rows(name)[:3] for name in link.ends]
    stiffness = body.geometric_stiffness((second - first) / length @ (rows[1] - rows[0]))
    slope: Array = np.sum((deformed @ stiffness) * deformed, axis=-1) / length
    return slope


def _middles(x: Array) -> Array:
    return (x[1:] + x[:-1]) / 2
