"""A radial bearing of 12 balls in Exudyn: shaft, balls in a cage, outer race.

What to learn here: one reduced ball is used 12 times; its floating frames turn with the cage. Races are rigid
cylinders, and the shaft carries its own. Joints hold the balls in their pockets, free along the radius.
"""

from dataclasses import dataclass

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

BALLS, RADIUS, PITCH = 12, 5e-3, 20e-3  # number, radius, and radius of the circle of their centres [m]
STEEL, F_CUT = ep.STEEL, 250e3  # the balls' first mode is at 260 kHz
MASS, SOFT, DAMPING = 0.5, 1e5, 200.0  # of the shaft [kg]; springs of pockets and shaft [N/m], [N s/m]


@dataclass
class Bearing:
    """The assembled model: balls and their contacts on shaft and outer race, the place of the shaft, the cage."""

    mbs: object
    balls: list
    inner: list
    outer: list
    place: object
    angles: np.ndarray
    turn: object


def ball_part(h, patch):
    """FE model of a ball with a patch at either pole along x, and the ring of its equator for the joint."""
    fine = [ep.Refine((x, 0, 0), patch, h) for x in (-RADIUS, RADIUS)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), RADIUS), STEEL, maxh=RADIUS / 2.5, refine=fine)
    poles = [
        ep.Partition.ball(fem, (x, 0, 0), patch, direction=(x, 0, 0), name=name)
        for name, x in (("inner", -RADIUS), ("outer", RADIUS))
    ]
    belt = np.unique(fem.facets[abs(fem.points[fem.facets].mean(axis=1)[:, 0]) < 0.2 * RADIUS])
    return fem, poles[0] | poles[1] | ep.Partition.interface(fem, "belt", belt, position=(0, 0, 0), kind="averaged")


def turned(angle):
    """Rotation about z."""
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])


class Turn:
    """Angle of the cage [rad]: it speeds up within a time [s], to a speed [rad/s], once it is switched on."""

    def __init__(self, speed, rise):
        self.speed, self.rise, self.on = speed, rise, False

    def __call__(self, t):
        """Return the angle at a time [s]."""
        if not self.on:
            return 0.0
        return self.speed * (t**2 / (2 * self.rise) if t < self.rise else t - self.rise / 2)


def bearing(body, load, clearance, turn, first=0.0):
    """The bearing, assembled; `load` [N] along -y on the shaft, the cage's `turn` over time, place of a ball [rad]."""
    mbs, angles = exu.SystemContainer().AddSystem(), 2 * np.pi * np.arange(BALLS) / BALLS - np.pi / 2 + first
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround())))
    node = mbs.AddNode(items.NodeRigidBodyRotVecLG(referenceCoordinates=[0] * 6))
    inertia = [MASS * PITCH**2] * 3 + [0] * 3
    shaft = mbs.AddObject(items.ObjectRigidBody(nodeNumber=node, mass=MASS, inertia=inertia))
    on_shaft = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=shaft))
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground, on_shaft], constrainedAxes=[0, 0, 1, 1, 1, 1]))
    soft = {"stiffness": [SOFT] * 3, "damping": [DAMPING] * 3}
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[ground, on_shaft], **soft))
    mbs.AddLoad(items.Force(markerNumber=on_shaft, loadVector=[0, -load, 0]))

    wheel = mbs.AddNode(items.Node1D(referenceCoordinates=[0.0]))
    cage = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=wheel, inertia=1e-5))
    coordinates = [
        mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=number, coordinate=0))
        for number in (mbs.AddNode(items.NodePointGround()), wheel)
    ]
    mbs.AddObject(
        items.CoordinateConstraint(markerNumbers=coordinates, offsetUserFunction=lambda mbs, t, *unused: turn(t))
    )
    inner = ep.RigidCylinder((0, 0, 0), (0, 0, 1), PITCH - RADIUS - clearance / 4)
    outer = ep.RigidCylinder((0, 0, 0), (0, 0, 1), PITCH + RADIUS + clearance / 4, hollow=True)
    place = mbs.AddSensor(
        items.SensorBody(bodyNumber=shaft, outputVariableType=exu.OutputVariableType.Displacement, storeInternal=True)
    )
    result = Bearing(mbs, [], [], [], place, angles, turn)
    for i, phi in enumerate(angles):
        place = PITCH * np.array([np.cos(phi), np.sin(phi), 0])
        ball = ep.CreatePartitionBody(
            mbs, body, name=f"ball {i}", frame="floating", referencePosition=place, referenceRotation=turned(phi)
        )
        belt = ball.CreateInterfaceMarker(mbs, "belt")
        pocket = mbs.AddMarker(
            items.MarkerBodyRigid(bodyNumber=cage, localHT=exu.HT(rotation=turned(phi), translation=place))
        )
        mbs.AddObject(items.GenericJoint(markerNumbers=[pocket, belt], constrainedAxes=[0, 1, 1, 1, 1, 1]))
        mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[pocket, belt], **soft))
        result.balls.append(ball)
        result.inner.append(ep.CreatePartitionContact(mbs, ball, inner, slavePatch="inner", masterBody=shaft))
        result.outer.append(ep.CreatePartitionContact(mbs, ball, outer, slavePatch="outer"))
    mbs.Assemble()
    return result


def run(model, end_time, step):
    """Press the shaft on the balls, then turn the cage; histories of both."""
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    pressed = ep.solve_static(model.mbs, load_steps=4, update_initial=True)
    model.turn.on = True
    moving = ep.solve_dynamic(
        model.mbs, end_time=end_time, method="implicit", step=step, spectral_radius=0.5, settings=settings
    )
    return pressed, moving
