"""A body of the full FE model: what is integrated, and where it may touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..fe.model import MASSES, FEModel, MassKind, node_dofs
from ..fe.partition import Partition, number_of_patch
from ..fe.patches import Patch, PlasticRegion
from ..plasticity.dilatation import with_free_zones, with_mean_dilatation
from ..plasticity.flow import PlasticState, validate_state
from ..plasticity.integration import points_an_element
from ..support.arrays import Array, Vector
from ..support.checks import validate_choice, validate_type, validate_vector
from ..surfaces.surface import Surface

PlasticExtent = Literal["zone", "everywhere", "none"]
_EXTENTS: tuple[PlasticExtent, ...] = get_args(PlasticExtent)


@dataclass(frozen=True, eq=False)
class FullBody:
    """One body of the full FE model.

    Parameters
    ----------
    fem : FEModel
    partition : Partition
        Its contact patch is what can touch.
    patch : int or str, optional
        Which one, if there are several.
    plastic : {"zone", "everywhere", "none"}
        Which elements may yield, if the material has `hardening`: the plastic zone of the patch, all, or none.
    plastic_state : PlasticState, optional
        What an earlier impact has left in the zone, as in `CreatePartitionBody`: the body begins at rest in the shape
        that it gives. Default: it never yielded.
    position : (3,) array
        Offset of the body's points in space, as referencePosition of the partition body [m].
    velocity : (3,) array
        Initial velocity [m/s].
    mass : {"consistent", "lumped"}

    Raises
    ------
    InputError
        If an argument is no such thing, the partition is of another mesh, or the state of another zone.
    """

    fem: FEModel
    partition: Partition
    position: Array = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    velocity: Array = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    mass: MassKind = "consistent"
    patch: int | str | None = None
    plastic: PlasticExtent = "zone"
    plastic_state: PlasticState | None = None

    if TYPE_CHECKING:  # any three numbers will do; they are kept as arrays

        def __init__(
            self,
            fem: FEModel,
            partition: Partition,
            position: Vector = ...,
            velocity: Vector = ...,
            mass: MassKind = ...,
            patch: int | str | None = None,
            plastic: PlasticExtent = ...,
            plastic_state: PlasticState | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        validate_type("fem", self.fem, FEModel, "fe_model()")
        validate_type("partition", self.partition, Partition, "Partition.ball()")
        self.partition.check_mesh(self.fem)
        object.__setattr__(self, "position", validate_vector("position", self.position))
        object.__setattr__(self, "velocity", validate_vector("velocity", self.velocity))
        validate_choice("mass", self.mass, MASSES)
        object.__setattr__(self, "patch", number_of_patch(self.partition, self.patch, "patch"))
        validate_choice("plastic", self.plastic, _EXTENTS)
        if self.plastic == "everywhere":
            self.fem.need_cells("plastic flow")
        if self.plastic == "everywhere" and self.fem.regions is not None:
            raise InputError("plastic: 'everywhere' expects a body of one material; take 'zone', or 'nowhere'")
        if self.plastic_state is not None:
            if not self.yields:
                raise InputError("plastic_state: this body cannot yield; give hardening= to its Material")
            cells = self.region.cells
            n = len(cells) * points_an_element(cells, self.region.hexahedra)
            object.__setattr__(self, "plastic_state", validate_state("plastic_state", self.plastic_state, n))

    @property
    def yields(self) -> bool:
        """Whether some of its elements may yield."""
        if self.plastic == "everywhere":
            return self.fem.material.plastic
        return self.plastic == "zone" and self.contact.plastic is not None

    @property
    def region(self) -> PlasticRegion:
        """Elements that may yield."""
        if self.plastic == "everywhere":
            return PlasticRegion(self.fem.cells, np.empty(0, dtype=np.int64), self.fem.hexahedra)
        assert self.contact.plastic is not None
        return self.contact.plastic

    @property
    def stiffness(self) -> sp.csr_matrix:
        """(3n, 3n) csr matrix [N/m], as a reduced body of this partition has it: see `plasticity.dilatation`."""
        if self.plastic == "everywhere" and self.yields:
            return with_mean_dilatation(self.fem, self.fem.cells, self.fem.material).stiffness
        return with_free_zones(self.fem, self.partition).stiffness

    @property
    def surface(self) -> Surface:
        """The contact patch in place."""
        return Surface.of(self.fem.points, self.contact, self.position)

    @property
    def contact(self) -> Patch:
        """The contact patch."""
        return self.partition.patches[number_of_patch(self.partition, self.patch, "patch")]


def rows_on_dofs(body: FullBody, rows: sp.csr_matrix) -> sp.csr_matrix:
    """Rows on all dofs of the FE model, (m, 3n), of rows on the dofs of the patch's nodes, (m, 3np)."""
    dofs = node_dofs(body.contact.nodes)
    pick = (np.ones(len(dofs)), (np.arange(len(dofs)), dofs))
    return sp.csr_matrix(rows @ sp.csr_matrix(pick, shape=(len(dofs), body.fem.n_dofs)))
