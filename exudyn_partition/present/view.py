"""Bodies in Exudyn's own renderer: their deforming surfaces, coloured by a field.

`CreatePartitionView` adds an ObjectGround to a model. It has no coordinates, so the equations of motion do not change.
Its graphicsDataUserFunction draws triangles whenever Exudyn renders: during the run, or in `mbs.SolutionViewer()`.
`picture` and `show` draw a finished run in a scene of their own. Rigid surfaces of contacts that are fixed in space are
drawn in grey, as far as the bodies extend; so are those that a body carries, and Exudyn's own bodies.

The tests check the data to be drawn, and raytraced pictures; neither needs a screen. Exudyn's OpenGL window was tried
under a virtual display (Xvfb), but not on a real screen.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import InputError, RunError
from ..exudyn_bodies.model import coordinate_slices, validate_model
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..exudyn_contacts.run_result import RunResult as Result
from ..fe.facets import flat_triangles
from ..support.arrays import Array, Vector
from ..support.checks import (
    validate_array,
    validate_choice,
    validate_flag,
    validate_integer,
    validate_positive,
    validate_result,
    validate_vector,
)
from ..support.foreign import ItemIndex, MainSystem, ObjectIndex, SystemContainer
from ..support.optional import require
from .body_fields import BodyFields, Shown
from .graphics import (
    COLOURS,
    UNITS,
    WINDOW,
    GraphicsData,
    Pose,
    ViewField,
    colour_bar,
    drawn_fields,
    fields_at,
    grey,
    peak_time,
    pieces_of,
    places_of,
    rigid_shapes,
    rigid_surfaces,
    time_of,
    title_of,
    validate_pixels,
    validate_scale,
)
from .signs import SignShape, signs_around

__all__ = ["CreatePartitionView", "picture", "show"]

Fields = Callable[[MainSystem, BodyFields], dict[str, Array]]  # returns the present fields
Rigid = Callable[[MainSystem, list[Array]], list[GraphicsData]]  # returns rigid surfaces, for places of the pieces

_AMBIENT = 0.8  # brightness without light: shadows must not look like small values
_MARGIN = 0.6  # half of a picture's height, relative to the diagonal of the bodies


def CreatePartitionView(
    mbs: MainSystem,
    bodies: Sequence[PartitionBody] | None = None,
    *,
    field: ViewField = "deformation",
    scale: float = 1.0,
    limits: Sequence[float] | None = None,
) -> ObjectIndex:
    """Show the surfaces of partition bodies in the renderer of a model.

    Call it before `mbs.Assemble()`. It costs nothing while nothing is rendered. After a run, `mbs.SolutionViewer()`
    shows the surfaces if Exudyn wrote its solution file (`settings.solution.file.write`).

    Parameters
    ----------
    mbs : exudyn.MainSystem
    bodies : sequence of PartitionBody, optional
        Default: all that the model holds now.
    field : {"deformation", "displacement", "velocity"}
        Its magnitude [m], [m/s] is the colour. Stresses need the static answer to contact forces: see `picture`, `show`
        and `output.write_paraview`.
    scale : float
        Factor on the drawn deformation; rigid motion is not scaled.
    limits : (2,), optional
        Values at the ends of the colour scale. Default: least and largest value of each frame.

    Returns
    -------
    exudyn.ObjectIndex
        Number of the ObjectGround.

    Raises
    ------
    InputError
        If there is no body, or an option is out of range.
    """
    validate_model(mbs)
    validate_choice("field", field, [name for name in UNITS if name != "von_mises"])
    configuration = require("exudyn").ConfigurationType.Visualization
    held = partition_items(mbs)[0]
    pieces = pieces_of(held, bodies, field)
    for piece in pieces:
        if piece.item not in held:
            raise InputError(
                f"bodies: body {piece.item.name!r} belongs to another model, or to this one before a Reset"
            )

    def fields(mbs: MainSystem, piece: BodyFields) -> dict[str, Array]:
        data, slices = mbs.systemData, coordinate_slices(mbs, piece.item)
        q, q_t = (
            np.concatenate([np.asarray(get(configuration))[s] for s in slices])
            for get in (data.GetODE2Coordinates, data.GetODE2Coordinates_t)
        )
        return {name: values[0] for name, values in piece.fields(q[None], q_t[None]).items()}

    for piece in pieces:
        if "oFFRFreducedOrder" in piece.item:  # which would be drawn over it
            mbs.SetObjectParameter(piece.item["oFFRFreducedOrder"], "Vshow", False)

    def rigid(mbs: MainSystem, places: list[Array]) -> list[GraphicsData]:
        def pose(contact: PartitionContact) -> Pose | None:
            return None if contact.carrier is None else contact.carrier.drawn_pose(mbs)

        return rigid_surfaces(partition_items(mbs)[1], np.vstack(places), pose)

    return _add(mbs, pieces, fields, field, scale, limits, rigid)


def picture(
    result: Result,
    time: float | None = None,
    bodies: Sequence[Shown] | None = None,
    *,
    field: ViewField = "deformation",
    scale: float = 1.0,
    limits: Sequence[float] | None = None,
    rotation: Vector = (-1.2, 0.0, 0.3),
    size: tuple[int, int] = WINDOW,
    signs: bool = True,
) -> Array:
    """Picture of a run's bodies by Exudyn's software raytracer, which needs no screen.

    Parameters
    ----------
    result : Result
    time : float, optional
        The nearest sample is drawn [s]. Default: that of the largest contact force; without contacts the last one.
    bodies : sequence of PartitionBody or (PartitionBody, FEModel), optional
        Default: all of the run. A body with its FE model also shows the static answer to the contacts' forces.
    field : {"deformation", "displacement", "velocity", "von_mises"}
        Its magnitude [m], [m/s] is the colour, or von Mises's stress [Pa], which needs the FE models.
    scale, limits :
        See `CreatePartitionView`.
    rotation : (3,)
        Rotation vector of the view [rad].
    size : (int, int)
        Width and height in pixels.
    signs : bool
        Whether small signs show joints, springs, drives, loads, ground and gravity, before the bodies.

    Returns
    -------
    (height, width, 3) uint8 array

    Raises
    ------
    InputError
        If an argument has a wrong type or is out of range, or the time is not within the run.
    """
    validate_result(result)
    frame = result.at([peak_time(result) if time is None else time_of(result, time)])
    turn = Rotation.from_rotvec(validate_vector("rotation", rotation).tolist())
    pixels, signs = validate_pixels(size), validate_flag("signs", signs)
    SC, mbs = _scene(frame, lambda: 0, bodies, field, scale, limits, turn)
    general, view = SC.visualizationSettings.general, SC.visualizationSettings.view0
    view.window.renderWindowSize = pixels
    general.renderWindowString = f"t = {frame.t[0]:.6g} s"
    general.showSolverInformation = general.showSolverTime = view.window.showComputationInfo = False
    light = SC.visualizationSettings.openGL
    light.lightModelAmbient = [_AMBIENT] * 3 + [1.0]
    light.light0.useCameraFrame = True
    SC.renderer.ZoomAll()  # otherwise the first drawing would change the view
    points = SC.renderer.GetGraphicsData()["triangles"]["points"].reshape(-1, 3)
    shapes = signs_around(frame.others, frame.t, [points]) if signs else []
    seen = turn.apply(
        np.vstack([points, *(sign.at(0) for sign in shapes)])
    )  # the renderer rotates before it translates
    low, high = seen.min(axis=0), seen.max(axis=0)
    height, centre = _MARGIN * float(np.linalg.norm(high - low)), (low + high) / 2
    SC.renderer.SetModelView(height, turn.as_rotvec().tolist(), centre.tolist())
    _add_signs(mbs, shapes, 2 * height * turn.inv().apply([0.0, 0.0, 1.0]))
    return np.array(SC.renderer.RedrawAndGetImage(useRaytracer=True))


def show(
    result: Result,
    bodies: Sequence[Shown] | None = None,
    *,
    field: ViewField = "deformation",
    scale: float = 1.0,
    limits: Sequence[float] | None = None,
    times: Sequence[float] | Array | int = 200,
    period: float = 0.04,
    cycles: int | None = None,
) -> None:
    """Show a run's bodies as a film in Exudyn's renderer, until its window is closed.

    Parameters
    ----------
    result : Result
    bodies, field, scale, limits :
        See `picture`.
    times : (k,) [s] or int
        See `Result.at`.
    period : float
        Time between frames on the screen [s].
    cycles : int, optional
        How often the film runs. Default: until the window is closed.

    Raises
    ------
    InputError
        If an argument has a wrong type or is out of range.
    RunError
        If there is no screen.
    """
    validate_result(result)
    frames, now = result.at(times), 0
    period = validate_positive("period", period, "s")
    if cycles is not None:
        cycles = validate_integer("cycles", cycles, 1)
    SC, mbs = _scene(frames, lambda: now, bodies, field, scale, limits)
    _check_screen()
    try:
        started, said = SC.renderer.Start(), ""
    except Exception as error:  # Exudyn has types of its own
        started, said = False, f": {error}"
    if not started:
        raise RunError(f"show: Exudyn could not open a window{said}; ep.view.picture draws without one")
    SC.renderer.ZoomAll()
    shown = 0
    while SC.renderer.IsActive() and (cycles is None or shown < cycles * len(frames.t)):
        now = shown % len(frames.t)
        SC.visualizationSettings.general.renderWindowString = f"t = {frames.t[now]:.6g} s"
        mbs.SendRedrawSignal()
        SC.renderer.DoIdleTasks(period, False)
        shown += 1
    SC.renderer.Stop()


def _add_signs(mbs: MainSystem, signs: Sequence[SignShape], nearer: Array) -> None:
    """Add signs to a model that was assembled, moved towards the viewer, (3,) [m], so that no body hides them."""
    if not signs:
        return
    drawn = [
        {
            "type": "TriangleList",
            "points": sign.at(0) + nearer,
            "colors": np.tile([*sign.rgb, 1.0], (len(sign.points), 1)),
            "triangles": sign.triangles,
        }
        for sign in signs
    ]
    items = require("exudyn.itemInterface")
    mbs.AddObject(items.ObjectGround(visualization=items.VObjectGround(graphicsData=drawn)))
    mbs.Assemble()
    mbs.SendRedrawSignal()


def _check_screen() -> None:
    """Raise where Exudyn would find no screen of X11: it would end the whole process, then or when Python ends."""
    if not sys.platform.startswith("linux"):
        return
    screen, instead = os.environ.get("DISPLAY"), "ep.view.picture draws without one"
    if not screen:
        raise RunError(f"show: there is no screen, DISPLAY is not set; {instead}")
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError as error:
        raise RunError(f"show: X11 is not installed ({error}); {instead}") from error
    x11.XOpenDisplay.restype, x11.XCloseDisplay.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
    opened = x11.XOpenDisplay(None)
    if not opened:
        raise RunError(f"show: there is no screen {screen!r}, which DISPLAY names; {instead}")
    x11.XCloseDisplay(opened)


def _scene(
    result: Result,
    now: Callable[[], int],
    bodies: Sequence[Shown] | None,
    field: ViewField,
    scale: float,
    limits: Sequence[float] | None,
    turn: Rotation | None = None,
) -> tuple[SystemContainer, MainSystem]:
    """System container and model with only the bodies, drawn at the sample whose number `now` returns."""
    SC = require("exudyn").SystemContainer()
    mbs = SC.AddSystem()
    pieces = pieces_of(result.bodies, bodies, field)
    at_sample = fields_at(result, pieces, now)

    def fields(mbs: MainSystem, piece: BodyFields) -> dict[str, Array]:
        return at_sample(piece)

    def rigid(mbs: MainSystem, places: list[Array]) -> list[GraphicsData]:
        shapes = rigid_shapes(result, result.t[[now()]], places_of(pieces, places))
        return [grey(shape.at(0), shape.triangles) for shape in shapes]

    _add(mbs, pieces, fields, field, scale, limits, rigid, turn)
    mbs.Assemble()
    return SC, mbs


def _add(
    mbs: MainSystem,
    pieces: list[BodyFields],
    fields: Fields,
    field: ViewField,
    scale: float,
    limits: Sequence[float] | None,
    rigid: Rigid,
    turn: Rotation | None = None,
) -> ObjectIndex:
    """Add the object that draws bodies and rigid surfaces of contacts; `turn` is the rotation of the view."""
    items, scale = require("exudyn.itemInterface"), validate_scale(scale)
    given = None if limits is None else validate_array("limits", limits, (2,))
    if given is not None and given[0] >= given[1]:
        raise InputError(
            f"limits: expected the lower and the upper end of the colours, got {given[0]:g} to {given[1]:g}"
        )

    def draw(mbs: MainSystem, item: ItemIndex) -> list[GraphicsData]:
        turned = turn or Rotation.identity()
        return _graphics(pieces, partial(fields, mbs), field, scale, given, turned, partial(rigid, mbs))

    return mbs.AddObject(items.ObjectGround(visualization=items.VObjectGround(graphicsDataUserFunction=draw)))


def _graphics(
    pieces: list[BodyFields],
    fields: Callable[[BodyFields], dict[str, Array]],
    field: ViewField,
    scale: float,
    limits: Array | None,
    turn: Rotation,
    rigid: Callable[[list[Array]], list[GraphicsData]],
) -> list[GraphicsData]:
    """Exudyn's graphics data of the deformed surfaces, of rigid surfaces, and of the scale of the colours."""
    places, values = drawn_fields(pieces, fields, field, scale)
    least, largest = (
        (min(v.min() for v in values), max(v.max() for v in values)) if limits is None else map(float, limits)
    )
    colours = require("matplotlib").colormaps[COLOURS]
    drawn: list[GraphicsData] = []
    for piece, place, value in zip(pieces, places, values, strict=True):
        share = (value - least) / (largest - least) if largest > least else np.zeros(len(value))
        triangles = flat_triangles(piece.cells)[0]
        drawn.append({"type": "TriangleList", "points": place, "colors": colours(share), "triangles": triangles})
    surfaces = rigid(places)
    seen = np.vstack([*places, *(np.asarray(surface["points"]) for surface in surfaces)])
    ends = f"{least:.3g}", f"{largest:.3g}"
    return [*drawn, *surfaces, *colour_bar(seen, turn, colours, title_of(field, scale), ends)]


def __dir__() -> list[str]:
    return __all__
