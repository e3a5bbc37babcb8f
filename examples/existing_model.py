"""An existing Exudyn model with a reduced body, and one line of it changed.

The model is models/swinging_arm.py, plain Exudyn. An arm swings on a hinge under a torque and gravity, with a weight on
its other end. In the first run the arm is Exudyn's own body, with Hurty-Craig-Bampton modes of `exudyn.FEM`. In the
second run it is a partition body of the same mesh. The same function makes everything else of the model.
"""

import argparse
import json
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep
from models.swinging_arm import GRAVITY, arm_shape, cms_modes, swing

F_CUT = 10e3  # truncation of our body [Hz]


def partition_body(mesh):
    """The arm reduced by this library, with interfaces at its bores; and the number of FE dofs."""
    fem = ep.fe_model(mesh, ep.STEEL)
    interfaces = ep.Partition.interface(fem, "pin", "pin") | ep.Partition.interface(fem, "tip", "tip")
    return ep.reduce(fem, interfaces, f_cut=F_CUT), fem.n_dofs


def draw(t, runs):
    """Figure of the tip's displacement, and of its deflection in the axes of the hinge."""
    figure, (above, below) = plt.subplots(2, sharex=True, layout="constrained")
    for (label, (tip, deflection)), style in zip(runs.items(), ("-", "--"), strict=True):
        above.plot(1e3 * t, 1e3 * tip[:, :2], style, label=[f"{axis}, {label}" for axis in "xy"])
        below.plot(1e3 * t, 1e3 * deflection, style, label=label)
    above.set(ylabel="displacement of the tip [mm]")
    below.set(ylabel="its deflection [mm]", xlabel="time [ms]")
    for panel in (above, below):
        panel.legend()
    return figure


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser mesh, the drive's time and a little more")
    parser.add_argument("--out", type=Path, default=Path("out/existing_model"), metavar="DIR")
    options = parser.parse_args(argv)
    maxh, end_time = (6e-3, 0.06) if options.quick else (5e-3, 0.5)

    mesh = ep.generate_mesh(arm_shape(), maxh=maxh)
    body, fe_dofs = partition_body(mesh)  # first, because FEMinterface changes the mesh
    begin = time.perf_counter()
    fem = cms_modes(mesh, ep.STEEL)
    cms_reduce_s = time.perf_counter() - begin
    # The line that changes: how the arm is added.
    t, *cms, cms_s = swing(lambda mbs: mbs.CreateFFRFReducedOrderObject("arm", fem, gravity=GRAVITY), end_time)
    ours = {"name": "arm", "gravity": GRAVITY, "frame": "floating", "superElement": True}
    t, *own, online_s = swing(lambda mbs: ep.CreatePartitionBody(mbs, body, **ours), end_time)

    errors = [float(np.linalg.norm(x - y) / np.linalg.norm(y)) for x, y in zip(own, cms, strict=True)]
    numbers = {
        "dofs": body.n_dofs,
        "cms_dofs": 6 + fem.modeBasis["matrix"].shape[1],
        "fe_dofs": fe_dofs,
        "time": {"reduce_s": body.reduce_s, "online_s": online_s, "cms_reduce_s": cms_reduce_s, "cms_online_s": cms_s},
        "error": dict(zip(("tip_displacement", "deflection"), errors, strict=True)),
        "largest_deflection_m": float(abs(own[1]).max()),
    }
    result = {**numbers, "left_out": list(body.left_out), "versions": ep.versions()}
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    picture = options.out / "existing_model.png"
    draw(t, {"Exudyn's body": cms, "partition body": own}).savefig(picture, dpi=150)
    print(json.dumps(numbers, indent=2))
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
