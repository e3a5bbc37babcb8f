"""Friction in motion, against rigid-body mechanics: slope, belt, turning drum, a ball that begins to roll, and spin.

Slope: a block slides down 30 degrees at g (sin - mu cos), at full size, a tenth and a hundredth of it.

Belt: a block on a belt of speed v, held by a spring k. It sticks until the spring pulls with the static friction, then
slips back with the kinetic one. With normal force N and circular frequency w, the period is

    2/w (pi - arctan((mu_s - mu_k) N w / (k v))) + 2 (mu_s - mu_k) N / (k v).

An elastic block slips by nanometres at its edges long before it slides. The coefficient therefore falls over a slip
speed that is a thousandth of the belt's. Without it, `decay`, rows that slip so little already have the kinetic one.

Rolling: a solid ball that starts to slide at v0 rolls after 2 v0 / (7 mu g), with 5/7 of its speed. It bounces on its
patch, so the time is where the straight lines through the speeds before and after meet.

Drum: a turning drum spins up a ball on top of it, which a spring holds. The ball rolls after 2 v / (5 mu g), with v the
speed of the drum's surface. A damper bears some of the weight at first, so the time follows from the later rate.

Spin: a ball hits a plane at an angle. Its spin is the moment of the tangential impulse about its centre.

Limit: 0.5 % each.

    python -m validation.friction.motion
"""

import argparse
import time

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from exudyn.utilities import InertiaCuboid
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes

GRAVITY, SLOPE, MU = 9.81, np.radians(30.0), 0.3  # m/s2, rad
EDGE, HEIGHT = 20e-3, 10e-3  # of the block at full size [m]
RADIUS, ROLLS_FROM, PRESSED = 10e-3, 0.5, 100 * GRAVITY  # of the ball [m], its speed [m/s], what presses it [m/s2]
STATIC, KINETIC, BELT, SPRING = 0.4, 0.25, 0.05, 50.0  # belt [m/s], spring [N/m]
DECAY = BELT / 1000  # slip speed of the falling coefficient [m/s]
DRUM, HELD = 50e-3, 1e7  # radius of the drum [m], spring that holds the ball's centre [N/m]
MATERIAL = ep.Material(E=ep.STEEL.E, nu=ep.STEEL.nu, rho=ep.STEEL.rho)
LIMIT = 0.005


def block(scale=1.0):
    """A block that stands on the whole of its lower face, z = 0."""
    a, h = scale * EDGE / 2, scale * HEIGHT
    fem = ep.fe_model(occ.Box(occ.Pnt(-a, -a, 0), occ.Pnt(a, a, h)), MATERIAL, maxh=scale * 10e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), 1.6 * a, direction=(0, 0, -1), axes="xyz")
    return ep.reduce(fem, part, f_cut=60e3 / scale)


def moving_belt(mbs, speed):
    """A rigid body that a guide and a drive move along x at a speed [m/s]."""
    # A belt so heavy that nothing stops it would need no drive. But its mass times the rounding of its acceleration is
    # a residual, below which Newton's method cannot get.
    belt_ = mbs.CreateRigidBody(inertia=InertiaCuboid(1000, [0.1, 0.1, 0.1]), initialVelocity=[speed, 0, 0])
    ground = mbs.CreateGround()
    mbs.CreatePrismaticJoint(bodyNumbers=[ground, belt_], position=[0, 0, 0], axis=[1, 0, 0])
    nodes = mbs.AddNode(items.NodePointGround()), mbs.GetObjectParameter(belt_, "nodeNumber")
    markers = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0)) for node in nodes]
    mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=markers, offset=speed, velocityLevel=True))
    return belt_


def slope(scale, steps=600):
    """Relative error of the acceleration of a sliding block."""
    mbs = exu.SystemContainer().AddSystem()
    gravity = GRAVITY * np.array([np.sin(SLOPE), 0, -np.cos(SLOPE)])
    item = ep.CreatePartitionBody(mbs, block(scale), gravity=gravity)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=MU)
    mbs.Assemble()
    end = 0.03 * np.sqrt(scale)  # so that it slides by about its own height
    result = ep.solve_dynamic(mbs, end_time=end, method="implicit", step=end / steps, spectral_radius=0.5)
    speed = item.momentum(result)[:, 0] / item.body.total_mass
    settled = result.t > 0.2 * end
    found = np.polyfit(result.t[settled], speed[settled], 1)[0]
    expected = GRAVITY * (np.sin(SLOPE) - MU * np.cos(SLOPE))
    assert contact.closed_rows(result)[-1] > 0
    return abs(found / expected - 1)


def belt(cycles=3, steps=3000):
    """Relative error of the period of a block on a belt, found and expected periods [s]."""
    mbs = exu.SystemContainer().AddSystem()
    body = block()
    item = ep.CreatePartitionBody(mbs, body, gravity=[0, 0, -GRAVITY], initialVelocity=[BELT, 0, 0])
    mass = body.total_mass
    normal, omega = mass * GRAVITY, np.sqrt(SPRING / mass)
    drop = (STATIC - KINETIC) * normal
    expected = 2 / omega * (np.pi - np.arctan(drop * omega / (SPRING * BELT))) + 2 * drop / (SPRING * BELT)
    carrier = moving_belt(mbs, BELT)
    friction = ep.Coulomb(static=STATIC, kinetic=KINETIC, decay=DECAY)
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), masterBody=carrier, friction=friction)
    marker = item.CreatePointMarker(mbs, [0, 0, HEIGHT / 2])
    ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, HEIGHT / 2]))
    mbs.AddObject(items.ObjectConnectorCartesianSpringDamper(markerNumbers=[ground, marker], stiffness=[SPRING, 0, 0]))
    mbs.Assemble()
    end = (cycles + 1) * expected
    result = ep.solve_dynamic(mbs, end_time=end, method="implicit", step=end / steps, spectral_radius=0.5)
    sliding = 1 - item.momentum(result)[:, 0] / (mass * BELT) - 0.1  # crosses zero soon after the block lets go
    last = np.flatnonzero((sliding[:-1] < 0) & (sliding[1:] >= 0))
    begins = result.t[last] + np.diff(result.t)[last] * sliding[last] / (sliding[last] - sliding[last + 1])
    found = np.diff(begins).mean()
    return abs(found / expected - 1), found, expected


def ball():
    """A ball on its south pole."""
    shape = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    fem = ep.fe_model(shape, MATERIAL, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 0.4e-3, 0.12e-3)])
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 0.5e-3, axes="xyz"), f_cut=150e3)


def rolling(body, mu=0.2, steps=600):
    """Relative errors of the time until it rolls, and of its speed then."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, body, gravity=[0, 0, -PRESSED], initialVelocity=[ROLLS_FROM, 0, 0], frame="floating"
    )
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=mu)
    mbs.Assemble()
    expected = 2 * ROLLS_FROM / (7 * mu * PRESSED)
    end = 1.6 * expected
    result = ep.solve_dynamic(mbs, end_time=end, method="implicit", step=end / steps, spectral_radius=0.5)
    t, speed = result.t, item.momentum(result)[:, 0] / body.total_mass
    slides, rolls = (t > 0.1 * expected) & (t < 0.9 * expected), t > 1.2 * expected
    slope_, start = np.polyfit(t[slides], speed[slides], 1)
    final = speed[rolls].mean()
    return abs((final - start) / slope_ / expected - 1), abs(final / (5 / 7 * ROLLS_FROM) - 1)


def spin(body, mu=0.5, speed=0.3, along=0.2):
    """Relative error of the spin by the moment of the tangential impulse."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, body, referencePosition=[0, 0, 1e-6], initialVelocity=[along, 0, -speed], frame="floating"
    )
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=mu)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=80e-6)
    q = item.coordinates(result)
    centre = np.array([0, 0, RADIUS]) + q[-1, :3]
    gained = item.angular_momentum(result, centre)[-1, 1]
    expected = -RADIUS * np.trapezoid(contact.friction.tangential_force(result)[:, 0], result.t)
    return abs(gained / expected - 1)


def drum(body, mu=0.2, steps=600):
    """Relative errors of the time in which a turning drum spins up a ball that a spring holds, and of its spin then."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, gravity=[0, 0, -PRESSED], frame="floating")
    turn = ROLLS_FROM / DRUM
    wheel = mbs.CreateRigidBody(
        inertia=InertiaCuboid(7850, [0.5, 0.5, 0.5]),  # so heavy that the ball neither stops nor moves it
        referencePosition=[0, 0, -DRUM],
        initialAngularVelocity=[0, turn, 0],
    )
    surface = ep.RigidCylinder([0, 0, 0], [0, 1, 0], DRUM)
    ep.CreatePartitionContact(mbs, item, surface, masterBody=wheel, friction=mu)
    centre = [0, 0, RADIUS]
    marker = item.CreatePointMarker(mbs, centre)
    ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateGround(), localPosition=centre))
    root = np.sqrt(HELD * body.total_mass)
    spring = {"stiffness": [HELD, HELD, 0], "damping": [1.4 * root, 1.4 * root, 0.3 * root]}
    mbs.AddObject(items.ObjectConnectorCartesianSpringDamper(markerNumbers=[ground, marker], **spring))
    mbs.Assemble()
    expected = 2 * ROLLS_FROM / (5 * mu * PRESSED)
    end = 1.6 * expected
    result = ep.solve_dynamic(mbs, end_time=end, method="implicit", step=end / steps, spectral_radius=0.5)
    t, turning = result.t, item.coordinates_t(result)[:, 4]
    slides, rolls = (t > 0.2 * expected) & (t < 0.9 * expected), t > 1.2 * expected
    rate, final = np.polyfit(t[slides], turning[slides], 1)[0], turning[rolls].mean()
    return abs(final / rate / expected - 1), abs(final / (-ROLLS_FROM / RADIUS) - 1)


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    begin, body = time.perf_counter(), ball()
    found = {f"slope_{scale:g}": slope(scale) for scale in (1.0, 0.1, 0.01)}
    found["belt"], *periods = belt()
    found["rolls_after"], found["rolls_at"] = rolling(body)
    found["spin"] = spin(body)
    found["drum_after"], found["drum_at"] = drum(body)
    Console(width=150).print(found)
    result = {
        "found": {key: float(value) for key, value in found.items()},
        "limits": dict.fromkeys(found, LIMIT),
        "belt_period_s": dict(zip(("found", "expected"), map(float, periods), strict=True)),
        "time_s": time.perf_counter() - begin,
    }
    scenes.finish(__file__, result, [f"{key} {error:.3g}" for key, error in found.items() if error > LIMIT])


if __name__ == "__main__":
    main()
