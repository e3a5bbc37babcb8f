"""A plank that spins freely: 100 turns in explicit steps, and a comparison with Exudyn's own floating frame.

Reference: conservation, for a steel plank of three unequal moments of inertia at 300 rad/s about an axis that is no
principal axis. ObjectFFRFreducedOrder with all its terms on the same modes, both by Runge-Kutta's method of order four.
Quantity: change of angular momentum and energy, relative to their first values; relative L2 errors of angular velocity
and of modal coordinates over a third of a turn; run time of a step.
Limits: 1e-6 for conservation, 1e-4 for angular velocity, 1e-3 for modal coordinates, for every basis.

    python -m validation.joints.rotation
"""

import json
import sys
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import scipy.sparse as sp
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep

LIMITS = {"angular_momentum": 1e-6, "energy": 1e-6, "angular_velocity": 1e-4, "modal_coordinates": 1e-3}
SPIN = np.array([100.0, 200.0, 200.0])  # rad/s, 300 in all
TURN, TURNS = 2 * np.pi / 300, 100  # [s]
F_CUT = 10e3  # [Hz]
STEPS = {"contact-adapted": 2e-6, "residual": 2e-6, "craig-bampton": 1.25e-6, "free": 1.25e-6}  # [s]


def plank():
    """400 x 60 x 40 mm, with a patch at one end."""
    fem = ep.fe_model(occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.4, 0.06, 0.04)), ep.STEEL, maxh=0.03)
    return fem, ep.Partition.ball(fem, (0.4, 0.03, 0.02), 16e-3)


def spinning(body):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame="floating", initialAngularVelocity=SPIN)
    mbs.Assemble()
    return mbs, item


def conserved(body, step):
    """Largest changes of angular momentum and energy over 100 turns, and the time of a step."""
    mbs, item = spinning(body)
    result = ep.solve_dynamic(mbs, end_time=TURNS * TURN, step=step, sample_period=TURN / 100)
    momentum, energy = item.angular_momentum(result), item.energy(result)
    return {
        "angular_momentum": float(abs(momentum - momentum[0]).max() / np.linalg.norm(momentum[0])),
        "energy": float(abs(energy / energy[0] - 1).max()),
        "us_a_step": 1e6 * result.time_s / result.steps,
    }


def runge_kutta(mbs, step):
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = TURN / 3, round(TURN / 3 / step)
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = TURN / 100
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.RK44)
    return ep.collect(mbs)


def of_exudyn(fem, body):
    """Exudyn's own body on the shapes of ours, and sensors of its angular velocity and modal coordinates."""
    kinematics = spinning(body)[1].kinematics.at(np.arange(fem.n_nodes))
    mass = fem.mass if body.basis.mass == "consistent" else fem.lumped_mass_matrix
    model = FEMinterface()
    model.nodes["Position"] = fem.points - fem.centre_of_mass
    model.massMatrix, model.stiffnessMatrix = sp.csr_matrix(mass), sp.csr_matrix(fem.stiffness)
    model.modeBasis = {"matrix": np.array(kinematics.rows), "type": "NormalModes"}
    model.elements = [{"Name": "solid", "Tet4": fem.cells[:, :4]}]
    modes = ObjectFFRFreducedOrderInterface(model, rigidBodyNodeType=exu.NodeType.RotationRotationVector)
    mbs = exu.SystemContainer().AddSystem()
    nodes = modes.AddObjectFFRFreducedOrder(mbs, initialVelocity=[0, 0, 0], initialAngularVelocity=SPIN)
    sensors = [
        mbs.AddSensor(items.SensorNode(nodeNumber=nodes[key], outputVariableType=kind, storeInternal=True))
        for key, kind in (
            ("nRigidBody", exu.OutputVariableType.AngularVelocityLocal),
            ("nGenericODE2", exu.OutputVariableType.Coordinates),
        )
    ]
    mbs.Assemble()
    return mbs, sensors


def compared(fem, body, step):
    """Errors against Exudyn's floating frame."""
    theirs, sensors = of_exudyn(fem, body)
    reference = runge_kutta(theirs, step)
    mbs, item = spinning(body)
    result = runge_kutta(mbs, step)
    own = item.coordinates_t(result)[:, 3:6] @ item.kinematics.node_axes.T, item.coordinates(result)[:, 6:]
    expected = [reference.sensor(sensor) for sensor in sensors]
    errors = [float(np.linalg.norm(x - y) / np.linalg.norm(y)) for x, y in zip(own, expected, strict=True)]
    return dict(zip(("angular_velocity", "modal_coordinates"), errors, strict=True))


def main():
    fem, part = plank()
    cases = {}
    for basis, step in STEPS.items():
        body = ep.reduce(fem, part, basis=basis, f_cut=F_CUT)
        cases[basis] = {"dofs": body.n_dofs, "step_s": step, **conserved(body, step), **compared(fem, body, step)}
    head = ("basis", "dofs", "step", *LIMITS, "a step")
    rows = [
        (name, str(c["dofs"]), f"{1e6 * c['step_s']:g} us", *(f"{c[key]:.1e}" for key in LIMITS),
         f"{c['us_a_step']:.0f} us")
        for name, c in cases.items()
    ]  # fmt: skip
    table = Table(*head, title=f"free rotation, {TURNS} turns")
    for row in rows:
        table.add_row(*row)
    Console(width=120).print(table)
    found = {key: max(c[key] for c in cases.values()) for key in LIMITS}
    result = {"cases": cases, "limits": LIMITS, "found": found, "tables": {f"{TURNS} turns": (head, rows)},
              "versions": ep.versions()}  # fmt: skip
    Path(__file__).with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")
    failed = [key for key, limit in LIMITS.items() if found[key] > limit]
    sys.exit(f"beyond the stated limits: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
