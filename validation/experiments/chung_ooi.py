"""Oblique impacts of Chung and Ooi (2011): an alumina ball on a rigid wall (test 4), two equal balls (test 8).

Their numbers, as Kratos' tests of its particle code store them, are for point contacts: Hertz and Mindlin without
micro-slip, restitution by a dashpot. Elastic bodies have no dashpot, so what a restitution of 0.5 does to sticking in
test 8 is not compared; where friction slides all the time, x = 3.5 mu (1 + e) v_n / v_t makes both the same.

Quantity: test 4: tangential restitution of the centre, by `ep.restitution_map`; test 8: tangential restitution of the
contact against x from 0.5 to 0.98; below, contact slides further than it is wide, and x - 1 holds in any case.
Limits: test 4, from 20 degrees on, 5 %; at all angles 7 % of elastic half-spaces (`half_spaces.py`), from 20 degrees on
2 %; test 8: 0.03.

Below 20 degrees test 4 differs, and its points too: 0.95 at 5 degrees, where this library has 0.57, half-spaces 0.61
and Kratos itself 0.85. An elastic ball on a rigid wall moves sideways all over its contact, as the wall does not. It
slips under the normal force alone. Point contacts know nothing of this; half-spaces show it.

    python -m validation.experiments.chung_ooi [--quick] [--out JSON]
"""

import time
import warnings

import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from validation.experiments import common, half_spaces

DATA = common.data("chung_ooi")
WALL, BALLS = DATA["setup"]["test_4"], DATA["setup"]["test_8"]
SURE, SLIDES = 20.0, (0.5, 0.98)  # degrees from which on test 4 is met; x of test 8 that are compared
LIMITS = {"test 4": 0.05, "half-spaces": 0.07, "the same, from 20 degrees": 0.02, "test 8": 0.03, "balance": 1e-3}
RIGID = ep.Material(E=1e18, nu=0.23, rho=4000.0)


def material(setup):
    return ep.Material(E=setup["E_Pa"], nu=setup["nu"], rho=setup["rho_kg_m3"])


def ball(setup, a, *, below=False, spare=1.0):
    """Reduced ball that touches z = 0 at the origin, for a contact of radius a [m]."""
    radius, side = setup["radius_m"], -1 if below else 1
    shape, fine = occ.Sphere(occ.Pnt(0, 0, side * radius), radius), ep.Refine((0, 0, 0), 1.3 * a, a / 3.5)
    fem = ep.fe_model(shape, material(setup), maxh=0.36 * radius, refine=[fine], grading=0.4)
    part = ep.Partition.ball(fem, (0, 0, 0), 1.35 * spare * a, axes="xyz")
    return ep.reduce(fem, part, f_cut=min(600e3 * 2.5e-3 / radius, 0.9 * fem.resolved_frequency))


def hertz(setup, speed, two):
    """Hertz' impact of the ball on the wall, or of two balls; and the contact radius [m]."""
    own, radius = material(setup), setup["radius_m"]
    mass = 4 / 3 * np.pi * radius**3 * own.rho
    others = (radius, own, own) if two else (np.inf, own)
    impact = ep.hertz.impact(mass / 2 if two else mass, speed, radius, *others)
    return impact, ep.hertz.contact_radius(impact.peak_force, radius, *others), mass


def on_the_wall(points):
    """Tangential restitution at (degrees, reference), beside half-spaces."""
    impact, a, mass = hertz(WALL, WALL["speed_m_s"], two=False)
    begin = time.perf_counter()
    body = ball(WALL, a)
    offline, begin = time.perf_counter() - begin, time.perf_counter()
    found = ep.restitution_map(
        (body, ep.RigidPlane()), speed=WALL["speed_m_s"], angle=np.radians([p[0] for p in points]),
        friction=WALL["friction"], duration=1.3 * impact.duration,
    )  # fmt: skip
    online, rows = time.perf_counter() - begin, []
    for (degrees, reference), ours in zip(points, found["centre_tangential"].ravel(), strict=True):
        velocity = WALL["speed_m_s"] * np.array([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])
        second = half_spaces.impact(WALL["radius_m"], mass, (material(WALL), RIGID), velocity, WALL["friction"])
        row = {"degrees": degrees, "reference": reference, "computed": float(ours), "error": ours / reference - 1}
        rows.append({**row, "half-spaces": second["centre"] / velocity[0]})
        rows[-1]["of them"] = ours / rows[-1]["half-spaces"] - 1
    return rows, {"offline_s": offline, "online_s": online, "balance": float(abs(found["balance"]).max())}


def two_balls(points):
    """Tangential restitution of the contact at (x, reference), of two equal balls."""
    normal = BALLS["normal_speed_m_s"]
    impact, a, _ = hertz(BALLS, normal, two=True)
    begin = time.perf_counter()
    pair = ball(BALLS, a), ball(BALLS, a, below=True, spare=1.3)
    offline, begin, rows, worst = time.perf_counter() - begin, time.perf_counter(), [], 0.0
    for x, reference in points:
        angle = np.arctan(3.5 * BALLS["friction"] * 2 / x)  # elastic balls: e = 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ep.errors.YieldWarning)  # compared with elastic balls
            found = ep.restitution_map(
                pair, speed=normal / np.cos(angle), angle=angle, friction=BALLS["friction"],
                duration=1.3 * impact.duration,
            )  # fmt: skip
        ours = found["tangential_restitution"].item()
        worst = max(worst, float(abs(found["balance"]).max()))
        rows.append({"x": x, "reference": reference, "computed": ours, "difference": ours - reference})
    return rows, {"offline_s": offline, "online_s": time.perf_counter() - begin, "balance": worst}


def draw(path, wall, balls):
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    x = [row["degrees"] for row in wall]
    left.plot(x, [row["reference"] for row in wall], "ks", mfc="none", label="Chung and Ooi, point contact")
    left.plot(x, [row["computed"] for row in wall], "C3o-", ms=4, lw=1, label="this library")
    left.plot(x, [row["half-spaces"] for row in wall], "C0--", lw=1, label="half-spaces")
    left.set(xlabel="angle from the normal [degrees]", ylabel="tangential restitution", title="test 4")
    left.legend(fontsize=8)
    right.plot(*zip(*DATA["test_8"], strict=True), "ks", mfc="none", label="Chung and Ooi, e = 0.5 by a dashpot")
    right.plot([r["x"] for r in balls], [r["computed"] for r in balls], "C3o-", ms=4, lw=1, label="this library, e = 1")
    right.set(xlabel="3.5 mu (1 + e) v_n / v_t", ylabel="tangential restitution", xlim=(0, 3), title="test 8")
    right.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "three angles, two points")
    wall = [p for p in DATA["test_4"] if not given.quick or 24 < p[0] < 42]
    slides = [p for p in DATA["test_8"] if SLIDES[0] <= p[0] <= SLIDES[1]]
    on_wall, told = on_the_wall(wall[:3] if given.quick else wall)
    of_balls, told_8 = two_balls(slides[-2:] if given.quick else slides)
    common.show("test 4", on_wall)
    common.show("test 8", of_balls)
    found = {
        "test 4": max(abs(row["error"]) for row in on_wall if row["degrees"] >= SURE),
        "half-spaces": max(abs(row["of them"]) for row in on_wall),
        "the same, from 20 degrees": max(abs(row["of them"]) for row in on_wall if row["degrees"] >= SURE),
        "test 8": max(abs(row["difference"]) for row in of_balls),
        "balance": max(told["balance"], told_8["balance"]),
    }
    result = {"test 4": on_wall, "test 8": of_balls, "time 4": told, "time 8": told_8}
    common.finish(__file__, result, found, LIMITS, given, lambda path: draw(path, on_wall, of_balls))


if __name__ == "__main__":
    main()
