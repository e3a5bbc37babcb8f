"""Estimates by Hertz's theory, before there is a mesh: contact radius (paper, eq. 30), impacts, f_cut.

Theory: examples/site/theory.md, "Hertz's impact and first yield".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..fe.material import Material
from ..support.arrays import Array
from ..support.checks import read_only, validate_number, validate_positive, validate_type
from ..support.optional import require
from .spectrum import truncation_frequency
from .yielding import Stress

__all__ = ["HertzImpact", "contact_radius", "effective", "impact", "plate_impedance", "rod_impedance"]


@dataclass(frozen=True, eq=False)
class HertzImpact:
    """Estimated impact of two bodies on a Hertz spring.

    Parameters
    ----------
    peak_force : float
        Largest force [N].
    approach : float
        Largest approach of the two bodies [m].
    duration : float
        Time in contact [s]; `math.inf` if no mass stops the bodies. If an impedance limits the force, waves that return
        from the ends of the bodies separate them earlier.
    rise_time : float
        Time in which the force rises from 10 % to 90 % of its peak [s].
    contact_radius : float
        Radius of the contact circle at the peak [m], as by eq. 30.
    t : (n,) array
        Times over the duration, equally spaced [s]; if it is infinite, until the force has reached its limit.
    force : (n,) array
        Contact force [N].
    stress : Stress
        Stress beneath the contact at the peak of the force.
    yield_speed : float or None
        Speed at which the first body begins to yield [m/s], its pressure by Hertz about 1.6 times its yield stress. For
        masses alone, see Johnson, Contact Mechanics, section 11.5. None if no yield stress is known.
    """

    peak_force: float
    approach: float
    duration: float
    rise_time: float
    contact_radius: float
    t: Array
    force: Array
    stress: Stress
    yield_speed: float | None

    def __post_init__(self) -> None:
        read_only(self.t, self.force)

    @property
    def peak_pressure(self) -> float:
        """Largest pressure [Pa]."""
        return self.stress.pressure

    @property
    def yield_ratio(self) -> float | None:
        """Largest von Mises stress by yield stress, of the body that yields first; None if no yield stress is known.

        Above one, the true force is smaller and lasts longer, and bodies rebound slower: the estimate is elastic.
        """
        return self.stress.yield_ratio

    @property
    def yield_force(self) -> float | None:
        """Force at which the first body begins to yield [N]; None if no yield stress is known."""
        return self.stress.yield_force

    @property
    def plastic_radius(self) -> float | None:
        """Radius of a plastic zone that flow does not leave, of the body that yields first [m], for `Partition.ball`.

        A dent whose mean pressure is 2.8 times the yield stress Y takes the work of Hertz's impact on a circle of some
        radius a. Flow reaches as far as around a cavity that is widened (Johnson, Contact Mechanics, section 6.3), here
        with nu = 0.3, and a third is added: c^3 = a^3 (E* a / (R Y) + 1.6) / 4.2. It is an upper estimate with
        hardening. None if no yield stress is known.
        """
        if (weakest := self.stress.weakest) is None:
            return None
        limit = self.stress.yield_stress[weakest]
        assert limit is not None
        R = self.contact_radius**2 / self.approach
        modulus = math.pi * R * self.peak_pressure / (2 * self.contact_radius)
        work = 0.4 * self.peak_force * self.approach
        a = max(self.contact_radius, (4 * R * work / (math.pi * _PRESSED * limit)) ** 0.25)
        cavity = (modulus * a / (R * limit) + 1.6) / 4.2
        return float(_BEYOND * a * max(1.0, cavity) ** (1 / 3))

    def __repr__(self) -> str:
        known = self.yield_ratio is not None
        yields = f", {self.yield_ratio:.3g} times the yield stress" if known else ""
        return (
            f"HertzImpact(peak force {self.peak_force:.4g} N, approach {self.approach:.4g} m, duration "
            f"{self.duration:.4g} s, rise time {self.rise_time:.4g} s, contact radius {self.contact_radius:.4g} m"
            f"{yields})"
        )

    def truncation_frequency(self, *, tolerance: float = 0.01) -> float:
        """Truncation frequency that this force needs, before any run (paper, section 5.2).

        If impedances limit the force, estimate the impact with masses too. The force then rises as the waves allow, and
        ends.

        Parameters
        ----------
        tolerance : float
            As for `truncation_frequency` of a signal.

        Returns
        -------
        float
            [Hz], for `f_cut` of `reduce`.

        Raises
        ------
        InputError
            If the contact never ends: then the share of its energy at zero frequency grows with time.
        """
        if math.isinf(self.duration):
            raise InputError("mass: expected a finite one, for a contact without end has no truncation frequency")
        return truncation_frequency(self.t, self.force, tolerance=tolerance)


_PRESSED = 2.8  # mean pressure of a fully plastic dent by the yield stress
_BEYOND = 1.33  # radius of a plastic zone by that of flow around a cavity, `validation/inelastic/zone_radius.py`
_SAMPLES = 100  # of the force in its rise time
_MOST_SAMPLES = 2**18  # in all, for forces that rise very fast compared with their duration
_SETTLED = 20  # time for a force that only an impedance limits: its distance from the limit falls as exp(-1.5 t)
_SPEED_TOLERANCE = 1e-3  # of the speed at first yield
_SLOWEST = 1e-10  # least share of the speed that a mass takes away while the force rises on an impedance


def _validate_limit(name: str, value: float, unit: str) -> float:
    if isinstance(value, float) and value == math.inf:
        return math.inf
    return validate_positive(name, value, unit)


def _curvature(name: str, radius: float) -> float:
    """Curvature [1/m] of a surface of a radius [m], below zero of a hollow one, zero of a plane."""
    if isinstance(radius, float) and radius == math.inf:
        return 0.0
    unit = "m, or math.inf for a plane; below zero for a hollow"
    number = validate_number(name, radius, f"a number in {unit}")
    return math.copysign(1 / validate_positive(name, abs(number), unit), number)


def _combined(
    radius_1: float, radius_2: float, material_1: Material, material_2: Material | None
) -> tuple[float, float]:
    curvature = _curvature("radius_1", radius_1) + _curvature("radius_2", radius_2)
    if not curvature > 0:
        raise InputError(
            "radius_1, radius_2: expected surfaces that touch at a point: one of a finite radius, with a plane, with "
            "another, or with a wider hollow, whose radius is below zero; not two planes, or what fits all over; got "
            f"{radius_1!r} and {radius_2!r}"
        )
    validate_type("material_1", material_1, Material, "Material()")
    if material_2 is not None:
        validate_type("material_2", material_2, Material, "Material()")
    compliance = 1 / material_1.plane_strain_modulus
    if material_2 is not None:
        compliance += 1 / material_2.plane_strain_modulus
    return 1 / curvature, 1 / compliance


def contact_radius(
    force: float, radius_1: float, radius_2: float, material_1: Material, material_2: Material | None = None
) -> float:
    """Radius of the contact circle under a force, (3 P R / 4 E*)^(1/3) (paper, eq. 30).

    Parameters
    ----------
    force : float
        P [N].
    radius_1, radius_2 : float
        Radii of the surfaces [m], `math.inf` for a plane; below zero where a surface is hollow, as a socket of a ball
        is. Hertz's contact is small beside both: it ends where the radius of a ball comes near to that of its socket.
    material_1, material_2 : Material
        Their materials; None for a rigid second body.

    Returns
    -------
    float
        [m]

    Raises
    ------
    InputError
        If the force is not above zero, or the surfaces do not touch at a point, as two planes.
    """
    R, E = _combined(radius_1, radius_2, material_1, material_2)
    return float((3 * validate_positive("force", force, "N") * R / (4 * E)) ** (1 / 3))


def effective(first: float, second: float) -> float:
    """Effective mass or impedance of two bodies against each other, first * second / (first + second).

    Parameters
    ----------
    first, second : float
        Both masses [kg], or both impedances [N s/m]; `math.inf` for a rigid wall.

    Returns
    -------
    float
    """
    unit = "kg or N s/m, or math.inf for a wall"
    inverse = 1 / _validate_limit("first", first, unit) + 1 / _validate_limit("second", second, unit)
    return 1 / inverse if inverse else math.inf


def rod_impedance(material: Material, area: float) -> float:
    """Wave impedance of a rod's end, rho c A with the bar wave speed c (Johnson, Contact Mechanics, section 11.1).

    Parameters
    ----------
    material : Material
    area : float
        Cross section A [m2].

    Returns
    -------
    float
        Force over velocity [N s/m] until the first wave returns from the other end.

    Raises
    ------
    InputError
        If the area is not above zero.
    """
    validate_type("material", material, Material, "Material()")
    return material.rho * material.bar_wave_speed * validate_positive("area", area, "m2")


def plate_impedance(material: Material, thickness: float) -> float:
    """Wave impedance of a thin plate under a normal point force, 8 sqrt(D rho h) with D = E h^3 / (12 (1 - nu^2)).

    Cremer, Heckl, Petersson: Structure-Borne Sound; also Zener 1941. It holds for frequencies whose bending waves are
    long compared with the thickness, and until the first wave returns from an edge.

    Parameters
    ----------
    material : Material
    thickness : float
        h [m].

    Returns
    -------
    float
        Force over velocity [N s/m].

    Raises
    ------
    InputError
        If the thickness is not above zero.
    """
    validate_type("material", material, Material, "Material()")
    h = validate_positive("thickness", thickness, "m")
    stiffness = material.plane_strain_modulus * h**3 / 12
    return 8 * math.sqrt(stiffness * material.rho * h)


def impact(
    mass: float,
    speed: float,
    radius_1: float,
    radius_2: float,
    material_1: Material,
    material_2: Material | None = None,
    *,
    impedance: float = math.inf,
) -> HertzImpact:
    """Estimate an impact from masses, wave impedances and Hertz's contact, before there is a mesh.

    The bodies approach by d against the force F = k d^(3/2) with k = 4/3 E* sqrt(R). The force changes the velocity of
    a compact body of mass m by the integral of F / m, and that of a wave guide of impedance Z by F / Z:

        d' = speed - 1 / mass int F dt - F / impedance.

    With a mass alone this is the impact of Hertz (Johnson, Contact Mechanics, section 11.4). With the mass of a sphere
    and the impedance of a plate it is that of Zener (Phys. Rev. 59, 1941, 669). The force has two upper limits:

        F <= k (5 mass speed^2 / (4 k))^(3/5)  at all times, as the energy of the relative motion is all there is,
        F <= impedance speed                   until waves return from the ends; later forces may be larger.

    Give the mass of a body if waves cross it many times during the contact, and its impedance if they do not return.
    For a body between these, the lower limit is an upper estimate of the force until waves return from the other body.
    Do not give both for the same body in one call: it would yield twice, and the force would be too small.

    Parameters
    ----------
    mass : float
        Effective mass m1 m2 / (m1 + m2) [kg], see `effective`; for a wall, that of the striker; `math.inf` if only
        impedances count.
    speed : float
        Approach speed [m/s].
    radius_1, radius_2, material_1, material_2 :
        As for `contact_radius`.
    impedance : float
        Effective impedance Z1 Z2 / (Z1 + Z2) [N s/m], see `effective`, `rod_impedance`, `plate_impedance`. If the other
        body is compact, thick or a wall, that of one body; `math.inf` if no body is a wave guide.

    Returns
    -------
    HertzImpact

    Raises
    ------
    InputError
        If an argument is out of range, neither mass nor impedance is finite, or the mass acts 1e10 times slower than
        the force rises.
    """
    R, E = _combined(radius_1, radius_2, material_1, material_2)
    speed = validate_positive("speed", speed, "m/s")
    wave_limit = _validate_limit("impedance", impedance, "N s/m, or math.inf for none") * speed
    energy = _validate_limit("mass", mass, "kg, or math.inf where only impedances count") * speed**2
    stiffness = 4 / 3 * E * math.sqrt(R)
    mass_limit = stiffness**0.4 * (1.25 * energy) ** 0.6
    # In units of the lower limit and its approach: y' = w - a y^(3/2), w' = -b y^(3/2).
    limit = min(wave_limit, mass_limit)
    if math.isinf(limit):
        raise InputError("mass, impedance: expected at least one of them finite, for nothing else limits the force")
    length = (limit / stiffness) ** (2 / 3)
    b = limit * length / energy
    if 0 < b < _SLOWEST:
        raise InputError(
            f"mass, impedance: the force would rise on the impedance in {length / speed:.3g} s, and the mass stop the "
            f"bodies only after some {length / speed / b:.3g} s: expected times nearer to each other. Give "
            "mass=math.inf for the rise alone"
        )
    y, end, rise, shape = _solve(limit / wave_limit, b)
    period, radius = length / speed, math.sqrt(R * length * y)
    materials = [material_1] if material_2 is None else [material_1, material_2]
    stress = Stress.beneath(limit * y**1.5, (radius, radius), materials)
    return HertzImpact(
        peak_force=stress.force,
        approach=length * y,
        duration=end * period if math.isfinite(mass) else math.inf,
        rise_time=rise * period,
        contact_radius=radius,
        t=np.linspace(0, end * period, len(shape)),
        force=limit * shape,
        stress=stress,
        yield_speed=None if stress.yield_force is None else _speed(stress.yield_force, stiffness, mass, impedance),
    )


def _speed(force: float, stiffness: float, mass: float, impedance: float) -> float:
    """Speed of the impact with a peak force [N], on a spring of `stiffness` d^(3/2)."""
    energy = float((force / stiffness**0.4) ** (5 / 3)) / 1.25
    by_mass = math.sqrt(energy / mass)
    by_waves = force / impedance
    most = by_mass + by_waves
    if min(by_mass, by_waves) < _SPEED_TOLERANCE * most:
        return most

    def beyond(speed: float) -> float:
        limit = impedance * speed
        y = _solve(1.0, limit * (limit / stiffness) ** (2 / 3) / (mass * speed**2))[0]
        return limit * y * math.sqrt(y) - force

    # Neither yields less than it would alone, and both together no more than one after the other.
    return float(require("scipy.optimize").brentq(beyond, max(by_mass, by_waves), most, xtol=_SPEED_TOLERANCE * most))


def _solve(a: float, b: float) -> tuple[float, float, float, Array]:
    """Largest y, end, rise time and force y^(3/2) at equal steps of y' = w - a y^(3/2), w' = -b y^(3/2), w(0) = 1."""

    def force(y: Array) -> Array:
        return np.maximum(y, 0) ** 1.5

    def rates(_: float, state: Array) -> tuple[Array, Array]:
        f = force(state[0])
        return state[1] - a * f, -b * f

    def turns(t: float, state: Array) -> Array:
        return rates(t, state)[0]

    def parts(_: float, state: Array) -> float:
        return float(state[0])

    turns.direction = parts.direction = -1  # type: ignore[attr-defined]
    parts.terminal = True  # type: ignore[attr-defined]
    span = (0, math.inf if b else _SETTLED)
    options = {"method": "LSODA", "rtol": 1e-10, "atol": 1e-22, "dense_output": True}
    run = require("scipy.integrate").solve_ivp(rates, span, (0.0, 1.0), events=(turns, parts), **options)
    end = run.t[-1]
    top, largest = (run.t_events[0][0], run.y_events[0][0][0]) if b else (end, run.y[0, -1])
    rising = np.linspace(0, top, 2**12)
    ten, ninety = np.interp(np.array([0.1, 0.9]) * largest**1.5, force(run.sol(rising)[0]), rising)
    rise = ninety - ten
    samples = min(math.ceil(_SAMPLES * end / rise), _MOST_SAMPLES)
    return float(largest), float(end), float(rise), force(run.sol(np.linspace(0, end, samples))[0])


def __dir__() -> list[str]:
    return __all__
