"""Fields of a run as files for ParaView: one VTU for each body and frame, and a PVD that lists them over time.

Points are where the bodies are at the start. `displacement` leads from there to where they are now, with rigid motion
and the rotation of a floating frame: ParaView's filter Warp By Vector with factor 1 shows the motion. `deformation` is
the part of the displacement that strains the body, in the axes of space. To show deformation s times as large, warp by
displacement + (s - 1) deformation.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, get_args
from xml.etree import ElementTree

import numpy as np

from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.plastic_results import SIDES
from ..exudyn_contacts.run_result import RunResult as Result
from ..fe.model import FEModel
from ..fe.shapes import linear_shares
from ..meshing.mesh_files import write_vtu
from ..plasticity.flow import von_mises as flow_von_mises
from ..reduction.recovery import nodal_stress, von_mises
from ..reduction.static_answer import StaticAnswer
from ..support.arrays import Array
from ..support.checks import validate_callable, validate_choice, validate_flag, validate_items, validate_result
from ..support.files import filling
from ..support.progress import Progress, shown

Shown = PartitionBody | tuple[PartitionBody, FEModel]
Load = tuple[PartitionContact, list[Array]]  # a contact, and its forces on the nodes of each side's patch, (n, np, 3)

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
_OF_STRESS = {"stress", "von_mises"}
_FRAMES = 50
_LONGEST_STEM = 40  # characters of a body's name in file names, which may have 255 bytes
_LIST = "run.pvd"
_FACETS = {3: "triangle", 6: "triangle6", 10: "VTK_LAGRANGE_TRIANGLE", 4: "quad"}
_CELLS = {4: "tetra", 10: "tetra10", 20: "VTK_LAGRANGE_TETRAHEDRON", 8: "hexahedron"}


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
        because their nodes have the contact's rows; with passes="two" on both bodies. Of contacts with friction:
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
    pieces = [BodyFields(entry, names, surface) for entry in shown_bodies(result.bodies, bodies)]
    answered = static_answer and any(piece.fem is not None for piece in pieces)
    loads = contact_loads(contacts, chosen) if answered else []
    entries = []
    with filling(folder, last=_LIST) as new, shown(progress, "write frames") as report:
        for part, (piece, stem) in enumerate(zip(pieces, _stems(pieces), strict=True)):
            for i, data in enumerate(piece.frames(chosen, contacts, loads)):
                path = new / f"{stem}_{i:04d}.vtu"
                write_vtu(path, piece.points, piece.kind, piece.cells, data)
                entries.append((float(chosen.t[i]), part, path.name))
                report((part + (i + 1) / len(chosen.t)) / len(pieces))
        _write_pvd(new / _LIST, sorted(entries))
    return Path(folder) / _LIST


def write_plastic_zones(folder: str | Path, contact: PartitionContact, result: Result) -> list[Path]:
    """Write what a run has left in the plastic zones of a contact, at its end and at rest, to VTU files for ParaView.

    Fields are means around nodes: "plastic_strain", equivalent, "residual_von_mises" [Pa], and "displacement" [m] in
    the body's own axes, the shape of the dent.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there. Files of the same names are replaced.
    contact : PartitionContact
    result : Result

    Returns
    -------
    list of Path
        One file for each zone, `zone_slave.vtu` and `zone_master.vtu`.

    Raises
    ------
    InputError
        If nothing can yield, or the result was read from a file, which does not hold this.
    OutputError
        If the disk is full or protected.
    """
    (contact,) = validate_contacts([contact])
    states = contact.plastic_states(result)
    assert contact.yielding is not None
    files = [f"zone_{name}.vtu" for name in states]
    with filling(folder, last=files[-1]) as new:
        for file, (side, run) in zip(files, contact.yielding.zones, strict=True):
            (item, patch), state, zone = contact.sides[side], states[SIDES[side]], run.zone
            region = item.body.partition.patches[patch].plastic
            assert region is not None
            moved = run.motion.at_rest(state)
            at_points = np.column_stack([state.equivalent, flow_von_mises(zone.stress(moved.ravel(), state))])
            cells = np.searchsorted(zone.nodes, region.cells)
            shares = np.repeat(cells, len(zone) // len(cells), axis=0)
            at_nodes, weight = np.zeros((len(zone.nodes), 2)), np.zeros(len(zone.nodes))
            np.add.at(at_nodes, shares, (zone.weight[:, None] * at_points)[:, None])
            np.add.at(weight, shares, zone.weight[:, None])
            strain, stress = (at_nodes / weight[:, None]).T
            fields = {"plastic_strain": strain, "residual_von_mises": stress, "displacement": moved}
            write_vtu(new / file, item.body.points[zone.nodes], _CELLS[cells.shape[1]], cells, fields)
    return [Path(folder) / file for file in files]


def shown_bodies(held: Sequence[PartitionBody], bodies: Sequence[Shown] | None) -> list[Shown]:
    """Return the `bodies` to write or draw, by default all that are `held`, or raise `InputError`."""
    expected = "bodies: expected a list of what CreatePartitionBody returns, or of pairs (body, fem) with its FE model"
    if bodies is None:
        bodies = held
    if isinstance(bodies, str | Mapping) or not isinstance(bodies, Iterable):
        raise InputError(f"{expected}, got {type(bodies).__name__}")
    found = list(bodies)
    if not found:
        raise InputError("bodies: there is no partition body to show; call CreatePartitionBody before")
    return found


def validate_contacts(contacts: Iterable[PartitionContact]) -> list[PartitionContact]:
    """Return contacts as a list, or raise `InputError`."""
    return validate_items("contacts", contacts, PartitionContact, "CreatePartitionContact()")


def _field_names(fields: Field | Iterable[Field]) -> list[Field]:
    """Names of fields without repetition."""
    if not isinstance(fields, Iterable):
        raise InputError(f"fields: expected names, {', '.join(map(repr, FIELDS))}, got {fields!r}")
    names = [validate_choice("fields", name, FIELDS) for name in ([fields] if isinstance(fields, str) else fields)]
    if not names:
        raise InputError(f"fields: expected at least one of {', '.join(map(repr, FIELDS))}, got none")
    return list(dict.fromkeys(names))


class BodyFields:
    """What is written or drawn of a body: points, cells and fields.

    Parameters
    ----------
    entry : PartitionBody or (PartitionBody, FEModel)
    names : sequence of str
        Some of `FIELDS`.
    surface : bool
        Whether to leave out the elements inside.

    Attributes
    ----------
    points : (n, 3) array
        Places of its nodes at the start, in space [m].
    cells : (nc, k) int array
        Facets or elements, as rows of `points`.
    kind : str
        Name of the cells in meshio.

    Raises
    ------
    InputError
        If `entry` has a wrong type, a needed FE model is missing or belongs to another body, or the body was saved
        without the inside that is needed.
    """

    def __init__(self, entry: Shown, names: Sequence[str], surface: bool) -> None:
        self.item: PartitionBody
        self.fem: FEModel | None
        pair = entry if isinstance(entry, tuple) else (entry, None)
        if len(pair) != 2 or not isinstance(pair[0], PartitionBody) or not isinstance(pair[1], FEModel | None):
            got = " and ".join(type(x).__name__ for x in (entry if isinstance(entry, tuple) else (entry,)))
            raise InputError(
                f"bodies: expected what CreatePartitionBody returns, or pairs (body, fem) with its FE model, got {got}"
            )
        self.item, self.fem = pair
        self.names, self.body = names, self.item.body
        self._static: StaticAnswer | None = None
        if self.fem is None and (_OF_STRESS & {*names} or not surface):
            what = "stress" if surface else "the inside"
            raise InputError(
                f"bodies: {what} of {self.item.name or 'a body'!r} needs its FE model, give pairs (body, fem)"
            )
        if self.fem is not None and not self.body.partition.is_of(self.fem):
            raise InputError(
                f"bodies: expected the FE model of {self.item.name or 'a body'!r} with {self.body.fe_dofs} dofs, of "
                f"the same mesh, got {self.fem!r}"
            )
        self._stressed = self.fem is not None and bool(_OF_STRESS & {*names})
        if self._stressed or not surface:
            self.body.check_inside(f"{'stress' if surface else 'the inside'} of {self.item.name or 'a body'!r}")
        cells = self.body.facets if surface or self.fem is None else self.fem.cells
        self.kind = (_FACETS if surface else _CELLS)[cells.shape[1]]
        self.nodes, numbers = np.unique(cells, return_inverse=True)
        self.cells: Array = numbers.reshape(cells.shape)
        self.kinematics = self.item.kinematics.at(self.nodes)
        self.points = self.kinematics.place(np.zeros(self.body.n_dofs))

    def frames(
        self, result: Result, contacts: Iterable[PartitionContact], loads: Iterable[Load]
    ) -> Iterator[dict[str, Array]]:
        """Yield fields, (n,) or (n, k), at each time of `result`, with those of `contacts`, answers to `loads`."""
        pressures = _pressures(self.item, contacts, result) if "contact_pressure" in self.names else []
        tangential = _tangential_fields(self.item, contacts, result, {*self.names})
        for i, (q, q_t) in enumerate(zip(self.item.coordinates(result), self.item.coordinates_t(result), strict=True)):
            data = self.fields(q, q_t, self.forces(loads, i))
            if pressures:
                field = np.zeros(len(self.body.points))
                for facets, nodes, values in pressures:
                    field[nodes] = values[i].toarray()[0]
                    if facets.shape[1] > 4:  # pressures are linear between corners
                        field[facets[:, 3:]] = field[facets[:, :3]] @ linear_shares(facets.shape[1])[3:].T
                data["contact_pressure"] = field[self.nodes]
            for name, nodes, values in tangential:
                field = np.zeros((len(self.body.points), *values.shape[2:]))
                field[nodes] = values[i]
                data[name] = data.get(name, 0.0) + field[self.nodes]
            yield data

    def forces(self, loads: Iterable[Load], i: int) -> Array:
        """Forces of contacts, `loads`, on all n nodes at sample i, (n, 3) in space [N]."""
        forces = np.zeros((len(self.body.points), 3))
        for contact, on_sides in loads:
            for (item, patch), on_side in zip(contact.sides, on_sides, strict=True):
                if item is self.item:
                    forces[self.body.partition.patches[patch].nodes] += on_side[i]
        return forces

    def fields(self, q: Array, q_t: Array, forces: Array | None = None) -> dict[str, Array]:
        """Fields at coordinates q and velocities q_t, (n_dofs,), with the static answer to forces on all nodes."""
        kinematics, axes, answer = self.kinematics, self.kinematics.frame(q)[1], None
        displacement, deformation = kinematics.displacements(q), kinematics.deformation(q)
        if self.fem is not None and self.body.basis.flexibility is not None and forces is not None and forces.any():
            self._static = self._static or StaticAnswer(self.fem, self.body)
            answer = self._static(kinematics.in_frame(q, forces), None if self._stressed else self.nodes)
            shown = answer[self.nodes] if self._stressed else answer
            deformation = deformation + shown
            displacement = displacement + shown @ axes.T
        data = {"displacement": displacement, "deformation": deformation @ axes.T}
        if "velocity" in self.names:
            data["velocity"] = kinematics.velocities(q, q_t)
        if self.fem is not None and self._stressed:
            within = self.body.displacement(kinematics.elastic(q))
            stress = nodal_stress(self.fem, within if answer is None else within + answer)[self.nodes]
            data |= {"stress": stress, "von_mises": von_mises(stress)}
        return {name: data[name] for name in self.names if name in data}


def contact_loads(contacts: Iterable[PartitionContact], result: Result) -> list[Load]:
    """Forces of elastic contacts on the nodes of their patches at the times of `result`; none of multipliers.

    Raises
    ------
    InputError
        If a carried rigid surface has the contact: its forces on nodes are not known after the run.
    """
    contacts = validate_contacts(contacts)
    validate_result(result)
    try:
        return [(contact, contact.nodal_forces(result)) for contact in contacts if contact.compliant]
    except InputError as error:
        raise InputError(f"{error}; they are not needed without FE models, or with static_answer=False") from error


def _pressures(
    item: PartitionBody, contacts: Iterable[PartitionContact], result: Result
) -> list[tuple[Array, Array, Array]]:
    """Facets and nodes of a body's patches that have rows, and the pressures at these nodes, (n, np) [Pa]."""
    found = []
    for contact in contacts:
        pressure, start = contact.pressure(result), 0
        for side, patch in contact.sides:
            own = side.body.partition.patches[patch]
            if start < pressure.shape[1]:  # the slave has rows; with two passes, so has the master
                if side is item:
                    found.append((own.facets, own.nodes, pressure[:, start : start + len(own.nodes)]))
                start += len(own.nodes)
    return found


def _tangential_fields(
    item: PartitionBody, contacts: Iterable[PartitionContact], result: Result, names: set[str]
) -> list[tuple[str, Array, Array]]:
    """Fields of contacts with friction whose slave is the body: names, nodes, and values at these, (n, np, ...)."""
    found = []
    for contact in contacts:
        (slave, patch), *_ = contact.sides
        if slave is item and contact.friction is not None:
            nodes = item.body.partition.patches[patch].nodes
            if "contact_traction" in names:
                found.append(("contact_traction", nodes, contact.traction(result)))
            if "contact_state" in names:
                found.append(("contact_state", nodes, contact.row_states(result).astype(float)))
    return found


def _stems(pieces: Sequence[BodyFields]) -> list[str]:
    """File names from the bodies' names, without special characters; they differ in more than case."""
    stems: list[str] = []
    for i, piece in enumerate(pieces):
        wanted = re.sub(r"[^\w.-]+", "_", piece.item.name)[:_LONGEST_STEM] or f"body{i}"
        stem, number = wanted, 1
        while stem.casefold() in [other.casefold() for other in stems]:
            number += 1
            stem = f"{wanted}_{number}"
        stems.append(stem)
    return stems


def _write_pvd(path: Path, entries: Iterable[tuple[float, int, str]]) -> None:
    """Write the PVD file: a list of files with their times and parts."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for t, part, name in entries:
        ElementTree.SubElement(collection, "DataSet", timestep=repr(t), part=str(part), file=name)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
