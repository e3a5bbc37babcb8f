"""Plastic flow in the full FE model: elements of the contact patch's zone, or all, yield as in partition contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..algebra.krylov import mass_normalised
from ..algebra.secants import Anderson
from ..algebra.sparse.flexibility import FreeBodyFlexibility
from ..errors import ComplementarityError
from ..fe.model import node_dofs
from ..plasticity.flow import PlasticState
from ..plasticity.zone import PlasticZone
from ..support.arrays import Array
from .full_body import FullBody
from .integrator import HHT
from .laws import Frictionless

_SETTLED = 1e-5  # relative change of the pseudo-forces
_MOST = 100  # iterations


class PlasticBody:
    """State of the elements of a full FE body that may yield.

    Attributes
    ----------
    force : (3n,) array
        Pseudo-forces of plastic strain on all nodes [N].
    work : float
        Plastic work so far [J].
    """

    def __init__(self, body: FullBody, side: HHT) -> None:
        fem, material = body.fem, body.contact.material or body.fem.material
        self.zone, self.side = PlasticZone(fem.points, body.region, material), side
        self._dofs = node_dofs(self.zone.nodes)
        self.state = self._new = body.plastic_state or PlasticState.virgin(len(self.zone))
        self.force, self.work = np.zeros(fem.n_dofs), 0.0
        self.force[self._dofs] = self.zone.pseudo_forces(self.state.strain)
        self._before = self.force
        if body.plastic_state is not None:
            rigid = mass_normalised(fem.rigid_modes, fem.mass)
            side.begin(FreeBodyFlexibility(body.stiffness, fem.mass, rigid)(self.force[:, None])[:, 0])
        self._strain = self._new_strain = self.zone.strains(side.u[self._dofs])

    @property
    def guess(self) -> Array:
        """Pseudo-forces at the end of the step if they change as in the step before, (3n,) [N]."""
        guess: Array = 2 * self.force - self._before
        return guess

    def answer(self, displacement: Array) -> Array:
        """Pseudo-forces at the end of a step, (3n,) [N], with these displacements, (3n,) [m]."""
        self._new_strain = self.zone.strains(displacement[self._dofs])
        self._new = self.zone.flow.answer(self._new_strain, self.state)
        force = np.zeros(len(displacement))
        force[self._dofs] = self.zone.pseudo_forces(self._new.strain)
        return force

    def finish(self, force: Array) -> None:
        """Accept what `answer` found last."""
        self.work += self.zone.work((self.state, self._strain), (self._new, self._new_strain))
        self.state, self._strain = self._new, self._new_strain
        self._before, self.force = self.force, force

    def energy(self) -> float:
        """Elastic energy that plastic strain adds to 1/2 u' K u [J]."""
        return self.zone.own_energy(self.state) - float(self.force @ self.side.u)


def plastic_step(sides: Sequence[HHT], yielding: Sequence[PlasticBody], law: Frictionless) -> Array:
    """Forces on the rows in a step, [N], with the plastic flow in it: a fixed point of the pseudo-forces.

    Raises
    ------
    ComplementarityError
        If it is not found.
    """
    motion = [side.predict() for side in sides]
    if not yielding:
        return law.forces(motion[0] + motion[1])
    numbers = [sides.index(one.side) for one in yielding]
    own, anderson = [one.guess for one in yielding], Anderson()
    p, sizes = np.concatenate(own), np.cumsum([len(one) for one in own])[:-1]
    for _ in range(_MOST):
        own = np.split(p, sizes)
        for one, number, force in zip(yielding, numbers, own, strict=True):
            motion[number] = one.side.load(one.force, force)
        lam = law.forces(motion[0] + motion[1])
        answers = [one.answer(one.side.end_of_step(lam)) for one in yielding]
        found = np.concatenate(answers)
        if np.linalg.norm(found - p) <= _SETTLED * np.linalg.norm(found):
            for one, answer in zip(yielding, answers, strict=True):
                one.finish(answer)
            return lam
        p = anderson.guess(p, found)
    change = np.linalg.norm(found - p) / np.linalg.norm(found)
    raise ComplementarityError(
        f"plastic flow of the full FE model did not settle in {_MOST} iterations; the last one changed its forces by "
        f"{change:.2g}. Take smaller steps"
    )
