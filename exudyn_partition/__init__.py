"""Partitioned flexible bodies with trustworthy contact for Exudyn.

The way of a model, each step with what it takes from the one before::

    fem = ep.fe_model(shape_or_file, ep.STEEL, maxh=6e-3, refine=[ep.Refine(point, radius, h)])
    part = ep.Partition.ball(fem, point, radius)  # | ep.Partition.interface(fem, "pin", nodes="bore")
    body = ep.reduce(fem, part, f_cut=40e3)  # or tolerance=1e-2; ep.reduce_pair for two
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -1])
    contact = ep.CreatePartitionContact(mbs, item, other)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-3)
    force, velocity = contact.force(result), item.velocity(result, point)
    result.report("run.html")

Around it: `hertz` (estimates before any mesh), `recovery` (strain, stress), `plot`, `output` (ParaView), `view`
(Exudyn's renderer), `pyvista_view`, `reference` (the full FE model), `compare`, `errors`. Units are SI: m, kg, s, N,
Pa, Hz, rad.

Names are imported on first use, so that importing the package is instant and needs neither Exudyn nor NGSolve.
"""

from __future__ import annotations

import importlib

from ._version import __version__ as __version__

_HOMES = {
    "fe.material": ("Material", "STEEL", "ALUMINIUM"),
    "meshing.feminterface": ("from_feminterface",),
    "meshing.file_bodies": ("FileBodies",),
    "meshing.matrix_files": ("FileMatrices", "read_matrices"),
    "meshing.mesh_files": ("read_bodies",),
    "meshing.mesh_size": ("Refine",),
    "meshing.netgen_mesh": ("generate_mesh",),
    "meshing.ngsolve_fem": ("fe_model", "fe_models"),
    "meshing.step_assembly": ("StepAssembly", "read_step"),
    "fe.model": ("FEModel",),
    "fe.partition": ("Partition",),
    "plasticity.flow": ("PlasticState",),
    "reduction.body": ("ReducedBody", "load_body"),
    "reduction.reduction": ("reduce", "reduce_pair"),
    "reduction.estimate": ("Estimate",),
    "accuracy.design": ("design_impact",),
    "accuracy.impact_design": ("ImpactDesign",),
    "accuracy.mesh_error": ("mesh_error",),
    "accuracy.total_error": ("with_mesh_error",),
    "reduction.recovery": ("StrainGauge",),
    "frames.damping": ("Rayleigh",),
    "algebra.coulomb": ("Coulomb",),
    "exudyn_bodies.create_body": ("CreatePartitionBody",),
    "exudyn_bodies.partition_body": ("PartitionBody",),
    "exudyn_bodies.surface_loads": ("CreateDistributedLoad",),
    "exudyn_bodies.item_work": ("CreateWorkSensor", "WorkSensor"),
    "contact.profile": ("RigidProfile",),
    "contact.rigid_mesh": ("RigidMesh",),
    "contact.rigid": ("RigidCylinder", "RigidPlane", "RigidSphere"),
    "exudyn_contacts.create_contact": ("CreatePartitionContact",),
    "exudyn_contacts.partition_contact": ("PartitionContact",),
    "exudyn_contacts.friction_results": ("FrictionResults",),
    "exudyn_contacts.plastic_results": ("PlasticResults",),
    "simulation.step_control": ("time_to_contact",),
    "simulation.result": ("Result",),
    "simulation.collect": ("collect",),
    "simulation.modes": ("natural_modes",),
    "simulation.solve": ("solve_dynamic",),
    "simulation.settling": ("settle",),
    "simulation.statics": ("solve_static",),
    "simulation.stability": ("stability_limit",),
    "results.history": ("History",),
    "prediction.spectrum": ("amplitude_spectrum", "truncation_frequency"),
    "present.view": ("CreatePartitionView",),
    "support.progress": ("progress",),
    "studies.points": ("sample_parameters",),
    "studies.study": ("study",),
    "studies.study_values": ("Study",),
    "studies.many_runs": ("ManyRuns", "run_many"),
    "studies.sensitivity": ("Sensitivity", "sensitivity"),
    "studies.restitution_map": ("restitution_map",),
    "studies.restitution_values": ("RestitutionMap",),
    "studies.restitution_law": ("RestitutionLaw",),
    "results.compare": ("Comparison", "compare", "versions"),
}
_MODULES = {
    "errors": "errors",
    "hertz": "prediction.hertz",
    "output": "present.output",
    "plot": "present.plot",
    "pyvista_view": "present.pyvista_view",
    "recovery": "reduction.recovery",
    "reference": "reference",
    "report": "results.compare",
    "view": "present.view",
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = sorted([*_HOME_OF, *_MODULES])


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return importlib.import_module(f".{_MODULES[name]}", __name__)
    if name in _HOME_OF:
        return getattr(importlib.import_module(f".{_HOME_OF[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
