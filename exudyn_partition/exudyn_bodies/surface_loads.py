"""Exudyn adapter: uniform tractions on faces of a partition body, and distributed loads.

Theory: examples/site/theory.md, "Uniform tractions".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..fe.facets import nodal_area
from ..fe.model import FEModel
from ..fe.partition import load_named
from ..fe.patches import Interface
from ..frames.floating import FloatingKinematics
from ..frames.inertial import InertialKinematics
from ..reduction.body import ReducedBody
from ..support.arrays import Array, Vector
from ..support.checks import validate_callable, validate_flag, validate_number, validate_text, validate_vector
from ..support.foreign import (
    Coordinates,
    ItemIndex,
    LoadIndex,
    MainSystem,
    MarkerIndex,
    MatrixContainer,
    ObjectIndex,
    UserFunction,
)
from ..support.optional import require
from ..support.spelling import spelled
from .model import BodyItem, registered

_ASIDE = 1e-6  # distance of an interface's point from the mean of its face, by the body's size, that is round-off


def loaded_area(body: ReducedBody | FEModel, interface: Interface) -> float:
    """Area of an interface's face [m2], after a check that a force on the interface is a uniform traction on it.

    The force of an averaged interface is spread over its nodes by their areas, as finite elements spread a uniform
    traction; on quadrilaterals of 8 nodes by the areas of hats between the nodes, which have the same resultants on
    each facet. At the mean of the face it has no moment.

    Raises
    ------
    InputError
        If the interface is rigid, its nodes are not those of a face, or its point is not the mean of the face.
    """
    if interface.kind != "averaged":
        raise InputError(
            f"interface: {interface.name!r} is rigid, so that a traction would not bend its face; take "
            "kind='averaged' of Partition.interface"
        )
    spanned = body.facets[np.isin(body.facets, interface.nodes).all(axis=1)]
    area = nodal_area(body.points, spanned)
    total = float(area.sum())
    if not total or abs(area[interface.nodes] / total - interface.weights).max() > _ASIDE * interface.weights.max():
        raise InputError(f"interface: expected nodes that are those of a face, {interface.name!r} has others too")
    aside = np.linalg.norm(interface.weights @ body.points[interface.nodes] - interface.position)
    if aside > _ASIDE * np.ptp(body.points, axis=0).max():
        raise InputError(
            f"interface: the point of {interface.name!r} is {aside:.3g} m away from the mean of its face, where a "
            "uniform traction acts; leave out position= of Partition.interface"
        )
    return total


@runtime_checkable
class LoadedBody(BodyItem, Protocol):
    """A body in a model that a distributed load can act on: a PartitionBody."""

    kinematics: FloatingKinematics | InertialKinematics


@spelled
def CreateDistributedLoad(
    mbs: MainSystem,
    body: LoadedBody,
    load: str,
    magnitude: float,
    *,
    bodyFixed: bool = True,
    loadUserFunction: UserFunction | None = None,
    name: str = "",
) -> ObjectIndex:
    """Put a distributed load of `Partition.load` on a body: a pressure or traction [Pa], or a line load [N/m].

    The body's static answer to it is that of the FE mesh. It is an object without mass, because Exudyn's loads act at
    points; `solve_static` applies it in full from its first load step on.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    body : PartitionBody
    load : str
        Name of the load in the partition.
    magnitude : float
        Pressure or traction [Pa], or line load [N/m].
    bodyFixed : bool
        Whether the directions turn with the body, as those of a pressure do. Otherwise they stay as they are at the
        start.
    loadUserFunction : callable, optional
        Function f(mbs, t, magnitude) that returns the magnitude at time t.
    name : str

    Returns
    -------
    exudyn.ObjectIndex

    Raises
    ------
    InputError
        If an argument is wrong, there is no such load, or the body is not in this model.
    """
    if not isinstance(body, LoadedBody):
        raise InputError(f"body: expected what CreatePartitionBody returns, got {type(body).__name__}")
    if body not in registered(mbs).bodies.values():
        raise InputError(f"body: {body.name!r} belongs to another model, or to this one before a Reset")
    pattern, size = load_named(body.body.partition, load, "load"), validate_number("magnitude", magnitude)
    validate_flag("bodyFixed", bodyFixed)
    if loadUserFunction is not None:
        validate_callable("loadUserFunction", loadUserFunction, "f(mbs, t, magnitude), which returns the magnitude")
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    kinematics, n = body.kinematics.at(pattern.nodes), body.body.n_dofs
    start = np.zeros(n)
    at_start = kinematics.frame(start)[1]
    unit = kinematics.generalised(start, pattern.forces @ at_start.T)  # of a frame that does not turn

    def force(mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates) -> Array:
        present = size
        if loadUserFunction is not None:
            present = validate_number("loadUserFunction", loadUserFunction(mbs, t, size))
        if kinematics.linear:
            return present * unit
        now = np.asarray(q)
        axes = kinematics.frame(now)[1] if bodyFixed else at_start
        generalised = kinematics.generalised(now, present * (pattern.forces @ axes.T))
        if isinstance(kinematics, FloatingKinematics):
            return kinematics.on_constant_mass(now, generalised)
        return generalised

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        return exu.MatrixContainer(sp.csr_matrix((n, n)))  # that of its turning is small

    return mbs.AddObject(
        items.ObjectGenericODE2(
            name=validate_text("name", name),
            nodeNumbers=body.nodes,
            forceUserFunction=force,
            jacobianUserFunction=jacobian,
            visualization=items.VObjectGenericODE2(show=False),
        )
    )


def surface_load(
    area: float, loadVector: Vector, bodyFixed: bool, loadVectorUserFunction: UserFunction | None, name: str
) -> Callable[[MainSystem, MarkerIndex], LoadIndex]:
    """Return a function that adds the force of a traction [Pa] on an area [m2] at a marker."""
    traction = validate_vector("loadVector", loadVector)
    validate_flag("bodyFixed", bodyFixed)
    options: dict[str, UserFunction] = {}
    if loadVectorUserFunction is not None:
        traction_of = loadVectorUserFunction
        validate_callable(
            "loadVectorUserFunction", traction_of, "a function f(mbs, t, loadVector) that returns a traction"
        )

        def force(mbs: MainSystem, t: float, load: object) -> Array:
            value: Array = area * validate_vector("loadVectorUserFunction", traction_of(mbs, t, traction.tolist()))
            return value

        options["loadVectorUserFunction"] = force

    def add(mbs: MainSystem, marker: MarkerIndex) -> LoadIndex:
        items = require("exudyn.itemInterface")
        return mbs.AddLoad(
            items.LoadForceVector(
                name=name, markerNumber=marker, loadVector=area * traction, bodyFixed=bodyFixed, **options
            )
        )

    return add
