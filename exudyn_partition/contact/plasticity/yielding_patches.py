"""Plastic zones beneath the patches of a contact: the paper's impact region II, without mass of its own."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...algebra.secants import DEPTH, Anderson, Secant
from ...errors import ComplementarityError
from ...plasticity.flow import PlasticState
from ...support.arrays import Array
from ...support.attributes import copied
from .yielding_zone import Flowed, Push, YieldingZone, ZoneGuess, ZoneStep, combined
from .zone_motion import ZoneMotion
from .zone_state import NodalState, ZoneState

if TYPE_CHECKING:
    from typing import Self

_SETTLED = 1e-4  # what the pseudo-forces lack, relative
# Plastic strain may be far larger than elastic strain. So what it lacks is also at most this share of elastic strain,
# unless that takes too many iterations.
_OF_STRESS, _PATIENT = 0.1, 30
_SETTLED_FOR_NEWTON = 5e-8  # in implicit and static steps: Newton's method does not converge on rough forces
_ROUGH, _STALLED = 2e-6, 4  # accept this change if it has not decreased in so many iterations, because of rounding
_MOST = 60  # iterations

OnPatches = Callable[[Sequence[Array]], list[Array]]  # forces on patches, (r,) [N], by displacements of their rows [m]


class Zone(Protocol):
    """A plastic zone beneath a patch.

    Attributes
    ----------
    motion : ZoneMotion
    start : ZoneState or NodalState
        At the start of each run.
    """

    motion: ZoneMotion
    start: Any


class Rows(Protocol):
    """Rows of a contact, with d directions each, see `NormalRows` and `TangentialRows`."""

    d: int

    @property
    def gaps(self) -> Any:
        """Gaps of the rows."""

    def side_rows(self, side: int) -> Any:
        """Rows on the flexibility coordinates of one side's patch, (d nr, r)."""


@dataclass(frozen=True, eq=False)
class ZonesAnswer:
    """What plastic zones do in a step.

    Parameters
    ----------
    sides : tuple of int
        Number of each zone's side.
    before, after : tuples of ZoneState or NodalState
        At the begin and at the end of the step.
    places : tuple of slice
        Where the coordinates that each zone pushes are among those of the contact.
    guesses : tuple of ZoneGuess
        Where the next answer in the same step may begin.
    iterations : int
    unsettled : float
        By how much the last iteration changed the forces, relative, if it was not the last for having settled.
    """

    sides: tuple[int, ...]
    before: tuple[Any, ...]
    after: tuple[Any, ...]
    places: tuple[slice, ...]
    guesses: tuple[ZoneGuess, ...] = ()
    iterations: int = 0
    unsettled: float = 0.0

    def check(self) -> None:
        """Refuse a step that ends so, if this is no solution.

        Raises
        ------
        ComplementarityError
        """
        if self.unsettled:
            raise ComplementarityError(
                f"plastic flow did not settle in {_MOST} iterations; the last one changed its forces by "
                f"{self.unsettled:.2g}. Take smaller steps, or a finer mesh in the plastic zone"
            )

    def generalised(self, on_rows: Array) -> Array:
        """Generalised forces, (n,), of rows and zones; `on_rows`, (n,), are those of the rows."""
        force = on_rows
        for place, state in zip(self.places, self.after, strict=True):
            if state.generalised.any():
                force = force.copy()
                force[place] += state.generalised
        return force

    @property
    def present(self) -> dict[int, PlasticState]:
        """Plastic state of each zone; keys are the numbers of the sides."""
        return {side: state.plastic for side, state in zip(self.sides, self.after, strict=True)}

    @property
    def stored(self) -> float:
        """Elastic energy that plastic strain adds [J]."""
        return float(sum(state.stored for state in self.after))

    @property
    def work(self) -> float:
        """Plastic work since the start of the run [J]."""
        return float(sum(state.work for state in self.after))

    @property
    def largest_strain(self) -> float:
        """Largest equivalent plastic strain."""
        return max(float(plastic.equivalent.max()) for plastic in self.present.values())

    @property
    def flowing(self) -> int:
        """Number of points that flow in the step."""
        both = zip(self.before, self.after, strict=True)
        return sum(int(np.count_nonzero(new.plastic.equivalent > old.plastic.equivalent)) for old, new in both)


class Zones:
    """Plastic zones beneath the patches of a contact: what all kinds of them have. They have no state.

    Parameters
    ----------
    zones : sequence of (int, Zone)
        Number of the side, and its zone.
    sizes : sequence of int
        Numbers of coordinates of the contact's sides.

    Attributes
    ----------
    secant : Secant or None
        First guess for Newton's method, see `YieldingPatches`; None if the run has none.
    """

    zones: Sequence[tuple[int, Zone]]
    secant: Secant | None = None

    def __init__(self, zones: Sequence[tuple[int, Zone]], sizes: Sequence[int]) -> None:
        ends = np.cumsum(sizes)
        self.zones, self._sides = zones, tuple(side for side, _ in zones)
        lengths = [zone.motion.kinematics.rows.shape[1] for _, zone in zones]
        self._places = tuple(
            slice(int(ends[side]) - n, int(ends[side])) for side, n in zip(self._sides, lengths, strict=True)
        )

    def for_run(self, method: str) -> Self:
        """Return the same zones for a run with this method."""
        raise NotImplementedError

    @property
    def motions(self) -> list[tuple[int, ZoneMotion]]:
        """For each side that can yield: its number, and its plastic zone."""
        return [(side, zone.motion) for side, zone in self.zones]

    @property
    def start(self) -> tuple[ZoneState | NodalState, ...]:
        """States at the start of each run."""
        return tuple(zone.start for _, zone in self.zones)

    def last(self, states: Sequence[ZoneState | NodalState]) -> ZonesAnswer:
        """Answer of a step that ended in these states, from which a run begins."""
        return self._answer(states, states)

    def _answer(self, before: Sequence[Any], after: Sequence[Any], *iteration: Any) -> ZonesAnswer:
        return ZonesAnswer(self._sides, (*before,), (*after,), self._places, *iteration)


class YieldingPatches(Zones):
    """Plastic zones beneath the patches of a contact.

    At coordinates q, with h(q) the gaps of the kept shapes, F the residual flexibilities, G the rows and p the
    pseudo-forces of plastic strain e_p on the nodes z of the zones, a step solves::

        lambda = LCP(h + G F p),    u_z = Phi_z q + F (p + G' lambda),    e_p from u_z by radial return,    p from e_p

    by a fixed-point iteration on p with Anderson acceleration. Like the contact, the zones have no mass of their own.
    Generalised forces are Phi' (G' lambda + p).

    In implicit and static steps, Newton's method also tries states far from the answer. There the iteration may not
    converge. Then its last forces are used, and `ZonesAnswer.check` refuses a step that ends in such a state. The
    stiffness of rows alone would be too large where much material flows. So it is corrected by `secant`, from the last
    step of Newton's method.

    A step in which nothing yields needs one evaluation of the strains. It needs none if a bound on the stresses shows
    that nothing yields.

    Parameters
    ----------
    zones : sequence of (int, ZoneMotion)
        Number of the side, and the zone beneath its patch.
    sizes : sequence of int
        Numbers of coordinates of the contact's sides.
    """

    zones: list[tuple[int, YieldingZone]]

    def __init__(self, zones: Sequence[tuple[int, ZoneMotion]], sizes: Sequence[int]) -> None:
        super().__init__([(side, YieldingZone(motion)) for side, motion in zones], sizes)
        self._settled = _SETTLED
        self._side_rows: dict[int, tuple[object, Array]] = {}  # kept to save time

    def for_run(self, method: str) -> Self:
        """See `Zones`."""
        result, explicit = copied(self), method == "explicit"
        # For forces accurate to 1e-4, single precision is enough. It halves the memory that products read.
        kind = np.float32 if explicit else np.float64
        result.zones = [(side, zone.in_precision(kind)) for side, zone in self.zones]
        result._settled = _SETTLED if explicit else _SETTLED_FOR_NEWTON
        result.secant = None if explicit else Secant()
        result._side_rows = {}
        return result

    def solve(
        self,
        states: Sequence[Any],
        parts: Sequence[Array],
        rows: Rows,
        respond: Callable[[Array], Array],
        pushed: Array,
        earlier: ZonesAnswer | None = None,
    ) -> ZonesAnswer:
        """Find the states after a step, together with the forces on the rows.

        Parameters
        ----------
        states : sequence of ZoneState
            Of the zones at the begin of the step.
        parts : sequence of (n,) arrays
            Coordinates of each side at its end.
        rows : NormalRows or TangentialRows
            The present ones.
        respond : callable
            Returns the forces on the rows, (nr, d) [N]. Its argument is the displacement of the rows due to zones and
            other contacts, in this shape [m]. The answer belongs to the last call.
        pushed : (nr, d) array
            Displacement of the rows due to other contacts.
        earlier : ZonesAnswer, optional
            An answer for other coordinates in the same step. The iteration begins with its guesses, which saves time.
            They change the answer by no more than a step leaves to the next one.

        Raises
        ------
        ComplementarityError
            In explicit steps, if flow does not settle. Otherwise `ZonesAnswer.check` raises it.
        """
        earlier_guesses = () if earlier is None else earlier.guesses
        guesses: Sequence[ZoneGuess | None] = earlier_guesses or [None] * len(states)
        begins = zip(self.zones, states, guesses, strict=True)
        steps = [zone.step(state, parts[side], guess) for (side, zone), state, guess in begins]
        on_patches = self._on_patches(steps, rows, respond, pushed)
        if not all(state.goes_on for state in states):
            forces = on_patches([state.applied.moved_patch for state in states])
            by_zone = list(zip(steps, forces, strict=True))
            flows = [step.begins_to_flow(force) for step, force in by_zone]
            if not any(flows):
                return self._answer(states, [step.elastic(force) for step, force in by_zone], _guesses(steps))
            steps = [flowing or step for step, flowing in zip(steps, flows, strict=True)]
        iterations = 0
        while True:
            ends, tried, unsettled = self._iterate(steps, on_patches)
            iterations += tried
            after = [end for end in ends if isinstance(end, ZoneState)]
            if len(after) == len(ends):
                answer = self._answer(states, after, _guesses(steps), iterations, unsettled)
                if self.secant is None:
                    answer.check()
                return answer
            steps = [end if isinstance(end, ZoneStep) else step for step, end in zip(steps, ends, strict=True)]

    def _iterate(
        self, steps: Sequence[ZoneStep], on_patches: OnPatches
    ) -> tuple[list[ZoneState | ZoneStep], int, float]:
        """Find the pseudo-forces of the active points.

        Returns
        -------
        list of ZoneState or ZoneStep
            See `ZoneStep.after`.
        int
            Number of iterations.
        float
            See `ZonesAnswer.unsettled`.
        """
        first, pushes, anderson = [step.first for step in steps], deque[list[Push]](maxlen=DEPTH + 1), Anderson()
        p, places = np.concatenate(first), np.cumsum([len(change) for change in first])[:-1]
        least, stalled, before = math.inf, 0, 0.0
        close = min(self._settled, _OF_STRESS * _elastic_share(steps))
        for tried in range(_MOST):
            parts = np.split(p, places)
            pushes.append([step.push(part if tried else None) for step, part in zip(steps, parts, strict=True)])
            flowed = _flow(steps, pushes[-1], on_patches)
            asked, size = _asked_for(steps, flowed)
            change = float(np.linalg.norm(asked - p))
            least, stalled = min(change, least), stalled + 1 if change >= least else 0
            # What an answer still lacks, by its change, if changes go on to decrease as the last one has.
            lacks = change / (before - change) if 2 * change < before else 1.0
            before, settled = change, (self._settled if tried >= _PATIENT else close) * size
            if lacks * change <= settled or (stalled >= _STALLED and change <= _ROUGH * size):
                return _ends(steps, flowed), tried + 1, 0.0
            p = anderson.guess(p, asked)
            if lacks * anderson.least <= settled:  # so the best combination of all guesses may do, without a product
                last = list(pushes)[-len(anderson.shares) :]
                mixed = [combined(of_zone, anderson.shares) for of_zone in zip(*last, strict=True)]
                flowed = _flow(steps, mixed, on_patches)
                asked = np.concatenate([flow.asks_for for flow in flowed])
                if lacks * np.linalg.norm(asked - np.concatenate([push.change for push in mixed])) <= settled:
                    return _ends(steps, flowed), tried + 1, 0.0
        return _ends(steps, flowed), _MOST, float(change / size)

    def _on_patches(
        self, steps: Sequence[ZoneStep], rows: Rows, respond: Callable[[Array], Array], pushed: Array
    ) -> OnPatches:
        """Forces on the patches by displacements of their rows.

        Tangential places of the contact's rows count from the end of the last accepted step.
        """
        on_sides = [self._rows_of(rows, side) for side, _ in self.zones]
        stood = [on_side @ step.state.applied.moved_patch for on_side, step in zip(on_sides, steps, strict=True)]

        def on_patches(moved: Sequence[Array]) -> list[Array]:
            total = np.zeros((1, 1))
            for on_side, of_patch, before in zip(on_sides, moved, stood, strict=True):
                places = (on_side @ of_patch).reshape(-1, rows.d)
                places[:, 1:] -= before.reshape(-1, rows.d)[:, 1:]
                total = total + places
            forces = respond(pushed + total).ravel()
            return [on_side.T @ forces for on_side in on_sides]

        return on_patches

    def _rows_of(self, rows: Rows, side: int) -> Array:
        """Rows on the flexibility coordinates of a side's patch, (d nr, r)."""
        gaps = rows.gaps
        stays = not gaps.moving or (side == 0 and gaps.slave.normal_only)  # no normals, and points keep their nodes
        kept = self._side_rows.get(side)
        if stays and kept is not None and kept[0] == gaps.stage.rows:
            return kept[1]
        on_coordinates = rows.side_rows(side)
        on_coordinates = on_coordinates if isinstance(on_coordinates, np.ndarray) else on_coordinates.toarray()
        self._side_rows[side] = gaps.stage.rows if stays else None, on_coordinates
        return on_coordinates


def _flow(steps: Sequence[ZoneStep], pushes: Sequence[Push], on_patches: OnPatches) -> list[Flowed]:
    """Flow in each zone by what was pushed in all of them."""
    both = list(zip(steps, pushes, strict=True))
    forces = on_patches([step.moved_patch(push) for step, push in both])
    return [step.flow(push, force) for (step, push), force in zip(both, forces, strict=True)]


def _asked_for(steps: Sequence[ZoneStep], flowed: Sequence[Flowed]) -> tuple[Array, float]:
    """Change of the pseudo-forces of all zones that flow asks for, and norm of the pseudo-forces after it [N]."""
    sizes = [step.size(flow.asks_for) for step, flow in zip(steps, flowed, strict=True)]
    return np.concatenate([flow.asks_for for flow in flowed]), float(np.linalg.norm(sizes))


def _guesses(steps: Sequence[ZoneStep]) -> tuple[ZoneGuess, ...]:
    return tuple(step.guess for step in steps)


def _ends(steps: Sequence[ZoneStep], flowed: Sequence[Flowed]) -> list[ZoneState | ZoneStep]:
    return [step.after(flow) for step, flow in zip(steps, flowed, strict=True)]


def _elastic_share(steps: Sequence[ZoneStep]) -> float:
    """Elastic strain divided by plastic strain, where a zone has flowed most; the least of all zones."""
    least = math.inf
    for step in steps:
        flow, most = step.zone.motion.zone.flow, step.state.plastic.equivalent.max()
        if most > 0.0:
            least = min(least, float(flow.flow_stress(most) / (3 * flow.shear_modulus * most)))
    return least
