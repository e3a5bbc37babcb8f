"""Exudyn adapter: uniform tractions on faces of a partition body.

Theory: examples/site/theory.md, "Uniform tractions".
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import InputError
from ..fe.facets import nodal_area
from ..fe.model import FEModel
from ..fe.patches import Interface
from ..reduction.body import ReducedBody
from ..support.arrays import Array, Vector
from ..support.checks import validate_callable, validate_flag, validate_vector
from ..support.foreign import LoadIndex, MainSystem, MarkerIndex, UserFunction
from ..support.optional import require

_ASIDE = 1e-6  # distance of an interface's point from the mean of its face, by the body's size, that is round-off


def loaded_area(body: ReducedBody | FEModel, interface: Interface) -> float:
    """Area of an interface's face [m2], after a check that a force on the interface is a uniform traction on it.

    The force of an averaged interface is spread over its nodes by their areas, as finite elements spread a uniform
    traction. At the mean of the face it has no moment.

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


def surface_load(
    area: float, loadVector: Vector, bodyFixed: bool, loadVectorUserFunction: UserFunction | None, name: str
) -> Callable[[MainSystem, MarkerIndex], LoadIndex]:
    """Return a function that adds the force of a traction [Pa] on an area [m2] at a marker."""
    traction = validate_vector("loadVector", loadVector)
    validate_flag("bodyFixed", bodyFixed)
    options: dict[str, UserFunction] = {}
    if loadVectorUserFunction is not None:
        own = loadVectorUserFunction
        validate_callable("loadVectorUserFunction", own, "a function f(mbs, t, loadVector) that returns a traction")

        def force(mbs: MainSystem, t: float, load: object) -> Array:
            value: Array = area * np.asarray(own(mbs, t, traction.tolist()), dtype=float)
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
