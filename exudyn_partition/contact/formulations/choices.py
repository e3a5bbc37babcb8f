"""The formulations that a user can choose by name: the bases that each takes, its law, and how contacts couple."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, get_args
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ...algebra.coulomb import Coulomb
from ...errors import InputError
from ...reduction.body import ReducedBody
from ...support.checks import validate_choice, validate_positive
from ..gaps import Gaps
from .compliance import ComplianceContact, PlasticCompliance
from .coupled import Compliant, CoupledContacts, SharedPatches
from .formulation import Formulation, Law, Links, SharedBody
from .frictional_compliance import FrictionalCompliance, PlasticFrictionalCompliance
from .lagrange import FrictionalLagrange, LagrangeContact, PlasticFrictionalLagrange, PlasticLagrange
from .penalty import FrictionalPenalty, PenaltyContact, bed_stiffness, inertial_stiffness

FormulationName = Literal["compliance", "lagrange", "penalty"]
NAMES: tuple[FormulationName, ...] = get_args(FormulationName)
_OF_A_FORMULATION = ("check", "law", "couples", "together", "rows")

_COUPLED = 1e-4  # residual flexibility between two patches, relative to their own; contacts are not coupled below it
_MOVED = 1e-9  # the same for accelerations: those that multipliers of one contact give to rows of another
_SIZES: WeakKeyDictionary[ReducedBody, dict[tuple[int, int], float]] = WeakKeyDictionary()  # see `_size`
_STIFFEST = 1e6  # times the default penalty; explicit steps are then a thousandth of those with the default


class Compliance(Formulation):
    """Contact through the residual flexibility, see `compliance.ComplianceContact`.

    Parameters
    ----------
    friction : Coulomb, optional
        With it, see `frictional_compliance.FrictionalCompliance`.
    """

    def __init__(self, friction: Coulomb | None = None) -> None:
        self.friction = friction

    def with_friction(self, friction: Coulomb) -> Compliance:
        """See `Formulation`."""
        return Compliance(friction)

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """See `Formulation`."""
        if not any(body.basis.flexibility is not None for body in bodies):
            raise InputError(
                f"formulation: 'compliance' needs a residual flexibility. Basis {_names(bodies)} has none; "
                "take formulation='lagrange', or basis='contact-adapted' or 'residual'"
            )

    def law(self, gaps: Gaps) -> ComplianceContact | FrictionalCompliance:
        """See `Formulation`."""
        zones = [side.zone for side in gaps.sides if side.zone is not None]
        yields = bool(zones)
        if any(zone.flexibility is None for zone in zones):
            raise InputError(
                "formulation: 'compliance' needs the residual flexibility of plastic zones, which basis 'free' does "
                "not have. Take formulation='lagrange', or basis 'contact-adapted' or 'residual' for both bodies"
            )
        if self.friction is None:
            return PlasticCompliance(gaps) if yields else ComplianceContact(gaps)
        kind = PlasticFrictionalCompliance if yields else FrictionalCompliance
        return kind(gaps, self.friction)

    def couples(self, law: Law, other: Law, shared: SharedBody) -> bool:
        """See `Formulation`; frictionless elastic contacts may share a patch."""
        if any(type(one) is not ComplianceContact for one in (law, other)):
            super().couples(law, other, shared)
        return _coupling(shared) > _COUPLED and isinstance(law, Compliant) and isinstance(other, Compliant)

    def together(self, laws: Sequence[Any], links: Links) -> CoupledContacts:
        """See `Formulation`."""
        if not links.shared:
            return CoupledContacts(laws, links)
        if any(type(law) is not ComplianceContact for law in laws):
            raise InputError(
                "friction: contacts that share a patch, and all that are solved together with them, are frictionless "
                "and elastic. Make a patch for each contact (Partition.ball(...) | Partition.ball(...))"
            )
        return SharedPatches(laws, links)


class Lagrange(Formulation):
    """Multipliers on patches with mass: `lagrange.LagrangeContact`, in implicit runs `stabilised.StabilisedContact`.

    Parameters
    ----------
    friction : Coulomb, optional
        With it, `lagrange.FrictionalLagrange` and `stabilised.FrictionalStabilised`.
    """

    rows = "node-to-segment"

    def __init__(self, friction: Coulomb | None = None) -> None:
        self.friction = friction

    def with_friction(self, friction: Coulomb) -> Lagrange:
        """See `Formulation`."""
        return Lagrange(friction)

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """See `Formulation`."""
        if any(body.basis.flexibility is not None for body in bodies):
            raise InputError(
                "formulation: 'lagrange' needs contact patches that move by coordinates with mass, which basis "
                f"{_names(bodies)} does not give them; take formulation='compliance', or basis='free'"
            )

    def law(self, gaps: Gaps) -> LagrangeContact:
        """See `Formulation`."""
        yields = any(side.zone is not None for side in gaps.sides)
        if self.friction is None:
            return PlasticLagrange(gaps) if yields else LagrangeContact(gaps)
        kind = PlasticFrictionalLagrange if yields else FrictionalLagrange
        return kind(gaps, self.friction)

    def couples(self, law: Law, other: Law, shared: SharedBody) -> bool:
        """See `Formulation`."""
        if not isinstance(law, LagrangeContact) or not isinstance(other, LagrangeContact):
            return False
        if shared.patches[0] == shared.patches[1]:
            if law.yielding is not None or other.yielding is not None:  # each would count the zone's forces
                super().couples(law, other, shared)
            return True
        inverse_mass = sp.diags(1 / shared.mass)
        G, others = (sp.csr_matrix(one.G[:, own]) for one, own in zip((law, other), shared.columns, strict=True))
        return bool(abs(G @ inverse_mass @ others.T).max() > _MOVED * abs(G @ inverse_mass @ G.T).max())


class Penalty(Formulation):
    """An elastic layer on the slave's patch, see `penalty.PenaltyContact`.

    Parameters
    ----------
    stiffness : float, optional
        Stiffness of the layer [N/m3]. Default: the layer yields under uniform pressure as much as the residual
        flexibility does. Where patches have mass, it adds at most a tenth to their highest squared frequency.
    friction : Coulomb, optional
        With it, see `penalty.FrictionalPenalty`.
    """

    def __init__(self, stiffness: float | None = None, friction: Coulomb | None = None) -> None:
        self.stiffness = None if stiffness is None else validate_positive("stiffness", stiffness, "N/m3")
        self.friction = friction

    def with_friction(self, friction: Coulomb) -> Penalty:
        """See `Formulation`."""
        return Penalty(self.stiffness, friction)

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """See `Formulation`; any basis will do."""

    def law(self, gaps: Gaps) -> PenaltyContact | FrictionalPenalty:
        """See `Formulation`."""
        usual = self.usual_stiffness(gaps)
        if self.stiffness is not None and self.stiffness > _STIFFEST * usual:
            raise InputError(
                f"stiffness: expected at most {_STIFFEST * usual:.3g} N/m3, a million times the default, "
                f"got {self.stiffness:.3g}. So stiff a layer yields less than round-off, and its time steps are "
                "far too small. Take formulation='compliance' or 'lagrange', which keep gaps closed without a layer"
            )
        stiffness = usual if self.stiffness is None else self.stiffness
        if self.friction is None:
            return PenaltyContact(gaps, stiffness)
        return FrictionalPenalty(gaps, self.friction, stiffness)

    @staticmethod
    def usual_stiffness(gaps: Gaps) -> float:
        """Stiffness of the layer that is taken by default [N/m3]."""
        if any(side.flexibility is not None for side in gaps.sides):
            return bed_stiffness(gaps)
        inverse_mass = 1 / np.concatenate([side.kinematics.mass for side in gaps.sides])
        return inertial_stiffness(gaps, inverse_mass, max(map(_highest_frequency, gaps.bodies)))


def formulation_of(choice: FormulationName | Formulation, stiffness: float | None = None) -> Formulation:
    """Return the formulation with the name `choice`, or `choice` itself if it is a formulation.

    Raises
    ------
    InputError
        If no formulation has this name, or a stiffness is given without formulation 'penalty'.
    """
    if stiffness is not None and not (isinstance(choice, str) and choice == "penalty"):
        raise InputError(f"stiffness: formulation {choice!r} has none; give it only with formulation='penalty'")
    if isinstance(choice, type):
        raise InputError(f"formulation: expected an object, got the class {choice.__name__}; call it")
    if not isinstance(choice, str) and all(hasattr(choice, name) for name in _OF_A_FORMULATION):
        return choice
    name = validate_choice("formulation", choice, NAMES)
    return Penalty(stiffness) if name == "penalty" else Compliance() if name == "compliance" else Lagrange()


def _names(bodies: Sequence[ReducedBody]) -> str:
    return " and ".join(repr(body.basis.name) for body in bodies)


def _coupling(shared: SharedBody) -> float:
    """Residual flexibility between two patches of a body, relative to their own."""
    body, (patch, other) = shared.body, shared.patches
    if body.basis.flexibility is None:
        return 0.0
    own, others = _size(body, patch, patch), _size(body, other, other)
    return _size(body, patch, other) / math.sqrt(own * others)


def _size(body: ReducedBody, patch: int, other: int) -> float:
    """Largest singular value of the residual flexibility between two patches [m/N]; found once for a body."""
    known = _SIZES.setdefault(body, {})
    if (patch, other) not in known:
        known[patch, other] = float(np.linalg.norm(body.flexibility(patch, other), 2))
    return known[patch, other]


def _highest_frequency(body: ReducedBody) -> float:
    """Highest circular frequency of a reduced body [rad/s]."""
    scale = sp.diags(1 / np.sqrt(body.mass.diagonal()))
    K = scale @ body.stiffness @ scale
    start = np.ones(K.shape[0])
    largest = scipy.sparse.linalg.eigsh(K, k=1, which="LA", tol=1e-4, v0=start, return_eigenvectors=False)[0]
    return float(np.sqrt(largest))
