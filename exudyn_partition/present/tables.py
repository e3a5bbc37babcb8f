"""A run as a table of pandas or a data set of xarray, with names and units."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ..errors import InputError
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..support.arrays import Array
from ..support.foreign import DataFrame, Dataset
from ..support.optional import require

_AXES = ("x", "y", "z")


def dataframe(result: Result) -> DataFrame:
    """See `Result.to_dataframe`."""
    columns: dict[str, Array] = {}
    for name, (unit, values) in _of_contacts(result).items():
        for contact, history in values.items():
            columns |= _columns(f"{contact}: {name}", unit, history)
    for name, (unit, values) in _of_bodies(result).items():
        for body, history in values.items():
            columns |= _columns(f"{body}: {name}", unit, history)
    pandas = require("pandas")
    table = pandas.DataFrame(columns, index=pandas.Index(result.t, name="t [s]"))
    table.attrs |= _facts(result)
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
    known = {contact.name or f"contact {i}": contact for i, contact in enumerate(result.contacts)}
    found = {
        "force": ("N", {name: contact.force(result) for name, contact in known.items()}),
        "gap": ("m", _each(known, lambda contact: contact.gap(result))),
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
        "momentum": ("N s", {name: item.momentum(result) for name, item in known.items()}),
        "energy": ("J", {name: item.energy(result) for name, item in known.items()}),
    }
    return {name: entry for name, entry in found.items() if entry[1]}


def _each(known: Mapping[str, PartitionContact], value: Callable[[PartitionContact], Array]) -> dict[str, Array]:
    """Values of those contacts that know them: not all do, of runs that were read from files."""
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
