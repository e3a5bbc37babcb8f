"""The formulations that a user can choose by name: the bases each accepts, its law, and how contacts couple."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ...algebra.sparse.skin_flexibility import largest_value
from ...errors import InputError
from ...reduction.body import ReducedBody
from ...support.checks import validate_positive
from ...support.once import once
from ...support.plugins import added_choice
from ..gaps import Gaps
from ..law import Law, RowDirections
from ..patch_contact import PatchContact
from ..spot_gaps import SpotGaps
from .compliance import compliance
from .coupled import CoupledContacts, SharedPatches
from .coupled_friction import CoupledFriction, SharedFriction
from .coupled_points import CoupledPoints
from .coupled_zones import CoupledZones
from .explicit_multipliers import Multipliers
from .formulation import Formulation, Links, SharedBody, Together
from .hertz import HertzPoint
from .hertz_friction import HertzFriction
from .penalty import PenaltyLayer, bed_stiffness, inertial_stiffness
from .separate import Separate

FormulationName = Literal["compliance", "lagrange", "penalty", "hertz"]
NAMES: tuple[FormulationName, ...] = get_args(FormulationName)

_COUPLED = 1e-4  # residual flexibility between two patches, relative to their own; below it, contacts are not coupled
_MOVED = 1e-9  # the same for accelerations that multipliers of one contact cause in rows of another
_STIFFEST = 1e6  # times the default penalty; explicit steps are then a thousandth of those with the default


class Compliance(Formulation):
    """Contact through the residual flexibility, see `compliance.NormalCompliance` and `FrictionalCompliance`."""

    friction = True
    plastic = True

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """See `Formulation`."""
        if not any(body.basis.flexibility is not None for body in bodies):
            raise InputError(
                f"formulation: 'compliance' needs a residual flexibility. Basis {_names(bodies)} has none; "
                "take formulation='lagrange', or basis='contact-adapted' or 'residual'"
            )

    def law(self, rows: RowDirections) -> Law:
        """See `Formulation`."""
        return compliance(rows)

    def couples(self, contact: PatchContact, neighbour: PatchContact, shared: SharedBody) -> bool:
        """See `Formulation`; contacts may share a patch unless they yield."""
        alike = isinstance(neighbour.formulation, Compliance)
        if not alike or contact.flows or neighbour.flows:
            super().couples(contact, neighbour, shared)
        return alike and _coupling(shared) > _COUPLED

    def check_group(self, *, flows: bool, whole: bool) -> None:
        """See `Formulation`."""
        if flows and whole:
            raise InputError(
                "slave, master: contacts that share a patch, or touch a large skin, and all that are solved together "
                "with them, are elastic, but one of these has plastic zones. Make a small patch for each contact "
                "(Partition.ball(...) | Partition.ball(...)), or take a material without hardening"
            )

    def together(self, contacts: Sequence[PatchContact], links: Links) -> Together:
        """See `Formulation`."""
        elastic = all(contact.elastic for contact in contacts)
        if len(contacts) == 1 and not (elastic and contacts[0].gaps.may_freeze):
            return Separate(contacts)
        if links.shared or links.on_demand:
            return (SharedPatches if elastic else SharedFriction)(contacts, links)
        flows = any(contact.flows for contact in contacts)
        return (CoupledContacts if elastic else CoupledZones if flows else CoupledFriction)(contacts, links)


class Lagrange(Formulation):
    """Multipliers on patches with mass: `explicit_multipliers`, and in implicit runs `implicit_multipliers`."""

    rows = "node-to-segment"
    friction = True
    plastic = True

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """See `Formulation`."""
        if any(body.basis.flexibility is not None for body in bodies):
            raise InputError(
                "formulation: 'lagrange' needs contact patches that move by coordinates with mass, which basis "
                f"{_names(bodies)} does not give them; take formulation='compliance', or basis='free'"
            )

    def law(self, rows: RowDirections) -> Law:
        """See `Formulation`."""
        return Multipliers()

    def couples(self, contact: PatchContact, neighbour: PatchContact, shared: SharedBody) -> bool:
        """See `Formulation`."""
        if not isinstance(neighbour.formulation, Lagrange):
            return False
        if shared.patches[0] == shared.patches[1]:
            if contact.zones is not None or neighbour.zones is not None:  # both contacts would count the zone's forces
                super().couples(contact, neighbour, shared)
            return True
        inverse_mass = sp.diags(1 / shared.mass)
        both = zip((contact, neighbour), shared.columns, strict=True)
        G, neighbour_rows = (
            sp.csr_matrix(member.rows.jacobian(np.arange(len(member.gaps.row_nodes)))[:, columns])
            for member, columns in both
        )
        return bool(abs(G @ inverse_mass @ neighbour_rows.T).max() > _MOVED * abs(G @ inverse_mass @ G.T).max())


class Penalty(Formulation):
    """An elastic layer on the slave's patch, see `penalty.PenaltyLayer`.

    Parameters
    ----------
    stiffness : float, optional
        Stiffness of the layer [N/m3]. Default: the layer yields under uniform pressure as much as the residual
        flexibility. Where patches have mass, it adds at most a tenth to their highest squared frequency.
    """

    friction = True
    edges = False  # a layer holds by its area

    def __init__(self, stiffness: float | None = None) -> None:
        self.stiffness = None if stiffness is None else validate_positive("stiffness", stiffness, "N/m3")

    def law(self, rows: RowDirections) -> PenaltyLayer:
        """See `Formulation`."""
        usual = self.usual_stiffness(rows.gaps)
        if self.stiffness is not None and self.stiffness > _STIFFEST * usual:
            raise InputError(
                f"stiffness: expected at most {_STIFFEST * usual:.3g} N/m3, a million times the default, "
                f"got {self.stiffness:.3g}. So stiff a layer yields less than round-off, and its time steps are "
                "far too small. Take formulation='compliance' or 'lagrange', which keep gaps closed without a layer"
            )
        return PenaltyLayer(rows, usual if self.stiffness is None else self.stiffness)

    @staticmethod
    def usual_stiffness(gaps: Gaps) -> float:
        """Default stiffness of the layer [N/m3]."""
        if any(side.flexibility is not None for side in gaps.sides):
            return bed_stiffness(gaps)
        inverse_mass = 1 / np.concatenate([side.kinematics.mass for side in gaps.sides])
        return inertial_stiffness(gaps, inverse_mass, max(map(_highest_frequency, gaps.sides.bodies)))


class Hertz(Formulation):
    """Contact at a point that the mesh does not resolve, see `hertz.HertzPoint` and `hertz_friction.HertzFriction`."""

    rows = "spot"
    friction = True

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """See `Formulation`."""
        if any(body.basis.flexibility is None for body in bodies):
            raise InputError(
                f"formulation: 'hertz' needs the residual flexibility of each body, and of the bases {_names(bodies)} "
                "not all have one; take basis='contact-adapted' or 'residual'"
            )

    def law(self, rows: RowDirections) -> Law:
        """See `Formulation`."""
        assert isinstance(rows.gaps, SpotGaps)
        return HertzPoint(rows) if rows.d == 1 else HertzFriction(rows)

    def couples(self, contact: PatchContact, neighbour: PatchContact, shared: SharedBody) -> bool:
        """See `Formulation`; points may share a patch."""
        if not isinstance(neighbour.formulation, Hertz):
            return super().couples(contact, neighbour, shared)
        return _coupling(shared) > _COUPLED

    def together(self, contacts: Sequence[PatchContact], links: Links) -> Together:
        """See `Formulation`."""
        return Separate(contacts) if len(contacts) == 1 else CoupledPoints(contacts, links)


def formulation_of(choice: FormulationName | Formulation, stiffness: float | None = None) -> Formulation:
    """Return the formulation with the name `choice`, or `choice` itself if it is a formulation.

    Raises
    ------
    InputError
        If no formulation has this name, or a stiffness is given without formulation 'penalty'.
    """
    if stiffness is not None and not (isinstance(choice, str) and choice == "penalty"):
        raise InputError(f"stiffness: formulation {choice!r} has none; give it only with formulation='penalty'")
    if isinstance(choice, type) and issubclass(choice, Formulation):
        raise InputError(f"formulation: expected an object, got the class {choice.__name__}; call it")
    if isinstance(choice, Formulation):
        return choice
    if not isinstance(choice, str):
        raise InputError(
            f"formulation: expected one of {', '.join(map(repr, NAMES))}, or an object whose class derives from "
            f"Formulation and whose law(rows) returns a law, got "
            f"{f'the class {choice.__name__}' if isinstance(choice, type) else type(choice).__name__}"
        )
    if (added := added_choice("formulation", choice, NAMES, "formulations")) is not None:
        made = added() if isinstance(added, type) else added
        if not isinstance(made, Formulation):
            raise InputError(f"formulation: expected a Formulation by the name {choice!r}, got {type(made).__name__}")
        return made
    if choice == "penalty":
        return Penalty(stiffness)
    return {"compliance": Compliance, "lagrange": Lagrange, "hertz": Hertz}[choice]()


def _names(bodies: Sequence[ReducedBody]) -> str:
    return " and ".join(repr(body.basis.name) for body in bodies)


def _coupling(shared: SharedBody) -> float:
    """Residual flexibility between two patches of a body, relative to their own."""
    body, (patch, neighbour) = shared.body, shared.patches
    if body.basis.flexibility is None:
        return 0.0
    if patch == neighbour:
        return 1.0
    size, neighbour_size = _size(body, patch, patch), _size(body, neighbour, neighbour)
    return _size(body, patch, neighbour) / math.sqrt(size * neighbour_size)


@once
def _size(body: ReducedBody, patch: int, neighbour: int) -> float:
    """Largest singular value of the residual flexibility between two patches [m/N]."""
    return largest_value(body.flexibility(patch, neighbour))


@once
def _highest_frequency(body: ReducedBody) -> float:
    """Highest circular frequency of a reduced body [rad/s]."""
    scale = sp.diags(1 / np.sqrt(body.mass.diagonal()))
    K = scale @ body.stiffness @ scale
    start = np.ones(K.shape[0])
    largest = scipy.sparse.linalg.eigsh(K, k=1, which="LA", tol=1e-4, v0=start, return_eigenvectors=False)[0]
    return float(np.sqrt(largest))
