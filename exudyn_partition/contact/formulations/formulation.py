"""What a formulation is: how contact forces follow from gaps, and all that the rest of the library asks of it.

A `Formulation` is what a user chooses for a contact. It does not change. Its `Law` is the state of one contact in one
run: the rows, the forces on them, and what a law that depends on the path remembers. Whoever writes another formulation
implements these two; `law.ContactLaw` has what most laws share.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import scipy.sparse as sp

from ...errors import InputError
from ...frames.kinematics import Rows
from ...reduction.body import ReducedBody
from ...support.arrays import Array
from ..gaps import Gaps

Method = Literal["explicit", "implicit", "static"]


class Motion(Protocol):
    """What a law may ask of the solver at work. Each is found when it is asked for."""

    @property
    def q(self) -> Array:
        """Coordinates of slave and master, (n,)."""

    @property
    def q_t(self) -> Array:
        """Their velocities, (n,)."""

    @property
    def step(self) -> float:
        """Present step [s]; zero where the solver asks for initial accelerations."""

    @property
    def start(self) -> float:
        """Time at the start of the step [s]."""


class Law(Protocol):
    """State of a contact in a run.

    Attributes
    ----------
    elastic : bool
        Whether forces follow from the coordinates alone and have a potential. Then they can be found again after a run.
    ahead : bool
        Whether forces are applied ahead of each explicit step, by `forward_increment`, and not by a force element.
    remembers : bool
        Whether forces depend on those of the steps before, so that `commit` and `rollback` matter.
    lam : (nr,) array
        Forces on the present rows [N].
    index : (na,) int array
        Rows that are closed.
    least_gap : float
        Smallest gap of the present rows, before the contact's own flexibility gives way [m].
    iterations, searches : int
        Iterations of the active set, and searches of the pairs of all points, since the start of the run.
    """

    elastic: bool
    ahead: bool
    remembers: bool

    @property
    def gaps(self) -> Gaps:
        """The rows; of two passes those of the first."""

    @property
    def lam(self) -> Array:
        """See the attributes."""

    @property
    def index(self) -> Array:
        """See the attributes."""

    @property
    def least_gap(self) -> float:
        """See the attributes."""

    @property
    def iterations(self) -> int:
        """See the attributes."""

    @property
    def searches(self) -> int:
        """See the attributes."""

    @property
    def row_nodes(self) -> Array:
        """Slave's patch node of each present row, (nr,)."""

    @property
    def node_areas(self) -> Array:
        """Area of the row of each of the slave's patch nodes, (np,) [m2]; zero where there is none."""

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """Pressures around the slave's patch nodes by the forces of their rows, (np, np) [1/m2]."""

    def for_run(self, method: Method) -> Law:
        """Return the state at the start of a run by a method; this one does not change."""

    def evaluate(self, motion: Motion) -> Array:
        """Generalised contact force, (n,), on the coordinates of slave and master."""

    def tangent_matrix(self, by_q: float, by_q_t: float) -> Rows:
        """Derivative of minus the force, (n, n): that by q times `by_q`, that by q_t times `by_q_t`; rows held."""

    def row_stiffness(self) -> Array:
        """Forces on the closed rows by their gaps, (na, na) [N/m]; of elastic laws only."""

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps, rates and accelerations of an open contact, as `Gaps.closing`."""

    def commit(self, start: float) -> None:
        """Begin a step at time `start` [s]: the step before was accepted."""

    def rollback(self) -> None:
        """Forget what was found since the last `commit`: the step is taken again, with another length."""

    def closed_stiffness(self) -> Array | None:
        """Stiffness with all rows closed, (n, n), which limits explicit steps; None if there is no such limit."""

    def potential(self, q: Array) -> float:
        """Energy stored in the contact [J] at coordinates q, (n,); zero if forces store none."""

    def stored(self) -> float:
        """Energy stored at present [J]."""

    def dissipated(self) -> float:
        """Energy that the contact has taken since the start of the run [J]."""

    def press(self, gap: Array) -> tuple[float, int]:
        """Energy stored [J] and number of closed rows at gaps of the present rows, (nr,) [m]; of elastic laws only."""

    def resultant(self) -> Array:
        """Force on the slave, (3,) [N]."""

    def moment(self, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m]."""

    def nodal_forces(self) -> list[Array]:
        """Forces on the patches' nodes in space, (np, 3) of each side [N]."""

    def edge_reached(self) -> Array | None:
        """Place of a closed row at the edge of what can touch, (3,) [m]; None if there is none."""

    def check(self, q: Array) -> None:
        """Raise RunError if the solver has not done with the forces what the law needs, at coordinates q, (n,)."""


class Together(Protocol):
    """State of several elastic contacts on common bodies, whose forces are found together."""

    def forces_at(self, state: Array, coordinates: Callable[[], Sequence[Array]]) -> list[Array]:
        """Generalised forces of each contact, (n,), see `coupled.CoupledContacts.forces_at`."""

    def forces(self, coordinates: Sequence[Array]) -> list[Array]:
        """Generalised forces of each contact, (n,), at the coordinates of each."""

    def stiffness(self, law: Any, other: Any) -> Array:
        """Forces on the closed rows of one contact by gaps of those of another, (na, nb) [N/m]."""

    def for_run(self, laws: Sequence[Any]) -> Together:
        """Return the state at the start of a run of these laws."""


@dataclass(frozen=True, eq=False)
class SharedBody:
    """A body that two contacts have in common.

    Parameters
    ----------
    body : ReducedBody
    name : str
    patches : (int, int)
        Number of the patch of each contact.
    mass : (n_dofs,) array
        Diagonal mass matrix of its coordinates.
    columns : (slice, slice)
        Where its coordinates are among those of each contact.
    other : str
        Name of the other contact.
    """

    body: ReducedBody
    name: str
    patches: tuple[int, int]
    mass: Array
    columns: tuple[slice, slice]
    other: str


class Formulation(Protocol):
    """How forces follow from gaps; a value.

    Attributes
    ----------
    rows : {"integrated", "node-to-segment"}
        Default of the rows.
    both_passes : bool
        Whether half of it may act with one body as slave, and half with the other.
    """

    rows: str = "integrated"
    both_passes: bool = False

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """Raise InputError if it needs something of a basis that the bodies do not have."""

    def law(self, gaps: Gaps) -> Law:
        """Return the law at the start."""

    def couples(self, law: Law, other: Law, shared: SharedBody) -> bool:
        """Whether forces of two contacts on a body move each other's rows, so that they are found together.

        Raises
        ------
        InputError
            If there is no answer for both.
        """
        if shared.patches[0] == shared.patches[1]:
            raise InputError(
                f"body {shared.name!r}: its patch {shared.patches[0]} already has the contact {shared.other!r}; each "
                "would take its residual flexibility for itself. Make a patch for each contact (Partition.ball(...) | "
                "Partition.ball(...)), or take basis='free' with formulation='lagrange'"
            )
        return False

    def together(self, laws: Sequence[Any], links: Callable[[], list[Any]]) -> Together | None:
        """Return what finds forces of several contacts together; None if each finds its own.

        Parameters
        ----------
        laws : sequence of Law
        links : callable
            Returns how the sides of the laws move each other, see `coupled.CoupledContacts`.
        """
        return None
