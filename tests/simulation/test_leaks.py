"""Memory that is given back: the same work over and over needs no more of it."""

import gc
import os
import weakref
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.algebra.sparse.solver import solved_by
from exudyn_partition.exudyn_contacts.model_run import runs_of

BASES = "contact-adapted", "residual", "craig-bampton", "free"
LEAKS = 2.0  # MB a reduction: a third of the factors of the block


def resident():
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.fixture
def no_collector():
    """Without the collector of garbage; objects that hold each other stay until it runs, after a few reductions."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize("how", [*({"basis": basis, "f_cut": 150e3} for basis in BASES), {"tolerance": 0.3}], ids=str)
def test_factors_go_with_the_reduction_that_made_them(coarse_ball, how, no_collector):
    """Nothing holds them in a circle, however rarely garbage is collected in a process with many objects."""
    factors = []

    def recorded(matrix):
        factors.append(Factorisation(matrix))
        return factors[-1]

    def kept():
        """Factors that are left of a reduction."""
        factors.clear()
        with solved_by(recorded):
            body = ep.reduce(*coarse_ball, **how)
        left = [weakref.ref(one) for one in factors]
        factors.clear()
        assert body.n_dofs > 0
        assert len(left) > 0
        return [one() for one in left if one() is not None]

    # If numba compiles a loop in the first one, it holds what has called the loop until garbage is collected.
    assert not kept() or not kept()


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="there is no such file on this system")
def test_reductions_give_their_memory_back(block, top):
    """Factors of 6 MB a reduction, made in one thread and dropped in another: a leak of a third shows in both halves.

    The memory of a process that ran other tests may jump once.
    """
    sizes, half = [], 5
    for cycle in range(2 + 2 * half):
        ep.reduce(block, top, f_cut=80e3)
        if cycle in (1, 1 + half, 1 + 2 * half):
            sizes.append(resident())
    assert np.diff(sizes).min() < LEAKS * half


def model(body, kind):
    """A ball above a plane; returns the model and what it holds."""
    mbs = exu.SystemContainer().AddSystem()
    frame = "floating" if kind == "floating" else "inertial"
    ball = ep.CreatePartitionBody(
        mbs, body, frame=frame, referencePosition=[0, 0, 1e-6], superElement=kind == "markers"
    )
    carrier = None
    if kind == "carried":
        node = mbs.AddNode(items.NodeRigidBodyRotVecLG(referenceCoordinates=[0.0] * 6))
        carrier = mbs.AddObject(items.ObjectRigidBody(nodeNumber=node, mass=1.0, inertia=[1, 1, 1, 0, 0, 0]))
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), masterBody=carrier)
    if kind == "view":
        ep.CreatePartitionView(mbs)
    mbs.Assemble()
    return mbs, ball, contact


@pytest.mark.parametrize("kind", ["floating", "markers", "carried", "view"])
def test_models_that_are_dropped_are_gone(bodies, kind):
    """A model holds its user functions; one that held the model would keep it, 1 to 2 MB each."""
    mbs, ball, contact = model(bodies[0], kind)
    ep.solve_dynamic(mbs, end_time=1e-6, step=0.25e-6)
    kept = weakref.ref(mbs), weakref.ref(ball), weakref.ref(contact)
    del mbs, ball, contact
    gc.collect()
    assert [reference() for reference in kept] == [None] * 3


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="there is no such file on this system")
def test_many_models_need_no_more_memory_than_few(bodies):
    """What leaks grows in both halves; the memory of a process that ran other tests may jump once."""
    sizes = []
    for cycle in range(36):
        for kind in ("floating", "markers", "carried", "view"):
            model(bodies[0], kind)
        if cycle in (5, 20, 35):
            gc.collect()
            sizes.append(resident())
    assert np.diff(sizes).min() < 60 * 0.1


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_runs_that_go_on_leave_nothing_of_those_before(yielding, no_collector, method):
    """A contact and its plastic zones held each other: 1.7 MB a run stayed until garbage was collected, if ever."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, yielding, referencePosition=[0, 0, 1e-6], initialVelocity=[0.1, 0, -1.0])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=0.3)
    mbs.Assemble()
    parts = []
    for i in range(6):
        result = ep.solve_dynamic(mbs, end_time=(12 + i) * 1e-6, step=0.25e-6, method=method, go_on=i > 0)
        model_run = runs_of(mbs).now(mbs)
        run = model_run.contact_run(contact)
        kept = run, model_run.group_run(contact), run.mechanics, run.mechanics.zones, run.mechanics.zones.zones[0][1]
        parts.append([weakref.ref(part) for part in kept])
        del run, model_run, kept
    assert contact.plastic.work(result)[-1] > 0
    assert [[part() is None for part in of] for of in parts[:-2]] == [[True] * 5] * 4
