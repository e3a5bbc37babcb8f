"""Films of a run, drawn by PyVista off screen: bodies with their motion and deformation, the force beneath.

They need no screen: `pip install "exudyn-partition[pictures]"` brings PyVista, and ffmpeg for MP4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..exudyn_contacts.run_result import RunResult as Result
from ..support.arrays import Array
from ..support.checks import validate_array, validate_callable, validate_choice, validate_positive, validate_result
from ..support.files import filling, writable
from ..support.foreign import Actor, Plotter, PolyData
from ..support.optional import require
from ..support.progress import Progress, shown
from .body_fields import Shown
from .frame_times import slow_spans, time_digits
from .graphics import RigidShape, validate_period, validate_pixels, validate_scale
from .motion import COLOUR_NAMES, LABELS, BodyMotion, Colour, Motion, motion_of
from .plot_input import plain
from .scene import colour_map
from .signs import SignShape

_SIZE = (1280, 720)
_STRIP = 0.2  # height of the curve of forces, by that of the picture
_LEAST = 240, 240  # pixels of a picture that has room for a curve
_INCH = 100  # pixels
_QUALITY = 20  # constant rate factor of H.264: small numbers are better and larger
_GREY = "#9a9aa0"
_LIGHT = {"ambient": 0.45, "diffuse": 0.65, "specular": 0.15}
_BAR = {"color": "black", "fill": True, "background_color": "white", "n_labels": 2, "fmt": "%.3g", "position_x": 0.64,
        "position_y": 0.86, "width": 0.31, "height": 0.13}  # fmt: skip
_LETTERS = 45  # of these a picture is high
_MANY = 24  # pictures in a film, from which impacts get more
_SEEN_THROUGH = 0.2  # opacity of what hides a body
_SHINING, _IN_FRONT = 0.5, -66000.0  # opacity of signs within bodies, and units of depth before these
_OPACITY = 0.75  # of the white box behind texts
_NEAR = 0.25  # size of what is seen of a contact, by that of all bodies


def film(
    path: str | Path,
    result: Result,
    bodies: Sequence[Shown] | None = None,
    *,
    colour: Colour = "speed",
    end: float | None = None,
    frames: int | Sequence[float] | Array = 100,
    period: float = 0.04,
    scale: float | None = None,
    view: str = "all",
    direction: Sequence[float] = (1.0, -1.6, 0.8),
    size: tuple[int, int] = _SIZE,
    progress: Progress | None = None,
) -> Path:
    """Write a film of a run; see `Result.film`."""
    path = writable(path)
    validate_result(result)
    ending = validate_choice("path", path.suffix.lower(), _WRITERS)
    validate_choice("colour", colour, COLOUR_NAMES)
    pixels = [2 * (side // 2) for side in validate_pixels(size)]  # H.264 takes even numbers
    period = validate_period(period)
    if scale is not None:
        scale = validate_scale(scale)
    if end is not None:
        end = validate_positive("end", end)
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    towards = validate_array("direction", direction, (3,))
    if not towards.any():
        raise InputError("direction: expected where the viewer is, seen from the bodies, got zeros")
    if ending == ".mp4":
        require("imageio_ffmpeg")
    require("pyvista")
    with shown(progress, "film") as report:
        motion = motion_of(
            result,
            bodies,
            colours=[colour],
            frames=frames,
            more=_more(frames),
            progress=lambda share: report(share / 2),
        )
        focus, extent = _focus(motion, view)
        with filling(path.parent, last=path.name) as new:
            pictures = _pictures(
                motion, colour, end, scale, (focus, extent, towards), pixels,
                lambda share: report(0.5 + share / 2),
            )  # fmt: skip
            _WRITERS[ending](new / path.name, pictures, pixels, period)
    return path if ending != ".png" else path.with_name(f"{path.stem}_0000.png")


def _more(frames: object) -> int:
    """Most pictures at impacts beside those that are equally spaced; none in a film of few pictures."""
    return int(frames) // 2 if isinstance(frames, int | np.integer) and frames >= _MANY else 0


def _slow(motion: Motion) -> list[bool]:
    """Whether each frame is of an impact that has frames of its own, so that time goes more slowly."""
    usual = float(np.median(np.diff(motion.t))) if len(motion.t) > 1 else 0.0
    spans = slow_spans(motion.force_t, motion.forces.values(), usual)
    return [any(start <= t <= end for start, end in spans) for t in motion.t]


def _focus(motion: Motion, view: str) -> tuple[Array, float]:
    """Point to look at and size of what is seen [m], of "all", "contact" or a body's name."""
    low, high = motion.bounds
    names = {body.name: body for body in motion.bodies}
    validate_choice("view", view, ["all", *["contact"] * bool(motion.spots), *names])
    if view == "all":
        return (low + high) / 2, motion.size
    if view == "contact":
        return motion.spots[0].place, _NEAR * motion.size
    body: BodyMotion = names[view]
    every = np.vstack([body.at(frame) for frame in (0, len(motion.t) // 2, len(motion.t) - 1)])
    return (every.min(axis=0) + every.max(axis=0)) / 2, float(np.linalg.norm(np.ptp(every, axis=0)))


def _pictures(
    motion: Motion,
    colour: Colour,
    end: float | None,
    scale: float | None,
    camera: tuple[Array, float, Array],
    pixels: list[int],
    progress: Progress,
) -> Iterator[Array]:
    """Yield the frames, (height, width, 3) uint8."""
    pyvista = require("pyvista")
    width, height = pixels
    below = 2 * int(_STRIP * height / 2) if motion.forces and width >= _LEAST[0] and height >= _LEAST[1] else 0
    strip = _strip(motion, width, below) if below else None
    scene = pyvista.Plotter(off_screen=True, window_size=[width, height - below])
    scale = motion.visible_scale if scale is None else float(scale)
    label, unit, many = LABELS[colour]
    top = many * (motion.end_of(colour) if end is None else end)
    scene.set_background("white")
    focus, extent, towards = camera
    faded = motion.look_through(int(abs(motion.t - motion.peak).argmin()), towards)
    meshes = [
        _drawn(scene, body, colour, many, scale, top, _SEEN_THROUGH if look else 1.0)
        for body, look in zip(motion.bodies, faded[0], strict=True)
    ]
    letter = max(8, height // _LETTERS)
    bar = scene.add_scalar_bar(
        f"{label} [{unit}]", mapper=meshes[0][1].mapper, title_font_size=letter, label_font_size=letter, **_BAR
    )
    grey: list[tuple[RigidShape, PolyData]] = [
        (shape, polydata(shape.at(0), shape.triangles)) for shape in motion.rigid
    ]
    for (_, mesh), look in zip(grey, faded[1], strict=True):
        scene.add_mesh(mesh, color=_GREY, show_scalar_bar=False, opacity=_SEEN_THROUGH if look else 1.0)
    grey += [(sign, add_sign(scene, sign)) for sign in motion.signs]
    scene.enable_anti_aliasing("msaa")
    scene.camera_position = [focus + 2 * extent * towards / np.linalg.norm(towards), focus, (0, 0, 1)]
    scene.camera.view_angle = 2 * np.degrees(np.arctan(0.27))
    scene.reset_camera_clipping_range()
    text = scene.add_text("t", position="upper_left", font_size=max(5, letter // 2 + 3), color="black")
    on_box(text, bar)
    slow, digits = _slow(motion), time_digits(motion.t, 1e3)
    said = "" if scale == 1 else f"\ndeformed x {scale:g}: bodies may seem to overlap"
    try:
        for frame, t in enumerate(motion.t):
            for body, (mesh, _) in zip(motion.bodies, meshes, strict=True):
                mesh.points = body.at(frame, scale)
                mesh.point_data[colour] = many * body.colours[colour][frame]
            for shape, mesh in grey:
                mesh.points = shape.at(frame)
            text.set_text("upper_left", f"t = {1e3 * t:.{digits}f} ms{' (slow motion)' if slow[frame] else ''}{said}")
            scene.render()  # a screenshot alone would show the frame before
            picture = np.asarray(scene.screenshot(return_img=True))[..., :3]
            yield picture if strip is None else np.vstack([picture, strip.at(float(t))])
            progress((frame + 1) / len(motion.t))
    finally:
        scene.close()


def on_box(text: Actor, bar: Actor) -> None:
    """Put a text and a bar of colours, whose background is filled, on boxes, so that they can be read before bodies."""
    text.prop.background_color, text.prop.background_opacity = "white", _OPACITY
    bar.GetBackgroundProperty().SetOpacity(_OPACITY)


def add_sign(scene: Plotter, sign: SignShape) -> PolyData:
    """Add a sign to a scene; what bodies hide of it shines through. Return its surface."""
    mesh = polydata(sign.at(0), sign.triangles)
    name, look = f"sign {id(mesh)}", {"color": sign.colour, "show_scalar_bar": False, **_LIGHT}
    scene.add_mesh(mesh, name=name, **look)
    shining = scene.add_mesh(mesh, name=f"{name}, shining", opacity=_SHINING, **look)
    shining.mapper.SetResolveCoincidentTopologyToPolygonOffset()
    shining.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, _IN_FRONT)
    return mesh


def _drawn(
    scene: Plotter, body: BodyMotion, colour: Colour, many: float, scale: float, top: float, opacity: float
) -> tuple[PolyData, Actor]:
    """Surface of a body in the scene, and what draws it."""
    mesh = polydata(body.at(0, scale), body.triangles)
    mesh.point_data[colour] = many * body.colours[colour][0]
    actor = scene.add_mesh(
        mesh, scalars=colour, cmap=colour_map(), clim=[0, top], show_scalar_bar=False, smooth_shading=True,
        split_sharp_edges=False, opacity=opacity, **_LIGHT,
    )  # fmt: skip
    return mesh, actor


class _Strip(NamedTuple):
    """Picture of the forces over time, the columns of its first and last time [s], and the rows of its curves."""

    picture: Array
    columns: tuple[float, float]
    rows: tuple[int, int]
    times: tuple[float, float]

    def at(self, t: float) -> Array:
        """The picture with a mark at a time [s]."""
        column = round(float(np.interp(t, self.times, self.columns)))
        picture = self.picture.copy()
        picture[slice(*self.rows), max(0, column - 1) : column + 1] = (200, 60, 40)
        return picture


def _strip(motion: Motion, width: int, height: int) -> _Strip:
    """Draw the curve of the forces."""
    figure = require("matplotlib.figure").Figure(figsize=(width / _INCH, height / _INCH), dpi=_INCH)
    canvas = require("matplotlib.backends.backend_agg").FigureCanvasAgg(figure)
    left, below, above = 66 / width, 22 / height, 20 / height  # room for numbers and names of the axes
    axes = figure.add_axes((left, below, 1 - left - 20 / width, max(0.1, 1 - below - above)))
    for name, force in motion.forces.items():
        axes.plot(1e3 * motion.force_t, force, linewidth=1.4, label=plain(name))
    if motion.force_t[-1] > motion.force_t[0]:  # one instant, as of result.at(3), has no curve
        axes.set_xlim(1e3 * motion.force_t[0], 1e3 * motion.force_t[-1])
    axes.margins(y=0.1)  # the largest force stays off the frame
    axes.set_title("contact force [N] over t [ms]", fontsize=8, loc="left", pad=3)
    axes.tick_params(labelsize=8)
    if len(motion.forces) > 1:
        axes.legend(fontsize=7, loc="upper right")
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())[..., :3].copy()
    times = float(motion.force_t[0]), float(motion.force_t[-1])
    first, last = (float(axes.transData.transform((1e3 * t, 0.0))[0]) for t in times)
    frame = axes.get_window_extent()
    return _Strip(picture, (first, last), (height - int(frame.y1), height - int(frame.y0)), times)


def _write_mp4(path: Path, pictures: Iterator[Array], pixels: list[int], period: float) -> None:
    writer = require("imageio_ffmpeg").write_frames(
        str(path), tuple(pixels), fps=1 / period, codec="libx264", quality=None, macro_block_size=2,
        output_params=["-crf", str(_QUALITY), "-movflags", "+faststart"],
    )  # fmt: skip
    writer.send(None)
    try:
        for picture in pictures:
            writer.send(np.ascontiguousarray(picture))
    finally:
        writer.close()


def _write_gif(path: Path, pictures: Iterator[Array], pixels: list[int], period: float) -> None:
    image = require("PIL.Image")  # which matplotlib needs too
    first, *others = [image.fromarray(picture) for picture in pictures]
    first.save(path, format="GIF", save_all=True, append_images=others, duration=1e3 * period, loop=0)


def _write_pngs(path: Path, pictures: Iterator[Array], pixels: list[int], period: float) -> None:
    image = require("PIL.Image")
    for number, picture in enumerate(pictures):
        image.fromarray(picture).save(path.with_name(f"{path.stem}_{number:04d}.png"))


_WRITERS = {".mp4": _write_mp4, ".gif": _write_gif, ".png": _write_pngs}


def polydata(points: object, triangles: object) -> PolyData:
    """PyVista's surface of triangles, (m, 3) int, between points, (n, 3) [m]."""
    corners = np.asarray(triangles)
    faces = np.column_stack([np.full(len(corners), 3), corners])
    return require("pyvista").PolyData(np.asarray(points, dtype=float), faces.ravel())
