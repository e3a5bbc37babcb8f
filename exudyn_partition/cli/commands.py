"""Command line: reduce a mesh to a body file, look into one, estimate an impact, run studies, check the installation.

Nothing else in the library prints. Exit codes: 0 done, 1 an error with its message on stderr, 2 a wrong call, 130
interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from .._version import __version__
from ..errors import CallError, InputError, OutputError, PartitionError, PartitionWarning, YieldWarning
from ..fe.material import ALUMINIUM, STEEL, Material
from ..fe.partition import Partition
from ..meshing.mesh_size import Refine
from ..meshing.ngsolve_fem import fe_model
from ..prediction.default_step import STEPS_A_PERIOD
from ..prediction.hertz import effective, impact
from ..reduction.body import ReducedBody, load_body
from ..reduction.reduction import BASES, reduce
from ..support.checks import validate_vector
from ..support.files import writable
from ..support.warn import warn
from .doctor import doctor
from .impact import impact as impact_command
from .printing import show
from .study import add_arguments as add_study_arguments
from .study import study as study_command

Command = Callable[[argparse.Namespace], tuple[int, dict[str, object]]]  # exit code, and what it found

MATERIALS = {"steel": STEEL, "aluminium": ALUMINIUM}
_MATERIAL = "steel, aluminium, or E,nu,rho or E,nu,rho,yield stress [Pa, 1, kg/m3, Pa]"
_EXAMPLES = {
    "": """examples:
  exudyn-partition reduce rod.step --scale 1e-3 --material steel --at 0 0 0 --radius 1e-3 --h 2e-4 --maxh 6e-3 \\
      --f-cut 40e3 -o rod.npz
  exudyn-partition info rod.npz
  exudyn-partition estimate --first 0.0327 0.010 steel --second inf inf aluminium --speed 0.5
  exudyn-partition impact rod.step plate.step --scale 1e-3 --material steel --material aluminium --speed 0.6 \\
      --contact 0,0,0 --tolerance 1e-2 -o out
  exudyn-partition doctor""",
    "reduce": """examples:
  exudyn-partition reduce rod.step --scale 1e-3 --material steel --at 0 0 0 --radius 1e-3 --h 2e-4 --maxh 6e-3 \\
      --f-cut 40e3 -o rod.npz
  exudyn-partition reduce plate.inp --material 70e9,0.33,2700 --at 0 0 0 --radius 1e-3 --tolerance 0.01 --speed 0.6 \\
      -o plate.npz
The file is then read by exudyn_partition.load_body("rod.npz").""",
    "info": """examples:
  exudyn-partition info rod.npz
  exudyn-partition info rod.npz --json""",
    "estimate": """examples:
  a steel ball of 20 mm on a thick aluminium block:
    exudyn-partition estimate --first 0.0327 0.010 steel --second inf inf aluminium --speed 0.5
  a reduced body with a tip of 10 mm radius on something rigid and flat:
    exudyn-partition estimate --first rod.npz 0.010 steel --speed 0.596""",
    "impact": """examples:
  two bodies, placed as they touch, from files in millimetres:
    exudyn-partition impact rod.step plate.step --scale 1e-3 --material steel --material aluminium --speed 0.6 \\
        --contact 0,0,0 --tolerance 1e-2 -o out
  a body on a rigid plane whose outward normal is z:
    exudyn-partition impact ball.step --scale 1e-3 --material steel --speed 0.3 --contact 0,0,0 --normal 0,0,1 -o out
  a part that falls on a rigid floor from half a metre, anyhow turned; its file is in millimetres:
    exudyn-partition impact part.step --drop 0.5 --floor --material 2.3e9,0.37,1050 --turn 20,10,0
The folder then has the reduced bodies, a page, and a script, which runs the impact again.""",
    "study": """examples:
  a grid of 3 x 2 runs of the function impact(speed, friction) of a file, by two processes:
    exudyn-partition study impact.py:impact --grid speed=0.2,0.4,0.6 --grid friction=0,0.1 --workers 2 -o study.jsonl
  64 Sobol points, by an array of ten tasks of Slurm (#SBATCH --array=1-10):
    exudyn-partition study impact.py:impact --between speed=0.2,0.8 --between angle=0,1 --count 64 \\
        --task $SLURM_ARRAY_TASK_ID/10 -o study.jsonl
The last line without --task, when all tasks have ended, puts their runs into study.jsonl, and runs what failed again.
The file is then read by exudyn_partition.Study.load("study.jsonl").""",
    "doctor": """examples:
  exudyn-partition doctor
  exudyn-partition doctor --json""",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code.

    Parameters
    ----------
    argv : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
    """
    # With a space in front: argparse would take -5e-3 for an option.
    words = [f" {word}" if _is_negative(word) else word for word in (sys.argv[1:] if argv is None else argv)]
    options = parser().parse_args(words)
    run: Command = options.run
    with warnings.catch_warnings():
        warnings.simplefilter("always", PartitionWarning)
        warnings.showwarning = _warn
        try:
            with contextlib.redirect_stdout(sys.stderr):  # Exudyn prints its own warnings there
                code, answer = run(options)
        except PartitionError as error:
            print(f"error: {error}", file=sys.stderr)
            code = 2 if isinstance(error, CallError) else 1
            answer = {"error": type(error).__name__, "message": str(error)}
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return 130
    try:
        if options.json:
            print(json.dumps(answer, indent=2))
        elif "error" not in answer:
            show(answer)
        sys.stdout.flush()
    except OSError as error:  # the reader of a pipe has gone, or the disk is full
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # otherwise Python tries again at its end
        print(f"error: the result could not be printed: {error.strerror}", file=sys.stderr)
        return 1
    return code


def _is_negative(word: str) -> bool:
    """Whether an argument is a number below zero, or several numbers of which that is the first."""
    try:
        return word.startswith("-") and not math.isnan(float(word.split(",")[0]))
    except ValueError:
        return False


def parser() -> argparse.ArgumentParser:
    """Parser of all commands; the function of each is `run` of what it returns."""

    def command(name: str, run: Command, said: str) -> argparse.ArgumentParser:
        one = commands.add_parser(
            name,
            help=said,
            description=said,
            epilog=_EXAMPLES[name],
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        one.add_argument("--json", action="store_true", help="print one JSON object to stdout")
        one.set_defaults(run=run)
        return one

    result = argparse.ArgumentParser(
        prog="exudyn-partition",
        description="Partitioned flexible bodies with contact for Exudyn. All lengths in metres, all units SI.",
        epilog=_EXAMPLES[""],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument("--version", action="version", version=__version__)
    commands = result.add_subparsers(required=True, metavar="COMMAND")

    one = command("reduce", _reduce, "Reduce a mesh or STEP file to a body file.")
    one.add_argument("source", help="STEP file, or a mesh of tetrahedra or hexahedra: VTU, Gmsh, Abaqus, Nastran")
    one.add_argument("-o", "--out", required=True, type=Path, metavar="BODY.npz")
    one.add_argument("--material", required=True, type=_material, help=_MATERIAL)
    xyz = ("X", "Y", "Z")
    one.add_argument("--at", required=True, action="append", type=float, nargs=3, metavar=xyz, help="contact point [m]")
    one.add_argument("--radius", required=True, action="append", type=_positive, help="of the impact region there [m]")
    one.add_argument("--name", action="append", help="of the patch")
    cut = one.add_mutually_exclusive_group(required=True)
    cut.add_argument("--f-cut", type=_positive, metavar="HZ", help="keep what moves below this frequency")
    cut.add_argument(
        "--tolerance", type=_positive, help="or grow the body until its estimated error is below, such as 0.01"
    )
    one.add_argument("--speed", type=_positive, help="of the impact that --tolerance judges [m/s]; 1 unless given")
    one.add_argument("--basis", default="contact-adapted", choices=BASES)
    one.add_argument("--scale", type=_positive, default=1.0, help="factor on the file's lengths: 1e-3 for millimetres")
    one.add_argument("--order", type=int, choices=(1, 2, 3), help="of the elements")
    one.add_argument("--maxh", type=_positive, metavar="M", help="largest element, for STEP files [m]")
    one.add_argument("--h", type=_positive, metavar="M", help="elements within the impact region, for STEP files [m]")
    one.add_argument("--no-inside", action="store_true", help="leave out the shapes inside the body: a smaller file")

    one = command("info", _info, "Say what a body file holds.")
    one.add_argument("body", type=Path, metavar="BODY.npz")
    one.add_argument("--table", action="store_true", help="with what each coordinate is")

    one = command("estimate", _estimate, "Estimate an impact by Hertz, and what it asks of a model.")
    three, said = (
        ("MASS", "RADIUS", "MATERIAL"),
        "mass [kg], or a body file; radius of the surface [m], negative if hollow; material",
    )
    one.add_argument("--first", required=True, nargs=3, metavar=three, help=said)
    said = "the same; inf for a mass that is held or a flat surface (default: a rigid wall)"
    one.add_argument("--second", default=("inf", "inf", "rigid"), nargs=3, metavar=three, help=said)
    one.add_argument("--speed", required=True, type=_positive, help="of approach [m/s]")
    one.add_argument(
        "--impedance", type=_limit, default=math.inf, help="effective wave impedance of long bodies [N s/m]"
    )

    one = command("impact", impact_command, "From STEP files to an impact, or a drop: bodies, a page and a script.")
    one.add_argument("source", nargs="+", metavar="STEP", help="one or two STEP files, placed as the bodies touch")
    one.add_argument("-o", "--out", type=Path, metavar="DIR", help="folder (default for --drop: NAME-drop)")
    said = f"{_MATERIAL}; of each body (default for --drop: steel)"
    one.add_argument("--material", action="append", type=_material, help=said)
    one.add_argument("--scale", type=_positive, help="factor on the files' lengths (default: 1; for --drop 1e-3, mm)")
    one.add_argument(
        "--duration", type=_positive, metavar="S", help="of the run, or over which errors are measured [s]"
    )
    at = one.add_argument_group("an impact at a known point")
    at.add_argument("--speed", type=_positive, help="of approach [m/s]")
    at.add_argument("--contact", type=_vector, metavar="X,Y,Z", help="where they touch, scaled [m]")
    said = "of a rigid plane there, in place of a second body"
    at.add_argument("--normal", type=_vector, metavar="X,Y,Z", help=said)
    at.add_argument("--tolerance", type=_positive, help="of the whole error (default: 0.01)")
    fall = one.add_argument_group("a part that falls, and may touch with its whole skin")
    fall.add_argument("--drop", type=_positive, metavar="HEIGHT", help="from which it falls [m]")
    fall.add_argument("--floor", action="store_true", help="on a rigid plane, below it along z")
    said = "turns about x, y and z, one after the other [degrees] (default: 3,2,0)"
    fall.add_argument("--turn", type=_vector, metavar="A,B,C", help=said)
    fall.add_argument("--maxh", type=_positive, metavar="M", help="largest element [m] (default: by its walls)")
    fall.add_argument("--f-cut", type=_positive, metavar="HZ", help="keep what moves below (default: by its size)")
    fall.add_argument("--friction", type=_share, help="coefficient (default: 0.3)")

    one = command("study", study_command, "Call a function at many points, and keep what it returns.")
    add_study_arguments(one)

    command("doctor", doctor, "Check the installation by versions and by a small impact.")
    return result


def _positive(text: str) -> float:
    """Number above zero."""
    if math.isinf(number := _limit(text)):
        raise argparse.ArgumentTypeError(f"expected a finite number above zero, got {text.strip()!r}")
    return number


def _share(text: str) -> float:
    """Number that is not negative."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number of at least zero, got {text.strip()!r}")
    return number


def _limit(text: str) -> float:
    """Number above zero, or inf."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not number > 0:
        raise argparse.ArgumentTypeError(f"expected a number above zero, got {text.strip()!r}")
    return number


def _vector(text: str) -> tuple[float, float, float]:
    """Three numbers with commas between them."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"expected three numbers such as 0,0,1e-3, got {text.strip()!r}") from error
    return x, y, z


def _material(text: str) -> Material:
    """Material by its name, or its three or four numbers."""
    if text in MATERIALS:
        return MATERIALS[text]
    try:
        E, nu, rho, *more = map(float, text.split(","))
        if len(more) > 1:
            raise ValueError(f"{len(more) + 3} numbers")
        return Material(E=E, nu=nu, rho=rho, yield_stress=more[0] if more else None)
    except PartitionError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    except ValueError as error:
        known = ", ".join(MATERIALS)
        raise argparse.ArgumentTypeError(
            f"expected {known} or E,nu,rho such as 210e9,0.3,7800, or with a yield stress, got {text!r}"
        ) from error


def _reduce(options: argparse.Namespace) -> tuple[int, dict[str, object]]:
    if len(options.radius) not in (1, len(options.at)):
        raise CallError(f"--radius: expected one, or one for each of {len(options.at)} --at, got {len(options.radius)}")
    radii = options.radius * (len(options.at) if len(options.radius) == 1 else 1)
    names = options.name or [""] * len(options.at)
    if len(names) != len(options.at):
        raise CallError(f"--name: expected one for each of {len(options.at)} --at, got {len(names)}")
    _check_out(options.out, options.source)
    places = [(validate_vector("--at", at), radius) for at, radius in zip(options.at, radii, strict=True)]
    refine = [Refine(at, radius, options.h) for at, radius in places] if options.h else []
    begin = time.perf_counter()
    fem = fe_model(
        options.source, options.material, order=options.order, maxh=options.maxh, refine=refine, scale=options.scale
    )
    fem_s = time.perf_counter() - begin
    patches = [Partition.ball(fem, *place, name=name) for place, name in zip(places, names, strict=True)]
    partition = patches[0]
    for patch in patches[1:]:
        partition |= patch
    limit = {"f_cut": options.f_cut} if options.tolerance is None else {"tolerance": options.tolerance}
    body = reduce(fem, partition, basis=options.basis, speed=options.speed, **limit)
    body = body.without_inside() if options.no_inside else body
    body.save(options.out)
    return 0, {"file": str(options.out), **_described(body), "time": {"fem_s": fem_s, "reduce_s": body.reduce_s}}


def _check_out(out: Path, source: str) -> None:
    """Raise, before the work, if the body cannot be written or would replace its source."""
    writable(out, "--out")
    if out.exists() and os.path.exists(source) and os.path.samefile(out, source):  # noqa: PTH110, PTH121
        raise InputError(f"--out: {out} is the source itself, which the body would replace; give it another name")
    folder = Path(os.path.realpath(out)).parent
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0")
    except OSError as error:
        raise OutputError(f"--out: nothing can be written into {folder}: {error.strerror}; choose another") from error


def _info(options: argparse.Namespace) -> tuple[int, dict[str, object]]:
    body = load_body(options.body)
    about = {"file": str(options.body), **_described(body)}
    return 0, about | {"coordinates": list(body.labels)} if options.table else about


def _described(body: ReducedBody) -> dict[str, object]:
    """Description of a body in types of JSON."""
    about: dict[str, object] = {
        "basis": body.basis.name,
        "f_cut_Hz": body.f_cut,
        "dofs": body.n_dofs,
        "fe_dofs": body.fe_dofs,
        "kept": dict(_kinds(body)),
        "highest_frequency_Hz": float(body.basis.omega.max(initial=0.0) / (2 * np.pi)),
        "mass_kg": body.total_mass,
        "centre_of_mass_m": body.centre_of_mass.tolist(),
        "size_m": np.ptp(body.points, axis=0).tolist(),
        "patches": [
            {
                "name": patch.name,
                "nodes": len(patch.nodes),
                "centre_m": body.points[patch.nodes].mean(axis=0).tolist(),
                "outward_normal": patch.direction.tolist(),
            }
            for patch in body.partition.patches
        ],
        "interfaces": [i.name for i in body.partition.interfaces],
        "left_out": list(body.left_out),
    }
    if body.estimate is not None:
        about["estimated_error"] = {"force": body.estimate.force, "velocity": body.estimate.velocity}
    return about


def _kinds(body: ReducedBody) -> Counter[str]:
    """Number of coordinates of each kind."""
    kinds: Counter[str] = Counter()
    for label in body.basis.labels:
        kinds["rigid" if label.startswith("rigid") else label.rsplit(" ", 2)[0]] += 1
    if len(body.basis.nodal):
        kinds["nodal"] = 3 * len(body.basis.nodal)
    return kinds


def _estimate(options: argparse.Namespace) -> tuple[int, dict[str, object]]:
    (mass_1, radius_1, material_1), (mass_2, radius_2, material_2) = (
        _hertz_body(f"--{name}", getattr(options, name)) for name in ("first", "second")
    )
    if material_1 is None:
        raise CallError("--first: expected a material, only the second body may be rigid")
    mass = effective(mass_1, mass_2)
    hertz = impact(mass, options.speed, radius_1, radius_2, material_1, material_2, impedance=options.impedance)
    result: dict[str, object] = {
        "effective_mass_kg": mass,
        "peak_force_N": hertz.peak_force,
        "contact_radius_m": hertz.contact_radius,
        "approach_m": hertz.approach,
        "duration_s": hertz.duration,
        "rise_time_s": hertz.rise_time,
        "peak_pressure_Pa": hertz.peak_pressure,
    }
    if hertz.yield_ratio is None:
        result["left_out"] = ["first yield: no yield stress is known (fourth number of a material)"]
    else:
        result |= {"yield_ratio": hertz.yield_ratio, "yield_force_N": hertz.yield_force}
        result |= {"yield_speed_m_s": hertz.yield_speed, "plastic_radius_m": hertz.plastic_radius}
        if hertz.yield_ratio > 1:
            warn(hertz.stress.advice(("the first body", "the second body")), YieldWarning)
    if math.isfinite(hertz.duration):
        f_cut = hertz.truncation_frequency()
        result |= {"f_cut_Hz": f_cut, "step_s": 1 / (STEPS_A_PERIOD * f_cut)}
    return 0, {key: None if value == math.inf else value for key, value in result.items()}


def _radius(text: str) -> float:
    """Radius of a surface [m], below zero of a hollow one."""
    return -_limit(text[1:]) if text.startswith("-") else _limit(text)


def _hertz_body(option: str, values: Sequence[str]) -> tuple[float, float, Material | None]:
    mass, radius, material = values
    try:
        number = load_body(mass).total_mass if mass.endswith(".npz") else _limit(mass)
        return number, _radius(radius), None if material == "rigid" else _material(material)
    except (ValueError, argparse.ArgumentTypeError) as error:
        if isinstance(error, PartitionError):
            raise
        raise CallError(f"{option}: expected MASS RADIUS MATERIAL, such as 0.03 0.01 steel: {error}") from error


def _warn(message: object, category: type[Warning], *unused: object, **also: object) -> None:
    if issubclass(category, PartitionWarning):
        print(f"warning: {message}", file=sys.stderr)
