"""Alumina balls hit thick glass obliquely at 3.9 m/s: an experiment by Kharaz, Gorham and Salman (2001).

`ep.restitution_map` computes the impacts over the angle, with the coefficient of friction 0.092 that the authors found
from sliding impacts. Meshes are those of `validation/friction/kharaz.py`: seven elements across the contact, and glass
so thick that no wave returns.

Quantity: tangential restitution (velocities of the ball's centre), spin, and rebound angle, at all measured angles.
Reference: the experiment, and as a second independent method elastic half-spaces with Coulomb friction
(`half_spaces.py`): no finite elements, no waves.
Limits: from 20 degrees on, 5 % of the measured tangential restitution and rebound angle, 8 % of the spin; at all angles
4 % of the tangential restitution by half-spaces.

Below 20 degrees the experiment has more tangential restitution: 0.79 at 1.8 degrees, where this library has 0.64 and
half-spaces have 0.66. Alumina and glass are unlike: under the normal force they move sideways by different amounts and
slip, and friction then has less left to hold the tangential motion. Half-spaces without that coupling (Maw's theory)
have 0.78, near to what was measured. So the real surfaces seem to slip less under the normal force than a coefficient
of 0.092 says. Nor do the measured numbers agree with each other: balance of angular momentum, w = 5 (1 - e_t) v sin(a)
/ (2 R), makes 0.674 of the spin that was measured at 6.1 degrees; the measured restitutions make 0.71 there.

    python -m validation.experiments.kharaz [--quick] [--out JSON]
"""

import time

import numpy as np

import exudyn_partition as ep
from validation.experiments import common, half_spaces
from validation.friction.kharaz import ALUMINA, GLASS, MU, RADIUS, SPEED, bodies

DATA = common.data("kharaz")
MASS = 4 / 3 * np.pi * RADIUS**3 * ALUMINA.rho
SURE = 20.0  # degrees, from which on the experiment is met
LIMITS = {"e_t": 0.05, "rebound": 0.05, "spin": 0.08, "half-spaces": 0.04, "balance": 1e-3}
LASTS = 15e-6  # no wave returns from the glass until then [s]


def by_half_spaces(degrees, coupled=True):
    """Tangential restitution of the ball's centre."""
    along, down = SPEED * np.sin(np.radians(degrees)), SPEED * np.cos(np.radians(degrees))
    found = half_spaces.impact(RADIUS, MASS, (ALUMINA, GLASS), (along, down), MU, coupled=coupled)
    return found["centre"] / along


def rows_of(found, measured):
    """One row a measured number, with ours beside it."""
    angles = np.degrees(found.angle)
    ours = {
        "e_t": found["centre_tangential"].ravel(),
        "spin": -found["spin"].ravel(),
        "rebound": np.degrees(found["rebound_angle"].ravel()),
    }
    rows = []
    for name, values in ours.items():
        for degrees, value in measured[name]:
            i = int(abs(angles - degrees).argmin())
            rows.append({"quantity": name, "degrees": degrees, "measured": value, "computed": float(values[i])})
            rows[-1]["error"] = rows[-1]["computed"] / value - 1
            if name == "e_t":
                rows[-1]["half-spaces"] = by_half_spaces(degrees)
                rows[-1]["half-spaces, uncoupled"] = by_half_spaces(degrees, coupled=False)
    return rows


def worst(rows, found):
    """Largest errors."""
    sure = {
        name: max(abs(row["error"]) for row in rows if row["quantity"] == name and row["degrees"] >= SURE)
        for name in ("e_t", "rebound", "spin")
    }
    second = [abs(r["computed"] / r["half-spaces"] - 1) for r in rows if r["quantity"] == "e_t"]
    return {
        **sure,
        "half-spaces": max(second),
        "balance": float(abs(found["balance"]).max()),
    }


def draw(path, rows):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    labels = {"e_t": "tangential restitution", "spin": "spin [rad/s]", "rebound": "rebound angle [degrees]"}
    for ax, (name, label) in zip(axes, labels.items(), strict=True):
        own = [row for row in rows if row["quantity"] == name]
        x = [row["degrees"] for row in own]
        ax.plot(x, [row["measured"] for row in own], "ks", mfc="none", label="measured")
        ax.plot(x, [row["computed"] for row in own], "C3o-", lw=1, ms=4, label="this library")
        if name == "e_t":
            ax.plot(x, [row["half-spaces"] for row in own], "C0--", lw=1, label="half-spaces")
            ax.plot(x, [row["half-spaces, uncoupled"] for row in own], "C0:", lw=1, label="the same, uncoupled (Maw)")
        ax.set(xlabel="angle of incidence from the normal [degrees]", ylabel=label)
        ax.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "three angles")
    measured = {name: DATA[name] for name in ("e_t", "spin", "rebound")}
    if given.quick:
        measured = {name: [row for row in rows if 20 < row[0] < 31.5][:1] for name, rows in measured.items()}
    begin, pair = time.perf_counter(), bodies()
    offline = time.perf_counter() - begin
    angles = sorted({row[0] for rows in measured.values() for row in rows})
    begin = time.perf_counter()
    found = ep.restitution_map(
        tuple(pair), speed=SPEED, angle=np.radians(angles), friction=MU, along=(1, 0, 0), duration=LASTS
    )
    online = time.perf_counter() - begin
    rows = rows_of(found, measured)
    for name in measured:
        common.show(f"Kharaz: {name}", [row for row in rows if row["quantity"] == name])
    result = {
        "rows": rows, "restitution": found["restitution"].ravel().tolist(), "offline_s": offline, "online_s": online,
        "impacts": len(angles), "dofs": sum(body.n_dofs for body in pair),
    }  # fmt: skip
    common.finish(__file__, result, worst(rows, found), LIMITS, given, lambda path: draw(path, rows))


if __name__ == "__main__":
    main()
