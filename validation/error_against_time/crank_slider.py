"""Error against run time: the crank-slider's first impact, 0.4 ms from 20 us before it.

Reference: both blocks as full FE models in the same mechanism, with the same link (../joints/full_blocks.py says what
it assumes). Its own error is what twice its step changes, and what a finer mesh of the blocks changes in the force of
reduced bodies. Quantity: see measure.py. Steps are implicit because the mechanism has joints; explicit ones are run for
comparison. The blocks of `tolerance=` are reduced as a pair of free bodies that hit each other. The link is always
reduced to 5 kHz. Bases whose patch has mass use another mesh, with as many nodes in the impact regions as the paper's.
There are no limits here: ../pareto.py has them.

    python -m validation.error_against_time.crank_slider [--again]
"""

import functools
from pathlib import Path

import exudyn as exu

import exudyn_partition as ep
from examples.models import crank_slider as example
from examples.models.crank_slider_parts import CONTACT_ANGLE, FULL_MESH, PAPER_MESH, SPEED, Start, block, link
from validation import exudyn_own
from validation.error_against_time import measure
from validation.error_against_time.measure import Setting
from validation.joints.baselines import cms_blocks, cms_hertz_run, cms_run, hertz_run
from validation.joints.full_blocks import full_blocks

ANGLE = CONTACT_ANGLE - 20e-6 * SPEED  # at the start
LINK_CUT, MODES = 5e3, 16  # of the link [Hz]; of Exudyn's blocks


class CrankSlider:
    """The scene as measure.Record asks for it; bodies are the link and the two blocks."""

    name, duration, step = "crank-slider", 0.4e-3, 0.5e-6

    def __init__(self, size=1.0):
        h, region, maxh = FULL_MESH
        self.models = [block(number, size * h, region, size * maxh) for number in (3, 4)]
        self.link = ep.reduce(*link(), f_cut=LINK_CUT)
        self.before_s = self.link.reduce_s
        self.default = Setting(method="implicit")

    @property
    def fe_dofs(self):
        """Of both blocks."""
        return sum(fem.n_dofs for fem, _ in self.models)

    def about(self):
        """What the FE models are."""
        return measure.about(self.models)

    def finer(self):
        """Return the scene with smaller elements."""
        return CrankSlider(0.8)

    def reference(self, step):
        """Return the history of the blocks as full FE models."""
        slave_is_3 = measure.finer_first(self.models)
        with ep.progress(f"{self.name}, full FE, {1e6 * step:g} us"):
            run = full_blocks(self.models, self.link, ANGLE, self.duration, step, "integrated", slave_is_3)
        info = {"step_s": step, "steps": len(run["t"]) - 1, "dofs": self.fe_dofs}
        return ep.History(run["t"], run["force"], {}, info | {k: run[k] for k in ("time_s", "setup_s")})

    def full_memory(self):
        """Of the full FE models [MB]."""
        return measure.full_memory(self.models, self.step)

    def reduced(self, setting):
        """Return the link and both blocks as a setting asks for them."""
        found, models = [self.link], self.models
        if setting.basis in measure.WITH_MASS:
            models = [block(number, *PAPER_MESH) for number in (3, 4)]
        for number, (fem, partition) in zip((3, 4), models, strict=True):
            if setting.region != 1.0:
                back = ep.Partition.interface(fem, "back", "back", kind="averaged")
                side = (1 if number == 3 else -1, 0, 0)
                radius = setting.region * FULL_MESH[1]
                partition = ep.Partition.ball(fem, (0, 0, 0), radius, direction=side) | back
            found.append(ep.reduce(fem, partition, basis=setting.basis, f_cut=setting.f_cut))
        return found

    def reduced_to(self, tolerance):
        """Return blocks as the library chooses them, and the link."""
        speed = Start(ANGLE).speed
        return [*ep.reduce_pair(*self.models, tolerance=tolerance, speed=speed, duration=self.duration), self.link]

    def simulate(self, bodies, setting):
        """Return the history of a run of the library."""
        link_body, *blocks = sorted(bodies, key=lambda body: body is not self.link)
        example.SCHEMES["this"] = setting.basis, setting.contact, setting.rows
        model = example.mechanism(link_body, blocks, "this", ANGLE)
        step = setting.step
        if setting.method == "explicit" and step is None:
            step = 0.5 * ep.stability_limit(model.mbs)
        short = setting.contact == "lagrange" and setting.method == "explicit"
        with ep.progress(f"{self.name}, {setting}") as report:
            result = ep.solve_dynamic(
                model.mbs, end_time=self.duration, step=step, method=setting.method, progress=report,
                sample_period=self.step if short else None, settings=exudyn_own.settings(self.duration, 1e-6),
            )  # fmt: skip
        info = {"time_s": result.time_s, "step_s": result.step, "steps": result.steps, "status": result.status}
        info["dofs"] = model.mbs.systemData.ODE2Size()
        return ep.History(result.t, model.contact.force(result), {}, info)

    def explicit(self):
        """The full FE blocks, lumped, no joints, by the paper's explicit scheme: time of a step times their number."""
        mbs, start = exu.SystemContainer().AddSystem(), Start(ANGLE)
        blocks = [
            ep.CreatePartitionBody(mbs, body, referencePosition=[head, 0, 0], initialVelocity=[speed, 0, 0])
            for body, head, speed in zip(measure.lumped(self.models), start.heads, (start.speed, 0.0), strict=True)
        ]
        ep.CreatePartitionContact(mbs, *blocks, formulation="lagrange")
        mbs.Assemble()
        return None, measure.explicit_cost(mbs, self.duration)

    def own(self, record, step, stiffness):
        """The baselines of ../joints/baselines.py."""

        def history(run, **more):
            info = {"step_s": step} | {k: run[k] for k in ("time_s", "steps", "dofs")}
            return ep.History(run["t"], run["force"], {}, info), more

        @functools.cache
        def modes():
            return cms_blocks(self.models, MODES)

        def rigid():
            return history(hertz_run(self.link, ANGLE, self.duration, step), offline_s=self.before_s)

        def cms(function, *arguments):
            models, cms_s = modes()
            run = function(self.link, self.models, models, ANGLE, self.duration, step, *arguments)
            return history(run, offline_s=cms_s + self.before_s)

        record.add("rigid, Hertz", "Hertz", rigid)
        record.add(f"{MODES} Craig-Bampton modes, Hertz", "Hertz", lambda: cms(cms_hertz_run))
        for k in stiffness:
            name = f"CMS, {MODES} Craig-Bampton modes, GeneralContact {k:g} N/m"
            record.add(name, "CMS", lambda k=k: cms(cms_run, k))


def main():
    options = measure.options(__doc__)
    scene = CrankSlider()
    record = measure.Record(scene, Path(__file__).with_suffix(".json"), options.again)
    record.full_models()
    implicit = {"method": "implicit", "step": 2e-6}
    record.mesh(Setting(f_cut=100e3, **implicit))
    record.settings(
        [
            *(Setting(f_cut=f, **implicit) for f in (50e3, 100e3, 137e3)),  # the first mode is at 36 kHz
            *(Setting(f_cut=50e3, method="implicit", step=h) for h in (8e-6, 4e-6, 1e-6, 0.5e-6, 0.25e-6)),
            *(Setting(f_cut=f) for f in (50e3, 100e3)),
            *(Setting(f_cut=50e3, region=x, **implicit) for x in (0.8, 0.6)),
            Setting(f_cut=50e3, formulation="penalty", **implicit),
            Setting(f_cut=50e3, rows="node-to-segment", **implicit),
            *(Setting("residual", f, **implicit) for f in (50e3, 100e3)),
        ]
    )
    record.tolerances((1e-1, 1e-2, 1e-3))
    scene.own(record, 1e-6, (1e4, 3e4, 1e5))
    record.settings([Setting(basis, 100e3) for basis in measure.WITH_MASS])
    record.add("full FE, explicit", "full FE", scene.explicit)
    measure.finish(record)


if __name__ == "__main__":
    main()
