"""Names of the package for checkers of types and editors; `__init__.py` imports the same ones on first use."""

from . import errors, reference
from ._version import __version__ as __version__
from .accuracy.design import design_impact
from .accuracy.impact_design import ImpactDesign
from .accuracy.mesh_error import mesh_error
from .accuracy.total_error import with_mesh_error
from .algebra.coulomb import Coulomb
from .contact.profile import RigidProfile
from .contact.rigid import RigidCylinder, RigidPlane, RigidSphere
from .contact.rigid_mesh import RigidMesh
from .exudyn_bodies.create_body import CreatePartitionBody
from .exudyn_bodies.item_work import CreateWorkSensor, WorkSensor
from .exudyn_bodies.partition_body import PartitionBody
from .exudyn_bodies.surface_loads import CreateDistributedLoad
from .exudyn_contacts.create_contact import CreatePartitionContact
from .exudyn_contacts.friction_results import FrictionResults
from .exudyn_contacts.partition_contact import PartitionContact
from .exudyn_contacts.plastic_results import PlasticResults
from .fe.material import ALUMINIUM, STEEL, Material
from .fe.model import FEModel
from .fe.partition import Partition
from .frames.damping import Rayleigh
from .meshing.feminterface import from_feminterface
from .meshing.file_bodies import FileBodies
from .meshing.matrix_files import FileMatrices, read_matrices
from .meshing.mesh_files import read_bodies
from .meshing.mesh_size import Refine
from .meshing.netgen_mesh import generate_mesh
from .meshing.ngsolve_fem import fe_model, fe_models
from .meshing.step_assembly import StepAssembly, read_step
from .plasticity.flow import PlasticState
from .prediction import hertz
from .prediction.spectrum import amplitude_spectrum, truncation_frequency
from .present import output, plot, pyvista_view, view
from .present.view import CreatePartitionView
from .reduction import recovery
from .reduction.body import ReducedBody, load_body
from .reduction.estimate import Estimate
from .reduction.recovery import StrainGauge
from .reduction.reduction import reduce, reduce_pair
from .results import compare as report
from .results.compare import Comparison, compare, versions
from .results.history import History
from .simulation.collect import collect
from .simulation.modes import natural_modes
from .simulation.result import Result
from .simulation.settling import settle
from .simulation.solve import solve_dynamic
from .simulation.stability import stability_limit
from .simulation.statics import solve_static
from .simulation.step_control import time_to_contact
from .studies.many_runs import ManyRuns, run_many
from .studies.points import sample_parameters
from .studies.restitution_law import RestitutionLaw
from .studies.restitution_map import restitution_map
from .studies.restitution_values import RestitutionMap
from .studies.sensitivity import Sensitivity, sensitivity
from .studies.study import study
from .studies.study_values import Study
from .support.progress import progress

__all__ = [
    "ALUMINIUM",
    "STEEL",
    "Comparison",
    "Coulomb",
    "CreateDistributedLoad",
    "CreatePartitionBody",
    "CreatePartitionContact",
    "CreatePartitionView",
    "CreateWorkSensor",
    "Estimate",
    "FEModel",
    "FileBodies",
    "FileMatrices",
    "FrictionResults",
    "History",
    "ImpactDesign",
    "ManyRuns",
    "Material",
    "Partition",
    "PartitionBody",
    "PartitionContact",
    "PlasticResults",
    "PlasticState",
    "Rayleigh",
    "ReducedBody",
    "Refine",
    "RestitutionLaw",
    "RestitutionMap",
    "Result",
    "RigidCylinder",
    "RigidMesh",
    "RigidPlane",
    "RigidProfile",
    "RigidSphere",
    "Sensitivity",
    "StepAssembly",
    "StrainGauge",
    "Study",
    "WorkSensor",
    "amplitude_spectrum",
    "collect",
    "compare",
    "design_impact",
    "errors",
    "fe_model",
    "fe_models",
    "from_feminterface",
    "generate_mesh",
    "hertz",
    "load_body",
    "mesh_error",
    "natural_modes",
    "output",
    "plot",
    "progress",
    "pyvista_view",
    "read_bodies",
    "read_matrices",
    "read_step",
    "recovery",
    "reduce",
    "reduce_pair",
    "reference",
    "report",
    "restitution_map",
    "run_many",
    "sample_parameters",
    "sensitivity",
    "settle",
    "solve_dynamic",
    "solve_static",
    "stability_limit",
    "study",
    "time_to_contact",
    "truncation_frequency",
    "versions",
    "view",
    "with_mesh_error",
]
