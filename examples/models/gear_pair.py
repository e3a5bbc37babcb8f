"""Two spur gears on shafts, in Exudyn: the wheel's shaft is turned or free, that of the pinion bears a torque.

What to learn here: several pairs of teeth touch at once, take over from each other, and cross the backlash. One contact
finds them all. The gears are in gear_pair_parts.py; the pinion is at the origin, the wheel beside it along x.
"""

from collections.abc import Callable
from dataclasses import dataclass

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np

import exudyn_partition as ep

from .gear_pair_parts import play, poses, teeth_of

INERTIA, CLEARANCE = 1e-4, 0.5e-6  # of each shaft [kg m2]; between teeth at the start [m]
SETTLING, SETTLING_STEP = 5e-3, 1e-4  # [s]


@dataclass
class Work:
    """Torque on the pinion's shaft [N m], and turn and velocity of the wheel's [rad, rad/s], functions of time [s]."""

    torque: Callable = lambda t: 0.0
    turn: Callable | None = None  # None: the wheel's shaft is free
    begun: bool = True  # if not, time stands still


@dataclass
class Pair:
    """The assembled model, its contact, and the sensors of both shafts' turns."""

    mbs: object
    gears: tuple
    contact: object
    turns: tuple
    work: Work
    start: float  # gap of the upper flanks at the start [m]

    def way(self, result):
        """Way of the pinion into the wheel along the line of contact from where upper flanks touch, (n,) [m]."""
        turns = [result.sensor(turn)[:, 0] for turn in self.turns]
        return sum(gear.base * turn for gear, turn in zip(self.gears, turns, strict=True)) - self.start

    def tooth_forces(self, result, points):
        """Forces of the pinion's flanks, (n,) [N] by tooth and flank; `points` are its patch nodes."""
        forces, (tooth, upper), found = self.contact.row_forces(result), teeth_of(self.gears[0], points), {}
        for number in np.unique(tooth):
            for side, name in ((upper, "upper"), (~upper, "lower")):
                force = np.asarray(forces[:, np.flatnonzero(side & (tooth == number))].sum(axis=1)).ravel()
                if force.any():
                    found[f"tooth {number}, {name} flank"] = force
        return found

    def run(self, end_time, step, spectral_radius=0.5):
        """Implicit steps that damp what they do not resolve."""
        options = {"method": "implicit", "spectral_radius": spectral_radius}
        return ep.solve_dynamic(self.mbs, end_time=end_time, step=step, **options)

    def settle(self):
        """Come to rest under the torque at time 0, and begin there: long steps damp all motion."""
        self.work.begun = False
        result, data = self.run(SETTLING, SETTLING_STEP, spectral_radius=0.0), self.mbs.systemData
        data.SetSystemState(data.GetSystemState(), exu.ConfigurationType.Initial)
        self.work.begun = True
        return result


def rotation(angle):
    """Rotation about z, (3, 3)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def pair(bodies, gears, work, turn=0.0, side=1, spin=0.0, damping=0.0, frame="floating"):
    """The assembled pair, after a turn of the pinion [rad] from where its tooth 0 points at the wheel.

    Its upper (`side` = 1) or lower (-1) flanks are in touch, but for `CLEARANCE`. `spin` is its velocity [rad/s],
    `damping` that of its shaft's bearings [N m s]. In an "inertial" frame the mesh is turned, and turns must be small.
    """
    mbs, made, shafts, turns = exu.SystemContainer().AddSystem(), [], [], []
    way = side * (play() - CLEARANCE)
    for body, (angle, place), velocity in zip(bodies, poses(gears, turn, way), (spin, 0.0), strict=True):
        motion = {"referencePosition": place, "initialAngularVelocity": [0, 0, velocity], "frame": frame}
        if turns_along := frame == "floating":
            motion["referenceRotation"] = rotation(angle)
        made.append(ep.CreatePartitionBody(mbs, body, **motion))
        node = mbs.AddNode(items.Node1D(referenceCoordinates=[angle * turns_along], initialVelocities=[velocity]))
        shaft = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=node, inertia=INERTIA, referencePosition=place))
        if turns_along:
            ends = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=shaft)), made[-1].CreateInterfaceMarker(mbs, "bore")
            mbs.AddObject(items.GenericJoint(markerNumbers=[*ends], constrainedAxes=[1] * 6))
        else:  # the bore's motions are linear in the body's coordinates
            of_bore = items.MarkerObjectODE2Coordinates(objectNumber=made[-1]["oGenericODE2"])
            ends = mbs.AddMarker(items.MarkerNodeCoordinates(nodeNumber=node)), mbs.AddMarker(of_bore)
            scaling = {"scalingMarker0": np.eye(6)[:, 5:], "scalingMarker1": body.interface_rows("bore")}
            mbs.AddObject(items.ObjectConnectorCoordinateVector(markerNumbers=[*ends], **scaling))
        shafts.append(mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0)))
        kind = exu.OutputVariableType.Coordinates
        turns.append(mbs.AddSensor(items.SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True)))
    torque = {"load": 1.0, "loadUserFunction": lambda mbs, t, unused: float(work.torque(t * work.begun))}
    mbs.AddLoad(items.LoadCoordinate(markerNumber=shafts[0], **torque))
    ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    mbs.AddObject(items.CoordinateSpringDamper(markerNumbers=[ground, shafts[0]], stiffness=0, damping=damping))
    if work.turn is not None:
        mbs.AddObject(
            items.CoordinateConstraint(
                markerNumbers=[ground, shafts[1]],
                offsetUserFunction=lambda mbs, t, *unused: float(work.turn(t * work.begun)[0]),
                offsetUserFunction_t=lambda mbs, t, *unused: float(work.turn(t * work.begun)[1]) * work.begun,
            )
        )
    contact = ep.CreatePartitionContact(mbs, *made, passes="given", name="teeth")
    mbs.Assemble()
    return Pair(mbs, tuple(gears), contact, tuple(turns), work, play() - way)
