"""A crank, a link and a sliding block from one STEP file: joints in their bores, and a round stop that the block hits.

`ep.read_step` names the solids before anything is meshed, `ep.fe_models` meshes them in place, and `cylinder=` finds
bores that have no name. A torque turns the crank from rest. Until the impact, work is the energy of rigid bodies.
"""

import argparse
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items

import exudyn_partition as ep
from models.crank_assembly import rigid_speed, write_results, write_step

PINS = {"shaft": (0.0, 0.0, 0.0), "crank pin": (0.05, 0.0, 0.0), "block pin": (0.2, 0.0, 0.0)}  # [m]
OF = {"crank": ("shaft", "crank pin"), "link": ("crank pin", "block pin"), "block": ("block pin",)}
NOSE, GAP, STOP, TORQUE = (0.18, 0.0, 0.018), 1e-3, 6e-3, 2.0  # [m], [m], radius [m], [N m]
HINGE, ALONG, SLIDE = [1, 1, 1, 1, 1, 0], [1, 1, 0, 0, 0, 0], [0, 1, 1, 1, 1, 1]  # axes that joints hold


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="coarse meshes")
    parser.add_argument("--out", type=Path, default=Path("out/assembly"))
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    machine = ep.read_step(write_step(options.out / "machine.step"), scale=1e-3)
    fine, maxh = (0.5e-3, 10e-3) if options.quick else (0.25e-3, 5e-3)
    maxh, refine = {"crank": maxh, "link": maxh, "block": maxh / 2}, [ep.Refine(NOSE, 1.5e-3, fine)]
    fems = ep.fe_models(machine, dict.fromkeys(OF, ep.STEEL), maxh=maxh, refine=refine)
    mbs, bodies, markers = exu.SystemContainer().AddSystem(), {}, {}
    for name, fem in fems.items():
        bores = [ep.Partition.interface(fem, pin, cylinder=(PINS[pin], (0, 0, 1), 0.004), position=PINS[pin])
                 for pin in OF[name]]  # fmt: skip
        more = ep.Partition.ball(fem, NOSE, 2e-3) if name == "block" else bores[-1]
        body = ep.reduce(fem, bores[0] if more is bores[0] else bores[0] | more, f_cut=20e3)
        frame = "inertial" if name == "block" else "floating"
        bodies[name] = ep.CreatePartitionBody(mbs, body, name=name, frame=frame)
        markers |= {(name, pin): bodies[name].CreateInterfaceMarker(mbs, pin) for pin in OF[name]}
    ground = mbs.AddObject(items.ObjectGround())
    for pin in ("shaft", "block pin"):
        markers["ground", pin] = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=PINS[pin]))
    for pin, one, other, axes in (
        ("shaft", "ground", "crank", HINGE), ("crank pin", "crank", "link", HINGE),
        ("block pin", "link", "block", ALONG), ("block pin", "ground", "block", SLIDE),
    ):  # fmt: skip
        mbs.AddObject(items.GenericJoint(markerNumbers=[markers[one, pin], markers[other, pin]], constrainedAxes=axes))
    mbs.AddLoad(items.Torque(markerNumber=markers["crank", "shaft"], loadVector=[0, 0, TORQUE]))
    stop = ep.RigidSphere(center=(NOSE[0] - GAP - STOP, 0, NOSE[2]), radius=STOP)
    contact = ep.CreatePartitionContact(mbs, bodies["block"], stop)
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=9e-3, step=2e-6 if not options.quick else 6e-6, method="implicit")
    return write_results(options.out, machine, fems, bodies, contact, run, rigid_speed(fems, TORQUE, GAP))


if __name__ == "__main__":
    main()
