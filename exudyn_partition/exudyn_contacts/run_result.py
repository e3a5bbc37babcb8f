"""Protocol of the result that pictures, files and pages read; `simulation.result.Result` fulfils it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ..exudyn_bodies.item_work import WorkSensor
from ..exudyn_bodies.other_bodies import OtherBody
from ..exudyn_bodies.partition_body import PartitionBody
from ..frames.damping import Damping
from ..results.history import History
from ..results.newmark import Newmark
from ..support.arrays import Array
from ..support.foreign import SensorIndex
from .contact_record import ContactRecord
from .kept_run import KeptRun
from .partition_contact import PartitionContact


class RunResult(Protocol):
    """Samples of a run, its end, and the model's items."""

    @property
    def t(self) -> Array:
        """Times of the samples, (n,) [s]."""

    @property
    def status(self) -> str:
        """How the run ended: "finished", "interrupted" or "unstable"."""

    @property
    def message(self) -> str:
        """Cause and time of the end of the run."""

    @property
    def step(self) -> float:
        """Time step [s]."""

    @property
    def steps(self) -> int:
        """Steps taken."""

    @property
    def method(self) -> str:
        """Solver: "explicit", "implicit", "static", or "" if it is not known."""

    @property
    def newmark(self) -> Newmark | None:
        """Parameters of the implicit method; None for another method, or if they are not known."""

    @property
    def time_s(self) -> float:
        """Run time of Exudyn's solver [s]."""

    @property
    def warnings(self) -> tuple[str, ...] | None:
        """Texts of the warnings after the run; None if they are not known."""

    @property
    def bodies(self) -> tuple[PartitionBody, ...]:
        """Bodies of the model."""

    @property
    def contacts(self) -> tuple[PartitionContact, ...]:
        """Contacts of the model."""

    @property
    def runs(self) -> Sequence[ContactRecord | KeptRun]:
        """Data of the run that each contact kept; empty if nothing was kept."""

    @property
    def item_work(self) -> WorkSensor | None:
        """Sensor of the work of joints, springs and loads, if the model has one."""

    @property
    def others(self) -> tuple[OtherBody, ...]:
        """Motion of Exudyn's own bodies that have a shape, or carry the rigid surface of a contact."""

    def history(self, contact: PartitionContact) -> History:
        """Force of a contact over time."""

    def sensor_of(self, item: object, number: SensorIndex) -> Array:
        """Samples of the sensor `number` of `item`, (n, k)."""

    def dampings_of(self, item: PartitionBody) -> tuple[tuple[float, Damping], ...]:
        """Damping of a body in the run, as joints held it, each with the time from which it acted [s]."""

    def kept(self, contact: PartitionContact) -> ContactRecord | KeptRun:
        """Data of the run that a contact kept."""

    def at(self, times: Sequence[float] | Array | int) -> RunResult:
        """Return the samples nearest to some times, each sample once."""
