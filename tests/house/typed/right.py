"""A script as users write it, which a strict checker of types must accept: it is checked, and never run."""

from pathlib import Path
from typing import assert_type

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep


def main(out: Path) -> float:
    steel = ep.Material(E=210e9, nu=0.3, rho=7850, yield_stress=355e6)
    refine = [ep.Refine((0, 0, 0), radius=0.3e-3, h=0.1e-3), ep.Refine(np.zeros(3), 1e-3, h=0.2e-3)]
    ball_shape = occ.Sphere(occ.Pnt(0, 0, 0.01), 0.01)  # pyright: ignore[reportAttributeAccessIssue]  # lacks stubs
    fem = ep.fe_model(ball_shape, steel, maxh=3e-3, refine=refine)
    assert_type(fem, ep.FEModel)
    part = ep.Partition.ball(fem, center=(0, 0, 0), radius=0.5e-3, axes="xyz", direction=np.array([0, 0, -1]))
    part |= ep.Partition.interface(fem, "pin", nodes="bore", kind="averaged", position=[0, 0, 0.02])
    body = ep.reduce(fem, part, f_cut=200e3, basis="residual", cache=out)
    assert_type(body, ep.ReducedBody)
    assert_type(ep.reduce_pair((fem, part), (fem, part), tolerance=0.01, speed=1.0)[1].estimate, ep.Estimate | None)
    body.save(out / "ball.npz")

    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(
        mbs,
        ep.load_body(out / "ball.npz"),
        frame="floating",
        referencePosition=np.zeros(3),
        referenceRotation=np.eye(3),
        initialVelocity=[0, 0, -1],
        damping=ep.Rayleigh(beta=1e-9),
        inertiaTerms=["gyroscopic"],
    )
    assert_type(ball, ep.PartitionBody)
    floor = ep.RigidPlane(normal=(0, 0, 1))
    contact = ep.CreatePartitionContact(
        mbs, ball, floor, formulation="penalty", rows="node-to-segment", passes="given", friction=ep.Coulomb(0.2)
    )
    assert_type(contact, ep.PartitionContact)
    assert_type(ep.CreatePartitionContact(mbs, [ball, ball], within=1e-3), list[ep.PartitionContact])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-4, method="implicit", progress=lambda share: print(share))
    assert_type(result, ep.Result)
    assert_type(ep.solve_static(mbs), ep.Result)
    assert_type(ep.collect(mbs), ep.Result)
    velocity = ball.velocity(result, (0, 0, 0.02))
    peak: float = contact.force(result).max()
    assert_type(contact.friction, ep.FrictionResults)
    assert_type(contact.plastic, ep.PlasticResults)
    lost = contact.friction.work(result) + contact.plastic.work(result)
    print(lost)
    result.report(out / "run.html")
    ep.output.write_paraview(out, result, fields=["displacement", "von_mises"], times=20)
    ep.plot.force(plt.figure().subplots(), result)
    ep.view.picture(result, 1e-5, field="von_mises", rotation=(0, 0, 0))
    gauge = ep.StrainGauge((0, 0, 0.02), direction=(1, 0, 0), length=1e-3)
    ball.recover(result, ep.recovery.gauge_rows(fem, [gauge]), fem=fem)
    bodies = [ep.reference.FullBody(fem, part, velocity=(0, 0, -1), mass="lumped"), ep.reference.FullBody(fem, part)]
    history = ep.reference.simulate(bodies, end_time=1e-4, rows="integrated", points={"top": (0, (0, 0, 0.02))})
    assert_type(ep.compare(result.history(contact), history), ep.Comparison)
    hertz = ep.hertz.impact(0.01, 1.0, 0.01, 0.01, steel)
    cut = ep.truncation_frequency(result.t, velocity[:, 2], window="hann")
    with ep.progress("study") as report:
        report(0.5)
    try:
        ep.stability_limit(mbs)
    except ep.errors.PartitionError as error:
        print(error, ep.__version__)
    return peak / hertz.peak_force * cut
