"""Plastic zones of a contact in a run: plastic work, strains, dents, and the state at the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..contact.plasticity.zone_motion import ZoneMotion
from ..errors import InputError
from ..plasticity.flow import PlasticState
from ..plasticity.strain_history import StrainHistory
from ..support.arrays import Array
from ..support.checks import validate_result
from .contact_samples import ModelContact, RunSamples

SIDES = ("slave", "master")
# Share of the flow at the edge of a zone up to which it ends there, see `validation/inelastic/zone_radius.py`.
_AT_BORDER = 0.03


class PlasticResults:
    """`contact.plastic`: results of the plastic zones beneath the patches in a run.

    Every contact has this view. Without plastic zones it is false (`if contact.plastic:`), its work is zero, and its
    other results raise an InputError.

    Parameters
    ----------
    contact : PartitionContact
    """

    def __init__(self, contact: ModelContact) -> None:
        self._contact = contact

    def __bool__(self) -> bool:
        """Whether the contact has plastic zones; formulations of users may not support any."""
        return self._contact.mechanics.zones is not None

    @property
    def zones(self) -> Sequence[tuple[int, ZoneMotion]]:
        """For each side that can yield: its number, and its plastic zone."""
        zones = self._contact.mechanics.zones
        return () if zones is None else zones.motions

    def work(self, result: RunSamples) -> Array:
        """Plastic work since the start of the run, (n,) [J]; zero without plastic zones.

        Raises
        ------
        InputError
            If `result` is no result, or is of another model.
        """
        validate_result(result)
        if not self:
            return np.zeros(len(result.sensor_of(self._contact, self._contact["sForce"])))
        return self._samples(result)[:, 1]

    def strain(self, result: RunSamples) -> Array:
        """Largest equivalent plastic strain of all zones, (n,).

        Raises
        ------
        InputError
            If nothing can yield, or `result` is no result or is of another model.
        """
        return self._samples(result)[:, 2]

    def states(self, result: RunSamples) -> dict[str, PlasticState]:
        """State of each plastic zone at the end of the run. Keys are the names of the sides: "slave" or "master".

        Raises
        ------
        InputError
            If nothing can yield, or nothing was kept of the run.
        """
        self._samples(result)
        return {SIDES[side]: state.copy() for side, state in result.kept(self._contact).plastic_ends.items()}

    def strain_histories(self, result: RunSamples) -> list[StrainHistory | None]:
        """Plastic strain in the run beneath the patch of each side, in the order of `sides`; None if it cannot yield.

        Raises
        ------
        InputError
            If `result` is no result or is of another model, or nothing was kept of the run.
        """
        validate_result(result)
        of_sides: list[StrainHistory | None] = [None] * len(self._contact.sides)
        if self:
            kept = result.kept(self._contact).histories({side: zone.zone for side, zone in self.zones})
            for side, history in kept.items():
                of_sides[side] = history
        return of_sides

    def dents(self, result: RunSamples) -> dict[str, float]:
        """Depth of the dent in each patch that may yield, at the end of the run and at rest [m].

        Keys are "slave" and "master". The depth is the distance that plastic strain has moved the deepest node of the
        patch into the body.

        Raises
        ------
        InputError
            See `states`.
        """
        states, depths = self.states(result), {}
        for side, motion in self.zones:
            name, (item, number) = SIDES[side], self._contact.sides[side]
            patch = item.body.partition.patches[number]
            moved = motion.at_rest(states[name])[np.isin(motion.zone.nodes, patch.nodes)]
            depths[name] = float(-(moved @ patch.direction).min(initial=0.0))
        return depths

    def flow_at_border(self, result: RunSamples) -> tuple[str, Array] | None:
        """Side and place, (3,) [m], where flow reached the edge of a plastic zone; None if it did not.

        Flow counts by its equivalent strain times volume. What lies at the edge, in the outer half of the outermost
        elements, may be 3 % of it. Then flow ends there: with a wider zone the force is the same within a few tenths of
        a percent.

        Raises
        ------
        InputError
            See `states`.
        """
        states = self.states(result)
        for side, motion in self.zones:
            name, zone = SIDES[side], motion.zone
            flow = states[name].equivalent * zone.weight
            at_border = np.where(zone.border, flow, 0.0)
            if at_border.sum() > _AT_BORDER * flow.sum():
                return name, zone.edge_near(int(at_border.argmax()))
        return None

    def _samples(self, result: RunSamples) -> Array:
        """Samples of the sensor `sPlastic`, (n, 4)."""
        if not self:
            raise InputError(
                f"contact {self._contact.name!r} has no plastic zones: its bodies' materials are elastic, or the basis "
                "is 'craig-bampton'. Give yield_stress= and hardening= to Material"
            )
        validate_result(result)
        return result.sensor_of(self._contact, self._contact["sPlastic"])


def dent_motion(contact: ModelContact, result: RunSamples) -> Callable[[int], list[Array] | None]:
    """Return a function of the sample: displacement of each patch's nodes by plastic strain, beyond the coordinates.

    See `Side.dent`. The function returns None if nothing can yield.

    Raises
    ------
    InputError
        See `PlasticResults.strain_histories`, and `StrainHistory.numbers`.
    """
    plastic = PlasticResults(contact)
    if not plastic:
        return lambda sample: None
    histories, sides = plastic.strain_histories(result), contact.mechanics.gaps.sides
    yielding = [(side, kept, kept.numbers(result.t)) for side, kept in enumerate(histories) if kept is not None]

    def dents(sample: int) -> list[Array]:
        displacements = [np.zeros(side.surface.points.shape) for side in sides]
        for side, kept, numbers in yielding:
            displacements[side] = sides[side].dent(kept.strain(int(numbers[sample])))
        return displacements

    return dents
