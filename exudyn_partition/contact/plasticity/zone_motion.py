"""A plastic zone of a body in motion: what it is, whatever has happened to it.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...algebra.krylov import mass_normalised
from ...algebra.sparse.flexibility import FreeBodyFlexibility
from ...frames.kinematics import Kinematics
from ...plasticity.flow import PlasticState
from ...plasticity.zone import PlasticZone
from ...plasticity.zone_flexibility import ZoneFlexibility
from ...reduction.body import ReducedBody
from ...support.arrays import Array


@dataclass(frozen=True, eq=False)
class ZoneMotion:
    """A plastic zone in motion.

    Parameters
    ----------
    zone : PlasticZone
    flexibility : ZoneFlexibility or None
        Residual flexibility; None if the zone's nodes are coordinates of the body (basis "free").
    kinematics : Kinematics
        Kinematics of the zone's nodes.
    start : PlasticState
        State at the start of each run.
    """

    zone: PlasticZone
    flexibility: ZoneFlexibility | None
    kinematics: Kinematics
    start: PlasticState

    @classmethod
    def of(cls, kinematics: Kinematics, patch: int, state: PlasticState | None = None) -> ZoneMotion | None:
        """Zone of a patch of the body with these kinematics; None if nothing yields there."""
        body: ReducedBody = kinematics.body
        plastic = [
            number for number, contact_patch in enumerate(body.partition.patches) if contact_patch.plastic is not None
        ]
        contact_patch = body.partition.patches[patch]
        region, material = contact_patch.plastic, contact_patch.material or body.material
        nodal = region is not None and np.isin(region.nodes, body.basis.nodal).all()
        if region is None or material is None or not (body.basis.zones or nodal):
            return None
        zone = PlasticZone(body.points, region, material)
        start = PlasticState.virgin(len(zone)) if state is None else state
        flexibility = body.basis.zones[plastic.index(patch)] if body.basis.zones else None
        return cls(zone, flexibility, kinematics.at(zone.nodes), start)

    def at_rest(self, state: PlasticState) -> Array:
        """Displacements of the zone's nodes due to plastic strain alone, at rest, in the body's axes, (nz, 3) [m]."""
        body, p = self.kinematics.body, self.zone.pseudo_forces(state.strain)
        rows = body.rows(self.zone.nodes)
        moved = np.asarray(rows @ deformed_at_rest(body, rows.T @ p))
        if self.flexibility is not None:
            moved += self.flexibility.own @ p
        return moved.reshape(-1, 3)


def deformed_at_rest(body: ReducedBody, force: Array) -> Array:
    """Coordinates of a body at rest, (n_dofs,), deformed by balanced forces on the coordinates, (n_dofs,)."""
    if not len(body.basis.nodal):
        elastic, q = body.basis.omega > 0, np.zeros(body.n_dofs)
        q[elastic] = force[elastic] / body.basis.omega[elastic] ** 2
        return q
    rigid = mass_normalised(body.rigid, body.mass)
    return FreeBodyFlexibility(body.stiffness, body.mass, rigid)(force[:, None])[:, 0]
