"""Plastic zones beneath the patches of a contact: the paper's impact region II, without mass of its own."""

from __future__ import annotations

import copy
import math
import weakref
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from ...algebra.secants import Anderson, Broyden
from ...errors import ComplementarityError
from ...plasticity.flow import PlasticState
from ...plasticity.zone import PlasticZone
from ...support.arrays import Array
from .zone_run import ZoneMotion, ZoneRun
from .zone_state import NodalState, ZoneState

_SETTLED = 1e-4  # what the pseudo-forces lack, relative
# Plastic strain may be far larger than elastic strain. So what it lacks is also at most this share of elastic strain,
# unless that takes too many iterations.
_OF_STRESS, _PATIENT = 0.1, 30
_SETTLED_FOR_NEWTON = 5e-8  # in implicit and static steps: Newton's method does not converge on rough forces
_ROUGH, _STALLED = 2e-6, 4  # accept this change if it has not decreased in so many iterations, because of rounding
_MOST = 60  # iterations


class Zone(Protocol):
    """State of a plastic zone in a run.

    Attributes
    ----------
    motion : ZoneMotion
    zone : PlasticZone
    state : ZoneState or NodalState
        At the end of the last accepted step.
    present : PlasticState
        Of the last answer.
    work : float
        Plastic work since the start of the run [J].
    """

    motion: ZoneMotion
    zone: PlasticZone
    state: Any
    present: PlasticState
    work: float

    def begin(self, state: Any) -> None:
        """Begin from a state."""

    def after(self) -> Any:
        """State after a step that ends with the last answer."""

    def accept(self, state: Any) -> None:
        """Accept the step whose end this state is."""

    def retry(self) -> None:
        """Begin the step again, from the state that was accepted last."""

    def stored(self) -> float:
        """Elastic energy that plastic strain adds [J]."""


class Zones:
    """Plastic zones beneath the patches of a contact: interface of all kinds.

    Attributes
    ----------
    zones : list of (int, ZoneRun or NodalZone)
        Number of the side, and its zone.
    """

    zones: Sequence[tuple[int, Zone]]

    def check(self) -> None:
        """Refuse a step that ends in the present states, if they are no solution.

        Raises
        ------
        ComplementarityError
        """

    def tangent(self, of_rows: Array) -> Array:
        """Stiffness -df/dq, (n, n), of rows and zones; `of_rows`, (n, n), is that of the rows if nothing flows."""
        return of_rows

    def for_run(self, contact: Any, method: str) -> Zones:
        """Return the same zones in their start state, for the contact of another run with this method."""
        raise NotImplementedError

    def solve(self, respond: Callable[[Array], Array], pushed: Array) -> None:
        """Find the states together with the forces on the rows, see `YieldingPatches.solve`."""
        respond(pushed)

    def forces(self, parts: Sequence[Array]) -> Array:
        """Generalised forces of the zones alone, (n,), at the coordinates of each side."""
        return np.zeros(sum(map(len, parts)))

    def generalised(self, contact: Array) -> Array:
        """Generalised forces, (n,), of rows and zones; `contact`, (n,), are those of the rows."""
        return contact

    # State.

    def after(self) -> tuple[ZoneState | NodalState, ...]:
        """States of the zones after a step that ends with the last answer."""
        return tuple(zone.after() for _, zone in self.zones)

    def accept(self, states: Sequence[ZoneState | NodalState]) -> None:
        """Accept the step whose end these states are; it is refused if they are no solution, see `check`."""
        self.check()
        for (_, zone), state in zip(self.zones, states, strict=True):
            zone.accept(state)

    def retry(self) -> None:
        """Begin the step again, from the states that were accepted last."""
        for _, zone in self.zones:
            zone.retry()

    def begin(self, states: Sequence[ZoneState | NodalState]) -> None:
        """Begin from these states."""
        for (_, zone), state in zip(self.zones, states, strict=True):
            zone.begin(state)

    def stored(self) -> float:
        """Elastic energy that plastic strain adds [J]."""
        return sum(zone.stored() for _, zone in self.zones)

    def work(self) -> float:
        """Plastic work since the start of the run [J]."""
        return sum(zone.work for _, zone in self.zones)

    def largest_strain(self) -> float:
        """Largest equivalent plastic strain."""
        return max(float(zone.present.equivalent.max()) for _, zone in self.zones)

    def flowing(self) -> int:
        """Number of points that flow in the present step."""
        return sum(int(np.count_nonzero(z.present.equivalent > z.state.plastic.equivalent)) for _, z in self.zones)


class YieldingPatches(Zones):
    """Plastic zones beneath the patches of a contact.

    At coordinates q, with h(q) the gaps of the kept shapes, F the residual flexibilities, G the rows and p the
    pseudo-forces of plastic strain e_p on the nodes z of the zones, a step solves::

        lambda = LCP(h + G F p),    u_z = Phi_z q + F (p + G' lambda),    e_p from u_z by radial return,    p from e_p

    by a fixed-point iteration on p with Anderson acceleration. Like the contact, the zones have no mass of their own.
    Generalised forces are Phi' (G' lambda + p).

    In implicit and static steps, Newton's method also tries states far from the answer. There the iteration may not
    converge. Then its last forces are used, and `check` refuses a step that ends in such a state. The stiffness of rows
    alone would be too large where much material flows. It is corrected from the last step of Newton's method.

    A step in which nothing yields needs one evaluation of the strains. It needs none if a bound on the stresses shows
    that nothing yields.

    Parameters
    ----------
    contact : PatchContact

    Attributes
    ----------
    zones : list of (int, ZoneRun)
        Number of the side, and its zone.
    iterations : int
    """

    zones: list[tuple[int, ZoneRun]]

    def __init__(self, contact: Any) -> None:
        zones = [(number, side.zone) for number, side in enumerate(contact.gaps.sides)]
        self.zones = [(number, ZoneRun(zone)) for number, zone in zones if zone is not None]
        self._take(contact)

    def _take(self, contact: Any, method: str = "explicit") -> None:
        self._contact, self.iterations = weakref.ref(contact), 0  # which holds the zones
        self._settled = _SETTLED if method == "explicit" else _SETTLED_FOR_NEWTON
        self._broyden = None if method == "explicit" else Broyden()
        self._unsettled = 0.0
        self._rows: dict[int, tuple[object, Array]] = {}

    @property
    def contact(self) -> Any:
        """The contact."""
        return self._contact()

    def for_run(self, contact: Any, method: str) -> YieldingPatches:
        """See `Zones`."""
        result = copy.copy(self)
        # For forces accurate to 1e-4, single precision is enough. It halves the memory that products read.
        kind = np.float32 if method == "explicit" else np.float64
        result.zones = [(number, zone.for_run(kind)) for number, zone in self.zones]
        result._take(contact, method)
        return result

    def solve(self, respond: Callable[[Array], Array], pushed: Array) -> None:
        """Find the state at the present coordinates.

        Parameters
        ----------
        respond : callable
            Returns the forces on the rows, (nr, d) [N]. Its argument is the displacement of the rows due to zones and
            other contacts, (nr, d) [m].
        pushed : array
            Displacement of the rows due to other contacts.
        """
        self._unsettled = 0.0
        parts = self.contact.gaps.coordinates
        rows = {side: self._side_rows(side) for side, _ in self.zones}
        for side, zone in self.zones:
            zone.back()
            zone.move(parts[side])
        if not all(zone.goes_on for _, zone in self.zones):
            on_patches = self._on_patches(rows, respond(pushed + self._moved(rows)))
            forces = zip(self.zones, on_patches, strict=True)
            if all([zone.stays_elastic(force) for (_, zone), force in forces]):  # each zone takes its force
                return
            if not any([zone.look() for _, zone in self.zones]):
                return
        while not self._iterate(respond, pushed, rows):
            pass

    def _iterate(self, respond: Callable[[Array], Array], pushed: Array, rows: dict[int, Array]) -> bool:
        """Find the pseudo-forces of the active points; return whether no other point flows."""
        self._unsettled = 0.0  # also after a rough answer that left points out
        own = [zone.guess for _, zone in self.zones]
        p, sizes, anderson = np.concatenate(own), np.cumsum([len(one) for one in own])[:-1], Anderson()
        least, stalled, before = math.inf, 0, 0.0
        close = min(self._settled, _OF_STRESS * self._elastic_share())
        for tried in range(_MOST):
            self.iterations += 1
            for (_, zone), part in zip(self.zones, np.split(p, sizes), strict=True):
                zone.push(part if tried else None)
            found, size = self._answer(respond, pushed, rows)
            change = float(np.linalg.norm(found - p))
            least, stalled = min(change, least), stalled + 1 if change >= least else 0
            # What an answer still lacks, by its change, if changes go on to decrease as the last one has.
            lacks = change / (before - change) if 2 * change < before else 1.0
            before, settled = change, (self._settled if tried >= _PATIENT else close) * size
            if lacks * change <= settled or (stalled >= _STALLED and change <= _ROUGH * size):
                return self._finish()
            p = anderson.guess(p, found)
            if lacks * anderson.least <= settled:  # so the best combination of all guesses may do, without a product
                parts = [zone.combine(anderson.shares) for _, zone in self.zones]
                found, _ = self._answer(respond, pushed, rows)
                if lacks * np.linalg.norm(found - np.concatenate(parts)) <= settled:
                    return self._finish()
        self._unsettled = float(change / size)
        if self._broyden is None:
            self.check()
        return self._finish()

    def _answer(self, respond: Callable[[Array], Array], pushed: Array, rows: dict[int, Array]) -> tuple[Array, float]:
        """Change of the pseudo-forces on active nodes that follows from what was pushed; norm of all of them [N]."""
        on_patches = self._on_patches(rows, respond(pushed + self._moved(rows)))
        answers = [zone.answer(force) for (_, zone), force in zip(self.zones, on_patches, strict=True)]
        sizes = [zone.size(one) for (_, zone), one in zip(self.zones, answers, strict=True)]
        return np.concatenate(answers), float(np.linalg.norm(sizes))

    def _finish(self) -> bool:
        """Enter the state of the last answer; return whether no other point flows."""
        return all([zone.finish() for _, zone in self.zones])

    def _elastic_share(self) -> float:
        """Elastic strain divided by plastic strain, where a zone has flowed most; the least of all zones."""
        least = math.inf
        for _, zone in self.zones:
            flow, most = zone.zone.flow, zone.state.plastic.equivalent.max()
            if most > 0.0:
                least = min(least, float(flow.flow_stress(most) / (3 * flow.shear_modulus * most)))
        return least

    def check(self) -> None:
        """See `Zones`."""
        if self._unsettled:
            raise ComplementarityError(
                f"plastic flow did not settle in {_MOST} iterations; the last one changed its forces by "
                f"{self._unsettled:.2g}. Take smaller steps, or a finer mesh in the plastic zone"
            )

    def _moved(self, rows: dict[int, Array]) -> Array:
        """Displacements of the rows due to the present pseudo-forces, (nr, d) [m].

        Tangential places count from the end of the last accepted step.
        """
        d, total = self.contact.rows.d, np.zeros((1, 1))
        for side, zone in self.zones:
            places = (rows[side] @ zone.moved_patch).reshape(-1, d)
            if d > 1:
                places[:, 1:] -= (rows[side] @ zone.moved_patch_before).reshape(-1, d)[:, 1:]
            total = total + places
        return total

    def _on_patches(self, rows: dict[int, Array], forces: Array) -> list[Array]:
        """Forces on the flexibility coordinates of each zone's patch, (d np,) [N], by forces on rows, (nr, d) [N]."""
        return [rows[side].T @ forces.ravel() for side, _ in self.zones]

    def _side_rows(self, side: int) -> Array:
        stays = self.contact.gaps.constant_rows
        kept = self._rows.get(side)
        if kept is not None and stays is not None and kept[0] is stays:
            return kept[1]
        rows = self.contact.rows.side_rows(side)
        rows = rows if isinstance(rows, np.ndarray) else rows.toarray()
        self._rows[side] = stays, rows
        return rows

    def generalised(self, contact: Array) -> Array:
        """Generalised forces, (n,), of rows and zones; `contact`, (n,), are those of the rows."""
        force, ends = contact, np.cumsum([side.n for side in self.contact.gaps.sides])
        for number, zone in self.zones:
            if zone.generalised.any():
                force = force.copy()
                force[ends[number] - len(zone.generalised) : ends[number]] += zone.generalised
        if self._broyden is not None:
            self._broyden.see(self.contact.gaps.q, force)
        return force

    def tangent(self, of_rows: Array) -> Array:
        """See `Zones`; corrected from Newton's last step."""
        return of_rows if self._broyden is None or not self.flowing() else self._broyden.corrected(of_rows)
