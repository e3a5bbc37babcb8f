"""Small bodies that several tests share; meshes and reductions are made once a session."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep

SPHERE_RADIUS = 0.010
TOP = (0.0, 0.0, 0.03)  # centre of the block's upper face
MARBLE_RADIUS = 5e-3
SPHERE_MATERIAL = ep.Material(E=210e9, nu=0.3, rho=7850.0)  # cases.md


def box(lx, ly, lz):
    """A box from the origin upwards, centred in x and y."""
    return occ.Box(occ.Pnt(-lx / 2, -ly / 2, 0), occ.Pnt(lx / 2, ly / 2, lz))


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
    fem = ep.fe_model(shape, SPHERE_MATERIAL, maxh=3e-3, refine=[fine], grading=0.4)
    return fem, ep.Partition.ball(fem, (0, 0, 0), 0.45e-3)


@pytest.fixture(scope="session")
def other_sphere():
    """The same with its north pole at the origin, meshed on its own so that the two meshes do not match."""
    shape = occ.Sphere(occ.Pnt(0, 0, -SPHERE_RADIUS), SPHERE_RADIUS)
    fine = ep.Refine((0, 0, 0), 0.35e-3, 0.09e-3)
    fem = ep.fe_model(shape, SPHERE_MATERIAL, maxh=3e-3, refine=[fine], grading=0.4)
    return fem, ep.Partition.ball(fem, (0, 0, 0), 0.6e-3)


@pytest.fixture
def mbs():
    """An empty Exudyn model."""
    return exu.SystemContainer().AddSystem()


@pytest.fixture(scope="session")
def ball():
    """A steel ball of radius 10 mm, for impacts on the block: south pole at the origin, coarser than `sphere`."""
    shape = occ.Sphere(occ.Pnt(0, 0, SPHERE_RADIUS), SPHERE_RADIUS)
    fine = ep.Refine((0, 0, 0), 0.6e-3, 0.25e-3)
    fem = ep.fe_model(shape, ep.STEEL, maxh=3.5e-3, refine=[fine], grading=0.5)
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
def marble(marble_parts):
    """The same, reduced."""
    return ep.reduce(*marble_parts, f_cut=300e3)


@pytest.fixture(scope="session")
def kept(tmp_path_factory, worker_id):
    """Folder of reduced bodies that all workers share: what one has reduced, the others read."""
    folder = tmp_path_factory.getbasetemp()
    return (folder if worker_id == "master" else folder.parent) / "reduced"


@pytest.fixture(scope="session")
def pair_of(ball, block, top, kept):
    """Ball and block, reduced, by the name of a basis."""
    return lambda basis: tuple(ep.reduce(*pair, basis=basis, f_cut=150e3, cache=kept) for pair in (ball, (block, top)))


@pytest.fixture(scope="session")
def bodies(pair_of):
    """Ball and block, reduced."""
    return pair_of("residual")


@pytest.fixture(scope="session")
def reduced_sphere(sphere, kept):
    """The fine sphere with its modes below 200 kHz."""
    return ep.reduce(*sphere, f_cut=200e3, cache=kept)


@pytest.fixture
def impact(mbs, bodies):
    """The ball about to hit the block at 1 m/s, assembled: model, striker, target, contact."""
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, name="tip", rows="node-to-segment")
    mbs.Assemble()
    return mbs, striker, target, contact


def relative(x, y):
    """||x - y|| / ||y||."""
    return np.linalg.norm(x - y) / np.linalg.norm(y)
