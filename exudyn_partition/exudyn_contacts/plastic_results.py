"""What a contact with plastic zones tells of a run: plastic work, strains, and the state that is left behind."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..contact.plasticity.yielding_patches import Zones
from ..errors import InputError
from ..plasticity.flow import PlasticState
from ..plasticity.strain_history import StrainHistory
from ..support.arrays import Array
from ..support.checks import validate_result
from .friction_results import FrictionResults, RunSamples

SIDES = ("slave", "master")


class PlasticResults(FrictionResults):
    """Results of a contact that exist with plastic zones; without, they are an InputError."""

    @property
    def yielding(self) -> Zones | None:
        """Plastic zones beneath the patches, at the start; laws of users may know none."""
        return getattr(self.law, "yielding", None)

    def plastic_work(self, result: RunSamples) -> Array:
        """Plastic work since the start of the run, (n,) [J]; zero without plastic zones.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return np.zeros(len(result.t)) if self.yielding is None else self._plastic_samples(result)[:, 1]

    def plastic_strain(self, result: RunSamples) -> Array:
        """Largest equivalent plastic strain of all zones, (n,).

        Raises
        ------
        InputError
            If nothing can yield, or the result is none or of another model.
        """
        return self._plastic_samples(result)[:, 2]

    def plastic_states(self, result: RunSamples) -> dict[str, PlasticState]:
        """State of each plastic zone at the end of the run, by the name of its side: "slave" or "master".

        Raises
        ------
        InputError
            If nothing can yield, or nothing was kept of the run.
        """
        self._plastic_samples(result)
        return {SIDES[side]: state for side, state in result.kept(self).plastic_ends.items()}

    def strain_histories(self, result: RunSamples) -> list[StrainHistory | None]:
        """Plastic strain in the run beneath the patch of each side, in the order of `sides`; None where none can yield.

        Raises
        ------
        InputError
            If the result is none or of another model, or nothing was kept of the run.
        """
        validate_result(result)
        if self.yielding is None:
            return [None] * len(self.sides)
        kept = result.kept(self).histories({side: zone.zone for side, zone in self.yielding.zones})
        return [kept.get(side) for side in range(len(self.sides))]

    def dents(self, result: RunSamples) -> dict[str, float]:
        """Depth of the dent in each patch that may yield, at the end of the run and at rest [m], by "slave", "master".

        It is how far plastic strain has moved the deepest node of the patch into the body.

        Raises
        ------
        InputError
            See `plastic_states`.
        """
        states, found = self.plastic_states(result), {}
        assert self.yielding is not None
        for side, run in self.yielding.zones:
            name, (item, number) = SIDES[side], self.sides[side]
            patch = item.body.partition.patches[number]
            moved = run.motion.at_rest(states[name])[np.isin(run.zone.nodes, patch.nodes)]
            found[name] = float(-(moved @ patch.direction).min(initial=0.0))
        return found

    def flow_at_border(self, result: RunSamples) -> tuple[str, Array] | None:
        """Side and place, (3,) [m], where flow reached the edge of a plastic zone; None if it did not.

        Raises
        ------
        InputError
            See `plastic_states`.
        """
        states = self.plastic_states(result)
        assert self.yielding is not None
        for side, run in self.yielding.zones:
            name, zone = SIDES[side], run.zone
            reached = np.flatnonzero(zone.border & (states[name].equivalent > 0))
            if reached.size:
                return name, zone.place(int(reached[states[name].equivalent[reached].argmax()]))
        return None

    def dissipated_energy(self, result: RunSamples) -> Array:
        """Energy that friction and plastic flow have taken since the start of the run, (n,) [J]; zero without them.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        return super().dissipated_energy(result) + self.plastic_work(result)

    def _plastic_samples(self, result: RunSamples) -> Array:
        """Samples of the sensor `sPlastic`, (n, 4)."""
        if self.yielding is None:
            raise InputError(
                f"contact {self.name!r} has no plastic zones: its bodies' materials are elastic, or the basis is "
                "'craig-bampton'. Give yield_stress= and hardening= to Material"
            )
        validate_result(result)
        return result.sensor_of(self, self["sPlastic"])


def dent_motion(contact: PlasticResults, result: RunSamples) -> Callable[[int], list[Array] | None]:
    """What plastic strain has moved the nodes of each patch by, beyond the coordinates, by the sample.

    See `Side.dent`; None where nothing can yield.

    Raises
    ------
    InputError
        See `PlasticResults.strain_histories`, and `StrainHistory.numbers`.
    """
    if contact.yielding is None:
        return lambda sample: None
    histories, sides = contact.strain_histories(result), contact.law.gaps.sides
    known = [(side, kept, kept.numbers(result.t)) for side, kept in enumerate(histories) if kept is not None]

    def dents(sample: int) -> list[Array]:
        found = [np.zeros(side.surface.points.shape) for side in sides]
        for side, kept, numbers in known:
            found[side] = sides[side].dent(kept.strain(int(numbers[sample])))
        return found

    return dents
