"""The calls of `misuse.py`: every public function with its arguments, scenes set up wrongly, command lines.

`CALLS` has everything that `public()` finds in the package, except `NOT_CALLED`, which says why these need no check.
Each entry has the kinds of its arguments, see `misuse_values`. It has a right value if the kind has none of its own.
"""

import inspect
from dataclasses import dataclass
from itertools import combinations
from types import ModuleType
from typing import Any

import netgen.occ as occ
import numpy as np
import scipy.sparse as sp
from exudyn.FEM import FEMinterface

import exudyn_partition as ep
from exudyn_partition.contact.formulations.choices import Penalty
from validation.stability import misuse_values as v
from validation.stability.misuse_values import STEP, Kind, Made


def public():
    """Functions, methods with arguments, and classes that a user can call, by their names behind `ep.`."""
    found = {}
    for name in sorted(ep.__all__, key=lambda name: isinstance(getattr(ep, name), ModuleType)):  # its own name first
        thing = getattr(ep, name)
        members = vars(thing) if isinstance(thing, ModuleType) else {name: thing}
        for key, value in members.items():
            own = not isinstance(thing, ModuleType) or key in exported(thing)
            if not own or key.startswith("_") or not (inspect.isclass(value) or inspect.isfunction(value)):
                continue
            if inspect.isclass(value) and issubclass(value, BaseException):
                continue
            if value in found.values():
                continue
            full = f"{name}.{key}" if isinstance(thing, ModuleType) else key
            found[full] = value
            if inspect.isclass(value):
                found |= _methods(full, value)
    return {name: value for name, value in found.items() if _takes_something(value)}


def exported(module):
    """Names that a module offers: those it says, or all that are defined in it."""
    own = [key for key, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
    return getattr(module, "__all__", own)


def _methods(full, kind):
    found = {}
    for base in reversed([c for c in kind.__mro__ if c.__module__.startswith("exudyn_partition")]):
        for key in vars(base):
            if not key.startswith("_") and callable(getattr(kind, key)):
                found[f"{full}.{key}"] = getattr(kind, key)
    return found


def _takes_something(thing):
    return bool({*inspect.signature(thing).parameters} - {"self", "cls"})


@dataclass(frozen=True)
class Call:
    """A function, and the kinds of its arguments; `of` makes what it is a method of."""

    arguments: dict[str, Kind]
    of: Any = None
    swaps: bool = True  # whether its first arguments, given for each other, are always wrong


def call(of=None, swaps=True, **arguments):
    return Call(arguments, of, swaps)


_item, _contact, _result, _body = (lambda s: s.item), (lambda s: s.contact), (lambda s: s.result), (lambda s: s.body)
_history = lambda s: s.history  # noqa: E731
_state = lambda s: s.yielding[0].plastic_states(s.yielding[1])["slave"]  # noqa: E731
_of_result = {"of": _contact, "result": v.result}


def _saved_state(s):
    path = s.folder / "read.npz"
    _state(s).save(path)
    return path


_numbers = Kind({**v.NOTHING, "halves": [0.5], "beyond": [10**6], "negative": [-1]})
_new = v.mbs(Made(lambda s: s.empty()))
_ready = v.mbs(Made(lambda s: s.assembled()))
_axes = Kind({"text": "x", "number": 1, "a result": Made(_result), "list": []}, None)
_rows = Kind({**v.NOTHING, "array": np.zeros(3), "of another mesh": sp.csr_matrix((1, 3))})
_rows = _rows(Made(lambda s: sp.csr_matrix((1, s.fem.n_dofs))))
_not_own = {"another mesh": Made(lambda s: s.other_fem), "another material": Made(lambda s: s.softer)}
_not_own |= {"another density": Made(lambda s: s.heavier), "elsewhere": Made(lambda s: s.moved)}


def _matrix_of(right):
    """Wrong values of a matrix of an FE model."""
    return Kind(
        {
            **v.NOTHING,
            "zeros": Made(lambda s: 0 * right(s)),
            "times 1000": Made(lambda s: 1000 * right(s)),
            "complex": Made(lambda s: right(s) * (1 + 0.1j)),
            "complex list of lists": Made(lambda s: sp.lil_matrix(right(s)) * 1j),
            "one triangle": Made(lambda s: sp.triu(right(s), format="csr")),
            "an entry on one side": Made(
                lambda s: right(s) + sp.csr_matrix(([1e-3 * right(s).max()], ([0], [5])), right(s).shape)
            ),
            "one row changed": Made(lambda s: sp.diags(1 + (np.arange(s.fem.n_dofs) == 7)) @ right(s)),
            "not square": Made(lambda s: right(s)[:-3]),
            "truth values": Made(lambda s: right(s).astype(bool)),
            "dense of text": Made(lambda s: right(s).toarray().astype(str)),
            "other order of dofs": Made(lambda s: _by_axes(right(s))),
            "of another mesh": Made(lambda s: sp.identity(3)),
            "nan": Made(lambda s: right(s) * v.nan),
        },
        Made(right),
    )


def _by_axes(matrix):
    """The same with all dofs x first, then y, then z."""
    order = np.arange(matrix.shape[0]).reshape(-1, 3).T.ravel()
    return matrix[order][:, order]


_fem, _own_fem = v.fem.or_none.but(**_not_own), v.fem.but(**_not_own)
_t, _x = np.linspace(0, 1, 101), np.sin(np.linspace(0, np.pi, 101)) ** 2
_signal_t = v.samples.but(descending=_t[::-1], uneven=_t**2, two=[0.0, 1.0])(_t)
_signal_x = v.samples.but(**{"another length": _x[:50], "infinite": np.full(101, np.inf)})(_x)
_names = v.text.but("number", "list")
_runs = Kind({**v.NOTHING, "list": [1], "of numbers": {"a": 1.0}, "empty name": {"": None}})
_runs = _runs(Made(lambda s: {"run": s.comparison}))
_named_points = Kind(
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
    },
    None,
)
_body_points = Kind(
    {
        "text": "x",
        "list": [1],
        "no pair": {"P": 1},
        "no point": {"P": ("x", (0, 0, 0))},
        "swapped": {"P": ((0, 0, 0), 1)},
    },
    None,
)
_pair = Kind(
    {
        **v.NOTHING,
        "fem": Made(lambda s: s.fem),
        "swapped": Made(lambda s: (s.part, s.fem)),
        "three": Made(lambda s: (s.fem, s.part, 1)),
        "of two meshes": Made(lambda s: (s.fem, s.other_part)),
    }
)
_reduced_pair = Kind(
    {
        **v.NOTHING,
        "fem": Made(lambda s: s.fem),
        "swapped": Made(lambda s: (s.body, s.fem)),
        "three": Made(lambda s: (s.fem, s.body, 1)),
        "of two meshes": Made(lambda s: (s.fem, s.other_body)),
        "of two materials": Made(lambda s: (s.softer, s.body)),
    }
)
_shape_pair = Kind(
    {
        **v.NOTHING,
        "shape": Made(lambda s: s.shape),
        "swapped": Made(lambda s: (ep.STEEL, s.shape)),
        "three": Made(lambda s: (s.shape, ep.STEEL, 1)),
        "FE model": Made(lambda s: (s.fem, ep.STEEL)),
        "no STEP file": Made(lambda s: (s.folder / "text.npz", ep.STEEL)),
        "missing": Made(lambda s: ("none.step", ep.STEEL)),
        "flat": Made(lambda s: (s.shape, ep.STEEL)),
    }
)


def _falling_ball(scene):
    return occ.Sphere(occ.Pnt(0, 0, 5e-3), 5e-3), ep.STEEL


_q = Kind({**v.NOTHING, "number": 1.0, "flat": np.zeros(3), "nan": np.full((1, 12), v.nan), "texts": [["a"]]})
_fems = {"fem": v.fem, "points": v.points([(0, 0, 5e-3)])}
_two = Kind(
    {
        **v.NOTHING,
        "one": Made(lambda s: [s.full]),
        "three": Made(lambda s: [s.full] * 3),
        "a fem": Made(lambda s: [s.full, s.other_fem]),
        "swapped in space": Made(lambda s: [s.full, s.full]),
        "of text": ["a", "b"],
    },
    Made(lambda s: [s.full, s.other_full]),
)
_limits = Kind({"text": "x", "one": [1], "descending": (2, 1), "equal": (1, 1), "nan": (0, v.nan), "number": 1}, None)
_bodies = Kind(
    {
        "text": "x",
        "number": 1,
        "empty": [],
        "bodies": Made(lambda s: [s.body]),
        "dict": {1: 2},
        "an item": Made(lambda s: 5),
        "pair of text": Made(lambda s: [(s.item, "x")]),
        "Nones": [None],
        "triple": Made(lambda s: [(s.item, s.fem, 1)]),
        "other fem": Made(lambda s: [(s.item, s.part)]),
        "fem of another material": Made(lambda s: [(s.item, s.softer)]),
        "foreign": Made(lambda s: [s.foreign[0]]),
    },
    None,
)
_contacts = Kind(
    {
        "text": "x",
        "number": 1,
        "items": Made(lambda s: [s.item]),
        "Nones": [None],
        "foreign": Made(lambda s: [s.foreign[1]]),
    },
    None,
)
_foreign_item = {"of another model": Made(lambda s: s.foreign[0])}
_foreign_contact = {"of another model": Made(lambda s: s.foreign[1])}
_plain_body, _plain_contact = v.item.or_none.but(**_foreign_item), v.contact.or_none.but(**_foreign_contact)
_cache = v.path_out.but("folder", "no folder", "/proc", "pipe", "400 characters", "device")(False)
_size = Kind(
    {**v.NOTHING, "one": (1,), "negative": (-1, 5), "halves": (1.5, 2.5), "huge": (10**6, 10**6), "nan": (v.nan, 1)},
    (32, 24),
)
_BY_GEOMETRY = {
    "cylinder": Kind(
        {"text": "x", "number": 1, "pair": ((0, 0, 0), 1.0), "no axis": ((0, 0, 0), (0, 0, 0), 1.0)}, None
    ),
    "plane": Kind({"text": "x", "number": 1, "one": ((0, 0, 0),), "no normal": ((0, 0, 0), (0, 0, 0))}, None),
    "near": Kind({"text": "x", "number": 1, "pair": (0, 0), "nan": (v.nan, 0, 0)}, None),
}
_frames = v.times.but(one=1, beyond_all=10**6)(2)
_scale = v.positive.or_none.but(**{"1e300": 1e300})
_direction = v.vector.but(zero=(0, 0, 0))((1.0, -1.0, 1.0))
_SCENE = {
    "result": v.own_result,
    "time": v.number.or_none.but(beyond=1.0, negative=-1.0)(STEP),
    "bodies": _bodies,
    "field": v.choice("velocity"),
    "scale": v.positive.but(**{"1e300": 1e300}),
    "limits": _limits,
}
_rotation = Kind(
    {
        "text": "x",
        "vector": (0, 0, 0),
        "mirror": -np.eye(3),
        "zeros": np.zeros((3, 3)),
        "nan": np.full((3, 3), v.nan),
    },
    None,
)


def _feminterface(scene):
    """Exudyn's import of a block with linear elements."""
    mesh = ep.generate_mesh(occ.Box((0, 0, 0), (0.01, 0.01, 0.01)), maxh=0.01)
    fem = FEMinterface()
    fem.ImportMeshFromNGsolve(mesh, ep.STEEL.rho, ep.STEEL.E, ep.STEEL.nu, meshOrder=1, boundaryNamesList=[])
    return fem


_refine = Kind({"text": "x", "number": 1, "tuples": [((0, 0, 0), 1, 1)], "Nones": [None]}, ())

_runnable = _ready.but(**{"not assembled": Made(lambda s: s.model()[0]), "empty": _new.right})
_settings = Kind({"text": "x", "number": 1, "dict": {}, "a model": Made(lambda s: s.mbs)}, None)

# Hollows are right; one that fits the other surface is not, for they would touch all over.
_radius = v.limit.but("negative", **{"hollow of the other's radius": -0.01, "narrower hollow": -0.005})(0.01)
CALLS = {
    "Material": call(
        E=v.positive(1e9),
        nu=v.number.but(half=0.5, **{"minus one": -1.0})(0.3),
        rho=v.positive(1e3),
        yield_stress=v.positive.or_none.but(MPa=355.0)(355e6),
        hardening=v.number.or_none.but(negative=-1.0, text="x", short=[(0.0, 355e6)], softening=[(0, 355e6), (1, 1e6)]),
        kinematic_hardening=v.number.but(negative=-1.0)(0.0),
        swaps=False,
    ),
    "Rayleigh": call(alpha=v.number.but(negative=-1.0), beta=v.number.but(negative=-1.0), swaps=False),
    "Coulomb": call(
        static=v.friction(0.3),
        kinetic=v.number.or_none.but(negative=-0.1, larger=0.4),
        decay=v.positive.or_none,
        swaps=False,
    ),
    "Refine": call(center=v.vector, radius=v.positive(1e-3), h=v.positive(1e-4), swaps=False),
    "generate_mesh": call(
        shape=v.own("shape")(Made(lambda s: s.shape)),
        maxh=v.positive(8e-3),
        refine=_refine,
        grading=v.positive.but(**{"1e-6": 1e-6, "5": 5.0})(0.3),
    ),
    "fe_model": call(
        source=v.path_in.but("folder").but(folder=Made(lambda s: s.folder))(Made(lambda s: s.shape)),
        material=v.material,
        modulus=v.function.but(
            **{"too few": lambda x: x[:1, 0], "negative": lambda x: -abs(x[:, 0]), "text of it": len}
        ),
        order=v.count.or_none.but(four=4),
        maxh=v.positive(8e-3),
        refine=_refine,
        grading=v.positive.but(**{"1e-6": 1e-6, "5": 5.0})(0.3),
        scale=v.positive(1.0),
    ),
    "FEModel.material_beneath": call(of=lambda s: s.fem, facets=_numbers(np.arange(2))),
    "FEModel.nearest_node": call(of=lambda s: s.fem, point=v.vector),
    "Partition.ball": call(
        fem=v.fem,
        center=v.vector.but(outside=(1, 1, 1)),
        radius=v.positive(4e-3),
        contact_radius=v.positive.or_none.but(larger=1.0),
        direction=v.direction.or_none,
        axes=v.choice("normal"),
        plastic_radius=v.positive.or_none.but(elastic=1e-3)(None),
        name=v.text("tip"),
    ),
    "Partition.load": call(
        fem=v.fem,
        **_BY_GEOMETRY,
        name=v.text,
        faces=Kind({"number": 1.0, "unknown": "none", "empty": [], "halves": [0.5], "object": object()}, np.arange(2)),
        line=Kind({"number": 1, "text": "x", "halves": [0.5], "beyond": [10**6]}, None),
        direction=v.direction.or_none,
        swaps=False,
    ),
    "Partition.find_load": call(of=lambda s: s.part, name=v.choice("weight"), swaps=False),
    "Partition.interface": call(
        fem=v.fem,
        **_BY_GEOMETRY,
        name=v.text("pin"),
        position=v.vector.or_none,
        kind=v.choice("rigid"),
        nodes=Kind(
            {
                **v.NOTHING,
                "none": [],
                "halves": [0.5, 1.5, 2.5],
                "beyond": [0, 1, 10**6],
                "two": [0, 1],
                "negative": [-1, 0, 1],
                "Trues": [True, False, True],
            }
        )(np.arange(12)),
    ),
    "Partition.surface": call(
        fem=v.fem,
        **_BY_GEOMETRY,
        faces=Kind(
            {
                **v.NOTHING,
                "none": [],
                "halves": [0.5, 1.5, 2.5],
                "beyond": [0, 1, 10**6],
                "negative": [-1, 0, 1],
                "Trues": [True, False, True],
                "no boundary": "hub",
                "names and numbers": ["hub", 3],
                "box outside": ((1, 1, 1), (2, 2, 2)),
                "box inside out": ((1, 1, 1), (-1, -1, -1)),
                "box of nan": ((0, 0, 0), (1, 1, np.nan)),
                "planes": np.zeros((3, 3)),
            }
        )(np.arange(12)),
        axes=v.choice("normal"),
        name=v.text("rim"),
    ),
    "FEModel": call(
        points=Kind(
            {
                **v.NOTHING,
                "twice": Made(lambda s: 2 * s.fem.points),
                "some": Made(lambda s: s.fem.points[:-1]),
                "in another order": Made(lambda s: s.fem.points[::-1]),
                "masked": Made(lambda s: np.ma.array(s.fem.points, mask=s.fem.points > 0.02)),
                "of a unit": Made(lambda s: v.WithUnit.of(s.fem.points)),
            },
            Made(lambda s: s.fem.points),
        ),
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
            Made(lambda s: s.fem.cells),
        ),
        mass=_matrix_of(lambda s: s.fem.mass),
        stiffness=_matrix_of(lambda s: s.fem.stiffness),
        cell_mass=v.samples.but(
            **{
                "times 1000": Made(lambda s: 1000 * s.fem.cell_mass),
                "some": Made(lambda s: s.fem.cell_mass[1:]),
                "negative": Made(lambda s: -s.fem.cell_mass),
                "of others": Made(lambda s: np.roll(s.fem.cell_mass, 1) * np.where(np.arange(len(s.fem.cells)), 1, 2)),
            }
        )(Made(lambda s: s.fem.cell_mass)),
        material=v.material.but(
            aluminium=ep.ALUMINIUM, **{"other nu": Made(lambda s: ep.Material(E=210e9, nu=0.29, rho=7800.0))}
        ),
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
            Made(lambda s: {"top": np.arange(3)}),
        ),
        regions=Kind({"text": "x", "a material": ep.STEEL, "numbers": np.arange(3)}, None),
        swaps=False,
    ),
    "Partition.patch": call(of=lambda s: s.part, key=v.patch),
    "Partition.find_interface": call(of=lambda s: s.part, name=v.choice("pin")),
    "reduce": call(
        fem=v.fem.but(**{"another mesh": Made(lambda s: s.other_fem)}),
        partition=v.part,
        tolerance=v.positive.or_none,
        duration=v.positive.or_none,
        f_cut=v.positive.but("None", beyond=1e9)(60e3),
        basis=v.choice("residual"),
        speed=v.number.or_none,
        progress=v.function,
        cache=_cache,
    ),
    "reduce_pair": call(
        slave=_pair(Made(lambda s: (s.fem, s.part))),
        master=_pair(Made(lambda s: (s.other_fem, s.other_part))),
        tolerance=v.positive.but(two=2.0)(0.1),
        speed=v.positive(1.0),
        duration=v.positive.or_none(1e-5),
        patches=Kind({"text": "x", "one": (0,), "beyond": (9, 9), "number": 1}, (None, None)),
        friction=Kind({**v.friction.wrong, "alone": 0.3}, None),
        tangential_speed=v.positive.or_none.but(alone=1.0),
        progress=v.function,
        cache=_cache,
        swaps=False,
    ),
    "mesh_error": call(
        slave=_reduced_pair(Made(lambda s: (s.fem, s.body))),
        master=_reduced_pair(Made(lambda s: ep.RigidPlane())),
        speed=v.positive(1.0),
        duration=v.positive(1e-5),
        patches=Kind({"text": "x", "one": (0,), "beyond": (9, 9), "number": 1, "rigid": (0, 0)}, (None, None)),
        swaps=False,
    ),
    "with_mesh_error": call(
        slave=_reduced_pair(Made(lambda s: (s.fem, ep.reduce(s.fem, s.body.partition, tolerance=0.2)))),
        master=_reduced_pair(Made(lambda s: ep.RigidPlane())),
        speed=v.positive.or_none(1.0),
        duration=v.positive.or_none(1e-5),
        patches=Kind({"text": "x", "one": (0,), "beyond": (9, 9), "number": 1, "rigid": (0, 0)}, (None, None)),
        correct=v.flag(False),
        swaps=False,
    ),
    "design_impact": call(
        first=_shape_pair(Made(_falling_ball)),
        second=_shape_pair(Made(lambda s: ep.RigidPlane())),
        speed=v.positive(1.0),
        contact=v.vector.but(aside=(1.0, 0.0, 0.0), above=(0.0, 0.0, 1e-3)),
        tolerance=v.positive.but(one=1.0, tiny=1e-9)(0.2),
        duration=v.positive.or_none(20e-6),
        scale=v.positive(1.0),
        max_dofs=v.count.but(few=10)(200_000),
        correct=v.flag(False),
        progress=v.function,
        swaps=False,
    ),
    "from_feminterface": call(
        fem=Kind({**v.NOTHING, "number": 1, "a model of ours": Made(lambda s: s.fem)}, Made(_feminterface)),
        material=v.material,
    ),
    "load_body": call(path=v.path_in(Made(lambda s: s.folder / "body.npz"))),
    "ReducedBody.save": call(
        of=_body, path=v.path_out(Made(lambda s: s.folder / "saved.npz")), inside=v.flag(True), swaps=False
    ),
    "ReducedBody.rows": call(of=_body, nodes=_numbers(np.arange(3))),
    "ReducedBody.reduced_rows": call(of=_body, rows=_rows),
    "ReducedBody.displacement": call(of=_body, q=_q.but("nan")(Made(lambda s: np.zeros(s.body.n_dofs)))),
    "ReducedBody.check_fem": call(of=_body, fem=_own_fem, name=Kind({}, "fem"), swaps=False),
    "ReducedBody.nearest_node": call(of=_body, point=v.vector),
    "ReducedBody.surface": call(of=_body, position=v.vector, patch=v.patch(0), swaps=False),
    "ReducedBody.flexibility": call(of=_body, patch=v.patch(0), other=v.patch(None), swaps=False),
    "ReducedBody.interface_rows": call(of=_body, name=v.choice("pin")),
    "CreatePartitionBody": call(
        mbs=_new,
        body=v.body,
        name=v.text(""),
        frame=v.choice.or_none("floating"),
        referencePosition=v.vector,
        referenceRotation=_rotation,
        referenceRotationMatrix=_rotation,
        positionRef=v.vector.or_none,
        rotationMatrixRef=_rotation,
        showMarkers=v.flag,
        verbose=v.flag,
        initialVelocity=v.vector,
        initialAngularVelocity=v.vector,
        gravity=v.vector,
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
        plasticStates=Kind({"text": "x", "number": 1, "elastic": {0: None}, "no patch": {9: None}}, None),
        inertiaTerms=Kind({"None": None, "number": 1, "unknown": ["x"], "text": "coriolis"}, ("coriolis",)),
        superElement=v.flag,
        massProportionalDamping=v.number.but(negative=-1.0)(0.0),
        stiffnessProportionalDamping=v.number.but(negative=-1e-9)(0.0),
        color=Kind({"text": "red", "three": (1, 0, 0), "beyond": (0, 0, 0, 255), "nan": (0, 0, v.nan, 1)}, None),
        superElementRigidMarkersOffsets=Kind({"text": "x", "vector": (0, 0, 0), "nan": [[v.nan] * 3]}, None),
    ),
    "CreateDistributedLoad": call(
        mbs=v.mbs(Made(lambda s: s.apart())),
        body=v.item.but(**_foreign_item)(Made(lambda s: s.striker)),
        load=v.choice("weight"),
        magnitude=v.number,
        bodyFixed=v.flag,
        loadUserFunction=v.function,
        name=v.text(""),
    ),
    "CreateWorkSensor": call(mbs=v.mbs(Made(lambda s: s.falling()))),
    "WorkSensor.work": call(of=lambda s: s.working[0], result=v.result(Made(lambda s: s.working[1]))),
    "CreatePartitionContact": call(
        mbs=v.mbs(Made(lambda s: s.apart())),
        slave=v.item.but(**_foreign_item)(Made(lambda s: s.striker)),
        master=v.item.but(**_foreign_item, itself=Made(lambda s: s.striker))(Made(lambda s: ep.RigidPlane())),
        formulation=v.choice.but(**{"a class": Penalty, "a law": Made(lambda s: s.contact.law)})("penalty"),
        rows=v.choice.or_none,
        passes=v.choice.but(**{"two passes": "two"})("finer"),
        slavePatch=v.patch(None),
        masterPatch=v.patch(None),
        masterBody=Kind(
            {"text": "x", "negative": -1, "beyond": 999, "half": 1.5, "True": True, "a body": Made(_item)}, None
        ),
        stiffness=v.positive.or_none,
        friction=v.friction(None),
        within=v.positive.or_none,
        name=v.text(""),
    ),
    "RigidPlane": call(point=v.vector, normal=v.direction, swaps=False),
    "RigidSphere": call(center=v.vector, radius=v.positive(1.0)),
    "RigidMesh": call(
        points=Kind(
            {**v.NOTHING, "plane": np.ones((3, 2)), "NaN": np.full((3, 3), np.nan), "one place": np.ones((3, 3))}
        )(np.eye(3)),
        triangles=Kind(
            {**v.NOTHING, "beyond": [[0, 1, 3]], "half": [[0, 1, 0.5]], "none": np.empty((0, 3)), "same": [[0, 1, 1]]}
        )([[0, 1, 2]]),
        swaps=False,
    ),
    "RigidMesh.of": call(
        source=Kind({**v.NOTHING, "no file": "nothing.stl", "a folder": "."})(
            Made(lambda s: occ.Box((0, 0, 0), (1, 1, 1)))
        ),
        maxh=v.positive(0.5),
        scale=v.positive(1.0),
    ),
    "RigidProfile": call(
        curve=Kind(
            {
                **v.NOTHING,
                "three": [(0, 0), (1, 0), (0, 1)],
                "flat": [(i, 0.0) for i in range(9)],
                "closed twice": [(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 20)],
                "space": np.ones((9, 3)),
                "no numbers": lambda angle: "circle",
            }
        )(lambda angle: np.column_stack([np.cos(angle), np.sin(angle)])),
        point=v.vector,
        axis=v.direction,
        first=v.direction.or_none,
        swaps=False,
    ),
    "RigidCylinder": call(point=v.vector, axis=v.direction, radius=v.positive(1.0), hollow=v.flag, swaps=False),
    "PartitionBody.CreateInterfaceMarker": call(of=_item, mbs=v.mbs, interface=v.choice("pin")),
    "PartitionBody.CreateSurfaceLoad": call(
        of=_item,
        mbs=v.mbs,
        interface=v.choice("pin"),
        loadVector=v.vector,
        bodyFixed=v.flag,
        loadVectorUserFunction=v.function,
        name=v.text(""),
    ),
    "PartitionBody.CreateNodeMarker": call(of=_item, mbs=v.mbs, point=v.vector),
    "PartitionBody.CreatePointMarker": call(of=_item, mbs=v.mbs, point=v.vector.but(outside=(1, 1, 1))((0, 0, 5e-3))),
    **{
        f"PartitionBody.{name}": call(of=_item, result=v.result)
        for name in ("coordinates", "coordinates_t", "momentum", "energy", "dissipated_energy")
    },
    **{
        f"PartitionBody.{name}": call(of=_item, result=v.result, point=v.vector.but(outside=(1, 1, 1)), fem=_fem)
        for name in ("displacement", "velocity")
    },
    "PartitionBody.angular_momentum": call(of=_item, result=v.result, point=v.vector),
    "PartitionBody.recover": call(of=_item, result=v.result, rows=_rows, fem=_fem),
    "PartitionBody.stress": call(of=_item, result=v.result, **{**_fems, "fem": _own_fem}),
    "PartitionBody.rigid_motion": call(of=_item, q=_q(Made(lambda s: np.zeros((1, s.body.n_dofs))))),
    "PartitionBody.deformation": call(of=_item, q=_q(Made(lambda s: np.zeros((1, s.body.n_dofs))))),
    "PartitionContact.impacts": call(**_of_result, merge=v.number.but(negative=-1.0)(0.0)),
    "PartitionContact.mean_force": call(**_of_result, window=v.positive.or_none(1e-6)),
    **{
        f"PartitionContact.{name}": call(**_of_result)
        for name in (
            "force",
            "force_on_slave",
            "closed_rows",
            "gap",
            "row_forces",
            "pressure",
            "area",
            "radius",
            "ringing",
            "largest_stress",
            "energy",
            "nodal_forces",
            "closed_samples",
            "moment_on_slave",
            "edge_reached",
            "depth",
        )
    },
    **{
        f"PartitionContact.{name}": call(of=lambda s: s.sticking[0], result=v.result(Made(lambda s: s.sticking[1])))
        for name in (
            "tangential_force",
            "stuck_rows",
            "dissipated_energy",
            "row_states",
            "row_tractions",
            "traction",
            "slip_path",
        )
    },
    **{
        f"PartitionContact.{name}": call(of=lambda s: s.yielding[0], result=v.result(Made(lambda s: s.yielding[1])))
        for name in ("plastic_work", "plastic_strain", "plastic_states", "strain_histories", "dents", "flow_at_border")
    },
    "output.write_plastic_zones": call(
        folder=v.folder(Made(lambda s: s.folder / "zones")),
        contact=v.contact(Made(lambda s: s.yielding[0])),
        result=v.result(Made(lambda s: s.yielding[1])),
    ),
    "PlasticState.save": call(of=_state, path=v.path_out(Made(lambda s: s.folder / "state.npz"))),
    "PlasticState.load": call(of=_state, path=v.path_in(Made(_saved_state))),
    "PartitionContact.AddMomentSensor": call(of=_contact, mbs=v.mbs, point=v.vector),
    "collect": call(mbs=v.mbs.but(**{"not run": _ready.right})),
    "stability_limit": call(mbs=v.mbs),
    "solve_static": call(
        mbs=_runnable,
        load_steps=v.count(1),
        load_factor=v.flag,
        update_initial=v.flag,
        settings=_settings,
        progress=v.function,
    ),
    "solve_dynamic": call(
        mbs=_runnable,
        end_time=v.positive.but(**{"1e-20": 1e-20, "1e30": 1e30})(4 * STEP),
        start_time=v.number.or_none.but(**{"beyond the end": 1.0, "1e-30": -1e30}),
        go_on=v.flag,
        step=v.positive.or_none.but(unstable=1.0, **{"1e-30": 1e-30})(STEP),
        method=v.choice("explicit"),
        sample_period=v.positive.or_none,
        spectral_radius=v.share.but(**{"of explicit steps": 2.0})(0.9),
        adaptive=v.flag,
        free_step=v.positive.or_none.but("number"),
        gap_tolerance=v.positive.or_none,
        unresolved=v.positive.or_none,
        settings=_settings,
        progress=v.function,
    ),
    "time_to_contact": call(
        contact=v.contact,
        q=_q(Made(lambda s: np.zeros(s.body.n_dofs + s.other_body.n_dofs))),
        q_t=_q(Made(lambda s: np.zeros(s.body.n_dofs + s.other_body.n_dofs))),
        q_tt=_q.or_none,
        swaps=False,
    ),
    "Result.sensor": call(
        of=_result, number=Kind({**v.NOTHING, "beyond": 999, "negative": -1, "half": 1.5, "list": [1]}, 0)
    ),
    "Result.sensor_of": call(
        of=_result, item=v.own("item", "contact").but(**_foreign_item)(Made(_item)), number=v.count(0).but("zero")
    ),
    "Result.kept": call(of=_result, contact=v.contact.but(**_foreign_contact)),
    "Result.at": call(of=_result, times=v.times(2)),
    "Result.report": call(of=_result, path=v.path_out(Made(lambda s: s.folder / "run.html")), title=v.text("")),
    "Result.film": call(
        of=_result,
        path=v.path_out.but(film=Made(lambda s: s.folder / "run.avi"))(Made(lambda s: s.folder / "run.gif")),
        bodies=_bodies,
        colour=v.choice("speed"),
        end=v.positive.or_none,
        frames=_frames,
        period=v.positive(0.04),
        scale=_scale,
        view=v.choice("all"),
        direction=_direction,
        size=_size((80, 60)),
        progress=v.function,
    ),
    "Result.scene": call(
        of=_result,
        path=v.path_out.or_none(None),
        bodies=_bodies,
        colours=Kind({"text": "speed", "number": 1, "empty": [], "unknown": ["x"], "dict": {1: 2}}, None),
        frames=_frames,
        scale=_scale,
        title=v.text(""),
        height=v.count.but(one=1)(300),
        progress=v.function,
    ),
    "Result.history": call(of=_result, contact=v.contact.but(**_foreign_contact), points=_body_points),
    "Result.save": call(of=_result, path=v.path_out(Made(lambda s: s.folder / "npz"))),
    "Result.load": call(
        path=v.path_in.but(**{"a body": Made(lambda s: s.folder / "body.npz")})(Made(lambda s: s.folder / "run.npz")),
        mbs=v.mbs.but("None", **{"another": _new.right}),
    ),
    "History": call(
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
        swaps=False,
    ),
    "History.until": call(of=_history, end_time=v.number.but(before=-1.0)(1.0)),
    "History.save": call(of=_history, path=v.path_out(Made(lambda s: s.folder / "saved"))),
    "History.load": call(path=v.path_in(Made(lambda s: s.folder / "history.npz"))),
    "Comparison": call(
        error=Kind({**v.NOTHING, "text in it": {"a": "x"}, "nan": {"a": v.nan}, "negative": {"a": -1}}).but("dict")(
            {"a": 1.0}
        ),
        time_s=v.number.but("nan", negative=-1.0),
        reference_time_s=v.number.but("nan", negative=-1.0),
        end_time=v.number,
        swaps=False,
    ),
    "compare": call(run=v.history, reference=v.history, swaps=False),
    "report.front": call(runs=_runs.but("dict"), quantity=v.choice("force")),
    "report.validate_runs": call(runs=_runs.but("dict"), quantity=v.choice("force")),
    "amplitude_spectrum": call(t=_signal_t, x=_signal_x, window=v.choice("hann"), swaps=False),
    "truncation_frequency": call(
        t=_signal_t,
        x=_signal_x.but(constant=np.ones(101)),
        tolerance=v.share.but(zero=0.0)(0.01),
        window=v.choice("none"),
        swaps=False,
    ),
    "hertz.contact_radius": call(
        force=v.positive,
        radius_1=_radius,
        radius_2=_radius,
        material_1=v.material,
        material_2=v.material.or_none,
        swaps=False,
    ),
    "hertz.effective": call(first=v.limit, second=v.limit, swaps=False),
    "hertz.rod_impedance": call(material=v.material, area=v.positive),
    "hertz.plate_impedance": call(material=v.material, thickness=v.positive),
    "hertz.impact": call(
        mass=v.limit,
        speed=v.positive,
        radius_1=_radius,
        radius_2=_radius,
        material_1=v.material,
        material_2=v.material.or_none,
        impedance=v.limit,
        swaps=False,
    ),
    "hertz.HertzImpact.truncation_frequency": call(
        of=lambda s: ep.hertz.impact(1.0, 1.0, 1.0, 1.0, ep.STEEL), tolerance=v.share.but(zero=0.0)(0.01)
    ),
    "StrainGauge": call(
        position=v.vector, direction=v.direction, length=v.positive(1e-3), name=v.text(""), swaps=False
    ),
    "recovery.gauge_rows": call(
        fem=v.fem, gauges=v.several(Kind(v.NOTHING))(Made(lambda s: [ep.StrainGauge((0, 0, 5e-3), (0, 0, 1), 1e-3)]))
    ),
    **{f"recovery.{name}": call(**_fems) for name in ("displacement_rows", "strain_rows", "stress_rows")},
    **{
        f"recovery.{name}": call(fem=v.fem, displacement=_q(Made(lambda s: np.zeros((s.fem.n_nodes, 3)))))
        for name in ("nodal_strain", "nodal_stress")
    },
    "recovery.von_mises": call(stress=_q.but(**{"five": np.zeros(5)})(np.zeros((2, 6)))),
    "recovery.static_correction": call(fem=_own_fem, body=v.body, patch=v.patch),
    "recovery.StaticAnswer": call(fem=_own_fem, body=v.body),
    "recovery.StaticAnswer.check": call(
        of=lambda s: ep.recovery.StaticAnswer(s.fem, s.body), body=v.body.but(another=Made(lambda s: s.other_body))
    ),
    "reference.FullBody": call(
        fem=v.fem.but(**{"another mesh": Made(lambda s: s.other_fem)}),
        partition=v.part,
        position=v.vector,
        velocity=v.vector,
        mass=v.choice("lumped"),
        patch=v.patch(None),
        plastic=v.choice("none"),
        plastic_state=Kind({"text": "x", "number": 1, "elastic": Made(_state)}, None),
    ),
    "reference.simulate": call(
        bodies=_two,
        end_time=v.positive(4 * STEP),
        step=v.positive.but(**{"longer": 1.0, "1e-30": 1e-30})(STEP),
        points=_named_points,
        alpha=v.share(0.1),
        rows=v.choice("integrated"),
        friction=v.friction,
        progress=v.function,
        swaps=False,
    ),
    "output.write_paraview": call(
        folder=v.folder(Made(lambda s: s.folder / "paraview")),
        result=v.own_result,
        bodies=_bodies,
        fields=v.choice.but(none=[], **{"stress without a mesh": "stress"})("velocity"),
        times=v.times(2),
        contacts=_contacts,
        surface=v.flag(True),
        static_answer=v.flag,
        progress=v.function,
    ),
    "plot.force": call(
        axes=_axes, run=v.run(_result and Made(_result)), reference=v.history.or_none, contact=_plain_contact
    ),
    "plot.velocity": call(
        axes=_axes,
        point=v.vector.but(outside=(1, 1, 1)),
        run=v.run(Made(_result)),
        reference=v.history.or_none,
        axis=v.count(2).but("zero", three=3),
        body=_plain_body(Made(_item)),
    ),
    "plot.spectrum": call(
        axes=_axes,
        run=v.run(Made(_result)),
        point=v.vector.or_none,
        axis=v.count(2).but("zero", three=3),
        contact=_plain_contact,
        body=v.Kind({}),
        f_cut=v.positive.or_none,
        swaps=False,
    ),
    "plot.energy": call(axes=_axes, result=v.own_result, bodies=_bodies.but("empty"), contacts=_contacts),
    "plot.pressure": call(
        axes=_axes,
        result=v.own_result,
        time=v.number.or_none.but(beyond=1.0, negative=-1.0)(STEP),
        contact=_plain_contact,
    ),
    "plot.stick": call(
        axes=_axes,
        result=v.own_result(Made(lambda s: s.sticking[1])),
        time=v.number.or_none.but(beyond=1.0, negative=-1.0)(STEP),
        contact=_plain_contact,
    ),
    "plot.selection": call(
        fem=v.fem.but(other=Made(lambda s: s.other_fem)), partition=v.part, axes=_axes, direction=_direction
    ),
    "plot.bodies": call(
        result=v.own_result,
        time=v.number.or_none.but(beyond=1.0, negative=-1.0)(STEP),
        bodies=_bodies,
        axes=_axes,
        colour=v.choice("speed"),
        end=v.positive.or_none,
        scale=_scale,
        direction=_direction,
    ),
    "plot.modes": call(axes=_axes, body=v.item_or_body),
    "plot.pareto": call(axes=_axes, runs=_runs, quantity=v.choice("force")),
    "plot.overview": call(run=v.run(Made(_result)), reference=v.history.or_none, contact=_plain_contact),
    "CreatePartitionView": call(
        mbs=v.mbs(Made(lambda s: s.mbs)),
        bodies=_bodies,
        field=v.choice("velocity"),
        scale=v.positive.but(**{"1e300": 1e300}),
        limits=_limits,
    ),
    "view.picture": call(**_SCENE, rotation=v.vector, size=_size),
    "view.show": call(
        result=v.own_result,
        bodies=_bodies,
        field=v.choice("velocity"),
        scale=v.positive.but(**{"1e300": 1e300}),
        limits=_limits,
        times=v.times(2),
        period=v.positive,
        cycles=v.count.or_none(1),
    ),
    "pyvista_view.plotter": call(**_SCENE, size=_size),
    "pyvista_view.turntable": call(
        path=v.path_out(Made(lambda s: s.folder / "turn.gif")),
        **_SCENE,
        size=_size((80, 60)),
        frames=v.count.but(one=1, beyond=10**6)(2),
        period=v.positive,
    ),
    "progress": call(title=v.text, after=v.number.but(negative=-1.0)(0.0)),
}

_MADE_BY_US = "made by the library, whose functions check what it is made of"
_EVERY_STEP = "called by Exudyn's solvers in every step, with what they have"
_INSIDE = "takes what the library has checked, in loops"
NOT_CALLED = {
    "Partition": _MADE_BY_US,
    "Estimate": _MADE_BY_US,
    "ImpactDesign": _MADE_BY_US,
    "ReducedBody": _MADE_BY_US,
    "PartitionBody": _MADE_BY_US,
    "PartitionContact": _MADE_BY_US,
    "WorkSensor": _MADE_BY_US,
    "Result": _MADE_BY_US,
    "hertz.HertzImpact": _MADE_BY_US,
    "PartitionBody.is_in": _EVERY_STEP,
    "PartitionContact.slices": _EVERY_STEP,
    **{
        f"{name}.project": _EVERY_STEP
        for name in ("RigidPlane", "RigidSphere", "RigidCylinder", "RigidProfile", "RigidMesh")
    },
    "PlasticState": _MADE_BY_US,
    **{f"PlasticState.{name}": _INSIDE for name in ("virgin", "at", "changed")},
    "Refine.n_elements": _INSIDE,
    "Partition.is_of": _INSIDE,
    "Partition.check_mesh": _INSIDE,
    "ReducedBody.check_inside": _INSIDE,
    "ReducedBody.check_nodes": _INSIDE,
    "ReducedBody.shape_rows": _INSIDE,
}
NOT_EVERYWHERE = {"view.show": "it needs a screen"}  # right calls that may fail


@dataclass(frozen=True)
class Misuse:
    """A wrong call: its name, the function, and what it is called with, by argument."""

    name: str
    function: Any
    of: Any
    arguments: dict[str, Any]

    def __call__(self, scene):
        """Make the call."""

        def made(value):
            return value.make(scene) if isinstance(value, Made) else value

        function, arguments = self.function, {name: made(value) for name, value in self.arguments.items()}
        if self.of is not None:
            function = getattr(self.of(scene), function.__name__)
        found = function(**arguments)
        if hasattr(found, "__enter__"):
            with found:
                pass
        return found


def right_calls():
    """Each function called with its right values: what refuses these tells nothing of the wrong ones."""
    callables = public()
    return [
        Misuse(f"{name}, right", callables[name], entry.of, {key: kind.right for key, kind in entry.arguments.items()})
        for name, entry in CALLS.items()
        if name not in NOT_EVERYWHERE
    ]


def misuses(functions=None):
    """All wrong calls: each argument of each function with each wrong value, and arguments given for each other."""
    found, callables = [], public()
    for name, entry in CALLS.items():
        if functions is not None and name not in functions:
            continue
        right = {argument: kind.right for argument, kind in entry.arguments.items()}
        for argument, kind in entry.arguments.items():
            for said, wrong in kind.wrong.items():
                title = f"{name}({argument}={said})"
                found.append(Misuse(title, callables[name], entry.of, {**right, argument: wrong}))
        if entry.swaps:
            for one, other in combinations([*right][:3], 2):
                if right[one] is not None and right[other] is not None:
                    title = f"{name}({one} and {other} swapped)"
                    swapped = {**right, one: right[other], other: right[one]}
                    found.append(Misuse(title, callables[name], entry.of, swapped))
    return found
