"""The values of `misuse.py`: a small scene, and for each kind of argument a right value and many wrong ones.

A wrong value is wrong wherever its kind is asked for. So a call that accepts it silently is a fault.
"""

import contextlib
import io
import os
import tempfile
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import exudyn as exu
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

LONG = "x" * 400  # longer than a file's name may be
STEP, LENGTH = 0.5e-6, 0.04


@dataclass(frozen=True)
class Made:
    """A value that is made of the scene for each call."""

    make: Any

    def __repr__(self):
        return "..."


class Scene:
    """Two small bars, one above the other: as meshes, reduced, in models, after a run. Made once a process."""

    def __init__(self):
        self._folder = tempfile.TemporaryDirectory(prefix="misuse")
        self.folder = Path(self._folder.name)
        upper, lower = (occ.Box((-5e-3, -5e-3, z), (5e-3, 5e-3, z + LENGTH)) for z in (0.0, -LENGTH))
        self.shape = upper
        self.fem, self.other_fem = (ep.fe_model(s, ep.STEEL, maxh=8e-3) for s in (upper, lower))
        high = np.flatnonzero(self.fem.points[:, 2] > LENGTH - 1e-9)
        self.part = (
            ep.Partition.ball(self.fem, (0, 0, 0), 4e-3, name="tip")
            | ep.Partition.interface(self.fem, "pin", high, kind="averaged")
            | ep.Partition.load(self.fem, "weight", ((-1, -1, LENGTH - 1e-9), (1, 1, 1)))
        )
        self.other_part = ep.Partition.ball(self.other_fem, (0, 0, 0), 4e-3)
        self.body = ep.reduce(self.fem, self.part, f_cut=60e3)
        self.other_body = ep.reduce(self.other_fem, self.other_part, f_cut=60e3)
        self.full = ep.reference.FullBody(self.fem, self.part, velocity=(0, 0, -1))
        self.other_full = ep.reference.FullBody(self.other_fem, self.other_part)
        self.mbs, self.item, self.target, self.contact = self.model()
        self.contact.AddMomentSensor(self.mbs)
        self.mbs.Assemble()
        self.result = ep.solve_dynamic(self.mbs, end_time=20 * STEP, step=STEP)
        self.history = self.result.history(self.contact, {"P": (self.item, (0, 0, LENGTH), self.fem)})
        self.comparison = ep.Comparison({"force": 0.1}, 1.0, 2.0, 1.0)
        self.body.save(self.folder / "body.npz")
        self.result.save(self.folder / "run.npz")
        self.history.save(self.folder / "history.npz")
        self.shape.WriteStep(str(self.folder / "block.step"))
        (self.folder / "text.npz").write_text("no archive")
        (self.folder / "empty.npz").write_bytes(b"")
        whole = (self.folder / "body.npz").read_bytes()
        (self.folder / "half.npz").write_bytes(whole[: len(whole) // 2])
        np.savez(self.folder / "other.npz", x=1)
        np.save(self.folder / "pickled.npy", np.array([{}], dtype=object), allow_pickle=True)

    @cached_property
    def softer(self):
        """FE model of the upper block of a softer material, on the same mesh."""
        return ep.fe_model(self.shape, replace(ep.STEEL, E=200e9), maxh=8e-3)

    @cached_property
    def heavier(self):
        """FE model of the upper block of a denser material, on the same mesh."""
        return ep.fe_model(self.shape, replace(ep.STEEL, rho=7900.0), maxh=8e-3)

    @property
    def moved(self):
        """FE model of the upper block at another place."""
        return replace(self.fem, points=self.fem.points + 1e-3)

    @cached_property
    def foreign(self):
        """Body and contact of another model."""
        _, item, _, contact = self.model()
        return item, contact

    @cached_property
    def sticking(self):
        """Contact of the upper block with a floor, with friction, and the result of its run."""
        part = ep.Partition.ball(self.fem, (0, 0, 0), 4e-3, axes="xyz")
        mbs = self.empty()
        item = ep.CreatePartitionBody(mbs, ep.reduce(self.fem, part, f_cut=60e3), initialVelocity=[0.1, 0, -1])
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=0.3)
        mbs.Assemble()
        return contact, ep.solve_dynamic(mbs, end_time=20 * STEP, step=STEP)

    @cached_property
    def yielding(self):
        """Contact of the upper block, which may yield, with a floor, and the result of its run."""
        material = replace(self.fem.material, yield_stress=1e-3 * self.fem.material.E, hardening=0.0)
        fem = replace(self.fem, material=material)
        mbs = self.empty()
        body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 4e-3), f_cut=60e3)
        item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -1])
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
        mbs.Assemble()
        return contact, ep.solve_dynamic(mbs, end_time=20 * STEP, step=STEP)

    def falling(self):
        """Model of the upper block under gravity."""
        mbs = self.empty()
        ep.CreatePartitionBody(mbs, self.body, gravity=[0, 0, -9.81])
        return mbs

    @cached_property
    def working(self):
        """Sensor of the work of gravity, and the result of its run."""
        mbs = self.falling()
        sensor = ep.CreateWorkSensor(mbs)
        mbs.Assemble()
        return sensor, ep.solve_dynamic(mbs, end_time=4 * STEP, step=STEP)

    def apart(self):
        """Model of both bodies without a contact; `striker` and `struck` are those of the last one."""
        mbs = exu.SystemContainer().AddSystem()
        self.striker = ep.CreatePartitionBody(mbs, self.body, name="upper", initialVelocity=[0, 0, -1])
        self.struck = ep.CreatePartitionBody(mbs, self.other_body, name="lower")
        return mbs

    def model(self):
        """Model, striker, target and contact, not assembled."""
        mbs = self.apart()
        contact = ep.CreatePartitionContact(mbs, self.striker, self.struck, name="contact")
        return mbs, self.striker, self.struck, contact

    def assembled(self):
        """A model that is ready to run."""
        mbs = self.model()[0]
        mbs.Assemble()
        return mbs

    def empty(self):
        """A model without anything."""
        return exu.SystemContainer().AddSystem()

    def pipe(self):
        """A pipe that nobody writes into."""
        path = self.folder / "pipe"
        with contextlib.suppress(FileExistsError):
            os.mkfifo(path)
        return path


@dataclass(frozen=True)
class Kind:
    """Wrong values of a kind of argument, by what is said of them; a right one where most calls take the same."""

    wrong: dict[str, Any]
    right: Any = None
    optional: bool = field(default=False)

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
NOTHING = {"None": None, "text": "x", "dict": {}, "object": object()}
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
function = Kind({"text": "x", "number": 1, "list": []}, None)
times = Kind({**NOTHING, "nan": [nan], "beyond": [1.0], "negative": [-1.0], "no frames": 0, "half": 0.5, "-1": -1})
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
        "folder": Made(lambda s: s.folder),
        "no folder": Made(lambda s: s.folder / "none" / "x"),
        "below a file": Made(lambda s: s.folder / "text.npz" / "x"),
        "device": "/dev/full",
        "/proc": "/proc/x",
        "pipe": Made(Scene.pipe),
    },
)
path_in = path_out.but(
    "device",
    "/proc",
    **{
        "missing": Made(lambda s: s.folder / "none"),
        "no archive": Made(lambda s: s.folder / "text.npz"),
        "empty file": Made(lambda s: s.folder / "empty.npz"),
        "half a file": Made(lambda s: s.folder / "half.npz"),
        "another archive": Made(lambda s: s.folder / "other.npz"),
        "pickle": Made(lambda s: s.folder / "pickled.npy"),
        "device": "/dev/null",
    },
)
folder = path_out.but("folder", "no folder", file=Made(lambda s: s.folder / "text.npz"))

_OWN = {
    "material": Made(lambda s: ep.STEEL),
    "fem": Made(lambda s: s.fem),
    "part": Made(lambda s: s.part),
    "body": Made(lambda s: s.body),
    "item": Made(lambda s: s.item),
    "contact": Made(lambda s: s.contact),
    "result": Made(lambda s: s.result),
    "history": Made(lambda s: s.history),
    "mbs": Made(lambda s: s.mbs),
    "comparison": Made(lambda s: s.comparison),
    "shape": Made(lambda s: s.shape),
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
result = result.but(**{"of another model": Made(lambda s: _result_of_another(s))})
run = own("result", "history")
item_or_body = own("item", "body")


def _result_of_another(scene):
    mbs = scene.assembled()
    with contextlib.redirect_stdout(io.StringIO()):
        return ep.solve_dynamic(mbs, end_time=2 * STEP, step=STEP)


def several(kind):
    """A list of a kind: wrong are all that its members may not be, alone and in a list."""
    wrong = {name: value for name, value in kind.wrong.items() if name not in ("None", "list", "in a list", "dict")}

    def listed(value):
        return Made(lambda s: [value.make(s) if isinstance(value, Made) else value])

    return Kind({**wrong, **{f"[{name}]": listed(value) for name, value in wrong.items()}, "dict": {1: 2}})
