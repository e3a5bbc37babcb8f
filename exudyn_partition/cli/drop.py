"""From a STEP file to a drop on a rigid floor: its whole skin may touch, so that nothing is selected."""

from __future__ import annotations

import argparse
import math
import runpy
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ..accuracy.landing import landing
from ..errors import CallError
from ..fe.material import STEEL
from ..fe.model import FEModel
from ..meshing.mesh_size import first_size
from ..meshing.netgen_mesh import measured
from ..meshing.ngsolve_fem import fe_model
from ..meshing.step_assembly import read_step
from ..present.report_page import write_report
from ..reduction.reduction import reduce
from ..results.impacts import closed_spans
from ..support.files import filling, replacing
from .quoting import escaped, quoted

_PROGRAM, _PAGE, _SCENE, _FORCE = "drop.py", "drop.html", "scene.html", "force.csv"
_MILLIMETRES = 1e-3  # unit of lengths in STEP files as they are read [m]
_G = 9.81  # [m/s2]
_FRICTION = 0.3
_TILT = (3.0, 2.0, 0.0)  # [degrees]: nothing falls quite flat
_WAVES = 2.0  # shear waves of the highest frequency along the diagonal
_WAY = 0.2  # of the diagonal: way at the speed of impact in the default duration
_SCRIPT = '''"""Drop of {named} from {height:g} m on a floor, made by `exudyn-partition impact`; run it with Python."""

from pathlib import Path

import exudyn as exu
from scipy.spatial.transform import Rotation

import exudyn_partition as ep

HERE = Path(__file__).parent
SPEED = {speed!r}  # at the floor [m/s]
TURN = {turn}  # about the axes x, y, z of the file, one after the other [degrees]
GAP = {gap!r}  # between the part and the floor at the start [m]
END_TIME = {end_time!r}  # [s]


def run():
    """Result of the run, the part, and its contact with the floor."""
    mbs = exu.SystemContainer().AddSystem()
    body, axes = ep.load_body(HERE / {file}), Rotation.from_euler("xyz", TURN, degrees=True).as_matrix()
    height = GAP - (body.points @ axes.T)[:, 2].min()
    part = ep.CreatePartitionBody(
        mbs, body, name={name}, frame="floating", referencePosition=[0, 0, height], referenceRotationMatrix=axes,
        initialVelocity=[0, 0, -SPEED], gravity=[0, 0, -9.81],
    )
    (contact,) = ep.CreatePartitionContact(mbs, [part, ep.RigidPlane()], friction={friction!r}, name="floor")
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=END_TIME), part, contact


if __name__ == "__main__":
    result, _, contact = run()
    print(f"peak force {{contact.force(result).max():.4g}} N, {{result.steps}} steps in {{result.time_s:.2g}} s")
'''


def drop(options: argparse.Namespace) -> tuple[int, dict[str, object]]:
    """Mesh and reduce a part with its skin, let it fall on the floor, and write body, script, pages and force."""
    _check(options)
    source = Path(options.source[0])
    begin = time.perf_counter()
    shape = read_step(source, scale=_MILLIMETRES if options.scale is None else options.scale).find(None)
    out = Path(f"{source.stem}-drop") if options.out is None else options.out
    with filling(out, ""):  # before the work: nothing is written yet
        pass
    maxh = first_size(*measured(shape)) if options.maxh is None else options.maxh
    speed, turn = math.sqrt(2 * _G * options.drop), _TILT if options.turn is None else options.turn
    fem = fe_model(shape, options.material[0] if options.material else STEEL, maxh=maxh)
    fine = landing(shape, fem, Rotation.from_euler("xyz", turn, degrees=True).as_matrix()[2], speed)
    if fine is not None and fine.h < maxh:
        fem = fe_model(shape, fem.material, maxh=maxh, refine=[fine])
    fem_s = time.perf_counter() - begin
    diagonal = float(np.linalg.norm(np.ptp(fem.points, axis=0)))
    f_cut = default_f_cut(fem, diagonal) if options.f_cut is None else options.f_cut
    body = reduce(fem, skin=True, f_cut=f_cut)
    duration = _WAY * diagonal / speed if options.duration is None else options.duration
    with filling(out, _PAGE) as folder:
        file = f"{source.stem}.npz"
        body.save(folder / file)
        with replacing(folder / _PROGRAM, "w") as program:
            program.write(
                _SCRIPT.format(
                    named=escaped(source.stem), height=options.drop, speed=speed, turn=list(turn),
                    gap=1e-4 * maxh, end_time=duration, file=quoted(file), name=quoted(source.stem),
                    friction=_FRICTION if options.friction is None else options.friction,
                )
            )  # fmt: skip
        result, part, contact = runpy.run_path(str(folder / _PROGRAM))["run"]()
        force = contact.force(result)
        with replacing(folder / _FORCE, "w") as table:
            np.savetxt(table, np.column_stack([result.t, force]), delimiter=",", header="t [s],force [N]", comments="")
        result.scene(folder / _SCENE, title=f"{source.stem} falls from {options.drop:g} m")
        write_report(folder / _PAGE, result, title=f"Drop of {source.stem} from {options.drop:g} m")
    spans, momentum = closed_spans(force), part.momentum(result)
    return 0, {
        "body": str(out / file),
        "script": str(out / _PROGRAM),
        "page": str(out / _PAGE),
        "scene": str(out / _SCENE),
        "force": str(out / _FORCE),
        "material": "steel, for none was given" if not options.material else _named(fem),
        "maxh_m": maxh,
        "maxh_at_landing_m": maxh if fine is None else min(fine.h, maxh),
        "fe_dofs": fem.n_dofs,
        "skin_nodes": len(body.partition.patch_nodes),
        "f_cut_Hz": f_cut,
        "dofs": body.n_dofs,
        "mass_kg": body.total_mass,
        "turn_deg": list(turn),
        "speed_m_s": speed,
        "duration_s": duration,
        "peak_force_N": float(force.max()),
        "impulse_N_s": float(np.sum((force[1:] + force[:-1]) / 2 * np.diff(result.t))),
        "impacts": len(spans),
        "velocity_after_m_s": (momentum[-1] / body.total_mass).tolist(),
        "time": {"fem_s": fem_s, "reduce_s": body.reduce_s, "online_s": result.time_s},
    }


def _check(options: argparse.Namespace) -> None:
    """Raise an error if options do not fit together."""
    if not options.floor:
        raise CallError("--drop: expected --floor, the rigid plane on which the part falls")
    if len(options.source) != 1:
        raise CallError(f"source: expected one STEP file for --drop, got {len(options.source)}")
    if options.material is not None and len(options.material) > 1:
        raise CallError(f"--material: expected one for --drop, got {len(options.material)}")
    for name in ("speed", "contact", "normal", "tolerance"):
        if getattr(options, name) is not None:
            raise CallError(f"--{name}: belongs to an impact at a known point, not to --drop")


def default_f_cut(fem: FEModel, diagonal: float) -> float:
    """Truncation frequency [Hz]: that of two shear waves along the diagonal, if the mesh resolves it."""
    return float(min(_WAVES * np.min(fem.elastic.shear_wave_speed) / diagonal, fem.resolved_frequency))


def _named(fem: FEModel) -> str:
    material = fem.material
    return f"E {material.E:.4g} Pa, nu {material.nu:.3g}, rho {material.rho:.4g} kg/m3"
