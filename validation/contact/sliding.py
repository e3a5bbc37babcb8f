"""A sphere-tipped body dragged over the facets of a block at a constant approach: ripple and jumps of the normal force.

Reference: the force itself without its trend along the way. The trend is a parabola, because the block yields most
towards its ends.
Quantity: standard deviation and largest deviation of the normal force along 0.5 mm, about three facets, over its mean.
The jump at the edge of a facet: where the force changes most in a step, the largest change in a hundredth of this step,
50 nm. Each state is the elastic equilibrium of both bodies at the prescribed rigid motion (quasi-static).
Limits: ripple (standard deviation and largest) below 2 % at the default mesh, about five nodes across the contact, for
both kinds of rows. A coarser and a finer mesh are reported too.

    python -m validation.contact.sliding
"""

import time

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes

RADIUS, APPROACH, F_CUT = 0.010, 4e-6, 200e3
WAY, STATES, SUBSTEPS = 0.5e-3, 101, 100
ALONG = np.array([1.0, 0.3, 0.0]) / np.hypot(1.0, 0.3)
A = (RADIUS * APPROACH) ** 0.5  # Hertz' contact radius
LEVELS = (0.9, 0.65, 0.45)  # requested element size over A; edges become about 1.4 times as long
DEFAULT = 0.65
WAYS = {
    "node-to-segment": {"rows": "node-to-segment"},
    "integrated": {"rows": "integrated"},
}
LIMIT = 0.02


def reduced(level):
    """Tip and block, reduced."""
    h, rng = level * A, np.random.default_rng(1)
    tip = scenes.sphere(RADIUS, scenes.STEEL, A, h, rng=rng, spare=1.5 * h, maxh=0.3)
    shape = occ.Box(occ.Pnt(-0.010, -0.006, -0.008), occ.Pnt(0.010, 0.006, 0))
    reach = WAY / 2 + 1.1 * A + 2.2 * h
    fine = ep.Refine((0, 0, 0), reach, 1.13 * h)
    block = ep.fe_model(shape, scenes.STEEL, maxh=4e-3, refine=[fine], grading=0.4)
    return [ep.reduce(*x, f_cut=F_CUT) for x in (tip, (block, ep.Partition.ball(block, (0, 0, 0), reach)))]


class Drag:
    """The tip at places along the way, both bodies in elastic equilibrium."""

    def __init__(self, bodies, options):
        mbs = exu.SystemContainer().AddSystem()
        tip, block = (ep.CreatePartitionBody(mbs, body) for body in bodies)
        contact = ep.CreatePartitionContact(mbs, tip, block, **{"passes": "given", **options})
        self.law, self.body, self.n_rows = contact.mechanics.for_run("explicit"), bodies[0], contact.n_rows
        self.elastic = np.concatenate([body.basis.omega > 0 for body in bodies])
        self.q, self.at_edge = np.zeros(len(self.elastic)), False
        self.q[: self.body.n_dofs] += self._rigid(-WAY / 2, APPROACH)

    def _rigid(self, x, depth):
        return self.body.rigid @ np.r_[x * ALONG[:2], -depth, 0, 0, 0]

    def force(self, x):
        """Normal force with the tip at x, (-WAY/2, WAY/2) [m]."""
        n = self.body.n_dofs
        held = ~self.elastic[:n]
        self.q[:n][held] = self._rigid(x, APPROACH)[held]
        self.q = scenes.equilibrium(self.law, self.q, self.elastic, tolerance=1e-9)
        self.at_edge |= self.law.evaluation.edge_reached() is not None
        return float(self.law.evaluation.lam.sum())


def drag(bodies, options):
    """Force along the way, ripple, and the largest jump."""
    begin = time.perf_counter()
    run, x = Drag(bodies, options), np.linspace(-WAY / 2, WAY / 2, STATES)
    force = np.array([run.force(place) for place in x])
    run_s = time.perf_counter() - begin
    trend = np.polyval(np.polyfit(x, force, 2), x)
    ripple = (force - trend) / force.mean()
    # The same path again up to the largest change, because the state may depend on the path; then small steps.
    i = abs(np.diff(ripple)).argmax()
    again = Drag(bodies, options)
    for place in x[: i + 1]:
        again.force(place)
    close = np.array([again.force(place) for place in np.linspace(x[i], x[i + 1], SUBSTEPS + 1)])
    return {
        "mean_N": force.mean(),
        "ripple_std": ripple.std(),
        "ripple_max": abs(ripple).max(),
        "largest_step": abs(np.diff(ripple)).max(),
        "jump": abs(np.diff(close)).max() / force.mean(),
        "jump_step_m": WAY / (STATES - 1) / SUBSTEPS,
        "rows": run.n_rows,
        "at_edge": run.at_edge,
        "nodes_across": 4 * A / run.law.gaps.size,
        "state_ms": 1e3 * run_s / STATES,
        "x_m": list(x),
        "force_N": list(force),
    }


def show(levels):
    table = Table(
        "rows", "h/a", "mean", "ripple, std", "max", "5 um", "jump in 50 nm", "off-line", "time a state",
        title=f"sphere dragged over {1e3 * WAY} mm at {1e6 * APPROACH} um approach",
    )  # fmt: skip
    for level, case in levels.items():
        for name, r in case["ways"].items():
            table.add_row(
                name + (" (at edge)" if r["at_edge"] else ""), level, f"{r['mean_N']:.2f} N", f"{r['ripple_std']:.2%}",
                f"{r['ripple_max']:.2%}", f"{r['largest_step']:.2%}", f"{r['jump']:.3%}", f"{case['offline_s']:.1f} s",
                f"{r['state_ms']:.1f} ms",
            )  # fmt: skip
    Console(width=130).print(table)


def draw(levels):
    path, (fig, axes) = scenes.figure(__file__, nrows=len(levels), figsize=(8, 9), sharex=True)
    for ax, (level, case) in zip(axes, levels.items(), strict=True):
        for name, r in case["ways"].items():
            ax.plot(1e3 * np.array(r["x_m"]), r["force_N"], label=name)
        ax.set(title=f"h/a = {level}", ylabel="normal force [N]")
    axes[-1].set_xlabel("way [mm]")
    axes[0].legend(fontsize=7)
    fig.savefig(path, dpi=120)


def main():
    levels = {}
    for level in LEVELS:
        begin = time.perf_counter()
        bodies = reduced(level)
        case = {"offline_s": time.perf_counter() - begin, "nodes": sum(len(body.points) for body in bodies)}
        levels[str(level)] = {**case, "ways": {name: drag(bodies, options) for name, options in WAYS.items()}}
        show({str(level): levels[str(level)]})
    draw(levels)
    default = levels[str(DEFAULT)]["ways"]
    failed = [
        f"{name}: {key} {default[name][key]:.2%}"
        for name in ("node-to-segment", "integrated")
        for key in ("ripple_std", "ripple_max")
        if default[name][key] > LIMIT
    ]
    scenes.finish(__file__, {"limit": LIMIT, "default": DEFAULT, "contact_radius_m": A, "levels": levels}, failed)


if __name__ == "__main__":
    main()
