"""The wrong calls of `misuse.py` as tables: all public functions, with the kinds of values that their arguments take.

`CALLS` has everything that `public()` of `misuse.py` finds in the package, except `NOT_CALLED`, which says why these
need no check. An argument is of the kind that `ARGUMENTS` has for its name. An entry of `CALLS` has only what differs:
another kind, or another right value of the same kind. A method is called of what `OBJECTS` has for its class, if its
entry has no `self`. So a new public name takes one entry.
"""

from dataclasses import replace

import netgen.occ as occ
import numpy as np
import scipy.sparse as sp

import exudyn_partition as ep
from exudyn_partition.contact.formulations.choices import Penalty
from validation.stability import misuse_values as v
from validation.stability.misuse_objects import STEP, Made, Scene, file, the
from validation.stability.misuse_values import Kind


def each(names, entry, of=""):
    """The same entry for several names, which spaces divide."""
    return {of + name: entry for name in names.split()}


PLANE = Made(lambda s: ep.RigidPlane())
AXIS = v.positive.but(
    "None", "list", "one in an array", "zero", empty=[], twice=[1.0, 1.0], ragged=[1.0, [1.0]], holed=[1.0, v.nan]
)
RUNNABLE = v.mbs.but(**{"not assembled": Made(lambda s: s.model()[0]), "empty": Made(Scene.empty)})(
    Made(Scene.assembled)
)
MOTION_OF_BOTH = v.motion(Made(lambda s: np.zeros(s.body.n_dofs + s.other_body.n_dofs)))
_t, _x = np.linspace(0, 1, 101), np.sin(np.linspace(0, np.pi, 101)) ** 2


def _dofs(scene):
    """What each row of the upper bar's matrices is."""
    return np.column_stack(np.divmod(np.arange(scene.fem.n_dofs), 3))


OF_A_MODEL = dict(
    points=Kind(
        {
            **v.NOTHING,
            "twice": Made(lambda s: 2 * s.fem.points),
            "some": Made(lambda s: s.fem.points[:-1]),
            "in another order": Made(lambda s: s.fem.points[::-1]),
            "masked": Made(lambda s: np.ma.array(s.fem.points, mask=s.fem.points > 0.02)),
            "of a unit": Made(lambda s: v.WithUnit.of(s.fem.points)),
        },
        the.fem.points,
    ),
    mass=v.matrix("mass"),
    stiffness=v.matrix("stiffness"),
    material=v.material.but(aluminium=ep.ALUMINIUM, **{"other nu": ep.Material(E=210e9, nu=0.29, rho=7800.0)}),
    boundaries=Kind(
        {
            "None": None,
            "text": "x",
            "list": ["top"],
            "no names": {1: np.arange(3)},
            "beyond": {"top": np.array([10**6])},
            "halves": {"top": np.array([0.5])},
            "names of names": {"top": "x"},
        },
        {"top": np.arange(3)},
    ),
)
ARGUMENTS = {
    # What the library makes
    "mbs": v.mbs,
    "material": v.material,
    "material_1": v.material,
    "material_2": v.material.or_none,
    "fem": v.fem,
    "partition": v.part,
    "body": v.body,
    "contact": v.contact.or_none.but(**v.foreign_contact),
    "result": v.result,
    "run": v.run,
    "runs": v.runs.but("dict"),
    "reference": v.history.or_none,
    "bodies": Kind(
        {
            "text": "x",
            "number": 1,
            "empty": [],
            "bodies": Made(lambda s: [s.body]),
            "dict": {1: 2},
            "an item": 5,
            "pair of text": Made(lambda s: [(s.item, "x")]),
            "Nones": [None],
            "triple": Made(lambda s: [(s.item, s.fem, 1)]),
            "other fem": Made(lambda s: [(s.item, s.part)]),
            "fem of another material": Made(lambda s: [(s.item, s.softer)]),
            "foreign": Made(lambda s: [s.foreign.item]),
        }
    ),
    "contacts": Kind(
        {
            "text": "x",
            "number": 1,
            "items": Made(lambda s: [s.item]),
            "Nones": [None],
            "foreign": Made(lambda s: [s.foreign.contact]),
        }
    ),
    # Numbers
    **each("speed radius period", v.positive),
    **each("duration sample_period decay within end gap_tolerance unresolved", v.positive.or_none),
    "velocity_tolerance": v.positive.or_none.but(loose=0.01),
    **each("radius_1 radius_2", v.radius_of_two),
    **each("alpha beta", v.number.but(negative=-1.0)),
    "maxh": v.positive(8e-3),
    "scale": v.scale,
    "grading": v.positive.but(**{"1e-6": 1e-6, "5": 5.0})(0.3),
    "tolerance": v.share.but(zero=0.0)(0.01),
    "friction": v.friction(None),
    "time": v.number.or_none.but(beyond=1.0, negative=-1.0)(STEP),
    "times": v.times(2),
    "frames": v.times.but(one=1, beyond_all=10**6)(2),
    # Places
    **each("point center position rotation referencePosition initialVelocity", v.vector),
    **each("initialAngularVelocity gravity loadVector velocity", v.vector),
    **each(
        "referenceRotation referenceRotationMatrix rotationMatrixRef",
        Kind(
            {
                "text": "x",
                "vector": (0, 0, 0),
                "mirror": -np.eye(3),
                "zeros": np.zeros((3, 3)),
                "nan": np.full((3, 3), v.nan),
            }
        ),
    ),
    "axis": v.direction,
    "direction": v.direction((1.0, -1.0, 1.0)),
    "points": v.points([(0, 0, 5e-3)]),
    "cylinder": Kind({"text": "x", "number": 1, "pair": ((0, 0, 0), 1.0), "no axis": ((0, 0, 0), (0, 0, 0), 1.0)}),
    "plane": Kind({"text": "x", "number": 1, "one": ((0, 0, 0),), "no normal": ((0, 0, 0), (0, 0, 0))}),
    "near": Kind({"text": "x", "number": 1, "pair": (0, 0), "nan": (v.nan, 0, 0)}),
    # Arrays
    "t": v.samples.but(descending=_t[::-1], uneven=_t**2, two=[0.0, 1.0])(_t),
    "x": v.samples.but(**{"another length": _x[:50], "infinite": np.full(101, np.inf)})(_x),
    "rows": Kind({**v.NOTHING, "array": np.zeros(3), "of another mesh": sp.csr_matrix((1, 3))})(
        Made(lambda s: sp.csr_matrix((1, s.fem.n_dofs)))
    ),
    "q": v.motion(Made(lambda s: np.zeros((1, s.body.n_dofs)))),
    "displacement": v.motion(Made(lambda s: np.zeros((s.fem.n_nodes, 3)))),
    # Names and paths
    **each("name title", v.text("")),
    **each("patch slavePatch masterPatch", v.patch),
    "patches": v.patches.but(rigid=(0, 0)),
    "interface": v.choice("pin"),
    "quantity": v.choice("force"),
    "window": v.choice("none"),
    "field": v.choice("velocity"),
    "colour": v.choice("speed"),
    "path": v.path_out,
    "folder": v.folder,
    "cache": v.path_out.but("folder", "no folder", "/proc", "pipe", "400 characters", "device")(False),
    # The rest
    **each("showMarkers verbose superElement bodyFixed hollow inside correct load_factor", v.flag),
    **each("update_initial slipping signs", v.flag),
    **each("go_on adaptive static_answer geometric_stiffness skin", v.flag),
    **each("progress loadUserFunction loadVectorUserFunction", v.function),
    "refine": Kind({"text": "x", "number": 1, "tuples": [((0, 0, 0), 1, 1)], "Nones": [None]}, ()),
    "settings": Kind({"text": "x", "number": 1, "dict": {}, "a model": the.mbs}),
    "axes": Kind({"text": "x", "number": 1, "a result": the.result, "list": []}),
    "limits": Kind({"text": "x", "one": [1], "descending": (2, 1), "equal": (1, 1), "nan": (0, v.nan), "number": 1}),
    "size": Kind(
        {
            **v.NOTHING,
            "one": (1,),
            "negative": (-1, 5),
            "halves": (1.5, 2.5),
            "huge": (10**6, 10**6),
            "nan": (v.nan, 1),
        },
        (32, 24),
    ),
}
OBJECTS = {
    "FEModel": the.fem,
    "FileMatrices": Made(lambda s: ep.read_matrices(s.matrix_files())),
    "StepAssembly": the.assembly,
    "FileBodies": the.bodies,
    "Partition": the.part,
    "ReducedBody": the.body,
    "PartitionBody": the.item,
    "PartitionContact": the.contact,
    "FrictionResults": the.sticking.of.friction,
    "PlasticResults": the.yielding.of.plastic,
    "WorkSensor": the.working.of,
    "PlasticState": the.plastic_state,
    "Result": the.result,
    "History": the.history,
    "RestitutionMap": the.map,
    "hertz.HertzImpact": Made(lambda s: ep.hertz.impact(1.0, 1.0, 1.0, 1.0, ep.STEEL)),
    "recovery.StaticAnswer": Made(lambda s: ep.recovery.StaticAnswer(s.fem, s.body)),
}
CALLS = {
    "Material": dict(
        E=v.positive(1e9),
        nu=v.number.but(half=0.5, **{"minus one": -1.0})(0.3),
        rho=v.positive(1e3),
        yield_stress=v.positive.or_none.but(MPa=355.0)(355e6),
        hardening=v.number.or_none.but(negative=-1.0, text="x", short=[(0.0, 355e6)], softening=[(0, 355e6), (1, 1e6)]),
        kinematic_hardening=v.number.but(negative=-1.0)(0.0),
    ),
    "Rayleigh": {},
    "Coulomb": dict(static=v.friction(0.3), kinetic=v.number.or_none.but(negative=-0.1, larger=0.4)),
    "Refine": dict(h=v.positive(1e-4), long_axis=v.direction.or_none.but(shorter=(1e-4, 0.0, 0.0))),
    "generate_mesh": dict(shape=v.own("shape")),
    "fe_model": dict(
        source=v.path_in(the.shape),
        modulus=v.function.but(
            **{"too few": lambda x: x[:1, 0], "negative": lambda x: -abs(x[:, 0]), "text of it": len}
        ),
        order=v.count.or_none.but(four=4),
        scale=v.positive,
        only_solids=v.flag.but(**{"of a shape": True}),
        solid=Kind({"of a shape": "block", "number": 1}),
    ),
    "read_step": dict(path=v.path_in(file("block.step")), scale=v.positive),
    "StepAssembly": dict(
        path=Kind({"number": 1, "list": []}, file("block.step")),
        solids=Kind(
            {**v.NOTHING, "number": 1, "text": "x", "a shape": the.shape, "text in it": {"rod": "x"}},
            Made(lambda s: {"rod": s.shape}),
        ),
    ),
    "StepAssembly.find": dict(name=Kind({"unknown": "rod", "number": 1, "list": ["solid"]})),
    "read_bodies": dict(
        source=v.path_in(file("block.vtu")), scale=v.positive, only_solids=v.flag.but(**{"of VTU": True})
    ),
    "FileBodies": dict(
        path=Kind({"number": 1, "list": []}, file("block.vtu")),
        file=Kind({**v.NOTHING, "text": "x", "a model": the.fem}, Made(lambda s: s.bodies.file)),
        scale=v.positive,
    ),
    "FileBodies.rows": dict(name=Kind({"unknown": "rod", "number": 1, "list": ["body"]}, "body")),
    "fe_models": dict(
        assembly=Kind({**v.NOTHING, "a shape": the.shape, "a path": file("block.step"), "a list": []}, the.assembly),
        materials=Kind(
            {**v.NOTHING, "a material": ep.STEEL, "unknown": {"rod": ep.STEEL}, "text in it": {"solid": "steel"}},
            {"solid": ep.STEEL},
        ),
        maxh=v.positive.but(**{"of another": {"rod": 1e-2}})(1e-2),
        refine=Kind({"number": 1, "text": "x", "far away": [ep.Refine((9, 9, 9), 1e-3, 1e-3)]}, ()),
        order=v.count.or_none.but(four=4),
    ),
    "FEModel": dict(
        **OF_A_MODEL,
        cells=Kind(
            {
                **v.NOTHING,
                "halves": Made(lambda s: s.fem.cells + 0.5),
                "from 1": Made(lambda s: s.fem.cells + 1),
                "one missing": Made(lambda s: s.fem.cells[1:]),
                "one twice": Made(lambda s: np.vstack([s.fem.cells[1:], s.fem.cells[1:2]])),
                "mirrored": Made(lambda s: s.fem.cells[:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]),
                "of another mesh": Made(lambda s: s.fem.cells[:, ::-1]),
                "corners alone": Made(lambda s: s.fem.cells[:, :4]),
            },
            the.fem.cells,
        ),
        cell_mass=v.samples.but(
            **{
                "times 1000": Made(lambda s: 1000 * s.fem.cell_mass),
                "some": Made(lambda s: s.fem.cell_mass[1:]),
                "negative": Made(lambda s: -s.fem.cell_mass),
                "of others": Made(lambda s: np.roll(s.fem.cell_mass, 1) * np.where(np.arange(len(s.fem.cells)), 1, 2)),
            }
        )(the.fem.cell_mass),
        regions=Kind({"text": "x", "a material": ep.STEEL, "numbers": np.arange(3)}),
        surface=Kind({"text": "x", "number": 1, "of cells": the.fem.facets}),
        hexahedra=v.flag,
    ),
    "FEModel.from_matrices": dict(
        **{**OF_A_MODEL, "boundaries": OF_A_MODEL["boundaries"].or_none},
        facets=Kind(
            {
                **v.NOTHING,
                "halves": Made(lambda s: s.fem.facets + 0.5),
                "from 1": Made(lambda s: s.fem.facets + 1),
                "one missing": Made(lambda s: s.fem.facets[1:]),
                "one twice": Made(lambda s: np.vstack([s.fem.facets, s.fem.facets[:1]])),
                "inside out": Made(lambda s: s.fem.facets[:, [1, 0, 2, 3, 5, 4]]),
                "of another mesh": Made(lambda s: s.fem.facets[:, ::-1]),
                "five nodes": Made(lambda s: s.fem.facets[:, :5]),
            },
            the.fem.facets,
        ),
        cells=Kind({"text": "x", "number": 1, "beside facets": the.fem.cells}),
        regions=Kind({"text": "x", "number": 1, "without several materials": Made(lambda s: ["a"] * len(s.fem.cells))}),
        hexahedra=v.flag,
        dofs=Kind(
            {
                "text": "x",
                "number": 1,
                "flat": Made(lambda s: np.arange(s.fem.n_dofs)),
                "one missing": Made(lambda s: _dofs(s)[1:]),
                "one twice": Made(lambda s: _dofs(s)[[0, *range(s.fem.n_dofs - 1)]]),
                "from 1": Made(lambda s: _dofs(s) + 1),
                "all x first": Made(lambda s: _dofs(s)[np.argsort(_dofs(s)[:, 1], kind="stable")]),
                "halves": Made(lambda s: _dofs(s) + 0.5),
            }
        ),
    ),
    "read_matrices": dict(
        source=v.path_in(Made(Scene.matrix_files)),
        mass=v.path_in.or_none,
        mass_unit=v.positive,
        stiffness_unit=v.positive,
    ),
    "FileMatrices.on": dict(
        labels=Kind(
            {
                **v.NOTHING,
                "number": 1,
                "none": [],
                "halves": [0.5],
                "unknown": Made(lambda s: np.arange(s.fem.n_nodes) + 2),
                "twice": Made(lambda s: np.ones(s.fem.n_nodes, dtype=int)),
                "negative": Made(lambda s: -np.arange(s.fem.n_nodes)),
            },
            Made(lambda s: np.arange(s.fem.n_nodes) + 1),
        )
    ),
    "FileMatrices.fe_model": dict(mesh=v.path_in(file("matrices.inp")), scale=v.positive),
    "FEModel.material_beneath": dict(facets=v.numbers),
    "FEModel.nearest_node": {},
    "Partition.ball": dict(
        center=v.inside,
        radius=4e-3,
        contact_radius=v.positive.or_none.but(larger=1.0),
        long_axis=v.direction.or_none.but(shorter=(1e-4, 0.0, 0.0)),
        direction=v.direction.or_none,
        axes=v.choice("normal"),
        plastic_radius=v.positive.or_none.but(elastic=1e-3),
        name="tip",
    ),
    "Partition.load": dict(
        name="name",
        faces=Kind({"number": 1.0, "unknown": "none", "empty": [], "halves": [0.5], "object": object()}, np.arange(2)),
        line=Kind({"number": 1, "text": "x", "halves": [0.5], "beyond": [10**6]}),
        direction=v.direction.or_none,
    ),
    "Partition.interface": dict(
        name="pin",
        position=v.vector.or_none,
        kind=v.choice("rigid"),
        nodes=Kind({**v.nodes.wrong, "two": [0, 1]}, np.arange(12)),
    ),
    "Partition.facing": dict(
        fems=Kind(
            {
                **v.NOTHING,
                "a model": the.fem,
                "one": Made(lambda s: [s.fem]),
                "twice": Made(lambda s: [s.fem, s.fem]),
                "shapes": Made(lambda s: [s.shape, s.shape]),
                "bodies": Made(lambda s: [s.body, s.other_body]),
                "numbers for names": Made(lambda s: {1: s.fem, 2: s.other_fem}),
                "far apart": Made(lambda s: [s.fem, replace(s.other_fem, points=s.other_fem.points + 1.0)]),
            },
            Made(lambda s: [s.fem, s.other_fem]),
        ),
        within=v.positive(1e-4),
        axes=v.choice("normal").or_none,
    ),
    "Partition.surface": dict(
        faces=Kind(
            {
                **v.nodes.wrong,
                "no boundary": "hub",
                "names and numbers": ["hub", 3],
                "box outside": ((1, 1, 1), (2, 2, 2)),
                "box inside out": ((1, 1, 1), (-1, -1, -1)),
                "box of nan": ((0, 0, 0), (1, 1, np.nan)),
                "planes": np.zeros((3, 3)),
            },
            np.arange(12),
        ),
        axes=v.choice("normal").or_none,
        name="rim",
    ),
    "Partition.skin": dict(
        beside=Kind({"number": 1.0, "text": "hub", "a model": the.fem, "of another mesh": the.other_part}, None),
        axes=v.choice("normal"),
        name="skin",
    ),
    "Partition.patch": dict(key=v.patch),
    "Partition.find_load": dict(name=v.choice("weight")),
    "Partition.find_interface": dict(name=v.choice("pin")),
    "reduce": dict(
        fem=v.of_mesh,
        tolerance=v.positive.or_none,
        f_cut=v.positive.but("None", beyond=1e9)(60e3),
        basis=v.choice("residual"),
        speed=v.number.or_none,
    ),
    "reduce_pair": dict(
        slave=v.model_and_partition(Made(lambda s: (s.fem, s.part))),
        master=v.model_and_partition(Made(lambda s: (s.other_fem, s.other_part))),
        tolerance=v.positive.but(two=2.0)(0.1),
        duration=1e-5,
        patches=v.patches,
        friction=v.friction.but(alone=0.3)(None),
        tangential_speed=v.positive.or_none.but(alone=1.0),
    ),
    "mesh_error": dict(
        slave=v.model_and_body(Made(lambda s: (s.fem, s.body))),
        master=v.model_and_body(PLANE),
        duration=v.positive(1e-5),
    ),
    "with_mesh_error": dict(
        slave=v.model_and_body(Made(lambda s: (s.fem, s.tolerant))),
        master=v.model_and_body(PLANE),
        speed=v.positive.or_none(1.0),
        duration=1e-5,
    ),
    "design_impact": dict(
        first=v.shape_and_material(Made(lambda s: (occ.Sphere(occ.Pnt(0, 0, 5e-3), 5e-3), ep.STEEL))),
        second=v.shape_and_material(PLANE),
        contact=v.vector.but(aside=(1.0, 0.0, 0.0), above=(0.0, 0.0, 1e-3)),
        tolerance=v.positive.but(one=1.0, tiny=1e-9)(0.2),
        duration=20e-6,
        scale=v.positive,
        max_dofs=v.count.but(few=10)(200_000),
    ),
    "from_feminterface": dict(
        fem=Kind({**v.NOTHING, "number": 1, "a model of ours": the.fem}, the.feminterface),
    ),
    "load_body": dict(path=v.path_in(file("body.npz"))),
    "ReducedBody.save": dict(path=file("saved.npz"), inside=True),
    "ReducedBody.save_sid": dict(path=file("saved.SID_FEM"), nodes=v.numbers),
    "ReducedBody.rows": dict(nodes=v.numbers),
    "ReducedBody.reduced_rows": {},
    "ReducedBody.displacement": dict(q=v.motion.but("nan")(Made(lambda s: np.zeros(s.body.n_dofs)))),
    "ReducedBody.check_fem": dict(fem=v.of_body, name=Kind({}, "fem")),
    "ReducedBody.nearest_node": {},
    "ReducedBody.surface": dict(patch=0),
    "ReducedBody.flexibility": dict(patch=0, other=v.patch),
    "ReducedBody.interface_rows": dict(name=v.choice("pin")),
    "ReducedBody.centrifugal_load": dict(angular_velocity=v.vector),
    "ReducedBody.geometric_stiffness": dict(load=v.motion.but("nan")(Made(lambda s: np.zeros(s.body.n_dofs)))),
    "CreatePartitionBody": dict(
        mbs=Made(Scene.empty),
        frame=v.choice.or_none("floating"),
        positionRef=v.vector.or_none,
        damping=Kind(
            {
                "text": "x",
                "negative": -0.1,
                "nan": v.nan,
                "too many": [0.1] * 999,
                "dict": {},
                "per cent": 2.0,
                "per cent by frequency": lambda f: 2.0 + 0 * f,
                "of another unit": ep.Rayleigh(beta=1.0),
                "ragged": [0.1, [0.1]],
                "durations": lambda f: np.zeros(len(f), "m8[s]"),
                "masked": np.ma.array(0.1, mask=True),
            },
            0.0,
        ),
        plasticStates=Kind({"text": "x", "number": 1, "elastic": {0: None}, "no patch": {9: None}}),
        inertiaTerms=Kind({"None": None, "number": 1, "unknown": ["x"], "text": "coriolis"}, ("coriolis",)),
        massProportionalDamping=v.number.but(negative=-1.0)(0.0),
        stiffnessProportionalDamping=v.number.but(negative=-1e-9)(0.0),
        color=Kind({"text": "red", "three": (1, 0, 0), "beyond": (0, 0, 0, 255), "nan": (0, 0, v.nan, 1)}),
        superElementRigidMarkersOffsets=Kind({"text": "x", "vector": (0, 0, 0), "nan": [[v.nan] * 3]}),
    ),
    "CreateDistributedLoad": dict(
        mbs=Made(Scene.apart),
        body=v.item.but(**v.foreign_item)(the.striker),
        load=v.choice("weight"),
        magnitude=v.number,
    ),
    "CreateWorkSensor": dict(mbs=Made(Scene.falling)),
    "CreatePartitionContact": dict(
        mbs=Made(Scene.apart),
        slave=v.item.but(**v.foreign_item)(the.striker),
        master=v.item.but(**v.foreign_item, itself=the.striker)(PLANE),
        formulation=v.choice.but(**{"a class": Penalty, "a law": the.contact.mechanics})("penalty"),
        rows=v.choice.or_none.but(**{"edges of a plane": "edges"}),
        passes=v.choice.but(**{"two passes": "two"})("finer"),
        masterBody=Kind({"text": "x", "negative": -1, "beyond": 999, "half": 1.5, "True": True, "a body": the.item}),
        stiffness=v.positive.or_none,
        interference=v.positive.or_none.but(**{"apart as placed": "placed", "metres": 1.0}),
    ),
    "RigidPlane": dict(normal=v.direction),
    "RigidSphere": {},
    "RigidMesh": dict(
        points=Kind(
            {**v.NOTHING, "plane": np.ones((3, 2)), "NaN": np.full((3, 3), np.nan), "one place": np.ones((3, 3))},
            np.eye(3),
        ),
        triangles=Kind(
            {**v.NOTHING, "beyond": [[0, 1, 3]], "half": [[0, 1, 0.5]], "none": np.empty((0, 3)), "same": [[0, 1, 1]]},
            [[0, 1, 2]],
        ),
    ),
    "RigidMesh.of": dict(
        source=Kind(
            {**v.NOTHING, "no file": "nothing.stl", "a folder": "."}, Made(lambda s: occ.Box((0, 0, 0), (1, 1, 1)))
        ),
        maxh=0.5,
        scale=v.positive,
    ),
    "RigidProfile": dict(
        curve=Kind(
            {
                **v.NOTHING,
                "three": [(0, 0), (1, 0), (0, 1)],
                "flat": [(i, 0.0) for i in range(9)],
                "closed twice": [(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 20)],
                "space": np.ones((9, 3)),
                "no numbers": lambda angle: "circle",
            },
            lambda angle: np.column_stack([np.cos(angle), np.sin(angle)]),
        ),
        first=v.direction.or_none,
    ),
    "RigidCylinder": {},
    "PartitionBody.CreateInterfaceMarker": {},
    "PartitionBody.CreateSurfaceLoad": {},
    "PartitionBody.CreateNodeMarker": {},
    "PartitionBody.CreatePointMarker": dict(point=v.inside((0, 0, 5e-3))),
    "PartitionBody.coordinates": {},
    "PartitionBody.coordinates_t": {},
    "PartitionBody.momentum": {},
    "PartitionBody.angular_momentum": {},
    "PartitionBody.energy": {},
    "PartitionBody.dissipated_energy": {},
    "PartitionBody.displacement": dict(point=v.inside, fem=v.of_body.or_none),
    "PartitionBody.velocity": dict(point=v.inside, fem=v.of_body.or_none),
    "PartitionBody.velocity_rows": dict(point=v.inside),
    "PartitionBody.recover": dict(fem=v.of_body.or_none),
    "PartitionBody.stress": dict(fem=v.of_body),
    "PartitionBody.rigid_motion": {},
    "PartitionBody.deformation": {},
    "PartitionContact.impacts": dict(merge=v.number.but(negative=-1.0)(0.0)),
    "PartitionContact.mean_force": dict(window=v.positive.or_none(1e-6)),
    **each(
        "force force_on_slave closed_rows closed_samples gap row_forces nodal_forces pressure area radius ringing "
        "depth largest_stress energy dissipated_energy moment_on_slave edge_reached",
        {},
        of="PartitionContact.",
    ),
    **each(
        "tangential_force stuck_rows work states row_forces traction slip_path",
        dict(result=the.sticking.result),
        of="FrictionResults.",
    ),
    **each(
        "work strain states strain_histories dents flow_at_border",
        dict(result=the.yielding.result),
        of="PlasticResults.",
    ),
    "PartitionContact.AddMomentSensor": {},  # behind `moment_on_slave`, as a sensor without a run has no moments
    "WorkSensor.work": dict(result=the.working.result),
    "PlasticState.save": dict(path=file("state.npz")),
    "PlasticState.load": dict(path=v.path_in(Made(Scene.plastic_file))),
    "collect": dict(mbs=v.mbs.but(**{"not run": Made(Scene.assembled)})),
    "stability_limit": {},
    "natural_modes": dict(mbs=RUNNABLE),
    "solve_static": dict(mbs=RUNNABLE, load_steps=v.count),
    "settle": dict(
        mbs=RUNNABLE.but(**{"without a weight": Made(Scene.assembled)})(Made(Scene.resting)),
        bodies=Kind(
            {
                "text": "x",
                "number": 1,
                "reduced": Made(lambda s: [s.body]),
                "dict": {1: 2},
                "Nones": [None],
                "of another model": Made(lambda s: [s.item]),
            }
        )(None),
    ),
    "solve_dynamic": dict(
        mbs=RUNNABLE,
        end_time=v.positive.but(**{"1e-20": 1e-20, "1e30": 1e30})(4 * STEP),
        start_time=v.number.or_none.but(**{"beyond the end": 1.0, "1e-30": -1e30}),
        step=v.positive.or_none.but(unstable=1.0, **{"1e-30": 1e-30})(STEP),
        method=v.choice("explicit"),
        spectral_radius=v.share.but(**{"of explicit steps": 2.0})(0.9),
        free_step=v.positive.or_none.but("number"),
        solver=v.choice("exudyn"),
    ),
    "run_many": dict(
        mbs=RUNNABLE,
        end_time=v.positive.but(**{"1e-20": 1e-20, "1e30": 1e30})(4 * STEP),
        vary=Kind(
            {
                **v.NOTHING,
                "empty": {},
                "of text": {"upper": {"damping": np.zeros(2)}},
                "foreign": Made(lambda s: {s.foreign.item: {"damping": np.zeros(2)}}),
                "an array": Made(lambda s: {s.striker: np.zeros(2)}),
                "nothing": Made(lambda s: {s.striker: {}}),
                "unknown": Made(lambda s: {s.striker: {"speed": np.zeros(2)}}),
                "a number": Made(lambda s: {s.striker: {"damping": 0.1}}),
                "negative": Made(lambda s: {s.striker: {"damping": [-0.1]}}),
                "zero": Made(lambda s: {s.striker: {"E": [0.0]}}),
                "nan": Made(lambda s: {s.striker: {"rho": [v.nan]}}),
                "text in it": Made(lambda s: {s.striker: {"rho": ["x"]}}),
                "vectors of two": Made(lambda s: {s.striker: {"gravity": np.zeros((2, 2))}}),
                "other lengths": Made(lambda s: {s.striker: {"gravity": np.zeros((2, 3)), "E": [1e11]}}),
                "friction of a body": Made(lambda s: {s.striker: {"friction": [0.3]}}),
                "friction of a foreign contact": Made(lambda s: {s.foreign.contact: {"friction": [0.3]}}),
            },
            Made(lambda s: {s.striker: {"initialVelocity": np.zeros((2, 3))}}),
        ),
        step=v.positive.or_none.but(unstable=1.0, **{"1e-30": 1e-30})(STEP),
        histories=Kind({"text": "force", "number": 1, "unknown": ["x"], "numbers": [1], "None": None}, ()),
        file=Kind({"number": 1, "list": [], "no folder": "nowhere/x.jsonl"}, None),
        workers=v.count,
    ),
    "sensitivity": dict(
        mbs=RUNNABLE,
        end_time=v.positive.but(**{"1e-20": 1e-20, "1e30": 1e30})(4 * STEP),
        of=v.choice("velocity"),
        at=Kind(
            {
                **v.NOTHING,
                "a body": the.body,
                "foreign": Made(lambda s: s.foreign.item),
                "of another kind": Made(lambda s: s.foreign.contact),
            },
            Made(lambda s: s.striker),
        ),
        direction=v.vector((0.0, 0.0, 1.0)),
        point=Kind({"text": "x", "two": (0, 0), "far": (9.0, 9.0, 9.0), "nan": (0, 0, v.nan)}, None),
        rows=Kind(
            {"text": "x", "of a velocity": Made(lambda s: sp.csr_matrix((1, 3 * len(s.striker.body.points))))}, None
        ),
        times=Kind({"text": "x", "a number": 0.0, "late": [1.0], "negative": [-1e-9], "nan": [v.nan]}, [0.0, STEP]),
        weights=Kind({"text": "x", "a row": [1.0, 1.0], "short": [[1.0]], "nan": [[v.nan, 0.0]]}, [[1.0, 1.0]]),
        values=Kind(
            {
                "text": "x",
                "numbers": Made(lambda s: {s.striker: 1.0}),
                "foreign": Made(lambda s: {s.foreign.item: {"damping": 0.0}}),
                "unknown": Made(lambda s: {s.striker: {"speed": 1.0}}),
                "negative": Made(lambda s: {s.striker: {"damping": -0.1}}),
            },
            None,
        ),
        step=v.positive.or_none.but(unstable=1.0, **{"1e-30": 1e-30})(STEP),
    ),
    "time_to_contact": dict(contact=v.contact, q=MOTION_OF_BOTH, q_t=MOTION_OF_BOTH, q_tt=v.motion.or_none),
    "Result.sensor": dict(
        number=Kind({**v.NOTHING, "beyond": 999, "negative": -1, "half": 1.5, "list": [1]}, 0),
    ),
    "Result.sensor_of": dict(item=v.own("item", "contact").but(**v.foreign_item), number=v.count.but("zero")(0)),
    "Result.kept": dict(contact=v.contact.but(**v.foreign_contact)),
    "Result.at": {},
    "Result.report": dict(path=file("run.html")),
    "Result.film": dict(
        path=v.path_out.but(film=file("run.avi"))(file("run.gif")),
        period=0.04,
        scale=v.scale.or_none,
        view=v.choice("all"),
        size=(80, 60),
    ),
    "Result.scene": dict(
        path=v.path_out.or_none,
        colours=Kind({"text": "speed", "number": 1, "empty": [], "unknown": ["x"], "dict": {1: 2}}),
        scale=v.scale.or_none,
        height=v.count.but(one=1)(300),
    ),
    "Result.history": dict(
        contact=v.contact.but(**v.foreign_contact),
        points=Kind(
            {
                "text": "x",
                "list": [1],
                "no pair": {"P": 1},
                "no point": {"P": ("x", (0, 0, 0))},
                "swapped": {"P": ((0, 0, 0), 1)},
            }
        ),
    ),
    "Result.save": dict(path=file("npz")),
    "Result.load": dict(
        path=v.path_in.but(**{"a body": file("body.npz")})(file("run.npz")),
        mbs=v.mbs.but("None", another=Made(Scene.empty))(Made(Scene.again)),
    ),
    "History": dict(
        t=v.samples.but(none=[], descending=[2.0, 1.0, 0.0])(np.arange(3.0)),
        force=v.samples.but(two=[1.0, 2.0])(np.zeros(3)),
        velocity=Kind(
            {
                "None": None,
                "text": "x",
                "list": [1],
                "flat": {"P": [0, 0, 0]},
                "text in it": {"P": "x"},
                "no name": {1: np.zeros((3, 3))},
            },
            {},
        ),
        info=Kind({"None": None, "text": "x", "list": []}, {}),
        tangential_force=v.samples.or_none.but(flat=[0.0, 0.0, 0.0], two=np.zeros((2, 3))),
        dissipated=v.samples.or_none.but(two=[1.0, 2.0]),
    ),
    "History.until": dict(end_time=v.number.but(before=-1.0)),
    "History.save": dict(path=file("saved")),
    "History.load": dict(path=v.path_in(file("history.npz"))),
    "Comparison": dict(
        error=Kind(
            {
                "None": None,
                "text": "x",
                "object": object(),
                "text in it": {"a": "x"},
                "nan": {"a": v.nan},
                "negative": {"a": -1},
            },
            {"a": 1.0},
        ),
        time_s=v.number.but("nan", negative=-1.0),
        reference_time_s=v.number.but("nan", negative=-1.0),
        end_time=v.number,
    ),
    "compare": dict(run=v.history, reference=v.history),
    "report.front": {},
    "amplitude_spectrum": {},
    "truncation_frequency": dict(
        x=v.samples.but(**{"another length": _x[:50], "infinite": np.full(101, np.inf)}, constant=np.ones(101))(_x)
    ),
    "hertz.contact_radius": dict(force=v.positive),
    "hertz.effective": dict(first=v.limit, second=v.limit),
    "hertz.rod_impedance": dict(area=v.positive),
    "hertz.plate_impedance": dict(thickness=v.positive),
    "hertz.impact": dict(mass=v.limit, impedance=v.limit),
    "hertz.HertzImpact.truncation_frequency": {},
    "StrainGauge": dict(length=v.positive(1e-3)),
    "recovery.gauge_rows": dict(
        gauges=v.several(Kind(v.NOTHING))(Made(lambda s: [ep.StrainGauge((0, 0, 5e-3), (0, 0, 1), 1e-3)]))
    ),
    **each("displacement_rows strain_rows stress_rows nodal_strain nodal_stress", {}, of="recovery."),
    "recovery.von_mises": dict(stress=v.motion.but(five=np.zeros(5))(np.zeros((2, 6)))),
    "recovery.static_correction": dict(fem=v.of_body),
    "recovery.StaticAnswer": dict(fem=v.of_body),
    "recovery.StaticAnswer.check": dict(body=v.body.but(another=the.other_body)),
    "reference.FullBody": dict(
        fem=v.of_mesh,
        mass=v.choice("lumped"),
        plastic=v.choice("none"),
        plastic_state=Kind({"text": "x", "number": 1, "elastic": the.plastic_state}),
    ),
    "reference.simulate": dict(
        bodies=Kind(
            {
                **v.NOTHING,
                "one": Made(lambda s: [s.full]),
                "three": Made(lambda s: [s.full] * 3),
                "a fem": Made(lambda s: [s.full, s.other_fem]),
                "swapped in space": Made(lambda s: [s.full, s.full]),
                "of text": ["a", "b"],
            },
            Made(lambda s: [s.full, s.other_full]),
        ),
        end_time=v.positive(4 * STEP),
        step=v.positive.but(longer=1.0, **{"1e-30": 1e-30})(STEP),
        points=Kind(
            {
                "text": "x",
                "list": [1],
                "no pair": {"P": 1},
                "no point": {"P": (0, "x")},
                "index 2": {"P": (2, (0, 0, 0))},
                "index -1": {"P": (-1, (0, 0, 0))},
                "nan": {"P": (0, (v.nan, 0, 0))},
                "no name": {1: (0, (0, 0, 0))},
                "of another material": Made(lambda s: {"P": (s.item, (0, 0, 5e-3), s.softer)}),
            }
        ),
        alpha=v.share(0.1),
        rows=v.choice("integrated"),
        friction=0.3,
    ),
    "output.write_paraview": dict(
        folder=file("paraview"),
        result=v.own_result,
        fields=v.choice.but(none=[], **{"stress without a mesh": "stress"})("velocity"),
        surface=v.flag(True),
    ),
    "plot.force": {},
    "plot.velocity": dict(
        point=v.inside, axis=v.count.but("zero", three=3)(2), body=v.item.or_none.but(**v.foreign_item)(the.item)
    ),
    "plot.spectrum": dict(
        point=v.vector.or_none,
        axis=v.count.but("zero", three=3)(2),
        body=Kind({}),
        f_cut=v.positive.or_none,
    ),
    "plot.energy": dict(result=v.own_result, bodies=ARGUMENTS["bodies"].but("empty")),
    "plot.pressure": dict(result=v.own_result),
    "plot.stick": dict(result=v.own_result(the.sticking.result)),
    "plot.selection": dict(fem=v.fem.but(other=the.other_fem)),
    "plot.bodies": dict(result=v.own_result, scale=v.scale.or_none),
    "plot.modes": dict(body=v.item_or_body),
    "plot.pareto": dict(runs=v.runs),
    "plot.overview": {},
    "CreatePartitionView": {},
    "view.picture": dict(result=v.own_result),
    "view.show": dict(result=v.own_result, cycles=v.count.or_none(1)),
    "pyvista_view.plotter": dict(result=v.own_result),
    "pyvista_view.turntable": dict(
        path=file("turn.gif"), result=v.own_result, size=(80, 60), frames=v.count.but(one=1, beyond=10**6)(2)
    ),
    "restitution_map": dict(
        bodies=Kind(
            {
                **v.NOTHING,
                "a body": the.body,
                "a rigid surface first": Made(lambda s: (ep.RigidPlane(), s.body)),
                "one": Made(lambda s: (s.body,)),
                "no partner": Made(lambda s: (s.body, None)),
                "a function of nothing useful": lambda place: None,
            },
            Made(lambda s: (s.body, ep.RigidPlane())),
        ),
        speed=AXIS.but(zero=0.0)(1.0),
        angle=AXIS.but(degrees=45.0)(0.0),
        friction=AXIS(0.0),
        place=Kind({**v.NOTHING, "beside given bodies": 1.0}, None).or_none,
        along=v.direction.or_none,
        duration=v.positive.or_none(1e-4),
        largest_turn=v.number.but(negative=-1e-3)(0.0),
        workers=v.count,
        file=v.path_out.or_none,
    ),
    "study": dict(
        function=Kind({"None": None, "text": "x", "number": 1, "list": []}, lambda x: x),
        parameters=Kind(
            {
                **v.NOTHING,
                "empty": [],
                "no values": {"x": []},
                "numbers": [1, 2],
                "no names": {1: [2]},
                "a body": Made(lambda s: {"x": s.body}),
            },
            {"x": [1.0, 2.0]},
        ),
        workers=v.count,
        chunk=v.count.or_none,
        together=v.text.or_none.but(unknown="y")("x"),
        task=Kind({"text": "x", "one": "3", "beyond": "4/3", "zero": "0/3", "number": 1, "halves": (0.5, 2)}, None),
        stop=v.flag,
        file=v.path_out.or_none,
    ),
    "sample_parameters": dict(
        ranges=Kind(
            {**v.NOTHING, "no names": {1: (0, 1)}, "none": {"x": 1.0}, "descending": {"x": (1, 0)}, "one": {"x": (1,)}},
            {"x": (0.0, 1.0)},
        ),
        count=v.count.but(three=3)(4),
        method=v.choice("sobol"),
        seed=v.count.but("zero")(1),
    ),
    "Study.load": dict(path=v.path_in(Made(Scene.study_file))),
    "RestitutionMap.load": dict(path=v.path_in(Made(Scene.map_file))),
    "RestitutionMap.save": dict(path=file("saved_map.npz")),
    "RestitutionMap.plot": dict(quantity=v.choice("restitution"), over=v.choice.or_none),
    "progress": dict(after=v.number.but(negative=-1.0)(0.0)),
}

_MADE_BY_US = "made by the library, whose functions check what it is made of"
_EVERY_STEP = "called by Exudyn's solvers in every step, with what they have"
_INSIDE = "takes what the library has checked, in loops"
NOT_CALLED = {
    "FileMatrices": _MADE_BY_US,
    "Partition": _MADE_BY_US,
    "Estimate": _MADE_BY_US,
    "ImpactDesign": _MADE_BY_US,
    "ManyRuns": _MADE_BY_US,
    "RestitutionMap": _MADE_BY_US,
    "Study": _MADE_BY_US,
    "Sensitivity": _MADE_BY_US,
    "RestitutionLaw": _MADE_BY_US,
    "ReducedBody": _MADE_BY_US,
    "PartitionBody": _MADE_BY_US,
    "PartitionContact": _MADE_BY_US,
    "FrictionResults": _MADE_BY_US,
    "PlasticResults": _MADE_BY_US,
    "WorkSensor": _MADE_BY_US,
    "Result": _MADE_BY_US,
    "hertz.HertzImpact": _MADE_BY_US,
    "PartitionBody.is_in": _EVERY_STEP,
    "PartitionContact.slices": _EVERY_STEP,
    **{
        f"{name}.project": _EVERY_STEP
        for name in ("RigidPlane", "RigidSphere", "RigidCylinder", "RigidProfile", "RigidMesh")
    },
    "RigidMesh.entered": _EVERY_STEP,
    "PlasticState": _MADE_BY_US,
    **{f"PlasticState.{name}": _INSIDE for name in ("virgin", "at", "changed")},
    "FEModel.shares_of_walls": _INSIDE,
    "FEModel.need_cells": _INSIDE,
    "Refine.n_elements": _INSIDE,
    "Partition.is_of": _INSIDE,
    "Partition.check_mesh": _INSIDE,
    "ReducedBody.check_inside": _INSIDE,
    "ReducedBody.check_nodes": _INSIDE,
    "ReducedBody.growth_in": _INSIDE,
    "ReducedBody.growth_rows": _INSIDE,
    "ReducedBody.shape_rows": _INSIDE,
    "ReducedBody.strain_energy": _INSIDE,
    "Result.dampings_of": _INSIDE,
}
NOT_EVERYWHERE = {
    "view.show": "it needs a screen",
    "ReducedBody.geometric_stiffness": "it needs a body that was reduced with it",
}  # right calls that may fail
# First arguments that may be given for each other, as they are alike.
EXCHANGEABLE = {
    "Rayleigh(alpha and beta swapped)",
    "Refine(radius and h swapped)",
    "time_to_contact(q and q_t swapped)",
    "History(t and force swapped)",
    "Comparison(time_s and reference_time_s swapped)",
    "compare(run and reference swapped)",
    "hertz.contact_radius(force and radius_1 swapped)",
    "hertz.contact_radius(force and radius_2 swapped)",
    "hertz.contact_radius(radius_1 and radius_2 swapped)",
    "hertz.effective(first and second swapped)",
    "hertz.impact(mass and speed swapped)",
    "hertz.impact(mass and radius_1 swapped)",
    "hertz.impact(speed and radius_1 swapped)",
}
