"""Bodies whose estimate tells the error of their meshes too."""

from __future__ import annotations

from dataclasses import replace

from ..algebra.blas_threads import one_blas_thread
from ..contact.rigid import RigidSurface
from ..errors import InputError, ToleranceWarning
from ..reduction.body import ReducedBody
from ..support.checks import validate_flag
from ..support.warn import warn
from .mesh_error import judged
from .modal_pair import Pair


def with_mesh_error(
    slave: Pair,
    master: Pair | RigidSurface,
    *,
    speed: float | None = None,
    duration: float | None = None,
    patches: tuple[int | str | None, int | str | None] = (None, None),
    correct: bool = False,
) -> tuple[ReducedBody, ...]:
    """Add the error of the meshes to the estimate of bodies that were reduced to a tolerance.

    `body.estimate` then tells the errors of truncation and step (`force`, `velocity`), of the step (`step`), of the
    meshes (`mesh_force`, `mesh_velocity`) and of all together (`total`). Its `limit` names the mesh if that is what
    keeps the total above the tolerance.

    Parameters
    ----------
    slave : (FEModel, ReducedBody)
    master : (FEModel, ReducedBody), RigidPlane, RigidSphere or RigidCylinder
    duration, patches :
        As for `mesh_error`.
    speed : float, optional
        Approach speed along the line of contact [m/s]; default: that of the slave's estimate.
    correct : bool
        Also give the bodies what functions of one order more change of them: of frequencies and shapes, and of the
        flexibility of the patches that meet (`correction`). Their error becomes smaller than what the estimate says,
        which stays that of the meshes, if elements at the contact are at most 0.7 contact radii long
        (`validation/mesh/correct.py`). That of the contact's rows stays as it is.

    Returns
    -------
    tuple of ReducedBody
        The slave, and the master if it is a body.

    Raises
    ------
    InputError
        If a body was not reduced to a tolerance; or one is to be corrected and has a plastic zone; or as `mesh_error`.
    MeshError, EmptyRegionError, PenetrationError, MemoryLimitError, MissingPackageError

    Warns
    -----
    ToleranceWarning
        If the total error is above the tolerance of the reduction; or as `mesh_error`.

    Notes
    -----
    It is no part of `reduce`, because it takes about as long: `validation/mesh/effectivity.py`.
    """
    if speed is None:
        body = slave[1] if isinstance(slave, tuple | list) and len(slave) == 2 else None
        if not isinstance(body, ReducedBody) or body.estimate is None:
            raise InputError("speed: expected one [m/s], because the slave was not reduced to a tolerance")
        speed = body.estimate.speed
    validate_flag("correct", correct)
    mesh_error, finers, numbers = judged(slave, master, speed=speed, duration=duration, patches=patches)
    result = []
    for finer, number in zip(finers, numbers, strict=True):
        body = finer.body
        if body.estimate is None:
            raise InputError("estimate: a body has none, because it was not reduced to a tolerance; reduce it so")
        limit = replace(mesh_error, truncation=body.estimate).limit
        estimate = replace(mesh_error.added_to(body.estimate), limit=limit or body.estimate.limit)
        if correct:
            with one_blas_thread():
                body = finer.corrected(number)
        result.append(replace(body, estimate=estimate))
    worst = max((body.estimate for body in result if body.estimate is not None), key=lambda estimate: estimate.total)
    if worst.total > worst.tolerance:
        warn(
            f"tolerance: {worst.tolerance:.3g} cannot be promised; the estimated total error is {worst.total:.3g}, of "
            f"which the meshes make {mesh_error.error:.3g}. What limits it is {worst.limit}",
            ToleranceWarning,
        )
    return tuple(result)
