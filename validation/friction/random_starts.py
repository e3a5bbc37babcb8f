"""Forces with friction from a thousand random starts, and along smooth paths, on the patch of a reduced ball.

The flexibility is that of a steel ball of 20 mm on a rigid plane, so that normal forces also move rows sideways. Gaps
are those of the ball, pressed in to a random depth and tilted, with random noise. Slips are a shift, a turn, and noise.
Coefficients are up to 1. Half of the starts know nothing, the others begin at random states and forces.

Limits: no start fails. Coulomb's and the contact conditions hold to 1e-8 of the largest force and gap. At most 15
Newton steps an answer along smooth paths of 20, 60 and 150 closed rows. Times are given without a limit.

    python -m validation.friction.random_starts
"""

import argparse
import time

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import regularised
from exudyn_partition.algebra.friction import FrictionProblem
from exudyn_partition.errors import ComplementarityError
from validation.contact import scenes

RADIUS, PATCH = 10e-3, 0.6e-3  # m
STARTS, STEPS = 1000, 400
CLOSED = (20, 60, 150)
LIMITS = {"failures": 0, "violation": 1e-8, "newton_steps": 15}


def patch():
    """Gaps of the rows at rest, (nr,), their places, (nr, 2), and their flexibility, (3 nr, 3 nr)."""
    shape = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    fine = ep.Refine((0, 0, 0), PATCH, PATCH / 4)
    fem = ep.fe_model(shape, scenes.STEEL, maxh=3e-3, refine=[fine], grading=0.4)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), PATCH, axes="xyz"), f_cut=100e3)
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, body)
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=0.3)
    law = contact.mechanics.for_run("explicit")
    gap = law.gaps.at(np.zeros(body.n_dofs))
    places = law.gaps.slave.surface.points[law.gaps.row_nodes, :2]
    return gap - gap.min(), places, regularised(law.rows.flexibility())


def violation(F, h, mu, lam):
    """Largest violation of the conditions, relative to the largest force and gap."""
    w = h + (F @ lam.ravel()).reshape(-1, 3)
    force, slip = np.linalg.norm(lam[:, 1:], axis=1), np.linalg.norm(w[:, 1:], axis=1)
    opposite = force[:, None] * w[:, 1:] + slip[:, None] * lam[:, 1:]
    gaps, forces = abs(h).max(), max(abs(lam).max(), 1e-300)
    works = [abs(lam[:, 0] * w[:, 0]).max(), abs(opposite).max(), (slip * (mu * lam[:, 0] - force)).max()]
    excess = [-lam[:, 0].min() / forces, -w[:, 0].min() / gaps, (force - mu * lam[:, 0]).max() / forces]
    return max(*excess, *(work / forces / gaps for work in works))


def random_start(rng, gap, places):
    """Gaps and slips, (nr, 3)."""
    depth = gap.max() * rng.uniform(0.02, 0.7)
    tilt = rng.normal(size=2) * 0.3 * depth / PATCH
    noise = depth * 10 ** rng.uniform(-4, -0.5)
    normal = gap - depth + places @ tilt + noise * rng.normal(size=len(gap))
    size = depth * 10 ** rng.uniform(-3, 1.5)
    turn = rng.normal() * size / PATCH
    slips = size * rng.normal(size=2) + turn * places[:, ::-1] * [-1, 1]
    return np.column_stack([normal, slips + noise * rng.normal(size=(len(gap), 2))])


def starts(gap, places, F):
    rng, problem, nr = np.random.default_rng(0), FrictionProblem(F), len(gap)
    failures, worst, steps, closed, resorts = [], 0.0, [], [], 0
    for number in range(STARTS):
        h, mu = random_start(rng, gap, places), np.full(nr, rng.uniform(0, 1))
        problem = FrictionProblem(F)
        if number % 2:
            force = rng.exponential(size=(nr, 1)) * gap.max() / F[0, 0]
            guess = np.column_stack([force, mu[:, None] * force * rng.uniform(-1, 1, (nr, 2))])
            problem.replace(F, rng.integers(0, 3, nr), guess)
        try:
            lam = problem.solve(h, mu)
        except ComplementarityError as error:
            failures.append(f"start {number}: {error}")
            continue
        worst = max(worst, violation(F, h, mu, lam))
        steps.append(problem.iterations)
        closed.append(len(problem.index))
        resorts += problem.iterations > 40
    return {
        "failures": len(failures),
        "messages": failures[:5],
        "violation": worst,
        "steps_mean": np.mean(steps),
        "steps_most": max(steps),
        "more_than_newton": resorts,
        "closed_mean": np.mean(closed),
        "closed_most": max(closed),
    }


def path(gap, places, F, count, mu=0.3):
    """An oblique impact in small steps; processor time of an answer, along the path and from nothing."""
    order = np.sort(gap)
    depth = 2 * order[min(count, len(gap) - 1)]
    near = gap < 1.1 * depth
    some = (3 * np.flatnonzero(near)[:, None] + np.arange(3)).ravel()
    gap, F = gap[near], F[np.ix_(some, some)]
    problem, place, times, closed, worst = FrictionProblem(F), np.zeros((len(gap), 2)), [], [], 0.0
    mu, top, cold = np.full(len(gap), mu), 0.0, 0.0
    for phase in np.pi * np.arange(1, STEPS + 1) / STEPS:
        way = mu[0] * depth * np.array([np.sin(1.7 * phase), 0.3 * np.sin(1.3 * phase)])
        h = np.column_stack([gap - depth * np.sin(phase), way - place])
        begin = time.thread_time()
        lam = problem.solve(h, mu)
        times.append(time.thread_time() - begin)
        closed.append(len(problem.index))
        worst = max(worst, violation(F, h, mu, lam))
        if closed[-1] > top:
            top, anew = closed[-1], FrictionProblem(F)
            begin = time.thread_time()
            anew.solve(h, mu)
            cold = time.thread_time() - begin
        place = place + h[:, 1:] + (F @ lam.ravel()).reshape(-1, 3)[:, 1:]
    busy = np.array(times)[np.array(closed) > 0]
    return {
        "closed": int(max(closed)),
        "rows": len(gap),
        "violation": worst,
        "newton_steps": problem.iterations / len(busy),
        "factorisations": problem.factorisations / len(busy),
        "sweeps": problem.sweeps,
        "warm_ms": 1e3 * busy.mean(),
        "warm_most_ms": 1e3 * busy.max(),
        "cold_ms": 1e3 * cold,
    }


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    console, model = Console(width=150), patch()
    console.print(f"{len(model[0])} rows")
    found = starts(*model)
    console.print(found)
    paths = {str(count): path(*model, count) for count in CLOSED}
    for case in paths.values():
        console.print({key: float(f"{value:.3g}") for key, value in case.items()})
    headline = {
        "failures": found["failures"],
        "violation": max(found["violation"], *(case["violation"] for case in paths.values())),
        "newton_steps": max(case["newton_steps"] for case in paths.values()),
    }
    failed = [f"{key} {headline[key]:.3g}" for key, limit in LIMITS.items() if headline[key] > limit]
    result = {"found": headline, "limits": LIMITS, "rows": len(model[0]), "starts": found, "paths": paths}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
