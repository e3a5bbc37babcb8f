"""Error against run time: the paper's steel rod on its aluminium plate, the example's coarser mesh, over 1.5 ms.

The mesh is coarse because bases whose patch has mass need steps of nanoseconds. ../rod_on_plate.py has the mesh of the
paper's size.
Reference: the full FE model of the same mesh, HHT. Its own error is what twice its step changes, and what a finer mesh
changes in the force of reduced bodies. Quantity: see measure.py. There are no limits here: ../pareto.py has them.

    python -m validation.error_against_time.rod_on_plate [--again]
"""

import math
from pathlib import Path

import exudyn_partition as ep
from examples.models import rod_on_plate as example
from validation.error_against_time import measure
from validation.error_against_time.measure import Setting
from validation.error_against_time.two_bodies import TwoBodies


def models(size=1.0, region=1.0):
    """Rod and plate; a `size` below one gives the paper's mesh size. `region` is of the smaller patch, the rod's."""
    fems, partitions, _ = example.fe_models(quick=size == 1.0)
    if region != 1.0:
        reach = 1.7 * ep.hertz.contact_radius(example.PEAK_FORCE, example.RADIUS, math.inf, ep.STEEL, ep.ALUMINIUM)
        partitions[0] = ep.Partition.ball(fems[0], (0, 0, 0), 1.5e-3, contact_radius=region * reach)
    return list(zip(fems, partitions, strict=True))


def main():
    options = measure.options(__doc__)
    radii = example.RADIUS, math.inf
    scene = TwoBodies("rod on plate", models, example.SPEED, 1.5e-3, 0.5e-6, (example.P1, example.P2), radii)
    record = measure.Record(scene, Path(__file__).with_suffix(".json"), options.again)
    record.full_models()
    record.mesh(Setting(f_cut=80e3))
    record.settings(
        [
            *(Setting(f_cut=f) for f in (2.5e3, 5e3, 10e3, 20e3, 40e3, 80e3, 120e3)),
            *(Setting(f_cut=40e3, step=step) for step in (0.5e-6, 0.25e-6)),
            *(Setting(f_cut=40e3, method="implicit", step=step) for step in (4e-6, 2e-6, 1e-6, 0.5e-6)),
            *(Setting(f_cut=40e3, region=x) for x in (0.8, 0.6)),
            Setting(f_cut=40e3, formulation="penalty"),
            Setting(f_cut=40e3, rows="node-to-segment"),
            *(Setting("residual", f) for f in (5e3, 10e3, 20e3, 40e3, 80e3)),
            *(Setting("craig-bampton", f) for f in (10e3, 20e3, 40e3)),
            *(Setting("free", f) for f in (10e3, 20e3, 40e3)),
        ]
    )
    record.tolerances((1e-1, 1e-2, 1e-3))
    record.own(modes=(8, 24), stiffness=(1e5, 4e5, 1.6e6), steps=(2e-6, 8e-6))
    record.add("full FE, explicit", "full FE", scene.explicit)
    measure.finish(record)


if __name__ == "__main__":
    main()
