"""Motion of surfaces, frame by frame: the places, speeds and stresses that bodies have in the run."""

import numpy as np
import pytest
from oracles import TOP, hit_by_a_spinning_ball

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.present.motion import motion_of


@pytest.fixture(scope="module")
def spinning(bodies):
    """A ball that spins in a floating frame hits a block in an inertial one."""
    return hit_by_a_spinning_ball(bodies, initialAngularVelocity=[0, 30.0, 0])


@pytest.mark.parametrize("scale", [1.0, 30.0])
def test_places_are_those_of_the_run(spinning, scale):
    *items, _, result = spinning
    motion = motion_of(result, frames=7)
    run = result.at(7)
    np.testing.assert_array_equal(motion.t, run.t)
    assert [body.name for body in motion.bodies] == ["ball", "body 1"]
    for item, body in zip(items, motion.bodies, strict=True):
        at, q = item.kinematics.at(np.unique(item.body.facets)), item.coordinates(run)
        axes = at.frame(q)[1]
        grown = at.grown(item.coordinates_t(run))  # by rotation
        assert (grown is None) == (item.frame == "inertial")
        deformed, beyond = at.deformation(q), 0.0 if grown is None else grown
        expected = at.place(q) + ((scale - 1) * deformed + scale * beyond) @ axes.swapaxes(1, 2)
        places = np.array([body.at(frame, scale) for frame in range(7)])
        np.testing.assert_allclose(places, expected, atol=1e-12)
        speed = np.linalg.norm(at.velocities(q, item.coordinates_t(run)), axis=2)
        np.testing.assert_allclose(body.colours["speed"], speed, rtol=1e-12)
    assert abs(motion.bodies[0].turn[-1] - motion.bodies[0].turn[0]).max() > 0.01  # the ball turns


def test_what_stands_beside_the_bodies(spinning):
    *_, contact, result = spinning
    motion = motion_of(result, frames=5)
    np.testing.assert_array_equal(motion.forces["ball on block"], contact.force(result))
    assert motion.peak == result.t[contact.force(result).argmax()]
    (spot,) = motion.spots
    np.testing.assert_allclose(spot.place, TOP, atol=0.3e-3)
    assert (spot.name, spot.bodies, spot.time) == ("ball on block", [0, 1], motion.peak)
    assert spot.push[2] > 0.99  # the ball, which is the slave, is pushed upwards
    assert 0 < spot.reach < 1.5e-3
    low, high = motion.bounds
    assert high[2] == pytest.approx(TOP[2] + 0.02, abs=1e-4)
    assert motion.size == pytest.approx(np.linalg.norm(high - low))


def test_stresses_of_many_frames_are_those_of_each(mbs, bodies, block, ball):
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    ep.CreatePartitionContact(mbs, striker, target)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=20e-6, step=0.5e-6)
    shown = [(striker, ball[0]), (target, block)]
    whole = motion_of(result, shown, colours=["von_mises"], frames=4)
    for frame, t in enumerate(whole.t[1:], 1):
        one = motion_of(result, shown, colours=["von_mises"], frames=[t])
        for body, alone in zip(whole.bodies, one.bodies, strict=True):
            largest = alone.colours["von_mises"].max()
            np.testing.assert_allclose(
                body.colours["von_mises"][frame], alone.colours["von_mises"][0], atol=1e-9 * largest
            )
            np.testing.assert_allclose(body.at(frame), alone.at(0), atol=1e-12)


def test_bodies_of_one_reduction_have_answers_to_their_own_contacts(mbs, bodies, ball):
    """Two equal balls fall on a plane, one faster: what they share, their stiffness, mixes nothing up."""
    items = [
        ep.CreatePartitionBody(mbs, bodies[0], referencePosition=[x, 0, 0], initialVelocity=[0, 0, -speed])
        for x, speed in ((0.0, 1.0), (0.05, 2.0))
    ]
    for item in items:
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0)))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=10e-6, step=0.5e-6)
    both = motion_of(result, [(item, ball[0]) for item in items], colours=["von_mises"], frames=3)
    for item, body in zip(items, both.bodies, strict=True):
        alone = motion_of(result, [(item, ball[0])], colours=["von_mises"], frames=3).bodies[0]
        np.testing.assert_allclose(body.colours["von_mises"], alone.colours["von_mises"], rtol=1e-9, atol=1.0)  # Pa
    first, second = (body.colours["von_mises"][-1].max() for body in both.bodies)
    assert second > 1.2 * first


def test_the_end_of_colours_is_ruled_by_area(spinning):
    motion = motion_of(spinning[-1], frames=5)
    ball = motion.bodies[0]
    assert ball.areas.sum() == pytest.approx(4 * np.pi * 0.01**2, rel=0.02)
    assert 0 < motion.end_of("speed") <= max(body.colours["speed"].max() for body in motion.bodies)
    nothing = motion_of(spinning[-1], colours=["contact_pressure"], frames=[0.0])
    assert nothing.end_of("contact_pressure") == 1.0


def test_what_is_refused(spinning):
    result = spinning[-1]
    with pytest.raises(InputError, match="frames: expected"):
        motion_of(result, frames=1)
    with pytest.raises(InputError, match="colours: expected"):
        motion_of(result, colours="speed")
    with pytest.raises(InputError, match="colours: expected"):
        motion_of(result, colours=["colour"])
    with pytest.raises(InputError, match="needs its FE model"):
        motion_of(result, colours=["von_mises"])
