"""Links under compression: Euler's load and the force in a run, against beam theory."""

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning
from exudyn_partition.reduction.buckling import Link, compression, links

LENGTH, WIDTH, HEIGHT = 0.3, 0.010, 0.006
EULER = np.pi**2 * ep.ALUMINIUM.E * WIDTH * HEIGHT**3 / 12 / LENGTH**2
MASS = ep.ALUMINIUM.rho * LENGTH * WIDTH * HEIGHT
PERIOD = 2 * np.sqrt(LENGTH * MASS / EULER)  # of the hinged beam: omega^2 = pi^2 EULER / (LENGTH MASS)


@pytest.fixture(scope="module", params=["rigid", "averaged"])
def column(request):
    """A column along z with an interface at each end."""
    shape = box(WIDTH, HEIGHT, LENGTH)
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "foot", "head"
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=12e-3)
    ends = [ep.Partition.interface(fem, name, name, kind=request.param) for name in ("foot", "head")]
    return ep.reduce(fem, ends[0] | ends[1], f_cut=5e3)


def test_euler_s_load_and_the_period_of_bending(column):
    (link,) = links(column)
    assert link.ends == ("foot", "head")
    assert link.buckling_load == pytest.approx(EULER, rel=0.02)
    assert link.period == pytest.approx(PERIOD, rel=0.01)


def test_the_force_is_the_axial_one_whatever_else_acts(column):
    """Statics of a free column: axial forces at its ends, and bending moments beside them."""
    (link,) = links(column)
    head, foot = column.interface_rows("head"), column.interface_rows("foot")
    load = 700 * (head[2] - foot[2]) + 3 * (head[3] - foot[3]) - 2 * (head[4] - foot[4])
    q = np.linalg.lstsq(column.stiffness.toarray(), load, rcond=1e-12)[0]
    assert link.force @ q == pytest.approx(700, rel=1e-6)


def test_a_short_pulse_does_not_bend():
    """The mean over a period: all of a constant force after one, a tenth of the force of a pulse of a tenth."""
    link = Link(("foot", "head"), force=np.array([-1.0]), buckling_load=1.0, period=1.0)
    t = np.linspace(0, 3, 3001)
    assert compression(link, t, np.full((3001, 1), 5.0))[[500, 1000, 3000]] == pytest.approx([2.5, 5.0, 5.0])
    pulse = np.where((t > 1) & (t <= 1.1), 5.0, 0.0)[:, None]
    assert compression(link, t, pulse).max() == pytest.approx(0.5, rel=0.02)


@pytest.mark.filterwarnings("ignore:damping took energy")  # the load acts at once, and steps damp what it excites
@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize(("share", "told"), [(0.3, "compressed"), (0.05, None), (-0.3, "pulled")])
def test_a_column_under_load(column, frame, share, told):
    """Clamped at its foot; the share that is told is that of the load, with what its vibration adds."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, column, name="column", frame=frame)
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround())))
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground, foot], constrainedAxes=[1] * 6))
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[0, 0, -share * EULER]))
    mbs.Assemble()
    options = {"end_time": 1.2 * PERIOD, "step": PERIOD / 200, "method": "implicit"}
    if told:
        with pytest.warns(ModelLimitWarning, match=rf"'column' is {told} between its interfaces 'foot' and 'head'"):
            result = ep.solve_dynamic(mbs, **options)
        (link,) = links(column)
        force = compression(link, result.t, item.kinematics.elastic(item.coordinates(result)))
        assert force[-1] == pytest.approx(share * EULER, rel=0.05)
    else:
        assert ep.solve_dynamic(mbs, **options).status == "finished"


def test_a_column_in_statics_is_told_its_whole_load(column):
    """Not a mean over static time, in which the load grows."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, column, name="column")
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround())))
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground, foot], constrainedAxes=[1] * 6))
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[0, 0, -0.3 * EULER]))
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match=rf"by up to {0.3 * EULER:.4g} N"):
        ep.solve_static(mbs, load_steps=1)
