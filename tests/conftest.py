"""Small bodies that several tests share; meshes and reductions are made once a session."""

import functools
import gc
import os
import re
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from browser import browser, opened  # noqa: F401  # fixtures
from oracles import MARBLE_RADIUS, SPHERE_MATERIAL, SPHERE_RADIUS, TOP, box, end, hexahedra, without_numba, write

import exudyn_partition as ep
from exudyn_partition.support.compiled import compiles

TESTS = Path(__file__).parent
# Files begin in this order, by turns for two workers. The first one has most of the loops compiled, which takes minutes
# after an installation. What runs no contact comes next, so that the other worker does not compile the same meanwhile,
# but reads it from disk later. Long files come before short ones: the last file of a run keeps one worker busy while
# the other one has nothing to do.
FIRST = "examples/test_examples.py", "house/test_site.py"
LAST = "house/test_types.py"  # when the mypy of .ci/run has ended, whose cache makes it four times as quick
RUNS = re.compile(r"Contact\(|solve_(?:dynamic|static)|reduce_pair|design_impact|^from validation|runpy", re.M)
LONG = "examples", "meshing", "validation"
NODAL = "free", "craig-bampton"  # bases that keep the motion of the patch's nodes
# Two workers fill two cores. Threads of NGSolve and BLAS wait by spinning, and would take the other worker's time.
ONE_THREAD = ("NGS_NUM_THREADS", "OMP_NUM_THREADS")


def pytest_configure(config):
    """Before workers start, which inherit the environment."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each child would translate all modules of the library again
    gc.set_threshold(20_000, 20, 20)  # by default 700, 10, 10, so that small tests wait for it often
    if getattr(config.option, "numprocesses", None):
        for name in ONE_THREAD:
            os.environ.setdefault(name, "1")


def pytest_collection_modifyitems(items):
    """Put files in their order, see `FIRST` and `LAST`."""

    @functools.cache
    def place(path):
        name = path.relative_to(TESTS).as_posix()
        if name in FIRST:
            return FIRST.index(name)
        if name == LAST:
            return 2 + len(FIRST) + len(LONG)
        folder, _, _ = name.partition("/")
        if folder != "examples" and not RUNS.search(path.read_text()):
            return len(FIRST)
        return 1 + len(FIRST) + (LONG.index(folder) if folder in LONG else len(LONG))

    items.sort(key=lambda item: place(item.path))


@pytest.fixture(scope="module", autouse=True)
def forget_what_is_old():
    """Collect what a file leaves, once, and let later collections pass over what lives on.

    Each would go through all that earlier files made: trees of sources, notebooks, compiled loops. That takes seconds.
    """
    yield
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def block():
    """A steel block, 10 x 20 x 30 mm, all frequencies simple."""
    return ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=5e-3)


@pytest.fixture(scope="session")
def top(block):
    """Impact region at the block's upper face."""
    return ep.Partition.ball(block, (0, 0, 0.03), 6e-3)


@pytest.fixture(scope="session")
def sphere():
    """A steel sphere of radius 10 mm, fine at its south pole, which is the origin."""
    shape = occ.Sphere(occ.Pnt(0, 0, SPHERE_RADIUS), SPHERE_RADIUS)
    fine = ep.Refine((0, 0, 0), 0.3e-3, 0.08e-3)
    fem = ep.fe_model(shape, SPHERE_MATERIAL, maxh=3e-3, refine=[fine], grading=0.5)
    return fem, ep.Partition.ball(fem, (0, 0, 0), 0.5e-3)


@pytest.fixture(scope="session")
def other_sphere():
    """The same with its north pole at the origin, meshed on its own so that the two meshes do not match."""
    shape = occ.Sphere(occ.Pnt(0, 0, -SPHERE_RADIUS), SPHERE_RADIUS)
    fine = ep.Refine((0, 0, 0), 0.35e-3, 0.09e-3)
    fem = ep.fe_model(shape, SPHERE_MATERIAL, maxh=3e-3, refine=[fine], grading=0.5)
    return fem, ep.Partition.ball(fem, (0, 0, 0), 0.6e-3)


@pytest.fixture
def mbs():
    """An empty Exudyn model."""
    return exu.SystemContainer().AddSystem()


@pytest.fixture(scope="session")
def ball():
    """A steel ball of radius 10 mm, for impacts on the block: south pole at the origin, coarser than `sphere`."""
    return steel_ball(3.5e-3, ep.Refine((0, 0, 0), 0.6e-3, 0.25e-3))


@pytest.fixture(scope="session")
def coarse_ball():
    """The same for bases that keep the patch's nodes: fewer of these, and explicit steps that are twice as long."""
    return steel_ball(5e-3, ep.Refine((0, 0, 0), 1e-3, 0.5e-3))


def steel_ball(maxh, fine):
    shape = occ.Sphere(occ.Pnt(0, 0, SPHERE_RADIUS), SPHERE_RADIUS)
    fem = ep.fe_model(shape, ep.STEEL, maxh=maxh, refine=[fine], grading=0.5)
    return fem, ep.Partition.ball(fem, (0, 0, 0), 1.2e-3)


@pytest.fixture(scope="session")
def marble_parts():
    """A small steel ball about the origin with a patch at either pole."""
    poles = [(0, 0, -MARBLE_RADIUS), (0, 0, MARBLE_RADIUS)]
    refine = [ep.Refine(pole, 0.5e-3, 0.15e-3) for pole in poles]
    shape = occ.Sphere(occ.Pnt(0, 0, 0), MARBLE_RADIUS)
    fem = ep.fe_model(shape, ep.STEEL, maxh=2.5e-3, refine=refine, grading=0.5)
    south, north = (ep.Partition.ball(fem, p, 0.5e-3, name=n) for p, n in zip(poles, ("south", "north"), strict=True))
    return fem, south | north


@pytest.fixture(scope="session")
def marble(marble_parts, kept):
    """The same, reduced."""
    return ep.reduce(*marble_parts, f_cut=300e3, cache=kept)


@pytest.fixture(scope="session")
def kept(tmp_path_factory, worker_id):
    """Folder of reduced bodies that all workers share: what one has reduced, the others read."""
    folder = tmp_path_factory.getbasetemp()
    return (folder if worker_id == "master" else folder.parent) / "reduced"


@pytest.fixture(scope="session")
def pair_of(ball, coarse_ball, block, top, kept):
    """Ball and block, reduced, by the name of a basis, and whether the ball is fine where a coarser one would do."""

    def pair(basis, fine=False):
        models = coarse_ball if basis in NODAL and not fine else ball, (block, top)
        return tuple(ep.reduce(*model, basis=basis, f_cut=150e3, cache=kept) for model in models)

    return pair


@pytest.fixture(scope="session")
def bodies(pair_of):
    """Ball and block, reduced."""
    return pair_of("residual")


@pytest.fixture(scope="session")
def reduced_sphere(sphere, kept):
    """The fine sphere with its modes below 200 kHz."""
    return ep.reduce(*sphere, f_cut=200e3, cache=kept)


@pytest.fixture(scope="session")
def round_body(ball, kept):
    """The ball with all three directions."""
    return ep.reduce(ball[0], ep.Partition.ball(ball[0], (0, 0, 0), 1.0e-3, axes="xyz"), f_cut=150e3, cache=kept)


@pytest.fixture(scope="session")
def yielding(kept):
    """A coarse ball of a soft metal, with all three directions."""
    shape = occ.Sphere(occ.Pnt(0, 0, SPHERE_RADIUS), SPHERE_RADIUS)
    soft = ep.Material(E=210e9, nu=0.3, rho=7800.0, yield_stress=300e6, hardening=1e9)
    fem = ep.fe_model(shape, soft, maxh=5e-3, refine=[ep.Refine((0, 0, 0), 1e-3, 0.5e-3)])
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1e-3, axes="xyz"), f_cut=60e3, cache=kept)


@pytest.fixture(scope="session")
def flat_body(kept):
    """A steel plate, 16 x 16 x 5 mm, its upper face at z = 0, fine in the middle, with all three directions."""
    shape = box(0.016, 0.016, 0.005).Move((0, 0, -0.005))
    fem = ep.fe_model(shape, ep.STEEL, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 1.2e-3, 0.35e-3)], grading=0.5)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.6e-3, axes="xyz"), f_cut=120e3, cache=kept)


@pytest.fixture(scope="session")
def thin_plate(kept):
    """A steel plate, 30 x 20 x 1 mm, its lower face at z = 0, with all of both faces as patches "low" and "high"."""
    fem = ep.fe_model(box(0.03, 0.02, 1e-3), ep.STEEL, maxh=6e-3)
    z = fem.points[fem.facets[:, :3]].mean(axis=1)[:, 2]
    low, high = (
        ep.Partition.surface(fem, np.flatnonzero(abs(z - at) < 1e-9), name=name, axes="xyz")
        for name, at in (("low", 0.0), ("high", 1e-3))
    )
    return ep.reduce(fem, low | high, f_cut=8e3, cache=kept)


@pytest.fixture(scope="session")
def bricks(tmp_path_factory):
    """The block as linear hexahedra."""
    return ep.fe_model(write(tmp_path_factory.mktemp("mesh") / "block.vtu", *hexahedra(4, 8, 12)), ep.STEEL)


@pytest.fixture(scope="session")
def link():
    """A bar along z, 10 x 8 x 60 mm."""
    return ep.fe_model(box(0.010, 0.008, 0.060), ep.STEEL, maxh=6e-3)


@pytest.fixture(scope="session")
def arm(link):
    """The bar with an interface at each end, of which one is rigid."""
    foot, head = end(link, 0.0), end(link, 0.06)
    return link, ep.Partition.interface(link, "foot", foot) | ep.Partition.interface(
        link, "head", head, kind="averaged"
    )


@pytest.fixture(scope="session")
def arm_body(arm):
    """The same, reduced."""
    return ep.reduce(*arm, f_cut=60e3)


@pytest.fixture(params=["inertial", "floating"])
def frame(request):
    """Each frame by its name."""
    return request.param


@pytest.fixture
def impact(mbs, bodies):
    """The ball about to hit the block at 1 m/s, assembled: model, striker, target, contact."""
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, name="tip", rows="node-to-segment")
    mbs.Assemble()
    return mbs, striker, target, contact


@pytest.fixture(params=["compiled", "numpy"])
def each_path(request):
    """Run a test twice: with compiled inner loops, and without numba."""
    if request.param == "compiled":
        if not compiles():
            pytest.skip("numba does not load here")
        yield
    else:
        with without_numba():
            yield
