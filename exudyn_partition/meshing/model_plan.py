"""What `fe_model` is asked for, checked and resolved: a shape to mesh, a mesh as it is, or the mesh of a file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..fe.material import Material
from ..support.checks import validate_flag, validate_integer, validate_number, validate_path, validate_positive
from ..support.foreign import NGSolveMesh, Shape
from .deck_materials import material_of_deck
from .file_bodies import FileBodies
from .materials import GivenMaterial, Modulus
from .mesh_files import DECKS, WITH_OTHERS, VolumeMesh, check_order, raised, read_bodies, volume_mesh
from .mesh_size import Refine, first_size
from .netgen_mesh import (
    GRADING,
    ONE_AT_A_TIME,
    check_one_part,
    is_mesh,
    is_shape,
    measured,
    regions_of,
    scaled,
    solids_alone,
    step_shape,
)
from .step_assembly import StepAssembly, read_step
from .step_files import ENDINGS


@dataclass(frozen=True, eq=False)
class ShapePlan:
    """A shape of one connected part that is to be meshed, in metres.

    Parameters
    ----------
    shape : netgen.occ.TopoDS_Shape
        Its solids alone.
    given : GivenMaterial
        One for each solid.
    order : {1, 2, 3}
        Of the elements.
    maxh : float
        Largest element size [m].
    refine : tuple of Refine
    grading : float
        See `generate_mesh`, which checks it.
    """

    shape: Shape
    given: GivenMaterial
    order: int
    maxh: float
    refine: tuple[Refine, ...]
    grading: float


@dataclass(frozen=True, eq=False)
class MeshPlan:
    """A mesh of NGSolve that is taken as it is.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    given : GivenMaterial
    order : {1, 2, 3}
        Of the elements.
    """

    mesh: NGSolveMesh
    given: GivenMaterial
    order: int


@dataclass(frozen=True, eq=False)
class FilePlan:
    """The mesh of a file.

    Parameters
    ----------
    path : Path
        For messages.
    file : VolumeMesh
        In metres.
    given : GivenMaterial
        The deck's own, if the user gave none.
    order : {1, 2, 3} or None
        Of the elements, as the user wants them; None for that of the file.
    """

    path: Path
    file: VolumeMesh
    given: GivenMaterial
    order: int | None

    @property
    def raised_to(self) -> int | None:
        """Order that linear tetrahedra of the file are raised to, None if they stay as they are."""
        return self.order if self.file.order == 1 and self.order in (2, 3) else None


ModelPlan = ShapePlan | MeshPlan | FilePlan


def plan_model(
    source: Shape | NGSolveMesh | StepAssembly | FileBodies | str | Path,
    material: Material | Mapping[str, Material] | None,
    *,
    modulus: Modulus | None,
    order: int | None,
    maxh: float | None,
    refine: Iterable[Refine],
    grading: float,
    scale: float,
    only_solids: bool,
    solid: str | None,
) -> ModelPlan:
    """Check the arguments of `fe_model`, read what they name, and return what there is to assemble.

    Raises
    ------
    InputError, MeshError, MissingPackageError

    Warns
    -----
    MeshQualityWarning
        If a file holds linear tetrahedra and no order is given.
    """
    if order is not None and validate_integer("order", order) not in (1, 2, 3):
        raise InputError(f"order: expected 1, 2 or 3, got {order!r}")
    given = None if material is None else GivenMaterial(material, modulus)
    validate_flag("only_solids", only_solids)
    scale = validate_positive("scale", scale)
    path = _path_of(source)
    from_shape = path.suffix.lower() in ENDINGS if path else not is_mesh(source)
    is_deck = path is not None and path.suffix.lower() in DECKS
    if given is None and not is_deck:
        raise InputError("material: expected an ep.Material, such as ep.STEEL, got None; only decks have their own")
    if solid is not None and not (path or isinstance(source, StepAssembly)):
        raise InputError("solid: has no effect here, it is for files and what ep.read_step or ep.read_bodies returns")
    has_others = path is not None and path.suffix.lower() in WITH_OTHERS and not isinstance(source, FileBodies)
    if only_solids and not has_others:
        raise InputError("only_solids: has no effect here, it is for input decks and universal files")
    if from_shape:
        assert given is not None
        return _plan_shape(_shape_of(source, path, solid), given, order or 2, maxh, refine, grading, scale)
    if path:
        bodies = source if isinstance(source, FileBodies) else read_bodies(path, only_solids=only_solids)
        bodies = replace(bodies, scale=scale * bodies.scale)
        plan: ModelPlan = _plan_file(bodies, solid, given, modulus, order)
    else:
        assert given is not None
        plan = MeshPlan(source, given, order or 2)
    refuse_mesh_options(maxh, refine, grading)
    if not path and scale != 1:
        raise InputError(f"scale: a mesh is taken as it is, got {scale:g}; scale its shape before meshing")
    return plan


def _path_of(source: object) -> Path | None:
    """Path of a file; None for a shape, mesh or STEP assembly."""
    if isinstance(source, FileBodies):
        return source.path
    if isinstance(source, StepAssembly) or is_mesh(source) or is_shape(source):
        return None
    if not isinstance(source, str | Path):
        raise InputError(
            "source: expected an OCC shape of netgen.occ, an ngsolve.Mesh, what ep.read_step or ep.read_bodies "
            f"returns, or the path of a STEP or mesh file, got {type(source).__name__}"
        )
    return validate_path("source", source)


def _shape_of(source: Shape | StepAssembly | str | Path, path: Path | None, solid: str | None) -> Shape:
    """Shape to mesh."""
    with ONE_AT_A_TIME:
        if isinstance(source, StepAssembly):
            return source.find(solid)
        if path is None:
            return source
        return step_shape(path) if solid is None else read_step(path).find(solid)


def _plan_shape(
    shape: Shape,
    given: GivenMaterial,
    order: int,
    maxh: float | None,
    refine: Iterable[Refine],
    grading: float,
    scale: float,
) -> ShapePlan:
    with ONE_AT_A_TIME:
        shape = scaled(solids_alone(shape), scale)
        if maxh is None:
            first = first_size(*measured(shape))
            raise InputError(f"maxh: a shape needs a largest element size [m]; {first:.2g} m would do for a first look")
        check_one_part(shape)
        given.check("shape", "solids", [solid.name or "default" for solid in shape.solids])
        maxh = validate_positive("maxh", maxh, "m")
        return ShapePlan(shape, given, order, maxh, tuple(regions_of(refine)), grading)


def _plan_file(
    bodies: FileBodies, solid: str | None, given: GivenMaterial | None, modulus: Modulus | None, order: int | None
) -> FilePlan:
    file = volume_mesh(bodies, solid, several=given is None or given.several)
    if given is None:
        names = [file.regions.names[i] or "" for i in np.unique(file.regions.number)]
        given = GivenMaterial(material_of_deck(bodies.path, file.materials, names, bodies.scale), modulus)
    check_order(bodies.path, file, order)
    if file.hexahedra and file.order == 1 and order == 2:
        file = raised(file)
    return FilePlan(bodies.path, file, given, order)


def refuse_mesh_options(maxh: object, refine: object, grading: object) -> None:
    """Refuse options that have no effect on a mesh."""
    named = {"maxh": maxh is not None, "grading": validate_number("grading", grading) != GRADING}
    named["refine"] = bool(regions_of(refine))
    given = [name for name, is_given in named.items() if is_given]
    if given:
        raise InputError(
            f"{', '.join(given)}: a mesh is taken as it is, so that this would have no effect. Mesh it finer where it "
            "was made, or give its shape or STEP file"
        )
