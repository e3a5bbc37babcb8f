"""What plastic zones remember of the last accepted step, as values of arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...plasticity.flow import PlasticState
from ...support.arrays import Array


@dataclass(frozen=True, eq=False)
class Change:
    """A change of the pseudo-forces, (3 nz,) [N], and how far it moves the nodes, (3 nz,), and the patch, (r,) [m]."""

    change: Array
    moved: Array
    moved_patch: Array

    def none(self) -> Change:
        """Return no change; this one if it is none."""
        if not self.change.any():
            return self
        return Change(np.zeros_like(self.change), np.zeros_like(self.moved), np.zeros_like(self.moved_patch))


@dataclass(frozen=True, eq=False)
class Applied:
    """Pseudo-forces that a plastic zone has applied, and what they do.

    Parameters
    ----------
    p, left : (3 nz,) arrays
        On the nodes, and what plastic strain asks for beyond them [N].
    moved : (3 nz,) array
        Displacements of the nodes [m].
    moved_patch : (r,) array
        Displacements of the patch's rows [m].
    generalised : (n,) array
        Forces on the last coordinates of the body from p + left [N].
    energy : float
        Elastic energy without the work of these forces [J].
    """

    p: Array
    left: Array
    moved: Array
    moved_patch: Array
    generalised: Array
    energy: float

    def beyond(self, last: Applied) -> Change:
        """What has been applied since the last step."""
        return Change(self.p - last.p, self.moved - last.moved, self.moved_patch - last.moved_patch)


@dataclass(frozen=True, eq=False)
class ZoneState:
    """A plastic zone at the end of a step: all that the next one needs.

    Parameters
    ----------
    plastic : PlasticState
    applied : Applied
    change : Change
        What the step has added to it: the first guess for the next step.
    q : (n,) array
        Last coordinates of the body, with which the zone moves.
    by_patch : (r,) array
        Forces on the rows of the patch [N].
    work : float
        Plastic work since the start of the run [J].
    active : (g,) bool array
        Points that may flow in the next step.
    goes_on : bool
        Whether points flowed in the step, and the next one begins with the active points.
    strain : (k, 6) array or None
        Strains of the active points, if they flowed.
    excess : (g,) array or None
        Stress beyond the flow stress [Pa], if points flowed.
    """

    plastic: PlasticState
    applied: Applied
    change: Change
    q: Array
    by_patch: Array
    work: float
    active: Array
    goes_on: bool = False
    strain: Array | None = None
    excess: Array | None = None

    @property
    def generalised(self) -> Array:
        """Forces on the last coordinates of the body, (n,) [N]."""
        return self.applied.generalised

    @property
    def stored(self) -> float:
        """Elastic energy that plastic strain adds to the energy of the patch forces [J]."""
        return self.applied.energy - float(self.generalised @ self.q)


@dataclass(frozen=True, eq=False)
class NodalState:
    """The same of a plastic zone whose nodes are coordinates.

    Parameters
    ----------
    plastic : PlasticState
    total : (g, 6) array
        Strain, elastic and plastic.
    generalised : (n,) array
        Forces on the last coordinates of the body [N].
    stored : float
        Elastic energy that plastic strain adds to that of the body's coordinates [J].
    work : float
        Plastic work since the start of the run [J].
    """

    plastic: PlasticState
    total: Array
    generalised: Array
    stored: float = 0.0
    work: float = 0.0
