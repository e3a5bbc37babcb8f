"""Interface of a formulation, which a user chooses for a contact. It is immutable; its law finds the forces.

A new formulation implements `Formulation` and a `law.Law`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args

from ...errors import InputError
from ...reduction.body import ReducedBody
from ...support.arrays import Array
from ...surfaces.points import RowKind
from ..law import Law, RowDirections
from ..patch_contact import PatchContact
from ..plasticity.nodal_zones import NodalZones
from ..plasticity.yielding_patches import YieldingPatches, Zones
from .separate import Separate

Integrator = Literal["explicit", "implicit"]
INTEGRATORS: tuple[Integrator, ...] = get_args(Integrator)
Method = Literal[Integrator, "static"]


class Together(Protocol):
    """Contacts that belong together: `separate.Separate` ones find their forces alone, `coupled.Coupled` in common."""

    def forces(self, coordinates: Sequence[Array]) -> list[Array]:
        """Generalised forces of each contact, (n,), at its coordinates."""

    def stiffness(self, rows: Mapping[int, Array]) -> dict[tuple[int, int], Array]:
        """Minus the derivative of forces of contacts with respect to coordinates of each other, at fixed pairs.

        Parameters
        ----------
        rows : dict of int to (d na, n) array
            Derivative of the places of the closed rows of each contact, by its number, with respect to coordinates.

        Returns
        -------
        dict
            For the numbers of two contacts, maybe the same, (n, m): generalised forces of the first due to coordinates
            of the other. Pairs that hardly move each other are left out.
        """

    def closed_stiffness(self, places: Sequence[int]) -> dict[tuple[int, int], Array]:
        """Stiffness with all rows of some contacts closed, and those of the others open.

        Parameters
        ----------
        places : sequence of int
            Numbers of the contacts.

        Returns
        -------
        dict
            As that of `stiffness`.
        """

    def for_run(self, contacts: Sequence[PatchContact]) -> Together:
        """Return the state at the start of a run with these contacts."""


@dataclass(frozen=True, eq=False)
class SharedBody:
    """A body that two contacts share.

    Parameters
    ----------
    body : ReducedBody
    name : str
    patches : (int, int)
        Number of each contact's patch on the body.
    mass : (n_dofs,) array
        Diagonal mass matrix of its coordinates.
    columns : (slice, slice)
        Place of its coordinates among those of each contact.
    neighbour : str
        Name of the other contact.
    """

    body: ReducedBody
    name: str
    patches: tuple[int, int]
    mass: Array
    columns: tuple[slice, slice]
    neighbour: str


class Links(Protocol):
    """Flexibility between the sides of several contacts."""

    @property
    def shared(self) -> bool:
        """Whether two of the contacts have the same patch of the same body."""

    @property
    def on_demand(self) -> bool:
        """Whether a body of theirs has a flexibility that is found on demand, so that few fields of it are unknown."""

    def __call__(self) -> list[Any]:
        """Flexibilities between the sides, see `coupled.Coupled`."""

    def some(self, places: Sequence[int]) -> Links:
        """Those between some of the contacts, by their numbers."""


class Formulation:
    """How forces follow from gaps. A user's own formulation needs only a `law`.

    Attributes
    ----------
    rows : {"integrated", "node-to-segment"}
        Default kind of the gap rows.
    friction : bool
        Whether its law has friction.
    plastic : bool
        Whether its law can have plastic zones beneath the patches.
    edges : bool
        Whether integrated rows of nodes at sharp edges are the gaps of these nodes. Such rows have no area.
    """

    rows: RowKind = "integrated"
    friction = False
    plastic = False
    edges = True

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """Raise InputError if the bases of the bodies do not suit the formulation; here all do."""

    def law(self, rows: RowDirections) -> Law:
        """Return the law of a contact with these rows; with friction, `rows.d` is 3."""
        raise NotImplementedError(f"{type(self).__name__} has no law")

    def zones(self, contact: PatchContact) -> Zones | None:
        """Plastic zones of a contact, if patches of its bodies yield.

        Raises
        ------
        InputError
            If patches yield and the formulation, or its basis, has no plastic zones.
        """
        zones = [(n, side.zone) for n, side in enumerate(contact.gaps.sides) if side.zone is not None]
        if not zones:
            return None
        if not self.plastic:
            raise InputError(
                f"formulation: {type(self).__name__} knows no plastic zones, and the material of a body has hardening. "
                "Take formulation='compliance', 'lagrange' with basis 'free', or a material without it"
            )
        sizes = [side.n for side in contact.gaps.sides]
        if contact.law.ahead:
            return NodalZones(zones, sizes)
        if any(zone.flexibility is None for _, zone in zones):
            raise InputError(
                "formulation: 'compliance' needs the residual flexibility of plastic zones, which basis 'free' does "
                "not have. Take formulation='lagrange', or basis 'contact-adapted' or 'residual' for both bodies"
            )
        return YieldingPatches(zones, sizes)

    def couples(self, contact: PatchContact, neighbour: PatchContact, shared: SharedBody) -> bool:
        """Whether forces of each contact on a body change the gaps of the other, so that both are solved together.

        Raises
        ------
        InputError
            If the two contacts cannot be computed on one body.
        """
        if shared.patches[0] == shared.patches[1]:
            raise InputError(
                f"body {shared.name!r}: its patch {shared.patches[0]} already has the contact {shared.neighbour!r}. "
                "Each contact would use all of its residual flexibility. Make a patch for each contact "
                "(Partition.ball(...) | Partition.ball(...)), or take formulation='compliance' without plastic zones, "
                "or basis='free' with formulation='lagrange'"
            )
        return False

    def check_group(self, *, flows: bool, whole: bool) -> None:
        """Raise InputError if contacts that belong together cannot be solved together; here all can.

        Parameters
        ----------
        flows : bool
            Whether one of them yields.
        whole : bool
            Whether their flexibilities are needed in full: some share a patch, or touch a skin, see `Links`.
        """

    def together(self, contacts: Sequence[PatchContact], links: Links) -> Together:
        """Return the object that finds the forces of contacts; here each contact is solved alone."""
        return Separate(contacts)
