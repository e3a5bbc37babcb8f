"""What a run leaves: samples of the model's sensors and of what contacts kept themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Number
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, RunError
from ..exudyn_bodies.item_work import WorkSensor
from ..exudyn_bodies.model import registered
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.contact_run import ContactRun
from ..exudyn_contacts.kept_run import KeptRun
from ..exudyn_contacts.model_run import runs_of
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..exudyn_contacts.run_record import Solver
from ..present.body_fields import Shown
from ..present.film import film
from ..present.motion import Colour
from ..present.report_page import write_report
from ..present.scene import Scene, scene_of
from ..present.tables import dataframe, dataset
from ..results.history import History
from ..results.newmark import Newmark
from ..support.arrays import Array
from ..support.attributes import no_attribute
from ..support.checks import validate_integer, validate_text, validate_times, validate_type
from ..support.files import writable
from ..support.foreign import DataFrame, Dataset, MainSystem, SensorIndex
from ..support.progress import Progress
from .sensor_checks import check_sensors
from .stored_run import (
    FILE,
    ItemMark,
    StoredBody,
    StoredBodyRun,
    StoredContact,
    StoredContactRun,
    StoredRun,
    check_items,
    described,
)
from .work import Work

_TIMES = "t for the times of the samples [s], or time_s for the run time [s]"
_MEANT = {  # names that other libraries have
    "time": _TIMES,
    "times": _TIMES,
    "y": "coordinates(result) of what CreatePartitionBody returns",
    "q": "coordinates(result) of what CreatePartitionBody returns",
    "force": "force(result) of what CreatePartitionContact returns",
    "forces": "force(result) of what CreatePartitionContact returns",
    "velocity": "velocity(result, point) of what CreatePartitionBody returns",
    "displacement": "displacement(result, point) of what CreatePartitionBody returns",
    "stress": "stress(result, points, fem) of what CreatePartitionBody returns",
    "energy": "energy(result) of what CreatePartitionBody and CreatePartitionContact return",
    "success": "status, which is 'finished'",
}


@dataclass(frozen=True, eq=False)
class Result:
    """What a run leaves.

    Parameters
    ----------
    t : (n,) array
        Times of the samples [s].
    status : {"finished", "interrupted", "unstable"}
    message : str
        Why and where the run ended.
    step : float
        Time step [s]; of an adaptive run, that in contact.
    steps : int
        Steps taken.
    method : str
    time_s : float
        Run time of Exudyn's solver [s].
    sensors : dict of int to (n, k) array
        Samples of the model's internally stored sensors, by sensor number.
    bodies : tuple of PartitionBody
        The model's.
    contacts : tuple of PartitionContact
        The model's.
    work : Work
        Counts of the solver and of the contacts.
    runs : tuple of ContactRun
        What each contact kept of the run; a `KeptRun` of a result that was read from a file.
    seldom : set of int
        Sensors that Exudyn read less often than the result has times.
    warnings : tuple of str, optional
        Texts of the warnings after the run. Default: not known.
    item_work : WorkSensor, optional
        The model's, if it has one.
    marks : tuple of ItemMark, optional
        What the model was, of a result that was read without it.
    newmark : Newmark, optional
        Parameters of the implicit method. Default: of another one, or not known, as of a result from a file.
    """

    t: Array
    status: str
    message: str
    step: float
    steps: int
    method: str
    time_s: float
    sensors: Mapping[int, Array] = field(repr=False)
    bodies: tuple[PartitionBody, ...] = field(default=(), repr=False)
    contacts: tuple[PartitionContact, ...] = field(default=(), repr=False)
    runs: tuple[ContactRun | KeptRun, ...] = field(default=(), repr=False)
    work: Work = field(default_factory=Work, repr=False)
    seldom: frozenset[int] = field(default=frozenset(), repr=False)
    warnings: tuple[str, ...] | None = field(default=None, repr=False)
    item_work: WorkSensor | None = field(default=None, repr=False)
    marks: tuple[ItemMark, ...] | None = field(default=None, repr=False)
    newmark: Newmark | None = field(default=None, repr=False)

    if not TYPE_CHECKING:  # for type checkers it would be every attribute

        def __getattr__(self, name: str) -> object:
            """Say what is meant by an attribute that is not there."""
            raise no_attribute(self, name, _MEANT)

    def __repr__(self) -> str:
        step = f"{self.steps} steps of {self.step:.4g} s, {self.method}, " if self.method else ""
        return f"Result({self.status}: {self.message}; {step}{len(self.t)} samples)"

    def sensor(self, number: SensorIndex) -> Array:
        """Samples of the sensor with Exudyn's `number`, (n, k), at the times of the result.

        Raises
        ------
        InputError
            If the run has no such sensor, or Exudyn read it too seldom.
        """
        if isinstance(number, Number | np.generic | np.ndarray) or not hasattr(number, "__int__"):  # no index of Exudyn
            number = validate_integer("number", number)
        if int(number) in self.seldom:
            raise InputError(
                f"number: Exudyn read sensor {int(number)} less often than this result has times, which are those of "
                f"all steps; read its own by mbs.GetSensorStoredData({int(number)}), or set "
                "settings.solution.sensors.writePeriod to the step before mbs.SolveDynamic"
            )
        if int(number) not in self.sensors:
            raise InputError(f"number: sensor {int(number)} stored nothing in this run; set storeInternal=True")
        return self.sensors[int(number)]

    def sensor_of(self, item: object, number: SensorIndex) -> Array:
        """Samples of the sensor `number` of `item`, (n, k); another model has the same numbers for other things.

        Raises
        ------
        InputError
            If the item was not in the model that was run.
        """
        if not isinstance(item, PartitionBody | StoredBody | PartitionContact | WorkSensor):
            raise InputError(
                "item: expected what CreatePartitionBody() or CreatePartitionContact() returns, got "
                f"{type(item).__name__}"
            )
        if item not in (*self.bodies, *self.contacts, self.item_work):
            raise InputError(
                f"result: expected one of the model that {called(item)} belongs to, got one of another model, or of "
                "a run before it was added; take what solve_dynamic or collect returns for its own"
            )
        return self.sensor(number)

    def kept(self, contact: PartitionContact) -> ContactRun | KeptRun:
        """Return what a contact kept of the run beside its sensors: its law at the end, and forces of rows.

        Raises
        ------
        InputError
            If the contact is of another model, or nothing was kept.
        """
        validate_type("contact", contact, PartitionContact, "CreatePartitionContact()")
        self.sensor_of(contact, contact["sForce"])
        if not self.runs:
            raise InputError(
                "result: nothing was kept of forces of rows, pressures, contact areas and the edge of a patch; repeat "
                "this run"
            )
        return self.runs[self.contacts.index(contact)]

    def at(self, times: Sequence[float] | Array | int) -> Result:
        """Return the samples nearest to some times, each once: for frames of a film.

        Parameters
        ----------
        times : (k,) [s] or int
            Times, or how many of them, equally spaced over the run.

        Raises
        ------
        InputError
            If a time is not within the run, or the run kept nothing.
        """
        if not len(self.t):
            raise InputError(f"result: the run kept no samples ({self.message})")
        if isinstance(times, int | np.integer):
            wanted = np.linspace(self.t[0], self.t[-1], validate_integer("times", times, least=1))
        else:
            wanted = validate_times("times", times, self.t)
        middles = (self.t[1:] + self.t[:-1]) / 2
        nearest = np.unique(np.searchsorted(middles, wanted))
        return replace(self, t=self.t[nearest], sensors={n: data[nearest] for n, data in self.sensors.items()})

    def save(self, path: str | Path) -> None:
        """Write the result to a file, to go on with it in another process; `load` reads it.

        It holds what sensors and contacts recorded: forces of rows, states, pressures, areas, plastic strains too.

        Parameters
        ----------
        path : str or Path
            Taken as it is.

        Raises
        ------
        InputError
            If no file can stand there.
        OutputError
            If the disk is full or protected; the file that was there is kept.
        """
        FILE.save(path, self._stored())

    def _stored(self) -> StoredRun:
        """What files hold of it."""
        kept: list[KeptRun | None] = [KeptRun.of(run) for run in self.runs]
        kept = kept or [None] * len(self.contacts)
        return StoredRun(
            t=self.t.copy(),
            status=self.status,
            message=self.message,
            step=float(self.step),
            steps=int(self.steps),
            method=self.method,
            time_s=float(self.time_s),
            work=self.work,
            numbers=np.array([*self.sensors], dtype=np.int64),
            seldom=np.array(sorted(self.seldom), dtype=np.int64),
            samples=tuple(np.array(data) for data in self.sensors.values()),
            items=described(self.bodies, self.contacts) if self.marks is None else self.marks,
            bodies=tuple(self._stored_body(item) for item in self.bodies),
            contacts=tuple(StoredContactRun.of(*both) for both in zip(self.contacts, kept, strict=True)),
            warnings=self.warnings,
        )

    def _stored_body(self, item: PartitionBody | StoredBody) -> StoredBodyRun:
        if isinstance(item, StoredBody):
            return item.run
        return StoredBodyRun(
            name=item.name,
            frame=item.frame,
            coordinates=np.array([*map(int, item["sCoordinates"])]),
            coordinates_t=np.array([*map(int, item["sCoordinates_t"])]),
            mass=float(item.body.total_mass),
            energy=item.energy(self),
            momentum=item.momentum(self),
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle holds what files hold: not the model with its matrices."""
        return _restored, (self._stored(),)

    @classmethod
    def load(cls, path: str | Path, mbs: MainSystem | None = None) -> Result:
        """Read what `save` wrote, as a result of a model that was built as the one that was run; or without a model.

        Without a model, `bodies` and `contacts` stand for its items. They have what the run recorded: times, forces,
        rows, pressures, areas, friction, energies, momenta. What needs meshes or matrices, as velocities of points that
        no sensor had, raises an InputError.

        Parameters
        ----------
        path : str or Path
        mbs : exudyn.MainSystem, optional
            It need not have been run.

        Raises
        ------
        InputError
            If the file is missing, damaged or of another kind, or the model is another one.
        """
        if mbs is None:
            return _restored(FILE.load(path))
        bodies, contacts = partition_items(mbs)
        stored: StoredRun = FILE.load(path)
        check_items(stored.items, described(bodies, contacts))
        return replace(
            _restored(stored),
            bodies=tuple(bodies),
            contacts=tuple(contacts),
            item_work=registered(mbs).work,
            marks=None,
        )

    def report(self, path: str | Path, *, title: str = "") -> Path:
        """Write the run as one HTML page: scene, step, conservation, contacts, timings, what was left out, figures.

        Parameters
        ----------
        path : str or Path
            Of the page, which needs no other file.
        title : str
            Default: the file's name.

        Returns
        -------
        Path

        Raises
        ------
        InputError
            If the folder does not exist, or the run kept nothing.
        """
        return write_report(path, self, title=title)

    def film(
        self,
        path: str | Path,
        bodies: Sequence[Shown] | None = None,
        *,
        colour: Colour = "speed",
        end: float | None = None,
        frames: int | Sequence[float] | Array = 100,
        period: float = 0.04,
        scale: float | None = None,
        view: str = "all",
        direction: Sequence[float] = (1.0, -1.6, 0.8),
        size: tuple[int, int] = (1280, 720),
        progress: Progress | None = None,
    ) -> Path:
        """Write a film of the moving and deforming bodies, with the contact force beneath; it needs no screen.

        Parameters
        ----------
        path : str or Path
            Its ending chooses the kind: `.mp4`, `.gif`, or `.png` for a numbered picture of each frame.
        bodies : sequence of PartitionBody or (PartitionBody, FEModel), optional
            Default: all. With its FE model a body also shows the static answer to the contacts' forces.
        colour : {"speed", "deformation", "von_mises", "contact_pressure"}
            "von_mises" needs the FE models.
        end : float, optional
            Value at the upper end of the colours [m/s, m, Pa]. Default: what 99.5 % of the area stay below, and more.
        frames : int or (m,) array
            How many, or their times [s], see `at`.
        period : float
            Time between frames in the film [s].
        scale : float, optional
            Factor on the deformation. Default: the power of ten that makes it visible.
        view : str
            What is looked at: "all", "contact", or the name of a body.
        direction : (3,)
            Where the viewer is, seen from there.
        size : (int, int)
            Width and height in pixels.
        progress : callable, optional
            Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

        Returns
        -------
        Path
            Of the film, or of its first picture.

        Raises
        ------
        InputError
            If an argument has a wrong type or is out of range, or no file can stand at the path.
        MissingPackageError
            If PyVista or imageio-ffmpeg is not installed: `pip install "exudyn-partition[pictures]"`.
        """
        return film(
            path, self, bodies, colour=colour, end=end, frames=frames, period=period, scale=scale, view=view,
            direction=direction, size=size, progress=progress,
        )  # fmt: skip

    def scene(
        self,
        path: str | Path | None = None,
        bodies: Sequence[Shown] | None = None,
        *,
        colours: Sequence[Colour] | None = None,
        frames: int | Sequence[float] | Array = 100,
        scale: float | None = None,
        title: str = "",
        height: int = 560,
        progress: Progress | None = None,
    ) -> Scene:
        """Make a page on which the bodies move, to play and turn in any browser; in a notebook, `result.scene()`.

        The page needs no other file and no network. It has the bodies with their deformation, rigid surfaces that are
        fixed in space, and the forces.

        Parameters
        ----------
        path : str or Path, optional
            Of the page. Default: it is not written.
        bodies : sequence of PartitionBody or (PartitionBody, FEModel), optional
            Default: all. With its FE model a body also shows the static answer to the contacts' forces, and stresses.
        colours : sequence of str, optional
            Some of "speed", "deformation", "von_mises", "contact_pressure", to choose from on the page. Default: all
            that there are.
        frames : int or (m,) array
            How many, or their times [s], see `at`.
        scale : float, optional
            Factor on the deformation at the start, which the page can change. Default: the power of ten that makes it
            visible.
        title : str
            Default: the file's name.
        height : int
            In a cell of a notebook [pixels].
        progress : callable, optional
            Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

        Returns
        -------
        Scene

        Raises
        ------
        InputError
            If an argument has a wrong type or is out of range, or no file can stand at the path.
        """
        target = None if path is None else writable(path)
        title = validate_text("title", title) or ("" if target is None else target.stem)
        made = scene_of(
            self, bodies, colours=colours, frames=frames, scale=scale, title=title, height=height, progress=progress
        )
        return made if target is None else made.save(target)

    def to_dataframe(self) -> DataFrame:
        """Histories of contacts and bodies as a table of pandas: force, gap, energy, momentum, with names and units.

        Rows are the times; `attrs` says how the run ended. `to_csv`, `to_hdf` and the like of the table write files.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        MissingPackageError
            If pandas is not installed: `pip install "exudyn-partition[tables]"`.
        """
        return dataframe(self)

    def to_xarray(self) -> Dataset:
        """The same as a data set of xarray, with dimensions t, contact, body and axis, and units as attributes.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        MissingPackageError
            If xarray is not installed: `pip install "exudyn-partition[tables]"`.
        """
        return dataset(self)

    def history(self, contact: PartitionContact, points: Mapping[str, tuple[Any, ...]] | None = None) -> History:
        """Forces of a contact and velocities of named points, to compare, plot and save.

        Parameters
        ----------
        contact : PartitionContact
        points : dict of str to (PartitionBody, point) or (PartitionBody, point, fem), optional
            With the FE model of the body velocities near a contact are better, see `PartitionBody.velocity`.

        Raises
        ------
        InputError
            If an argument is no such thing, or the contact is of another model.
        """
        validate_type("contact", contact, PartitionContact, "CreatePartitionContact()")
        expected = "points: expected a dict of name: (body, point) or (body, point, fem)"
        if points is not None and not isinstance(points, Mapping):
            raise InputError(f"{expected}, got {type(points).__name__}")
        velocity = {}
        for name, entry in (points or {}).items():
            if not isinstance(entry, tuple | list) or len(entry) not in (2, 3):
                raise InputError(f"{expected}, got {entry!r} for {name!r}")
            body, point, *fem = entry
            validate_type("points", body, PartitionBody, "CreatePartitionBody()")
            velocity[name] = body.velocity(self, point, fem=fem[0] if fem else None)
        bodies = [item.body for item, _ in contact.sides]
        info = {
            "label": f"{bodies[0].basis.name}, {self.method}",
            "dofs": sum(body.n_dofs for body in bodies),
            "contact_nodes": contact.n_rows,
            "step_s": self.step,
            "steps": self.steps,
            "time_s": self.time_s,
            "status": self.status,
        }
        of_friction = {}
        if contact.friction:
            of_friction = {
                "tangential_force": contact.friction.tangential_force(self),
                "dissipated": contact.dissipated_energy(self),
            }
        return History(self.t, contact.force(self), velocity, info, **of_friction)


def _restored(stored: StoredRun) -> Result:
    """Result of a stored run, without its model."""
    kept = tuple(contact.kept for contact in stored.contacts if contact.kept is not None)
    return Result(
        t=stored.t,
        status=stored.status,
        message=stored.message,
        step=stored.step,
        steps=stored.steps,
        method=stored.method,
        time_s=stored.time_s,
        work=stored.work,
        sensors=dict(zip(map(int, stored.numbers), stored.samples, strict=True)),
        bodies=tuple(map(StoredBody, stored.bodies)),  # type: ignore[arg-type]
        contacts=tuple(map(StoredContact, stored.contacts)),
        runs=kept,
        seldom=frozenset(map(int, stored.seldom)),
        warnings=stored.warnings,
        marks=stored.items,
    )


def samples(mbs: MainSystem) -> Result:
    """What the sensors stored, with what contacts kept themselves where Exudyn read its sensors seldom."""
    check_sensors(mbs)
    sensors = {}
    for number in range(mbs.systemData.NumberOfSensors()):
        if mbs.GetSensorParameter(number, "storeInternal"):
            data = np.atleast_2d(mbs.GetSensorStoredData(number))
            if data.size:
                sensors[number] = data
    if not sensors:
        raise RunError("mbs: no sensor stored anything; run the model first")
    count = min(len(data) for data in sensors.values())
    t = next(iter(sensors.values()))[:count, 0].copy()
    (bodies, contacts), run, solver = partition_items(mbs), runs_of(mbs).last(mbs), Solver.last(mbs)
    result = Result(
        t=t,
        status="finished",
        message="samples of the model's last run",
        step=float("nan"),
        steps=0,
        method="",
        time_s=float("nan"),
        sensors={number: data[:count, 1:] for number, data in sensors.items()},
        bodies=tuple(bodies),
        contacts=tuple(contacts),
        work=Work.of(solver, run),
        runs=() if run is None else tuple(run.of(contact) for contact in contacts),
        item_work=registered(mbs).work,
        newmark=None if solver is None else solver.newmark,
    )
    times = np.empty(0) if run is None else run.record.times
    return result if run is None or not len(times) else _joined(result, times, run.record.sensors(mbs))


def _joined(result: Result, t: Array, kept: Mapping[int, Array]) -> Result:
    """Result at its own times and at t, (n,), with what was kept there, (n, k) by sensor number."""
    own = ~np.isin(t, result.t)
    times = np.r_[result.t, t[own]]
    order = np.argsort(times)
    joined = {
        number: np.concatenate([data, kept[number][own]])[order]
        for number, data in result.sensors.items()
        if number in kept
    }
    seldom = frozenset(number for number in result.sensors if number not in kept)
    return replace(result, t=times[order], sensors=joined, seldom=seldom)


def cut(result: Result, count: int) -> Result:
    """Keep the first samples of a result."""
    sensors = {number: data[:count] for number, data in result.sensors.items()}
    return replace(result, t=result.t[:count], sensors=sensors)


def called(item: PartitionBody | StoredBody | PartitionContact | WorkSensor) -> str:
    """Return what messages call a body, a contact or the sensor of work."""
    if isinstance(item, WorkSensor):
        return "this sensor of work"
    kind = "body" if isinstance(item, PartitionBody | StoredBody) else "contact"
    return f"{kind} {item.name!r}" if item.name else f"the {kind}"
