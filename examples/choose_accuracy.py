"""How fine does a body have to be? Ask for a tolerance, and see whether it is kept.

A steel ball hits an aluminium plate. Because of the plate's bending waves there is no simple formula for this impact.
`reduce_pair` computes the impact of the two bodies while their bases grow. It stops when the estimated error is the
wanted one. Here each estimate is compared with the full FE model of the same meshes. The estimate is for the force and
for the whole velocity field. The velocity of a single point near the contact, which is printed too, can have a larger
error.
"""

import argparse
import json
import time
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ

import exudyn_partition as ep

R, SIDE, THICKNESS, SPEED = 0.008, 0.12, 0.006, 0.5  # [m], [m/s]


def fe_models(h, maxh):
    """FE models of ball and plate with their partitions; they touch at the origin."""
    fine = [ep.Refine((0, 0, 0), 0.5e-3, h)]
    ball = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), ep.STEEL, maxh=R / 3, refine=fine)
    box = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, -THICKNESS), occ.Pnt(SIDE / 2, SIDE / 2, 0))
    plate = ep.fe_model(box, ep.ALUMINIUM, maxh=maxh, refine=fine)
    return (ball, ep.Partition.ball(ball, (0, 0, 0), 0.7e-3)), (plate, ep.Partition.ball(plate, (0, 0, 0), 0.9e-3))


def collide(bodies, fem, end_time):
    """History of an impact of two reduced bodies in Exudyn; `fem` is the plate's, whose back is near the contact."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], name="ball", initialVelocity=[0, 0, -SPEED])
    plate = ep.CreatePartitionBody(mbs, bodies[1], name="plate")
    contact = ep.CreatePartitionContact(mbs, ball, plate, passes="given")  # the same slave as in the reference
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=end_time)
    return run.history(contact, {"back of the plate": (plate, (0, 0, -THICKNESS), fem)})


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser meshes, two tolerances, a shorter time")
    parser.add_argument("--out", type=Path, default=Path("out/choose_accuracy"), metavar="DIR")
    options = parser.parse_args(argv)
    h, maxh, end_time = (0.25e-3, 16e-3, 0.1e-3) if options.quick else (0.12e-3, 6e-3, 0.4e-3)

    begin = time.perf_counter()
    models = fe_models(h, maxh)
    fem_s = time.perf_counter() - begin
    full = [ep.reference.FullBody(*models[0], velocity=(0, 0, -SPEED)), ep.reference.FullBody(*models[1])]
    with ep.progress("full FE reference") as progress:
        reference = ep.reference.simulate(
            full,
            end_time=end_time,
            step=0.5e-6,
            points={"back of the plate": (1, (0, 0, -THICKNESS))},
            progress=progress,
        )

    runs, comparisons = [], {}
    for tolerance in (0.1, 0.01) if options.quick else (0.1, 0.03, 0.01, 0.003):  # half a minute each
        bodies = ep.reduce_pair(*models, tolerance=tolerance, speed=SPEED, duration=end_time)
        estimate, label = bodies[0].estimate, f"tolerance {tolerance:g}"
        history = collide(bodies, models[1][0], end_time)
        comparisons[label] = ep.compare(history, reference)
        runs.append(
            {
                "tolerance": tolerance,
                "estimated": {"force": estimate.force, "velocity": estimate.velocity},
                "true": comparisons[label].error,
                "f_cut_Hz": estimate.f_cut,
                "dofs": sum(body.n_dofs for body in bodies),
                "reduce_s": sum(body.reduce_s for body in bodies),
                "online_s": history.info["time_s"],
            }
        )
        print(f"{label}: {json.dumps(runs[-1], indent=1)}")

    result = {
        "fe_dofs": sum(fem.n_dofs for fem, _ in models),
        "dofs": runs[-1]["dofs"],
        "step_s": history.info["step_s"],
        "steps": history.info["steps"],
        "time": {"fem_s": fem_s, "reference_s": reference.info["time_s"]}
        | {k: runs[-1][k] for k in ("reduce_s", "online_s")},
        "error": runs[-1]["true"],
        "peak_force_N": history.peak_force,
        "runs": runs,
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))

    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    ep.plot.force(axes[0], history, reference)
    wanted = [run["tolerance"] for run in runs]
    axes[1].loglog(wanted, wanted, "k--", label="asked for")
    axes[1].loglog(wanted, [run["estimated"]["force"] for run in runs], "o-", label="estimated")
    axes[1].loglog(wanted, [run["true"]["force"] for run in runs], "s-", label="true")
    axes[1].set(xlabel="tolerance", ylabel="relative error of the force")
    axes[1].grid(alpha=0.3)
    axes[1].legend()
    ep.plot.pareto(axes[2], comparisons)
    picture = options.out / "choose_accuracy.png"
    figure.savefig(picture, dpi=150)
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
