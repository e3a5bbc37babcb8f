"""A crank slider strikes a block on a spring-damper (Wang, Liu, Hong 2018, section 6).

A rigid crank turns at constant speed. Through a flexible link it drives block 3 along a slide. Near the outer dead
centre, the spherical head of block 3 strikes the head of block 4, which a spring-damper holds. The model is
models/crank_slider.py with the parts of models/crank_slider_parts.py. This script runs it and compares the work of the
drive with the stored and the dissipated energy. Then it draws the paper's figures.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from models import crank_slider as model
from models import crank_slider_parts as parts
from models import crank_slider_results as results


def summary(mechanism, run, found, models):
    """Main numbers of the run, for result.json."""
    bodies = [item.body for item in (mechanism.link, *mechanism.blocks)]
    impacts = mechanism.contact.impacts(run)
    return {
        "status": run.status,
        "dofs": sum(body.n_dofs for body in bodies),
        "fe_dofs": sum(fem.n_dofs for fem, _ in models),
        "modes": [body.n_shapes - 6 for body in bodies],
        "contact_nodes": mechanism.contact.n_rows,
        "step_s": run.step,
        "steps": run.steps,
        "first_contact_s": impacts[0].start,
        "peak_force_N": float(found["force"].max()),
        "impacts": len(impacts),
        "contact_duration_s": sum(impact.end - impact.start for impact in impacts),
        "impulse_Ns": sum(impact.impulse for impact in impacts),
        "largest_torque_Nm": float(abs(found["torque"]).max()),
        "work_J": float(found["work"][-1]),
        "dissipated_J": float(found["dissipated"][-1]),
        "energy_error": results.imbalance(found),
        "left_out": [*bodies[1].left_out, *mechanism.contact.left_out],
        "versions": ep.versions(),
    }


def show(result):
    """Print the main numbers as a table."""
    table = Table(title=f"crank slider, {result['scheme']}: {result['dofs']} of {result['fe_dofs']} dofs")
    table.add_column("quantity")
    table.add_column("value")
    for key in ("steps", "impacts", "peak_force_N", "impulse_Ns", "largest_torque_Nm", "energy_error"):
        table.add_row(key, f"{result[key]:.5g}")
    for key, seconds in result["time"].items():
        table.add_row(key, f"{seconds:.3g}")
    Console().print(table)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scheme", default="contact-adapted", choices=[*model.SCHEMES])
    parser.add_argument("--f-cut", type=float, default=100e3, metavar="HZ", help="of the blocks; the link has 5 kHz")
    parser.add_argument("--step", type=float, default=2e-6, metavar="S", help="in contact")
    parser.add_argument("--quick", action="store_true", help="coarser meshes, 2.2 ms around the first impact")
    parser.add_argument("--out", type=Path, default=Path("out/crank_slider"), metavar="DIR")
    options = parser.parse_args(argv)
    mesh = parts.QUICK_MESH if options.quick else parts.FULL_MESH
    before, end_time = (0.2e-3, 2.2e-3) if options.quick else (parts.CONTACT_ANGLE / parts.SPEED, parts.TURN)
    if options.scheme == "paper":
        mesh, before, end_time = parts.PAPER_MESH, 20e-6, 0.4e-3
    basis = model.SCHEMES[options.scheme][0]

    clock = [time.perf_counter()]
    link, *blocks = models = [parts.link(), *(parts.block(number, *mesh) for number in (3, 4))]
    clock.append(time.perf_counter())
    link_body = ep.reduce(*link, f_cut=5e3)
    block_bodies = [ep.reduce(*block, basis=basis, f_cut=options.f_cut) for block in blocks]
    clock.append(time.perf_counter())
    angle = parts.CONTACT_ANGLE - before * parts.SPEED
    mechanism = model.mechanism(link_body, block_bodies, options.scheme, angle)
    run = model.run(mechanism, end_time, options.step, options.scheme)
    found = results.histories(mechanism, run)

    times = {"fem_s": clock[1] - clock[0], "reduce_s": clock[2] - clock[1], "online_s": run.time_s}
    result = {"scheme": options.scheme, "time": times, **summary(mechanism, run, found, models)}
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    np.savez_compressed(options.out / "histories.npz", **found)
    picture = options.out / "crank_slider.png"
    results.draw_histories(found).savefig(picture, dpi=150)
    results.draw_motion(found, mechanism.start).savefig(options.out / "mechanism.png", dpi=120)
    shown = [(item, fem) for item, (fem, _) in zip((mechanism.link, *mechanism.blocks), models, strict=True)]
    axes = ep.plot.bodies(run, bodies=shown, colour="von_mises", scale=1, direction=(0, -1, 0.3))
    heads = 1e3 * mechanism.start.heads[1] + np.array([-30, 30])
    axes.set(xlim=heads, ylim=(-15, 15), adjustable="box")
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    run.scene(options.out / "moving.html", title="crank-slider")
    show(result)
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
