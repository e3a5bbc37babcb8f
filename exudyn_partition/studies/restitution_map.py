"""Restitution over speed, angle, place and friction: a study of free impacts."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, ModelLimitWarning
from ..support.arrays import Array, Vector
from ..support.checks import answer_of, validate_array, validate_number, validate_positive, validate_vector
from ..support.foreign import DaskClient
from ..support.progress import Progress
from ..support.spelling import spelled
from ..support.warn import warn
from .free_impact import QUANTITIES, free_impact
from .impact_setup import Pair, Point, approach, default_duration, sideways, validate_pair
from .restitution_values import RestitutionMap
from .run_records import about_function
from .study import study

LARGEST_TURN = 2e-3  # rad, see `restitution_map`: restitution is right to 1e-3


@spelled
def restitution_map(
    bodies: Pair | Callable[[float], Pair],
    *,
    speed: float | Sequence[float] | Array,
    angle: float | Sequence[float] | Array = 0.0,
    friction: float | Sequence[float] | Array = 0.0,
    place: float | Sequence[float] | Array | None = None,
    along: Vector | None = None,
    duration: float | None = None,
    largest_turn: float = LARGEST_TURN,
    file: str | Path | None = None,
    workers: int | Executor | DaskClient = 1,
    progress: Progress | None = None,
) -> RestitutionMap:
    """Compute free impacts on a grid of speed, angle, friction and place, and what a rigid code has to know of them.

    The first body flies at the second one, which rests, or at a rigid surface, and does not spin. Both are free,
    without gravity. Each impact is watched until no vibration can close the contact again.

    Impacts in which bodies hardly turn are run by compiled steps in frames that do not move, in a quarter of the time,
    where these hold the impact: without plastic flow, and as long as pairs of patches do not slide in contact. The
    others are run in floating frames: by compiled steps too, which equal Exudyn's, on a rigid plane, sphere or
    cylinder, and on another body; else by Exudyn. `info["compiled"]` of the map says which impacts were run by
    compiled steps.

    Parameters
    ----------
    bodies : (ReducedBody, ReducedBody or rigid surface), or callable
        Placed as at the impact, with one contact patch each; with friction, patches of axes="xyz". A function is called
        with each `place` and returns them, such as a bar that is tilted by this angle. It must be one that processes
        can be told by its name, if `workers` are several.
    speed : float or sequence
        Of the first body against the second one [m/s].
    angle : float or sequence
        Of its velocity from the normal of the contact [rad], 0 up to below pi/2.
    friction : float or sequence
        Coefficient of Coulomb friction; 0 is none.
    place : float or sequence, optional
        What the function of bodies is called with. Default: 0.
    along : (3,) array, optional
        Direction of the motion along the surface. Default: the x axis, or y where x is nearly the normal.
    duration : float, optional
        Time to watch after the first touch [s]; if more contacts may come, up to eight times that. Default: 30
        crossings of a longitudinal wave through the larger body.
    largest_turn : float
        Angle by which bodies may turn until the last contact opens, in frames that do not move [rad]. Restitution then
        differs by less than this angle. 0: all impacts are run in floating frames.
    file : path, optional
        Of JSON lines. Impacts are added as soon as they are known, and those that it holds are not computed again. It
        must be of the same bodies, or of a function of the same name.
    workers : int, concurrent.futures.Executor or distributed.Client
        Number of processes; or an executor of your own, or a client of Dask's.
    progress : callable, optional
        Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

    Returns
    -------
    RestitutionMap

    Raises
    ------
    InputError
        If an argument is out of range, the bodies do not touch as they are placed, or `file` is of other bodies.
    OutputError
        If `file` cannot be written.
    PartitionError
        Of the impact that failed, with its point of the grid; `file` keeps what was computed.

    Warns
    -----
    PartitionWarning
        Once for each kind of warning that impacts gave, with how many did.
    """
    axes = _grid(speed, angle, friction, place)
    if callable(bodies):
        source: Pair | Callable[[float], Pair] = functools.partial(bodies)  # which always has a hash
    else:
        if place is not None:
            raise InputError("place: expected none beside given bodies; give a function of place that returns them")
        source = validate_pair("bodies", bodies)
    given = None if along is None else validate_vector("along", along)
    if not callable(source):
        sideways(approach(source), given)
    lasts = None if duration is None else validate_positive("duration", duration, "s")
    turn = validate_number("largest_turn", largest_turn, "an angle in rad, zero or above")
    if turn < 0:
        raise InputError(f"largest_turn: expected an angle in rad, zero or above, got {turn!r}")
    impact = functools.partial(impact_at, bodies=source, along=given, duration=lasts, largest_turn=turn)
    points = [dict(zip(axes, map(float, point), strict=True)) for point in itertools.product(*axes.values())]
    # The largest friction comes first: a patch without rows for it is refused before any impact is run.
    runs = study(impact, points[::-1], file=file, workers=workers, together="place", stop=True, progress=progress)
    left = int((runs["over"] == 0).sum())
    if left:
        warn(
            f"duration: {left} of {len(runs)} impacts may not be over: bodies vibrate so much, or part so slowly, "
            "that they may touch again. Give a longer one",
            ModelLimitWarning,
        )
    shape = tuple(len(values) for values in axes.values())
    values = {name: runs[name][::-1].astype(float).reshape(shape) for name in QUANTITIES}
    compiled = runs["compiled"][::-1].astype(bool).reshape(shape)
    about = {**about_function(impact)["fixed"], "new": runs.info["new"], "compiled": compiled}
    return RestitutionMap(**axes, values=values, info=about)


def _grid(speed: Any, angle: Any, friction: Any, place: Any) -> dict[str, Array]:
    """Values of each axis, ascending, by its name."""
    axes = {"place": 0.0 if place is None else place, "speed": speed, "angle": angle, "friction": friction}
    grid = {}
    for name, given in axes.items():
        values = validate_array(name, [given] if isinstance(given, int | float | np.number) else given, (None,))
        if not len(values):
            raise InputError(f"{name}: expected at least one number, got none")
        grid[name] = np.unique(values)
        if len(grid[name]) < len(values):
            raise InputError(f"{name}: expected numbers that differ, got {list(map(float, values))}")
    if grid["speed"][0] <= 0:
        raise InputError(f"speed: expected speeds above zero [m/s], got {grid['speed'][0]:g}")
    if grid["angle"][0] < 0 or grid["angle"][-1] >= math.pi / 2:
        worst = grid["angle"][0] if grid["angle"][0] < 0 else grid["angle"][-1]
        raise InputError(
            f"angle: expected angles from the normal, 0 up to below pi/2 = 1.5708 rad, got {worst:g}. "
            "Degrees are turned into rad by np.radians()"
        )
    if grid["friction"][0] < 0:
        raise InputError(f"friction: expected coefficients of zero or above, got {grid['friction'][0]:g}")
    return grid


def impact_at(
    place: float,
    speed: float,
    angle: float,
    friction: float,
    *,
    bodies: Pair | Callable[[float], Pair],
    along: Array | None,
    duration: float | None,
    largest_turn: float,
) -> dict[str, float]:
    """One impact of a map, which any process can compute."""
    pair = _made(bodies, place) if callable(bodies) else bodies
    lasts = default_duration(pair) if duration is None else duration
    return free_impact(pair, Point(place, speed, angle, friction), along, lasts, largest_turn)


@functools.lru_cache(maxsize=1)  # impacts of one place follow each other
def _made(bodies: Callable[[float], Pair], place: float) -> Pair:
    """Bodies at a place."""
    pair = answer_of(f"bodies({place:g})", bodies, place, "a place, which returns the two bodies of an impact there")
    return validate_pair(f"bodies({place:g})", pair)
