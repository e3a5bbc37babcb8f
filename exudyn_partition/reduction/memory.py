"""Memory that a reduction will need, estimated before the work."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence

from ..algebra.krylov import columns
from ..errors import MemoryLimitError, MemoryWarning
from ..fe.model import FEModel
from ..fe.partition import Partition
from ..fe.patches import Patch
from ..support.machine import available_memory
from ..support.warn import warn
from .free_body import HUGE, found_on_demand

_LOG = logging.getLogger(__name__)

_GB = 1e9
# Numbers in factors and fronts while they are made, over n^(4/3): 22 to 24 for blocks and balls, 15 for a slender bar,
# 10 for a thin plate.
_FILL = 20
_FILL_OF_ZONE = 42  # numbers in the fronts of a plastic zone, which is compact: 40 to 45 for 800 to 3300 nodes
_BESIDE = 1.15  # peak with factors of a shifted matrix in single precision, by factors of the stiffness as estimated
_ROUNDED = 0.62  # factors of a huge body in single precision, with fronts in double precision: 0.59 to 0.7
_ENTRY = 12  # bytes of an entry of a sparse matrix and its index
_DENSE_BLOCKS = 5  # of right-hand sides at a time
_KRYLOV = 150  # vectors of a large Krylov space, with M times each and the room to grow
_SQUARES = 6  # dense matrices of the order of all patch rows at a time
_MATRICES = 4  # sparse matrices with the pattern of the stiffness at a time


def needed(models: Sequence[tuple[FEModel, Partition]], basis: str) -> float:
    """Estimated peak of memory beyond what is in use, to a factor of 1.5 for a contact-adapted basis [bytes].

    Bodies are reduced one after the other. Vectors of all bodies are kept, but only the factors of one.
    """
    at_work, kept, rows = 0.0, 0.0, 0
    for fem, partition in models:
        n, nodes = fem.n_dofs, len(partition.patch_nodes)
        huge = n >= HUGE and not any(patch.plastic for patch in partition.patches) and not found_on_demand(partition)
        factors = _factors(fem) * ((_ROUNDED if huge else _BESIDE) if basis == "contact-adapted" else 1.0)
        at_work = max(at_work, factors + 8.0 * n * _DENSE_BLOCKS * columns(n))
        kept += 8.0 * n * _KRYLOV
        if basis == "craig-bampton":  # the answer to every displacement of the boundary is a shape
            kept += 8.0 * n * 4 * 3 * nodes
        if basis != "free":  # which keeps the zones' nodes and needs no flexibility of them
            kept += sum(_zone(patch) for patch in partition.patches)
        if found_on_demand(partition):
            kept += 8.0 * _FILL * n ** (4 / 3)  # most of the factors stay
        else:
            rows += sum(len(patch.nodes) * patch.n_axes for patch in partition.patches)
    return at_work + kept + 8.0 * _SQUARES * rows**2


def _zone(patch: Patch) -> float:
    """Memory of the flexibility of a patch's plastic zone [bytes]."""
    n = 0 if patch.plastic is None else 3 * len(patch.plastic.nodes)
    return float(8 * (_FILL_OF_ZONE * n ** (4 / 3) + n * len(patch.nodes) * patch.n_axes))


def _factors(fem: FEModel) -> float:
    """Memory of the factors of a body while they are made [bytes]."""
    return float(8 * _FILL * fem.n_dofs ** (4 / 3) + _ENTRY * _MATRICES * fem.stiffness.nnz)


def fits_together(models: Sequence[tuple[FEModel, Partition]]) -> bool:
    """Whether the factors of all bodies may be kept beside what a reduction needs, in half of the free memory."""
    kept = sum(_factors(fem) for fem, _ in models)
    return kept + needed(models, "contact-adapted") < available_memory()[0] / 2


@contextlib.contextmanager
def watched(models: Sequence[tuple[FEModel, Partition]], basis: str) -> Iterator[None]:
    """Refuse, or warn of, a reduction that needs too much memory; a MemoryError during the work is named.

    Raises
    ------
    MemoryLimitError
        If the estimate is above all that this process may have, or memory runs out.

    Warns
    -----
    MemoryWarning
        If it is above what is free.
    """
    need, (free, most) = needed(models, basis), available_memory()
    _LOG.info("reduction: needs some %.3g GB, %.3g GB are free, %.3g GB in all", need / _GB, free / _GB, most / _GB)
    sizes = ", ".join(f"{fem.n_dofs} dofs with {len(partition.patch_nodes)} patch nodes" for fem, partition in models)
    remedy = (
        "Coarsen the mesh: three elements per contact radius are enough, and only near the patch (refine= of "
        "fe_model); or make the patch smaller (contact_radius= of the partition)"
    )
    if need > most:
        raise MemoryLimitError(
            f"fem: reducing {sizes} needs some {need / _GB:.3g} GB of memory; there are {most / _GB:.3g} GB. {remedy}"
        )
    if need > free:
        warn(
            f"fem: reducing {sizes} needs some {need / _GB:.3g} GB of memory; {free / _GB:.3g} GB are free. {remedy}",
            MemoryWarning,
        )
    try:
        yield
    except MemoryError as error:
        raise MemoryLimitError(
            f"fem: memory ran out while reducing {sizes}, which was estimated to need {need / _GB:.3g} GB. {remedy}"
        ) from error
