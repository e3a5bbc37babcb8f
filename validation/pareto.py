"""Error against run time for rod on plate: which basis and truncation for 10 %, 1 % and 0.1 %.

Reference: that of benchmarks/bases.json, which is read: the full FE model on the same mesh, HHT steps of 0.5 us, whose
own error, by halving its step, is shown. Quantity: relative L2 error of the contact force over 5 ms against times of
reduction (off-line), of Exudyn's solver (on-line), and both together. Nothing is run; benchmarks/bases.py measures.

    python validation/pareto.py
"""

import json
import math
from pathlib import Path

import matplotlib as mpl
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep

mpl.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "validation" / "benchmarks" / "bases.json"
FIGURE = ROOT / "out" / "pareto.png"
FINER = "0.5 us"
TARGETS = (0.1, 0.01, 0.001)
TIMES = {"off-line": ("offline_s",), "on-line": ("online_s",), "together": ("offline_s", "online_s")}
COLOURS = {"contact-adapted": "C0", "residual": "C1", "craig-bampton": "C2", "free": "C3"}


def runs(data, times):
    """Comparisons by name, with the sum of some of their times, of the cases that ended."""
    reference = data["references"][FINER]
    return {
        name: ep.Comparison(
            case["error"][FINER], sum(case[t] for t in times), reference["time_s"], case["end_time_s"]
        )
        for name, case in data["cases"].items()
        if case["status"] == "finished"
    }  # fmt: skip


def front(comparisons):
    """Names of runs that no other beats in both time and error."""
    best, names = math.inf, []
    for name, run in sorted(comparisons.items(), key=lambda item: (item[1].time_s, item[1].error["force"])):
        if run.error["force"] < best:
            best = run.error["force"]
            names.append(name)
    return names


def recommended(comparisons, target):
    """Name of the quickest run with at most this error; None if there is none."""
    within = {name: run.time_s for name, run in comparisons.items() if run.error["force"] <= target}
    return min(within, key=within.get) if within else None


def draw(panels, floor):
    figure, axes = plt.subplots(1, len(panels), figsize=(15, 5.5), sharey=True, layout="constrained")
    for ax, (title, comparisons) in zip(axes, panels.items(), strict=True):
        ep.plot.pareto(ax, comparisons)
        marked = front(comparisons)
        # 30 names hide the points: colours say the basis, and the front its frequencies.
        for line in ax.get_lines():
            basis = line.get_label().split(",")[0]
            if basis in COLOURS:
                line.set(color=COLOURS[basis], marker="o", markersize=5)
        for name in marked:
            run = comparisons[name]
            kHz = name.split(", ")[1]
            at = (run.time_s, 100 * run.error["force"])
            ax.annotate(kHz, at, xytext=(4, 4), textcoords="offset points", fontsize=7)
        ax.yaxis.set_minor_formatter("")
        ax.axhline(100 * floor, color="k", linestyle=":", linewidth=0.8)
        if ax.get_legend() is not None:
            ax.get_legend().remove()
        ax.set(title=title, xlabel=f"{title} time [s]")
    handles = [mpl.lines.Line2D([], [], color=c, marker="o", linestyle="", label=b) for b, c in COLOURS.items()]
    handles.append(mpl.lines.Line2D([], [], color="k", linestyle="--", label="stepping of the full FE model"))
    handles.append(mpl.lines.Line2D([], [], color="k", linestyle=":", label="the reference's own error"))
    axes[0].legend(handles=handles, fontsize=8)
    FIGURE.parent.mkdir(exist_ok=True)
    figure.savefig(FIGURE, dpi=130)


def main():
    data = json.loads(SOURCE.read_text())
    panels = {title: runs(data, times) for title, times in TIMES.items()}
    together, floor = panels["together"], data["reference_step_error"]["force"]
    fronts = {title: front(comparisons) for title, comparisons in panels.items()}
    draw(panels, floor)
    head = ("case", "dofs", "force error", "off-line", "on-line", "on the front of")
    rows = [
        (
            name, data["cases"][name]["dofs"], f"{run.error['force']:.2%}", f"{panels['off-line'][name].time_s:.2f} s",
            f"{panels['on-line'][name].time_s:.3g} s", ", ".join(t for t, names in fronts.items() if name in names),
        )
        for name, run in sorted(together.items(), key=lambda item: item[1].error["force"])
    ]  # fmt: skip
    choice_head = ("force error at most", *TIMES)
    choice = [
        (f"{target:.1%}", *(recommended(panels[title], target) or f"none: the reference's own error is {floor:.2%}"
                            for title in TIMES))
        for target in TARGETS
    ]  # fmt: skip
    tables = {
        "Recommended setting: the quickest of those measured, by time off-line, on-line, and together": (
            choice_head,
            choice,
        ),
        "All runs that reached 5 ms": (head, rows),
    }
    for title, (columns, lines) in tables.items():
        table = Table(*columns, title=title)
        for line in lines:
            table.add_row(*map(str, line))
        Console(width=150).print(table)
    result = {"source": str(SOURCE.relative_to(ROOT)), "fronts": fronts, "tables": tables}
    Path(__file__).with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
