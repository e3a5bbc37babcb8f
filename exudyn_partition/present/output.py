"""Fields of a run as files for ParaView: one VTU for each body and frame, and a PVD that lists them over time.

Points are where the bodies are at the start. `displacement` leads from there to where they are now, with rigid motion
and the rotation of a floating frame: ParaView's filter Warp By Vector with factor 1 shows the motion. `deformation` is
the part of the displacement that strains the body, in the axes of space. To show deformation s times as large, warp by
displacement + (s - 1) deformation.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal, get_args
from xml.etree import ElementTree

from ..errors import InputError
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..meshing.mesh_files import write_vtu
from ..reduction.body import ReducedBody
from ..reduction.static_answer import StaticAnswer
from ..support.arrays import Array
from ..support.checks import listed, validate_callable, validate_choice, validate_flag, validate_result
from ..support.files import distinct, filling
from ..support.progress import Progress, shown
from .body_fields import BodyFields, Shown, contact_loads, shown_bodies, validate_contacts

__all__ = ["FIELDS", "write_paraview"]

Field = Literal[
    "displacement",
    "deformation",
    "velocity",
    "stress",
    "von_mises",
    "contact_pressure",
    "contact_traction",
    "contact_state",
]
FIELDS: tuple[Field, ...] = get_args(Field)
_FRAMES = 50
_LONGEST_STEM = 40  # characters of a body's name in file names, which may have 255 bytes
_LIST = "run.pvd"


def write_paraview(
    folder: str | Path,
    result: Result,
    bodies: Sequence[Shown] | None = None,
    *,
    fields: Field | Iterable[Field] = ("displacement",),
    times: Sequence[float] | Array | int = _FRAMES,
    contacts: Sequence[PartitionContact] | None = None,
    surface: bool = True,
    static_answer: bool = True,
    progress: Progress | None = None,
) -> Path:
    """Write fields of a run to VTU files and a PVD file, which ParaView opens as a film.

    Only one frame of one body is in memory at a time.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there. Files of the same names are replaced when all are written.
    result : Result
    bodies : sequence of PartitionBody or (PartitionBody, FEModel), optional
        Default: all of the run. Stresses, and the inside of a body, need its FE model.
    fields : str or iterable of str
        "displacement" and "deformation" [m] and "velocity" [m/s], (n, 3) in the axes of space. "von_mises", (n,), and
        "stress", (n, 6) xx, yy, zz, yz, xz, xy in the body's own axes [Pa]. "contact_pressure", (n,) [Pa], on slaves,
        because their nodes have the contact's rows. Of contacts with friction:
        "contact_traction", (n, 3) [Pa], tangential, and "contact_state", (n,): 0 open, 1 sticks, 2 slips.
    times : (k,) [s] or int
        Times, for which the nearest samples are taken; or the number of frames, equally spaced over the run.
    contacts : sequence of PartitionContact, optional
        Default: all of the run.
    surface : bool
        Write only the surface, not the elements inside.
    static_answer : bool
        For bodies with an FE model, add the static answer to the contacts' forces that the kept shapes do not contain,
        see `recovery.StaticAnswer`. Without it, stresses beneath a contact are far too small. It costs a factorisation
        of the body's stiffness. Velocities do not include it.
    progress : callable, optional
        Called with the finished share, 0 to 1. Default: a bar on the terminal, if writing takes long.

    Returns
    -------
    Path
        Path of the PVD file, `run.pvd` in the folder.

    Raises
    ------
    InputError
        If an argument has a wrong type, a field is unknown, a time is not within the run, or there is no body. Also if
        an FE model is missing or belongs to another body.
    OutputError
        If the disk is full or protected; old files are kept.
    """
    names = _field_names(fields)
    validate_result(result)
    validate_flag("surface", surface)
    validate_flag("static_answer", static_answer)
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    contacts = validate_contacts(result.contacts if contacts is None else contacts)
    for contact in contacts:
        result.sensor_of(contact, contact["sForce"])  # raises for a contact of another model
    chosen = result.at(times)
    answers: dict[ReducedBody, StaticAnswer] = {}
    pieces = [BodyFields(entry, names, surface, answers) for entry in shown_bodies(result.bodies, bodies)]
    answered = static_answer and any(piece.fem is not None for piece in pieces)
    loads = contact_loads(contacts, chosen) if answered else []
    entries = []
    with filling(folder, last=_LIST) as new, shown(progress, "write frames") as report:
        for part, (piece, stem) in enumerate(zip(pieces, _stems(pieces), strict=True)):
            for i, data in enumerate(piece.frames(chosen, contacts, loads)):
                path = new / f"{stem}_{i:04d}.vtu"
                write_vtu(path, piece.points, piece.blocks, data)
                entries.append((float(chosen.t[i]), part, path.name))
                report((part + (i + 1) / len(chosen.t)) / len(pieces))
        _write_pvd(new / _LIST, sorted(entries))
    return Path(folder) / _LIST


def _field_names(fields: Field | Iterable[Field]) -> list[Field]:
    """Names of fields without repetition."""
    given = [fields] if isinstance(fields, str) else listed(fields)
    if given is None:
        raise InputError(f"fields: expected names, {', '.join(map(repr, FIELDS))}, got {fields!r}")
    names = [validate_choice("fields", name, FIELDS) for name in given]
    if not names:
        raise InputError(f"fields: expected at least one of {', '.join(map(repr, FIELDS))}, got none")
    return list(dict.fromkeys(names))


def _stems(pieces: Sequence[BodyFields]) -> list[str]:
    """File names from the bodies' names, without special characters; they differ in more than case."""
    return distinct(
        re.sub(r"[^\w.-]+", "_", piece.item.name)[:_LONGEST_STEM] or f"body{i}" for i, piece in enumerate(pieces)
    )


def _write_pvd(path: Path, entries: Iterable[tuple[float, int, str]]) -> None:
    """Write the PVD file: a list of files with their times and parts."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for t, part, name in entries:
        ElementTree.SubElement(collection, "DataSet", timestep=repr(t), part=str(part), file=name)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def __dir__() -> list[str]:
    return __all__
