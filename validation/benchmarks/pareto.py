"""Draw pareto.png, the README's picture: error of the contact force over run time, of what bases.py measured."""

import json
from pathlib import Path

import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
RESULTS, PICTURE = HERE / "bases.json", HERE / "pareto.png"
REFERENCE = "1 us"  # its step
NAMES = {
    "contact-adapted": "contact-adapted (default)",
    "residual": "residual",
    "craig-bampton": "Craig-Bampton",
    "free": "free, as published",
}
REGION = 1.5e-3  # [m], the largest impact region measured, where the paper's basis does best; bases.py draws all


def points(cases, basis):
    """On-line times [s], errors of the force and truncations [Hz] of a basis' finished runs, by truncation."""
    found = sorted(
        (case["f_cut_Hz"], case["online_s"], case["error"][REFERENCE]["force"])
        for case in cases.values()
        if case["basis"] == basis and case["status"] == "finished" and (basis != "free" or case["region_m"] == REGION)
    )
    f_cut, online_s, error = zip(*found, strict=True)
    return online_s, error, f_cut


def main():
    """Draw it."""
    data = json.loads(RESULTS.read_text())
    figure, axes = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    for (basis, name), marker, colour in zip(NAMES.items(), "os^D", ("C3", "C1", "C2", "C0"), strict=True):
        online_s, error, f_cut = points(data["cases"], basis)
        axes.loglog(online_s, [100 * x for x in error], marker + "-", color=colour, markersize=5, label=name)
        for i, beside in ((0, (5, 5)), (-1, (5, -11))):
            axes.annotate(
                f"{1e-3 * f_cut[i]:g} kHz",
                (online_s[i], 100 * error[i]),
                xytext=beside,
                textcoords="offset points",
                fontsize="x-small",
                color=colour,
            )
    reference = data["references"][REFERENCE]
    axes.axvline(reference["time_s"], color="k", linestyle="--", linewidth=1)
    axes.annotate(
        f"full FE model,\n{reference['dofs']} dofs",
        (reference["time_s"], 50),
        xytext=(6, 0),
        textcoords="offset points",
        fontsize="small",
    )
    floor = 100 * data["reference_step_error"]["force"]
    axes.axhline(floor, color="0.6", linewidth=1)
    axes.annotate(
        "what halving the full model's step changes",
        (0.0025, floor),
        xytext=(0, 3),
        textcoords="offset points",
        fontsize="small",
    )
    axes.set(xlabel="run time of 5 ms in Exudyn, or of the full FE model [s]", ylabel="error of the contact force [%]")
    axes.set(xlim=(2e-3, 2e3), ylim=(0.2, 100))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(0.25, 1), fontsize="small")
    figure.savefig(PICTURE, dpi=120)
    print(PICTURE)


if __name__ == "__main__":
    main()
