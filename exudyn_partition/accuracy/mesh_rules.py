"""Sizes of elements by rule: from the wavelengths of an impact far from the contact, and from its radius there.

A first look has quadratic elements. Others are cubic: for the same error they mostly take fewer dofs and less time.
Where round sides of a long body ask for many more elements than waves do, quadratic ones take fewer dofs; but in thin
walls they cannot hold the parabolic shear.
Far: a wave takes four elements in walls, fewer elsewhere. The frequency is the one below which 99 % of the force's
energy lies. The wave is a bending wave in walls that are thinner than half of it and that few elements span, and a
shear wave elsewhere. Round sides take as few elements as keep the volume. Bodies that are corrected have larger
elements there.
Near: elements of 0.72 shorter semi-axes of the contact, within 1.2 semi-axes; then elements grow. In long contacts they
may be larger, by 1.45 at most. Those of the slave are smaller by 0.8, for its facets also carry the rows, which have an
error of their own.

These sizes make an error of a few percent at most. The tolerance changes them by the rates below; the estimate decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..errors import FrequencyRangeError
from ..fe.material import Material
from ..fe.model import FEModel
from ..fe.walls import bending_frequency
from ..meshing.netgen_mesh import CURVATURE
from ..prediction.spectrum import truncation_frequency
from ..support.arrays import Array
from ..support.foreign import NGSolveMesh
from ..support.optional import require

GRADING = 0.5  # growth of elements away from the contact
REFINED = 1.2  # semi-axes of the refined region, by those of the contact
REACH = (1.5, 2.0)  # those of the patches of the first and of the second body; half an element is added

_OF_A_WAVE, _OF_A_SHEAR_WAVE = 4, 2.7  # elements
QUADRATIC, _QUADRATIC_FAR = 0.62, 0.65  # sizes of quadratic elements, at the contact and far, by those of cubic ones
_LOCAL, _FIRST_LOCAL = 0.72, 1.0  # elements at the contact, by its shorter semi-axis; on the first mesh
_LONG_POWER, _LONG_MOST = 0.4, 1.45  # of the ratio of semi-axes, which these sizes follow up to a factor
_LARGEST = 1.5  # of them at the contact: larger ones have no useful estimate
_SLAVE = 0.8  # of these at the slave
# Of bodies that are corrected, by others: far sizes, and those at the slave, whose rows are not corrected.
_CORRECTED, _SLAVE_CORRECTED = 1.6, 0.85
_FIRST_LOOK = 12  # elements in the longest side of a body, on its first mesh
_LAYERS = 1.5  # elements across a wall of the first mesh, from which on quadratic ones are enough
_FEWEST, _ACROSS = 3, 1.3  # elements in the longest side of any body, and in the shortest one of a stocky body
_FIRST_ACROSS = 3  # the latter on the first mesh
_ENERGY = 0.1  # amplitude whose square is the energy above the frequency: 1 %
# Tolerances for which the rules are, and powers of it that far and near sizes follow.
_FAR_TOLERANCE, _NEAR_TOLERANCE, _FAR_POWER, _NEAR_POWER = 0.04, 0.01, 1 / 3, 1 / 3
_FAR_RATE, _NEAR_RATE = 2.0, {2: 2.5, 3: 3.3}  # powers by which errors fall with these sizes, at least; by order
MISSED = 0.1  # of the tolerance: share of its volume that a mesh with curved sides may miss
_COARSE_CURVATURE = 1.3  # elements in a radius of curvature; with fewer, curved sides often turn elements inside out
_FINE_CURVATURE = 3.0  # the same at most
_VOLUME_RATE = 2.5  # power of them by which quadratic sides miss less volume, at least
_LEAST_CHANGE, _MOST_CHANGE = 0.93, 0.45  # of a size in one refinement


@dataclass(frozen=True)
class Sizes:
    """How a body is meshed.

    Parameters
    ----------
    order : {2, 3}
        Of its elements.
    far : float
        Largest elements [m].
    near : float
        Elements at the contact [m].
    why : str
        What decided on order and far size.
    curvature : float
        Elements in a radius of curvature.
    thin : bool
        Whether `far` follows bending waves in thin walls.
    """

    order: int
    far: float
    near: float
    why: str
    curvature: float = CURVATURE
    thin: bool = False

    def quadratic(self) -> Sizes | None:
        """Quadratic elements of about the same error; None in thin walls, whose parabolic shear they cannot hold."""
        if self.thin:
            return None
        return replace(self, order=2, far=_QUADRATIC_FAR * self.far, near=QUADRATIC * self.near)

    def finer(self, far: float | None, near: float | None) -> Sizes:
        """Smaller elements, by the ratios of allowed and estimated errors, far and near; None leaves a size."""
        sizes = self if (far, near) == (None, None) else replace(self, why="the estimate")
        if far is not None:
            sizes = replace(sizes, far=self.far * _factor(far, _FAR_RATE))
        if near is not None:
            sizes = replace(sizes, near=self.near * _factor(near, _NEAR_RATE[self.order]))
        return sizes


def _factor(ratio: float, rate: float) -> float:
    """Change of a size that makes an error smaller by a ratio."""
    return min(max(math.pow(ratio, 1 / rate), _MOST_CHANGE), _LEAST_CHANGE)


def first_sizes(sides: Array, semi_axes: tuple[float, float]) -> Sizes:
    """Quadratic elements of a first look, by the sides of a body, (3,) [m], and the semi-axes of the contact [m]."""
    far = max(float(sides.max()) / _FIRST_LOOK, float(sides.min()) / _FIRST_ACROSS)
    return Sizes(2, far, _FIRST_LOCAL * _size_at(*semi_axes), "a first look", _COARSE_CURVATURE)


def _size_at(long: float, short: float) -> float:
    """Size to which those of elements at a contact are proportional [m], by its semi-axes."""
    return short * min(math.pow(long / short, _LONG_POWER), _LONG_MOST)


def curvature_for(curvature: float, missed: float, tolerance: float) -> float:
    """Elements in a radius of curvature that miss little of a body's volume, by the relative share that others miss."""
    needed = curvature * math.pow(missed / (MISSED * tolerance), 1 / _VOLUME_RATE)
    return min(max(needed, _COARSE_CURVATURE), _FINE_CURVATURE)


def sizes_by_rule(
    fem: FEModel,
    sides: Array,
    frequency: float,
    semi_axes: tuple[float, float],
    tolerance: float,
    *,
    slave: bool = False,
    corrected: bool = False,
) -> Sizes:
    """Sizes for an impact, by the walls that a first mesh shows; see the module.

    Parameters
    ----------
    fem : FEModel
        Of the first mesh.
    sides : (3,) array
        Of the body [m].
    frequency : float
        Below which the energy of the force lies [Hz].
    semi_axes : (float, float)
        Of the contact, the longer one first [m].
    tolerance : float
        For the whole error.
    slave : bool
        Whether the body carries the rows of the contact.
    corrected : bool
        Whether the body is to be corrected; then elements far from the contact may be larger.
    """
    wall, material = fem.weakest_wall, fem.material
    shear = material.shear_wave_speed / frequency
    bending = bending_wavelength(frequency, wall.thickness, material)
    far_factor = (tolerance / _FAR_TOLERANCE) ** _FAR_POWER * (_CORRECTED if corrected else 1.0)
    thin = wall.thickness < min(bending / 2, _LAYERS * wall.element)
    if thin:
        far = bending / _OF_A_WAVE * far_factor
        why = f"bending waves of {1e3 * bending:.3g} mm at {1e-3 * frequency:.3g} kHz in {1e3 * wall.thickness:.3g} mm"
    else:
        far = min(shear / _OF_A_SHEAR_WAVE * far_factor, float(sides.min()) / _ACROSS)
        why = f"shear waves of {1e3 * shear:.3g} mm at {1e-3 * frequency:.3g} kHz; or the shortest side over {_ACROSS}"
    near = near_size(semi_axes, tolerance, slave=slave)
    if slave and corrected:
        near *= _SLAVE_CORRECTED
    return Sizes(3, min(far, float(sides.max()) / _FEWEST), near, why, thin=thin)


def near_size(semi_axes: tuple[float, float], tolerance: float, *, slave: bool) -> float:
    """Cubic elements at a contact [m]; quadratic ones are smaller by `QUADRATIC`. See `sizes_by_rule`."""
    share: float = min(_LOCAL * (tolerance / _NEAR_TOLERANCE) ** _NEAR_POWER, _LARGEST)
    return share * _size_at(*semi_axes) * (_SLAVE if slave else 1.0)


def bending_wavelength(frequency: float, thickness: float, material: Material) -> float:
    """Length of bending waves in a plate [m]; infinite without a thin wall."""
    if not math.isfinite(thickness):
        return math.inf

    def off(log_length: float) -> float:
        return float(bending_frequency(2 * np.pi / math.exp(log_length), thickness, material)) / frequency - 1

    low, high = 1e-3 * thickness, 1e6 * thickness
    if off(math.log(low)) < 0:
        return low
    return math.exp(float(require("scipy.optimize").brentq(off, math.log(low), math.log(high))))


def energy_frequency(t: Array, force: Array) -> float:
    """Frequency below which 99 % of the energy of a force lies [Hz]; forces that have not ended are faded out.

    The last spacing of the times may differ from the others, as in the records of `Impact.run`.
    """
    even = np.linspace(t[0], t[-1], len(t))
    force = np.interp(even, t, force)
    at_rest = max(abs(force[0]), abs(force[-1])) <= _ENERGY * abs(force).max()
    try:
        return truncation_frequency(even, force, tolerance=_ENERGY, window="none" if at_rest else "hann") / 2
    except FrequencyRangeError:  # the samples are too few for what lies above
        return float(0.25 * (len(t) - 1) / (t[-1] - t[0]))


def count_of_dofs(mesh: NGSolveMesh, order: int) -> int:
    """Dofs of an FE model of that mesh."""
    nodes = mesh.nv + (order - 1) * mesh.nedge + (order - 1) * (order - 2) // 2 * mesh.nface
    return int(3 * nodes)
