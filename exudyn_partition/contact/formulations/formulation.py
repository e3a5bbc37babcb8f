"""Interface of a formulation: it says how contact forces follow from gaps.

A `Formulation` is what a user chooses for a contact. It does not change. Its `Law` is the state of one contact in one
run: the rows, the forces on them, and the memory of a law that depends on the path. A new formulation implements these
two classes; `law.ContactLaw` has what most laws share.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args

import scipy.sparse as sp

from ...algebra.coulomb import Coulomb
from ...errors import InputError
from ...frames.kinematics import Rows
from ...reduction.body import ReducedBody
from ...support.arrays import Array
from ...surfaces.points import RowKind
from ..frozen import FrozenContacts
from ..gaps import Gaps
from ..plasticity.yielding_patches import Zones
from .step_mean import GeneralizedAlpha

Integrator = Literal["explicit", "implicit"]
INTEGRATORS: tuple[Integrator, ...] = get_args(Integrator)
Method = Literal[Integrator, "static"]


class Motion(Protocol):
    """What a law can ask of the running solver. Each value is computed when it is asked for."""

    @property
    def q(self) -> Array:
        """Coordinates of slave and master, (n,)."""

    @property
    def q_t(self) -> Array:
        """Velocities of the coordinates, (n,)."""

    @property
    def step(self) -> float:
        """Present step [s]; zero while the solver computes initial accelerations."""

    @property
    def start(self) -> float:
        """Time at the start of the step [s]."""

    @property
    def weights(self) -> GeneralizedAlpha:
        """Coefficients of generalized-alpha, in implicit runs."""


class Law(Protocol):
    """State of a contact in a run.

    Attributes
    ----------
    elastic : bool
        Whether forces follow from the coordinates alone and have a potential. Then they can be computed again after a
        run.
    compliant : bool
        Whether closed rows yield by a flexibility or layer of the contact itself. Then `press` tells by how much.
    ahead : bool
        Whether forces are applied ahead of each explicit step, by `forward_increment`, and not by a force element.
    remembers : bool
        Whether forces depend on those of earlier steps. Then `commit` and `rollback` matter.
    friction : Coulomb or None
    lam : (nr,) array
        Forces on the present rows [N].
    index : (na,) int array
        Rows that are closed.
    least_gap : float
        Smallest gap of the present rows, without the deformation by the contact's own flexibility [m].
    iterations, searches : int
        Number of iterations of the active set, and of searches for the pairs of all points, since the start of the run.
    """

    elastic: bool
    compliant: bool
    ahead: bool
    remembers: bool
    friction: Coulomb | None

    @property
    def yielding(self) -> Zones | None:
        """Plastic zones beneath the patches."""

    @property
    def gaps(self) -> Gaps:
        """The gaps."""

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
    def impulse(self) -> Array | None:
        """Impulses so far of laws in implicit runs whose forces are means within steps, (7,) [N s]; else None.

        Those of the normal forces, their sum and as a vector on the slave, and of the tangential forces on it.
        """

    @property
    def row_nodes(self) -> Array:
        """Node of the slave's patch for each present row, (nr,)."""

    @property
    def node_areas(self) -> Array:
        """Area of the row of each node of the slave's patch, (np,) [m2]; zero for a node without a row."""

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """Matrix from forces of the rows to pressures around the nodes of the slave's patch, (np, np) [1/m2]."""

    def for_run(self, method: Method) -> Law:
        """Return the state at the start of a run with this method; the law itself does not change."""

    def force(self, q: Array) -> Array:
        """Generalised contact force, (n,), at the coordinates q, (n,), of slave and master.

        Only of elastic laws, and of those with friction whose forces follow from q and from the last accepted step.
        """

    def evaluate(self, motion: Motion) -> Array:
        """Generalised contact force, (n,), of laws that are not elastic."""

    def tangent_matrix(self, by_q: float, by_q_t: float) -> Rows:
        """Return -(by_q dF/dq + by_q_t dF/dq_t), (n, n), of the force F, with the rows held."""

    def row_stiffness(self) -> Array:
        """Derivative of the forces on the closed rows by their gaps, (na, na) [N/m]; compliant laws only.

        With friction, of the forces along all three directions of the rows, (3 na, 3 na).
        """

    def row_jacobian(self) -> Rows:
        """Derivative of the gaps of closed rows by the coordinates, (na, n); with friction of all directions."""

    def row_carrier(self) -> Array:
        """The same by the velocities of the body that carries a rigid surface, (na, 6); with friction (3 na, 6)."""

    @property
    def traction(self) -> Array:
        """Tangential forces on the present rows in space, (nr, 3) [N]; zero without friction."""

    @property
    def state(self) -> Array:
        """Whether each present row is open, sticks or slips, (nr,) int8, see `algebra.friction`."""

    @property
    def slip_path(self) -> Array:
        """Path that the row of each node of the slave's patch has slipped so far, (np,) [m]."""

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps, rates and accelerations of an open contact, see `Gaps.closing`."""

    def commit(self, start: float) -> None:
        """Begin a step at time `start` [s]: the step before was accepted."""

    def flies_on(self, start: float) -> bool:
        """Begin a step at time `start` [s] in which, as in the one before, all rows are open; else do nothing.

        The last evaluation is the end of the step before. Return whether the step has begun, so that `commit` need not
        be called: there is nothing to remember but the places.
        """

    def rollback(self) -> None:
        """Forget everything since the last `commit`: the step is repeated with another length."""

    def resume(self, earlier: Any, q: Array) -> bool:
        """Go on from the end of an earlier run, whose law is `earlier`, if that ended at coordinates q, (n,).

        Return whether it did; only laws that remember are asked.
        """

    def closed_stiffness(self) -> Array | None:
        """Stiffness with all rows closed, (n, n), which limits explicit steps; None if it sets no limit."""

    def potential(self, q: Array) -> float:
        """Energy stored in the contact [J] at coordinates q, (n,); zero if the law stores none."""

    def stored(self) -> float:
        """Energy stored at present [J]."""

    def dissipated(self) -> float:
        """Energy that the contact has dissipated since the start of the run [J]."""

    def press(self, gap: Array) -> tuple[float, int]:
        """Stored energy [J] and number of closed rows for gaps of the present rows, (nr,) [m]; compliant laws."""

    def resultant(self) -> Array:
        """Force on the slave, (3,) [N]."""

    def moment(self, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m]."""

    def on_carrier(self, point: Array) -> Array:
        """Force on the body that carries the rigid surface, and moment about a point in space, (6,) [N, N m]."""

    def nodal_forces(self) -> list[Array]:
        """Forces on the nodes of the patches, in axes of space, (np, 3) for each side [N]."""

    def forces_on_nodes(self, q: Array, nodes: Array, lam: Array, traction: Array) -> list[Array]:
        """Forces on the nodes of the patches, as `nodal_forces`, of rows that were closed at coordinates q, (n,).

        Parameters
        ----------
        q : (n,) array
        nodes : (na,) int array
            Nodes of the slave's patch that the rows belong to.
        lam, traction : (na,), (na, 3) arrays
            Normal forces on them, and tangential forces in space [N]; these are zero without friction.
        """

    def edge_reached(self) -> Array | None:
        """Place of a closed row at the edge of the contact patch, (3,) [m]; None if there is none."""

    def check(self, q: Array) -> None:
        """Raise RunError if the solver did not apply the forces as the law needs; q, (n,), are the coordinates."""


class Together(Protocol):
    """State of several elastic contacts on common bodies. Their forces are computed together."""

    def forces_at(self, state: Array, coordinates: Callable[[], Sequence[Array]]) -> list[Array]:
        """Generalised forces of each contact, (n,), see `coupled.CoupledContacts.forces_at`."""

    def forces(self, coordinates: Sequence[Array]) -> list[Array]:
        """Generalised forces of each contact, (n,), at its coordinates."""

    def stiffness(self, law: Any, other: Any) -> Array:
        """Derivative of the forces on closed rows of `law` by gaps of closed rows of `other`, (na, nb) [N/m]."""

    def for_run(self, laws: Sequence[Any]) -> Together:
        """Return the state at the start of a run with these laws."""

    def frozen(self, dofs: Sequence[Array], last: FrozenContacts | None) -> FrozenContacts | None:
        """All contacts at once in compiled loops, or None, see `coupled.CoupledContacts.frozen`."""

    def take(self, frozen: FrozenContacts, coordinates: Sequence[Array]) -> bool:
        """Let the laws take the state that `frozen` has found, see `coupled.CoupledContacts.take`."""


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
        Place of its coordinates in those of each contact.
    other : str
        Name of the other contact.
    """

    body: ReducedBody
    name: str
    patches: tuple[int, int]
    mass: Array
    columns: tuple[slice, slice]
    other: str


class Links(Protocol):
    """What the sides of several laws push each other by."""

    @property
    def shared(self) -> bool:
        """Whether two of the laws have the same patch of the same body."""

    def __call__(self) -> list[Any]:
        """Flexibilities between the sides, see `coupled.CoupledContacts`. They are asked for once, at the first run."""


class Formulation(Protocol):
    """How forces follow from gaps; it does not change.

    Attributes
    ----------
    rows : {"integrated", "node-to-segment"}
        Default kind of the gap rows.
    """

    rows: RowKind = "integrated"

    def check(self, bodies: Sequence[ReducedBody]) -> None:
        """Raise InputError if the bases of the bodies lack what the formulation needs."""

    def law(self, gaps: Gaps) -> Law:
        """Return the law at the start."""

    def with_friction(self, friction: Coulomb) -> Formulation:
        """Return the same formulation with friction.

        Raises
        ------
        InputError
            If there is none.
        """
        raise InputError(
            f"friction: formulation {type(self).__name__} has none; take formulation='compliance', 'lagrange' or "
            "'penalty', or leave friction out"
        )

    def couples(self, law: Law, other: Law, shared: SharedBody) -> bool:
        """Whether forces of each contact on a body change the gaps of the other, so that both are solved together.

        Raises
        ------
        InputError
            If the two contacts cannot be computed on one body.
        """
        if shared.patches[0] == shared.patches[1]:
            raise InputError(
                f"body {shared.name!r}: its patch {shared.patches[0]} already has the contact {shared.other!r}. Each "
                "contact would use all of its residual flexibility. Make a patch for each contact "
                "(Partition.ball(...) | Partition.ball(...)), or take formulation='compliance' without friction and "
                "plastic zones, or basis='free' with formulation='lagrange'"
            )
        return False

    def together(self, laws: Sequence[Any], links: Links) -> Together | None:
        """Return the object that solves several contacts together; None if each contact is solved alone.

        Parameters
        ----------
        laws : sequence of Law
        links : Links
        """
        return None
