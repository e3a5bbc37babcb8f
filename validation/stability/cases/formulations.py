"""Other formulations, rigid surfaces, joints and thin sheets."""

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ

import exudyn_partition as ep
from exudyn_partition.contact.formulations.penalty import bed_stiffness
from validation.stability.cases.registry import QUIET, case
from validation.stability.scenes import (
    RADIUS,
    Run,
    ball,
    block,
    error,
    finite,
    hertz,
    kept,
    penetration,
    strike,
)


@case("multipliers, nodes with mass", "Hertz 10 %, bounce 5 %, no penetration")
def multipliers(method):
    body = ball(h=0.03, basis="craig-bampton")
    run = strike(method, body, contact={"formulation": "lagrange"}, end_time=80e-6, sample_period=0.2e-6,
                 step=0.1e-6 if method == "implicit" else None)  # fmt: skip
    checks = kept(run, energy=0.05) | hertz(run, 1.0, force=0.1, bounce=0.05)
    return checks | {"penetration over dent": (penetration(run) / 18e-6, 1e-2)}


@case("penalty 1e4 times as stiff", "energy, momentum, bounce 5 %; the explicit step follows by itself; warns, rings",
      warns=("ModelLimitWarning",))  # fmt: skip
def stiff_penalty(method):
    layer = {"formulation": "penalty"}
    gaps = strike(method, ball(), contact=layer, end_time=1e-6).contacts[0].mechanics.gaps
    layer["stiffness"] = 1e4 * bed_stiffness(gaps)
    run = strike(method, ball(), contact=layer, end_time=80e-6, step=0.02e-6 if method == "implicit" else None)
    return kept(run, energy=0.02, momentum=0.02) | {"speed after": error(run.velocity()[-1, 2], 1.0, 0.05)}


@case("rigid sphere in a conforming hollow", "momentum, energy, complementarity", warns=("ModelLimitWarning",))
def rigid_sphere(method):
    run = strike(method, ball(), ep.RigidSphere((0, 0, -RADIUS / 100), RADIUS / 100), end_time=80e-6, speed=0.1)
    return kept(run)


@case("ball on a rigid cylinder 1e3 times thinner", "momentum, energy", warns=("ModelLimitWarning",))
def rigid_needle(method):
    needle = ep.RigidCylinder((0, 0, -1e-5), (1, 0, 0), 1e-5)
    return kept(strike(method, ball(), needle, end_time=80e-6, speed=0.01))


@case("hinged bar strikes a stop", "energy 2 %; the joint holds to 1e-5 of its length", warns=("ModelLimitWarning",))
def hinged(method):
    arm = occ.Box(occ.Pnt(0, -0.01, -0.01), occ.Pnt(0.2, 0.01, 0.01))
    arm.faces.Min(occ.X).name = "end"
    fem = ep.fe_model(arm, ep.STEEL, maxh=15e-3, refine=[ep.Refine((0.19, 0, -0.01), 2e-3, 1.5e-3)])
    tip = ep.Partition.ball(fem, (0.19, 0, -0.01), 4e-3)
    body = ep.reduce(fem, ep.Partition.interface(fem, "pin", nodes="end") | tip, f_cut=15e3)
    mbs = exu.SystemContainer().AddSystem()
    omega = 1.0
    centre = body.centre_of_mass
    item = ep.CreatePartitionBody(
        mbs, body, frame="floating", initialAngularVelocity=[0, omega, 0],
        initialVelocity=[0, 0, -omega * centre[0]],
    )  # fmt: skip
    pin = item.CreateInterfaceMarker(mbs, "pin")
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground, pin], constrainedAxes=[1, 1, 1, 1, 0, 1]))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidSphere((0.19, 0, -0.02 - 1e-5), 0.01), slavePatch=0)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-3, step=1e-6, method=method, **QUIET)
    run = Run(result, [item], [contact], 1.0)
    end = item.displacement(result, (0, 0, 0))
    return {
        "unfinished": (float(result.status != "finished"), 0.0),
        "not finite": (finite(run), 0.0),
        "force": (float(run.force.max() <= 0), 0.0),
        "pulling": (float(-run.force.min()), 0.0),
        "energy": (float(abs(run.energy / run.energy[0] - 1).max()), 0.02),
        "hinge over length": (float(abs(end).max() / 0.2), 1e-5),
    }


@case("ball slides off its patch", "warns that the contact left its patch", warns=("ContactPatchWarning",))
def slides_off(method):
    across = {"initialVelocity": [50.0, 0, -1.0]}
    body = block()
    run = strike(method, ball(), body, body=across, contact={"passes": "given"}, end_time=60e-6)
    return {"not finite": (finite(run), 0.0), "unfinished": (float(run.result.status != "finished"), 0.0)}


def ball_on_sheet(method, thickness, width, maxh):
    """Elements are as long as the sheet's bending waves up to f_cut allow."""
    shape = occ.Box(occ.Pnt(-0.05, -width / 2, -thickness), occ.Pnt(0.05, width / 2, 0))
    fine = ep.Refine((0, 0, 0), 1.2e-3, 0.3e-3)
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=maxh, refine=[fine], grading=0.7)
    target = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.2e-3, direction=(0, 0, 1)), f_cut=20e3)
    return kept(strike(method, ball(), target, speed=0.1, end_time=200e-6))


@case("thin sheet, 1:100", "momentum, energy, complementarity; warns of ringing", warns=("ModelLimitWarning",))
def sheet(method):
    return ball_on_sheet(method, 1e-3, 0.1, 4e-3)


@case("thin strip, 1:1000", "momentum, energy, complementarity; warns of a contact of one row, and of long elements",
      warns=("MeshQualityWarning", "ModelLimitWarning"))  # fmt: skip
def strip(method):
    return ball_on_sheet(method, 1e-4, 5e-3, 0.8e-3)


@case("thin sheet, 1:1000, coarse", "FrequencyRangeError: its elements bend with no wave; warns of these",
      methods=("explicit",), raises="FrequencyRangeError", warns=("MeshQualityWarning",))  # fmt: skip
def coarse_sheet(method):
    ball_on_sheet(method, 1e-4, 0.1, 10e-3)


@case("one basis for two formulations", "InputError", methods=("explicit",), raises="InputError", quick=True)
def wrong_formulation(method):
    strike(method, ball(), contact={"formulation": "lagrange"}, end_time=1e-6)


@case("run of less than a step", "one step, nothing lost", quick=True)
def short_run(method):
    run = strike(method, ball(), end_time=1e-12)
    return {"not finite": (finite(run), 0.0), "steps": (float(abs(run.result.steps - 1)), 0.0)} | kept(run)
