"""Objects that compiled steps take of contacts with friction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba.experimental import structref

from ..support.arrays import Array
from ..support.compiled import compiled
from ..support.struct_kernels import StructType, define_struct

if TYPE_CHECKING:
    from ..algebra.friction_kernels import FrictionLimits, FrictionObject
    from ..contact.linear_gaps import FlatRows
    from .friction_plan import Choosing
    from .moving import MovingState, Surfaces
    from .pair_kernels import Pairs


@structref.register
class FrictionType(StructType):
    """Type of `Friction` in compiled loops."""


class Friction(structref.StructRefProxy):
    """All contacts with friction of a run as one object: rows, memory and state, see `friction_plan`.

    `rows` is a `kernels.RowsObject`, `pool` has the problems of all groups, `problem` the one at hand.
    """

    rows: FlatRows
    pool: FrictionObject
    problem: FrictionObject
    ways: Array
    numbers: Array
    tangents: Array
    groups: Array
    flexible: Array
    F_starts: Array
    frictional: Array
    forces: Array
    before: Array
    slipped: Array
    speed: Array
    path: Array
    dissipated: Array
    tractions: Array
    coulomb: Array
    gap: Array
    pushed: Array
    way: Array
    lam: Array
    status: Array
    slips: Array
    energy: Array
    mu: Array
    near: Array
    chosen: Array
    owner: Array
    fresh: Array
    h: Array
    mu_near: Array
    moved: Array
    taken: Array
    values: Array
    friction: Array
    stored: Array
    iterations: Array
    limits: FrictionLimits
    choosing: Choosing


define_struct(Friction, FrictionType, [*Friction.__annotations__])


@compiled
def friction_of(*fields: Any) -> Friction:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return Friction(*fields)  # type: ignore[no-untyped-call]


@structref.register
class RubsType(StructType):
    """Type of `Rubs` in compiled loops."""


class Rubs(structref.StructRefProxy):
    """`Rubbing` and `RubbingState` as one object, with that state of the run by which bodies grow.

    Where there are no rigid surfaces, or no pairs of two bodies, `surfaces` or `pairs` is None.
    """

    moving: MovingState
    surfaces: Surfaces
    pairs: Pairs
    groups: Array
    first_axis: Array
    same: Array
    links: Array
    cores: Array
    fields: Array
    n_fields: int
    normals: Array
    place: Array
    before: Array
    nodes: Array
    nodes_from: Array
    axes_before: Array
    growing_before: Array
    axes: Array
    axis: Array
    anchored: Array
    anchors: Array
    along: Array
    growing: Array
    found_axis: Array
    fresh: Array
    lost: Array
    left: Array
    left_at: Array
    numbers: Array


define_struct(Rubs, RubsType, [*Rubs.__annotations__])


@compiled
def rubs(*fields: Any) -> Rubs:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return Rubs(*fields)  # type: ignore[no-untyped-call]
