"""Ratios of stiffness and mass of a million, Poisson's ratios at their bounds."""

import warnings

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
from exudyn.utilities import InertiaSphere

import exudyn_partition as ep
from exudyn_partition.errors import UnitsWarning
from validation.stability.cases.registry import QUIET, case
from validation.stability.scenes import (
    PLANE,
    RADIUS,
    Run,
    ball,
    ball_model,
    block,
    error,
    hertz,
    kept,
    strike,
)


def soft(factor):
    """Steel softened by a factor, and as light as a foam, because waves slower than in any solid would warn."""
    return ep.Material(E=210e9 * factor, nu=0.3, rho=2000.0)


@case("stiffness ratio 1e6, soft ball on steel", "Hertz 5 %")
def soft_ball(method):
    steps = {"step": 25e-6} if method == "implicit" else {}
    run = strike(method, ball(material=soft(1e-6)), block(), speed=1e-3, end_time=80e-3, sample_period=25e-6, **steps)
    both = run.bodies[0].body.total_mass * run.bodies[1].body.total_mass
    both /= sum(item.body.total_mass for item in run.bodies)
    return kept(run) | hertz(run, 1e-3, material=soft(1e-6), force=0.05, bounce=0, mass=both)


@case("stiffness ratio 1e6, steel ball on soft block", "momentum, energy, complementarity")
def soft_block(method):
    steps = {"step": 25e-6} if method == "implicit" else {}
    run = strike(method, ball(), block(soft(1e-6)), speed=1e-3, end_time=30e-3, sample_period=25e-6, **steps)
    return kept(run)


@case("mass ratio 1e6, light ball", "bounces off as from a wall, 2 %")
def light_ball(method):
    light = ep.Material(E=210e9, nu=0.3, rho=7800e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnitsWarning)  # nothing is so light but by a slip of units
        upper = ball(material=light)
    run = strike(method, upper, block(), speed=1e3, end_time=80e-9)
    after = ep.hertz.impact(run.bodies[0].body.total_mass, 1e3, RADIUS, np.inf, light, ep.STEEL)
    return kept(run) | {
        "peak force": error(run.force.max(), after.peak_force, 0.15),
        "speed after": error(run.velocity()[-1, 2], 1e3, 0.02),
    }


@case("mass ratio 1e6, plane carried by a rigid body", "Hertz 5 %, bounce 1e-3, momentum of both")
def heavy_carrier(method):
    mass, mbs = ball().total_mass, exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, ball(), name="upper", initialVelocity=[0, 0, -1.0])
    frame = mbs.CreateRigidBody(
        inertia=InertiaSphere(1e6 * mass, 1.0), nodeType=exu.NodeType.RotationRotationVector, returnDict=True
    )
    contact = ep.CreatePartitionContact(mbs, upper, PLANE, masterBody=frame["bodyNumber"])
    kind = exu.OutputVariableType.Velocity
    sensor = mbs.AddSensor(
        items.SensorNode(nodeNumber=frame["nodeNumber"], outputVariableType=kind, storeInternal=True)
    )
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, method=method, end_time=80e-6, **QUIET)
    run = Run(result, [upper], [contact], mass)
    momentum = upper.momentum(result)[:, 2] + 1e6 * mass * result.sensor(sensor)[:, 2]
    return {
        "not finite": (float(np.count_nonzero(~np.isfinite(momentum))), 0.0),
        "momentum": (float(abs(momentum - momentum[0]).max() / mass), 1e-6),
    } | hertz(run, 1.0, bounce=1e-3)


@case("nu 0.4999, quadratic elements", "Hertz 10 %")
def incompressible(method):
    material = ep.Material(E=210e9, nu=0.4999, rho=7800.0)
    run = strike(method, ball(material=material), end_time=80e-6)
    return kept(run) | hertz(run, 1.0, material=material, force=0.10, bounce=0.05)


@case("nu 0.4999, linear elements", "LockingError", methods=("explicit",), raises="LockingError", quick=True)
def locking(method):
    ball_model(material=ep.Material(E=210e9, nu=0.4999, rho=7800.0), order=1)


@case("nu -0.9", "Hertz 20 %: without much bulk modulus the whole ball yields too")
def auxetic(method):
    material = ep.Material(E=210e9, nu=-0.9, rho=7800.0)
    run = strike(method, ball(material=material), end_time=60e-6)
    return kept(run) | hertz(run, 1.0, material=material, force=0.20)
