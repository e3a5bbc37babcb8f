"""Contact of skins whose flexibility is found on demand: the forces are those of the same body with an array."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.algebra.sparse.skin_flexibility import SkinFlexibility
from exudyn_partition.errors import InputError
from exudyn_partition.reduction import free_body

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")  # of coarse meshes

SIZE, MU, F_CUT = (12e-3, 10e-3, 8e-3), 0.3, 60e3
ON_TOP = (6e-3, 5e-3, 8e-3)
SAME = 1e-11  # of the largest force


def both(fem, partition):
    """The body with a flexibility that is found on demand, as if it were large, and with an array."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(free_body, "SMALL", 100)
        body = ep.reduce(fem, partition, f_cut=F_CUT)
    dense = ep.reduce(fem, partition, f_cut=F_CUT)
    assert isinstance(body.basis.flexibility, SkinFlexibility)
    assert isinstance(dense.basis.flexibility, np.ndarray)
    return body, dense


@pytest.fixture(scope="module")
def box():
    """A box with a bore, both ways."""
    shape = occ.Box((0, 0, 0), SIZE) - occ.Cylinder(occ.Pnt(6e-3, 5e-3, 0), occ.Z, r=2.5e-3, h=SIZE[2])
    fem = ep.fe_model(shape, ep.STEEL, maxh=4e-3)
    return both(fem, ep.Partition.surface(fem, range(len(fem.facets)), axes="xyz"))


@pytest.fixture(scope="module")
def smooth():
    """The same with the flexibility along normals alone."""
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 5e-3), 5e-3), ep.STEEL, maxh=1.5e-3)
    return both(fem, ep.Partition.surface(fem, range(len(fem.facets)), axes="normal"))


def low(body, turn):
    return (body.points @ turn.T)[:, 2].min()


def drop(mbs, body, *, tilt=(12.0, 8.0, 0.0), speed=1.0, along=0.3, **options):
    """A body that falls on a plane; the body and its contact."""
    turn = Rotation.from_euler("xyz", tilt, degrees=True).as_matrix()
    position = [0.0, 0.0, 1e-6 - low(body, turn)]
    item = ep.CreatePartitionBody(
        mbs, body, referencePosition=position, referenceRotationMatrix=turn, frame="floating",
        initialVelocity=[along, 0.0, -speed], damping=options.pop("damping", None),
    )  # fmt: skip
    return item, ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), **options)


def each(bodies, make, **run):
    """Forces of the contacts that `make` returns, with its items, the result and the contacts, for each body."""
    found = []
    for body in bodies:
        mbs = exu.SystemContainer().AddSystem()
        items, contacts, *started = make(mbs, body)
        mbs.Assemble()
        for item, speed in started:
            q_t = item.kinematics.from_basis @ speed
            mbs.systemData.SetODE2Coordinates_t(q_t, exu.ConfigurationType.Initial)
        result = ep.solve_dynamic(mbs, **run)
        found.append((np.array([contact.force(result) for contact in contacts]), items, result, contacts))
    return found


def assert_alike(found, same=SAME):
    (force, *_), (dense, *_) = found
    assert force.max() > 1.0
    np.testing.assert_allclose(force, dense, rtol=0, atol=same * dense.max())


def one(mbs, body, **options):
    item, contact = drop(mbs, body, **options)
    return [item], [contact]


@pytest.mark.parametrize("friction", [None, MU])
def test_a_tilted_drop(box, friction):
    """The forces are those by an array; momentum and energy are kept."""
    found = each(box, lambda mbs, body: one(mbs, body, friction=friction), end_time=60e-6, step=0.2e-6)
    assert_alike(found)
    force, (item,), result, (contact,) = found[0]
    if friction is None:
        impulse = np.sum((force[0, 1:] + force[0, :-1]) / 2 * np.diff(result.t))
        gained = item.momentum(result)[-1] - item.momentum(result)[0]
        np.testing.assert_allclose(gained, [0, 0, impulse], rtol=0, atol=1e-6 * impulse)
        energy = item.energy(result) + contact.energy(result)
        np.testing.assert_allclose(energy, energy[0], rtol=1e-3)


def test_normals_alone(smooth):
    assert_alike(each(smooth, lambda mbs, body: one(mbs, body, along=0.0), end_time=30e-6, step=0.2e-6))


def test_damping_delays_the_flexibility(box):
    make = lambda mbs, body: one(mbs, body, friction=MU, damping=ep.Rayleigh(0.0, 2e-6))  # noqa: E731
    assert_alike(each(box, make, end_time=40e-6, step=0.1e-6))


@pytest.mark.parametrize("friction", [None, MU])
def test_implicit_steps(box, friction):
    make = lambda mbs, body: one(mbs, body, friction=friction)  # noqa: E731
    assert_alike(each(box, make, end_time=40e-6, step=1e-6, method="implicit"))


def test_penalty(smooth):
    """The usual layer is as soft as the flexibility of the rows at the start."""
    make = lambda mbs, body: one(mbs, body, formulation="penalty")  # noqa: E731
    assert_alike(each(smooth, make, end_time=40e-6, step=0.1e-6))


@pytest.mark.parametrize("friction", [None, MU])
def test_two_skins(box, friction):
    """One falls on another."""

    def make(mbs, body):
        under = ep.CreatePartitionBody(mbs, body, frame="floating")
        turn = Rotation.from_euler("xyz", (15.0, 10.0, 5.0), degrees=True).as_matrix()
        placed = body.points @ turn.T
        at = np.array([2e-3, 2e-3, SIZE[2] + 1e-6]) - placed[placed[:, 2].argmin()]
        over = ep.CreatePartitionBody(
            mbs,
            body,
            referencePosition=[*at],
            referenceRotationMatrix=turn,
            frame="floating",
            initialVelocity=[0, 0, -1],
        )
        return [over, under], [ep.CreatePartitionContact(mbs, over, under, friction=friction)]

    assert_alike(each(box, make, end_time=40e-6, step=0.2e-6))


@pytest.mark.parametrize("friction", [None, MU])
def test_two_contacts_on_a_skin(box, friction):
    """A floor and a wall push on the same patch."""

    def make(mbs, body):
        item, floor = drop(mbs, body, tilt=(12.0, 0.0, 8.0), speed=1.0, along=-1.0, friction=friction)
        turn = Rotation.from_euler("xyz", (12.0, 0.0, 8.0), degrees=True).as_matrix()
        left = (body.points @ turn.T)[:, 0].min() - 1e-6
        wall = ep.CreatePartitionContact(mbs, item, ep.RigidPlane((left, 0, 0), (1, 0, 0)), friction=friction)
        return [item], [floor, wall]

    found = each(box, make, end_time=40e-6, step=0.2e-6)
    assert found[0][0].max(axis=1).min() > 1.0
    assert_alike(found)


def test_equilibrium(box):
    """On a plane, under its weight and friction; forces are the weight."""
    for body in box:
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, frame="floating", gravity=[2.0, 0.0, -1000.0])
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=MU)
        mbs.Assemble()
        force = contact.force(ep.solve_static(mbs, load_steps=2))[-1]
        assert force == pytest.approx(1000.0 * body.total_mass, rel=1e-6)


def test_a_body_that_touches_itself():
    """The tip of a clip on its other arm; both are on one skin."""
    arm, thick, mouth, gap = 20e-3, 4e-3, 3e-3, 5e-6
    outside = occ.Box(occ.Pnt(-thick, -thick / 2, -mouth - thick), occ.Pnt(arm, thick / 2, thick))
    ball = occ.Sphere(occ.Pnt(17e-3, 0, -gap - 20e-3), 20e-3)
    lower = occ.Box(occ.Pnt(0, -thick / 2, -mouth - thick), occ.Pnt(arm, thick / 2, 0))
    shape = (outside - occ.Box(occ.Pnt(0, -thick, -mouth), occ.Pnt(2 * arm, thick, 0))) + ball * lower
    refine = [ep.Refine((17e-3, 0, z), 1e-3, 0.5e-3) for z in (-gap, 0.0)]
    fem = ep.fe_model(shape, ep.STEEL, maxh=3e-3, refine=refine)
    inside = [(13e-3, -1.6e-3, -mouth + 0.1e-3), (19.5e-3, 1.6e-3, 0.1e-3)]
    bodies = both(fem, ep.Partition.surface(fem, inside, axes="xyz"))

    def make(mbs, body):
        nodes = body.partition.patches[0].nodes
        upper = body.points[nodes, 2] > -gap / 2
        tip, face = (
            body.rows(some).reshape(-1, 3, body.n_dofs)[:, 2].mean(axis=0) for some in (nodes[~upper], nodes[upper])
        )
        first = np.flatnonzero(abs(tip - face) > 0.5 * abs(tip - face).max())[0]
        speed = np.eye(body.n_dofs)[first] / (tip - face)[first]
        item = ep.CreatePartitionBody(mbs, body)
        contact = ep.CreatePartitionContact(mbs, item, item, passes="given", friction=MU)
        return [item], [contact], (item, speed)

    assert_alike(each(bodies, make, end_time=60e-6, step=0.25e-6))


@pytest.fixture(scope="module")
def lid():
    """A box with a small patch on top and a skin around it, for some material: the material, both patches."""

    def make(material, plastic_radius=None):
        fem = ep.fe_model(occ.Box((0, 0, 0), SIZE), material, maxh=3e-3, refine=[ep.Refine(ON_TOP, 1.5e-3, 1e-3)])
        top = ep.Partition.ball(fem, ON_TOP, 1.5e-3, name="top", axes="xyz", plastic_radius=plastic_radius)
        above = fem.points[fem.facets, 2].min(axis=1) > SIZE[2] / 2
        rest = np.flatnonzero(above & ~np.isin(fem.facets, top.patch_nodes).any(axis=1))
        return both(fem, top | ep.Partition.surface(fem, rest, axes="xyz", name="rest"))

    return make


def two_balls(mbs, body):
    """A ball above the small patch, another just beside it; the box rises."""
    item = ep.CreatePartitionBody(mbs, body, frame="floating", initialVelocity=[0, 0, 1.0])
    on_top = body.points[body.partition.patches[1].nodes]
    on_top = on_top[on_top[:, 2] > SIZE[2] - 1e-6]
    beside = on_top[np.linalg.norm(on_top - ON_TOP, axis=1).argmin()]
    radius, places = 20e-3, {"top": ON_TOP, "rest": beside}
    above = {name: ep.RigidSphere([*at[:2], at[2] + radius + 1e-6], radius) for name, at in places.items()}
    return [item], [ep.CreatePartitionContact(mbs, item, ball, slavePatch=name) for name, ball in above.items()]


def test_a_small_patch_beside_a_large_skin(lid):
    """They push each other through the full flexibility between them."""
    found = each(lid(ep.STEEL), two_balls, end_time=30e-6, step=0.2e-6)
    assert found[0][0].max(axis=1).min() > 1.0
    assert_alike(found, same=1e-4)  # an array is replaced by few fields between patches, with an error of this size


def test_a_large_skin_beside_a_plastic_zone_is_refused(lid):
    """Both would be solved together by few fields of the body, and those of a skin are not known."""
    soft = ep.Material(E=2.1e11, nu=0.3, rho=7850, yield_stress=3e8, hardening=1e9)
    with pytest.raises(InputError, match="touch a large skin"):
        two_balls(exu.SystemContainer().AddSystem(), lid(soft)[0])
