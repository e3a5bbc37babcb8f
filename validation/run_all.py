"""Run the validation: each case in a process of its own; results as JSON, figures, report.md and report.html.

A case is a module of this folder. Its docstring states reference, quantity and limits. It exits with an error if a
limit is missed. If the folder has a case's result for this commit, the case is not run again. The list below says how
to run each case and how to read its headline numbers.

    python validation/run_all.py [--quick] [--only NAME ...] [--out DIR] [--jobs N] [--cluster ADDRESS] [--again]

`--quick` runs the cases that are done within minutes. A case's time limit counts processor time, of all its processes,
so that a machine with other work does not end it. Run times are meaningful only with one job on a quiet machine.
"""

import argparse
import base64
import concurrent.futures
import contextlib
import datetime
import hashlib
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jinja2
import psutil
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
TEMPLATES = HERE
HOUR, QUICK_LIMIT = 3600.0, 180.0  # limits of a case's processor time [s]
STALL = 600.0  # for which a case may use no processor time before it counts as hanging [s]
SKIPPED = "skipped:"  # start of the last line of a script that ends without error because something it needs is missing
ANSWERS = {True: "yes", False: "NO", None: "skipped"}


@dataclass(frozen=True)
class Row:
    """A headline number: quantity, reference, limit and result; `at_most` says how limit and result compare."""

    quantity: str
    reference: str
    limit: float
    result: float
    at_most: bool = True

    @property
    def agrees(self):
        """Whether the result is within its limit."""
        return abs(self.result) <= self.limit if self.at_most else self.result >= self.limit


@dataclass(frozen=True)
class Case:
    """A script, how to read its headline numbers, its arguments in a quick run (None: not in it) and in a full one.

    `{out}` in the arguments is the folder of the report: results of quick runs that hold less than the full go there.
    """

    script: str
    rows: Callable
    quick: tuple | None = None
    figures: tuple = ()  # that it draws
    full: tuple = ()
    limit_s: float = HOUR

    def result(self, arguments):
        """Path of the JSON that the script writes when called so."""
        if "--out" in arguments:
            return Path(arguments[arguments.index("--out") + 1])
        return HERE / Path(self.script).with_suffix(".json")


def stability(d):
    return [Row(f"{d['cases']} stiff and extreme cases: rows that do not hold", "stated in each", 0,
                len(d["beyond_limits"]))]  # fmt: skip


def misuse(d):
    return [Row(f"{d['tried']} wrong inputs: raw, silent, hang or crash", "a named error or a warning", 0,
                len(d["beyond_limits"]))]  # fmt: skip


def paper(d):
    """Rows that are judged. Disagreements that are understood are in the table below, with the reason."""
    judged = [r for r in d["rows"] if r["limit"] is not None and not (r["known"] and not r["agrees"])]
    return [Row(r["what"], r["paper"], r["limit"], r["deviation"]) for r in judged]


def memory(d):
    """For estimates of a peak, the factor by which they are too large or too small."""
    peaks = [
        Row(f"memory of a reduction, {k} elements a radius: estimate", "peak", 1.5, max(c["ratio"], 1 / c["ratio"]))
        for k, c in d["peaks"].items()
    ]
    kept = [Row("memory kept by three reductions [MB]", "none", 50, d["leak"]["growth_MB"])] if d["leak"] else []
    return peaks + kept


def rod_on_plate(d):
    limits = {"force": 0.010, "velocity_p1": 0.008, "velocity_p2": 0.030}
    error = d["cases"]["contact-adapted, explicit"]["error"]
    return [Row(f"{k}, default basis", "full FE model", limit, error[k]) for k, limit in limits.items()]


def unresolved(d):
    found = {}
    for scene, of_scene in d["scenes"].items():
        by_law = [row for row in of_scene["rows"] if row["formulation"] == "hertz"]
        found[scene] = max(abs(row[what]) for row in by_law for what in ("peak", "impulse", "duration"))
    friction = d["friction"]
    found["oblique"] = max(abs(row["impulse"]) for row in friction["oblique"])
    found |= {what: friction[what] for what in ("rolling", "rest")}
    if "seams" in d:
        found["energy"] = max(row["energy"] for row in d["seams"])
    maw = "Maw, Barber and Fawcett, whole sphere; refined patches"
    said = {
        "energy": "energy at the start, of a body that tumbles over seams",
        "oblique": maw,
        "rolling": "weight",
        "rest": "weight",
    }
    reference = "series of spheres, refined patches"
    return [
        Row(f"contact that the mesh does not resolve, {what}: worst", said.get(what, reference), d["limits"][what], off)
        for what, off in found.items()
    ]


def hertz(d):
    static = d["static"]["node-to-segment"]["pressure_L2"]
    return [
        Row("quantities beyond limits", "Hertz, series for whole spheres", 0, len(d["beyond_limits"])),
        Row("static pressure (L2)", "Hertz", d["limits"]["static"], static),
    ]


def bars(d):
    rows = []
    for name, c in d["cases"].items():
        top = max(r["f_cut_Hz"] for r in c["runs"])
        runs = [r for r in c["runs"] if r["f_cut_Hz"] == top and r["solver"] == "explicit"]
        for q, limit in d["limits"].items():
            rows.append(Row(f"{name}: {q}", "Saint-Venant", limit, max(abs(r["error"][q]) for r in runs)))
    return rows


def patch_test(d):
    way = d["cases"]["fine"]["ways"]["integrated, finer"]
    pressures = {key: value for key, value in way.items() if key.endswith("L2")}
    return [
        Row("quantities beyond limits", "uniform pressure", 0, len(d["beyond_limits"])),
        *(Row(key, "uniform pressure", d["limits"]["pressure"], value) for key, value in pressures.items()),
    ]


def oblique(d):
    best = d["runs"][-1]["deviation"]
    return [Row(f"change of {key}", "conservation", limit, best[key]) for key, limit in d["limits"].items()]


def bouncing(d):
    return [
        Row("change of energy", "conservation", d["limits"]["energy"], d["energy"]),
        Row("impacts", "asked for", d["limits"]["impacts"], d["impacts"], at_most=False),
    ]


def bouncing_bar(d):
    return [Row(key, "Doyen, Ern, Piperno", d["limit"], error) for key, error in d["runs"][-1]["error"].items()]


def ringing(d):
    limits = d["limits"]
    return [
        Row("mean force while it rings", "Saint-Venant", limits["force"], max(abs(r["force"]) for r in d["runs"])),
        Row("energy of a whole flat face", "conservation", limits["block_energy"],
            max(abs(b["energy"]) for b in d["blocks"] if b["default"])),
    ]  # fmt: skip


def lasting(d):
    limits, each = d["limits"], {row["name"]: row for row in d["scenes"]}
    timed = ("valve", "block", "crank slider")
    rest = max(abs(row["now"]["rest_error"]) for row in d["scenes"])
    return [
        *(Row(f"{name}: time", "steps of an impact", limits[name], each[name]["time"]) for name in timed),
        Row("pressed: steps", "", limits["steps"], each["pressed"]["now"]["steps"]),
        Row("first impacts", "steps of an impact", limits["impulse"], max(row["impulse"] for row in d["scenes"])),
        Row("force at rest", "weight and spring", limits["rest"], rest),
    ]


def formulations(d):
    own = [c for c in d["cases"] if c["formulation"] == "compliance"]
    worst = max(own, key=lambda c: abs(c["impulse"]))
    return [Row("impulse, compliance", "full FE model", d["limits"]["compliance"][0], worst["impulse"])]


def markers(d):
    top = min(c["error"] for c in d["frequencies"]["cases"])
    return [
        Row("frequencies of the hinged body", "full FE model", d["limit"], top),
        Row("tip of the pendulum", "Exudyn's FFRF", d["limit"], max(c["tip_error"] for c in d["pendulum"]["cases"])),
        Row("force in a joint", "inertial frame", d["limit"], d["force_near_zero_rotation"]["error"]),
    ]


def exudyn_examples(d):
    """Stated limits, or what half the step changes, and what other modes change; what the body tells is not judged."""
    compared = [row for row in d["rows"] if "error" in row]  # the others must be refused
    rows = [
        (": ".join([", ".join(row[key] for key in ("scene", "idiom") if key in row), name]), row, name)
        for row in compared
        for name in row["limits"]
        if name not in row.get("told", ())
    ]

    def limit(row, name):
        unresolved, by_modes = (row.get(key, {}).get(name, 0.0) for key in ("unresolved", "by_modes"))
        return max(row["limits"][name], unresolved) + by_modes

    return [Row(title, "Exudyn's FFRF", limit(row, name), row["error"][name]) for title, row, name in rows]


def ordering(d):
    return [
        Row(f"time of factors, {n}", "SuperLU in its best order", d["limit"], c["factors"])
        for n, c in d["cases"].items()
    ]


def damping(d):
    rows = [Row(f"{k} of a damped mode", "one mode", d["limit"], found) for k, found in d["worst"].items()]
    return [*rows, Row("ratios of held strips", "those given", d["held"]["limit"], d["held"]["worst"])]


def limits(units):
    """Headline numbers of scripts whose JSON has `found` and `limits` of the same names."""

    def rows(d):
        found = d.get("found", d)
        return [Row(k, "stated limit", v, found[k], k in units) for k, v in d["limits"].items() if k in found]

    return rows


def experiment(d):
    return [Row(name, "see its docstring and data", limit, d["found"][name]) for name, limit in d["limits"].items()]


def gears(d):
    shown = limits(("transmission", "shares", "iso_stiffness", "impact_force", "impact_impulse"))(d)
    asked, quicker = d["faster_asked"], d["faster_than_explicit"]
    return [*shown, Row("steps on-line are quicker by", "explicit full FE steps", asked, quicker, at_most=False)]


def error_against_time(d):
    return [Row(n, "full FE model", r["tolerance"], r["error"]["force"]) for n, r in d["runs"].items() if r["kind"] ==
            "tolerance" and r["tolerance"] >= 0.01]  # fmt: skip


def pareto(d):
    rows, limits = [], d["limits"]
    for name, scene in d["scenes"].items():
        for tolerance, found in scene["tolerances"].items():
            if found["tolerance"] >= 0.01:
                rows += [
                    Row(
                        f"{name}, {tolerance}: {time} time over the quickest",
                        "runs with no larger error",
                        limits["tolerance"],
                        found["over"][time]["ratio"],
                    )
                    for time in ("on-line", "together")
                ]
        for key, limit in (("faster", "faster than CMS"), ("less_error", "less error than CMS")):
            worst = min(found[key] for found in scene["against_cms"].values())
            rows.append(Row(f"{name}: times {limit}", "Exudyn, GeneralContact", limits[limit], worst, at_most=False))
    return rows


EXPERIMENTS = (
    "tilted_bar",
    "zener",
    "ball_on_beam",
    "kharaz",
    "chung_ooi",
    "granular_chain",
    "sdnl111",
    "cgs1",
    "cgs4",
    "lame",
)  # scripts of experiments/
SCENES = ("rod_on_plate", "block_on_block", "two_spheres", "crank_slider")  # of error_against_time
CUT = ("explicit", "multipliers", "floating", "zones", "implicit")  # kinds of cut_runs
CASES = {
    "stability": Case("stability/stability.py", stability, ("--quick", "--out", "{out}/stability_quick.json")),
    "compiled_scenes": Case("stability/compiled_runs.py", limits(("difference",)),
                            ("--count", "40", "--out", "{out}/compiled_scenes.json")),
    "rubbing_scenes": Case("stability/rubbing_runs.py", limits(("difference", "on each other")),
                           ("--count", "12", "--out", "{out}/rubbing_scenes.json")),
    "sensitivities": Case("stability/sensitivities.py", limits(("difference",)),
                          ("--count", "20", "--out", "{out}/sensitivities.json")),
    "random_scenes": Case("stability/random_scenes.py", limits(("unexplained",)),
                          ("--count", "40", "--out", "{out}/random_scenes.json")),
    "cut_runs": Case(
        "stability/cut_runs.py",
        limits([f"{kind}, {what}" for kind in CUT for what in ("next", "until the end")]),
        ("--count", "12", "--out", "{out}/cut_runs.json"),
    ),
    "misuse": Case("stability/misuse.py", misuse, quick=()),
    "paper": Case("paper/paper.py", paper, ("--quick", "--out", "{out}/paper_quick.json"),
                  ("paper_fig6.png", "paper.png", "paper_fig11.png", "paper_crank_slider.png")),
    "calculix_spheres": Case("calculix/spheres.py", limits(("force", "peak", "impulse", "contact-adapted")),
                             ("--quick", "--out", "{out}/calculix_spheres.json"), ("calculix_spheres.png",)),
    "calculix_oblique": Case("calculix/oblique.py", limits(("normal", "tangential")),
                             figures=("calculix_oblique.png",)),
    "calculix_plastic": Case("calculix/plastic.py", limits(("force", "restitution")),
                             figures=("calculix_plastic.png",)),
    "calculix_rod_on_plate": Case("calculix/rod_on_plate.py", limits(("force", "dofs")),
                                  figures=("calculix_rod_on_plate.png",)),
    "patch_test": Case("contact/patch_test.py", patch_test, quick=(), figures=("contact_patch_test.png",)),
    "contact_evaluation": Case("benchmarks/contact_evaluation.py", limits(("frozen", "moving")), quick=()),
    "many_contacts": Case("benchmarks/many_contacts.py",
                          limits(("growth", "closed_us", "open_us", "symmetry")), quick=()),
    "outside_steps": Case("benchmarks/outside_steps.py", limits(("one_ms", "fifty", "creation")), quick=()),
    "unresolved": Case("contact/unresolved.py", unresolved, ("--quick", "--out", "{out}/unresolved_quick.json")),
    "hertz": Case("contact/hertz.py", hertz, figures=("contact_hertz.png",)),
    "bars": Case("contact/bars.py", bars, figures=("contact_bars.png",)),
    "sliding": Case("contact/sliding.py", lambda d: [Row("ways beyond the ripple's limit", "smooth force", 0,
                    len(d["beyond_limits"]))], figures=("contact_sliding.png",)),
    "sharp_edges": Case("contact/sharp_edges.py", limits(
        ("depth", "impulse", "energy", "full FE", "pressure, plane", "pressure, bar")),
                        figures=("contact_sharp_edges.png",)),
    "oblique": Case("contact/oblique.py", oblique),
    "bouncing": Case("contact/bouncing.py", bouncing),
    "energy_floor": Case("contact/energy_floor.py", limits(("unexplained", "rigid", "layer")), quick=()),
    "bouncing_bar": Case("contact/bouncing_bar.py", bouncing_bar, figures=("contact_bouncing_bar.png",)),
    "ringing": Case("contact/ringing.py", ringing),
    "lasting": Case("contact/lasting.py", lasting),
    "formulations": Case("contact/formulations.py", formulations),
    "friction_half_space": Case("friction/half_space.py", limits(("maw", "force", "stick_radius", "loss")), quick=(),
                                figures=("friction_half_space.png",)),
    "friction_random_starts": Case("friction/random_starts.py", limits(("failures", "violation", "newton_steps"))),
    "friction_stacks": Case("friction/stacks.py", limits(
        ("two", "two_turned", "three", "three_turned", "table_s", "forces", "table_forces", "rest", "still",
         "failures", "no_rest", "weights", "cone"))),
    "friction_motion": Case("friction/motion.py", limits(
        ("slope_1", "slope_0.1", "slope_0.01", "belt", "rolls_after", "rolls_at", "spin", "drum_after", "drum_at")),
        quick=()),
    "friction_two_balls": Case("friction/two_balls.py", limits(("maw",)), figures=("friction_two_balls.png",)),
    "cam": Case("wandering/cam.py",
                limits(("force", "ripple", "profile_force", "profile_ripple", "lift_off", "friction")),
                figures=("wandering_cam.png",)),
    "gears": Case("wandering/gears.py", gears, figures=("wandering_gears.png",)),
    "skin": Case("wandering/skin.py",
                 limits(("force", "momentum", "energy", "reduce", "memory_GB", "file_MB", "again_s", "step",
                         "bounces_missing", "bounces_run"))),
    "ten_bodies": Case("wandering/ten_bodies.py", limits(("momentum", "energy", "asleep"))),
    "large_patch": Case("benchmarks/large_patch.py", limits(("memory_GB", "file_MB", "ratio"))),
    "huge_body": Case("benchmarks/huge_body.py", limits(("memory_GB", "frequencies"))),
    "thin_patch": Case("benchmarks/thin_patch.py", limits(("ratio", "frequency", "mobility"))),
    "friction_at_rest": Case("friction/at_rest.py", limits(("force", "stick_radius", "loss")),
                             figures=("friction_at_rest.png",)),
    "friction_kharaz": Case("friction/kharaz.py", limits(("spin", "energy")), figures=("friction_kharaz.png",)),
    "friction_oblique": Case("friction/oblique.py", limits(
        ("normal", "tangential", "velocity_tip", "energy", "momentum", "ms_a_step", "free_flight")),
        figures=("friction_oblique.png",)),
    "friction_clip": Case("friction/clip.py", limits(("normal", "tangential", "work", "momentum", "turning")), quick=(),
                          figures=("friction_clip.png",)),
    "friction_front": Case("friction/front.py", limits(("tolerance 0.1", "tolerance 0.01", "full_fe_quicker")),
                           figures=("friction_front.png",)),
    "markers": Case("joints/markers.py", markers),
    "exudyn_examples": Case("joints/exudyn_examples.py", exudyn_examples),
    "exudyn_parts": Case("joints/exudyn_parts.py", exudyn_examples),
    "hammer": Case("joints/hammer.py", limits(("hinge", "hinge_peak", "blow")), quick=None),
    "rotation": Case("joints/rotation.py",
                     limits(("angular_momentum", "energy", "angular_velocity", "modal_coordinates"))),
    "growth": Case("joints/growth.py", limits(("bar", "strain", "rim", "gap", "bore", "press_fit", "share_of_reduction",
                                              "file", "run")), quick=()),
    "geometric_stiffness": Case("joints/geometric_stiffness.py",
                                limits(("strut", "strut_with_nodes", "pressed", "flap", "lag", "southwell", "link",
                                        "step_ratio", "iterations", "step_ratio_with_nodes", "iterations_with_nodes")),
                                quick=(),
                                figures=("joints_geometric_stiffness.png",)),
    "damping": Case("inelastic/damping.py", damping),
    "kelvin_voigt": Case("inelastic/kelvin_voigt.py", limits(
        ("restitution", "kuwabara_kono", "peak", "two_balls", "energy", "order"))),
    "statics": Case("inelastic/statics.py", limits(("spheres", "pressure", "stack", "frequencies", "preloaded")),
                    quick=None, figures=("inelastic_statics.png",)),
    "plastic_impact": Case("inelastic/impact.py", limits(("force", "peak", "rebound", "work", "balance")),
                           figures=("inelastic_impact.png",)),
    "plastic_block": Case("inelastic/pressed_block.py", limits(("force", "strain", "sideways", "work")), quick=()),
    "plastic_rod": Case("inelastic/rod_on_plate.py", limits(("force", "peak", "rebound", "work", "dent", "balance")),
                        figures=("inelastic_rod_on_plate.png",)),
    "plastic_front": Case("inelastic/front.py", limits(("tolerance 0.1", "tolerance 0.01", "full_fe_quicker")),
                          figures=("inelastic_front.png",)),
    "plastic_large": Case("inelastic/large.py", limits(("force", "work", "offline", "memory_GB"))),
    "plastic_zones": Case("inelastic/zones.py", limits(
        ("force", "work", "offline_s", "memory_GB", "large_offline_s", "large_GB", "online_by_nodes", "wide_offline",
         "wide_online"))),
    "plastic_settling": Case("inelastic/settling.py", limits(
        ("settling", "step", "mesh: restitution", "mesh: work", "mesh: dent")),
        ("--quick", "--out", "{out}/settling_quick.json")),
    "zone_radius": Case("inelastic/zone_radius.py", limits(("reached", "force"))),
    "plastic_nodes": Case("inelastic/nodal_region.py", limits(("contact-adapted", "all nodes", "balance")), quick=None),
    "indentation": Case("inelastic/indentation.py",
                        limits(("first_yield", "mean_pressure", "work_again", "stiffness", "unloading")),
                        figures=("inelastic_indentation.png",)),
    "plastic_extremes": Case("inelastic/extremes.py", limits(("explicit", "implicit")), quick=()),
    "bearing": Case("wandering/bearing.py", limits(("force", "deflection", "moving", "stribeck", "balance"))),
    "chain": Case("wandering/chain.py", limits(("force", "time", "velocity"))),
    "crank_slider": Case("joints/crank_slider.py", lambda d: []),
    "feminterface": Case("benchmarks/feminterface.py", limits(("difference",))),
    "body_files": Case("benchmarks/body_files.py", limits(("whole", "ball_without_inside", "without_inside"))),
    "large_cad": Case("benchmarks/large_cad.py", limits(("most_off", "over_mesh"))),
    "compiled_runs": Case("benchmarks/compiled_runs.py", limits((
        "steps", "many", "compiled", "difference", "rough_steps", "rough_many", "rough_compiled", "rough_difference",
        "tumbling_steps", "tumbling", "tumbling_difference", "gradient", "rough_gradient", "curved_gradient",
        "tumbling_gradient",
    ))),
    "restitution_map": Case("benchmarks/restitution_map.py", limits(
        ("cpu_s", "balance", "new_over_old", "difference"))),
    "mechanisms": Case("benchmarks/mechanisms.py", limits(("force",))),
    "study": Case("benchmarks/study.py", limits(("loop", "workers"))),
    "second_worker": Case("benchmarks/second_worker.py", limits(())),
    "tilted_bar_refined": Case("experiments/tilted_bar_refined.py", limits(("library", "beam"))),
    "size": Case("benchmarks/size.py", limits(
        ("reduce_s", "memory_GB", "bases_s", "exponent", "spread", "force_error")), limit_s=2 * HOUR),
    "memory": Case("benchmarks/memory.py", memory),
    "earlier": Case("benchmarks/earlier.py", limits(("time", "time_with_extra", "memory_GB"))),
    "ordering": Case("benchmarks/ordering.py", ordering, quick=None),
    **{f"time_{scene}": Case(f"error_against_time/{scene}.py", error_against_time, full=("--again",))
       for scene in SCENES},
    **{name: Case(f"experiments/{name}.py", experiment, ("--quick", "--out", f"{{out}}/{name}_quick.json"),
                  (f"experiments_{name}.png",)) for name in EXPERIMENTS},
    "pareto": Case("pareto.py", pareto, quick=(), figures=tuple(f"pareto_{scene}.png" for scene in SCENES)),
    "rod_on_plate": Case("rod_on_plate.py", rod_on_plate),
    "order": Case("mesh/order.py", limits(("unknowns",))),
    "imports": Case("mesh/imports.py", limits(("volume", "mass", "between_dialects", "faces_wrong", "frequencies",
                                               "longer_than_meshio_s")),
                    ("--quick", "--out", "{out}/imports_quick.json")),
    "row_spacing": Case("mesh/row_spacing.py", limits(("largest_rate", "off_independent")), quick=()),
    "effectivity": Case("mesh/effectivity.py", limits(("largest", "reference"))),
    "promise": Case("mesh/promise.py", limits(("failed", "largest_share"))),
    "correct": Case("mesh/correct.py", limits(())),
    "by_hand": Case("mesh/by_hand.py", limits(("ratio", "dofs", "share", "true_by_estimated"))),
    "design": Case("mesh/design.py", limits(("failed", "largest_share")),
                   ("--quick", "--out", "{out}/design_quick.json"), ("mesh_design.png",)),
}  # fmt: skip


def commit():
    """Commit of the sources, and a mark if Python files differ from it."""

    def git(*arguments):
        run = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, check=False)
        return run.stdout if run.returncode == 0 else b""

    head = git("rev-parse", "--short=12", "HEAD").decode().strip() or "no commit"
    changes = git("diff", "HEAD", "--", "*.py") + git("status", "--porcelain", "-uall", "--", "*.py")
    return head + (f"+{hashlib.sha256(changes).hexdigest()[:8]}" if changes else "")


def run_case(name, out, quick, version):
    """Run one script and return its record; a function of plain values, so that any executor can take it elsewhere.

    Workers on other machines need this folder and `out` under the same paths.
    """
    case, out = CASES[name], Path(out)
    arguments = tuple(a.format(out=out) for a in (case.quick if quick else case.full))
    result = case.result(arguments)
    module = ".".join([HERE.name, *Path(case.script).with_suffix("").parts])
    command = [sys.executable, "-m", module, *arguments]
    started, limit, log = time.time(), QUICK_LIMIT if quick else case.limit_s, out / f"{name}.log"
    with log.open("w") as stream:
        process = subprocess.Popen(
            command, cwd=HERE.parent, stdout=stream, stderr=subprocess.STDOUT, start_new_session=True
        )
        spent_s, late = _watch(process, limit)
        code = None if late else process.returncode
    record = {"name": name, "commit": version, "quick": quick, "time_s": time.time() - started,
              "processor_s": spent_s, "code": code,
              "command": " ".join(["python", "-m", module, *arguments])}  # fmt: skip
    tail = log.read_text(errors="replace").strip().splitlines()
    record["message"] = late or (tail[-1][-300:] if code and tail else "")
    record["skipped"] = tail[-1] if code == 0 and tail and tail[-1].startswith(SKIPPED) else None
    fresh = result.exists() and result.stat().st_mtime >= started - 1
    record["data"] = json.loads(result.read_text()) if fresh and code is not None else None
    for figure in case.figures:
        drawn = ROOT / "out" / figure
        if drawn.exists() and drawn.stat().st_mtime >= started - 1:
            shutil.copy(drawn, out / figure)
    (out / f"{name}.json").write_text(json.dumps(record, indent=1) + "\n")
    return record


def _watch(process, limit):
    """Wait for a script; return its processor time [s], and why it was ended, or an empty string."""
    spent, moved = 0.0, time.monotonic()
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.5)
            return spent, ""
        now = _processor_time(process.pid)
        if now > spent:
            spent, moved = now, time.monotonic()
        late = f"not done after {limit:g} s of processor time" if spent > limit else ""
        if time.monotonic() - moved > STALL:
            late = f"used no processor time for {STALL:g} s"
        if late:
            _end(process)
            return spent, late


def _processor_time(pid):
    """Processor time of a process and of all that it started [s]; zero of one that has ended."""
    spent = 0.0
    with contextlib.suppress(psutil.NoSuchProcess):
        own = psutil.Process(pid)
        for process in (own, *own.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):
                spent += sum(process.cpu_times()[:4])  # its own, and of those that have ended; user and system
    return spent


def _end(process):
    """End a script and the processes that it started."""
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()


def done(name, out, quick, version):
    """Return the record of a case that ran to its end at this commit, else None."""
    path = Path(out) / f"{name}.json"
    if not path.exists():
        return None
    record = json.loads(path.read_text())
    ended = record["code"] is not None and not record.get("skipped")
    return record if ended and (record["commit"], record["quick"]) == (version, quick) else None


def sweep(function, tasks, executor, retries=1):
    """Yield (name, result or exception) as calls end; one whose worker died is called again, up to `retries` times.

    Parameters
    ----------
    function : callable
    tasks : dict of str to tuple
        Name -> arguments of a call.
    executor : concurrent.futures.Executor
        Also a Dask cluster's, `Client.get_executor()`. One that a dead worker breaks, as a ProcessPoolExecutor, ends
        all of its calls; a cluster's lives on.
    """
    left = {executor.submit(function, *arguments): (name, retries) for name, arguments in tasks.items()}
    while left:
        ended, _ = concurrent.futures.wait(left, return_when=concurrent.futures.FIRST_COMPLETED)
        for future in ended:
            name, again = left.pop(future)
            error = future.exception()
            if error is not None and again:
                try:
                    left[executor.submit(function, *tasks[name])] = name, again - 1
                    continue
                except RuntimeError as broken:  # the executor accepts no more calls
                    error = broken
            yield name, future.result() if error is None else error


def executor_of(options):
    if options.cluster is None:
        return concurrent.futures.ThreadPoolExecutor(options.jobs)  # each thread waits for a process
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise SystemExit("--cluster needs Dask: pip install 'exudyn-partition[cluster]'") from error
    return Client(options.cluster).get_executor()


def headline(record):
    """Rows of a record: (quantity, reference, limit, result, agrees); agrees is None for what was skipped."""
    if record.get("skipped"):
        return [("not run", "", "", record["skipped"], None)]
    name, rows = record["name"], []
    if record["data"] is not None:
        try:
            rows = [(r.quantity, r.reference, r.limit, r.result, r.agrees) for r in CASES[name].rows(record["data"])]
        except (KeyError, IndexError, TypeError, ValueError) as error:
            rows = [("headline numbers", "the list in run_all.py", "", f"not readable: {error!r}", False)]
    ending = "within its limits" if record["code"] == 0 else record["message"] or f"exit code {record['code']}"
    return [*rows, ("the script's own limits", "stated at its top", "", ending, record["code"] == 0)]


def figure_of(value):
    return f"{value:.3g}" if isinstance(value, int | float) else str(value)


def report(records, out, version):
    """Write report.md and report.html, which needs no other file."""
    when = datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    versions = ", ".join(f"{k} {v}" for k, v in ep.versions().items())
    machine = f"{os.cpu_count()} CPUs, {platform.platform()}"
    facts = [f"Commit {version}, {when}", f"Machine: {machine}", f"Versions: {versions}"]
    head = ("case", "quantity", "reference", "limit", "result", "agrees")
    rows = [
        (r["name"], q, reference, figure_of(limit), figure_of(value), ANSWERS[agrees])
        for r in records
        for q, reference, limit, value, agrees in headline(r)
    ]
    runs = [(r["name"], f"`{r['command']}`", f"{r['time_s']:.0f} s") for r in records]
    md = ["# Validation", "", *(f"{fact}  " for fact in facts), "", *_markdown(head, rows), ""]
    sections = []
    for record in records:
        tables = (record["data"] or {}).get("tables", {})
        figures = [out / f for f in CASES[record["name"]].figures if (out / f).exists()]
        if record["name"] == "stability" and record["data"]:
            tables = {"Stiff and extreme cases": extreme(record["data"])}
        if not tables and not figures:
            continue
        md += [f"## {record['name']}", ""]
        for title, table in tables.items():
            md += [title, "", *_markdown(*table), ""]
        for figure in figures:
            md += [f"![{figure.stem}]({figure.name})", ""]
        encoded = [(figure.stem, base64.b64encode(figure.read_bytes()).decode()) for figure in figures]
        sections.append({"name": record["name"], "tables": tables, "figures": encoded})
    md += ["## Runs", "", *_markdown(("case", "command", "time"), runs)]
    (out / "report.md").write_text("\n".join(md) + "\n")
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True)
    environment.filters["shown"] = lambda value: str(value).strip("`")
    page = environment.get_template("report.html").render(
        facts=facts, head=head, rows=rows, sections=sections, runs=runs
    )
    (out / "report.html").write_text(page, encoding="utf-8")
    return rows


def extreme(data):
    """Head and rows of the table of stiff and extreme cases."""
    rows = []
    for r in data["rows"]:
        worst = max(r["checks"].items(), key=lambda c: c[1]["value"] / (c[1]["limit"] or 1e-300), default=None)
        found = r["error"] or ", ".join(r["warnings"])
        if worst and not found:
            found = f"{worst[0]} {worst[1]['value']:.2g} (limit {worst[1]['limit']:.2g})"
        if not r["passed"]:
            found = "; ".join(r["beyond"])
        rows.append((r["case"], r["method"], r["must"], found, "yes" if r["passed"] else "NO"))
    return ("case", "integrator", "must hold", "nearest to its limit, or how it stopped", "holds"), rows


def _markdown(head, rows):
    def line(cells):
        return "| " + " | ".join(str(c).replace("|", "\\|") for c in cells) + " |"

    return [line(head), line(["---"] * len(head)), *map(line, rows)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the cases that are done within minutes")
    parser.add_argument("--only", nargs="+", choices=CASES, help="these cases")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "validation_report")
    parser.add_argument("--jobs", type=int, default=1, help="scripts at a time; run times then mean little")
    parser.add_argument("--cluster", help="address of a Dask scheduler to run the scripts on")
    parser.add_argument("--again", action="store_true", help="run also what is done for this commit")
    options = parser.parse_args()
    out, version, console = options.out.resolve(), commit(), Console(width=150)
    out.mkdir(parents=True, exist_ok=True)
    names = [n for n, c in CASES.items() if (not options.quick or c.quick is not None)]
    names = [n for n in options.only or names if n in names]
    records = {} if options.again else {n: r for n in names if (r := done(n, out, options.quick, version))}
    tasks = {n: (n, str(out), options.quick, version) for n in names if n not in records}
    for name in records:
        console.print(f"{name}: done for {version}")
    with ep.progress("validation") as bar, executor_of(options) as executor:
        for name, record in sweep(run_case, tasks, executor):
            if isinstance(record, Exception):
                record = {"name": name, "commit": version, "quick": options.quick, "time_s": float("nan"), "code": None,
                          "command": CASES[name].script, "message": f"no result: {record!r}", "data": None}  # fmt: skip
            records[name] = record
            bar(len(records) / len(names))
            end = "done" if record["code"] == 0 else record["message"] or f"exit code {record['code']}"
            end = record.get("skipped") or end
            console.print(f"{name}: {end}, {record['time_s']:.0f} s", markup=False)
    rows = report([records[n] for n in names], out, version)
    table = Table("case", "quantity", "reference", "limit", "result", "agrees", title=f"validation, {version}")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    console.print(f"{out / 'report.md'}, {out / 'report.html'}", markup=False)
    failed = [n for n in names if records[n]["code"] != 0]
    sys.exit(f"failed: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
