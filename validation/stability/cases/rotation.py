"""Bodies that spin, in both frames."""

import exudyn as exu
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from validation.stability.cases.registry import QUIET, case
from validation.stability.scenes import (
    RADIUS,
    ball,
    hertz,
    kept,
    strike,
)


def spinning(method, omega, frame="floating", **options):
    """A free block that spins about a tilted axis."""
    fem = ep.fe_model(occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.01, 0.02, 0.03)), ep.STEEL, maxh=7e-3)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0.005, 0.01, 0.03), 6e-3), f_cut=80e3)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, initialAngularVelocity=omega)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, method=method, **options, **QUIET)
    return body, item, result


@case("spinning at 1e4 rad/s, floating frame", "angular momentum 1e-4, energy 1e-3, three turns", quick=True)
def spin(method):
    """Strain by centrifugal forces is not in the rigid inertia, so the energy varies with it."""
    omega = 1e4 * np.array([0.6, 0.1, 0.79])
    body, item, result = spinning(method, omega, end_time=2e-3, step=0.2e-6, sample_period=2e-6)
    L, energy = item.angular_momentum(result, body.centre_of_mass), item.energy(result)
    q = item.coordinates(result)
    return {
        "not finite": (float(np.count_nonzero(~np.isfinite(q))), 0.0),
        "unfinished": (float(result.status != "finished"), 0.0),
        "angular momentum": (float(np.linalg.norm(L - L[0], axis=1).max() / np.linalg.norm(L[0])), 1e-4),
        "energy": (float(abs(energy / energy[0] - 1).max()), 1e-3),
    }


@case("spinning at 1e4 rad/s, inertial frame", "warns of rotation", warns=("ModelLimitWarning",))
def spin_inertial(method):
    _, item, result = spinning(method, [0, 0, 1e4], frame="inertial", end_time=50e-6)
    q = item.coordinates(result)
    return {"not finite": (float(np.count_nonzero(~np.isfinite(q))), 0.0)}


@case("spinning ball at 1e4 rad/s on a plane", "bounce 2 %, Hertz 15 %: it rings by centrifugal forces")
def spinning_ball(method):
    spun = {"frame": "floating", "initialAngularVelocity": [0, 0, 1e4]}
    run = strike(method, ball(axes="xyz"), body=spun, gap=1e-6, end_time=80e-6)
    checks = kept(run, solve=False, energy=5e-3) | hertz(run, 1.0, force=0.15)
    q, q_t = (f(run.result) for f in (run.bodies[0].coordinates, run.bodies[0].coordinates_t))
    L = run.bodies[0].kinematics.angular_momentum(q, q_t, np.array([0, 0, RADIUS]))[:, 2]
    return checks | {"spin": (float(abs(L / L[0] - 1).max()), 1e-4)}


@case("steps of ten radians", "warns that steps do not resolve the rotation", methods=("implicit",),
      warns=("ModelLimitWarning",), quick=True)  # fmt: skip
def spin_long_steps(method):
    _, item, result = spinning(method, [6e3, 1e3, 7.9e3], end_time=20e-3, step=1e-3)
    return {"not finite": (float(np.count_nonzero(~np.isfinite(item.coordinates(result)))), 0.0)}
