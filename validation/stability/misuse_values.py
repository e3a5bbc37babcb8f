"""The kinds of arguments of `misuse.py`: for each a right value, where most calls take the same, and many wrong ones.

A wrong value is wrong wherever its kind is asked for. So a call that accepts it silently is a fault.
"""

from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
import scipy.sparse as sp

import exudyn_partition as ep
from validation.stability.misuse_objects import Made, Scene, file, the

LONG = "x" * 400  # longer than a file's name may be


@dataclass(frozen=True)
class Kind:
    """Wrong values of a kind of argument, by what is said of them; a right one where most calls take the same."""

    wrong: dict[str, Any]
    right: Any = None

    def but(self, *names, **more):
        """The same kind without some of the wrong values, and with others."""
        return Kind({k: v for k, v in {**self.wrong, **more}.items() if k not in names}, self.right)

    def __call__(self, right):
        """The same kind with another right value."""
        return Kind(self.wrong, right)

    @property
    def or_none(self):
        """The same kind where None is right, as it means the default."""
        return Kind({k: v for k, v in self.wrong.items() if k != "None"}, None)


class WithUnit(np.ndarray):
    """An array with a unit, as packages for quantities have it."""

    unit = "mm"

    @classmethod
    def of(cls, value):
        """The value in millimetres."""
        return np.asarray(value).view(cls)


nan, inf = float("nan"), float("inf")
NOTHING = {"None": None, "text": "x", "dict": {}, "object": object(), "text without axes": np.array("x")}
NUMBERS = {**NOTHING, "list": [1, 2], "complex": 1j, "nan": nan, "inf": inf, "text of a number": "1.0", "True": True}
# What float() and NumPy read as numbers, and what loses its meaning on the way.
NUMBERS |= {
    "complex of NumPy": np.complex128(1 + 1j),
    "text without axes": np.array("1.0"),
    "True without axes": np.array(True),
    "duration": np.timedelta64(1, "s"),
    "masked": np.ma.array(1.0, mask=True),
    "memory": memoryview(b"1"),
    "bytes": bytearray(b"1"),
    "of a unit": WithUnit.of(1.0),
    "one in an array": np.ones(1),
}

number = Kind(NUMBERS, 1.0)
positive = number.but(**{"negative": -1.0, "zero": 0.0})
limit = positive.but("inf")  # math.inf is a wall, a plane, ...
share = number.but(**{"negative": -0.1, "two": 2.0})
friction = number.but("None", **{"negative": -0.1, "per cent": 30.0})(0.3)
count = Kind({**NOTHING, "half": 1.5, "negative": -1, "zero": 0, "nan": nan, "list": [1], "True": True}, 1)
count = count.but(
    **{"duration": np.timedelta64(1, "s"), "masked": np.ma.array(1, mask=True), "of a unit": WithUnit.of(1)}
)
_VECTORS = {
    **NOTHING,
    "number": 1.0,
    "two": (0, 0),
    "four": (0, 0, 0, 0),
    "nested": [[0, 0, 0]],
    "nan": (nan, 0, 0),
    "inf": (0, inf, 0),
    "texts": ("0", "0", "0"),
    "Nones": (None, 0, 0),
    "ragged": [0, [0], 0],
    "huge": (10**400, 0, 0),
    "durations": np.array([0, 0, 1], "m8[s]"),
    "dates": np.array([0, 0, 1], "M8[s]"),
    "masked": np.ma.array([0.0, 0.0, 1.0], mask=[0, 0, 1]),
    "truth values": np.array([False, False, True]),
    "a truth value": [0.0, 0.0, True],
    "complex": np.array([0, 0, 1 + 1j]),
    "with fields": np.array([(0, 0, 1)], dtype="f8,f8,f8"),
    "bytes": bytearray(b"001"),
    "of a unit": WithUnit.of([0.0, 0.0, 1.0]),
    "some of a unit": [0.0, 0.0, WithUnit.of(1.0)],
}
vector = Kind(_VECTORS, (0.0, 0.0, 0.0))
direction = vector.but(zero=(0, 0, 0))((0.0, 0.0, 1.0))
points = Kind({**NOTHING, "flat": (0, 0, 0), "pairs": [[0, 0]], "nan": [(nan, 0, 0)], "far away": [(1, 1, 1)]})
points = points.but(**{
    "durations": np.array([[0, 0, 1]], "m8[s]"),
    "masked": np.ma.array([[0.0, 0.0, 1.0]], mask=True),
    "truth values": np.array([[False, False, True]]),
    "of a unit": WithUnit.of([[0.0, 0.0, 1.0]]),
})  # fmt: skip
text = Kind({"None": None, "number": 1, "bytes": b"x", "list": [], "NUL": "a\0b"}, "name")
choice = Kind({**NOTHING, "empty": "", "number": 1, "list": ["x"], "array": np.arange(3)})
flag = Kind({"None": None, "text": "yes", "number": 2, "list": [], "half": 0.5}, False)
patch = Kind({"unknown": "none", "negative": -1, "beyond": 99, "half": 0.5, "True": True, "list": [0], "dict": {}})
function = Kind({"text": "x", "number": 1, "list": [], "class": dict}, None)
times = Kind(
    {**NOTHING, "nan": [nan], "none": [], "beyond": [1.0], "negative": [-1.0], "no frames": 0, "half": 0.5, "-1": -1}
)
samples = Kind({**NOTHING, "number": 1.0, "nested": [[0.0, 1.0]], "nan": [0, nan, 1], "texts": ["a", "b", "c"]})
samples = samples.but(**{
    "durations": np.arange(101).astype("m8[us]"),
    "dates": np.arange(101).astype("M8[us]"),
    "masked": np.ma.array(np.arange(101.0), mask=np.arange(101) == 50),
    "truth values": np.arange(101) > 50,
    "of a unit": WithUnit.of(np.arange(101.0)),
})  # fmt: skip
path_out = Kind(
    {
        "None": None,
        "number": 1,
        "list": [],
        "bytes": b"x",
        "empty": "",
        "NUL": "a\0b",
        "400 characters": LONG,
        "folder": the.folder,
        "no folder": file("none/x"),
        "below a file": file("text.npz/x"),
        "device": "/dev/full",
        "/proc": "/proc/x",
        "pipe": Made(Scene.pipe),
    },
)
path_in = path_out.but(
    "device",
    "/proc",
    **{
        "missing": file("none"),
        "no archive": file("text.npz"),
        "empty file": file("empty.npz"),
        "half a file": file("half.npz"),
        "another archive": file("other.npz"),
        "pickle": file("pickled.npy"),
        "device": "/dev/null",
    },
)
folder = path_out.but("folder", "no folder", file=file("text.npz"))

_OWN = {
    "material": Made(lambda s: ep.STEEL),
    "fem": the.fem,
    "part": the.part,
    "body": the.body,
    "item": the.item,
    "contact": the.contact,
    "result": the.result,
    "history": the.history,
    "mbs": the.mbs,
    "comparison": the.comparison,
    "shape": the.shape,
}


def own(name, *also_right):
    """A thing of the library: wrong are None, plain values, all other things, and the thing in a list."""
    wrong = {**NOTHING, "number": 1.0, "list": [], "class": dict}
    wrong |= {f"a {other}": value for other, value in _OWN.items() if other not in (name, *also_right)}
    wrong["in a list"] = Made(lambda s: [_OWN[name].make(s)])
    return Kind(wrong, _OWN[name])


material, fem, part, body, item = (own(name) for name in ("material", "fem", "part", "body", "item"))
contact, result, history, mbs = (own(name) for name in ("contact", "result", "history", "mbs"))
mbs = mbs.but(**{"a SystemContainer": Made(lambda s: exu.SystemContainer())})
own_result = result
result = result.but(**{"of another model": Made(Scene.another_result)})
run = own("result", "history")
item_or_body = own("item", "body")


def several(kind):
    """A list of a kind: wrong are all that its members may not be, alone and in a list."""
    wrong = {name: value for name, value in kind.wrong.items() if name not in ("None", "list", "in a list", "dict")}

    def listed(value):
        return Made(lambda s: [value.make(s) if isinstance(value, Made) else value])

    return Kind({**wrong, **{f"[{name}]": listed(value) for name, value in wrong.items()}, "dict": {1: 2}})


# Kinds of several functions
foreign_item, foreign_contact = {"of another model": the.foreign.item}, {"of another model": the.foreign.contact}
of_mesh = fem.but(**{"another mesh": the.other_fem})
of_body = of_mesh.but(**{"another material": the.softer, "another density": the.heavier}, elsewhere=the.moved)
inside = vector.but(outside=(1, 1, 1))
scale = positive.but(**{"1e300": 1e300})
# Hollows are right; one that fits the other surface is not, for they would touch all over.
radius_of_two = limit.but("negative", **{"hollow of the other's radius": -0.01, "narrower hollow": -0.005})(0.01)
numbers = Kind({**NOTHING, "halves": [0.5], "beyond": [10**6], "negative": [-1]}, np.arange(2))
nodes = Kind({**NOTHING, "none": [], "halves": [0.5, 1.5, 2.5], "beyond": [0, 1, 10**6], "negative": [-1, 0, 1]})
nodes = nodes.but(ragged=[0, [0], 0], Trues=[True, False, True])(np.arange(12))
motion = Kind({**NOTHING, "number": 1.0, "flat": np.zeros(3), "nan": np.full((1, 12), nan), "texts": [["a"]]})
patches = Kind({"text": "x", "one": (0,), "beyond": (9, 9), "number": 1}, (None, None))
runs = Kind({**NOTHING, "list": [1], "of numbers": {"a": 1.0}, "empty name": {"": None}})
runs = runs(Made(lambda s: {"run": s.comparison}))
model_and_partition = Kind(
    {
        **NOTHING,
        "fem": the.fem,
        "swapped": Made(lambda s: (s.part, s.fem)),
        "three": Made(lambda s: (s.fem, s.part, 1)),
        "of two meshes": Made(lambda s: (s.fem, s.other_part)),
    }
)
model_and_body = Kind(
    {
        **NOTHING,
        "fem": the.fem,
        "swapped": Made(lambda s: (s.body, s.fem)),
        "three": Made(lambda s: (s.fem, s.body, 1)),
        "of two meshes": Made(lambda s: (s.fem, s.other_body)),
        "of two materials": Made(lambda s: (s.softer, s.body)),
    }
)
shape_and_material = Kind(
    {
        **NOTHING,
        "shape": the.shape,
        "swapped": Made(lambda s: (ep.STEEL, s.shape)),
        "three": Made(lambda s: (s.shape, ep.STEEL, 1)),
        "FE model": Made(lambda s: (s.fem, ep.STEEL)),
        "no STEP file": Made(lambda s: (s.folder / "text.npz", ep.STEEL)),
        "missing": ("none.step", ep.STEEL),
        "flat": Made(lambda s: (s.shape, ep.STEEL)),
    }
)


def matrix(name):
    """Values of a matrix of an FE model."""

    def changed(change):
        return Made(lambda s: change(getattr(s.fem, name)))

    def by_axes(matrix):  # all dofs x first, then y, then z
        order = np.arange(matrix.shape[0]).reshape(-1, 3).T.ravel()
        return matrix[order][:, order]

    return Kind(
        {
            **NOTHING,
            "zeros": changed(lambda m: 0 * m),
            "times 1000": changed(lambda m: 1000 * m),
            "complex": changed(lambda m: m * (1 + 0.1j)),
            "complex list of lists": changed(lambda m: sp.lil_matrix(m) * 1j),
            "one triangle": changed(lambda m: sp.triu(m, format="csr")),
            "an entry on one side": changed(lambda m: m + sp.csr_matrix(([1e-3 * m.max()], ([0], [5])), m.shape)),
            "one row changed": changed(lambda m: sp.diags(1 + (np.arange(m.shape[0]) == 7)) @ m),
            "not square": changed(lambda m: m[:-3]),
            "truth values": changed(lambda m: m.astype(bool)),
            "dense of text": changed(lambda m: m.toarray().astype(str)),
            "other order of dofs": changed(by_axes),
            "of another mesh": sp.identity(3),
            "nan": changed(lambda m: m * nan),
        },
        changed(lambda m: m),
    )
