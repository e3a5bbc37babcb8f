"""What the calls of `misuse.py` are made with: a small scene with its bodies, models, results and files.

What a table takes of it is written `the.body`, `file("body.npz")` or `Made(function)`, and made for each call.
"""

import contextlib
import io
import os
import tempfile
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import exudyn as exu
import netgen.occ as occ
import numpy as np
import scipy.sparse as sp
from exudyn.FEM import FEMinterface

import exudyn_partition as ep
from exudyn_partition.meshing.mesh_files import write_vtu

STEP, LENGTH = 0.5e-6, 0.04


@dataclass(frozen=True)
class Made:
    """A value that is made of the scene for each call, by a function; so are its attributes."""

    make: Any

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        return Made(lambda scene: getattr(self.make(scene), name))

    def __repr__(self):
        return "..."


the = Made(lambda scene: scene)


def file(name):
    """A path in the scene's folder."""
    return Made(lambda scene: scene.folder / name)


class Run(NamedTuple):
    """What a scene's run is asked for, and its result."""

    of: Any
    result: Any


class Pair(NamedTuple):
    """A body's item, and its contact."""

    item: Any
    contact: Any


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
        write_vtu(self.folder / "block.vtu", self.fem.points, [("tetra10", self.fem.cells)], {})
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

    @cached_property
    def tolerant(self):
        """The upper block, reduced to a tolerance."""
        return ep.reduce(self.fem, self.part, tolerance=0.2)

    @cached_property
    def assembly(self):
        """What the STEP file of the upper block holds."""
        return ep.read_step(self.folder / "block.step", scale=1.0)

    @cached_property
    def bodies(self):
        """What a mesh file of the upper block holds."""
        return ep.read_bodies(self.folder / "block.vtu")

    @property
    def moved(self):
        """FE model of the upper block at another place."""
        return replace(self.fem, points=self.fem.points + 1e-3)

    @cached_property
    def foreign(self):
        """Body and contact of another model."""
        _, item, _, contact = self.model()
        return Pair(item, contact)

    @cached_property
    def map(self):
        """Map of restitution of the upper block on a floor."""
        return ep.restitution_map((self.body, ep.RigidPlane()), speed=1.0, duration=1e-4)

    def map_file(self):
        """File of the map."""
        self.map.save(self.folder / "map.npz")
        return self.folder / "map.npz"

    def study_file(self):
        """File of a study."""
        ep.study(lambda x: x, [{"x": 1.0}], file=self.folder / "study.jsonl")
        return self.folder / "study.jsonl"

    @cached_property
    def sticking(self):
        """Contact of the upper block with a floor, with friction, and the result of its run."""
        part = ep.Partition.ball(self.fem, (0, 0, 0), 4e-3, axes="xyz")
        return self._on_a_floor(self.fem, part, [0.1, 0, -1], friction=0.3)

    @cached_property
    def yielding(self):
        """Contact of the upper block, which may yield, with a floor, and the result of its run."""
        material = replace(self.fem.material, yield_stress=1e-3 * self.fem.material.E, hardening=0.0)
        fem = replace(self.fem, material=material)
        return self._on_a_floor(fem, ep.Partition.ball(fem, (0, 0, 0), 4e-3), [0, 0, -1])

    def _on_a_floor(self, fem, part, velocity, **options):
        mbs = self.empty()
        item = ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=60e3), initialVelocity=velocity)
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), **options)
        mbs.Assemble()
        return Run(contact, ep.solve_dynamic(mbs, end_time=20 * STEP, step=STEP))

    @property
    def plastic_state(self):
        """What the upper block, which may yield, keeps of its run."""
        return self.yielding.of.plastic.states(self.yielding.result)["slave"]

    def falling(self):
        """Model of the upper block under gravity."""
        mbs = self.empty()
        ep.CreatePartitionBody(mbs, self.body, gravity=[0, 0, -9.81])
        return mbs

    def resting(self):
        """A model that is ready to settle: the upper block above a plane."""
        mbs = self.empty()
        item = ep.CreatePartitionBody(mbs, self.body, gravity=[0, 0, -9.81])
        lowest = float(self.body.points[:, 2].min())
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, lowest - 1e-6)))
        mbs.Assemble()
        return mbs

    @cached_property
    def working(self):
        """Sensor of the work of gravity, and the result of its run."""
        mbs = self.falling()
        sensor = ep.CreateWorkSensor(mbs)
        mbs.Assemble()
        return Run(sensor, ep.solve_dynamic(mbs, end_time=4 * STEP, step=STEP))

    def apart(self, **striker):
        """Model of both bodies without a contact; `striker` and `struck` are those of the last one."""
        mbs = self.empty()
        options = {"name": "upper", "initialVelocity": [0, 0, -1], **striker}
        self.striker = ep.CreatePartitionBody(mbs, self.body, **options)
        self.struck = ep.CreatePartitionBody(mbs, self.other_body, name="lower")
        return mbs

    def model(self, contact=None, **striker):
        """Model, striker, target and contact, not assembled, with options of the contact and the striker."""
        mbs = self.apart(**striker)
        options = {"name": "contact", **(contact or {})}
        contact = ep.CreatePartitionContact(mbs, self.striker, self.struck, **options)
        return mbs, self.striker, self.struck, contact

    def again(self):
        """The model that was run, made anew: other calls have since added markers and sensors to the first one."""
        mbs, _, _, contact = self.model()
        contact.AddMomentSensor(mbs)
        mbs.Assemble()
        return mbs

    def assembled(self):
        """A model that is ready to run."""
        mbs = self.model()[0]
        mbs.Assemble()
        return mbs

    def another_result(self):
        """Result of a run of another model."""
        with contextlib.redirect_stdout(io.StringIO()):
            return ep.solve_dynamic(self.assembled(), end_time=2 * STEP, step=STEP)

    def empty(self):
        """A model without anything."""
        return exu.SystemContainer().AddSystem()

    @cached_property
    def feminterface(self):
        """Exudyn's import of a block with linear elements."""
        mesh = ep.generate_mesh(occ.Box((0, 0, 0), (0.01, 0.01, 0.01)), maxh=0.01)
        fem = FEMinterface()
        fem.ImportMeshFromNGsolve(mesh, ep.STEEL.rho, ep.STEEL.E, ep.STEEL.nu, meshOrder=1, boundaryNamesList=[])
        return fem

    def matrix_files(self):
        """Matrices of the upper block as CalculiX writes them, and the deck that they were made of."""
        path = self.folder / "matrices.sti"
        if path.exists():
            return path
        for suffix, matrix in ((".sti", self.fem.stiffness), (".mas", self.fem.mass)):
            rows, columns, values = sp.find(sp.triu(matrix))
            np.savetxt(path.with_suffix(suffix), np.column_stack([rows + 1, columns + 1, values]), "%d %d %.13e")
        nodes = np.arange(self.fem.n_nodes) + 1
        path.with_suffix(".dof").write_text("\n".join(f"{node}.{way}" for node in nodes for way in (1, 2, 3)))
        with path.with_suffix(".inp").open("w") as deck:
            deck.write("*NODE\n")
            np.savetxt(deck, np.column_stack([nodes, self.fem.points]), "%d, %.17g, %.17g, %.17g")
            deck.write("*ELEMENT, TYPE=C3D10\n")
            np.savetxt(deck, np.column_stack([np.arange(len(self.fem.cells)) + 1, self.fem.cells + 1]), "%d", ", ")
        return path

    def plastic_file(self):
        """File of what the upper block, which may yield, keeps."""
        self.plastic_state.save(self.folder / "plastic.npz")
        return self.folder / "plastic.npz"

    def pipe(self):
        """A pipe that nobody writes into."""
        path = self.folder / "pipe"
        with contextlib.suppress(FileExistsError):
            os.mkfifo(path)
        return path
