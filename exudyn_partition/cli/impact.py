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

_PROGRAM, _PAGE = "impact.py", "impact.html"
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
    """Design an impact, run it, and write bodies, page and script."""
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
        tolerance=options.tolerance,
        duration=options.duration,
        scale=options.scale,
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


def script(design: ImpactDesign, names: list[str], options: argparse.Namespace) -> str:
    """Text of the script."""
    if len(names) == 2:
        second = (
            f"ep.CreatePartitionBody(mbs, ep.load_body(HERE / {_quoted(names[1], '.npz')}), name={_quoted(names[1])})"
        )
    else:
        second = f"ep.RigidPlane({list(options.contact)}, {list(options.normal)})"
    points, normal = design.place.points, design.place.normal
    flight = max(0.0, float((points[1] - points[0]) @ normal)) / design.speed
    return _SCRIPT.format(
        names=_escaped(" on ".join([*names, *["a rigid plane"] * (len(names) == 1)])),
        speed=design.speed,
        duration=design.duration,
        error=design.error,
        normal=np.round(normal, 12).tolist(),
        end_time=design.duration + flight,
        step=design.step,
        file=_quoted(names[0], ".npz"),
        name=_quoted(names[0]),
        second=second,
    )


def _quoted(name: str, ending: str = "") -> str:
    """Name as a text in a program."""
    return repr(name + ending)


def _escaped(text: str) -> str:
    """Text as it stands within the triple double quotes of a docstring."""
    return repr(text)[1:-1].replace('"', '\\"')


def _described(design: ImpactDesign) -> dict[str, object]:
    """What was chosen, in types of JSON."""
    look = design.look
    assert look.mesh is not None
    found: dict[str, object] = {
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
    return found | {"limit": design.limit} if design.limit else found
