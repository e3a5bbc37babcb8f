"""The result of a run: samples of the model's sensors, and the data that contacts kept themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Number
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, RunError
from ..exudyn_bodies.held_damping import hold_damping
from ..exudyn_bodies.item_work import WorkSensor
from ..exudyn_bodies.model import registered
from ..exudyn_bodies.other_bodies import OtherBody
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.contact_record import ContactRecord
from ..exudyn_contacts.kept_run import KeptRun
from ..exudyn_contacts.model_run import runs_of
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..exudyn_contacts.run_record import Solver
from ..frames.damping import Damping
from ..present.body_fields import Shown
from ..present.film import film
from ..present.motion import Colour
from ..present.report_page import write_report
from ..present.scene import Scene, scene_of
from ..present.tables import dataframe, dataset
from ..results.history import History
from ..results.newmark import Newmark
from ..support.arrays import Array
from ..support.attributes import for_users, no_attribute
from ..support.checks import read_only, validate_integer, validate_text, validate_times, validate_type
from ..support.files import writable
from ..support.foreign import DataFrame, Dataset, MainSystem, SensorIndex
from ..support.progress import Progress
from .continuation import RunEnd
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

_MOST_TIMES = 1_000_000  # more equal times find no other samples
_TIMES = "t for the times of the samples [s], or time_s for the run time [s]"
_MEANT = {  # names in other libraries
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
    """The result of a run.

    Parameters
    ----------
    t : (n,) array
        Times of the samples [s].
    status : {"finished", "interrupted", "unstable"}
    message : str
        Cause and time of the end of the run.
    step : float
        Time step [s]; for an adaptive run, the step in contact.
    steps : int
        Steps taken.
    method : str
    time_s : float
        Run time of Exudyn's solver [s].
    sensors : dict of int to (n, k) array
        Samples of the model's internally stored sensors, by sensor number.
    bodies : tuple of PartitionBody
        All bodies of the model.
    contacts : tuple of PartitionContact
        All contacts of the model.
    work : Work
        Counts of the solver and of the contacts.
    runs : tuple of ContactRecord or KeptRun
        Data of the run that each contact kept; `KeptRun` if the result was read from a file.
    seldom : set of int
        Sensors that Exudyn read less often than the result has times.
    warnings : tuple of str, optional
        Texts of the warnings after the run. Default: not known.
    item_work : WorkSensor, optional
        Sensor of work, if the model has one that was read at all times.
    marks : tuple of ItemMark, optional
        Description of the model, for a result that was read without it.
    newmark : Newmark, optional
        Parameters of the implicit method. Default: another method, or not known, as in a result from a file.
    others : tuple of OtherBody
        Motion of Exudyn's own bodies that have a shape, or carry the rigid surface of a contact.
    dampings : tuple of tuple
        Of each body, see `dampings_of`; the model may be assembled with other joints since.
    end : RunEnd, optional
        State at the end of the run, from which another one goes on: `solve_dynamic(mbs, go_on=result)`. Default: the
        run did not end with a whole step.
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
    runs: tuple[ContactRecord | KeptRun, ...] = field(default=(), repr=False)
    work: Work = field(default_factory=Work, repr=False)
    seldom: frozenset[int] = field(default=frozenset(), repr=False)
    warnings: tuple[str, ...] | None = field(default=None, repr=False)
    item_work: WorkSensor | None = field(default=None, repr=False)
    marks: tuple[ItemMark, ...] | None = field(default=None, repr=False)
    newmark: Newmark | None = field(default=None, repr=False)
    others: tuple[OtherBody, ...] = field(default=(), repr=False)
    dampings: tuple[tuple[tuple[float, Damping], ...], ...] = field(default=(), repr=False)
    end: RunEnd | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        read_only(self.t, *self.sensors.values())

    if not TYPE_CHECKING:  # type checkers would accept every attribute

        def __getattr__(self, name: str) -> object:
            """Raise an error that names the right attribute instead of a missing one."""
            raise no_attribute(self, name, _MEANT)

    def __dir__(self) -> list[str]:
        return for_users(
            self,
            {"dampings", "dampings_of", "end", "item_work", "kept", "marks", "newmark", "runs"}
            | {"seldom", "sensor_of"},
        )

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
        return self._sensor(_number_of(number))

    def _sensor(self, number: int) -> Array:
        """See `sensor`."""
        if (found := self.sensors.get(number)) is not None and number not in self.seldom:
            return found
        if number in self.seldom:
            raise InputError(
                f"number: Exudyn read sensor {number} less often than this result has times, which are those of "
                f"all steps; read its own by mbs.GetSensorStoredData({number}), or set "
                "settings.solution.sensors.writePeriod to the step before mbs.SolveDynamic"
            )
        raise InputError(
            f"number: sensor {number} stored nothing in this run: it was added later, or without storeInternal=True. "
            "Run the model again with it"
        )

    def sensor_of(self, item: object, number: SensorIndex) -> Array:
        """Samples of the sensor `number` of `item`, (n, k). In another model the same number may be another sensor.

        Raises
        ------
        InputError
            If the item was not in the model that was run.
        """
        key = _number_of(number)
        if not isinstance(item, PartitionBody | StoredBody | PartitionContact | WorkSensor):
            raise InputError(
                "item: expected what CreatePartitionBody() or CreatePartitionContact() returns, got "
                f"{type(item).__name__}"
            )
        seldom = isinstance(item, WorkSensor) and key in self.seldom
        if item not in self._items and not seldom:
            raise InputError(
                f"result: expected one of the model that {called(item)} belongs to, got one of another model, or of "
                "a run before it was added; take what solve_dynamic or collect returns for its own"
            )
        return self._sensor(key)

    @cached_property
    def _items(self) -> frozenset[object]:
        """Bodies, contacts and sensor of work of the model that was run."""
        return frozenset((*self.bodies, *self.contacts, self.item_work))

    @cached_property
    def _run_of(self) -> dict[int, ContactRecord | KeptRun]:
        """Data that each contact kept, by its identity."""
        return {id(contact): run for contact, run in zip(self.contacts, self.runs, strict=True)}

    def dampings_of(self, item: PartitionBody) -> tuple[tuple[float, Damping], ...]:
        """Damping of a body in the run, as joints held it, each with the time from which it acted [s].

        Parameters
        ----------
        item : PartitionBody
            A body of the model; others have none.
        """
        return self._dampings.get(id(item), ())

    @cached_property
    def _dampings(self) -> dict[int, tuple[tuple[float, Damping], ...]]:
        """See `dampings_of`, by the identity of each body."""
        return {id(body): damping for body, damping in zip(self.bodies, self.dampings, strict=False)}

    def kept(self, contact: PartitionContact) -> ContactRecord | KeptRun:
        """Return the data of the run that a contact kept beside its sensors: forces of rows, states, strains.

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
        return self._run_of[id(contact)]

    def at(self, times: Sequence[float] | Array | int) -> Result:
        """Return the samples nearest to some times, each sample once, for example for frames of a film.

        Parameters
        ----------
        times : (k,) [s] or int
            Times [s], or a number of times that are equally spaced over the run.

        Raises
        ------
        InputError
            If a time is not within the run, or the run kept nothing.
        """
        if not len(self.t):
            raise InputError(f"result: the run kept no samples ({self.message})")
        if isinstance(times, int | np.integer):
            count = min(validate_integer("times", times, least=1), _MOST_TIMES)
            wanted = np.linspace(self.t[0], self.t[-1], count)
        else:
            wanted = validate_times("times", times, self.t)
        middles = (self.t[1:] + self.t[:-1]) / 2
        nearest = np.unique(np.searchsorted(middles, wanted))
        return replace(self, t=self.t[nearest], sensors={n: data[nearest] for n, data in self.sensors.items()})

    def save(self, path: str | Path) -> None:
        """Write the result to a file, for use in another process; `load` reads it.

        It holds all data that sensors and contacts recorded, with forces of rows, states, pressures, areas and plastic
        strains.

        Parameters
        ----------
        path : str or Path
            Path of the file; no ending is added.

        Raises
        ------
        InputError
            If no file can be written there.
        OutputError
            If the disk is full or protected; an older file is kept.
        """
        FILE.save(path, self._stored())

    def _stored(self) -> StoredRun:
        """Data of the result that files hold."""
        kept: list[KeptRun | None] = [KeptRun.of_record(record) for record in self.runs]
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
            contacts=tuple(StoredContactRun.of_contact(*both) for both in zip(self.contacts, kept, strict=True)),
            warnings=self.warnings,
            others=self.others,
            end=self.end,
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
        """Pickle holds the same data as files, without the model and its matrices."""
        return _restored, (self._stored(),)

    @classmethod
    def load(cls, path: str | Path, mbs: MainSystem | None = None) -> Result:
        """Read a file that `save` wrote, with a model built in the same way as the one that was run, or without one.

        Without a model, `bodies` and `contacts` replace its items. They have the data that the run recorded: times,
        forces, rows, pressures, areas, friction, energies, momenta. Results that need meshes or matrices raise an
        InputError, for example velocities of points without a sensor.

        Parameters
        ----------
        path : str or Path
        mbs : exudyn.MainSystem, optional
            The model; it need not have been run. With damping and joints, it must be assembled.

        Raises
        ------
        InputError
            If the file is missing, damaged or of another kind, or the model is another one.
        """
        if mbs is None:
            return _restored(FILE.load(path))
        bodies, contacts = partition_items(mbs)
        hold_damping(mbs)
        stored: StoredRun = FILE.load(path)
        check_items(stored.items, described(bodies, contacts))
        return replace(
            _restored(stored),
            bodies=tuple(bodies),
            contacts=tuple(contacts),
            item_work=registered(mbs).work,
            marks=None,
            dampings=tuple(item.dampings for item in bodies),
        )

    def report(self, path: str | Path, *, title: str = "") -> Path:
        """Write the run as one HTML page: scene, step, conservation, contacts, timings, effects left out, figures.

        Parameters
        ----------
        path : str or Path
            Path of the page. It needs no other file.
        title : str
            Title of the page. Default: the file's name.

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
        """Write a film of the moving and deforming bodies, with a plot of the contact force below; it needs no screen.

        Parameters
        ----------
        path : str or Path
            Its ending chooses the kind: `.mp4`, `.gif`, or `.png` for a numbered picture of each frame.
        bodies : sequence of PartitionBody or (PartitionBody, FEModel), optional
            Default: all. With its FE model a body also shows the static answer to the contacts' forces.
        colour : {"speed", "deformation", "von_mises", "contact_pressure"}
            "von_mises" needs the FE models.
        end : float, optional
            Value at the upper end of the colours [m/s, m, Pa]. Default: a value that 99.5 % of the area stay below.
        frames : int or (m,) array
            Number of frames, or their times [s], see `at`. From 24 on, each impact gets up to half as many more.
        period : float
            Time between frames in the film [s], 0.01 to 600.
        scale : float, optional
            Factor on the deformation. Default: the power of ten that makes it visible.
        view : str
            Centre of the picture: "all", "contact", or the name of a body.
        direction : (3,)
            Direction from this centre to the viewer.
        size : (int, int)
            Width and height in pixels.
        progress : callable, optional
            Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

        Returns
        -------
        Path
            Path of the film, or of its first picture.

        Raises
        ------
        InputError
            If an argument has a wrong type or is out of range, or no file can be written at the path.
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
        """Make a page that shows the moving bodies in any browser, to play and turn; in a notebook, `result.scene()`.

        The page needs no other file and no network. It has the bodies with their deformation, rigid surfaces, Exudyn's
        own bodies as its renderer draws them, and the forces.

        Parameters
        ----------
        path : str or Path, optional
            Path of the page. Default: no file is written.
        bodies : sequence of PartitionBody or (PartitionBody, FEModel), optional
            Default: all. With its FE model a body also shows the static answer to the contacts' forces, and stresses.
        colours : sequence of str, optional
            Some of "speed", "deformation", "von_mises", "contact_pressure", for a choice on the page. Default: all that
            are available.
        frames : int or (m,) array
            Number of equally spaced frames, beside a dozen for each impact, or the times of all frames [s], see `at`.
        scale : float, optional
            First factor on the deformation; the page can change it. Default: the power of ten that makes the
            deformation visible.
        title : str
            Title of the page. Default: the file's name.
        height : int
            Height in a cell of a notebook [pixels].
        progress : callable, optional
            Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

        Returns
        -------
        Scene

        Raises
        ------
        InputError
            If an argument has a wrong type or is out of range, or no file can be written at the path.
        """
        target = None if path is None else writable(path)
        title = validate_text("title", title) or ("" if target is None else target.stem)
        made = scene_of(
            self, bodies, colours=colours, frames=frames, scale=scale, title=title, height=height, progress=progress
        )
        return made if target is None else made.save(target)

    def to_dataframe(self) -> DataFrame:
        """Histories of contacts and bodies as a table of pandas: force, gap, energy, momentum, with names and units.

        Each row is a time. `attrs` has the end of the run. Methods of the table, such as `to_csv`, write files.

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
        """Same data as a data set of xarray, with dimensions t, contact, body and axis, and units as attributes.

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
            Points by name. With the FE model of the body, velocities near a contact are more exact, see
            `PartitionBody.velocity`.

        Raises
        ------
        InputError
            If an argument has a wrong type, or the contact is of another model.
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
        info = {"step_s": self.step, "steps": self.steps, "time_s": self.time_s, "status": self.status}
        if isinstance(contact, StoredContact):
            info["label"] = self.method
        else:
            bodies = [item.body for item, _ in contact.sides]
            info["label"] = f"{bodies[0].basis.name}, {self.method}"
            info |= {"dofs": sum(body.n_dofs for body in bodies), "contact_nodes": contact.n_rows}
        of_friction = {}
        if contact.friction:
            of_friction = {
                "tangential_force": contact.friction.tangential_force(self),
                "dissipated": contact.dissipated_energy(self),
            }
        return History(self.t, contact.force(self), velocity, info, **of_friction)


def end_for(result: Result, mbs: MainSystem) -> RunEnd:
    """State at the end of a run, from which a run of this model goes on.

    Raises
    ------
    InputError
        If the run did not end with a whole step, or the model is another one.
    """
    if result.end is None:
        raise InputError(
            "go_on: the run of this result did not end with a whole step, so that no other run can go on from it"
        )
    bodies, contacts = partition_items(mbs)
    if result.marks is not None or result.bodies != tuple(bodies) or result.contacts != tuple(contacts):
        marks = described(result.bodies, result.contacts) if result.marks is None else result.marks
        check_items(marks, described(bodies, contacts))
    return result.end


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
        others=stored.others,
        end=stored.end,
    )


def samples(mbs: MainSystem) -> Result:
    """Result from the sensors, and from the contacts' own record if Exudyn read its sensors seldom."""
    items, sensors = check_sensors(mbs), {}
    for number in range(mbs.systemData.NumberOfSensors()):
        if mbs.GetSensorParameter(number, "storeInternal"):
            data = np.atleast_2d(mbs.GetSensorStoredData(number))
            if data.size:
                sensors[number] = data
    if not sensors:
        raise RunError("mbs: no sensor stored anything; run the model first")
    count = min(len(data) for data in sensors.values())
    t = next(iter(sensors.values()))[:count, 0].copy()
    bodies, contacts = tuple(items.bodies.values()), tuple(items.contacts.values())
    run, solver = runs_of(mbs).last(mbs), Solver.last(mbs)
    result = Result(
        t=t,
        status="finished",
        message="samples of the model's last run",
        step=float("nan"),
        steps=0,
        method="",
        time_s=float("nan"),
        sensors={number: data[:count, 1:] for number, data in sensors.items()},
        bodies=bodies,
        contacts=contacts,
        work=Work.counted(solver, run),
        runs=() if run is None else tuple(run.contact_run(contact).record for contact in contacts),
        item_work=items.work,
        newmark=None if solver is None else solver.newmark,
        others=() if run is None else run.others.motions(mbs),
        dampings=tuple(item.dampings for item in bodies),
    )
    times = np.empty(0) if run is None else run.record.times
    return result if run is None or not len(times) else _joined(result, times, run.record.sensors(mbs))


def _joined(result: Result, t: Array, kept: Mapping[int, Array]) -> Result:
    """Result at its own times and at t, (n,), with the values `kept` at t, (n, k); keys are the sensors' numbers."""
    further = ~np.isin(t, result.t)
    times = np.r_[result.t, t[further]]
    order = np.argsort(times)
    joined = {
        number: np.concatenate([data, kept[number][further]])[order]
        for number, data in result.sensors.items()
        if number in kept
    }
    seldom = frozenset(number for number in result.sensors if number not in kept)
    of_work = None if result.item_work is None or int(result.item_work.number) in seldom else result.item_work
    return replace(result, t=times[order], sensors=joined, seldom=seldom, item_work=of_work)


def cut(result: Result, count: int) -> Result:
    """Keep the first samples of a result."""
    sensors = {number: data[:count] for number, data in result.sensors.items()}
    return replace(result, t=result.t[:count], sensors=sensors)


def _number_of(number: SensorIndex) -> int:
    """Number of a sensor, which a user may have given."""
    if isinstance(number, Number | np.generic | np.ndarray) or not hasattr(number, "__int__"):  # no index of Exudyn
        return validate_integer("number", number)
    return int(number)


def when(result: Result, time: float) -> str:
    """Return the words that messages use for a time [s] of a run, or for a load factor of statics."""
    return f"t = {time:.6g}{' of the load steps' if result.method == 'static' else ' s'}"


def called(item: PartitionBody | StoredBody | PartitionContact | WorkSensor) -> str:
    """Return the name that messages use for a body, a contact or the sensor of work."""
    if isinstance(item, WorkSensor):
        return "this sensor of work"
    kind = "body" if isinstance(item, PartitionBody | StoredBody) else "contact"
    return f"{kind} {item.name!r}" if item.name else f"the {kind}"
