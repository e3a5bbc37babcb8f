"""Interface of a contact law: how the forces on the rows of a contact follow from where the rows are.

A law is a function of the rows and of the contact's memory. `patch_contact.PatchContact` has the state. With friction,
a row has three directions, d = 3. Without, it has its normal alone, d = 1. No other code asks which law a contact has.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import scipy.sparse as sp

from ..algebra.products import Solved, smallest
from ..algebra.row_problem import RowProblem
from ..errors import InputError
from ..frames.kinematics import Rows
from ..support.arrays import Array
from ..support.attributes import FoundOnce
from .gaps import Gaps
from .plasticity.yielding_patches import Zones
from .step_mean import GeneralizedAlpha

Slope: TypeAlias = Array | sp.spmatrix | Solved
_NO_ARRAY = np.dtype(object)  # for what has no type of its entries


class Forces(NamedTuple):
    """Answer of a law.

    Parameters
    ----------
    on_rows : (nr, d) array
        Forces on the rows [N]: along the normal, and with friction also along both tangents.
    closed : (na,) int array
        Numbers of the rows that are closed, in ascending order. Forces on other rows do not count.
    state : (nr,) int8 array, optional
        With friction, whether each row is OPEN, sticks or slips: the constants of `algebra.friction`. Results and the
        coefficient in the next step need it.
    slips : (nr, 2) array, optional
        With friction within the steps, how far rows have slipped since the last accepted step [m].
    power : float
        Energy that the law itself takes per time, as by damping [W]; friction does not count. Only a law that is not
        `elastic` takes any.
    taken : float
        Energy that it takes in this step, as by damage, besides that of `power` [J].
    memory : (nr, k) array, optional
        What rows remember if the step ends so, see `Law.memory`. A law with a memory gives it in each answer.
    stored : float, optional
        Energy that is stored [J], zero where forces begin. Default: half of the normal forces times the depths.
    stiffness : callable, optional
        Returns minus the derivative of forces on closed rows with respect to their places, (d na, d na) [N/m]. Implicit
        and static runs need it. It may be `Solved`: as a rule the bodies have fewer coordinates than a large contact
        has directions of rows.
    damping : callable, optional
        Returns minus the derivative of forces on closed rows with respect to their rates, (d na, d na) [N s/m].
        Implicit runs need it if forces depend on rates.
    iterations : int
        How many iterations of the set of closed rows were needed.
    """

    on_rows: Array
    closed: Array
    state: Array | None = None
    slips: Array | None = None
    power: float = 0.0
    taken: float = 0.0
    memory: Array | None = None
    stored: float | None = None
    stiffness: Callable[[], Slope] | None = None
    damping: Callable[[], Slope] | None = None
    iterations: int = 0

    def energy(self, gap: Array) -> float:
        """Energy that is stored [J]; `gap`, (nr,) [m], are the gaps without displacements that others cause."""
        return -0.5 * float(np.vdot(self.on_rows[:, 0], gap)) if self.stored is None else self.stored  # never warns


class Motion(Protocol):
    """State of the running solver, for laws. Each value is computed when it is needed."""

    @property
    def q(self) -> Array:
        """Coordinates of slave and master, (n,)."""

    @property
    def q_t(self) -> Array:
        """Velocities of the coordinates, (n,), at the time of `q`."""

    @property
    def step(self) -> float:
        """Present step [s]; zero while the solver computes initial accelerations."""

    @property
    def start(self) -> float:
        """Time at the start of the step [s]."""

    @property
    def weights(self) -> GeneralizedAlpha:
        """Coefficients of generalized-alpha, in implicit runs."""


class Places:
    """Places of the rows.

    Parameters
    ----------
    gap : (nr,) array
        Gaps [m], including the displacements due to other contacts and plastic zones.
    way : (nr, d - 1) array, optional
        How far rows have slid along their tangents since the last accepted step [m]. Default, without friction: no
        tangents.
    last : (nr, 3) array, optional
        Forces along normal and tangents at the end of the last accepted step [N]. Default, without friction: zero.
    mu : (nr,) array, optional
        Coefficients of friction in this step. Default: zero.
    problem : RowProblem, optional
        How forces move the rows in the coming step, for laws that act ahead of steps. For these laws, places are those
        at the end of the step without forces.
    motion : Motion, optional
        State of the solver. None for laws that act ahead of steps, and when forces are found again after a run.
    since : float
        Start of the present step [s].
    memory : (nr, k) array, optional
        What rows remember from the last accepted step, see `Law.memory`; None if the law has no memory.
    find_rates : callable, optional
        Finds `rates` for `motion`.
    find_way : callable, optional
        Finds `way` when it is asked for first, where the rows are at present.
    least : float, optional
        Smallest gap [m], if it is known.
    """

    def __init__(
        self,
        gap: Array,
        way: Array | None = None,
        last: Array | None = None,
        mu: Array | None = None,
        *,
        problem: RowProblem | None = None,
        motion: Motion | None = None,
        since: float = 0.0,
        memory: Array | None = None,
        find_rates: Callable[[Motion | None], Array] | None = None,
        find_way: Callable[[], Array] | None = None,
        least: float | None = None,
    ) -> None:
        if least is not None:
            self.least = least
        self.gap, self._find_way = gap, find_way
        if way is not None:
            self.way = way
        if last is not None:
            self.last = last
        if mu is not None:
            self.mu = mu
        self.motion, self.since, self._problem, self._find_rates = motion, since, problem, find_rates
        self._memory = memory

    @FoundOnce
    def way(self) -> Array:
        """See `Places`; without friction, rows have no tangents."""
        return np.empty((len(self.gap), 0)) if self._find_way is None else self._find_way()

    @FoundOnce
    def least(self) -> float:
        """Smallest gap [m]."""
        return smallest(self.gap)

    @FoundOnce
    def last(self) -> Array:
        """See `Places`."""
        return np.zeros((len(self.gap), 3))

    @FoundOnce
    def mu(self) -> Array:
        """See `Places`."""
        return np.zeros(len(self.gap))

    @property
    def problem(self) -> RowProblem:
        """How forces move the rows in the coming step; only for laws that act ahead of steps."""
        assert self._problem is not None, "only laws with ahead = True have a problem"
        return self._problem

    @property
    def memory(self) -> Array:
        """What rows remember from the last accepted step, (nr, k), zero at the start; only for laws with a `memory`."""
        assert self._memory is not None, "only laws with memory > 0 remember"
        return self._memory

    @FoundOnce
    def rates(self) -> Array:
        """Rates of gaps and tangential places, (nr, d) [m/s], computed when they are asked for first.

        That of a gap is negative while surfaces approach.

        They are those of the bodies, and of what carries a rigid surface, for fixed pairs. Only laws with elastic =
        False have them. They are zero in static runs, and while a run chooses its step before it moves.
        """
        if self._find_rates is None:
            return np.zeros((len(self.gap), 1 + self.way.shape[1]))
        return self._find_rates(self.motion)


class Law:
    """How forces on rows follow from where the rows are.

    One object serves one contact in one run. It may keep data that save time, but answers follow from `Places` alone:
    solvers ask several times in a step, also at places that are given up, and each run has a law of its own. What
    a row must remember is part of the answer, and comes back with the places of the next step.

    Attributes
    ----------
    compliant : bool
        Whether closed rows yield through a flexibility or layer of the contact itself.
    ahead : bool
        Whether forces are found ahead of each step, from the places that rows would have at its end without forces.
        Then forces are constant within the step. Otherwise they belong to the time at which they are found.
    elastic : bool
        Whether forces without friction follow from the coordinates alone and have a potential, so that they can be
        found again after a run. A law that asks for rates, or takes energy, is not elastic. The default step of a run
        resolves impacts of elastic laws that have no reach; for others, choose it.
    reach : float
        Gap at which forces begin [m]: above zero for surfaces that attract each other, or a soft layer. Only laws
        within steps have one. Rows within reach count as closed, also if they pull.
    residual : bool
        Whether rows yield through the residual flexibility of their bodies, which the bodies' damping may delay.
    memory : int
        How many values each row remembers from step to step, as its largest opening: `Places.memory` and
        `Forces.memory`. A law with a memory acts within steps, and is not elastic.
    """

    compliant = True
    memory = 0
    reach = 0.0
    residual = False
    ahead = False
    elastic = True

    def answer(self, places: Places) -> Forces:
        """Return the forces on the rows. It is called only if a gap is below `reach`, or if the law has a memory.

        A law that acts ahead of steps may get the rows of several contacts at once. These contacts share bodies; in a
        model with joints, they are all contacts with such a law. Such a law has no attributes of its own.
        """
        raise NotImplementedError(f"{type(self).__name__} has no answer")

    def closed_stiffness(self, rows: RowDirections) -> Array | None:
        """Contact stiffness on the coordinates, (n, n), with all rows closed and stuck. It limits explicit steps.

        None if the law sets no limit.
        """
        return None

    @property
    def left_out(self) -> list[str]:
        """Sentences on the effects that the law leaves out."""
        return []

    def semi_axes(self, force: float) -> tuple[float, float] | None:
        """Semi-axes of the ellipse of contact under a force [N], the larger first [m]; None if rows tell them."""
        return None


class RowDirections(Protocol):
    """Rows of a contact with their d directions: the normal, with friction also two tangents."""

    d: int

    @property
    def gaps(self) -> Gaps:
        """Gaps of the rows."""

    def jacobian(self, index: Array) -> Rows:
        """Derivative of the places of some rows with respect to the coordinates, (d na, n), for fixed pairs."""

    def flexibility(self, index: Array) -> Array:
        """Residual flexibility of some rows, (d na, d na) [m/N]."""

    def pushing(self, index: Array) -> Array:
        """Motion of all rows along their normals by unit forces on some, (nr, d na) [m/N]; not if `on_demand`.

        It is found where the flexibility was.
        """


class LawMaker(Protocol):
    """Maker of the law of a contact: a formulation, see `formulations.formulation.Formulation`."""

    def law(self, rows: RowDirections) -> Law:
        """Return the law of a contact with these rows."""

    def zones(self, contact: Any) -> Zones | None:
        """Return plastic zones of a `PatchContact`, if patches of its bodies yield."""


def check_forces(law: Law, forces: Forces, n: int, d: int) -> None:
    """Raise InputError if a law's answer for n rows with d directions cannot be right."""
    name = type(law).__name__
    if not isinstance(forces, Forces):
        raise InputError(f"law {name}: expected an answer of type contact.law.Forces, got {type(forces).__name__}")
    if getattr(forces.on_rows, "shape", None) != (n, d):
        raise InputError(
            f"law {name}: expected forces of shape {(n, d)}, rows by directions, got {np.shape(forces.on_rows)}"
        )
    if getattr(forces.closed, "dtype", _NO_ARRAY).kind not in "iu":
        raise InputError(
            f"law {name}: expected numbers of the closed rows, an array of integers as np.flatnonzero(forces) "
            f"returns it, got {getattr(forces.closed, 'dtype', type(forces.closed).__name__)}"
        )
    if not (isinstance(forces.power, float) and isinstance(forces.taken, float)):
        _check_energies(name, forces)
    if law.elastic and (forces.power or forces.taken):
        raise InputError(f"law {name}: it takes energy, which only laws with elastic = False do")
    remembered = None if forces.memory is None else np.shape(forces.memory)
    if (law.memory or remembered) and remembered != (n, law.memory):
        raise InputError(
            f"law {name}: expected a memory of shape {(n, law.memory)}, rows by the values that `memory` of the "
            f"law says, got {remembered}"
        )


def _check_energies(name: str, forces: Forces) -> None:
    """Raise InputError if the energies in the answer of a law of this name are no numbers."""
    for key, value in (("power", forces.power), ("taken", forces.taken)):
        if np.ndim(value) != 0:
            raise InputError(
                f"law {name}: expected one number as `{key}`, the sum over the rows, got the shape {np.shape(value)}"
            )
