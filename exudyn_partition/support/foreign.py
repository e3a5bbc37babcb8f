"""Names for values of packages that have no types, or are imported only when they are needed.

A checker of types knows nothing of them; the names tell a reader what they are.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_Unknown = Any

# Exudyn.
Exudyn = _Unknown  # the module itself, or its itemInterface
SystemContainer = _Unknown
MainSystem = _Unknown
MainSolver = _Unknown
SimulationSettings = _Unknown
ItemIndex = _Unknown  # a number of any kind of item; those of one kind follow
NodeIndex = _Unknown
ObjectIndex = _Unknown
MarkerIndex = _Unknown
LoadIndex = _Unknown
SensorIndex = _Unknown
ItemEntry = dict[str, _Unknown]  # what Exudyn tells of an item, by its own keys
Coordinates = _Unknown  # what Exudyn hands to a user function: a list of numbers
MatrixContainer = _Unknown
FEMinterface = _Unknown  # exudyn.FEM.FEMinterface
UserFunction = Callable[..., _Unknown]  # what Exudyn calls in a step

# NGSolve and Netgen.
NGSolve = _Unknown  # the module itself
Shape = _Unknown  # netgen.occ.TopoDS_Shape
ShapeSurface = _Unknown  # of a face of a shape
ShapeAssembly = _Unknown  # netgen.occ.OCCAssemblyNode
NGSolveMesh = _Unknown  # ngsolve.Mesh
NGSolveObject = _Unknown  # a vector, matrix or coefficient function

# Others.
MeshioMesh = _Unknown  # meshio.Mesh
Meshio = _Unknown  # meshio itself
Axes = _Unknown  # matplotlib.axes.Axes
Figure = _Unknown  # matplotlib.figure.Figure
Plotter = _Unknown  # pyvista.Plotter
PolyData = _Unknown  # pyvista.PolyData
Actor = _Unknown  # pyvista.Actor
DataFrame = _Unknown  # pandas.DataFrame
Dataset = _Unknown  # xarray.Dataset
DaskClient = _Unknown  # distributed.Client
SecondOrderModel = _Unknown  # pymor.models.iosys.SecondOrderModel
ProgressBar = _Unknown  # rich.progress.Progress
JSON = _Unknown  # a value in the types of JSON, from a file
