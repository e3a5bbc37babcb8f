"""A cam that turns against the flat face of a spring-loaded follower, in Exudyn.

What to learn here: contact wanders over two whole faces, opens and closes. `ep.solve_static` finds the preloaded
equilibrium in which the run begins. The cam is an eccentric disc, held at its
bore by a shaft along z that speeds up; the follower moves along y in a guide. The parts are in cam_follower_parts.py.
"""

from dataclasses import dataclass

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np

import exudyn_partition as ep

from .cam_follower_parts import ECCENTRICITY, HEIGHT, RADIUS, Drive

STIFFNESS, PRELOAD = 2.5e4, 0.05  # of the spring [N/m], its compression at the least lift [m]
DAMPING = 20.0  # of the spring [N s/m]
CLEARANCE = 1e-7  # at the start [m]


@dataclass
class Mechanism:
    """The assembled model, its bodies, their contact and the drive."""

    mbs: object
    cam: dict
    follower: dict
    contact: object
    drive: Drive

    def rigid_force(self, t):
        """Contact force [N], (n,), of rigid bodies that never part: spring, damper and inertia of the follower."""
        turn, velocity, acceleration = self.drive.turn(t)
        angle = self.drive.start + turn
        rate = ECCENTRICITY * np.cos(angle) * velocity
        inertia = ECCENTRICITY * (np.cos(angle) * acceleration - np.sin(angle) * velocity**2)
        spring = STIFFNESS * (PRELOAD + ECCENTRICITY * (1 + np.sin(angle)))
        return spring + DAMPING * rate + self.follower.body.total_mass * inertia


def add_shaft(mbs, drive):
    """Add the shaft along z and what turns it; returns the number of its body."""
    node = mbs.AddNode(items.Node1D(referenceCoordinates=[drive.start]))
    shaft = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=node, inertia=1e-4))
    nodes = mbs.AddNode(items.NodePointGround()), node
    coordinates = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=number, coordinate=0)) for number in nodes]
    mbs.AddObject(
        items.CoordinateConstraint(
            markerNumbers=coordinates,
            offsetUserFunction=lambda mbs, t, *unused: float(drive.turn(t)[0]) if drive.turning else 0.0,
            offsetUserFunction_t=lambda mbs, t, *unused: float(drive.turn(t)[1]) if drive.turning else 0.0,
        )
    )
    return shaft


def add_follower(mbs, body, least):
    """Add the follower in its guide, with its spring; `least` is the height of its face at the least lift [m]."""
    follower = ep.CreatePartitionBody(mbs, body, name="follower", referencePosition=[0, least + CLEARANCE, 0])
    ground = mbs.AddObject(items.ObjectGround())
    guide, anchor = (
        mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=[0, y + HEIGHT, 0]))
        for y in (least + CLEARANCE, least)
    )
    back = follower.CreateInterfaceMarker(mbs, "back")
    mbs.AddObject(items.GenericJoint(markerNumbers=[guide, back], constrainedAxes=[1, 0, 1, 1, 1, 1]))
    along_y = {"stiffness": [0, STIFFNESS, 0], "damping": [0, DAMPING, 0]}
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[anchor, back], **along_y))
    # The spring's force at the least lift is a load of its own, which grows in the load steps of statics.
    mbs.AddLoad(items.Force(markerNumber=back, loadVector=[0, -STIFFNESS * PRELOAD, 0]))
    return follower


def mechanism(cam_body, follower_body, speed, ramp, friction=None):
    """The mechanism at rest, to be turned with `speed` [rad/s] after `ramp` [s], assembled."""
    mbs, drive = exu.SystemContainer().AddSystem(), Drive(speed, ramp)
    cos, sin = np.cos(drive.start), np.sin(drive.start)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    cam = ep.CreatePartitionBody(mbs, cam_body, name="cam", frame="floating", referenceRotation=turn)
    follower = add_follower(mbs, follower_body, RADIUS - ECCENTRICITY)
    on_shaft = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=add_shaft(mbs, drive)))
    bore = cam.CreateInterfaceMarker(mbs, "bore")
    mbs.AddObject(items.GenericJoint(markerNumbers=[on_shaft, bore], constrainedAxes=[1] * 6))
    contact = ep.CreatePartitionContact(mbs, cam, follower, friction=friction, name="cam and follower")
    mbs.Assemble()
    return Mechanism(mbs, cam, follower, contact, drive)


def lift_off_speed(mass):
    """Speed at which a rigid follower of a mass [kg] leaves the cam at its top [rad/s]."""
    return np.sqrt(STIFFNESS * (PRELOAD + 2 * ECCENTRICITY) / (mass * ECCENTRICITY))


def run(model, end_time, step, spectral_radius=0.5):
    """Press the follower on the cam, then turn it, by implicit steps that damp what they do not resolve."""
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    ep.solve_static(model.mbs, update_initial=True)  # the preloaded equilibrium is the initial state of the next run
    model.drive.turning = True
    return ep.solve_dynamic(
        model.mbs, end_time=end_time, method="implicit", step=step, spectral_radius=spectral_radius, settings=settings
    )
