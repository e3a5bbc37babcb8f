"""Objects whose attributes change in a run: those of the contributing page, and no others."""

import importlib
import inspect
import pkgutil
import re
import sys
from collections import defaultdict
from pathlib import Path
from typing import Protocol

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import SPHERE_RADIUS as R

import exudyn_partition as ep
from exudyn_partition.exudyn_contacts.model_run import ModelRun, Runs

pytestmark = pytest.mark.filterwarnings("ignore")
LAYERS = "contact", "exudyn_contacts", "simulation"
BUILDERS = {"__init__", "for_run", "fresh"}  # what they assign belongs to a new object
BY_NUMBA = {"_meminfo", "_type", "_code"}  # what numba assigns to a new object


def table():
    """Kinds of objects that change, and their classes, from the contributing page."""
    page = (Path(__file__).parents[2] / ".github" / "CONTRIBUTING.md").read_text()
    rows = re.findall(r"^\| \*\*(\w+)\*\* \|.*\| (.*) \|$", page, re.M)
    return {kind: set(re.findall(r"`(\w+)`", names)) for kind, names in rows}


def classes():
    """Classes of the layers of contacts and runs."""
    for layer in LAYERS:
        package = importlib.import_module(f"exudyn_partition.{layer}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    for name, module in [*sys.modules.items()]:
        if name.startswith("exudyn_partition."):
            for thing in vars(module).values():
                if inspect.isclass(thing) and thing.__module__ == name and name.split(".")[1] in LAYERS:
                    yield thing


@pytest.fixture
def changed(monkeypatch):
    """Attributes that are assigned while a run makes steps, by the classes of their objects."""
    found, depth = defaultdict(set), [0]

    def watched(of):
        def assign(thing, name, value):
            frame, built = inspect.currentframe().f_back, not depth[0]
            while frame and not built:
                code = frame.f_code.co_name
                builds = code in BUILDERS and (frame.f_locals.get("self"), frame.f_locals.get("result"))
                built = builds and any(thing is made for made in builds)
                frame = frame.f_back
            if not built and name not in BY_NUMBA:
                found[type(thing).__name__].add(name)
            original(thing, name, value)

        original = of.__setattr__
        monkeypatch.setattr(of, "__setattr__", assign)

    def stepping(of, name):
        method = getattr(of, name)

        def call(*arguments, **named):
            depth[0] += 1
            try:
                return method(*arguments, **named)
            finally:
                depth[0] -= 1

        monkeypatch.setattr(of, name, call)

    for of in {*classes()}:
        plain = not issubclass(of, BaseException) and Protocol not in of.__bases__
        if plain and "__setattr__" not in vars(of) and not issubclass(of, tuple):
            watched(of)
    for name in ("force", "before_step", "look_ahead", "after_step", "keep", "publish"):
        stepping(ModelRun, name)
    stepping(Runs, "sample")
    return found


@pytest.fixture(scope="module")
def bodies():
    """A ball that yields beneath its patch, a ball with every node of it, and a plate that moves along."""
    metal = ep.Material(E=210e9, nu=0.3, rho=7800.0, yield_stress=300e6, hardening=1e9)
    ball, plate = occ.Sphere(occ.Pnt(0, 0, R), R), occ.Box(occ.Pnt(-R, -R, -R), occ.Pnt(R, R, 0))
    made = []
    for shape, material, f_cut, basis in (
        (ball, metal, 60e3, "contact-adapted"),
        (ball, ep.STEEL, 180e3, "free"),
        (plate, ep.STEEL, 60e3, "contact-adapted"),
    ):
        fem = ep.fe_model(shape, material, maxh=R / 2.5, refine=[ep.Refine((0, 0, 0), R / 10, R / 15)])
        patch = ep.Partition.ball(fem, (0, 0, 0), R / 8, axes="xyz")
        made.append(ep.reduce(fem, patch, basis=basis, f_cut=f_cut))
    return made


@pytest.fixture(scope="module")
def coarse():
    """A ball with its whole skin as a patch."""
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), ep.STEEL, maxh=R / 2)
    return ep.reduce(fem, ep.Partition.surface(fem, near=(0, 0, 0), axes="xyz"), f_cut=60e3)


def steps(body, other, method, frame="inertial", **options):
    """A few steps of a ball that slides on a surface."""
    mbs = exu.SystemContainer().AddSystem()
    motion = {"initialVelocity": [3.0, 0, -1.0]}
    ball = ep.CreatePartitionBody(mbs, body, frame=frame, referencePosition=[0, 0, 1e-7], **motion)
    if not isinstance(other, ep.RigidPlane):
        other = ep.CreatePartitionBody(mbs, other, frame=frame)
    ep.CreatePartitionContact(mbs, ball, other, **options)
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=1.5e-6, step=0.03e-6, method=method)


def test_what_changes_in_a_run_is_what_the_page_says(bodies, coarse, changed):
    """At most four kinds of objects. What is no state and no record may be lost, as `test_state` holds."""
    soft, nodal, plate = bodies
    friction = {"friction": 0.3}
    for method in ("explicit", "implicit"):
        assert steps(soft, ep.RigidPlane(), method, **friction).steps
        assert steps(nodal, ep.RigidPlane(), method, formulation="lagrange", **friction).steps
        assert steps(soft, plate, method, "floating", **friction).steps
        for law in ({}, friction):
            assert steps(coarse, ep.RigidPlane(), method, "floating", formulation="hertz", **law).steps
    kinds = table()
    assert list(kinds) == ["State", "Records", "Places", "Guesses"]
    listed = set.union(*kinds.values())
    assert set(changed) <= listed, {name: changed[name] for name in set(changed) - listed}
    known = {of.__name__ for of in classes()}
    assert listed <= known
    assert len(set(changed) & kinds["State"]) >= 4


def test_a_hidden_change_would_be_seen(bodies, changed, monkeypatch):
    """A contact that wrote something down on the side."""
    from exudyn_partition.contact.law import Places

    publish = ModelRun.publish

    def scribbling(run, mbs, **options):
        note = Places(*np.zeros((4, 1)))
        note.seen = True
        publish(run, mbs, **options)

    monkeypatch.setattr(ModelRun, "publish", scribbling)
    steps(bodies[1], ep.RigidPlane(), "explicit", formulation="lagrange")
    assert "seen" in changed["Places"]
