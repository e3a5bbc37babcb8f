"""A body that falls onto another along z: by this library, by the full FE model, and by Exudyn's own methods."""

import functools
import math
import time
from dataclasses import dataclass, field, replace

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np

import exudyn_partition as ep
from validation import exudyn_own
from validation.error_against_time import measure

Z = 2
RADIUS = 0.1e-3  # of the spheres of GeneralContact [m]


@dataclass(eq=False)
class TwoBodies:
    """Slave above, which falls, and master below, touching at the origin.

    Parameters
    ----------
    name : str
    build : callable
        Element size and patch radius, both relative to the scene's -> ((FE model, partition), ...)
    speed, duration, step : float
        Approach [m/s], time [s], the reference's step [s].
    far_ends : two (3,) points
        Where velocities are compared [m].
    radii : two floats
        Of curvature, for Hertz [m].
    """

    name: str
    build: object
    speed: float
    duration: float
    step: float
    far_ends: tuple
    radii: tuple
    before_s: float = field(default=0.0, init=False)  # of reductions that are not part of a run [s]

    def __post_init__(self):
        self.models = self.build()
        self.order = (0, 1) if measure.finer_first(self.models) else (1, 0)  # the finer one first
        self.default = measure.Setting()

    @property
    def fe_dofs(self):
        """Of both FE models."""
        return sum(fem.n_dofs for fem, _ in self.models)

    def about(self):
        """What the FE models are."""
        return measure.about(self.models)

    def finer(self):
        """Return the scene with smaller elements."""
        return replace(self, build=functools.partial(self.build, size=0.7))

    @property
    def points(self):
        """Names of the far ends, with the body's number."""
        return {name: (i, x) for i, (name, x) in enumerate(zip(("slave", "master"), self.far_ends, strict=True))}

    def full(self):
        """Return both full FE models, moving."""
        velocities = ((0, 0, -self.speed), (0, 0, 0))
        return [ep.reference.FullBody(*m, velocity=v) for m, v in zip(self.models, velocities, strict=True)]

    def reference(self, step):
        """The full FE model under integrated rows."""
        with ep.progress(f"{self.name}, full FE, {1e6 * step:g} us") as report:
            return ep.reference.simulate(
                self.full(), end_time=self.duration, step=step, points=self.points, progress=report
            )

    def full_memory(self):
        """Of the full FE model [MB]."""
        return measure.full_memory(self.models, self.step)

    def reduced(self, setting):
        """Return both bodies as a setting asks for them."""
        models = self.models if setting.region == 1.0 else self.build(region=setting.region)
        return [ep.reduce(*model, basis=setting.basis, f_cut=setting.f_cut) for model in models]

    def reduced_to(self, tolerance):
        """Return both bodies as the library chooses them."""
        return ep.reduce_pair(*self.models, tolerance=tolerance, speed=self.speed, duration=self.duration)

    def assemble(self, bodies, setting):
        """Return the model, both bodies in it, and their contact."""
        mbs = exu.SystemContainer().AddSystem()
        slave = ep.CreatePartitionBody(mbs, bodies[0], name="slave", initialVelocity=[0, 0, -self.speed])
        master = ep.CreatePartitionBody(mbs, bodies[1], name="master")
        contact = ep.CreatePartitionContact(mbs, slave, master, formulation=setting.contact, rows=setting.rows)
        mbs.Assemble()
        return mbs, (slave, master), contact

    def simulate(self, bodies, setting):
        """History of a run of the library."""
        mbs, pair, contact = self.assemble(bodies, setting)
        step = setting.step
        short = setting.contact == "lagrange" and setting.method == "explicit"
        with ep.progress(f"{self.name}, {setting}") as report:
            result = ep.solve_dynamic(
                mbs, end_time=self.duration, step=step, method=setting.method,
                sample_period=self.step if short else None, progress=report,
            )  # fmt: skip
        return result.history(contact, {name: (pair[i], x) for name, (i, x) in self.points.items()})

    def explicit(self):
        """The full FE model, lumped, by the paper's explicit scheme: time of a step times the number of steps."""
        mbs, *_ = self.assemble(measure.lumped(self.models), _Lagrange)
        return None, measure.explicit_cost(mbs, self.duration)

    def hertz_stiffness(self):
        """Of Hertz' force over approach^(3/2) [N/m^(3/2)]."""
        moduli = [fem.material.plane_strain_modulus for fem, _ in self.models]
        return 4 / 3 / sum(1 / E for E in moduli) / math.sqrt(sum(1 / R for R in self.radii))

    def rigid_hertz(self, step):
        """Rigid bodies with Hertz' force."""
        mbs, markers = exu.SystemContainer().AddSystem(), []
        for (fem, _), speed in zip(self.models, (-self.speed, 0.0), strict=True):
            body = mbs.AddObject(
                items.MassPoint(
                    mass=fem.total_mass,
                    nodeNumber=mbs.AddNode(items.Point(initialVelocities=[0, 0, speed])),
                )
            )
            markers.append(mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=body)))
        sensor = exudyn_own.add_hertz(mbs, markers[::-1], Z, self.hertz_stiffness())
        return self._own_history(mbs, sensor, Z, step, 6), {"offline_s": 0.0, "memory_MB": 0.0}

    @functools.cache  # noqa: B019 scenes live as long as their script
    def cms(self, modes, craig_bampton):
        """Both bodies' modes by Exudyn, and the time of their computation [s]."""
        found, begin = [], time.perf_counter()
        for (fem, partition), end in zip(self.models, self.far_ends, strict=True):
            far = np.argsort(np.linalg.norm(fem.points - end, axis=1))[:40]
            found.append(exudyn_own.cms(fem, modes, [far, partition.patch_nodes] if craig_bampton else ())[0])
        return found, time.perf_counter() - begin

    def _cms_model(self, modes, craig_bampton, shift=0.0):
        models, offline_s = self.cms(modes, craig_bampton)
        mbs = exu.SystemContainer().AddSystem()
        bodies = [
            exudyn_own.add_cms(mbs, model, velocity=[0, 0, -speed], position=[0, 0, place])
            for model, speed, place in zip(models, (self.speed, 0.0), (shift, 0.0), strict=True)
        ]
        shapes = [model.modeBasis["matrix"] for model in models]
        more = {"offline_s": offline_s, "memory_MB": sum(2 * s.nbytes for s in shapes) / 1e6, "modes": modes}
        return mbs, bodies, sum(6 + s.shape[1] for s in shapes), more

    def modal_hertz(self, modes, step):
        """Floating frame bodies with free modes, and Hertz' force between the means of their patches."""
        mbs, bodies, dofs, more = self._cms_model(modes, False)
        markers = []
        for (fem, partition), (body, _) in zip(self.models, bodies, strict=True):
            near = partition.patch_nodes
            near = near[np.argsort(np.linalg.norm(fem.points[near], axis=1))[:3]]
            place = fem.points[near].mean(axis=0)[Z]
            markers.append((place, mbs.AddMarker(items.MarkerSuperElementPosition(
                bodyNumber=body, meshNodeNumbers=[*map(int, near)], weightingFactors=[1 / 3] * 3
            ))))  # fmt: skip
        gap = markers[0][0] - markers[1][0]  # of nodes beside the pole
        sensor = exudyn_own.add_hertz(mbs, [m for _, m in markers[::-1]], Z, self.hertz_stiffness(), gap)
        return self._own_history(mbs, sensor, Z, step, dofs), more

    def facet_contact(self, modes, craig_bampton, stiffness, step):
        """Floating frame bodies, and GeneralContact between nodes of the finer patch and facets of the other."""
        mbs, bodies, dofs, more = self._cms_model(modes, craig_bampton, shift=RADIUS)
        (slave, node), (master, _) = (bodies[i] for i in self.order)
        (_, fine), (fem, coarse) = (self.models[i] for i in self.order)
        contact = exudyn_own.add_facet_contact(
            mbs, (slave, fine.patch_nodes), (master, fem.points, coarse.patches[0].facets), RADIUS, stiffness,
            (-3e-3, -3e-3, -2e-3), (3e-3, 3e-3, 2e-3),
        )  # fmt: skip
        sensor = exudyn_own.sense_facet_contact(mbs, contact, node, Z)
        return self._own_history(mbs, sensor, 0, step, dofs), more | {"stiffness_N_per_m": stiffness}

    def _own_history(self, mbs, sensor, column, step, dofs):
        mbs.Assemble()
        t, force, time_s = exudyn_own.solve(mbs, sensor, self.duration, step)
        n = len(t) - 1
        info = {"time_s": time_s, "step_s": step, "steps": n, "dofs": dofs}
        return ep.History(t, abs(force[:, column]), {}, info)


class _Lagrange:
    contact, rows = "lagrange", None
