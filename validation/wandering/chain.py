"""A chain of 50 equal balls, struck at one end, against masses on Hertz springs.

The wave passes all contacts, which close and open again. Reference: point masses on springs of Hertz, integrated by
SciPy. Quantity: largest force of each contact, the time that the wave takes, from the blow to the largest force of the
last contact, and the last ball's velocity. Limits: 1 % each.

The speed is low, because a whole ball is stiffer than the half space of Hertz, by the order of the contact's radius
over that of the ball.

    python -m validation.wandering.chain
"""

import argparse
import time
from itertools import pairwise

import exudyn as exu
import netgen.occ as occ
import numpy as np
import scipy.integrate
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes

R, SPEED, BALLS, STEP = 0.010, 0.2, 50, 5e-7  # [m], [m/s], [s]
LIMITS = {"force": 0.01, "time": 0.01, "velocity": 0.01}


def reduced_ball():
    """A ball with a patch at either pole, reduced."""
    poles = {"back": (0, 0, -R), "front": (0, 0, R)}
    fine = [ep.Refine(pole, 0.4e-3, 0.08e-3) for pole in poles.values()]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=R / 3, refine=fine)
    back, front = (ep.Partition.ball(fem, pole, radius=0.5e-3, name=name) for name, pole in poles.items())
    return ep.reduce(fem, back | front, f_cut=200e3)


def by_springs(mass, end_time):
    """Largest forces [N], time of the last of them [s], and velocity of the last mass [m/s], of masses on springs."""
    stiffness = 4 / 3 * ep.STEEL.E / (2 * (1 - ep.STEEL.nu**2)) * np.sqrt(R / 2)

    def forces(places):
        return stiffness * np.maximum(places[:-1] - places[1:], 0.0) ** 1.5

    def rate(t, state):
        force = np.concatenate([[0.0], forces(state[:BALLS]), [0.0]])
        return np.r_[state[BALLS:], -np.diff(force) / mass]

    start = np.r_[np.zeros(BALLS), SPEED, np.zeros(BALLS - 1)]
    found = scipy.integrate.solve_ivp(rate, (0, end_time), start, rtol=1e-9, atol=1e-14, max_step=2 * STEP)
    force = forces(found.y[:BALLS])
    return force.max(axis=1), found.t[force[-1].argmax()], found.y[-1, -1]


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    begin, body = time.perf_counter(), reduced_ball()
    mbs = exu.SystemContainer().AddSystem()
    balls = [
        ep.CreatePartitionBody(
            mbs, body, frame="inertial", referencePosition=[0, 0, 2 * R * i], initialVelocity=[0, 0, SPEED * (i == 0)]
        )
        for i in range(BALLS)
    ]
    contacts = [
        ep.CreatePartitionContact(mbs, *pair, slavePatch="front", masterPatch="back") for pair in pairwise(balls)
    ]
    mbs.Assemble()
    end_time = 90e-6 * BALLS
    result = ep.solve_dynamic(mbs, end_time=end_time, step=STEP)
    force = np.array([contact.force(result) for contact in contacts])
    largest, when, velocity = by_springs(body.total_mass, end_time)
    found = {
        "force": abs(force.max(axis=1) / largest - 1).max(),
        "time": abs(result.t[force[-1].argmax()] / when - 1),
        "velocity": abs(balls[-1].velocity(result, (0, 0, 0))[-1, 2] / velocity - 1),
    }
    Console().print(found)
    beyond = [f"{key} {found[key]:.3g}" for key in LIMITS if found[key] > LIMITS[key]]
    data = {
        "found": found, "limits": LIMITS, "balls": BALLS, "largest_N": [force.max(), largest.max()],
        "facets_m": 0.08e-3, "online_s": result.time_s, "time_s": time.perf_counter() - begin,
    }  # fmt: skip
    scenes.finish(__file__, data, beyond)


if __name__ == "__main__":
    main()
