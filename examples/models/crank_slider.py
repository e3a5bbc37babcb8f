"""The crank slider as a mechanism in Exudyn: crank, drive, joints, spring-damper, contact, and how it is run.

What to learn here: a reduced body that turns has a floating frame, and one that slides has an inertial frame. Its
interfaces give markers. Exudyn's own joints and springs are attached to these as to the markers of any other body.
"""

from dataclasses import dataclass

import exudyn as exu
import exudyn.itemInterface as items

import exudyn_partition as ep

from .crank_slider_parts import CONTACT_ANGLE, CRANK, CRANK_MASS, DAMPING, LENGTHS, SPEED, STIFFNESS, Start

SCHEMES = {  # basis of the blocks, formulation and rows of their contact
    "contact-adapted": ("contact-adapted", "compliance", "integrated"),
    "paper": ("free", "lagrange", "node-to-segment"),  # explicit, because its nodes have mass: the first impact alone
}


@dataclass
class Mechanism:
    """The assembled model, its bodies, the sensor of the drive, and where it starts."""

    mbs: object
    link: dict
    blocks: list
    contact: object
    drive: object
    start: Start


def connect(mbs, start, pins, backs):
    """Add crank, drive, joints and spring-damper to the markers of link and blocks; returns the drive's sensor."""
    crank_node = mbs.AddNode(items.Node1D(referenceCoordinates=[start.angle], initialVelocities=[SPEED]))
    crank = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=crank_node, inertia=CRANK_MASS * CRANK**2 / 3))
    ground = mbs.AddObject(items.ObjectGround())

    def on(body, x):
        return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[x, 0, 0]))

    slides = [on(ground, start.place), on(ground, start.heads[1] + LENGTHS[1])]
    mbs.AddObject(items.GenericJoint(markerNumbers=[on(crank, -CRANK), pins[0]], constrainedAxes=[1, 1, 1, 1, 1, 0]))
    mbs.AddObject(items.GenericJoint(markerNumbers=[backs[0], pins[1]], constrainedAxes=[1, 1, 0, 0, 0, 0]))
    for slide, back in zip(slides, backs, strict=True):
        mbs.AddObject(items.GenericJoint(markerNumbers=[slide, back], constrainedAxes=[0, 1, 1, 1, 1, 1]))
    along_x = {"stiffness": [STIFFNESS, 0, 0], "damping": [DAMPING, 0, 0]}
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[slides[1], backs[1]], **along_x))
    nodes = mbs.AddNode(items.NodePointGround()), crank_node
    axes = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0)) for node in nodes]
    drive = mbs.AddObject(
        items.CoordinateConstraint(
            markerNumbers=axes,
            offsetUserFunction=lambda mbs, t, *unused: SPEED * t,
            offsetUserFunction_t=lambda mbs, t, *unused: SPEED,
        )
    )
    force = exu.OutputVariableType.Force
    return mbs.AddSensor(items.SensorObject(objectNumber=drive, outputVariableType=force, storeInternal=True))


def add_link(mbs, body, start):
    """Add the link, which turns; returns it and the markers of its pins."""
    rod = ep.CreatePartitionBody(
        mbs,
        body,
        name="link",
        frame="floating",
        referencePosition=start.centre,
        referenceRotation=start.axes,
        initialVelocity=start.velocity,
        initialAngularVelocity=start.turning,
    )
    return rod, [rod.CreateInterfaceMarker(mbs, name) for name in ("crank pin", "slider pin")]


def mechanism(link_body, block_bodies, scheme="contact-adapted", angle=0.0, contact_angle=CONTACT_ANGLE):
    """The mechanism with the crank at `angle` [rad], assembled."""
    mbs, start = exu.SystemContainer().AddSystem(), Start(angle, contact_angle)
    rod, pins = add_link(mbs, link_body, start)
    blocks = [
        ep.CreatePartitionBody(
            mbs, body, name=f"block {number}", referencePosition=[head, 0, 0], initialVelocity=[speed, 0, 0]
        )
        for body, number, head, speed in zip(block_bodies, (3, 4), start.heads, (start.speed, 0.0), strict=True)
    ]
    drive = connect(mbs, start, pins, [item.CreateInterfaceMarker(mbs, "back") for item in blocks])
    _, formulation, rows = SCHEMES[scheme]
    contact = ep.CreatePartitionContact(mbs, *blocks, formulation=formulation, rows=rows, name="heads")
    mbs.Assemble()
    return Mechanism(mbs, rod, blocks, contact, drive, start)


def run(model, end_time, step, scheme="contact-adapted", free_step=2e-4, velocity_tolerance=None):
    """Run implicit steps, long in free flight and short in the impact; the paper's scheme runs central differences."""
    if scheme == "paper":
        step = 0.5 * ep.stability_limit(model.mbs)
        return ep.solve_dynamic(model.mbs, end_time=end_time, step=step, sample_period=1e-6)
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    newton = settings.timeIntegration.newton
    newton.absoluteTolerance, newton.relativeTolerance = 1e-8, 1e-5  # forces do not change, iterations are saved
    newton.modifiedNewtonContractivity = 0.02  # a new Jacobian takes less time than more iterations with an old one
    newton.numericalDifferentiation.jacobianConnectorDerivative = False  # a small part of it, which takes most time
    # Undamped vibration after the impact has less than 1 % of the energy. Without contact it is not resolved.
    adaptive = {"adaptive": True, "free_step": free_step, "unresolved": 1e-2, "velocity_tolerance": velocity_tolerance}
    return ep.solve_dynamic(model.mbs, end_time=end_time, step=step, method="implicit", settings=settings, **adaptive)
