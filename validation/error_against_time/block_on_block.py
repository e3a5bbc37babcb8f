"""Error against run time: two steel cylinders with spherical heads, as in the crank slider, one at rest.

Reference: the full FE model of the same mesh, HHT. Its own error is what twice its step changes, and what a finer mesh
changes in the force of reduced bodies. Quantity: see measure.py. There are no limits here: ../pareto.py has them.

    python -m validation.error_against_time.block_on_block [--again]
"""

from pathlib import Path

import netgen.occ as occ

import exudyn_partition as ep
from validation.error_against_time import measure
from validation.error_against_time.measure import Setting
from validation.error_against_time.two_bodies import TwoBodies

R, LENGTHS, H = 0.010, (0.071, 0.058), 0.16e-3  # radius, lengths, elements at the contact [m]


def models(size=1.0, region=1.0):
    """The upper and the lower block, touching at the origin."""
    found = []
    for length, sign, reach in zip(LENGTHS, (1, -1), (0.6e-3, 0.75e-3), strict=True):
        shape = occ.Cylinder(occ.Pnt(0, 0, R if sign > 0 else -length), occ.Z, r=R, h=length - R)
        shape += occ.Sphere(occ.Pnt(0, 0, sign * R), R)
        refined = [ep.Refine((0, 0, 0), 0.5e-3, size * H)]
        fem = ep.fe_model(shape, ep.STEEL, maxh=size * 5e-3, refine=refined, grading=0.5)
        found.append((fem, ep.Partition.ball(fem, (0, 0, 0), region * reach)))
    return found


def main():
    options = measure.options(__doc__)
    far_ends = (0, 0, LENGTHS[0]), (0, 0, -LENGTHS[1])
    scene = TwoBodies("block on block", models, 1.0, 400e-6, 0.2e-6, far_ends, (R, R))
    record = measure.Record(scene, Path(__file__).with_suffix(".json"), options.again)
    record.full_models()
    record.mesh(Setting(f_cut=80e3))
    record.settings(
        [
            # The first mode of such blocks is at 36 kHz.
            *(Setting(f_cut=f) for f in (40e3, 80e3, 120e3)),
            *(Setting(f_cut=40e3, step=step) for step in (3e-6, 2e-6, 1.5e-6, 0.5e-6)),
            *(Setting(f_cut=40e3, method="implicit", step=step) for step in (8e-6, 4e-6, 2e-6, 1e-6, 0.5e-6)),
            *(Setting(f_cut=40e3, region=x) for x in (0.8, 0.6)),
            Setting(f_cut=40e3, formulation="penalty"),
            Setting(f_cut=40e3, rows="node-to-segment"),
            *(Setting("residual", f) for f in (40e3, 80e3, 120e3)),
            *(Setting("craig-bampton", f) for f in (40e3, 120e3)),
            *(Setting("free", f) for f in (40e3, 120e3)),
        ]
    )
    record.tolerances((1e-1, 1e-2, 1e-3))
    record.own(modes=(8, 24), stiffness=(3e5, 5e5, 8e5, 1.2e6), steps=(1e-6, 4e-6))
    record.add("full FE, explicit", "full FE", scene.explicit)
    measure.finish(record)


if __name__ == "__main__":
    main()
