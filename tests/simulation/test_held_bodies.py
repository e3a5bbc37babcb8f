"""Bodies in floating frames that joints hold: their statics and modes, with reactions that keep their directions."""

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning

LENGTH, WIDTH, HEIGHT = 0.3, 0.010, 0.006
EULER = np.pi**2 * ep.ALUMINIUM.E * WIDTH * HEIGHT**3 / 12 / LENGTH**2
G = 9.81


@pytest.fixture(scope="module")
def model():
    shape = box(WIDTH, HEIGHT, LENGTH)
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "foot", "head"
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=12e-3)
    return fem, ep.Partition.interface(fem, "foot", "foot") | ep.Partition.interface(fem, "head", "head")


@pytest.fixture(scope="module")
def link(model):
    return ep.reduce(*model, f_cut=5e3)


@pytest.fixture(scope="module")
def strut(model):
    return ep.reduce(*model, f_cut=5e3, geometric_stiffness=True)


def on_ground(mbs, *place):
    ground = mbs.AddObject(items.ObjectGround(referencePosition=list(place)))
    return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))


def hinge(mbs, *markers):
    mbs.AddObject(items.GenericJoint(markerNumbers=list(markers), constrainedAxes=[1, 1, 1, 0, 1, 1]))


def hanging(body, aside=0.0, load=0.0, links=1):
    """Links below each other with hinges about x, turned aside from the vertical, and a load down on the last [N]."""
    mbs = exu.SystemContainer().AddSystem()
    turn = Rotation.from_rotvec([np.pi - aside, 0, 0]).as_matrix()
    below = turn @ [0, 0, LENGTH]
    top, bodies = on_ground(mbs, 0, 0, 0), []
    for number in range(links):
        bodies.append(
            ep.CreatePartitionBody(
                mbs, body, frame="floating", gravity=[0, 0, -G], referencePosition=number * below,
                referenceRotationMatrix=turn,
            )
        )  # fmt: skip
        hinge(mbs, top, bodies[-1].CreateInterfaceMarker(mbs, "foot"))
        top = bodies[-1].CreateInterfaceMarker(mbs, "head")
    if load:
        mbs.AddLoad(items.LoadForceVector(markerNumber=top, loadVector=[0, 0, -load]))
    mbs.Assemble()
    return mbs, bodies, links * below


def lowest(mbs, n=1):
    return ep.natural_modes(mbs)[0][:n]


@pytest.mark.parametrize(("aside", "load"), [(0.05, 0.0), (0.5, 0.0), (1.0, 0.0), (0.5, 3.0)])
def test_a_hinged_link_comes_to_hang(link, aside, load):
    """Its only stiffness against turns is that of the hinge's reaction."""
    mbs, (item,), end = hanging(link, aside, load)
    result = ep.solve_static(mbs, load_steps=1)
    assert result.status == "finished"
    end = end + item.displacement(result, (0, 0, LENGTH))[-1]
    np.testing.assert_allclose(end, [0, 0, -LENGTH], atol=1e-4 * LENGTH)


def test_a_link_swings_about_its_hinge(link):
    mbs, (item,), _ = hanging(link, 0.2)
    ep.solve_static(mbs, load_steps=1, update_initial=True)
    mass = item.body.total_mass
    swing = np.sqrt(mass * G * LENGTH / 2 / (mass * LENGTH**2 / 3)) / (2 * np.pi)
    assert lowest(mbs)[0] == pytest.approx(swing, rel=2e-4)  # also without a run before, where it hangs already:
    assert lowest(hanging(link)[0])[0] == pytest.approx(swing, rel=2e-4)
    loaded = np.sqrt((mass * G * LENGTH / 2 + 3.0 * LENGTH) / (mass * LENGTH**2 / 3)) / (2 * np.pi)
    assert lowest(hanging(link, load=3.0)[0])[0] == pytest.approx(loaded, rel=5e-4)


def test_two_links_swing_on_each_other(link):
    mass = np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]])
    swing = np.sqrt(eigh(G / LENGTH * np.diag([3 / 2, 1 / 2]), mass, eigvals_only=True)) / (2 * np.pi)
    np.testing.assert_allclose(lowest(hanging(link, links=2)[0], 2), swing, rtol=5e-4)


def test_a_link_on_its_hinge_is_unstable(link):
    mbs, *_ = hanging(link, np.pi)
    with pytest.warns(ModelLimitWarning, match="This equilibrium is unstable, as that of a link that stands"):
        ep.solve_static(mbs, load_steps=1, update_initial=True)
    assert lowest(mbs)[0] < -1.0


def pressed(body, frame, share, clamped=False, aside=0.1):
    """A strut with a share of Euler's load on its head and a force across [N], with hinges or clamped at its foot."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, name="strut", frame=frame)
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    axes = [1, 1, 1, *(3 * [1] if clamped else [0, 0, 1])]
    mbs.AddObject(items.GenericJoint(markerNumbers=[on_ground(mbs, 0, 0, 0), foot], constrainedAxes=axes))
    if not clamped:
        top = on_ground(mbs, 0, 0, LENGTH)
        mbs.AddObject(items.GenericJoint(markerNumbers=[top, head], constrainedAxes=[1, 1, 0, 0, 0, 0]))
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[0, 0, -share * EULER]))
    middle = item.CreatePointMarker(mbs, (0, HEIGHT / 2, LENGTH / 2))
    mbs.AddLoad(items.LoadForceVector(markerNumber=middle, loadVector=[0, aside, 0]))
    mbs.Assemble()
    return mbs, item


def test_a_strut_near_its_buckling_load_settles_in_one_step(strut):
    """In a floating frame it took 385 load steps, and minutes with a force across."""
    bent = []
    for frame in ("inertial", "floating"):
        mbs, item = pressed(strut, frame, 0.98)
        result = ep.solve_static(mbs, load_steps=1)
        assert result.steps == 1
        bent.append(item.displacement(result, (0, HEIGHT / 2, LENGTH / 2))[-1])
    np.testing.assert_allclose(bent[1], bent[0], atol=1e-6 * np.linalg.norm(bent[0]))


def test_a_clamped_column_has_the_same_modes_in_both_frames(strut):
    found = []
    for frame in ("inertial", "floating"):
        mbs, _ = pressed(strut, frame, 0.2, clamped=True)  # of the load of a hinged one: 0.8 of its own
        ep.solve_static(mbs, load_steps=1, update_initial=True)
        found.append(lowest(mbs, 3))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-3)


def test_modes_of_a_body_that_spins_warn(link):
    mbs = exu.SystemContainer().AddSystem()
    ep.CreatePartitionBody(mbs, link, name="bar", frame="floating", initialAngularVelocity=[0, 0, 100.0])
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match="body 'bar' turns at 100 rad/s in the initial state"):
        ep.natural_modes(mbs)
