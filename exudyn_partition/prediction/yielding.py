"""First yield beneath a contact, by Hertz's field of stress on the axis (Johnson, Contact Mechanics, 3.4, 4.2, 6.1).

Theory: examples/site/theory.md, "Hertz's impact and first yield".
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import ellipeinc, ellipkinc

from ..fe.material import Material

_ROUND = 0.99  # ratio of the semi-axes, above which the formula of the circle is taken: that of the ellipse is 0 / 0
_LINE = 1e-3  # and below which an ellipse is as long as a line
_DEEPEST, _DEPTHS = 1.5, 3000  # in minor semi-axes: the largest stress lies at 0.3 to 0.8 of it


@functools.lru_cache(maxsize=1024)
def von_mises_factor(nu: float, ratio: float = 1.0) -> float:
    """Largest von Mises stress on the axis beneath an elliptical contact, by its largest pressure p0.

    For nu = 0.3, it is 0.620 beneath a circle, so that yielding begins at p0 = 1.61 times the yield stress, and 0.558
    beneath a line. It is the largest of the whole body where nu is above zero and nothing rubs.

    Parameters
    ----------
    nu : float
        Poisson's ratio.
    ratio : float
        Of the minor semi-axis to the major one, 0 to 1.

    Returns
    -------
    float
    """
    ratio = max(ratio, _LINE)
    z = np.linspace(0, _DEEPEST, _DEPTHS + 1)[1:] * (1.0 if ratio > _ROUND else ratio)  # in major semi-axes
    if ratio > _ROUND:
        axial = -1 / (1 + z**2)
        lateral = -(1 + nu) * (1 - z * np.arctan(1 / z)) - axial / 2
        return float(abs(axial - lateral).max())
    square = 1 - ratio**2
    T = np.sqrt((ratio**2 + z**2) / (1 + z**2))
    F, E = ellipkinc(np.arctan(1 / z), square), ellipeinc(np.arctan(1 / z), square)
    along, across = z * (F - E), z * (E / ratio**2 - F)
    x = -(1 - T) / 2 + along + nu * (1 - T / ratio**2 + across)
    y = 0.5 + 0.5 / T - T / ratio**2 + across + nu * (T - 1 + along)
    s1, s2, s3 = ratio / square * np.array([2 * x, 2 * y, -(1 - T**2) / T])
    return float(np.sqrt(((s1 - s2) ** 2 + (s2 - s3) ** 2 + (s3 - s1) ** 2) / 2).max())


_factor = functools.lru_cache(maxsize=256)(von_mises_factor)  # many contacts have nearly the same ratio


@dataclass(frozen=True)
class Stress:
    """Stress beneath a contact of two bodies under a force, as Hertz has it.

    Parameters
    ----------
    force : float
        [N]
    pressure : float
        Largest pressure p0 of the Hertz contact with this force and these semi-axes, 3 P / (2 pi a b) [Pa].
    semi_axes : (float, float)
        Of the contact's ellipse, the larger one first [m].
    von_mises : tuple of float or None
        Largest von Mises stress in each body [Pa]; None for one whose material is not known.
    yield_stress : tuple of float or None
        Of each body [Pa]; None where it is not known.
    flat : bool
        Whether bodies touch all over their patch: the mean pressure is then a stress as in a bar, if that is larger
        than what Hertz gives.
    time : float or None
        When that was, of a run [s].
    """

    force: float
    pressure: float
    semi_axes: tuple[float, float]
    von_mises: tuple[float | None, ...]
    yield_stress: tuple[float | None, ...]
    flat: bool = False
    time: float | None = None

    @classmethod
    def beneath(
        cls,
        force: float,
        semi_axes: tuple[float, float],
        materials: Iterable[Material | None],
        mean: float = 0.0,
        time: float | None = None,
    ) -> Stress:
        """Stress beneath a contact with these semi-axes [m]; `mean` is the pressure of one that is flat [Pa]."""
        a, b = semi_axes
        pressure, materials = 3 * force / (2 * math.pi * a * b), [*materials]
        by_hertz = [None if m is None else pressure * _factor(m.nu, round(b / a, 2)) for m in materials]
        return cls(
            force=force,
            pressure=pressure,
            semi_axes=semi_axes,
            von_mises=tuple(None if s is None else max(s, mean) for s in by_hertz),
            yield_stress=tuple(None if m is None else m.yield_stress for m in materials),
            flat=any(s is not None and mean > s for s in by_hertz),
            time=time,
        )

    @property
    def weakest(self) -> int | None:
        """Number of the body that yields first, 0 or 1; None if no yield stress is known."""
        shares = {i: share for i in range(len(self.von_mises)) if (share := self.share(i)) is not None}
        return max(shares, key=shares.__getitem__) if shares else None

    def share(self, body: int) -> float | None:
        """Von Mises stress of a body by its yield stress; None if that is not known."""
        stress, limit = self.von_mises[body], self.yield_stress[body]
        return None if stress is None or limit is None else stress / limit

    @property
    def yield_ratio(self) -> float | None:
        """Von Mises stress by yield stress, of the body that yields first; None if no yield stress is known."""
        return None if self.weakest is None else self.share(self.weakest)

    @property
    def yield_force(self) -> float | None:
        """Force at which the first body begins to yield [N]: stresses grow with the third root of the force.

        Where the contact is flat, they grow with the force itself.
        """
        ratio = self.yield_ratio
        return None if ratio is None else self.force / (ratio if self.flat else ratio**3)

    def by_body(self, bodies: tuple[str, ...]) -> list[tuple[str, str]]:
        """Each body with its von Mises stress in words."""
        said = []
        for i, (name, stress) in enumerate(zip(bodies, self.von_mises, strict=True)):
            share = self.share(i)
            beyond = "no yield stress is known" if share is None else f"{share:.3g} times its yield stress"
            said.append((name, "its material is not known" if stress is None else f"{1e-6 * stress:.4g} MPa, {beyond}"))
        return said

    def advice(self, bodies: tuple[str, ...]) -> str:
        """Return by how much the stress is beyond first yield, and what to do; `bodies` are named in sentences."""
        if (body := self.weakest) is None or self.yield_force is None:
            return ""
        stress, limit = self.von_mises[body], self.yield_stress[body]
        assert stress is not None
        assert limit is not None
        how = "the mean pressure" if self.flat else f"Hertz-equivalent pressure {self.pressure:.4g} Pa"
        return (
            f"the von Mises stress of {bodies[body]} reaches {stress:.4g} Pa, {stress / limit:.3g} times the yield "
            f"stress of {limit:.4g} Pa ({how}, at {self.force:.4g} N): it begins to yield at {self.yield_force:.3g} N. "
            "The body stays elastic here; a real one dents, with a smaller and longer force, and rebounds slower. "
            "Reduce speed or force, enlarge the radius, take a harder material, or let its patch yield (hardening= of "
            "Material). Its own value is given by yield_stress= of Material; those of STEEL and ALUMINIUM are typical"
        )
