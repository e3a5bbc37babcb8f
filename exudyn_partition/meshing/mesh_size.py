"""Sizes of elements: local refinement, and estimates of the elements and the memory that a mesh will take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, MemoryLimitError, UnitsWarning
from ..fe.places import distance_within, validate_long_axis
from ..support.arrays import Array, Vector
from ..support.checks import validate_positive, validate_vector
from ..support.machine import available_memory
from ..support.progress import say
from ..support.warn import warn

_MOST_POINTS = 1e7  # of a ball's grid: no FE model in memory has so many nodes
# Netgen's elements in a volume maxh^3, and on a surface maxh^2 of walls thinner than an element.
_A_VOLUME, _A_SURFACE = 4.5, 3.5
# By order: nodes per element, and peak memory of an FE model per node [byte]; that of its mesh per element.
_NODES = {1: 0.22, 2: 1.5, 3: 4.9}
_WALLS = 2.0  # largest element of a first mesh, by the mean thickness of walls
_COARSEST, _FINEST = 12.0, 60.0  # elements along the diagonal of a first mesh
LARGE = 3e4  # nodes of a mesh that takes a while, and its reduction longer
_A_NODE, _AN_ELEMENT = {1: 19e3, 2: 19e3, 3: 30e3}, 1.2e3


@dataclass(frozen=True)
class Refine:
    """Local mesh size around a point.

    Parameters
    ----------
    center : (3,) array
        Centre of the refined ball [m].
    radius : float
        Its radius [m].
    h : float
        Element size within it [m]. The nodes of quadratic elements are h / 2 apart.
    long_axis : (3,) array, optional
        As for `Partition.ball`: longer semi-axis of an ellipsoid in place of the ball [m]; `radius` is its size across.
    """

    center: Array
    radius: float
    h: float
    long_axis: Array | None = field(default=None, kw_only=True)

    if TYPE_CHECKING:  # any three numbers will do; they are kept as arrays

        def __init__(self, center: Vector, radius: float, h: float, *, long_axis: Vector | None = None) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", validate_vector("center", self.center))
        for name in ("radius", "h"):
            object.__setattr__(self, name, validate_positive(name, getattr(self, name), "m"))
        object.__setattr__(self, "long_axis", validate_long_axis(self.long_axis, self.radius))

    @property
    def longest(self) -> float:
        """Longest semi-axis [m]."""
        return self.radius if self.long_axis is None else float(np.linalg.norm(self.long_axis))

    @property
    def n_points(self) -> float:
        """Number of `points`, estimated without making them."""
        return 4 / 3 * np.pi * (self.radius / self.h + 0.5) ** 2 * (self.longest / self.h + 0.5)

    def points(self) -> Array:
        """(n, 3) array: a grid of spacing h that fills the ball, or the ellipsoid along its long axis [m]."""
        across, along = (int(np.ceil(x / self.h)) for x in (self.radius, self.longest))
        axes = np.eye(3)
        if self.long_axis is not None:
            axes = np.linalg.svd(self.long_axis[None])[2]
        counts = np.meshgrid(*[np.arange(-n, n + 1) for n in (along, across, across)])
        grid = self.center + self.h * np.stack(counts, axis=-1).reshape(-1, 3) @ axes
        points: Array = grid[distance_within(grid, self.center, self.radius, self.long_axis) <= self.radius]
        return points

    def n_elements(self, maxh: float, grading: float) -> float:
        """Approximate number of elements in the ball and around it; the centre is on the surface of the body.

        Parameters
        ----------
        maxh : float
            Largest size of elements, outside [m].
        grading : float
            Growth of the element size with the distance.
        """
        h = min(self.h, maxh)
        around = (maxh - h) / grading * np.linspace(0, 1, 200)
        shell = (self.radius + around) * (self.radius + 2 * self.longest + 3 * around) / 3
        integral = np.trapezoid(shell / (h + grading * around) ** 3, around)
        return float(_A_VOLUME * 2 * np.pi * (self.radius**2 * self.longest / (3 * h**3) + integral))


def check_sizes(low: Array, high: Array, maxh: float, regions: Sequence[Refine]) -> float:
    """Size of a body that spans `low` to `high`, (3,) [m]; checks that element sizes fit to it.

    Warnings are reported for the caller of `generate_mesh` or `fe_model`.

    Raises
    ------
    InputError
        If the body has no finite extent, or a ball takes more elements than memory holds.
    """
    size = float((high - low).max())
    if not np.isfinite([low, high]).all() or not size > 0:
        raise InputError(f"shape: expected a body of finite size, got one that spans {low} to {high} m")
    if maxh > size:
        warn(
            f"maxh: {maxh:g} m is longer than the body, {size:.4g} m; lengths are in metres: give maxh in metres, "
            "and scale=1e-3 of fe_model for a shape in millimetres",
            UnitsWarning,
        )
    for region in regions:
        if region.n_points > _MOST_POINTS:
            raise InputError(
                f"refine: a ball of radius {region.radius:g} m with elements of {region.h:g} m takes "
                f"{region.n_points:.2g} of them, expected at most {_MOST_POINTS:g}; the body is {size:.4g} m long. Is "
                "a length in millimetres? Give radius and h in metres"
            )
        if region.h >= maxh:
            warn(
                f"refine: h={region.h:g} m has no effect, it is not below maxh={maxh:g} m; the body is {size:.4g} m "
                "long. Is it in millimetres? Give it in metres",
                UnitsWarning,
            )
    return size


def first_size(diagonal: float, volume: float, surface: float) -> float:
    """Size of the largest elements of a first mesh [m]: twice the walls are thick, within bounds by the diagonal.

    A wall of thickness t has the volume t/2 for each area of its surface.
    """
    return float(np.clip(_WALLS * 2 * volume / surface, diagonal / _FINEST, diagonal / _COARSEST))


@dataclass(frozen=True)
class SurfaceSizes:
    """Sizes of elements that a mesher takes at a surface, for curves, short edges and small faces.

    Parameters
    ----------
    places : (n, 3) array
        Points all over the surface [m].
    areas : (n,) array
        Of the surface around each [m2].
    sizes : (n,) array
        Of elements there [m].
    """

    places: Array
    areas: Array
    sizes: Array

    def n_elements(self, maxh: float, grading: float) -> float:
        """Approximate number of elements that it takes to grow from the surface up to size `maxh` inside [m]."""
        growth: Array = self.areas * (self.sizes**-2 - maxh**-2) / (2 * grading)
        return float(_A_VOLUME * growth.sum())

    @property
    def smallest(self) -> tuple[float, Array]:
        """Least size [m], and its place, (3,) [m]."""
        least = int(self.sizes.argmin())
        return float(self.sizes[least]), self.places[least]


def check_memory_of_mesh(
    size: float,
    volume: float,
    surface: float,
    maxh: float,
    regions: Sequence[Refine],
    grading: float,
    order: int,
    surface_sizes: Callable[[], SurfaceSizes | None] = lambda: None,
) -> float:
    """Approximate number of elements of a mesh; refuse one that would not fit into memory, before it is made.

    Of a large one it says so, and what decides its size.

    Parameters
    ----------
    size, volume, surface : float
        Of the body [m], [m3], [m2].
    maxh, regions, grading :
        As `generate_mesh` takes them.
    order : {1, 2, 3}
        Of the FE model that is made of it.
    surface_sizes : callable, optional
        Returns the sizes of elements at the surface. It is asked after a first look that does not know them.

    Raises
    ------
    MemoryLimitError
        With the estimated number of elements.
    """
    inside, walls = _A_VOLUME * volume / maxh**3, _A_SURFACE * surface / maxh**2
    balls = sum(
        min(region.n_elements(maxh, grading), _A_VOLUME * volume / min(region.h, maxh) ** 3) for region in regions
    )

    def checked(n: float) -> float:
        needed, available = n * (_NODES[order] * _A_NODE[order] + _AN_ELEMENT), available_memory()[0]
        if needed > available:
            raise MemoryLimitError(
                f"maxh: elements of {maxh:.4g} m in a body of {size:.4g} m would be about {n:.2g}"
                f"{', refinement included,' if regions else ''} and take {_gb(needed)}, of {_gb(available)} that are "
                "free. Take a larger maxh, or larger h and smaller radius in refine; is the shape in millimetres? Then "
                "give scale=1e-3 of fe_model"
            )
        return n

    n = checked(max(inside, walls) + balls)
    at_surface = surface_sizes()
    if at_surface is not None:
        n = checked(max(n, inside + balls + at_surface.n_elements(maxh, grading)))
    if (nodes := n * _NODES[order]) > LARGE:
        if balls > n / 2:
            most = "are in the balls of refine: a larger h makes fewer"
        elif max(inside, walls) > n / 2 or at_surface is None:
            power = 1 / 3 if inside > walls else 1 / 2
            larger = maxh * (nodes / LARGE) ** power
            most = f"fill the body: a larger maxh makes fewer, {larger:.2g} m some {_rounded(LARGE)} nodes"
        else:
            h, place = at_surface.smallest
            where = ", ".join(f"{x:.3g}" for x in place)
            most = (
                f"are at curves, short edges and small faces of the shape, down to {h:.2g} m at ({where}) m; maxh does "
                "not decide. Leave out small fillets and holes in CAD, or take grading=0.5"
            )
        say(f"mesh: some {_rounded(n)} elements with {_rounded(nodes)} nodes are to come. Most {most}")
    return n


def check_memory_of_model(n_nodes: int, order: int) -> None:
    """Refuse an FE model whose matrices would not fit into memory, before they are assembled.

    Raises
    ------
    MemoryLimitError
    """
    needed, available = n_nodes * _A_NODE[order], available_memory()[0]
    if needed > available:
        raise MemoryLimitError(
            f"mesh: the matrices of {n_nodes} nodes would take about {_gb(needed)}, of {_gb(available)} that are free. "
            "Take larger elements far from the contact"
        )


def _rounded(n: float) -> str:
    return f"{float(f'{n:.2g}'):,.0f}"


def _gb(size: float) -> str:
    return f"{size / 1e9:.3g} GB"
