"""Exudyn adapter: contacts of partition bodies as objects, sensors and step functions of an existing model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ..contact.formulations.compliance import ComplianceContact
from ..contact.formulations.lagrange import LagrangeContact
from ..contact.formulations.penalty import PenaltyContact, bed_stiffness, inertial_stiffness
from ..contact.formulations.stabilised import StabilisedContact
from ..contact.formulations.two_pass import TwoPass
from ..contact.gaps import Side
from ..contact.patch_gaps import PatchGaps
from ..contact.rigid import RigidCylinder, RigidGaps, RigidPlane, RigidSphere, RigidSurface
from ..errors import InputError, RunError
from ..exudyn_bodies.carriers import Carrier, load_carrier, motion, pose
from ..exudyn_bodies.model import REGISTRY, coordinate_slices, partition_items, runs_implicit, validate_new_name
from ..exudyn_bodies.partition_body import PartitionBody
from ..support.arrays import Array
from ..support.checks import validate_choice, validate_positive, validate_vector
from ..support.optional import require
from ..surfaces.points import ROWS
from .central_differences import MultiplierStep
from .contact_elements import add_element, add_links
from .contact_results import ContactResults
from .coupling import check_shared_bodies
from .run_record import RunRecord, run_record

FORMULATIONS = ("compliance", "lagrange", "penalty")
PASSES = ("finer", "given", "two")

_DIGITS = 1e-5  # of a facet's size: round-off of places in space from which gaps are no longer known
_STIFFEST = 1e6  # of the default penalty: the explicit step is a thousandth of the default's then
_FINER = 0.9  # facets of the master smaller than this share of the slave's make the two change places


class PartitionContact(ContactResults):
    """What `CreatePartitionContact` returns: Exudyn indices by name, and the contact's results.

    Keys: `oContact`, the force element; `sForce`, a sensor of the total normal force [N], the number of closed rows,
    the force on the slave [N] and the smallest gap [m]; of multipliers also the impulses so far in an explicit run,
    total and on the slave [N s]. `sMoment` after `AddMomentSensor`: the moment on the slave [N m].

    `slave` and `master` are the bodies as the rows have them: with passes="finer" they may have changed places.
    """

    def __init__(self, name: str, sides: Sequence[tuple[PartitionBody, int]], rigid: RigidSurface | None) -> None:
        super().__init__()
        self.name, self.sides = name, tuple(sides)
        self.slave = sides[0][0]
        self.master = rigid if rigid is not None else sides[1][0]
        self.laws = {}
        self.group = [self]
        self.stepper: Any = None  # MultiplierStep of multipliers
        self.carrier: Carrier | None = None
        self._moment_about: Array | None = None

    def restart(self, t: float = 0.0) -> None:
        """Forget the last run; the next one begins at time t [s]."""
        if self.stepper is not None:
            self.stepper.reset()
            self.laws["implicit"].reset()
        else:
            (self.law if len(self.group) == 1 else self.together).reset()
        self.reached_edge_at: float | None = None
        self.reached_edge: Array | None = None
        self.run = object()
        self._stepped_to = t
        self._impulse = np.zeros(4)
        self._samples: list[tuple[float, Array, Array]] = []
        self._closed = self._closed_nodes = np.empty(0, dtype=np.int64)
        self._areas = self.law.node_areas

    def before_step(self, mbs: Any, t: float) -> None:
        """Apply multipliers ahead of the explicit step that ends at t, with those of other contacts that they move.

        With joints in the model, `solve_dynamic` does.
        """
        if self.stepper is not None and self.stepper.joints is None:
            record = run_record(mbs)
            if record.on:
                record.advance(mbs, t)
            self.stepper.before_step(mbs, t)

    def take_law(self, mbs: Any) -> None:
        """Choose between the multipliers of explicit and of implicit runs by the solver at work."""
        self.law = self.laws["implicit" if runs_implicit(mbs) else "explicit"]

    def stepped(self, t: float, step: float) -> None:
        """Count what multipliers have pushed in the step to t."""
        if self.law.index.size:
            self._impulse += step * np.r_[self.law.lam.sum(), self.law.resultant()]
        self._stepped_to = t

    def sample(self, mbs: Any, record: RunRecord, t: float) -> list[float]:
        """Values of the sensor `sForce` at t, where `record` is that of the run."""
        record.see(mbs, t)
        return self._values(mbs, t, mbs.systemData.GetODE2Coordinates(copy=False))

    def recorded(self, mbs: Any, t: float, q: Array) -> dict[int, list[float]]:
        """Values of the contact's sensors at t, by their numbers, with the model's coordinates q there."""
        values = {int(self["sForce"]): self._values(mbs, t, q)}
        if self._moment_about is not None:
            values[int(self["sMoment"])] = self.law.moment(self._moment_about).tolist()
        return values

    def _values(self, mbs: Any, t: float, q: Array) -> list[float]:
        law = self.law
        closed = law.index
        if self.ahead:
            self._check_step(mbs, t, q)
        if closed.size:
            if closed is not self._closed:  # the active set is kept from step to step
                self._closed, self._closed_nodes = closed, law.row_nodes[closed]
                if self.reached_edge_at is None:
                    self.reached_edge = law.edge_reached()
                    self.reached_edge_at = None if self.reached_edge is None else t
            lam = law.lam.take(closed)
            if self._samples and self._samples[-1][0] == t:  # asked for again
                self._samples.pop()
            self._samples.append((t, self._closed_nodes, lam))
            values = [float(lam.sum()), float(closed.size), *law.resultant().tolist(), 0.0]
        else:
            values = [0.0, 0.0, 0.0, 0.0, 0.0, float(law.least_gap)]
        return values + self._impulse.tolist() if self.multipliers else values

    def _check_step(self, mbs: Any, t: float, q: Array) -> None:
        """Refuse a run in which multipliers were not applied, or not by central differences."""
        if t > self._stepped_to and self.stepper.joints is None:
            raise RunError(
                f"contact {self.name!r}: its multipliers were not applied in the step to t = {t:.6g} s, for its "
                "PreStep function was replaced. Set your own with SetPreStepUserFunction before "
                "CreatePartitionContact, or run the model by solve_dynamic"
            )
        self.law.check_gaps(np.concatenate([q[s] for s in self.slices(mbs)]))

    def slices(self, mbs: Any) -> list[slice]:
        """Where the coordinates of slave and master are among the model's."""
        return [s for item, _ in self.sides for s in coordinate_slices(mbs, item)]

    def force_in_group(self, mbs: Any) -> Array:
        """Generalised force of this contact, (n,), solved together with those that move its patches."""
        data = mbs.systemData.GetODE2Coordinates(copy=False)

        def coordinates() -> list[Array]:
            return [np.concatenate([data[s] for s in contact.slices(mbs)]) for contact in self.group]

        return self.together.forces_at(data, coordinates)[self._place_in_group]

    def rows_on(self, item: PartitionBody) -> sp.csr_matrix:
        """Gap rows of multipliers on the coordinates of `item`, one of the bodies, (nr, n_dofs)."""
        G, n = self.laws["explicit"].G, self.slave.body.n_dofs
        return sp.csr_matrix(G[:, :n] if item is self.slave else G[:, n:])

    @property
    def nodes(self) -> list[Any]:
        """Exudyn nodes of slave and master."""
        return [node for item, _ in self.sides for node in item.nodes]

    def AddMomentSensor(self, mbs: Any, point: Sequence[float] = (0.0, 0.0, 0.0)) -> Any:
        """Add a sensor of the moment on the slave about a point in space, (3,) [m]; returns its number, also `sMoment`.

        Extra, for it costs the places of the patch's nodes in every sample.

        Raises
        ------
        InputError
            If the point is no vector of three numbers, or the contact is of another model.
        """
        place = validate_vector("point", point)
        if not any(contact is self for contact in partition_items(mbs)[1]):
            raise InputError(f"mbs: contact {self.name!r} belongs to another model, or to this one before a Reset")
        self["sMoment"] = mbs.AddSensor(
            require("exudyn.itemInterface").SensorUserFunction(
                sensorUserFunction=lambda mbs, t, *unused: [*map(float, self.law.moment(place))], storeInternal=True
            )
        )
        self._moment_about = place
        return self["sMoment"]


def CreatePartitionContact(
    mbs: Any,
    slave: PartitionBody,
    master: PartitionBody | RigidSurface,
    *,
    formulation: str = "compliance",
    rows: str | None = None,
    passes: str = "finer",
    slavePatch: int | str | None = None,
    masterPatch: int | str | None = None,
    masterBody: Any = None,
    stiffness: float | None = None,
    name: str = "",
) -> PartitionContact:
    """Add frictionless contact between the patches of two partition bodies, or of one and a rigid surface.

    The slave's patch is kept out of the master. Pairs stay as they are found at the start, along the line of
    contact, until the patches slide along each other; then they follow (`contact.patch_gaps`).

    Parameters
    ----------
    mbs : exudyn.MainSystem
    slave : PartitionBody
    master : PartitionBody, RigidPlane, RigidSphere or RigidCylinder
        Rigid surfaces are fixed in space, or to `masterBody`.
    formulation : {"compliance", "lagrange", "penalty"}
        "compliance" where a basis carries a residual flexibility; "lagrange" for bases whose patch has mass, the
        paper's and Craig-Bampton's, in VelocityVerlet (`contact.lagrange`) and generalized-alpha
        (`contact.stabilised`); "penalty" for any basis, an elastic layer on the slave's patch.
    rows : {"integrated", "node-to-segment"}, optional
        What is kept out: the mean gap around each node of the slave's patch, which passes uniform pressure through
        meshes that do not match, or each node by itself (paper, section 3); see `contact.points`. A mean over a convex
        tip closes later than the tip's lowest point, by the order of a facet's size squared over the radius. Default:
        "integrated", but with "lagrange" the paper's "node-to-segment", whose implicit steps converge better.
    passes : {"finer", "given", "two"}
        Which body is the slave: the one with the smaller facets, the one given as such, or both in turn, with half of
        the contact each.
    slavePatch, masterPatch : int or str, optional
        Number or name of the contact patch, for bodies that have several.
    masterBody : optional
        Exudyn body that carries the rigid surface, which is then given in that body's axes.
    stiffness : float, optional
        Of the penalty's layer [N/m3]. Default: what makes it yield under uniform pressure as the residual flexibility
        does; where patches have mass, what adds a tenth to their highest squared frequency at most.
    name : str

    Returns
    -------
    PartitionContact

    Raises
    ------
    EmptyRegionError, PenetrationError, InputError, IndefiniteMatrixError
    """
    bodies, contacts = partition_items(mbs)
    other = master if isinstance(master, PartitionBody) else None
    rigid = None if isinstance(master, PartitionBody) else master
    if rigid is not None and not isinstance(rigid, (RigidPlane, RigidSphere, RigidCylinder)):
        raise InputError(
            "master: expected what CreatePartitionBody returns, or a RigidPlane, RigidSphere or RigidCylinder, got "
            f"{type(master).__name__}"
        )
    if not isinstance(slave, PartitionBody):
        raise InputError(f"slave: expected what CreatePartitionBody returns, got {type(slave).__name__}")
    for role, item in (("slave", slave), ("master", other)):
        if item is not None and not any(item is body for body in bodies):
            raise InputError(f"{role}: body {item.name!r} belongs to another model, or to this one before a Reset")
    if slave is master:
        raise InputError("slave, master: expected two bodies, got the same twice")
    validate_new_name(mbs, name, ("Object", "Sensor"))
    validate_choice("formulation", formulation, FORMULATIONS)
    rows = validate_choice("rows", rows or ("node-to-segment" if formulation == "lagrange" else "integrated"), ROWS)
    validate_choice("passes", passes, PASSES)
    if masterBody is not None and rigid is None:
        raise InputError("masterBody: only a rigid surface is carried by a body")
    if masterPatch is not None and rigid is not None:
        raise InputError(f"masterPatch: a {type(rigid).__name__} has no patches, leave it out")
    if stiffness is not None and formulation != "penalty":
        raise InputError(
            f"stiffness: formulation {formulation!r} has none, it is taken only with formulation='penalty'"
        )
    sides = [(slave, slave.body.partition.patch(slavePatch))]
    if other is not None:
        sides.append((other, other.body.partition.patch(masterPatch)))
    placed = [Side.of(item.kinematics, patch) for item, patch in sides]
    for side in placed:
        _check_digits(side)
    if passes == "finer" and rigid is None and placed[1].surface.facet_size < _FINER * placed[0].surface.facet_size:
        sides, placed = sides[::-1], placed[::-1]
    contact = PartitionContact(name, sides, rigid)
    _check_formulation(formulation, [item for item, _ in sides])

    if rigid is not None:
        contact.law = _law(
            formulation, RigidGaps(placed[0], rigid, rows, pose(mbs, masterBody), motion(mbs, masterBody)), stiffness
        )
    else:
        contact.law = _law(formulation, PatchGaps(placed[0], placed[1], rows), stiffness)
    if passes == "two":
        if rigid is not None or formulation == "lagrange":
            raise InputError("passes: 'two' needs two partition bodies and formulation 'compliance' or 'penalty'")
        back = _law(formulation, PatchGaps(placed[1], placed[0], rows), stiffness)
        contact.law = TwoPass(contact.law, back)
    if formulation == "lagrange":
        contact.laws = {"explicit": contact.law, "implicit": StabilisedContact(contact.law.gaps)}
        contact.stepper = MultiplierStep([contact])
    if masterBody is not None:
        contact.carrier = Carrier(mbs, masterBody)
    contact.restart()
    check_shared_bodies(contact, contacts)
    if contact.multipliers:
        _chain_before_step(mbs, contact)
    contact["oContact"] = add_element(mbs, contact)
    if masterBody is not None:
        load_carrier(mbs, contact, masterBody)
    add_links(mbs, contact)
    items, record = require("exudyn.itemInterface"), run_record(mbs)
    contact["sForce"] = mbs.AddSensor(
        items.SensorUserFunction(
            name=name, sensorUserFunction=lambda mbs, t, *unused: contact.sample(mbs, record, t), storeInternal=True
        )
    )
    mbs.sys[REGISTRY][1][int(contact["sForce"])] = contact
    return contact


def _check_digits(side: Side) -> None:
    """Gaps are differences of places: far from the origin they have no digits left."""
    reach, size = float(abs(side.surface.points).max()), side.surface.facet_size
    if np.finfo(float).eps * reach > _DIGITS * size:
        raise InputError(
            f"referencePosition: the patch is {reach:.3g} m from the origin, where numbers stand "
            f"{np.finfo(float).eps * reach:.2g} m apart, expected at most {_DIGITS:g} of its facets' size, {size:.3g} "
            "m. Move the origin near to the contact"
        )


def _check_formulation(formulation: str, items: list[PartitionBody]) -> None:
    flexible = [item.body.basis.flexibility is not None for item in items]
    names = " and ".join(repr(item.body.basis.name) for item in items)
    if formulation == "compliance" and not any(flexible):
        raise InputError(
            f"formulation: 'compliance' needs a residual flexibility, which basis {names} does not have; take "
            "formulation='lagrange', or basis='contact-adapted' or 'residual'"
        )
    if formulation == "lagrange":
        if any(flexible):
            raise InputError(
                f"formulation: 'lagrange' needs contact patches that move by coordinates with mass, which "
                f"basis {names} does not give them; take formulation='compliance', or basis='free'"
            )


def _law(formulation: str, gaps: PatchGaps | RigidGaps, stiffness: float | None) -> Any:
    if formulation == "compliance":
        return ComplianceContact(gaps)
    if formulation == "lagrange":
        return LagrangeContact(gaps)
    if any(side.flexibility is not None for side in gaps.sides):
        usual = bed_stiffness(gaps)
    else:
        inverse_mass = 1 / np.concatenate([side.kinematics.mass for side in gaps.sides])
        omega_max = max(_highest_frequency(side.kinematics.body) for side in gaps.sides)
        usual = inertial_stiffness(gaps, inverse_mass, omega_max)
    if stiffness is None:
        stiffness = usual
    elif validate_positive("stiffness", stiffness, "N/m3") > _STIFFEST * usual:
        raise InputError(
            f"stiffness: expected at most {_STIFFEST * usual:.3g} N/m3, a million times what the bodies ask for, got "
            f"{stiffness:.3g}. A layer so stiff yields by less than round-off and takes steps that never end. Take "
            "formulation='compliance' or 'lagrange', which keep gaps closed without a layer"
        )
    return PenaltyContact(gaps, stiffness)


def _highest_frequency(body: Any) -> float:
    """Highest circular frequency of a reduced body [rad/s]."""
    scale = sp.diags(1 / np.sqrt(body.mass.diagonal()))
    K = scale @ body.stiffness @ scale
    start = np.ones(K.shape[0])
    largest = scipy.sparse.linalg.eigsh(K, k=1, which="LA", tol=1e-4, v0=start, return_eigenvectors=False)[0]
    return float(np.sqrt(largest))


def _chain_before_step(mbs: Any, contact: PartitionContact) -> None:
    """Put the contact's work before each step in front of the model's own PreStep function."""
    own = mbs.GetPreStepUserFunction()
    own_function = own["function"] if isinstance(own, dict) else None

    def before_step(mbs: Any, t: float) -> bool:
        contact.before_step(mbs, t)
        return own_function is None or own_function(mbs, t)

    mbs.SetPreStepUserFunction(before_step)
