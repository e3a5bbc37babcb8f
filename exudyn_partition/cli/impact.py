"""From two STEP files to an impact: body files, a page, and a script that runs it again."""

from __future__ import annotations

import argparse
import runpy
from pathlib import Path

import numpy as np

from ..accuracy.design import design_impact
from ..accuracy.impact_design import ImpactDesign
from ..contact.rigid import RigidPlane
from ..errors import CallError
from ..present.report_page import write_report
from ..support.files import filling, replacing
from .drop import drop
from .quoting import escaped, quoted

_PROGRAM, _PAGE = "impact.py", "impact.html"
_TOLERANCE = 1e-2
_SCRIPT = '''"""Impact of {names} at {speed:g} m/s, as `exudyn-partition impact` designed it; run it with Python.

Estimated error of force and velocities over {duration:.4g} s: {error:.2%}.
"""

from pathlib import Path

import exudyn as exu

import exudyn_partition as ep

HERE = Path(__file__).parent
SPEED = {speed!r}  # of the first body [m/s]
NORMAL = {normal}  # its outward normal at the contact
END_TIME, STEP = {end_time!r}, {step!r}  # [s]


def run():
    """Result of the run, and the contact in it."""
    mbs = exu.SystemContainer().AddSystem()
    velocity = [SPEED * x for x in NORMAL]
    first = ep.CreatePartitionBody(mbs, ep.load_body(HERE / {file}), name={name}, initialVelocity=velocity)
    second = {second}
    contact = ep.CreatePartitionContact(mbs, first, second, passes="given", name="impact")
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=END_TIME, step=STEP), contact


if __name__ == "__main__":
    result, contact = run()
    print(f"peak force {{contact.force(result).max():.4g}} N, {{result.steps}} steps in {{result.time_s:.2g}} s")
'''


def impact(options: argparse.Namespace) -> tuple[int, dict[str, object]]:
    """Design an impact, run it, and write bodies, page and script; or let a part drop, see `drop`."""
    if options.drop is not None:
        return drop(options)
    _check(options)
    sources = [Path(source) for source in options.source]
    if len(sources) > 2 or (len(sources) == 1) == (options.normal is None):
        raise CallError(
            f"source: expected two STEP files, or one and --normal of a rigid plane, got {len(sources)} and "
            f"{'no ' if options.normal is None else ''}--normal"
        )
    if len(options.material) not in (1, len(sources)):
        raise CallError(
            f"--material: expected one, or one for each of {len(sources)} bodies, got {len(options.material)}"
        )
    materials = options.material * (len(sources) if len(options.material) == 1 else 1)
    with filling(options.out, ""):  # before the work: nothing is written yet
        pass
    first, *others = zip(sources, materials, strict=True)
    design = design_impact(
        first,
        others[0] if others else RigidPlane(options.contact, options.normal),
        speed=options.speed,
        contact=options.contact,
        tolerance=_TOLERANCE if options.tolerance is None else options.tolerance,
        duration=options.duration,
        scale=1.0 if options.scale is None else options.scale,
    )
    names = [source.stem for source in sources]
    if len(set(names)) < len(names):
        names = [f"{name}_{i}" for i, name in enumerate(names, 1)]
    files = [f"{name}.npz" for name in names]
    with filling(options.out, _PAGE) as folder:
        for body, name in zip(design.bodies, files, strict=True):
            body.save(folder / name)
        with replacing(folder / _PROGRAM, "w") as file:
            file.write(script(design, names, options))
        result, contact = runpy.run_path(str(folder / _PROGRAM))["run"]()
        write_report(folder / _PAGE, result, title=" on ".join(names), note=str(design))
    return 0, {
        "bodies": [str(options.out / name) for name in files],
        "script": str(options.out / _PROGRAM),
        "page": str(options.out / _PAGE),
        **_described(design),
        "peak_force_N": float(contact.force(result).max()),
        "time": {**{f"{name}_s": x for name, x in design.seconds.items()}, "online_s": result.time_s},
    }


def _check(options: argparse.Namespace) -> None:
    """Raise an error if an impact at a known point lacks an option, or has one that belongs to a drop."""
    for name, meaning in (("material", "of each body"), ("speed", "of approach [m/s]"), ("contact", "where they touch"),
                          ("out", "the folder")):  # fmt: skip
        if getattr(options, name) is None:
            raise CallError(f"--{name}: expected one, {meaning}. Or take --drop HEIGHT --floor for a part that falls")
    for name in ("floor", "maxh", "turn", "f_cut", "friction"):
        if getattr(options, name) not in (None, False):
            raise CallError(f"--{name.replace('_', '-')}: belongs to --drop, give it with a height")


def script(design: ImpactDesign, names: list[str], options: argparse.Namespace) -> str:
    """Text of the script."""
    if len(names) == 2:
        second = (
            f"ep.CreatePartitionBody(mbs, ep.load_body(HERE / {quoted(names[1], '.npz')}), name={quoted(names[1])})"
        )
    else:
        second = f"ep.RigidPlane({list(options.contact)}, {list(options.normal)})"
    points, normal = design.place.points, design.place.normal
    flight = max(0.0, float((points[1] - points[0]) @ normal)) / design.speed
    return _SCRIPT.format(
        names=escaped(" on ".join([*names, *["a rigid plane"] * (len(names) == 1)])),
        speed=design.speed,
        duration=design.duration,
        error=design.error,
        normal=np.round(normal, 12).tolist(),
        end_time=design.duration + flight,
        step=design.step,
        file=quoted(names[0], ".npz"),
        name=quoted(names[0]),
        second=second,
    )


def _described(design: ImpactDesign) -> dict[str, object]:
    """What was chosen, in types of JSON."""
    look = design.look
    assert look.mesh is not None
    about: dict[str, object] = {
        "contact_radius_m": look.circle,
        "step_s": design.step,
        "duration_s": design.duration,
        "fe_dofs": list(look.dofs),
        "orders": [sizes.order for sizes in look.sizes],
        "dofs": [body.n_dofs for body in design.bodies],
        "f_cut_Hz": look.truncation.f_cut,
        "estimated_error": {
            "mesh": look.mesh.error,
            "truncation_and_step": look.truncation.error,
            "step": look.step_error,
            "total": design.error,
        },
    }
    return about | {"limit": design.limit} if design.limit else about
