"""Exudyn adapter: contacts between partition bodies as objects, sensors and step functions of an existing model."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from ._checks import validate_choice
from ._optional import require
from .contact.compliance import ComplianceContact
from .contact.lagrange import LagrangeContact
from .contact.rows import pair
from .errors import InputError, ModelLimitWarning, RunError
from .history import at_times
from .items import REGISTRY, PartitionBody, coordinate_slices, partition_items

if TYPE_CHECKING:
    from .solve import Result

Array = np.ndarray

_COUPLED = 0.01  # residual flexibility between two patches over their own, below which nobody needs a warning


class PartitionContact(dict):
    """What `CreatePartitionContact` returns: Exudyn indices by name, and the contact's results.

    Keys: `oContact` with compliance; `sForce`, a sensor of the total normal force [N], the number of closed rows and
    the force on the slave [N]; of multipliers also the impulses so far, total and on the slave [N s].
    """

    def __init__(
        self, name: str, slave: PartitionBody, master: PartitionBody, patches: tuple[int, int], law: Any
    ) -> None:
        super().__init__()
        self.name, self.slave, self.master, self.patches, self.law = name, slave, master, patches, law
        self.restart()

    def restart(self, t: float = 0.0) -> None:
        """Forget the last run."""
        self.law.reset()
        self.reached_edge_at: float | None = None
        self._sampled_at = self._stepped_to = t
        self._impulse = np.zeros(len(self.law.rows))

    def before_step(self, mbs: Any, t: float) -> None:
        """Apply multipliers ahead of the step that ends at t, once.

        Verlet takes q += h v + h^2/2 a, v += h/2 (a + a'), so that v += h/2 c and a += c ahead of it make the velocity
        at mid-step v + h/2 a + h c: central differences (paper, eq. 29) with the contact's acceleration c.
        """
        if not self.explicit_only or t == self._stepped_to:
            return
        exu, data = require("exudyn"), mbs.systemData
        step = t - data.GetTime(exu.ConfigurationType.StartOfStep)
        slices = coordinate_slices(mbs, self.nodes)
        q_t, q_tt = data.GetODE2Coordinates_t(copy=False), data.GetODE2Coordinates_tt(copy=False)
        views = (data.GetODE2Coordinates(copy=False), q_t, q_tt)
        increment = self.law.increment(*[np.concatenate([view[s] for s in slices]) for view in views], step=step)
        if increment is not None:
            self._impulse += step * self.law.lam
            start = 0
            for s in slices:
                part = increment[start : start + s.stop - s.start]
                q_t[s] += 0.5 * step * part
                q_tt[s] += part
                start += len(part)
        self._stepped_to = t

    def sample(self, mbs: Any, t: float) -> list[float]:
        """Values of the sensor `sForce` at t."""
        if t < max(self._sampled_at, self._stepped_to):
            self.restart(t)
        self._sampled_at = t
        lam, index, rows = self.law.lam, self.law.problem.index, self.law.rows
        if self.reached_edge_at is None and index.size and rows.at_edge[index].any():
            self.reached_edge_at = t
        values = [lam.sum(), index.size, *(lam @ rows.normal)]
        if self.explicit_only:
            self._check_step(mbs, t)
            values += [self._impulse.sum(), *(self._impulse @ rows.normal)]
        return [float(value) for value in values]

    def _check_step(self, mbs: Any, t: float) -> None:
        """Refuse a run in which multipliers were not applied, or not by central differences."""
        if t > self._stepped_to:
            raise RunError(
                f"contact {self.name!r}: its multipliers were not applied in the step to t = {t:.6g} s, for its "
                "PreStep function was replaced. Set your own with SetPreStepUserFunction before "
                "CreatePartitionContact, or run the model by solve_dynamic"
            )
        coordinates = mbs.systemData.GetODE2Coordinates(copy=False)
        self.law.check_gaps(np.concatenate([coordinates[s] for s in coordinate_slices(mbs, self.nodes)]))

    @property
    def sides(self) -> list[tuple[PartitionBody, int]]:
        """Slave and master, each with the number of its patch."""
        return [(self.slave, self.patches[0]), (self.master, self.patches[1])]

    def rows_on(self, item: PartitionBody) -> sp.csr_matrix:
        """Gap rows of multipliers on the coordinates of one of the bodies, (nc, n_dofs)."""
        n = self.slave.body.n_dofs
        return self.law.G[:, :n] if item is self.slave else self.law.G[:, n:]

    @property
    def nodes(self) -> list[Any]:
        """Exudyn nodes of slave and master."""
        return self.slave.nodes + self.master.nodes

    def force(self, result: Result) -> Array:
        """Sum of the normal forces, (n,) [N], >= 0, at the times of `result`."""
        return self._sampled(result, slice(0, 1), slice(5, 6))[:, 0]

    def force_on_slave(self, result: Result) -> Array:
        """Resultant force on the slave, (n, 3) [N]; the master has its opposite. Curved patches spread the normals."""
        return self._sampled(result, slice(2, 5), slice(6, 9))

    def _sampled(self, result: Result, forces: slice, impulses: slice) -> Array:
        """Forces at the times of `result`; single multipliers jump, theirs come from the impulses between samples."""
        samples = result.sensor(self["sForce"])
        if not self.explicit_only or len(result.t) < 2:
            return samples[:, forces]
        impulse = samples[:, impulses]
        means = np.diff(impulse, axis=0, prepend=impulse[:1]) / np.diff(result.t, prepend=-1.0)[:, None]
        return at_times(result.t, means)

    def closed_rows(self, result: Result) -> Array:
        """Number of closed contact rows, (n,)."""
        return result.sensor(self["sForce"])[:, 1].astype(int)

    def energy(self, result: Result) -> Array:
        """Energy stored in the contact's own flexibility, (n,) [J]; multipliers store none."""
        if self.explicit_only:
            return np.zeros(len(result.t))
        q = np.hstack([self.slave.coordinates(result), self.master.coordinates(result)])
        return np.array([self.law.potential(x) for x in q])

    @property
    def explicit_only(self) -> bool:
        """Whether the contact runs in explicit solvers only."""
        return isinstance(self.law, LagrangeContact)

    def largest_slide(self, result: Result) -> tuple[float, float]:
        """Largest tangential displacement between the patches while closed [m], of some 50 samples, and when [s]."""
        closed = np.flatnonzero(self.force(result) > 0)
        if not len(closed):
            return 0.0, 0.0
        samples = closed[:: max(1, len(closed) // 50)]
        means = []
        for item, patch in self.sides:
            nodes = item.body.partition.patches[patch].nodes
            u = item.body.rows(nodes) @ item.coordinates(result)[samples].T
            means.append(u.reshape(len(nodes), 3, -1).mean(axis=0))
        line = self.law.rows.approach
        between = means[0] - means[1]
        slide = np.linalg.norm(between - np.outer(line, line @ between), axis=0)
        return float(slide.max()), float(result.t[samples[slide.argmax()]])

    @property
    def left_out(self) -> list[str]:
        """What the contact leaves out, in sentences."""
        unpaired = self.law.rows.unpaired
        said = ["tangential rows: the contact is frictionless"]
        if unpaired:
            said.append(f"{unpaired} nodes of {self.slave.name or 'the slave'} that face no facet of the master patch")
        return said


def CreatePartitionContact(
    mbs: Any,
    slave: PartitionBody,
    master: PartitionBody,
    *,
    formulation: str = "compliance",
    slavePatch: int | str | None = None,
    masterPatch: int | str | None = None,
    name: str = "",
) -> PartitionContact:
    """Add frictionless contact between the patches of two partition bodies.

    Each patch node of the slave faces the point of the master's facets that it meets along the line of contact
    (node-to-segment, paper section 3; `contact.rows.pair`). Pairs stay as they are found here.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    slave, master : PartitionBody
        Take the body with the finer or the curved patch as slave.
    formulation : {"compliance", "lagrange"}
        "compliance" for bases with a residual flexibility, explicit and implicit; "lagrange" for those whose patch has
        mass, the paper's and Craig-Bampton's, in Exudyn's explicit VelocityVerlet.
    slavePatch, masterPatch : int or str, optional
        Number or name of the contact patch, for bodies that have several.
    name : str

    Returns
    -------
    PartitionContact

    Raises
    ------
    EmptyRegionError, PenetrationError, InputError, IndefiniteMatrixError
    """
    bodies, contacts = partition_items(mbs)
    for role, item in (("slave", slave), ("master", master)):
        if not isinstance(item, PartitionBody):
            raise InputError(f"{role}: expected what CreatePartitionBody returns, got {type(item).__name__}")
        if not any(item is body for body in bodies):
            raise InputError(f"{role}: body {item.name!r} belongs to another model, or to this one before a Reset")
    if slave is master:
        raise InputError("slave, master: expected two bodies, got the same twice")
    validate_choice("formulation", formulation, ("compliance", "lagrange"))
    patches = (slave.body.partition.patch(slavePatch), master.body.partition.patch(masterPatch))
    surfaces = [item.body.surface(item.position, i) for item, i in zip((slave, master), patches, strict=True)]
    rows = pair(*surfaces)
    law_of = ComplianceContact if formulation == "compliance" else LagrangeContact
    law = law_of(rows, slave.body, master.body, patches)
    contact = PartitionContact(name, slave, master, patches, law)
    _check_shared_bodies(contact, contacts)
    items = require("exudyn.itemInterface")
    if formulation == "compliance":
        contact["oContact"] = _add_force_element(mbs, contact)
    else:
        _chain_before_step(mbs, contact)
    contact["sForce"] = mbs.AddSensor(
        items.SensorUserFunction(
            name=name, sensorUserFunction=lambda mbs, t, *unused: contact.sample(mbs, t), storeInternal=True
        )
    )
    mbs.sys[REGISTRY][1][int(contact["sForce"])] = contact
    return contact


def _check_shared_bodies(contact: PartitionContact, others: list[PartitionContact]) -> None:
    """Refuse or warn of contacts whose forces move another contact's patch beyond what each contact knows of it."""
    for other in others:
        for item, patch in contact.sides:
            for other_item, other_patch in other.sides:
                if item is not other_item or contact.explicit_only != other.explicit_only:
                    continue
                if contact.explicit_only:
                    _refuse_coupled_multipliers(contact, other, item)
                elif patch == other_patch:
                    raise InputError(
                        f"body {item.name!r}: its patch {patch} already has the contact {other.name!r}; each would "
                        "take its residual flexibility for itself. Make a patch for each contact (Partition.ball(...) "
                        "| Partition.ball(...)), or take basis='free' with formulation='lagrange'"
                    )
                else:
                    _warn_of_coupled_flexibility(item, patch, other_patch)


def _refuse_coupled_multipliers(contact: PartitionContact, other: PartitionContact, item: PartitionBody) -> None:
    """Multipliers of each contact close its own gaps; those of the other must not open them again."""
    inverse_mass = sp.diags(1 / item.body.mass.diagonal())
    G, others = (c.rows_on(item) for c in (contact, other))
    coupling = abs(G @ inverse_mass @ others.T).max()
    if coupling > 1e-9 * abs(G @ inverse_mass @ G.T).max():
        raise InputError(
            f"body {item.name!r}: multipliers of the contact {other.name!r} move the nodes of {contact.name!r}, as "
            f"basis {item.body.basis.name!r} couples them. Take basis='free', or formulation='compliance' with "
            "basis='contact-adapted' and a patch for each contact"
        )


def _warn_of_coupled_flexibility(item: PartitionBody, patch: int, other: int) -> None:
    own, others = (np.linalg.norm(item.body.flexibility(i), 2) for i in (patch, other))
    coupling = np.linalg.norm(item.body.flexibility(patch, other), 2) / np.sqrt(own * others)
    if coupling > _COUPLED:
        warnings.warn(
            f"body {item.name!r}: the residual flexibility couples its patches {patch} and {other} by {coupling:.1%}, "
            "which contacts on both neglect; forces on one may be off by about that share of the other's. A higher "
            "f_cut lowers it",
            ModelLimitWarning,
            stacklevel=4,
        )


def _add_force_element(mbs: Any, contact: PartitionContact) -> Any:
    """Massless object over the nodes of both bodies, with the contact's force and its Jacobian."""
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    law: ComplianceContact = contact.law

    def force(mbs: Any, t: float, i: Any, q: Any, q_t: Any) -> Array:
        return law.force(np.asarray(q))

    def jacobian(mbs: Any, t: float, i: Any, q: Any, q_t: Any, fODE2: float, fODE2_t: float) -> Any:
        law.force(np.asarray(q))
        return exu.MatrixContainer(sp.csr_matrix(fODE2 * law.tangent()))

    return mbs.AddObject(
        items.ObjectGenericODE2(
            name=contact.name,
            nodeNumbers=contact.nodes,
            forceUserFunction=force,
            jacobianUserFunction=jacobian,
            visualization=items.VObjectGenericODE2(show=False),
        )
    )


def _chain_before_step(mbs: Any, contact: PartitionContact) -> None:
    """Put the contact's work before each step in front of the model's own PreStep function."""
    own = mbs.GetPreStepUserFunction()
    own_function = own["function"] if isinstance(own, dict) else None

    def before_step(mbs: Any, t: float) -> bool:
        contact.before_step(mbs, t)
        return own_function is None or own_function(mbs, t)

    mbs.SetPreStepUserFunction(before_step)
