"""Elastic materials of input decks, in the units of the deck or in SI."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..fe.material import Material

_LOG = logging.getLogger(__name__)

_DENSITIES = (50.0, 3e4)  # of solids [kg/m3]: from aerogel and foam to osmium
_SPEEDS = (10.0, 2e4)  # of waves in bars [m/s]
_MASSES = (1e12, 1e9, 1e6)  # factors from t, kg and g by mm3 to kg/m3
_TIMES = (1e-3, 1.0)  # factors from mm by s and ms to m/s


@dataclass(frozen=True)
class DeckMaterial:
    """A material as a deck has it.

    Parameters
    ----------
    name : str
    where : str
        File and line, for messages.
    E, nu, rho : float or None
        In the deck's units; None if it does not say.
    besides : str
        What it has that is no such number, as "orthotropic"; blank for none.
    """

    name: str
    where: str
    E: float | None = None
    nu: float | None = None
    rho: float | None = None
    besides: str = ""

    @property
    def elastic(self) -> Material:
        """Material with its numbers; InputError if some are missing, or it is no isotropic one."""
        if self.besides:
            raise InputError(f"material: {self.name!r} ({self.where}) is {self.besides}. Give material= of fe_model")
        if self.E is None or self.nu is None or not self.rho:
            lacks = [n for n, x in (("modulus", self.E), ("Poisson's ratio", self.nu), ("density", self.rho)) if not x]
            raise InputError(
                f"material: {self.name!r} ({self.where}) has no {' and no '.join(lacks)} in the deck. Give material= "
                "of fe_model"
            )
        return Material(E=self.E, nu=self.nu, rho=self.rho)


def material_of_deck(
    path: Path, known: Mapping[str, DeckMaterial], names: Sequence[str], scale: float
) -> Material | dict[str, Material]:
    """Material of the deck, or one for each region that elements are in.

    Parameters
    ----------
    path : Path
    known : mapping of str to DeckMaterial
        By the names of the regions.
    names : sequence of str
        Regions that elements are in.
    scale : float
        Factor on lengths. With 1e-3, numbers in millimetres become those in SI units.

    Raises
    ------
    InputError
        If one is missing, not isotropic, or cannot be converted.
    """
    missing = [name for name in names if name not in known]
    if missing:
        of = f" for {', '.join(map(repr, missing))}" if any(missing) else ""
        raise InputError(f"material: {path} has none{of}. Give material= of fe_model, such as ep.STEEL")
    materials = {}
    for name in names:
        given = known[name].elastic
        materials[name] = given if scale == 1 else _scaled(known[name], given, scale)
        told = materials[name]
        units = "SI units" if scale != 1 or not given.in_millimetres else "units of millimetres, as the geometry's"
        _LOG.info(
            "%s: material %r has E=%.6g, nu=%.4g and rho=%.6g, taken as %s",
            path, known[name].name, told.E, told.nu, told.rho, units,
        )  # fmt: skip
    return materials if len(materials) > 1 else materials[names[0]]


def _scaled(deck: DeckMaterial, given: Material, scale: float) -> Material:
    """Material in SI units; its numbers go with lengths in millimetres."""
    density = [given.rho * factor for factor in _MASSES if _DENSITIES[0] <= given.rho * factor <= _DENSITIES[1]]
    speeds = [given.bar_wave_speed * factor for factor in _TIMES]
    speed = [value for value in speeds if _SPEEDS[0] <= value <= _SPEEDS[1]]
    if scale != 1e-3 or not density or not speed:
        raise InputError(
            f"material: {deck.name!r} ({deck.where}) has E={given.E:.6g} and rho={given.rho:.6g} in units of the deck. "
            f"With scale={scale:g} they are not converted; this is done with scale=1e-3 of a deck in millimetres "
            "alone. Give material= of fe_model"
        )
    return Material(E=density[0] * speed[0] ** 2, nu=given.nu, rho=density[0])
