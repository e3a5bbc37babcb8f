"""Implicit steps of bodies with geometric stiffness: as few iterations as without it, and the same accuracy."""

import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box, each_way

import exudyn_partition as ep
from exudyn_partition.frames import loops

LENGTH, WIDTH, HEIGHT = 0.3, 0.010, 0.006
EULER = np.pi**2 * ep.ALUMINIUM.E * WIDTH * HEIGHT**3 / 12 / LENGTH**2
STEP = 2e-5  # [s]


@pytest.fixture(scope="module")
def model():
    shape = box(WIDTH, HEIGHT, LENGTH)
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "foot", "head"
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=15e-3)
    ends = [ep.Partition.interface(fem, name, name) for name in ("foot", "head")]
    return fem, ends[0] | ends[1] | ep.Partition.ball(fem, (0, HEIGHT / 2, LENGTH / 2), 13e-3)


@pytest.fixture(scope="module", params=["contact-adapted", "free", "craig-bampton"])
def bodies(request, model):
    """The same body without geometric stiffness and with it."""
    return [ep.reduce(*model, f_cut=3e3, basis=request.param, geometric_stiffness=own) for own in (False, True)]


@pytest.fixture(scope="module")
def column(model):
    return ep.reduce(*model, f_cut=3e3, geometric_stiffness=True)


def marker_at(mbs, *place):
    ground = mbs.AddObject(items.ObjectGround(referencePosition=list(place)))
    return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))


def strut(body, frame):
    """A hinged strut that half of Euler's load presses, and a moment on its head bends, both from 2 ms on."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, name="strut", frame=frame)
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    mbs.AddObject(items.GenericJoint(markerNumbers=[marker_at(mbs, 0, 0, 0), foot], constrainedAxes=[1, 1, 1, 0, 0, 1]))
    top = marker_at(mbs, 0, 0, LENGTH)
    mbs.AddObject(items.GenericJoint(markerNumbers=[top, head], constrainedAxes=[1, 1, 0, 0, 0, 0]))

    def rising(mbs, t, load):
        share = (1 - np.cos(np.pi * min(t / 2e-3, 1.0))) / 2
        return [share * component for component in load]

    for kind, load in ((items.LoadForceVector, [0, 0, -0.5 * EULER]), (items.LoadTorqueVector, [1.0, 0, 0])):
        mbs.AddLoad(kind(markerNumber=head, loadVector=load, loadVectorUserFunction=rising))
    mbs.Assemble()
    return mbs, item


def implicit(body, frame, steps=300, step=STEP):
    mbs, item = strut(body, frame)
    result = ep.solve_dynamic(mbs, end_time=steps * step, step=step, method="implicit", sample_period=10 * STEP)
    assert result.status == "finished"
    return mbs, item, result


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_step_takes_as_few_iterations_as_without_it(bodies, frame):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of compression, without geometric stiffness
        without, with_it = (implicit(body, frame, 150)[2].work for body in bodies)
    assert with_it.newton_iterations <= 1.15 * without.newton_iterations
    assert with_it.jacobians <= without.jacobians + 0.05 * 150


def test_long_steps_in_a_turning_frame_take_no_more_jacobians(model):
    """A strut turns about its foot by 0.05 rad a step, in which Newton's method computes its Jacobian anew."""
    work = []
    for own in (False, True):
        body = ep.reduce(*model, f_cut=3e3, geometric_stiffness=own)
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(
            mbs, body, name="strut", frame="floating",
            initialAngularVelocity=[250.0, 0, 0], initialVelocity=[0, -250.0 * LENGTH / 2, 0],
        )  # fmt: skip
        held = [marker_at(mbs, 0, 0, 0), item.CreateInterfaceMarker(mbs, "foot")]
        mbs.AddObject(items.GenericJoint(markerNumbers=held, constrainedAxes=[1, 1, 1, 0, 1, 1]))
        mbs.Assemble()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of rotation, without geometric stiffness
            work.append(ep.solve_dynamic(mbs, end_time=60 * 2e-4, step=2e-4, method="implicit").work)
    assert work[1].newton_iterations <= 1.15 * work[0].newton_iterations
    assert work[1].jacobians <= 1.15 * work[0].jacobians + 3


def test_steps_are_of_second_order(column):
    """The middle of the strut by steps of one length, a half and a quarter of it, against an eighth."""
    motions = []
    for divided in (1, 2, 4, 8):
        _, item, result = implicit(column, "inertial", 200 * divided, STEP / divided)
        motions.append(item.displacement(result, (0, HEIGHT / 2, LENGTH / 2))[:, 1])
    errors = [np.linalg.norm(motion - motions[-1]) for motion in motions[:-1]]
    assert errors[0] < 2e-3 * np.linalg.norm(motions[-1])
    assert errors[0] / errors[1] == pytest.approx(63 / 15, rel=0.15)  # 1 - 1/64 by 1/4 - 1/64
    assert errors[1] / errors[2] == pytest.approx(15 / 3, rel=0.15)


def test_a_vibrating_body_keeps_its_energy(column):
    """Large bending in free flight, without damping of the steps: of second order in the squares of slopes."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, column, name="bar", frame="floating")
    shape = np.argmin(np.where(column.basis.omega > 0, column.basis.omega, np.inf)) - 6
    start = np.zeros(column.n_dofs - 6)
    start[shape] = 0.2  # [m/s kg^1/2]
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", start)
    mbs.Assemble()
    result = ep.solve_dynamic(
        mbs, end_time=4000 * STEP, step=STEP, method="implicit", spectral_radius=1.0, sample_period=40 * STEP
    )
    energy = item.energy(result)
    assert energy == pytest.approx(0.2**2 / 2, rel=1e-3)
    assert result.work.newton_iterations < 1.3 * result.steps


def test_other_runs_of_the_model_have_the_true_force(column):
    """After an implicit run, a static run and explicit steps are those of a new model."""
    mbs, item, _ = implicit(column, "inertial", 30)
    new, its = strut(column, "inertial")
    pairs = [(mbs, item), (new, its)]
    ends = [item.coordinates(ep.solve_static(mbs, load_steps=1))[-1] for mbs, item in pairs]
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-9 * abs(ends[1]).max())
    ends = [item.coordinates(ep.solve_dynamic(mbs, end_time=2e-4, method="explicit"))[-1] for mbs, item in pairs]
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-12 * abs(ends[1]).max())


def test_a_step_that_begins_again_ends_in_the_same_place(column):
    """Runs in two parts are as one, though the solver then has no earlier steps to guess from."""
    _, item, whole = implicit(column, "inertial", 200)
    mbs, its = strut(column, "inertial")
    ep.solve_dynamic(mbs, end_time=100 * STEP, step=STEP, method="implicit")
    parts = ep.solve_dynamic(mbs, end_time=200 * STEP, go_on=True, method="implicit", sample_period=10 * STEP)
    one, other = (
        own.displacement(result, (0, HEIGHT / 2, LENGTH / 2))[-1] for own, result in ((item, whole), (its, parts))
    )
    assert other == pytest.approx(one, rel=1e-5, abs=1e-5 * np.linalg.norm(one))


def test_compiled_steps_are_those_of_numpy(column):
    rng, stiffening = np.random.default_rng(2), column.stiffening
    k = stiffening.states.shape[1]
    motion, guess = 1e-4 * rng.normal(size=(2, k))
    tangent, dynamic = stiffening.tangent_on_motion(motion), 1e8 + 1e10 * rng.random(k)
    smooth = np.outer([3.0, 2.0, 1.0], 1e-6 * rng.normal(size=k))
    for errors in (smooth, smooth * [[1], [-1], [1]], smooth + np.array([[0], [0], [1e-6]])):

        def at_guess(errors=errors):
            anchor, force = np.zeros((2, k))
            found = loops.stiffening_at_guess(stiffening, tangent, dynamic, errors, motion, anchor, force)
            return np.array([found, anchor, force])

        compiled, plain = each_way(at_guess)
        for one, other in zip(compiled, plain, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-11 * abs(other).max())
    for share in (1e-12, 1e12):

        def in_step(share=share):
            anchor, force = motion + 1e-7, stiffening.force_on_motion(motion + 1e-7)
            found, linear = loops.stiffening_in_step(stiffening, tangent, dynamic, guess, share, motion, anchor, force)
            assert linear == (share > 1)
            return np.array([found, anchor, force])

        compiled, plain = each_way(in_step)
        for one, other in zip(compiled, plain, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-11 * abs(other).max())
