"""Overlaps that are meant: Lame's pressure, pull-off by friction, clamped columns, preloaded runs, refusals."""

import contextlib
import math

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box, ground

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, PenetrationError

INNER, OUTER, WIDTH = 20e-3, 40e-3, 20e-3
OVERLAP, FRICTION = 10e-6, 0.12
AREA = 2 * math.pi * INNER * WIDTH
STEEL = ep.Material(E=210e9, nu=0.3, rho=7800.0)
SOFT = ep.Material(E=1e9, nu=0.0, rho=1000.0)
WHOLE = STEEL.E * OVERLAP * (OUTER**2 - INNER**2)  # of Lame's formulas
ON_RIGID = WHOLE / (INNER * ((1 - STEEL.nu) * INNER**2 + (1 + STEEL.nu) * OUTER**2))
ON_ELASTIC = WHOLE / (2 * INNER * OUTER**2)
ARBITRARY = pytest.mark.filterwarnings("ignore:.*nothing holds it against some motion")


def cylinder(radius):
    return occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, radius, WIDTH)


def seat(fem, radius=INNER):
    return ep.Partition.surface(fem, cylinder=((0, 0, 0), (0, 0, 1), radius), axes="xyz")


def held(fem, name, chosen, place):
    return ep.Partition.interface(fem, name, np.flatnonzero(chosen), kind="averaged", position=place)


@pytest.fixture(scope="module")
def hub():
    fem = ep.fe_model(cylinder(OUTER) - cylinder(INNER), STEEL, maxh=8e-3)
    rim = abs(np.hypot(*fem.points[:, :2].T) - OUTER) < 1e-5
    return fem, ep.reduce(fem, seat(fem) | held(fem, "rim", rim, (0, 0, WIDTH / 2)), f_cut=50e3)


@pytest.fixture(scope="module")
def shaft():
    fem = ep.fe_model(cylinder(INNER), STEEL, maxh=7e-3)
    end = (fem.points[:, 2] < 1e-9) & (np.hypot(*fem.points[:, :2].T) < 0.5 * INNER)
    return ep.reduce(fem, seat(fem) | held(fem, "end", end, (0, 0, 0)), f_cut=50e3)


def on_rigid(mbs, body, interference=OVERLAP, radius=INNER, **options):
    """A hub on a rigid shaft."""
    item = ep.CreatePartitionBody(mbs, body, name="hub", frame="floating")
    rigid = ep.RigidCylinder((0, 0, 0), (0, 0, 1), radius)
    contact = ep.CreatePartitionContact(mbs, item, rigid, interference=interference, name="seat", **options)
    mbs.Assemble()
    return item, contact


@ARBITRARY
@pytest.mark.parametrize("radius", [INNER, INNER + OVERLAP, INNER - 0.4 * OVERLAP])
def test_pressure_of_lame_on_a_rigid_shaft_however_it_is_drawn(mbs, hub, radius):
    _, contact = on_rigid(mbs, hub[1], radius=radius)
    result = ep.solve_static(mbs, load_steps=4)
    pressure = contact.force(result) / AREA
    assert np.allclose(pressure, ON_RIGID * result.t, rtol=0.01, atol=1e-3 * ON_RIGID)
    rows = contact.row_forces(result)[-1].toarray().ravel()
    assert abs(contact.nodal_forces(result)[0][-1].sum(axis=0)).max() < 1e-3 * rows.sum()
    assert rows.min() > 0


@ARBITRARY
def test_the_hoop_stress_at_the_bore_is_that_of_lame(mbs, hub):
    fem, body = hub
    item, _ = on_rigid(mbs, body)
    result = ep.solve_static(mbs, load_steps=1)
    angles, radius = np.linspace(0, 2 * math.pi, 16, endpoint=False), 26e-3
    c, s = np.cos(angles), np.sin(angles)
    places = np.column_stack([radius * c, radius * s, np.full(len(angles), WIDTH / 2)])
    xx, yy, _, _, _, xy = item.stress(result, places, fem)[-1].T
    hoop = (xx * s**2 + yy * c**2 - 2 * xy * s * c).mean()
    lame = ON_RIGID * INNER**2 / (OUTER**2 - INNER**2) * (1 + (OUTER / radius) ** 2)
    assert abs(hoop / lame - 1) < 0.02


@ARBITRARY
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_run_after_the_statics_begins_pressed_and_at_rest(mbs, hub, method):
    item, contact = on_rigid(mbs, hub[1])
    pressed = contact.force(ep.solve_static(mbs, load_steps=2, update_initial=True))[-1]
    step = {} if method == "explicit" else {"step": 1e-6}
    result = ep.solve_dynamic(mbs, end_time=20e-6, method=method, **step)
    assert np.allclose(contact.force(result), pressed, rtol=1e-5)
    assert np.ptp(item.energy(result)) < 1e-6 * item.energy(result)[0]
    again = ep.solve_static(mbs, load_steps=3)  # from the pressed state: the overlap stays closed
    assert np.allclose(contact.force(again)[1:], pressed, rtol=1e-5)


@ARBITRARY
@pytest.mark.parametrize("rigid", ["cylinder", "placed", "mesh"])
def test_an_overlap_that_is_meant_sinks_nowhere(mbs, hub, rigid):
    """Before load steps close it, edges at the ends of the bore are below the surface: deeper than a warning allows."""
    depth, master = 60e-6, ep.RigidCylinder((0, 0, 0), (0, 0, 1), INNER + (60e-6 if rigid == "placed" else 0.0))
    if rigid == "mesh":
        master = ep.RigidMesh.of(occ.Cylinder(occ.Pnt(0, 0, -WIDTH), occ.Z, INNER, 3 * WIDTH), maxh=5e-3)
    item = ep.CreatePartitionBody(mbs, hub[1], name="hub", frame="floating")
    contact = ep.CreatePartitionContact(mbs, item, master, interference="placed" if rigid == "placed" else depth)
    mbs.Assemble()
    pressure = contact.force(ep.solve_static(mbs, load_steps=2))[-1] / AREA
    assert abs(pressure / (depth / OVERLAP * ON_RIGID) - 1) < (
        0.1 if rigid == "placed" else 0.01
    )  # facets overlap more


@ARBITRARY
def test_each_static_run_from_the_state_as_placed_presses_anew(mbs, hub):
    _, contact = on_rigid(mbs, hub[1])
    first, second = (contact.force(ep.solve_static(mbs, load_steps=2)) for _ in range(2))
    assert first[0] == second[0] == 0.0
    assert np.allclose(first, second, rtol=1e-9)


def test_a_run_that_was_not_pressed_is_warned_of(mbs, hub):
    on_rigid(mbs, hub[1])
    with pytest.warns(ModelLimitWarning, match=r"starts with an overlap.*solve_static"):
        ep.solve_dynamic(mbs, end_time=20e-6, step=1e-7)


@pytest.fixture(scope="module")
def pulled(hub, shaft):
    """A hub pressed on an elastic shaft and pulled off: pressure, contact, result, force of the joint."""
    mbs, way = exu.SystemContainer().AddSystem(), {"z": 0.0}
    outer = ep.CreatePartitionBody(mbs, hub[1], name="hub", frame="floating")
    inner = ep.CreatePartitionBody(mbs, shaft, name="shaft", frame="floating")
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), inner.CreateInterfaceMarker(mbs, "end")]))
    joint = mbs.AddObject(
        items.GenericJoint(
            markerNumbers=[ground(mbs, (0, 0, WIDTH / 2)), outer.CreateInterfaceMarker(mbs, "rim")],
            constrainedAxes=[0, 0, 1, 0, 0, 0],
            offsetUserFunction=lambda mbs, t, *unused: [0, 0, way["z"] * t, 0, 0, 0],
        )
    )
    kind = exu.OutputVariableType.ForceLocal
    sensor = mbs.AddSensor(items.SensorObject(objectNumber=joint, outputVariableType=kind, storeInternal=True))
    contact = ep.CreatePartitionContact(mbs, outer, inner, interference=OVERLAP, friction=FRICTION)
    mbs.Assemble()
    pressure = contact.force(ep.solve_static(mbs, load_steps=4, update_initial=True)) / AREA
    way["z"] = 20e-6
    result = ep.solve_static(mbs, load_steps=8, load_factor=False)
    return pressure, contact, result, mbs.GetSensorStoredData(sensor)[-9:, 3]


def test_pressure_of_lame_on_an_elastic_shaft_with_friction(pulled):
    """Friction holds the ends of the shaft and of the bore together, which would part by Poisson's ratio."""
    pressure, *_ = pulled
    assert pressure[0] == 0.0
    assert abs(pressure[-1] / ON_ELASTIC - 1) < 0.015


def test_the_pull_off_force_is_the_coefficient_times_the_pressure(pulled):
    _, contact, result, pull = pulled
    assert abs(pull[-1] / (FRICTION * ON_ELASTIC * AREA) - 1) < 0.02
    assert math.isclose(pull[-1], FRICTION * contact.force(result)[-1], rel_tol=1e-3)
    assert abs(pull[-1] / pull[-2] - 1) < 1e-3  # it slides
    assert pull[0] < 0.3 * pull[-1]


@pytest.fixture(scope="module")
def column():
    """A block with a patch on each end."""
    fem = ep.fe_model(box(10e-3, 10e-3, 20e-3), SOFT, maxh=6e-3)
    ends = [ep.Partition.surface(fem, plane=((0, 0, z), (0, 0, n)), name=name)
            for name, z, n in (("bottom", 0.0, -1.0), ("top", 20e-3, 1.0))]  # fmt: skip
    return ep.reduce(fem, ends[0] | ends[1], f_cut=20e3)


@ARBITRARY
@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_two_columns_between_planes_share_the_overlap(mbs, column, frame):
    """Three contacts, of which one is pressed: with nu = 0 the force is E A d / 2 L."""
    lower = ep.CreatePartitionBody(mbs, column, frame=frame)
    upper = ep.CreatePartitionBody(mbs, column, frame=frame, referencePosition=[0, 0, 20e-3])
    floor, ceiling = ep.RigidPlane(), ep.RigidPlane((0, 0, 40e-3), (0, 0, -1))
    contacts = [
        ep.CreatePartitionContact(mbs, lower, floor, slavePatch="bottom"),
        ep.CreatePartitionContact(mbs, upper, lower, slavePatch="bottom", masterPatch="top", interference=OVERLAP),
        ep.CreatePartitionContact(mbs, upper, ceiling, slavePatch="top"),
    ]
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=2, update_initial=True)
    expected = SOFT.E * 1e-4 * OVERLAP / 40e-3 * result.t
    for contact in contacts:
        assert np.allclose(contact.force(result), expected, rtol=1e-3, atol=1e-6 * expected[-1])
    run = ep.solve_dynamic(mbs, end_time=1e-4, method="implicit", step=5e-6)
    for contact in contacts:
        assert np.allclose(contact.force(run), expected[-1], rtol=1e-4)


def test_an_overlap_that_is_not_meant_names_the_way(mbs, hub):
    with pytest.raises(PenetrationError, match="interference="):
        on_rigid(mbs, hub[1], None, radius=INNER + OVERLAP)
    item = ep.CreatePartitionBody(mbs, hub[1], name="other hub")
    with pytest.raises(PenetrationError, match="interference="):
        ep.CreatePartitionContact(mbs, item, ep.RigidCylinder((0, 0, 0), (0, 0, 1), INNER + OVERLAP))


@pytest.mark.parametrize(
    ("interference", "radius", "said"),
    [
        (OVERLAP, INNER + 100e-6, "more than the 1e-05 m that are meant"),
        (OVERLAP, INNER - 5e-3, "come nearer"),
        ("placed", INNER - 1e-4, "overlap as they are placed"),
        ("drawn", INNER, "text is no number"),
    ],
)
def test_interference_that_does_not_suit_the_place_is_refused(mbs, hub, interference, radius, said):
    with pytest.raises(InputError, match=said):
        on_rigid(mbs, hub[1], interference, radius)


def test_surfaces_that_do_not_lie_on_each_other_need_a_drawn_overlap(mbs, bodies):
    item = ep.CreatePartitionBody(mbs, bodies[0], name="ball")
    with pytest.raises(InputError, match=r"expected surfaces that lie on each other.*'placed'"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), interference=1e-6)


@pytest.mark.parametrize(("share", "lies_on_it"), [(0.5, True), (2.0, False)])
def test_gaps_may_differ_by_what_facets_explain(mbs, column, share, lies_on_it):
    """A flat face on a plane that is tilted: facets explain 1e-4 of their size, as where patches touch."""
    item = ep.CreatePartitionBody(mbs, column, frame="floating")
    face = column.surface(np.zeros(3), 0)
    x = face.points[:, 0]
    slope = share * 1e-4 * face.facet_size / abs(x - np.median(x)).max()
    plane = ep.RigidPlane(normal=(slope, 0, 1))
    refused = pytest.raises(InputError, match="expected surfaces that lie on each other")
    with contextlib.nullcontext() if lies_on_it else refused:
        ep.CreatePartitionContact(mbs, item, plane, slavePatch="bottom", interference=OVERLAP, rows="node-to-segment")


def test_multipliers_have_no_statics_to_press_with(mbs):
    fem = ep.fe_model(box(10e-3, 10e-3, 20e-3), SOFT, maxh=6e-3)
    tip = ep.Partition.ball(fem, (0, 0, 0), 3e-3)
    body = ep.reduce(fem, tip, f_cut=38e3, basis="free")
    item = ep.CreatePartitionBody(mbs, body)
    with pytest.raises(InputError, match=r"interference: .*formulation='compliance'"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), interference=1e-6, formulation="lagrange")
