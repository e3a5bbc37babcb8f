"""Check of an installation: its packages, and a small impact."""

from __future__ import annotations

import argparse
import importlib
import math
import sys
import time
from importlib import metadata

import numpy as np

from .._version import __version__
from ..fe.material import STEEL
from ..fe.partition import Partition
from ..meshing.mesh_size import Refine
from ..meshing.ngsolve_fem import fe_model
from ..prediction.hertz import impact
from ..reduction.reduction import reduce
from ..support.compiled import compiles
from ..support.optional import require

_PACKAGES = ("exudyn", "ngsolve", "numpy", "scipy", "meshio", "matplotlib", "rich", "platformdirs", "threadpoolctl")


def doctor(options: argparse.Namespace) -> tuple[int, dict[str, object]]:
    """Versions of the packages, or what is missing, and a test impact; the exit code stands first."""
    wanted = {}
    for line in _requirements():
        name = line.split(">")[0].strip()
        wanted[name] = line
    versions, missing = {"python": sys.version.split()[0], "exudyn-partition": __version__}, {}
    for package in _PACKAGES:
        try:
            importlib.import_module(package)
            versions[package] = metadata.version(package)
        except ImportError as error:  # also PackageNotFoundError
            missing[wanted.get(package, package)] = str(error)  # it may be there, but miss a library that it needs
    answer: dict[str, object] = {"versions": versions, "contact_loops": contact_loops()}
    if missing:
        line = "pip install --upgrade " + " ".join(f'"{name}"' for name in missing)
        return 1, answer | {"missing": missing, "install": line}
    answer["self_test"] = test = _self_test()
    return int(not test["passed"]), answer


def contact_loops() -> str:
    """What evaluates contact."""
    if compiles():
        return f"compiled by numba {metadata.version('numba')}"
    return 'NumPy; pip install "exudyn-partition[fast]" compiles them'


def _requirements() -> list[str]:
    try:
        return [line for line in metadata.requires("exudyn-partition") or [] if "extra" not in line]
    except metadata.PackageNotFoundError:
        return []


def _self_test() -> dict[str, object]:
    """Impact of a small steel ball on a rigid plane, compared with Hertz; balances of momentum and energy."""
    from ..contact.rigid import RigidPlane
    from ..exudyn_bodies.create_body import CreatePartitionBody
    from ..exudyn_contacts.create_contact import CreatePartitionContact
    from ..simulation.solve import solve_dynamic

    begin, R, speed, pole = time.perf_counter(), 0.010, 0.5, np.zeros(3)
    occ = require("netgen.occ")
    ball = occ.Sphere(occ.Pnt(0, 0, R), R)
    fem = fe_model(ball, STEEL, maxh=4e-3, refine=[Refine(pole, 0.5e-3, 0.15e-3)], grading=0.7)
    body = reduce(fem, Partition.ball(fem, pole, 0.6e-3), f_cut=150e3)
    mbs = require("exudyn").SystemContainer().AddSystem()
    item = CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -speed])
    contact = CreatePartitionContact(mbs, item, RigidPlane(pole, np.array([0.0, 0.0, 1.0])))
    mbs.Assemble()
    result = solve_dynamic(mbs, end_time=100e-6, progress=lambda share: None)
    hertz = impact(body.total_mass, speed, R, math.inf, STEEL)
    energy = item.energy(result) + contact.energy(result)
    momentum, impulse = item.momentum(result)[:, 2], result.history(contact).impulse
    errors = {
        "peak_force_to_hertz": float(contact.force(result).max() / hertz.peak_force - 1),
        "momentum": float((momentum[-1] - momentum[0]) / impulse - 1),
        "energy": float(abs(energy / energy[0] - 1).max()),
    }
    limits = {"peak_force_to_hertz": 0.1, "momentum": 1e-6, "energy": 1e-2}
    return {
        "passed": all(abs(errors[key]) < limit for key, limit in limits.items()),
        "errors": errors,
        "limits": limits,
        "time_s": time.perf_counter() - begin,
    }
