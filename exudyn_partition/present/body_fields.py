"""Fields of a body in a run, for files and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_bodies.static_part import zone_stresses
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..fe.facets import by_shape, facet_corners
from ..fe.model import FEModel, node_dofs
from ..fe.shapes import linear_shares
from ..plasticity.strain_history import StrainHistory
from ..plasticity.zone_stress import ZoneStress
from ..reduction.body import ReducedBody
from ..reduction.recovery import nodal_stresses, von_mises
from ..reduction.static_answer import StaticAnswer
from ..support.arrays import Array
from ..support.checks import listed, validate_items, validate_result

Shown = PartitionBody | tuple[PartitionBody, FEModel]
_NUMBERS_AT_ONCE = 20_000_000  # in one array of displacements at some samples
_OF_STRESS = {"stress", "von_mises"}
_FACETS = {3: "triangle", 6: "triangle6", 10: "VTK_LAGRANGE_TRIANGLE", 4: "quad", 8: "quad8"}  # names in meshio
# A contact, its forces on the nodes of each side's patch, (n, np, 3), and the plastic strain of each side.
Load = tuple[PartitionContact, list[Array], list[StrainHistory | None]]


def shown_bodies(held: Sequence[PartitionBody], bodies: Sequence[Shown] | None) -> list[Shown]:
    """Return the `bodies` to write or draw, by default all that are `held`, or raise `InputError`."""
    expected = "bodies: expected a list of what CreatePartitionBody returns, or of pairs (body, fem) with its FE model"
    if bodies is None:
        bodies = held
    if (found := listed(bodies)) is None:
        raise InputError(f"{expected}, got {type(bodies).__name__}")
    if not found:
        raise InputError("bodies: there is no partition body to show; call CreatePartitionBody before")
    return found


def validate_contacts(contacts: Iterable[PartitionContact]) -> list[PartitionContact]:
    """Return contacts as a list, or raise `InputError`."""
    return validate_items("contacts", contacts, PartitionContact, "CreatePartitionContact()")


class Acting(NamedTuple):
    """What contacts do to a body at m samples.

    Attributes
    ----------
    forces : (m, n, 3) array
        Forces on all nodes in the body's axes [N], with the pseudo-forces of plastic strain.
    strains : dict of int to list of m (g, 6) arrays
        Plastic strain of its zones, by the numbers of their patches.
    """

    forces: Array
    strains: dict[int, list[Array]]


class BodyFields:
    """What is written or drawn of a body: points, cells and fields.

    Parameters
    ----------
    entry : PartitionBody or (PartitionBody, FEModel)
    names : sequence of str
        Some of `output.FIELDS`.
    surface : bool
        Whether to leave out the elements inside.
    answers : dict of ReducedBody to StaticAnswer, optional
        Those that are known; a new one is added. Equal bodies share it, as the balls of a bearing do.

    Attributes
    ----------
    points : (n, 3) array
        Places of its nodes at the start, in space [m].
    cells : (nc, k) int array
        Facets or elements, as rows of `points`.
    blocks : list of (str, (m, k) int array)
        The cells by their names in meshio.

    Raises
    ------
    InputError
        If `entry` has a wrong type, a needed FE model is missing or belongs to another body, or the body was saved
        without the inside that is needed.
    """

    def __init__(
        self, entry: Shown, names: Sequence[str], surface: bool, answers: dict[ReducedBody, StaticAnswer] | None = None
    ) -> None:
        self.item: PartitionBody
        self.fem: FEModel | None
        pair = entry if isinstance(entry, tuple) else (entry, None)
        if len(pair) != 2 or not isinstance(pair[0], PartitionBody) or not isinstance(pair[1], FEModel | None):
            got = " and ".join(type(x).__name__ for x in (entry if isinstance(entry, tuple) else (entry,)))
            raise InputError(
                f"bodies: expected what CreatePartitionBody returns, or pairs (body, fem) with its FE model, got {got}"
                "; bodies of a file come with their model, Result.load(path, mbs)"
            )
        self.item, self.fem = pair
        self.names, self.body = names, self.item.body
        self._answers = {} if answers is None else answers
        self._zones: dict[int, ZoneStress] = {}
        if self.fem is None and (_OF_STRESS & {*names} or not surface):
            what = "stress" if surface else "the inside"
            raise InputError(
                f"bodies: {what} of {self.item.name or 'a body'!r} needs its FE model, give pairs (body, fem)"
            )
        if self.fem is not None:
            self.body.check_fem(self.fem, f"bodies, {self.item.name or 'a body'!r}")
        self._stressed = self.fem is not None and bool(_OF_STRESS & {*names})
        if self.fem is not None and (self._stressed or not surface):
            self.fem.need_cells("stress" if surface else "the inside")
        if self._stressed or not surface:
            self.body.check_inside(f"{'stress' if surface else 'the inside'} of {self.item.name or 'a body'!r}")
        cells = self.body.facets if surface or self.fem is None else self.fem.cells
        self.nodes, numbers = np.unique(cells, return_inverse=True)
        self.cells: Array = numbers.reshape(cells.shape)
        if surface or self.fem is None:
            parts = by_shape(self.cells)
            self.blocks = [(_FACETS[len(columns)], self.cells[rows][:, columns]) for rows, columns in parts]
        else:
            self.blocks = [(kind.name, self.cells[rows][:, kind.columns]) for kind, rows in self.fem.kinds]
        self.kinematics = self.item.kinematics.at(self.nodes)
        self.points = self.kinematics.place(np.zeros(self.body.n_dofs))

    def frames(
        self, result: Result, contacts: Iterable[PartitionContact], loads: Iterable[Load]
    ) -> Iterator[dict[str, Array]]:
        """Yield fields, (n,) or (n, k), at each time of `result`, with those of `contacts`, answers to `loads`.

        Some samples are computed at once, which is quicker than one by one.
        """
        contacts = list(contacts)
        pressures = _pressures(self.item, contacts, result) if "contact_pressure" in self.names else []
        tangential = _tangential_fields(self.item, contacts, result, {*self.names})
        count = max(1, _NUMBERS_AT_ONCE // (3 * len(self.body.points)))
        for samples in np.split(np.arange(len(result.t)), range(count, len(result.t), count)):
            some = self.at_samples(result, loads, samples)
            for now, i in enumerate(samples):
                data = {name: values[now] for name, values in some.items()}
                if pressures:
                    field = np.zeros(len(self.body.points))
                    for facets, nodes, values in pressures:
                        field[nodes] += values[i].toarray()[0]  # contacts may share a patch
                        for rows, columns in by_shape(facets):
                            own = facets[rows][:, columns]
                            corners = facet_corners(own)
                            n = corners.shape[1]
                            if len(columns) > n:  # pressures are linear between corners
                                field[own[:, n:]] = field[corners] @ linear_shares(len(columns))[n:].T
                    data["contact_pressure"] = field[self.nodes]
                for name, nodes, values in tangential:
                    field = np.zeros((len(self.body.points), *values.shape[2:]))
                    field[nodes] = values[i]
                    data[name] = data.get(name, 0.0) + field[self.nodes]
                yield data

    def at_samples(self, result: Result, loads: Iterable[Load], samples: Array) -> dict[str, Array]:
        """Fields at m samples of `result`, (m,) int: (m, n) or (m, n, k), with the static answer to `loads`."""
        q, q_t = self.item.coordinates(result)[samples], self.item.coordinates_t(result)[samples]
        return self.fields(q, q_t, self._acting(loads, result.t, samples, q))

    def _acting(self, loads: Iterable[Load], t: Array, samples: Array, q: Array) -> Acting | None:
        """What contacts, `loads`, do to the body at some samples of the times t, (m,) int, at coordinates q, (m, n)."""
        own = [
            (patch, on_side, history)
            for contact, on_sides, histories in loads
            for (item, patch), on_side, history in zip(contact.sides, on_sides, histories, strict=True)
            if item == self.item
        ]
        if not own:
            return None
        forces = np.zeros((len(samples), len(self.body.points), 3))
        strains: dict[int, list[Array]] = {}
        axes = self.kinematics.frame(q)[1]
        for patch, on_side, history in own:
            nodes = self.body.partition.patches[patch].nodes
            forces[:, nodes] += on_side[samples] @ axes  # from the axes of space to the body's
            if history is not None:
                strains[patch] = [history.strain(int(number)) for number in history.numbers(t[samples])]
                for force, strain in zip(forces, strains[patch], strict=True):
                    force[history.zone.nodes] += history.zone.pseudo_forces(strain).reshape(-1, 3)
        return Acting(forces, strains)

    def fields(self, q: Array, q_t: Array, acting: Acting | None = None) -> dict[str, Array]:
        """Fields at coordinates q and velocities q_t, (m, n_dofs), with the static answer to what contacts do."""
        kinematics, axes = self.kinematics, self.kinematics.frame(q)[1]
        displacement, deformation = kinematics.displacements(q), kinematics.deformation(q)
        grown, products = kinematics.grown(q_t), kinematics.products(q_t)
        if grown is not None:
            deformation, displacement = deformation + grown, displacement + grown @ axes.swapaxes(1, 2)
        moved, answer = self._answer(acting)
        if len(moved):
            shown = answer[:, self.nodes] if self._stressed else answer
            deformation[moved] += shown
            displacement[moved] += shown @ axes[moved].swapaxes(1, 2)
        data = {"displacement": displacement, "deformation": deformation @ axes.swapaxes(1, 2)}
        if "velocity" in self.names:
            data["velocity"] = kinematics.velocities(q, q_t)
        if self.fem is not None and self._stressed:
            whole = self._everywhere(kinematics.elastic(q))
            if products is not None:
                whole += (self.body.basis.growth @ products.T).reshape(whole.shape)
            whole[..., moved] += answer.transpose(1, 2, 0)
            stress = nodal_stresses(self.fem, whole, self.nodes)
            if acting is not None:
                self._zones = self._zones or zone_stresses(self.body, self.fem)
                for patch, strains in acting.strains.items():
                    zone = self._zones[patch]
                    for i, strain in enumerate(strains):
                        stress[i] += zone.at_nodes(whole[..., i], strain)[self.nodes]
            data |= {"stress": stress, "von_mises": von_mises(stress)}
        return {name: data[name] for name in self.names if name in data}

    def _everywhere(self, q: Array) -> Array:
        """Displacements of all nodes, (n, 3, m) [m], of coordinates in the basis, (m, n_dofs)."""
        count = self.body.n_shapes
        found: Array = self.body.shape_rows() @ q[:, :count].T
        found[node_dofs(self.body.basis.nodal)] += q[:, count:].T
        return found.reshape(-1, 3, len(q))

    def _answer(self, acting: Acting | None) -> tuple[Array, Array]:
        """Samples at which contacts act, (j,) int, and the static answer to it then, (j, k, 3) [m].

        It is that of all nodes if stress is wanted, else of those shown.
        """
        nodes = np.arange(len(self.body.points)) if self._stressed else self.nodes
        moved = np.zeros(0, dtype=int) if acting is None else np.flatnonzero(acting.forces.any(axis=(1, 2)))
        if acting is None or self.fem is None or self.body.basis.flexibility is None or not len(moved):
            return moved[:0], np.zeros((0, len(nodes), 3))
        if self.body not in self._answers:
            self._answers[self.body] = StaticAnswer(self.fem, self.body)
        return moved, self._answers[self.body](acting.forces[moved], None if self._stressed else nodes)


def contact_loads(contacts: Iterable[PartitionContact], result: Result) -> list[Load]:
    """Forces of contacts on the nodes of their patches at the times of `result`, and plastic strain; no multipliers.

    Raises
    ------
    InputError
        If the result does not have them, as where another body carries the rigid surface.
    """
    contacts = validate_contacts(contacts)
    validate_result(result)
    try:
        return [(c, c.nodal_forces(result), c.plastic.strain_histories(result)) for c in contacts if c.compliant]
    except InputError as error:
        raise InputError(f"{error}; they are not needed without FE models, or with static_answer=False") from error


def _pressures(
    item: PartitionBody, contacts: Iterable[PartitionContact], result: Result
) -> list[tuple[Array, Array, Array]]:
    """Facets and nodes of the patches with which a body is a slave, and the pressures at these nodes, (n, np) [Pa]."""
    found = []
    for contact in contacts:
        (slave, patch), *_ = contact.sides
        if slave == item:
            own = item.body.partition.patches[patch]
            found.append((own.facets, own.nodes, contact.pressure(result)))
    return found


def _tangential_fields(
    item: PartitionBody, contacts: Iterable[PartitionContact], result: Result, names: set[str]
) -> list[tuple[str, Array, Array]]:
    """Fields of contacts with friction whose slave is the body: names, nodes, and values at these, (n, np, ...)."""
    found = []
    for contact in contacts:
        (slave, patch), *_ = contact.sides
        if slave == item and contact.friction:
            nodes = item.body.partition.patches[patch].nodes
            if "contact_traction" in names and contact.mechanics.law.semi_axes(1.0) is None:  # else it is not resolved
                found.append(("contact_traction", nodes, contact.friction.traction(result)))
            if "contact_state" in names:
                found.append(("contact_state", nodes, contact.friction.states(result).astype(float)))
    return found
