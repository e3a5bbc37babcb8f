"""What is told of entries of `run_many`, as reviews tell it of a single run.

Reviews look at all samples. Of an entry there are values of contacts at all steps, what rows were pressed, and
coordinates at some moments only. So a note has no numbers, and is the same for all entries.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .. import errors
from ..compiled.plan import Motion, StepPlan
from ..compiled.run import Histories
from ..contact.gaps import Gaps
from ..errors import ContactPatchWarning, ModelLimitWarning, YieldWarning
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.contact_record import ContactRecord
from ..exudyn_contacts.partition_contact import PartitionContact, largest_stresses
from ..exudyn_contacts.row_samples import RowSamples
from ..prediction.point_contact import PointContact
from ..prediction.yielding import Stress
from ..simulation.result import called
from ..simulation.reviews.balance import OFF
from ..simulation.reviews.deformation import LARGEST_OFF, LARGEST_ROTATION, wrong_speed
from ..simulation.reviews.patches import ASIDE, off_line
from ..simulation.reviews.penetration import DEEP, ENERGY, ROUND_OFF
from ..simulation.reviews.resolution import COARSE, FEW_ROWS, SOME_ROWS, point_of
from ..simulation.reviews.reviewed_run import LARGEST_DEFORMATION, deformed_share, lengths
from ..simulation.reviews.steps import LARGEST_TURN
from ..support.arrays import Array
from ..support.warn import warn
from .variations import Variations


class Note(NamedTuple):
    """What is told of an entry.

    Parameters
    ----------
    kind : str
        Name of the category of the warning.
    text : str
    """

    kind: str
    text: str


class Moments:
    """Coordinates and velocities of a run now and then.

    Parameters
    ----------
    motion : Motion
        State of the run.
    """

    def __init__(self, motion: Motion) -> None:
        self._motion, self._q, self._v = motion, list[Array](), list[Array]()

    def look(self, made: int) -> bool:
        """Keep the present state; True, for a run goes on."""
        self._q.append(self._motion.q.copy())
        self._v.append(self._motion.v.copy())
        return True

    def with_ends(self, made: Histories) -> tuple[Array, Array]:
        """Coordinates, (k, nq), and velocities, (m, nq), also at start and end; coordinates at the largest forces."""
        both, forces = (made.start, made.end), made.peaks.force > 0.0
        return (
            np.array([*(state.q for state in both), *self._q, *made.peaks.q[forces]]),
            np.array([*(state.v for state in both), *self._v]),
        )


class AtPeak(NamedTuple):
    """A contact at its largest force.

    Parameters
    ----------
    rows : Gaps
        Its rows then.
    lam : (nr,) array
        Normal forces on them [N].
    """

    rows: Gaps
    lam: Array


class Notes:
    """Finds what is told of an entry.

    Parameters
    ----------
    places : dict of PartitionBody to (n_dofs,) int array
        Numbers of the coordinates of each body.
    contacts : sequence of PartitionContact
    gaps : sequence of Gaps
        Of these contacts.
    rows : sequence of slice
        Of these contacts among all rows.
    variations : Variations
    step : float
        [s]
    """

    def __init__(
        self,
        places: Mapping[PartitionBody, Array],
        contacts: Sequence[PartitionContact],
        gaps: Sequence[Gaps],
        rows: Sequence[slice],
        variations: Variations,
        step: float,
    ) -> None:
        self._places, self._contacts, self._gaps, self._rows = places, contacts, gaps, rows
        self._variations, self._step = variations, step
        self._points = [functools.cache(functools.partial(point_of, contact)) for contact in contacts]

    def of(
        self, plan: StepPlan, made: Histories, moments: Moments, peaks: Sequence[AtPeak | None], energy: Array
    ) -> list[Note]:
        """Notes of an entry; `energy`, (2, nb) [J], is that of its bodies at start and end."""
        found, (q, v) = list[Note](), moments.with_ends(made)
        for item, dofs in self._places.items():
            found += self._of_body(item, q[:, dofs], v[:, dofs])
        for j, peak in enumerate(peaks):
            if peak is not None:
                found += self._of_contact(j, made, peak, energy)
        return [*found, *self._of_energy(plan, made, energy)]

    def _of_body(self, item: PartitionBody, q: Array, v: Array) -> Iterator[Note]:
        """Notes of a body at some moments, (k, n)."""
        if item.frame == "inertial" and lengths(item.kinematics.rigid_motion(q)[:, 3:]).max() > LARGEST_ROTATION:
            yield _limit(
                f"{called(item)} has rotated by more than {LARGEST_ROTATION} rad: frame='inertial' takes rotations as "
                "small, results are wrong by their square. Take frame='floating'"
            )
        if item.frame == "floating" and self._step * lengths(v[:, 3:6]).max() > LARGEST_TURN:
            yield _limit(
                f"{called(item)} turns by more than {LARGEST_TURN:g} rad in a step: no integrator follows that. Take "
                "a shorter step"
            )
        if deformed_share(item, q, item.kinematics.deformed(q)).max() >= LARGEST_DEFORMATION:
            yield _limit(
                f"{called(item)}: its contact patch has deformed by more than {LARGEST_DEFORMATION} of the body's "
                "size. The answer is that of linear elasticity, which no material follows there. Check speeds, units "
                "and the material"
            )

    def _of_contact(self, j: int, made: Histories, peak: AtPeak, energy: Array) -> Iterator[Note]:
        """Notes of a contact that closed."""
        contact, pressed = self._contacts[j], -made.values[:, j, 5]
        if (j in made.left) or self._leaves(j, made):
            yield Note(
                ContactPatchWarning.__name__,
                f"{called(contact)} reached the edge of its patch; the force is too small from then on. Enlarge the "
                "contact radius of its partitions, or give Partition.surface more faces",
            )
        start = pressed[0] > ROUND_OFF * contact.slave_facet_size
        if start and made.start_stored[j] > ENERGY * energy.sum(axis=1).max():
            yield _limit(
                f"{called(contact)} starts with an overlap, whose energy throws the bodies apart. Check "
                "referencePosition of these entries"
            )
        areas = contact.mechanics.node_areas[peak.rows.row_nodes[peak.lam > 0]]
        if pressed.max() > DEEP * np.sqrt(areas.sum() / np.pi) > 0:
            yield _limit(
                f"{called(contact)}: the bodies penetrate each other by more than {DEEP} of the radius of the contact "
                "area, for which linear elasticity has no answer. Check speeds, units and the material"
            )
        yield from self._few_rows(j, made)
        yield from self._turned(j, made, peak)
        top = int(made.values[:, j, 0].argmax())
        for (item, number), sign in zip(contact.sides, (-1, 1), strict=False):
            q = made.peaks.q[j][self._places[item]]
            if off_line(item, number, q, sign * made.values[top, j, 2:5]) > ASIDE:
                yield _limit(
                    f"{called(contact)}: the largest force is more than {np.degrees(ASIDE):.0f} degrees off the line "
                    f"of contact of the patch of {called(item)}, which yields along that line only: the contact is "
                    'too soft. Give the partition axes="xyz", or take Partition.surface'
                )
        yield from self._yields(j, made, peak)

    def _turned(self, j: int, made: Histories, peak: AtPeak) -> Iterator[Note]:
        """See `deformation.turned_surfaces`; here with rotations at the peak, and their rates at the start."""
        contact, (force, depth) = self._contacts[j], made.values[:, j, [0, 5]].T
        first, top = int((force > 0.0).argmax()), int(force.argmax())
        speed = (depth[first - 1] - depth[first]) / self._step if first else 0.0
        if not 0.0 < speed < np.inf:
            return
        slave, number = contact.sides[0]
        nodes = slave.body.partition.patches[number].nodes[peak.rows.row_nodes]
        places = slave.kinematics.at(nodes).place(made.peaks.q[j][self._places[slave]])
        place, normal = peak.lam @ places / peak.lam.sum(), made.values[top, j, 2:5] / force[top]
        for item, _ in contact.sides:
            if item.frame == "inertial":
                q, q_t = (values[self._places[item]] for values in (made.peaks.q[j], made.start.v))
                rate = item.kinematics.rigid_motion(q_t)[3:]
                if wrong_speed(item, q, rate, place, normal) > LARGEST_OFF * speed:
                    yield _limit(
                        f"{called(contact)} closes with a speed that is wrong: {called(item)} has turned by then, and "
                        "frame='inertial' takes rotations as small. Take frame='floating'"
                    )

    def _leaves(self, j: int, made: Histories) -> bool:
        """Whether closed rows of a contact left its patch, see `Evaluation.edge_reached`."""
        depth, leaves_at = made.peaks.depth[self._rows[j]], self._gaps[j].stage.rows.leaves_at
        if len(depth) != len(leaves_at):  # of two bodies whose pairs slide, which loops watch
            return False
        return bool(((depth > -np.inf) & (np.maximum(depth, 0.0) >= leaves_at)).any())

    def _few_rows(self, j: int, made: Histories) -> Iterator[Note]:
        """See `resolution.few_rows`."""
        contact, force = self._contacts[j], made.values[:, j, 0]
        top = int(force.argmax())
        closed = made.values[top, j, 1]
        if closed > SOME_ROWS or top == len(force) - 1 or contact.n_rows <= closed:
            return
        if closed > FEW_ROWS:
            point = self._points[j]()
            if point is None or contact.slave_facet_size < COARSE * point.mean_axis(float(force[top])):
                return
        yield _limit(
            f"{called(contact)} has {SOME_ROWS} closed rows or fewer at its largest force: its facets of "
            f"{contact.slave_facet_size:.3g} m do not resolve the contact, so that forces of impacts are off by a "
            "quarter and more. Refine the mesh there, or take formulation='hertz' in solve_dynamic"
        )

    def _yields(self, j: int, made: Histories, peak: AtPeak) -> Iterator[Note]:
        """See `yielding.first_yield`."""
        contact = self._contacts[j]
        if any(self._variations.varies(item, "E") for item, _ in contact.sides):
            return
        force, point = float(made.values[:, j, 0].max()), self._points[j]()
        stress = _stress_at_point(contact, force, point) if point else _stress_of_rows(contact, force, peak)
        if stress is not None and (stress.yield_ratio or 0.0) > 1.0:
            yield Note(
                YieldWarning.__name__,
                f"{called(contact)} is beyond first yield at its largest force. The bodies stay elastic here; real "
                "ones dent, with a smaller and longer force, and rebound slower",
            )

    def _of_energy(self, plan: StepPlan, made: Histories, energy: Array) -> Iterator[Note]:
        """Energy of an entry that has no cause."""
        start, end = made.start, made.end
        given = float(plan.bodies.load @ (end.q - start.q))
        before = energy[0].sum() + made.start_stored.sum()
        after = energy[1].sum() + made.end_stored.sum() + made.friction[-1, :, 5].sum()
        if after - before - given > OFF * max(before, after, abs(given)):
            yield _limit(
                f"the bodies have more than {OFF:.0%} more energy at the end than they had, and than their weight "
                "gave them: the error of the steps. Take a shorter step"
            )


def _limit(text: str) -> Note:
    return Note(ModelLimitWarning.__name__, text)


def _stress_at_point(contact: PartitionContact, force: float, point: PointContact) -> Stress:
    return Stress.beneath(force, point.semi_axes(force), contact.elastic_materials)


def _stress_of_rows(contact: PartitionContact, force: float, peak: AtPeak) -> Stress | None:
    """Stress by the forces on the rows."""
    record, closed = ContactRecord(contact.mechanics), np.flatnonzero(peak.lam)
    record.keep_rows(1.0, peak.rows.row_nodes[closed], peak.lam[closed], 0.0, None)
    rows = RowSamples(record, np.array([0.0, 1.0]))
    return largest_stresses([(contact, np.array([0.0, force]), rows)])[0]


def tell(notes: Mapping[int, Sequence[Note]], count: int) -> None:
    """Warn of each note once, with how many of the entries have it."""
    counts = Counter(note for of_entry in notes.values() for note in of_entry)
    for note, having in counts.items():
        first = min(entry for entry, of_entry in notes.items() if note in of_entry)
        warn(
            f"{having} of {count} runs: {note.text}. The first is entry {first}; ManyRuns.warnings has all",
            getattr(errors, note.kind, errors.PartitionWarning),
        )
