"""What `design_impact` returns: FE models, bodies and step of an impact, with what was chosen and why."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..fe.model import FEModel
from ..fe.partition import Partition
from ..reduction.body import ReducedBody
from ..reduction.estimate import Estimate
from .contact_place import ContactPlace
from .mesh_error import MeshEstimate
from .mesh_rules import Sizes

TRUST = 1.25  # the estimated sum must be below the tolerance by this factor


@dataclass(frozen=True, eq=False)
class Look:
    """One set of meshes, and what it tells.

    Parameters
    ----------
    sizes : tuple of Sizes
        Of the elements of each body.
    dofs : tuple of int
        Of each FE model.
    missed : tuple of float
        Shares of the bodies' volumes that their meshes miss, because curved sides only follow the shapes nearly.
    circle : float
        Radius of the contact at the peak of the force, of a circle of the same area [m].
    peak : float
        Of the force [N].
    frequency : float
        Below which 99 % of the force's energy lies [Hz].
    truncation : Estimate
        Estimated errors of truncation and step together; mostly by the first look, which has richer bodies.
    mesh : MeshEstimate or None
        Estimated errors of the meshes; None on the first look.
    step : float
        [s]
    step_error : float
        Error of the force by the step alone, by comparison with a quarter of it.
    seconds : dict of str to float
        Times [s].
    """

    sizes: tuple[Sizes, ...]
    dofs: tuple[int, ...]
    missed: tuple[float, ...]
    circle: float
    peak: float
    frequency: float
    truncation: Estimate
    mesh: MeshEstimate | None
    step: float
    step_error: float
    seconds: dict[str, float]

    def by_meshes(self, quantity: str) -> float:
        """Estimated error of a `MeshEstimate`'s quantity by elements and by missed volume, which changes it less."""
        return (getattr(self.mesh, quantity) if self.mesh else 0.0) + max(self.missed)

    @property
    def force(self) -> float:
        """Estimated error of the force by all together."""
        return self.truncation.force + self.by_meshes("force")

    @property
    def velocity(self) -> float:
        """Estimated error of the velocities of every point by all together, for which the tolerance is not."""
        return self.truncation.velocity + self.by_meshes("velocity")

    @property
    def mean_velocity(self) -> float:
        """Estimated error of the velocities of whole bodies by all together."""
        assert self.truncation.mean_velocity is not None
        return self.truncation.mean_velocity + self.by_meshes("mean_velocity")

    @property
    def error(self) -> float:
        """The larger one of force and velocities of whole bodies, for which the tolerance is."""
        return max(self.force, self.mean_velocity)


@dataclass(frozen=True, eq=False)
class ImpactDesign:
    """FE models, bodies and step of an impact, whose total error is estimated. `print` it for a table.

    The estimate is the sum of those of the meshes and of the truncation with the step. It is no bound:
    `validation/mesh/design.py` and `by_hand.py` show it beside the true error. So a design ends only where the
    estimate is below the tolerance by a factor of 1.25.

    Parameters
    ----------
    fems : tuple of FEModel
        One, or two: of the first and of the second body.
    partitions : tuple of Partition
    bodies : tuple of ReducedBody
        For `CreatePartitionBody`. The first one is the slave of the contact, `passes="given"`.
    look : Look
        The meshes that were chosen, and their estimates.
    looks : tuple of Look
        All that were tried, the first look first.
    tolerance, speed, duration : float
        What was asked for: relative error, [m/s], [s].
    place : ContactPlace
        Points, normal and curvatures of the contact.
    limit : str
        Why the estimate is above the tolerance over 1.25; empty if it is not.
    """

    fems: tuple[FEModel, ...]
    partitions: tuple[Partition, ...]
    bodies: tuple[ReducedBody, ...]
    look: Look
    looks: tuple[Look, ...]
    tolerance: float
    speed: float
    duration: float
    place: ContactPlace
    limit: str = ""

    @property
    def step(self) -> float:
        """Step of the run, for `solve_dynamic` [s]."""
        return self.look.step

    @property
    def error(self) -> float:
        """Estimated total error: the larger one of force and velocities of whole bodies."""
        return self.look.error

    @property
    def seconds(self) -> dict[str, float]:
        """Times of meshing, assembly, reduction and estimates of all looks [s]."""
        names = dict.fromkeys(name for look in self.looks for name in look.seconds)
        return {name: sum(look.seconds[name] for look in self.looks) for name in names}

    def __str__(self) -> str:
        look, mesh = self.look, self.look.mesh
        assert mesh is not None
        low, high = self.place.curvatures
        long, short = self.place.semi_axes(look.circle)
        shape = f"{_mm(look.circle)}" if long < 1.1 * short else f"{_mm(long)} by {_mm(short)}"
        rows = [
            ("contact radius", shape, f"at {look.peak:.4g} N, relative radii {_mm(1 / high)} and {_mm(1 / low)}"),
            ("pulse", f"{1e-3 * look.frequency:.3g} kHz", "99 % of the force's energy lies below"),
        ]
        for i, (sizes, dofs) in enumerate(zip(look.sizes, look.dofs, strict=True)):
            elements = f"{_mm(sizes.far)}, order {sizes.order}"
            rows += [
                (f"body {i + 1}: elements", elements, f"by {sizes.why}"),
                ("  at the contact", _mm(sizes.near), f"{dofs} dofs, reduced to {self.bodies[i].n_dofs}"),
                ("  error by its mesh", f"{mesh.of_bodies[i]:.2%}", f"far {mesh.far[i]:.2%}, near {mesh.local[i]:.2%}"),
            ]
        cut = f"f_cut {1e-3 * look.truncation.f_cut:.3g} kHz"
        rows += [
            (
                "estimated error by the meshes",
                f"{max(mesh.force, mesh.mean_velocity):.2%}",
                f"force {mesh.force:.2%}, velocities of whole bodies {mesh.mean_velocity:.2%}",
            ),
            ("  by their shape", f"{max(look.missed):.2%}", "share of a body's volume that its mesh misses"),
            (
                "  by truncation and step",
                f"{look.truncation.error:.2%}",
                f"{cut}; the step alone {look.step_error:.2%}",
            ),
            ("  in all", f"{self.error:.2%}", f"asked for {self.tolerance:.2%}, {self._verdict()}"),
            ("  in all, velocities of every point", f"{look.velocity:.2%}", "the tolerance is not for these"),
            (
                "step",
                f"{1e6 * self.step:.3g} us",
                f"{self.duration / self.step:.0f} steps in {1e3 * self.duration:.3g} ms",
            ),
            ("time", f"{sum(self.seconds.values()):.1f} s", self._times()),
        ]
        return "\n".join([*_columns(rows), *([f"limit: {self.limit}"] if self.limit else [])])

    def _verdict(self) -> str:
        if not self.limit:
            return "reached"
        if self.error <= self.tolerance:
            return f"not promised: must be below {self.tolerance / TRUST:.2%}"
        return "not reached"

    def _times(self) -> str:
        return f"{len(self.looks)} meshings: " + ", ".join(f"{name} {x:.1f} s" for name, x in self.seconds.items())


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g} mm"


def _columns(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Lines of a table with columns as wide as their longest entry."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(n) for cell, n in zip(row, widths, strict=True)).rstrip() for row in rows]
