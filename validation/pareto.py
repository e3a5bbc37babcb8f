"""Error against run time: which setting for 10 %, 1 % and 0.1 %, whether `tolerance=` finds it, and times of others.

Nothing is run: error_against_time/*.py measured four scenes, each with its reference and that reference's own error.
Quantity: relative L2 error of the contact force against times of reduction (off-line), of the solver (on-line), and
of both together. The front contains all runs, also those of the full FE model and of Exudyn's own methods.
Limits, for each scene:
- `tolerance=0.1` and `0.01`: the true force error is below the tolerance. The estimate is within a factor of three of
  it, or below the reference's own error; the crank-slider is excepted here, because its blocks are estimated as a
  pair that hits freely. Times are within twice those of the quickest run with no larger error;
- Exudyn's floating frame bodies with penalty contact (GeneralContact): at equal force error this library is ten times
  faster on-line, and at equal on-line time its error is ten times smaller. Nothing is interpolated: the library's run
  has no larger error, or takes no longer;
- the paper's basis `free`, rod on plate: the default basis has a tenth of its coordinates at no larger error, and a
  tenth of its error with no more coordinates.

    python -m validation.pareto
"""

import json
import math
import sys
from pathlib import Path

import matplotlib as mpl
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.tables import PAGE, README, write_between

mpl.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
MEASURED, OUT = ROOT / "validation" / "error_against_time", ROOT / "out"
PICTURE = Path(__file__).with_suffix(".png")  # the README's
SCENES = ("rod_on_plate", "block_on_block", "two_spheres", "crank_slider")
TARGETS = (0.1, 0.01, 0.001)
TIMES = {"off-line": ("offline_s",), "on-line": ("online_s",), "together": ("offline_s", "online_s")}
LIMITS = {
    "tolerance": 2.0,
    "estimate": 3.0,
    "faster than CMS": 10.0,
    "less error than CMS": 10.0,
    "tenth of free": 10.0,
}
OWN = ("library", "tolerance")
STYLES = {  # colour, marker and name of a kind of run
    "contact-adapted": ("C3", "o", "contact-adapted (default)"),
    "residual": ("C1", "s", "residual"),
    "craig-bampton": ("C2", "^", "Craig-Bampton"),
    "free": ("C0", "D", "free, as published"),
    "tolerance": ("k", "*", "tolerance="),
    "full FE": ("0.5", "v", "full FE model, implicit"),
    "CMS": ("C4", "X", "Exudyn's CMS, GeneralContact"),
    "Hertz": ("C5", "P", "rigid or modal bodies, Hertz"),
}


class Scene:
    """What was measured of a scene."""

    def __init__(self, name):
        data = json.loads((MEASURED / f"{name}.json").read_text())
        self.name, self.data, self.reference = data["scene"], data, data["reference"]
        self.runs = {n: r for n, r in data["runs"].items() if r["status"] == "finished"}
        steps = [r for r in self.runs.values() if r["kind"] == "full FE"]
        self.floor = min(steps, key=lambda r: r["step_s"])["error"]["force"]

    def of(self, *kinds):
        """Runs of some kinds."""
        return {n: r for n, r in self.runs.items() if r["kind"] in kinds}

    def comparisons(self, times):
        """Comparisons by name, with the sum of some of the times, of the runs that take any."""
        full, taken = self.reference["time_s"], {n: sum(r[t] for t in times) for n, r in self.runs.items()}
        return {
            n: ep.Comparison(r["error"], taken[n], full, self.data["duration_s"])
            for n, r in self.runs.items()
            if taken[n] > 0
        }

    def fronts(self):
        """Names of the runs on the front, by time."""
        return {title: ep.report.front(self.comparisons(times)) for title, times in TIMES.items()}

    def quickest(self, error, times, kinds=OWN):
        """Name and time of the quickest run with no larger error; None if there is none."""
        found = [(sum(r[t] for t in times), n) for n, r in self.of(*kinds).items() if r["error"]["force"] <= error]
        return min(found)[::-1] if found else None

    def recommended(self, target):
        """The quickest settings for an error, by each time."""
        picks = [self.quickest(target, times, ("library",)) for times in TIMES.values()]
        if picks[0] is None:
            return [f"none; twice the reference's step changes {self.floor:.2%}"] * len(picks)
        return [f"{name} ({time_s:.3g} s)" for name, time_s in picks]

    def tolerances(self):
        """Of each tolerance: error, estimate, and times over those of the quickest runs with no larger error."""
        rows = {}
        for name, run in self.of("tolerance").items():
            error, estimate = run["error"]["force"], run["estimate"]
            over = {}
            for title, times in TIMES.items():
                best, time_s = self.quickest(error, times)
                over[title] = {"ratio": sum(run[t] for t in times) / time_s, "quickest": best}
            rows[name] = {
                "tolerance": run["tolerance"], "error": error, "estimate": estimate["force"], "over": over,
                "promised": not estimate["limit"],
            }  # fmt: skip
        return rows

    def against_cms(self):
        """The library against each CMS baseline: times faster at no larger error, times less error in no more time."""
        rows = {}
        for name, run in self.of("CMS").items():
            best, time_s = self.quickest(run["error"]["force"], ("online_s",)) or (None, float("inf"))
            within = [(r["error"]["force"], n) for n, r in self.of(*OWN).items() if r["online_s"] <= run["online_s"]]
            error, finest = min(within) if within else (float("inf"), None)
            rows[name] = {
                "error": run["error"]["force"], "online_s": run["online_s"], "quickest": best, "finest": finest,
                "faster": run["online_s"] / time_s, "less_error": run["error"]["force"] / error,
            }  # fmt: skip
        return rows

    def against_free(self):
        """The default basis against each run of the paper's: times fewer coordinates, times less error."""
        own = [r for r in self.of(*OWN).values() if r.get("basis", "contact-adapted") == "contact-adapted"]
        rows = {}
        for name, run in self.of("library").items():
            if run["basis"] == "free":
                error = run["error"]["force"]
                fewest = min(r["dofs"] for r in own if r["error"]["force"] <= error)
                least = min(r["error"]["force"] for r in own if r["dofs"] <= run["dofs"])
                rows[name] = {"dofs": run["dofs"] / fewest, "error": error / least}
        return rows

    def failures(self):
        """Limits that are missed."""
        failed = []
        for name, row in self.tolerances().items():
            if row["tolerance"] not in TARGETS[:2]:
                continue
            if row["error"] > row["tolerance"]:
                failed.append(f"{name}: force error {row['error']:.2%}")
            off = row["estimate"] / row["error"]
            judged = self.name != "crank-slider" and max(row["error"], row["estimate"]) > self.floor
            if judged and not 1 / LIMITS["estimate"] < off < LIMITS["estimate"]:
                failed.append(f"{name}: estimate {off:.2g} of the true error")
            for title in ("on-line", "together"):
                if row["over"][title]["ratio"] > LIMITS["tolerance"]:
                    failed.append(f"{name}: {title} {row['over'][title]['ratio']:.1f} times the quickest")
        for name, row in self.against_cms().items():
            if row["faster"] < LIMITS["faster than CMS"]:
                failed.append(f"{name}: only {row['faster']:.1f} times faster")
            if row["less_error"] < LIMITS["less error than CMS"]:
                failed.append(f"{name}: only {row['less_error']:.1f} times less error")
        if self.name == "rod on plate":
            for name, row in self.against_free().items():
                failed += [f"{name}: {key} only 1/{x:.1f}" for key, x in row.items() if x < LIMITS["tenth of free"]]
        return [f"{self.name}, {what}" for what in failed]


def style(run):
    return STYLES[run["basis"] if run["kind"] == "library" else run["kind"]]


def draw(ax, scene, title, front):
    """One panel: all runs by one of the times."""
    comparisons = scene.comparisons(TIMES[title])
    ep.plot.pareto(ax, comparisons)
    for name, line in zip(comparisons, ax.get_lines()[1:], strict=False):  # the first one is the front
        colour, marker, _ = style(scene.runs[name])
        line.set(color=colour, marker=marker, markersize=9 if marker == "*" else 5, alpha=0.9)
        if scene.runs[name].get("formulation") == "penalty":
            line.set(markerfacecolor="none")
        if name in front:
            line.set(markeredgecolor="k", zorder=3)
    ax.axhline(100 * scene.floor, color="k", linestyle=":", linewidth=0.8)
    explicit = scene.data["runs"].get("full FE, explicit")
    if explicit and title != "off-line":
        ax.axvline(explicit["online_s"], color="k", linestyle="-.", linewidth=0.8)
    ax.yaxis.set_minor_formatter("")
    ax.get_legend().remove()
    ax.set(xlabel=f"{title} time [s]", ylim=(None, 300))


def legend(scenes):
    kinds = [s for s in STYLES.values() if any(style(r) == s for scene in scenes for r in scene.runs.values())]
    line = mpl.lines.Line2D
    return [
        *(line([], [], color=c, marker=m, linestyle="", label=label) for c, m, label in kinds),
        line([], [], color="C3", marker="o", mfc="none", linestyle="", label="the same with penalty contact"),
        line([], [], color="0.6", label="front, its runs edged in black"),
        line([], [], color="k", linestyle="--", label="stepping of the reference"),
        line([], [], color="k", linestyle="-.", label="full FE model, explicit (by its first steps)"),
        line([], [], color="k", linestyle=":", label="what twice the reference's step changes"),
    ]


def pictures(scenes):
    """A figure for each scene, and the README's figure with the on-line times of all."""
    OUT.mkdir(exist_ok=True)
    for scene in scenes:
        figure, axes = plt.subplots(1, 3, figsize=(16, 6), sharey=True, layout="constrained")
        for ax, (title, front) in zip(axes, scene.fronts().items(), strict=True):
            draw(ax, scene, title, front)
            if title != "off-line":
                annotate(ax, scene, title, front)
        figure.suptitle(
            f"{scene.name}, {1e3 * scene.data['duration_s']:g} ms, {scene.data['model']['fe_dofs']} FE dofs"
        )
        figure.legend(handles=legend(scenes), loc="outside lower center", ncols=4, fontsize=8)
        figure.savefig(OUT / f"pareto_{scene.name.replace(' ', '_').replace('-', '_')}.png", dpi=120)
    figure, axes = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
    for ax, scene in zip(axes.ravel(), scenes, strict=True):
        draw(ax, scene, "on-line", scene.fronts()["on-line"])
        ax.set_title(f"{scene.name}, {1e3 * scene.data['duration_s']:g} ms", fontsize="medium")
    figure.legend(handles=legend(scenes), loc="outside lower center", ncols=3, fontsize=8)
    figure.savefig(PICTURE, dpi=110)


def annotate(ax, scene, title, front):
    """Names of the library's runs on the front, as far as there is room; the name of the default basis is left out."""
    last = math.inf
    for name in front:
        run = scene.runs[name]
        error = 100 * run["error"]["force"]
        if run["kind"] in OWN and error < last / 1.4:
            last, at = error, (sum(run[t] for t in TIMES[title]), error)
            label = name.replace("contact-adapted, ", "")
            ax.annotate(label, at, xytext=(4, 4), textcoords="offset points", fontsize=7)


def all_runs(scene):
    """Head and rows of the table of a scene."""
    fronts, rows = scene.fronts(), []
    for name, run in sorted(scene.runs.items(), key=lambda item: item[1]["error"]["force"]):
        on = ", ".join(title for title, names in fronts.items() if name in names)
        rows.append((
            name, run["dofs"], f"{run['memory_MB']:.1f} MB" if "memory_MB" in run else "",
            f"{run['error']['force']:.3%}",
            f"{run['peak_force_N'] / scene.reference['peak_force_N'] - 1:+.2%}",
            f"{run['offline_s']:.2f} s", f"{run['online_s']:.3g} s", on,
        ))  # fmt: skip
    return ("case", "dofs", "memory", "force error", "peak", "off-line", "on-line", "on the front of"), rows


def tables(scenes):
    """All tables by title: head, rows."""
    choice, picks, cms, free = [], [], [], []
    for scene in scenes:
        choice += [(scene.name, f"{target:.1%}", *scene.recommended(target)) for target in TARGETS]
        for name, row in scene.tolerances().items():
            run, over = scene.runs[name], row["over"]
            picks.append((
                scene.name, scene.data["model"]["fe_dofs"],
                f"{row['tolerance']:g}{'' if row['promised'] else ', warns'}", run["dofs"],
                f"{1e-3 * run['estimate']['f_cut']:.0f} kHz", f"{row['estimate']:.3%}", f"{row['error']:.3%}",
                f"{run['offline_s']:.1f} s", f"{run['online_s']:.3g} s", f"{scene.reference['time_s']:.0f} s",
                *(f"{over[title]['ratio']:.1f}" for title in ("on-line", "together")),
            ))  # fmt: skip
        for name, row in scene.against_cms().items():
            cms.append((
                scene.name, name, f"{row['error']:.1%}", f"{row['online_s']:.3g} s", f"{row['faster']:.0f}",
                row["quickest"], f"{row['less_error']:.0f}", row["finest"],
            ))  # fmt: skip
        free += [(scene.name, n, f"{r['dofs']:.1f}", f"{r['error']:.1f}") for n, r in scene.against_free().items()]
    own_error = [
        (s.name, s.data["model"]["fe_dofs"], f"{1e6 * s.reference['step_s']:g} us", f"{s.floor:.3%}",
         f"{s.data['mesh']['error']:.2%}", f"{s.data['mesh']['fe_dofs'][1]}", f"{s.reference['time_s']:.0f} s")
        for s in scenes
    ]  # fmt: skip
    return {
        "Recommended: the quickest setting of those measured, by time off-line, on-line, and together": (
            ("scene", "force error at most", *TIMES), choice),
        "Bodies that tolerance= chose, and their times over those of the quickest run with no larger error": (
            ("scene", "FE dofs", "tolerance", "dofs", "f_cut", "force: estimated", "true", "off-line", "on-line",
             "full FE", "x quickest on-line", "x quickest together"), picks),
        "Against Exudyn's floating frame bodies with GeneralContact": (
            ("scene", "baseline", "its error", "its on-line time", "times faster at no larger error", "by",
             "times less error in no more time", "by"), cms),
        "The default basis against the paper's: times fewer coordinates, times less error": (
            ("scene", "case", "coordinates at no larger error", "error with no more coordinates"), free),
        "The references: what twice the step changes in the force, and what a finer mesh does": (
            ("scene", "FE dofs", "step", "twice the step", "finer mesh", "its FE dofs", "stepping"), own_error),
        **{f"All runs of {s.name}": all_runs(s) for s in scenes},
    }  # fmt: skip


def settings(scenes):
    """Head and rows of the second table of the site: recommended settings, and Exudyn's own methods."""
    rows = []
    for s in scenes:
        cms, rigid = s.against_cms().values(), s.runs["rigid, Hertz"]
        rows.append((
            s.name, *(s.recommended(target)[1] for target in TARGETS), best_cms(s),
            f"{min(row['faster'] for row in cms):.0f}", f"{min(row['less_error'] for row in cms):.0f}",
            f"{rigid['error']['force']:.1%} in {rigid['online_s']:.2g} s",
        ))  # fmt: skip
    head = ("scene", *(f"quickest on-line for {target:.1%}" for target in TARGETS), "best of Exudyn's CMS",
            "times faster", "times less error", "rigid, Hertz")  # fmt: skip
    return head, rows


def best_cms(scene):
    """Error and time of the best run of Exudyn's bodies with GeneralContact."""
    best = min(scene.against_cms().values(), key=lambda row: row["error"])
    return f"{best['error']:.0%} in {best['online_s']:.3g} s"


def in_short(scenes):
    """Head and rows of the README's table: the bodies of a tolerance of 1 %."""
    rows = []
    for s in scenes:
        (name,) = (name for name, row in s.tolerances().items() if row["tolerance"] == 0.01)
        run = s.runs[name]
        rows.append((
            s.name, s.data["model"]["fe_dofs"], run["dofs"], f"{run['error']['force']:.2%}",
            f"{run['offline_s']:.1f} s", f"{run['online_s']:.2g} s", f"{s.reference['time_s']:.0f} s", best_cms(s),
        ))  # fmt: skip
    head = ("scene", "FE dofs", "kept dofs", "error of the force", "off-line", "on-line", "full FE", "Exudyn's CMS")
    return head, rows


def markdown(head, rows):
    """A table as text."""
    return "".join("| " + " | ".join(map(str, line)) + " |\n" for line in (head, ["---"] * len(head), *rows))


def main():
    scenes = [Scene(name) for name in SCENES if (MEASURED / f"{name}.json").exists()]
    found = tables(scenes)
    for title, (head, rows) in found.items():
        table = Table(*head, title=title)
        for row in rows:
            table.add_row(*map(str, row))
        Console(width=200).print(table)
    pictures(scenes)
    write_between(README, "pareto.py, in short", markdown(*in_short(scenes)))
    by_tolerance = list(found.values())[1]
    write_between(PAGE, "pareto.py", "\n".join(markdown(*table) for table in (by_tolerance, settings(scenes))))
    failed = [what for scene in scenes for what in scene.failures()]
    result = {
        "scenes": {s.name: {"floor": s.floor, "mesh": s.data["mesh"]["error"], "fronts": s.fronts(),
                            "tolerances": s.tolerances(), "against_cms": s.against_cms()} for s in scenes},
        "limits": LIMITS, "beyond_limits": failed, "tables": found,
    }  # fmt: skip
    Path(__file__).with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
