"""The runs that the scenes here share. Each is stored as soon as it is done, so that an interrupted script can go on.

Quantity: relative L2 error of the contact force over the scene's duration (`ep.compare`); time of reduction (off-line)
and of the solver alone (on-line); coordinates; memory. Rows are integrated, the library's default, but with multipliers
they are node-to-segment. The reference has integrated rows. So the errors of multipliers include the difference of the
rows, and one run measures this difference. Memory is that of arrays that are kept on-line: those of both bodies, or
matrices and factors of the full FE model.
"""

import argparse
import json
import math
import os
import platform
import sys
import time
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.algebra.sparse.multifrontal import Factorisation

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "out" / "error_against_time"
REPEAT = 20, 1.0  # number of on-line runs, or their total time [s]: the shortest time counts
WITH_MASS = ("free", "craig-bampton")  # bases whose patch has mass
EXPLICIT_STEPS = 200  # of the full FE model, to measure the time of a step
NUMBERS = ("step_s", "steps", "dofs", "time_s")


@dataclass(frozen=True)
class Setting:
    """Options of a run of the library."""

    basis: str = "contact-adapted"
    f_cut: float = 40e3  # [Hz]
    formulation: str = ""  # default: by the basis
    method: str = "explicit"
    step: float | None = None  # [s]; default: the library's
    region: float = 1.0  # radius of impact region and patch over the scene's
    rows: str | None = None

    @property
    def contact(self):
        """The formulation."""
        return self.formulation or ("lagrange" if self.basis in WITH_MASS else "compliance")

    def __str__(self):
        words = [self.basis, f"{1e-3 * self.f_cut:g} kHz", self.formulation, self.rows or ""]
        words += [self.method] if self.method != "explicit" else []
        words += [f"{1e6 * self.step:g} us"] if self.step else []
        words += [f"patch x {self.region:g}"] if self.region != 1.0 else []
        return ", ".join(w for w in words if w)


class Record:
    """The runs of a scene in its JSON file; `add` measures what it lacks."""

    def __init__(self, scene, path, again=False):
        self.scene, self.path = scene, path
        self.data = {} if again or not path.exists() else json.loads(path.read_text())
        self.data.setdefault("runs", {})
        self.data |= {"scene": scene.name, "duration_s": scene.duration, "model": scene.about()}
        self.data["machine"] = {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()}
        self.reference = self._reference(scene.step, again)
        self.console = Console(width=150)

    def _reference(self, step, again):
        """History of the full FE model, kept in out/ for the next call with the same mesh and versions."""
        path = KEPT / f"{self.scene.name.replace(' ', '_')}_{1e9 * step:.0f}_ns.npz"
        if path.exists() and not again:
            history = ep.History.load(path)
            if history.info["dofs"] == self.scene.fe_dofs and history.info["versions"] == ep.versions():
                return history
        history = self.scene.reference(step)
        history.info["versions"] = ep.versions()
        KEPT.mkdir(parents=True, exist_ok=True)
        history.save(path)
        return history

    def add(self, name, kind, function, **about):
        """Measure a run if it is not there: `function` returns a history, or None, and what else is to be stored.

        The status says if the library refuses a run, or if the run ends early.
        """
        if name in self.data["runs"]:
            return
        try:
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always", ep.errors.PartitionWarning)
                warnings.simplefilter("ignore", ep.errors.YieldWarning)  # compared with elastic bodies
                history, more = function()
            entry = {"status": "finished", **more}
            if history is not None:
                entry |= {key: history.info[key] for key in NUMBERS if key in history.info}
                entry["online_s"] = entry.pop("time_s")
                entry["status"] = history.info.get("status", "finished")
                known = {name: self.reference.velocity[name] for name in history.velocity}
                entry["error"] = ep.compare(history, replace(self.reference, velocity=known)).error
                entry |= {"peak_force_N": history.peak_force, "impulse_Ns": history.impulse}
                entry["warnings"] = [str(w.message) for w in said if issubclass(w.category, ep.errors.PartitionWarning)]
        except ep.errors.PartitionError as problem:
            entry = {"status": "failed", "message": str(problem)}
        self.data["runs"][name] = {"kind": kind, **about, **entry}
        self.write()
        error = entry.get("error", {}).get("force", float("nan"))
        self.console.print(
            f"{name:60} {entry['status']:9} {entry.get('dofs', 0):6} dofs, force {error:8.3%}, off-line "
            f"{entry.get('offline_s', 0):6.1f} s, on-line {entry.get('online_s', 0):8.3g} s", highlight=False
        )  # fmt: skip

    def write(self):
        """Write the JSON file."""
        self.path.write_text(json.dumps(self.data, indent=1, default=float) + "\n")

    def full_models(self, factors=(2, 4, 8, 16)):
        """The full FE model: the reference itself, and longer steps, the first of which tells the reference's error."""
        info = self.reference.info
        self.data["reference"] = {k: info[k] for k in ("step_s", "steps", "time_s", "setup_s", "dofs")} | {
            "peak_force_N": self.reference.peak_force, "impulse_Ns": self.reference.impulse
        }  # fmt: skip
        memory = self.scene.full_memory()
        for factor in factors:
            step = factor * self.scene.step

            def run(step=step):
                history = self.scene.reference(step)
                return history, {"offline_s": history.info["setup_s"]}

            self.add(f"full FE, implicit, {1e6 * step:g} us", "full FE", run, memory_MB=memory)

    def settings(self, settings):
        """Runs of the library; bodies are reduced once for all runs that share them."""
        bodies = {}
        for setting in settings:
            key = setting.basis, setting.f_cut, setting.region

            def run(setting=setting, key=key):
                if key not in bodies:
                    bodies[key] = self.scene.reduced(setting)
                return self.library(bodies[key], setting)

            self.add(str(setting), "library", run, **asdict(setting) | {"formulation": setting.contact})

    def library(self, bodies, setting):
        """Run the library's bodies; history, and times."""
        history = self.scene.simulate(bodies, setting)
        times, total_s = REPEAT
        for _ in range(min(times - 1, int(total_s / history.info["time_s"]))):
            again = self.scene.simulate(bodies, setting)
            history.info["time_s"] = min(history.info["time_s"], again.info["time_s"])
        return history, {"offline_s": sum(b.reduce_s for b in bodies), "memory_MB": sum(map(array_bytes, bodies)) / 1e6}

    def tolerances(self, tolerances):
        """Bodies that the library chooses itself."""
        for tolerance in tolerances:

            def run(tolerance=tolerance):
                begin = time.perf_counter()
                bodies = self.scene.reduced_to(tolerance)
                reduce_s, estimate = time.perf_counter() - begin, bodies[0].estimate
                history, more = self.library(bodies, self.scene.default)
                more["offline_s"] = reduce_s + self.scene.before_s
                more["estimate"] = {k: getattr(estimate, k) for k in ("force", "velocity", "f_cut", "f_top", "limit")}
                return history, more

            self.add(f"tolerance={tolerance:g}", "tolerance", run, tolerance=tolerance)

    def own(self, modes, stiffness, steps):
        """Exudyn's own means: Hertz' force on rigid and on modal bodies, GeneralContact on CMS bodies.

        `stiffness` [N/m] of GeneralContact is scanned with the most modes, free ones and Hurty-Craig-Bampton; the best
        is run with the other `steps` [s] too.
        """
        scene, step, n = self.scene, steps[0], modes[-1]
        self.add("rigid, Hertz", "Hertz", lambda: scene.rigid_hertz(step))
        for m in modes:
            self.add(f"{m} free modes, Hertz", "Hertz", lambda m=m: scene.modal_hertz(m, step))

        def cms(shapes, k, step):
            name = f"CMS, {n} {shapes} modes, GeneralContact {k:g} N/m, {1e6 * step:g} us"
            self.add(name, "CMS", lambda: scene.facet_contact(n, shapes != "free", k, step))
            run = self.data["runs"][name]
            return run["error"]["force"] if "error" in run else math.inf, shapes, k

        _, *best = min(cms(shapes, k, step) for shapes in ("free", "Craig-Bampton") for k in stiffness)
        for h in steps[1:]:
            cms(*best, h)

    def mesh(self, setting):
        """What a finer mesh changes in the force, both reduced alike: the mesh's share of the reference's error."""
        if "mesh" in self.data:
            return
        scenes = self.scene, self.scene.finer()
        coarse, fine = (s.simulate(s.reduced(setting), setting) for s in scenes)
        self.data["mesh"] = {
            "fe_dofs": [s.fe_dofs for s in scenes], "setting": str(setting),
            "error": ep.compare(replace(coarse, velocity={}), replace(fine, velocity={})).error["force"],
        }  # fmt: skip
        self.write()


def array_bytes(thing):
    """Bytes of the arrays in a dataclass, with those within it [B]."""
    if isinstance(thing, np.ndarray):
        return thing.nbytes
    if isinstance(thing, dict):
        return sum(map(array_bytes, thing.values()))
    if isinstance(thing, (tuple, list)):
        return sum(map(array_bytes, thing))
    if hasattr(thing, "indptr"):
        return thing.data.nbytes + thing.indices.nbytes + thing.indptr.nbytes
    return array_bytes(vars(thing)) if hasattr(thing, "__dataclass_fields__") else 0


def about(models):
    """What FE models and partitions are."""
    return {
        "fe_nodes": [fem.n_nodes for fem, _ in models],
        "fe_dofs": sum(fem.n_dofs for fem, _ in models),
        "patch_nodes": [len(p.patch_nodes) for _, p in models],
        "resolved_frequency_Hz": [fem.resolved_frequency for fem, _ in models],
    }


def finer_first(models):
    """Whether the first body's patch has the smaller facets, and so is the slave."""
    sizes = [ep.reference.FullBody(*model).surface.facet_size for model in models]
    return bool(sizes[0] <= sizes[1])


def full_memory(models, step):
    """Size of matrices and factors of the full FE models [MB]."""
    total = 0
    for fem, _ in models:
        factors = Factorisation(fem.mass + 0.3 * step**2 * fem.stiffness)
        total += 12 * (fem.stiffness.nnz + fem.mass.nnz + factors.nnz)  # a number and an index each
    return total / 1e6


def lumped(models):
    """Full FE models as bodies whose nodes all keep their mass; joints have no place on them."""
    return [
        ep.reduce(fem, replace(p, nodes=np.arange(fem.n_nodes), interfaces=()), basis="free", f_cut=1e3)
        for fem, p in models
    ]


def explicit_cost(mbs, duration):
    """Time of a step of an assembled full FE model by the paper's explicit scheme, times the number of steps."""
    step = 0.9 * ep.stability_limit(mbs)
    result = ep.solve_dynamic(mbs, end_time=EXPLICIT_STEPS * step, step=step, sample_period=EXPLICIT_STEPS * step)
    steps = math.ceil(duration / step)
    return {
        "status": "extrapolated", "dofs": mbs.systemData.ODE2Size(), "step_s": step, "steps": steps,
        "online_s": result.time_s / result.steps * steps, "offline_s": 0.0, "measured_steps": result.steps,
    }  # fmt: skip


def options(doc):
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--again", action="store_true", help="measure everything anew, the reference too")
    return parser.parse_args()


def finish(record):
    """Exit with a message if a run of the library did not end."""
    record.write()
    runs = record.data["runs"]
    failed = [f"{n}: {r['status']}" for n, r in runs.items() if r["kind"] == "library" and r["status"] != "finished"]
    sys.exit(f"did not end: {'; '.join(failed)}" if failed else 0)
