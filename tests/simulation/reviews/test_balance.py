"""Each run checks its own balance of energy and momentum: what is wrong is told, what is not known is not judged."""

import dataclasses
import re

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import ground

import exudyn_partition as ep
from exudyn_partition.exudyn_contacts.balance import STEPS, Balance
from exudyn_partition.simulation.reviews.balance import balance
from exudyn_partition.simulation.reviews.reviewed_run import ReviewedRun

SPEED, GRAVITY, SPAN = 0.4, np.array([0, 0, -2e4]), 40e-6
SOFT = 1e3


def dropped(marble, *, acting=None, frame="inertial", damping=None, formulation="compliance", **options):
    """A ball hits a plane under a large weight, and what `acting` adds; model, result, ball, contact."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, marble, name="ball", frame=frame, gravity=GRAVITY, initialVelocity=[0, 0, -SPEED], damping=damping,
        referencePosition=[0, 0, 5.001e-3],
    )  # fmt: skip
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="south", formulation=formulation)
    if acting is not None:
        acting(mbs, item)
    mbs.Assemble()
    return mbs, ep.solve_dynamic(mbs, end_time=SPAN, **options), item, contact


def faster(result, item, share=0.05):
    """The result as if the body were faster after half of the run."""
    late = (result.t > SPAN / 2)[:, None]
    changed = {int(n): result.sensors[int(n)] * np.where(late, 1 + share, 1.0) for n in item["sCoordinates_t"]}
    return dataclasses.replace(result, sensors={**result.sensors, **changed})


def told(mbs, result):
    """What the check says, by what it is about."""
    texts = [finding.text for finding in balance(ReviewedRun(mbs, result))]
    return {("momentum" if "momentum" in text else "energy"): text for text in texts}


@pytest.mark.parametrize("options", [{}, {"method": "implicit"}, {"method": "implicit", "spectral_radius": 0.5}])
def test_a_run_that_makes_energy_and_momentum_says_so_with_its_numbers(marble, frame, options):
    mbs, result, item, contact = dropped(marble, frame=frame, **options)
    assert told(mbs, result) == {}
    wrong = faster(result, item)
    said = told(mbs, wrong)
    assert {*said} == {"energy", "momentum"}
    energy, right = (item.energy(each) + contact.energy(each) for each in (wrong, result))
    when, share = map(float, re.search(r"until t = (\S+) s, ([\d.]+)% of what they should", said["energy"]).groups())
    at = int(abs(result.t - when).argmin())
    assert "have gained" in said["energy"]
    assert share == pytest.approx(100 * (energy - right)[at] / right.max(), abs=0.15)
    slower = told(mbs, faster(result, item, -0.05))
    assert "have lost" in slower["energy"]
    assert "more than 10 times what they should have" in told(mbs, faster(result, item, 5))["energy"]
    number = int(contact["sForce"])
    weaker = {**result.sensors, number: result.sensors[number] * 0.95}
    said = told(mbs, dataclasses.replace(result, sensors=weaker))["momentum"]
    (share,) = map(float, re.findall(r"([\d.]+)% of the largest change is missing", said))
    changed = np.linalg.norm(item.momentum(result) - item.momentum(result)[0], axis=1).max()
    assert share == pytest.approx(5 * np.trapezoid(contact.force(result), result.t) / changed, rel=0.05)


def test_what_the_steps_take_leaves_the_same_rest_for_every_spectral_radius(marble, frame):
    """The rest of the balance is that of rows that close and open; damping of the steps is not in it."""
    rests, taken = [], []
    for radius in (1.0, 0.9, 0.3, 0.0):
        _, result, *_ = dropped(marble, frame=frame, method="implicit", spectral_radius=radius, step=0.15e-6)
        balance = Balance.of_run(result)
        rests.append(balance.rest[-1] / balance.total[0])
        taken.append(balance.taken[STEPS][-1] / balance.total[0] if radius < 1 else 0.0)
    assert np.all(np.diff(taken) > 0)
    assert np.ptp(rests) < 0.1 * taken[-1]
    assert taken[-1] > 1e-4


def spring(mbs, item):
    marker = item.CreateNodeMarker(mbs, item.body.points[item.body.points[:, 2].argmax()])
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[ground(mbs), marker], stiffness=[0, 0, SOFT]))


def sensed(mbs, item):
    spring(mbs, item)
    ep.CreateWorkSensor(mbs)


def stiffness(mbs, item):
    K = exu.MatrixContainer(np.eye(item.body.n_dofs))
    mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=item.nodes, stiffnessMatrix=K))


def stepping(mbs, item):
    mbs.SetPreStepUserFunction(lambda mbs, t: True)


@pytest.mark.parametrize(
    ("acting", "judged"),
    [(None, {"energy", "momentum"}), (spring, set()), (sensed, {"energy"}), (stiffness, set()), (stepping, set())],
)
def test_only_what_is_known_is_judged(marble, acting, judged):
    """Work of a spring is known if it is sensed; a user's matrix or function may do anything."""
    mbs, result, item, _ = dropped(marble, acting=acting)
    assert {*told(mbs, faster(result, item))} == judged


def test_samples_far_apart_tell_energy_but_no_impulse(marble):
    mbs, result, item, _ = dropped(marble, sample_period=4e-6)
    assert {*told(mbs, faster(result, item))} == {"energy"}
    mbs, result, item, _ = dropped(marble, sample_period=4e-6, damping=0.05)
    assert not told(mbs, result)  # though the samples do not resolve what damping takes


def test_a_joint_in_space_gives_no_energy_and_a_driven_one_may(arm_body):
    for drive, judged in (({}, {"energy"}), ({"offsetUserFunction": lambda mbs, t, i, offset: [0.0] * 6}, set())):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, arm_body, frame="floating", gravity=[0, 0, -1e5])
        joint = items.GenericJoint(
            markerNumbers=[ground(mbs), item.CreateInterfaceMarker(mbs, "foot")], constrainedAxes=[1, 1, 1, 1, 1, 1],
            **drive,
        )  # fmt: skip
        mbs.AddObject(joint)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=SPAN)
        assert {*told(mbs, faster(result, item, 0.5))} == judged


@pytest.fixture(scope="module")
def free_marble(marble_parts):
    """The ball with a patch that has mass."""
    return ep.reduce(*marble_parts, f_cut=300e3, basis="free")


def gained(mbs, result, item):
    """What a run that made energy is advised to take."""
    said = told(mbs, faster(result, item))["energy"]
    return re.search(r"Take (.*)$", said)[1]


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_run_that_makes_energy_is_advised_what_it_does_not_have_already(marble, free_marble, method):
    """No explicit run to take explicit steps, and no contact to take its own formulation."""
    explicit, step = (["method='explicit'"], SPAN / 80) if method == "implicit" else ([], None)
    compliance = "formulation='compliance'"
    for body, formulation, more in (
        (marble, "compliance", []),
        (marble, "penalty", [compliance]),
        (free_marble, "lagrange", [f"a basis with residual flexibility and {compliance}"]),
    ):
        if formulation == "lagrange" and method == "explicit":
            continue  # very short steps
        mbs, result, item, _ = dropped(body, formulation=formulation, method=method, step=step)
        assert gained(mbs, result, item) == ", or ".join(["shorter ones", *explicit, *more])


def test_a_run_without_contact_is_advised_nothing_about_contacts(marble, mbs):
    item = ep.CreatePartitionBody(mbs, marble, gravity=GRAVITY)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=SPAN)
    assert gained(mbs, result, item) == "shorter ones"


def test_explicit_steps_are_not_advised_to_a_model_that_they_refuse(marble):
    def at_constant_speed(mbs, item):
        node = mbs.AddNode(items.NodePoint())
        mbs.AddObject(items.MassPoint(mass=1e-9, nodeNumber=node))
        nodes = mbs.AddNode(items.NodePointGround()), node
        markers = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=n, coordinate=0)) for n in nodes]
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=markers, velocityLevel=True))
        ep.CreateWorkSensor(mbs)

    mbs, result, item, _ = dropped(marble, acting=at_constant_speed, method="implicit")
    assert gained(mbs, result, item) == "shorter ones"
