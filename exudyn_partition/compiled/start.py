"""Where an explicit run begins, stands or ends, as one value: all that later steps depend on."""

from __future__ import annotations

from dataclasses import dataclass

from ..contact.gaps import GapState
from ..support.arrays import Array
from .friction_plan import FrictionMemory
from .moving import Anchors


@dataclass(frozen=True, eq=False)
class Start:
    """A state in which a run begins, or from which it goes on.

    Parameters
    ----------
    q, v : (nq,) arrays
        Coordinates and velocities.
    a : (nq,) array, optional
        Accelerations at the end of an earlier run, from which this one goes on. Default: those that forces give.
    friction : FrictionMemory, optional
        What rows with friction remember. Default: nothing.
    turning : (nq,) array, optional
        Velocities by which bodies in floating frames grow at the start. Default: `v`.
    anchors : Anchors, optional
        Where contacts with rigid surfaces have found their flexibility. Default: nowhere.
    pairs : tuple of GapState, optional
        Of contacts of two bodies whose rows follow facets. Default: as they are placed.
    rubbing : Anchors, optional
        As `anchors`, of contacts with friction.
    rubbing_pairs : tuple of GapState, optional
        As `pairs`, of contacts with friction.
    """

    q: Array
    v: Array
    a: Array | None = None
    friction: FrictionMemory | None = None
    turning: Array | None = None
    anchors: Anchors | None = None
    pairs: tuple[GapState, ...] | None = None
    rubbing: Anchors | None = None
    rubbing_pairs: tuple[GapState, ...] | None = None
