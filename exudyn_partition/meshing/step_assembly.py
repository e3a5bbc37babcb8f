"""Assemblies in STEP files: each solid by its name, in place."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from ..fe.patch_facets import show
from ..support.checks import validate_path, validate_positive, validate_text
from ..support.foreign import Shape
from .netgen_mesh import ONE_AT_A_TIME, center_of, is_shape, products_of, scaled, solids_alone
from .step_files import ENDINGS

_LOG = logging.getLogger(__name__)

_NO_NAME = re.compile(r"(Open CASCADE|Unnamed|Unknown|Untitled|NONE\b|COMPOUND\b|SOLID\b|$)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class StepAssembly:
    """The solids of a STEP file by their names, each where it stands in the assembly.

    Parameters
    ----------
    path : Path
        The file.
    solids : dict of str to netgen.occ.TopoDS_Shape
        Lengths in metres, if `scale` of `read_step` made them so. Alike parts have numbers: "bolt", "bolt.2".
    """

    path: Path
    solids: Mapping[str, Shape] = field(repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", validate_path("path", self.path))
        named = isinstance(self.solids, Mapping) and all(isinstance(name, str) for name in self.solids)
        if not named or not self.solids or not all(map(is_shape, self.solids.values())):
            raise InputError(f"solids: expected shapes of netgen.occ by their names, got {self.solids!r}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the solids, in the order of the file."""
        return tuple(self.solids)

    def find(self, name: str | None) -> Shape:
        """Shape of a solid by its name, or of the only one.

        Raises
        ------
        InputError
            If there is none of this name, or several and no name is given.
        """
        listed = ", ".join(map(repr, self.names[:12])) + (", ..." if len(self.names) > 12 else "")
        if name is None:
            if len(self.names) > 1:
                raise InputError(f"solid: expected one of {listed} in {self.path}, or ep.fe_models for several of them")
            name = self.names[0]
        if validate_text("solid", name) not in self.solids:
            raise InputError(f"solid: expected one of {listed} in {self.path}, got {name!r}")
        return self.solids[name]

    def __str__(self) -> str:
        lines = [f"{self.path}: {len(self.names)} solids"]
        for name, shape in self.solids.items():
            lines.append(f"  {name}: {abs(shape.mass):.4g} m3 around {show(center_of(shape))} m")
        return "\n".join(lines)


def read_step(path: str | Path, *, scale: float = 1.0) -> StepAssembly:
    """Read the solids of a file of STEP, IGES or BREP, before anything is meshed; of STEP all products and their parts.

    A solid has the name of its product. Where a product has several, they have their own names, or the product's with a
    number. Sketches, sheets and free edges beside solids are left out, and the log says so. `print` lists the solids
    with their volumes and places; `ep.fe_models` meshes them, `ep.fe_model(..., solid="rod")` one of them.

    Parameters
    ----------
    path : str or Path
    scale : float
        Factor on all lengths. Netgen reads STEP and IGES in millimetres: 1e-3 turns them into metres.

    Returns
    -------
    StepAssembly

    Raises
    ------
    InputError
        If it is no such file, or cannot be read.
    MeshError
        If it has no solid, or Netgen reads fewer than the file defines.
    MissingPackageError
    """
    path, scale = validate_path("path", path), validate_positive("scale", scale)
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"path: expected a file of STEP, IGES or BREP ({', '.join(ENDINGS)}), got {path}")
    with ONE_AT_A_TIME:
        solids: dict[str, Shape] = {}
        for name, shape in _named(products_of(path)):
            wanted, number = name, 1
            while name in solids:
                number += 1
                name = f"{wanted}.{number}"
            solids[name] = scaled(shape, scale)
    _LOG.info("%s: solids %s", path, ", ".join(solids))
    return StepAssembly(path, solids)


def _named(products: Iterable[tuple[str, Shape]]) -> Iterable[tuple[str, Shape]]:
    """Solids with their names."""
    for product, shape in products:
        own = list(shape.solids)
        given = "" if _NO_NAME.match(product) else product
        if len(own) == 1:
            name = given or own[0].name or "solid"
            # What belongs to no solid is told once, for the product.
            yield name, next(iter(solids_alone(shape, f"{name!r}").solids))
            continue
        for number, solid in enumerate(own, 1):
            plain = solid.name or ""
            name = plain if not _NO_NAME.match(plain) and plain != product else f"{given or 'solid'}.{number}"
            yield name, solid
