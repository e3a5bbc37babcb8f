"""Plastic flow by von Mises (J2) at small strain, with isotropic and kinematic hardening: radial return.

Deviatoric strains and stresses are vectors (xx, yy, zz, sqrt(2) yz, sqrt(2) xz, sqrt(2) xy), Mandel's notation, so that
the double contraction of two tensors is the scalar product of their vectors.

References
----------
J. C. Simo, T. J. R. Hughes, Computational Inelasticity, 1998, sections 3.3 and 3.4.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..fe.material import Material
from ..support.archive import Format
from ..support.arrays import Array
from ..support.checks import check_floats

_ROUND_OFF = 1e-12  # of the yield stress


@dataclass(frozen=True, eq=False)
class PlasticState:
    """What plastic flow has left behind at g points of a zone.

    Parameters
    ----------
    strain : (g, 6) array
        Plastic strain, deviatoric, in Mandel's notation.
    equivalent : (g,) array
        Equivalent plastic strain, the path of sqrt(2/3) times the length of the plastic strain.
    back : (g, 6) array
        Back stress [Pa], in Mandel's notation.
    """

    strain: Array
    equivalent: Array
    back: Array

    def save(self, path: str | Path) -> None:
        """Write to an npz file; `load` reads it.

        Parameters
        ----------
        path : str or Path
            Taken as it is, nothing is appended.

        Raises
        ------
        InputError
            If the folder does not exist, or `path` is one.
        """
        FILE.save(path, self)

    @classmethod
    def load(cls, path: str | Path) -> PlasticState:
        """Read a state that `save` wrote.

        Parameters
        ----------
        path : str or Path

        Raises
        ------
        InputError
            If the file is missing, damaged, or of another kind.
        """
        state: PlasticState = FILE.load(path)
        return state

    @classmethod
    def virgin(cls, points: int) -> PlasticState:
        """State of a material that has never yielded, at a number of `points`."""
        return cls(np.zeros((points, 6)), np.zeros(points), np.zeros((points, 6)))

    def __post_init__(self) -> None:
        if not self.strain.shape == self.back.shape == (*self.equivalent.shape, 6):
            raise InputError(
                "strain, equivalent, back: expected shapes (g, 6), (g,) and (g, 6), got "
                f"{self.strain.shape}, {self.equivalent.shape} and {self.back.shape}"
            )

    def copy(self) -> PlasticState:
        """State with arrays of its own."""
        return PlasticState(self.strain.copy(), self.equivalent.copy(), self.back.copy())

    def at(self, points: Array) -> PlasticState:
        """State of some points, (k,) int array."""
        return PlasticState(self.strain[points], self.equivalent[points], self.back[points])

    def changed(self, points: Array, new: PlasticState) -> PlasticState:
        """Return the state with a `new` one at some points, (k,) int array."""
        strain, equivalent, back = self.strain.copy(), self.equivalent.copy(), self.back.copy()
        strain[points], equivalent[points], back[points] = new.strain, new.equivalent, new.back
        return PlasticState(strain, equivalent, back)


FILE = Format("plastic state", 1, "SI (Pa), or the units of the body", (PlasticState,), packed=True)


class FlowTables(NamedTuple):
    """Numbers of a flow rule, for compiled loops.

    Parameters
    ----------
    shear_modulus, least, back_slope : float
        G, the excess of stress from which on a point flows, slope of the back stress [Pa].
    strain, stress : (k,) arrays
        Flow stress Y [Pa] by equivalent plastic strain a.
    slope : float
        Of the flow stress beyond the table [Pa].
    known : (k,) array
        Y + (3 G + H_k) a [Pa] by equivalent plastic strain.
    stiff, last_slope : float
        3 G + H_k, and the slope of `known` beyond the table [Pa].
    """

    shear_modulus: float
    least: float
    back_slope: float
    strain: Array
    stress: Array
    slope: float
    known: Array
    stiff: float
    last_slope: float


class Flow:
    """Flow rule of a material.

    Parameters
    ----------
    material : Material
        With `hardening`.
    """

    def __init__(self, material: Material) -> None:
        if material.hardening is None or material.yield_stress is None:
            raise InputError("material: it is elastic; give yield_stress= and hardening= to Material")
        self.shear_modulus = material.shear_modulus
        self.yield_stress = material.yield_stress
        self._back_slope = material.kinematic_hardening
        if isinstance(material.hardening, tuple):
            self._strain, self._stress = np.array(material.hardening).T.copy()  # each lies by itself
        else:
            self._strain = np.array([0.0, 1.0])
            self._stress = self.yield_stress + material.hardening * self._strain
        # At the end of a step, Y(a) + (3 G + H_k) a is known; this inverts it.
        self._stiff = 3 * self.shear_modulus + self._back_slope
        self._known = self._stress + self._stiff * self._strain
        self._last_slope = float(np.diff(self._known[-2:])[0] / np.diff(self._strain[-2:])[0])

    @cached_property
    def tables(self) -> FlowTables:
        """The numbers of this rule."""
        least, slope = _ROUND_OFF * self.yield_stress, self._last_slope - self._stiff
        yields = self._strain, self._stress, slope, self._known, self._stiff, self._last_slope
        return FlowTables(self.shear_modulus, least, float(self._back_slope), *yields)

    def flow_stress(self, equivalent: Array) -> Array:
        """Flow stress, (k,) [Pa], at equivalent plastic strains, (k,)."""
        slope = self._last_slope - self._stiff
        inside = np.interp(equivalent, self._strain, self._stress)
        return np.asarray(inside + slope * np.maximum(equivalent - self._strain[-1], 0.0))

    def stress(self, strain: Array, state: PlasticState) -> Array:
        """Deviatoric stress, (g, 6) [Pa], of deviatoric strains, (g, 6)."""
        stress: Array = 2 * self.shear_modulus * (strain - state.strain)
        return stress

    def excess(self, stress: Array, state: PlasticState) -> Array:
        """Von Mises stress beyond the flow stress, (g,) [Pa]: of deviatoric stresses, (g, 6), about the back stress."""
        return von_mises(stress - state.back) - self.flow_stress(state.equivalent)

    def of_strain(self, length: Array) -> Array:
        """Von Mises stress [Pa] of deviatoric strains of some length in Mandel's notation, if they are elastic."""
        value: Array = np.sqrt(6.0) * self.shear_modulus * length  # sqrt(3/2) 2 G |e|
        return value

    def answer(self, strain: Array, state: PlasticState) -> PlasticState:
        """State at the end of a step with these deviatoric strains, (g, 6); the same object if no point flows.

        Backward Euler: the trial stress returns radially to the yield surface.
        """
        trial = self.stress(strain, state)
        flows = np.flatnonzero(self.excess(trial, state) > _ROUND_OFF * self.yield_stress)
        if not flows.size:
            return state
        relative, before = trial[flows] - state.back[flows], state.equivalent[flows]
        length = np.sqrt(np.einsum("ki,ki->k", relative, relative))
        target = np.sqrt(1.5) * length + self._stiff * before
        after = np.interp(target, self._known, self._strain)
        after += np.maximum(target - self._known[-1], 0.0) / self._last_slope
        flow = (np.sqrt(1.5) * (after - before) / length)[:, None] * relative
        back = state.back[flows] + 2 / 3 * self._back_slope * flow
        return state.changed(flows, PlasticState(state.strain[flows] + flow, after, back))


def von_mises(stress: Array) -> Array:
    """Von Mises stress, (g,) [Pa], of deviatoric stresses in Mandel's notation, (g, 6)."""
    value: Array = np.sqrt(1.5 * np.einsum("gi,gi->g", stress, stress))
    return value


def validate_state(name: str, state: object, points: int) -> PlasticState:
    """Return a copy of a state that a user gave, if it is one of a zone with this number of points.

    Raises
    ------
    InputError
    """
    if not isinstance(state, PlasticState) or np.shape(state.equivalent) != (points,):
        given = f"{np.size(state.equivalent)} points" if isinstance(state, PlasticState) else type(state).__name__
        raise InputError(f"{name}: expected the PlasticState of a zone with {points} points, got {given}")
    check_floats("strain", state.strain, (points, 6))
    check_floats("equivalent", state.equivalent, (points,))
    check_floats("back", state.back, (points, 6))
    return state.copy()
