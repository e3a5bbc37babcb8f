"""Bodies with geometric stiffness in models: a loaded strut, a rotating blade, and what runs conserve."""

import re
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning
from exudyn_partition.reduction.buckling import links, squared_slope

LENGTH, WIDTH, HEIGHT = 0.3, 0.010, 0.006
EULER = np.pi**2 * ep.ALUMINIUM.E * WIDTH * HEIGHT**3 / 12 / LENGTH**2
BLADE = 0.5  # [m]
RATE, FREQUENCY, AT_REST = 3.0, 4.7973, 3.5160  # of a rotating cantilever by Wright, see reduction


@pytest.fixture(scope="module")
def column_model():
    shape = box(WIDTH, HEIGHT, LENGTH)
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "foot", "head"
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=12e-3)
    ends = [ep.Partition.interface(fem, name, name) for name in ("foot", "head")]
    return fem, ends[0] | ends[1]


@pytest.fixture(scope="module")
def column(column_model):
    return ep.reduce(*column_model, f_cut=5e3, geometric_stiffness=True)


@pytest.fixture(scope="module")
def column_with_nodes(column_model):
    """Basis "free", which keeps the nodes of a patch on a side."""
    fem, ends = column_model
    patch = ep.Partition.ball(fem, (0, HEIGHT / 2, LENGTH / 2), 13e-3)
    return ep.reduce(fem, ends | patch, f_cut=5e3, basis="free", geometric_stiffness=True)


@pytest.fixture(scope="module")
def blade():
    shape = box(BLADE, 0.010, 0.008)
    shape.faces.Min(occ.X).name = "root"
    fem = ep.fe_model(shape, ep.STEEL, maxh=15e-3)
    return ep.reduce(fem, ep.Partition.interface(fem, "root", "root"), f_cut=1e3, geometric_stiffness=True)


def marker_at(mbs, *place):
    ground = mbs.AddObject(items.ObjectGround(referencePosition=list(place)))
    return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))


def hinged(body, frame, force, aside=0.0, gravity=0.0):
    """A strut with hinges at its ends, a force on its head [N], one across, in its middle [N], and gravity across."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, name="strut", frame=frame, gravity=[0, gravity, 0])
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    mbs.AddObject(items.GenericJoint(markerNumbers=[marker_at(mbs, 0, 0, 0), foot], constrainedAxes=[1, 1, 1, 0, 0, 1]))
    top = marker_at(mbs, 0, 0, LENGTH)
    mbs.AddObject(items.GenericJoint(markerNumbers=[top, head], constrainedAxes=[1, 1, 0, 0, 0, 0]))
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[0, 0, -force]))
    if aside:
        middle = item.CreatePointMarker(mbs, (0, HEIGHT / 2, LENGTH / 2))
        mbs.AddLoad(items.LoadForceVector(markerNumber=middle, loadVector=[0, aside, 0]))
    mbs.Assemble()
    return mbs, item


def loaded_and_not(body, frame, **across):
    """Ratios of the lowest frequency and of the middle's deflection, with 0.6 of Euler's load by those without it."""
    frequencies, deflections = [], []
    for share in (0.0, 0.6):
        mbs, item = hinged(body, frame, share * EULER, **across)
        result = ep.solve_static(mbs, update_initial=True, load_steps=1)
        deflections.append(item.displacement(result, (0, HEIGHT / 2, LENGTH / 2))[-1, 1])
        values = mbs.ComputeODE2Eigenvalues(convert2Frequencies=True)[0]
        frequencies.append(np.sort(values[np.isfinite(values)])[0])
    return frequencies[1] / frequencies[0], deflections[1] / deflections[0]


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_strut_in_statics_bends_and_vibrates_as_its_load_says(column, frame):
    frequency, deflection = loaded_and_not(column, frame, aside=1.0)
    assert frequency == pytest.approx(np.sqrt(1 - 0.6), rel=5e-3)
    u = np.pi / 2 * np.sqrt(0.6)  # Timoshenko and Gere, section 1.2
    assert deflection == pytest.approx(3 * (np.tan(u) - u) / u**3, rel=0.01)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_strut_that_keeps_nodes_does_so_too(column_with_nodes, frame):
    frequency, deflection = loaded_and_not(column_with_nodes, frame, gravity=100.0)
    assert frequency == pytest.approx(np.sqrt(1 - 0.6), rel=5e-3)
    u = np.pi / 2 * np.sqrt(0.6)  # Timoshenko and Gere, section 1.3
    assert deflection == pytest.approx(12 * (2 / np.cos(u) - 2 - u**2) / (5 * u**4), rel=0.01)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_energy_of_a_strut_that_keeps_nodes(column_with_nodes, frame):
    """Explicit steps: the load and gravity do all work."""
    mbs, item = hinged(column_with_nodes, frame, 0.6 * EULER, gravity=1e3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they act at once
        result = ep.solve_dynamic(mbs, end_time=2.5e-4, method="explicit")
    head = item.displacement(result, (0, 0, LENGTH))[:, 2]
    fallen = item.kinematics.rigid_motion(item.coordinates(result))[:, 1]
    work = -0.6 * EULER * head + 1e3 * column_with_nodes.total_mass * fallen
    assert abs(item.energy(result) - work).max() < 0.02 * work.max()


@pytest.mark.parametrize("method", ["implicit", "explicit"])
def test_a_blade_that_rotates_is_stiffer(blade, method):
    """A short push across the plane of rotation, and the frequency after it."""
    at_rest = AT_REST / BLADE**2 * np.sqrt(ep.STEEL.E / ep.STEEL.rho / 12) * 0.008
    omega, end = RATE / AT_REST * at_rest, 0.045
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, blade, name="blade", frame="floating", referencePosition=[BLADE / 2, 0, 0],
        initialVelocity=[0, omega * BLADE / 2, 0], initialAngularVelocity=[0, 0, omega],
    )  # fmt: skip
    hub = [marker_at(mbs, 0, 0, 0.004), item.CreateInterfaceMarker(mbs, "root")]
    mbs.AddObject(items.GenericJoint(markerNumbers=hub, constrainedAxes=[1, 1, 1, 1, 1, 0]))
    tip, push = item.CreatePointMarker(mbs, (BLADE / 2, 0, 0)), 5e-3
    mbs.AddLoad(
        items.LoadForceVector(
            markerNumber=tip, loadVector=[0, 0, 1], loadVectorUserFunction=lambda mbs, t, v: [0, 0, float(t < push)]
        )
    )
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the blade begins without its tension, and stretches at once
        result = ep.solve_dynamic(mbs, end_time=end, method=method, step=2e-4 if method == "implicit" else None)
    later = result.t > push
    t, aside = result.t[later], item.displacement(result, (BLADE / 2, 0, 0))[later, 2]
    rates = at_rest * np.linspace(1.0, 1.8, 801)

    def left(rate):
        fields = np.column_stack([np.cos(rate * t), np.sin(rate * t), np.ones(len(t))])
        return np.linalg.norm(aside - fields @ np.linalg.lstsq(fields, aside, rcond=None)[0])

    found = rates[int(np.argmin([left(rate) for rate in rates]))]
    assert found / at_rest == pytest.approx(FREQUENCY / AT_REST, rel=0.01)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_energy_of_a_pressed_strut_is_the_work_of_its_load(column, frame):
    """Explicit steps: the load and the push across do all work; the energy has the part of geometric stiffness."""
    mbs, item = hinged(column, frame, 0.6 * EULER, aside=5.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the load acts at once
        result = ep.solve_dynamic(mbs, end_time=4e-3, method="explicit")
    head = item.displacement(result, (0, 0, LENGTH))[:, 2]
    aside = item.displacement(result, (0, HEIGHT / 2, LENGTH / 2))[:, 1]
    work = -0.6 * EULER * head + 5.0 * aside
    assert abs(item.energy(result) - work).max() < 0.02 * work.max()


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_buckled_strut_warns_of_its_slopes(column, frame):
    """Near Euler's load there is no warning, if the strut stays straight."""
    mbs, _ = hinged(column, frame, 0.9 * EULER, aside=1e-3)
    assert ep.solve_static(mbs, load_steps=1).status == "finished"
    mbs, item = hinged(column, frame, 0.9 * EULER, aside=150.0)
    with pytest.warns(ModelLimitWarning, match=r"'strut' bends between its interfaces .* is wrong by about") as caught:
        result = ep.solve_static(mbs, load_steps=4)
    middle = abs(item.displacement(result, (0, HEIGHT / 2, LENGTH / 2))[-1, 1])
    slope = np.pi * middle / LENGTH / np.sqrt(2)  # of a half wave of sine
    limits = [warning for warning in caught if warning.category is ModelLimitWarning]  # it would yield, too
    (told,) = [re.search(r"up to ([\d.]+) rad", str(warning.message)) for warning in limits]
    assert float(told[1]) == pytest.approx(slope, rel=0.05)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_statics_tell_that_a_straight_strut_has_buckled(column, frame):
    """The straight strut is an equilibrium beyond Euler's load too, which no strut keeps."""
    mbs, _ = hinged(column, frame, 0.96 * EULER)
    assert not ep.solve_static(mbs, load_steps=1).warnings
    mbs, _ = hinged(column, frame, 1.03 * EULER)
    with pytest.warns(ModelLimitWarning, match=r"'strut': this equilibrium is unstable"):
        ep.solve_static(mbs, load_steps=1)


def test_a_column_vibrates_by_its_own_weight_as_greenhill_says(column_model):
    """Clamped at its foot; the weight at which it buckles is 7.837 E I / L^2, and squares of frequencies fall to it."""
    fem, _ = column_model
    foot = ep.Partition.interface(fem, "foot", "foot")
    body = ep.reduce(fem, foot, f_cut=2e3, geometric_stiffness=True)
    greatest = 7.837 * EULER / np.pi**2  # weight [N]; Euler's load is pi^2 E I / L^2
    found = []
    for share in (0.0, 0.4, 0.8):
        mbs = exu.SystemContainer().AddSystem()
        gravity = -share * greatest / body.total_mass
        item = ep.CreatePartitionBody(mbs, body, name="column", gravity=[0, 0, gravity])
        held = [marker_at(mbs, 0, 0, 0), item.CreateInterfaceMarker(mbs, "foot")]
        mbs.AddObject(items.GenericJoint(markerNumbers=held, constrainedAxes=[1] * 6))
        mbs.Assemble()
        ep.solve_static(mbs, load_steps=1, update_initial=True)
        values = mbs.ComputeODE2Eigenvalues(convert2Frequencies=True)[0]
        found.append(np.sort(values[np.isfinite(values)])[0])
    squares = (np.array(found) / found[0]) ** 2
    assert squares[1] == pytest.approx(0.6, rel=0.01)
    assert 0.8 / (1 - squares[2]) == pytest.approx(1.0, rel=0.015)  # share of the weight at which they are zero


def test_a_strut_beyond_its_load_bends_as_the_review_says(column):
    """What holds it there is wrong by at most the share that is told; an elastica bears a quarter of the square."""
    (link,) = links(column)
    mbs, item = hinged(column, "inertial", 1.03 * EULER, aside=1.0)
    with pytest.warns(ModelLimitWarning, match="wrong by about"):
        result = ep.solve_static(mbs, load_steps=20)
    slope = squared_slope(column, link, item.kinematics.deformed(item.coordinates(result)))[-1]
    assert 0.25 < 0.03 / slope < 2.0
