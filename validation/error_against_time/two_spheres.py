"""Error against run time: two equal steel spheres, one at rest.

Reference: the full FE model of the same mesh, HHT. Its own error is what twice its step changes, and what a finer mesh
changes in the force of reduced bodies. Quantity: see measure.py. There are no limits here: ../pareto.py has them.

    python -m validation.error_against_time.two_spheres [--again]
"""

from pathlib import Path

import netgen.occ as occ

import exudyn_partition as ep
from validation.error_against_time import measure
from validation.error_against_time.measure import Setting
from validation.error_against_time.two_bodies import TwoBodies

STEEL = ep.Material(E=210e9, nu=0.3, rho=7850.0)
R, H = 0.010, 0.11e-3  # radius; elements at the contact [m]


def models(size=1.0, region=1.0):
    """Both spheres, touching at the origin."""
    found = []
    for up, reach in ((True, 0.45e-3), (False, 0.6e-3)):
        shape = occ.Sphere(occ.Pnt(0, 0, R if up else -R), R)
        refined = [ep.Refine((0, 0, 0), 0.35e-3, size * H)]
        fem = ep.fe_model(shape, STEEL, maxh=size * 3e-3, refine=refined, grading=0.5)
        found.append((fem, ep.Partition.ball(fem, (0, 0, 0), region * reach)))
    return found


def main():
    options = measure.options(__doc__)
    scene = TwoBodies("two spheres", models, 0.5, 150e-6, 0.1e-6, ((0, 0, 2 * R), (0, 0, -2 * R)), (R, R))
    record = measure.Record(scene, Path(__file__).with_suffix(".json"), options.again)
    record.full_models()
    record.mesh(Setting(f_cut=200e3, step=0.1e-6))
    record.settings(
        [
            # The first mode of such spheres that contact moves is at 140 kHz.
            *(Setting(f_cut=f) for f in (150e3, 200e3)),
            *(Setting(f_cut=150e3, step=step) for step in (1e-6, 0.5e-6, 0.1e-6)),
            *(Setting(f_cut=150e3, method="implicit", step=step) for step in (4e-6, 2e-6, 1e-6, 0.5e-6, 0.25e-6)),
            *(Setting(f_cut=150e3, region=x, step=0.5e-6) for x in (0.8, 0.6)),
            Setting(f_cut=150e3, formulation="penalty"),
            Setting(f_cut=150e3, rows="node-to-segment"),
            *(Setting("residual", f) for f in (150e3, 200e3)),
            *(Setting("craig-bampton", f) for f in (150e3, 200e3)),
            Setting("free", 200e3),
        ]
    )
    record.tolerances((1e-1, 1e-2, 1e-3))
    record.own(modes=(8, 24), stiffness=(2e5, 3e5, 5e5, 8e5), steps=(1e-6, 4e-6))
    record.add("full FE, explicit", "full FE", scene.explicit)
    measure.finish(record)


if __name__ == "__main__":
    main()
