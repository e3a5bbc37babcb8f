"""Energy that steps make in contact, against the whole balance of runs whose steps take none."""

import warnings

import exudyn as exu
import exudyn.itemInterface as items
import pytest
from oracles import MARBLE_RADIUS, TOP

import exudyn_partition as ep
from exudyn_partition.simulation import adaptive_options
from exudyn_partition.simulation.contact_work import ContactWork

GRAVITY, SPEED = 2e3, 0.2  # [m/s2], [m/s]


@pytest.mark.parametrize(
    ("frame", "friction"),
    [("inertial", None), ("floating", None), ("inertial", 0.3)],
    ids=["inertial", "floating", "friction"],
)
@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")
def test_the_work_of_long_steps_is_what_the_balance_lacks(round_body, frame, friction):
    """With the spectral radius 1 steps take no energy: what a run gains comes from the contact's forces in them."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(
        mbs,
        round_body,
        frame=frame,
        gravity=[0, 0, -GRAVITY],
        referencePosition=[0, 0, 1e-7],
        initialVelocity=[0.5 * SPEED if friction else 0, 0, -SPEED],
    )
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=friction)
    step = 5e-6
    works = []

    def after_step(mbs, t):
        if not works:
            works.append(ContactWork.if_known(mbs, [contact]))
        works[0].end_step(step)
        works[0].begin_step()
        return True

    mbs.SetPostStepUserFunction(after_step)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=150e-6, step=step, method="implicit", spectral_radius=1.0)
    height = ball.rigid_motion(ball.coordinates(result))[:, 2]
    energy = ball.energy(result) + contact.energy(result) + contact.friction.work(result)
    energy += round_body.total_mass * GRAVITY * height
    gained = energy[-1] - energy[0]
    assert abs(gained) > 1e-4 * energy[0]
    assert works[0].made == pytest.approx(gained, rel=0.02)


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
def test_long_steps_that_make_energy_warn(marble, monkeypatch):
    """With errors of velocities a thousand times too large; with the right ones the same run is quiet."""
    monkeypatch.setattr(adaptive_options, "TOLERANCE", 1.0)
    said = []
    for tolerance in (1e-3, 1.0):
        mbs = exu.SystemContainer().AddSystem()
        ball = ep.CreatePartitionBody(mbs, marble, gravity=[0, 0, -1e5], referencePosition=[0, 0, MARBLE_RADIUS])
        ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south")
        mbs.Assemble()
        with warnings.catch_warnings(record=True):
            warnings.simplefilter("always")
            options = {"method": "implicit", "adaptive": True, "velocity_tolerance": tolerance}
            result = ep.solve_dynamic(mbs, end_time=0.3e-3, **options)
        said.append([text for text in result.warnings if "grew in lasting contact" in text])
    assert not said[0]
    assert "velocity_tolerance" in said[1][0]


def test_work_of_carriers_is_not_judged(mbs, marble):
    """Their bodies give work that no contact knows."""
    node = mbs.AddNode(items.NodeRigidBodyRotVecLG(referenceCoordinates=[0.0] * 6))
    carrier = mbs.AddObject(items.ObjectRigidBody(nodeNumber=node, mass=1.0, inertia=[1, 1, 1, 0, 0, 0]))
    ball = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, MARBLE_RADIUS])
    alone = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south")
    carried = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south", masterBody=carrier)
    assert ContactWork.if_known(mbs, []) is None
    assert ContactWork.if_known(mbs, [alone, carried]) is None
    assert ContactWork.if_known(mbs, [alone]) is not None


@pytest.mark.parametrize(("formulation", "known"), [("lagrange", False), ("penalty", True)])
def test_work_of_multipliers_is_not_judged(mbs, pair_of, formulation, known):
    """They store nothing: what bodies give within a contact and get back would seem to be lost and made."""
    bodies = [
        ep.CreatePartitionBody(mbs, body, referencePosition=place)
        for body, place in zip(pair_of("free"), (TOP, (0, 0, 0)), strict=True)
    ]
    contact = ep.CreatePartitionContact(mbs, *bodies, formulation=formulation)
    mbs.Assemble()
    assert (ContactWork.if_known(mbs, [contact]) is not None) is known
