"""An elastic ball that touches its mirror image, pressed and then pulled along: Cattaneo and Mindlin, by an FE model.

In the mirror each row meets its equal, so relative motions are twice those of the ball, and normal forces cause none
along the surface: these entries of the flexibility of the reduced ball's patch are left out. So this stands for two
equal balls. Limits: force Q 2 %, radius of the stick zone 3 % of the contact's, loss of a cycle 3 %. The theory is that
of half-spaces; the contact's radius is a hundredth of the ball's.

    python -m validation.friction.at_rest
"""

import argparse
import time

import exudyn as exu
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import regularised
from exudyn_partition.algebra.friction import FrictionProblem
from validation.contact import scenes
from validation.friction import half_space
from validation.friction.half_space import MU, Squares
from validation.friction.two_balls import ball

CONTACT, ELEMENTS = 0.1e-3, 5  # of the contact [m], elements in it
LIMITS = {"force": 0.02, "stick_radius": 0.03, "loss": 0.03}


class Mirrored(Squares):
    """Rows of the patch of a ball that meets its mirror image, by its own flexibility."""

    def __init__(self, a):
        fem = ball(a, ELEMENTS)
        body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.12 * a, axes="xyz"), f_cut=20e3)
        mbs = exu.SystemContainer().AddSystem()
        contact = ep.CreatePartitionContact(mbs, ep.CreatePartitionBody(mbs, body), ep.RigidPlane(), friction=MU)
        law = contact.mechanics.for_run("explicit")
        F = regularised(law.rows.flexibility())
        F[::3] *= np.arange(F.shape[1]) % 3 == 0  # normal forces alone move rows along the normal ...
        F[:, ::3] *= (np.arange(F.shape[0]) % 3 == 0)[:, None]  # ... and nothing else
        self.flexibility, self.problem = F, FrictionProblem(F)
        self.height, self.area = law.gaps.at(np.zeros(body.n_dofs)), law.gaps.area
        tangents = law.rows.tangents
        self.along = tangents[:, :, 0]  # the load's direction on each row's tangents
        nr = len(self.height)
        self.mu, self.place = np.full(nr, MU), np.zeros((nr, 2))
        self.dissipated, self.last = 0.0, np.zeros((nr, 3))

    def press(self, approach, way):
        """Normal and tangential force on the ball after it has come nearer and moved to `way` along x [N]."""
        h = np.column_stack([self.height - approach, self.along * way - self.place])
        lam = self.problem.solve(h, self.mu)
        slip = h[:, 1:] + (self.flexibility @ lam.ravel()).reshape(-1, 3)[:, 1:]
        self.dissipated -= 0.5 * np.sum(slip * (lam + self.last)[:, 1:])
        self.place, self.last = self.place + slip, lam
        return np.array([lam[:, 0].sum(), np.sum(self.along * lam[:, 1:])])


def draw(rest):
    path, (_, axes) = scenes.figure(__file__, figsize=(6, 4.5))
    axes.plot(rest["way"], rest["expected"], "k", label="Q, Cattaneo and Mindlin")
    axes.plot(rest["way"], rest["forces"], "C0o", mfc="none", label="Q / (mu P)")
    axes.plot(rest["way"], rest["radius"], "k--", label="c, Cattaneo and Mindlin")
    axes.plot(rest["way"], rest["sticks"], "C1s", mfc="none", label="c / a")
    axes.plot(*rest["loop"].T, "C2-", lw=0.8, label="cycle")
    axes.set(xlabel="delta / delta of full slip")
    axes.legend(fontsize=7)
    axes.figure.savefig(path, dpi=120)
    return path


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    begin, console = time.perf_counter(), Console(width=150)
    rows = Mirrored(CONTACT)
    rest = half_space.at_rest(rows, CONTACT)
    found = {key: float(rest[key]) for key in LIMITS}
    console.print(found)
    console.print(str(draw(rest)))
    result = {"found": found, "limits": LIMITS, "amplitude": float(rest["amplitude"]), "rows": len(rows.height),
              "time_s": time.perf_counter() - begin}  # fmt: skip
    scenes.finish(__file__, result, [f"{key} {found[key]:.3g}" for key in LIMITS if abs(found[key]) > LIMITS[key]])


if __name__ == "__main__":
    main()
