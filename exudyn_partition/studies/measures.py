"""What `run_many` keeps of each entry: numbers of its contacts, energies and momenta of its bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..compiled.moving import rows_of
from ..compiled.plan import Bodies
from ..compiled.run import Histories
from ..compiled.start import Start
from ..contact.gaps import Gaps
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..results.impacts import closed_spans
from ..support.arrays import Array, consecutive
from .entry_notes import AtPeak
from .variations import Variations


class Measures:
    """Finds them.

    Parameters
    ----------
    places : dict of PartitionBody to (n_dofs,) int array
        Numbers of the coordinates of each body.
    contacts : sequence of PartitionContact
    gaps : sequence of Gaps
        Of these contacts.
    variations : Variations
    t : (n,) array
        Times of all steps [s].
    """

    def __init__(
        self,
        places: Mapping[PartitionBody, Array],
        contacts: Sequence[PartitionContact],
        gaps: Sequence[Gaps],
        variations: Variations,
        t: Array,
    ) -> None:
        self._places, self._contacts, self._gaps, self._variations = places, contacts, gaps, variations
        self._t, self.rows = t, consecutive([len(rows_of(rows)) for rows in gaps])
        self._coordinates = [np.concatenate([places[item] for item, _ in contact.sides]) for contact in contacts]
        self._slaves = [
            contact.slave.kinematics.at(rows.slave.surface.nodes) for contact, rows in zip(contacts, gaps, strict=True)
        ]

    def at_peaks(self, made: Histories) -> list[AtPeak | None]:
        """Each contact at its largest force; None for one without a force."""
        return [self._at_peak(j, made) if force > 0.0 else None for j, force in enumerate(made.peaks.force)]

    def _at_peak(self, j: int, made: Histories) -> AtPeak:
        rows, lam = self._gaps[j], made.peaks.lam[self.rows[j]]
        if rows.moving:  # their normals are those of the peak; threads may work with others
            rows = rows.for_run()
            rows.at(made.peaks.q[j][self._coordinates[j]])
        return AtPeak(rows, lam if len(lam) == len(rows.row_nodes) else lam[rows.all_points.rows_of(rows.row_nodes)])

    def of(
        self, entry: int, bodies: Bodies, made: Histories, peaks: Sequence[AtPeak | None]
    ) -> tuple[dict[str, Array], Array, Array]:
        """Numbers by contact, energies, (2, nb) [J], and momenta, (2, nb, 3) [N s], see `ManyRuns`.

        `bodies` are those of the entry.
        """
        force, t = np.ascontiguousarray(made.values[:, :, 0].T), self._t[: made.made + 1]
        spans = [self._spans(j, of_contact, made) for j, of_contact in enumerate(force)]
        measures = {
            "peak": force.max(axis=1),
            "impulse": np.trapezoid(force, t, axis=1),
            "duration": np.array([sum(end - start for start, end in of_contact) for of_contact in spans]),
            "counts": np.array([float(len(of_contact)) for of_contact in spans]),
            "restitution": np.array([self._restitution(j, made, peak) for j, peak in enumerate(peaks)]),
            "stored": made.end_stored,
            "dissipated": np.zeros(len(force)),
        }
        if made.friction.shape[1]:
            measures["dissipated"][-made.friction.shape[1] :] = made.friction[-1, :, 5]
        energy = np.array([self._energies(bodies, state) for state in (made.start, made.end)])
        momentum = np.array([self._momenta(entry, state) for state in (made.start, made.end)])
        return measures, energy, momentum

    def _spans(self, j: int, force: Array, made: Histories) -> list[tuple[float, float]]:
        """Start and end of each time of contact [s]."""
        gap, t = made.values[:, j, 5], self._t[: made.made + 1]

        def crossing(inside: int, outside: int) -> float:
            if not 0 <= outside < len(t):
                return float(t[inside])
            share = gap[inside] / (gap[inside] - gap[outside])
            return float(t[inside] + share * (t[outside] - t[inside]))

        return [(crossing(first, first - 1), crossing(last, last + 1)) for first, last in closed_spans(force)]

    def _restitution(self, j: int, made: Histories, peak: AtPeak | None) -> float:
        """See `ManyRuns`."""
        contact = self._contacts[j]
        impulse = np.trapezoid(self._normal_forces(j, made), self._t[: made.made + 1], axis=0)
        if peak is None or not (size := np.linalg.norm(impulse)):
            return np.nan
        normal = impulse / size
        at_peak = made.peaks.q[j][self._places[contact.slave]]
        weights = peak.rows.stage.nodal_forces(peak.lam)[0] @ normal
        at_nodes = self._slaves[j].place(at_peak)
        centre = weights @ at_nodes / weights.sum()

        def separation(state: Start) -> float:
            speeds = []
            for item, _ in contact.sides:
                motion, dofs = item.kinematics, self._places[item]
                way = motion.rigid_motion(state.q[dofs]) - motion.rigid_motion(made.peaks.q[j][dofs])
                # The centre goes with each body, so that a body that slides has the arm of the impact.
                speeds.append(motion.mean_velocity(state.q[dofs], state.v[dofs], centre + way[:3]) @ normal)
            return float(speeds[0] - sum(speeds[1:]))

        before = separation(made.start)
        return -separation(made.end) / before if before else np.nan

    @staticmethod
    def _normal_forces(j: int, made: Histories) -> Array:
        """Resultant of the normal forces of a contact, (n, 3) [N]."""
        place = j - made.values.shape[1] + made.friction.shape[1]  # contacts with friction come last
        resultant: Array = made.values[:, j, 2:5]
        return resultant if place < 0 else resultant - made.friction[:, place, :3]

    def _energies(self, bodies: Bodies, state: Start) -> list[float]:
        """Kinetic and strain energy of each body [J]."""
        kinetic, strain = bodies.mass * state.v**2, bodies.stiffness * state.q**2
        energies = []
        for item, dofs in self._places.items():
            of_motion = 0.5 * float(kinetic[dofs].sum())
            if item.frame == "floating":  # whose inertia is no diagonal
                of_motion = float(item.kinematics.kinetic_energy(state.q[dofs], state.v[dofs]))
            energies.append(of_motion + 0.5 * float(strain[dofs].sum()))
        return energies

    def _momenta(self, entry: int, state: Start) -> list[Array]:
        """Linear momentum of each body, (3,) [N s]."""
        both = ((item, self._variations.factor(item, "rho", entry)) for item in self._places)
        return [rho * item.kinematics.momentum(state.v[self._places[item]]) for item, rho in both]


def flies_on(made: Histories) -> bool:
    """Whether a run stopped as pairs slid while all contacts were open, after one was closed."""
    return made.stopped is not None and made.stopped.kind == "slides" and _has_bounced(made.values[:, :, 0])


def _has_bounced(force: Array) -> bool:
    """Whether sums of forces, (n, nc), were there, and are gone."""
    return bool(force.any() and not force[-1].any())
