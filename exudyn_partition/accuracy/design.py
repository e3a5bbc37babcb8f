"""From two shapes to bodies whose total error in their impact is below a tolerance: `design_impact`.

A first look with a coarse mesh gives the force, and with it the size of the contact, the frequencies, and a truncation
that keeps a part of the tolerance. Rules (`mesh_rules`) turn these into meshes. The bodies are reduced, and the error
of their meshes is estimated (`mesh_error`). What makes the largest error is refined, until the sum is below the
tolerance over 1.25.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..contact.rigid import RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from ..errors import InputError, ToleranceWarning
from ..fe.material import Material
from ..meshing.netgen_mesh import shape_of
from ..support.arrays import Vector
from ..support.checks import (
    validate_callable,
    validate_flag,
    validate_integer,
    validate_number,
    validate_positive,
    validate_vector,
)
from ..support.foreign import Shape
from ..support.progress import Progress, shown
from ..support.spelling import spelled
from ..support.warn import warn
from .contact_place import contact_place
from .correction import LEFT
from .design_search import Search
from .impact_design import ImpactDesign
from .impact_scene import Scene, first_circle

_TOLERANCES = (2e-3, 0.2)
_MOST_DOFS = 250_000
_FASTEST = 1e4  # m/s

Body = tuple[Shape | str | Path, Material]


@spelled
def design_impact(
    first: Body,
    second: Body | RigidSurface,
    *,
    speed: float,
    contact: Vector,
    tolerance: float = 1e-2,
    duration: float | None = None,
    scale: float = 1.0,
    max_dofs: int = _MOST_DOFS,
    correct: bool = False,
    progress: Progress | None = None,
) -> ImpactDesign:
    """Mesh and reduce two bodies, or one, such that the total error of their impact is below a tolerance.

    The total error is that of the meshes, of the truncation and of the step, against the elastic bodies themselves. It
    is estimated and no bound: see `ImpactDesign`.

    Parameters
    ----------
    first : (shape or path, Material)
        An OCC shape or the path of a STEP file, placed as at the impact.
    second : (shape or path, Material), RigidPlane, RigidSphere or RigidCylinder
        It touches the first body, or nearly so.
    speed : float
        Approach speed along the normal of the contact [m/s].
    contact : (3,) array
        Where they touch, after scaling [m]. Both surfaces are smooth there and touch at a point.
    tolerance : float
        Of the contact force and of the velocities of whole bodies: relative error in the L2 norm over `duration`;
        0.002 to 0.2. Velocities of single points may be worse; `ImpactDesign.look` has an estimate of these.
    duration : float, optional
        [s]; default: 30 crossings of a longitudinal wave through the larger body.
    scale : float
        Factor on the lengths of both shapes; Netgen reads STEP files in millimetres: give 1e-3.
    max_dofs : int
        Most dofs of both FE models together.
    correct : bool
        Give the bodies what functions of one order more change of them, as `with_mesh_error` does. Coarser meshes are
        then enough. The estimate counts half of the error that these functions show, and all of that of the rows.
    progress : callable, optional
        As for `reduce`.

    Returns
    -------
    ImpactDesign
        FE models, bodies, step, and what was chosen and why.

    Raises
    ------
    InputError
        If an argument is out of range; or a material has hardening; or the point lies on an edge; or the bodies touch
        along a line or an area.
    EmptyRegionError
        If a body is not near the point of contact, or they do not face each other there.
    MeshError, MemoryLimitError, MissingPackageError

    Warns
    -----
    ToleranceWarning
        If the tolerance is not reached within `max_dofs`, the free memory or six meshes, or a finer mesh fails; the
        best design is returned.
    """
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    validate_flag("correct", correct)
    scene, duration = _scene(first, second, speed, contact, tolerance, duration, scale, max_dofs)
    if correct:
        scene = replace(scene, left=LEFT)
    with shown(progress, "design an impact") as report:
        design = Search(scene, duration).run(report)
    if design.limit:
        warn(
            f"tolerance: {tolerance:.3g} cannot be promised; the best design has an estimated error of "
            f"{design.error:.3g}. What limits it is {design.limit}",
            ToleranceWarning,
        )
    return design


def _scene(
    first: Body,
    second: Body | RigidSurface,
    speed: float,
    contact: Vector,
    tolerance: float,
    duration: float | None,
    scale: float,
    max_dofs: int,
) -> tuple[Scene, float | None]:
    """Check the arguments, and find the place of contact."""
    rigid = second if isinstance(second, (RigidPlane, RigidSphere, RigidCylinder)) else None
    named = [("first", first)] if rigid is not None else [("first", first), ("second", second)]
    also = ", or a RigidPlane, RigidSphere or RigidCylinder"
    for name, body in named:
        if not isinstance(body, tuple | list) or len(body) != 2 or not isinstance(body[1], Material):
            raise InputError(
                f"{name}: expected (shape or path of a STEP file, ep.Material){also if name == 'second' else ''}, got "
                f"{type(body).__name__}"
            )
        if body[1].plastic:
            raise InputError(
                f"{name}: its material has hardening=, and the estimates are those of elastic bodies. Design with an "
                "elastic material; then make partitions with plastic_radius, and reduce to the f_cut that was found"
            )
    speed = validate_positive("speed", speed, "m/s")
    if not 1 / _FASTEST <= speed <= _FASTEST:
        raise InputError(f"speed: expected {1 / _FASTEST:g} to {_FASTEST:g} m/s, got {speed!r}")
    low, high = _TOLERANCES
    tolerance = validate_number("tolerance", tolerance)
    if not low <= tolerance <= high:
        raise InputError(
            f"tolerance: expected {low:g} to {high:g}, got {tolerance!r}. Below, rounding of meshes and rows decides; "
            "above, meshes are too coarse for an estimate"
        )
    point, scale = validate_vector("contact", contact), validate_positive("scale", scale)
    max_dofs = validate_integer("max_dofs", max_dofs, 1000)
    duration = None if duration is None else validate_positive("duration", duration, "s")
    shapes = tuple(shape_of(body[0], scale, name) for name, body in named)  # type: ignore[index]
    materials = tuple(body[1] for _, body in named)  # type: ignore[index]
    place = contact_place(shapes, rigid, point, lambda radius: first_circle(shapes, materials, speed, radius))
    return Scene(shapes, materials, rigid, place, speed, tolerance, max_dofs), duration
