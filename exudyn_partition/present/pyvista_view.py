"""Bodies in PyVista, which is optional: `pip install "exudyn-partition[pictures]"`.

`plotter` puts the bodies of a run into a scene of PyVista, where a script can add to it, turn it and take pictures.
`turntable` writes a picture that turns, as a GIF. Neither needs a screen.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..errors import InputError
from ..exudyn_contacts.run_result import RunResult as Result
from ..fe.facets import flat_triangles
from ..support.checks import validate_array, validate_flag, validate_integer, validate_result
from ..support.files import replacing, writable
from ..support.foreign import Plotter
from ..support.optional import require
from .body_fields import Shown
from .film import add_sign, on_box, polydata
from .graphics import (
    COLOURS,
    WINDOW,
    ViewField,
    drawn_fields,
    fields_at,
    peak_time,
    pieces_of,
    places_of,
    rigid_shapes,
    time_of,
    title_of,
    validate_period,
    validate_pixels,
    validate_scale,
)
from .signs import signs_around

__all__ = ["plotter", "turntable"]

_GREY = "#9a9aa0"
_AMBIENT = 0.5  # brightness without light: shadows must not look like small values
_BAR = {
    "color": "black",
    "fill": True,
    "background_color": "white",
    "n_labels": 2,
    "fmt": "%.3g",
    "position_x": 0.32,
    "position_y": 0.89,
    "width": 0.62,
    "height": 0.09,
    "title_font_size": 16,
    "label_font_size": 14,
}
_MOST_FRAMES = 1000


def plotter(
    result: Result,
    time: float | None = None,
    bodies: Sequence[Shown] | None = None,
    *,
    field: ViewField = "deformation",
    scale: float = 1.0,
    limits: Sequence[float] | None = None,
    size: tuple[int, int] = WINDOW,
    signs: bool = True,
) -> Plotter:
    """Scene of PyVista with the bodies of a run, its rigid surfaces, a colour bar, and the time.

    Parameters
    ----------
    result : Result
    time, bodies, field, scale, limits :
        See `view.picture`.
    size : (int, int)
        Width and height in pixels.
    signs : bool
        Whether small signs show joints, springs, drives, loads, ground and gravity. Within bodies they shine through.

    Returns
    -------
    pyvista.Plotter
        Off screen: `screenshot("scene.png")` writes a picture.

    Raises
    ------
    InputError
        If an argument has a wrong type or is out of range, or the time is not within the run.
    MissingPackageError
        If PyVista is not installed.
    """
    validate_result(result)
    pixels, scale, signs = validate_pixels(size), validate_scale(scale), validate_flag("signs", signs)
    ends = None if limits is None else validate_array("limits", limits, (2,)).tolist()
    frame = result.at([peak_time(result) if time is None else time_of(result, time)])
    pieces = pieces_of(result.bodies, bodies, field)
    places, values = drawn_fields(pieces, fields_at(frame, pieces, lambda: 0), field, scale)
    if ends is None:
        ends = [min(float(v.min()) for v in values), max(float(v.max()) for v in values)]
    elif ends[0] >= ends[1]:
        raise InputError(f"limits: expected the lower and the upper end of the colours, got {ends[0]:g} to {ends[1]:g}")
    pyvista = require("pyvista")
    scene = pyvista.Plotter(off_screen=True, window_size=pixels)
    title, *said = title_of(field, scale)
    for piece, place, value in zip(pieces, places, values, strict=True):
        triangles = flat_triangles(piece.cells)[0]
        mesh = polydata(place, triangles)
        mesh.point_data[field] = value
        scene.add_mesh(
            mesh,
            scalars=field,
            cmap=COLOURS,
            clim=ends,
            name=piece.item.name or None,
            ambient=_AMBIENT,
            diffuse=1 - _AMBIENT,
            scalar_bar_args={"title": title, **_BAR},
        )
    surfaces = rigid_shapes(result, frame.t, places_of(pieces, places))
    for rigid in surfaces:
        scene.add_mesh(polydata(rigid.at(0), rigid.triangles), color=_GREY, show_scalar_bar=False)
    if signs:
        bodies_of_exudyn = [rigid.at(0) for rigid in surfaces if rigid.name]
        for sign in signs_around(result.others, frame.t, [*places, *bodies_of_exudyn]):
            add_sign(scene, sign)
    text = scene.add_text("\n".join([f"t = {frame.t[0]:.6g} s", *said]), font_size=10, color="black")
    on_box(text, scene.scalar_bar)
    scene.set_background("white")
    scene.add_axes(color="black")
    return scene


def turntable(
    path: str | Path,
    result: Result,
    time: float | None = None,
    bodies: Sequence[Shown] | None = None,
    *,
    field: ViewField = "deformation",
    scale: float = 1.0,
    limits: Sequence[float] | None = None,
    size: tuple[int, int] = (640, 480),
    frames: int = 48,
    period: float = 4.0,
) -> Path:
    """Write a GIF in which the bodies of a run turn once about the vertical axis of the view.

    Parameters
    ----------
    path : str or Path
    result : Result
    time, bodies, field, scale, limits, size :
        See `plotter`.
    frames : int
        Pictures of a turn.
    period : float
        Time of a turn on the screen [s]; 0.01 to 600 s a picture.

    Returns
    -------
    Path
        The written file.

    Raises
    ------
    InputError
        As `plotter`; or if the folder does not exist.
    MissingPackageError
    """
    path = writable(path)
    count = validate_integer("frames", frames, 2, _MOST_FRAMES)
    period = validate_period(period, count)
    scene = plotter(result, time, bodies, field=field, scale=scale, limits=limits, size=size)
    image = require("PIL.Image")  # which matplotlib needs too
    pictures = []
    try:
        for _ in range(count):
            pictures.append(image.fromarray(scene.screenshot(return_img=True)))
            scene.camera.azimuth += 360 / count
            scene.render()
    finally:
        scene.close()
    with replacing(path, "wb") as file:
        pictures[0].save(
            file, format="GIF", save_all=True, append_images=pictures[1:], duration=1e3 * period / count, loop=0
        )
    return path


def __dir__() -> list[str]:
    return __all__
