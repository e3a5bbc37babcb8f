"""A run as a table of pandas or a data set of xarray, with names and units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..support.arrays import Array
from ..support.foreign import DataFrame, Dataset
from ..support.optional import require

_AXES = ("x", "y", "z")

Item = TypeVar("Item", PartitionBody, PartitionContact)


def dataframe(result: Result) -> DataFrame:
    """See `Result.to_dataframe`."""
    columns: dict[str, Array] = {}
    units = {"t [s]": "s"}
    for found in (_of_contacts(result), _of_bodies(result)):
        for name, (unit, values) in found.items():
            for item, history in values.items():
                added = _columns(f"{item}: {name}", unit, history)
                columns |= added
                units |= dict.fromkeys(added, unit)
    pandas = require("pandas")
    table = pandas.DataFrame(columns, index=pandas.Index(result.t, name="t [s]"))
    table.attrs |= _facts(result) | {"units": units}
    return table


def dataset(result: Result) -> Dataset:
    """See `Result.to_xarray`."""
    xarray = require("xarray")
    arrays = {}
    for of, found in (("contact", _of_contacts(result)), ("body", _of_bodies(result))):
        for name, (unit, values) in found.items():
            names, histories = list(values), np.stack([*values.values()], axis=1)
            dims = ("t", of, *["axis"] * (histories.ndim == 3))
            of_name = name if of == "contact" else f"body_{name}"
            arrays[of_name.replace(" ", "_")] = xarray.DataArray(
                histories, dims=dims, coords={of: names}, attrs={"units": unit, "long_name": name}
            )
    made = xarray.Dataset(arrays, coords={"t": ("t", result.t, {"units": "s"})}, attrs=_facts(result))
    return made.assign_coords(axis=list(_AXES)) if "axis" in made.dims else made


def _columns(name: str, unit: str, history: Array) -> dict[str, Array]:
    """Columns of a history, (n,) or (n, 3)."""
    if history.ndim == 1:
        return {f"{name} [{unit}]": history}
    return {f"{name} {axis} [{unit}]": history[:, i] for i, axis in enumerate(_AXES)}


def _of_contacts(result: Result) -> dict[str, tuple[str, dict[str, Array]]]:
    """Unit of each quantity, and its history by the contacts that have it."""
    known = {contact.name: contact for contact in result.contacts}
    found = {
        "force": ("N", {name: contact.force(result) for name, contact in known.items()}),
        "force on slave": ("N", _each(known, lambda contact: contact.force_on_slave(result))),
        "gap": ("m", _each(known, lambda contact: contact.gap(result))),
        "closed rows": ("1", _each(known, lambda contact: contact.closed_rows(result))),
        "contact area": ("m2", _each(known, lambda contact: contact.area(result))),
        "largest pressure": ("Pa", _each(known, lambda contact: contact.pressure(result).max(axis=1).toarray()[:, 0])),
        "contact energy": ("J", _each(known, lambda contact: contact.energy(result))),
    }
    rubbing = {name: contact for name, contact in known.items() if contact.friction}
    found["tangential force"] = ("N", _each(rubbing, lambda contact: contact.friction.tangential_force(result)))
    lossy = {
        name: contact
        for name, contact in known.items()
        if contact.friction or contact.plastic or contact.mechanics.damped
    }
    found["dissipated energy"] = ("J", _each(lossy, lambda contact: contact.dissipated_energy(result)))
    return {name: entry for name, entry in found.items() if entry[1]}


def _of_bodies(result: Result) -> dict[str, tuple[str, dict[str, Array]]]:
    """See `_of_contacts`."""
    known = {item.name or f"body {i}": item for i, item in enumerate(result.bodies)}
    found = {
        "place of centre": ("m", _each(known, lambda item: _motion(item, result)[0])),
        "rotation vector": ("rad", _each(known, lambda item: _motion(item, result)[1])),
        "velocity of centre": ("m/s", _each(known, lambda item: item.momentum(result) / item.body.total_mass)),
        "momentum": ("N s", {name: item.momentum(result) for name, item in known.items()}),
        "energy": ("J", {name: item.energy(result) for name, item in known.items()}),
    }
    return {name: entry for name, entry in found.items() if entry[1]}


def _motion(item: PartitionBody, result: Result) -> tuple[Array, Array]:
    """Place of the centre of mass, (n, 3) [m], and rotation vector from the axes of the mesh, (n, 3) [rad]."""
    q = item.coordinates(result)
    motion = item.rigid_motion(q)
    return item.kinematics.frame(np.zeros(q.shape[1]))[0] + motion[:, :3], motion[:, 3:]


def _each(known: Mapping[str, Item], value: Callable[[Item], Array]) -> dict[str, Array]:
    """Values of those items that know them: not all do, of runs that were read from files."""
    found = {}
    for name, item in known.items():
        try:
            found[name] = value(item)
        except InputError:
            continue
    return found


def _facts(result: Result) -> dict[str, object]:
    """What stands beside the table."""
    return {
        "status": result.status,
        "message": result.message,
        "method": result.method,
        "step_s": result.step,
        "steps": result.steps,
        "time_s": result.time_s,
    }
