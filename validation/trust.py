"""The table of the page "How far to trust it": errors and costs of all that was compared, from the stored results.

It runs nothing. Every number is read from the JSON beside the script that is named in its row.

    python -m validation.trust
"""

import json
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from validation.tables import write_between

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "examples" / "site" / "trust.md"
ANALYTIC, CODE, EXPERIMENT, FULL, OTHER = "theory", "other code", "experiment", "full FE", "other formulation"


@dataclass(frozen=True)
class Row:
    """What was compared: scene, quantity, error as text, with what, script, and cost as text."""

    kind: str
    scene: str
    quantity: str
    error: str
    against: str
    script: str
    cost: str = ""


def stored(script):
    return json.loads((HERE / f"{script}.json").read_text())


def percent(*values):
    """Largest absolute value, in per cent."""
    return f"{100 * max(abs(value) for value in values):.2g} %"


def cost(offline, online):
    """Off-line and on-line times."""
    return " + ".join(f"{x:.0f} s" if x >= 10 else f"{x:.2g} s" for x in (offline, online))


def of_rows(rows):
    """Largest times of the rows."""
    return cost(max(row["offline_s"] for row in rows), max(row["online_s"] for row in rows))


def experiments():
    """Of `experiments/`."""
    bar, zener, beam = (stored(f"experiments/{name}") for name in ("tilted_bar", "zener", "ball_on_beam"))
    kharaz, chung, chain = (stored(f"experiments/{name}") for name in ("kharaz", "chung_ooi", "granular_chain"))
    bars, wedge = (stored(f"experiments/{name}") for name in ("sdnl111", "cgs4"))
    smooth = [row for row in bar["rows"] if not row["friction"]]
    yield Row(ANALYTIC, "tilted bar, up to four micro-collisions", "restitution", f"{bar['found']['e']:.3f}",
              "Timoshenko beam and rod on a Hertz spring", "experiments.tilted_bar", of_rows(smooth))  # fmt: skip
    yield Row(ANALYTIC, "the same", "peak force", percent(bar["found"]["peak"]), "the same", "experiments.tilted_bar")
    yield Row(ANALYTIC, "the same, friction 0.1", "restitution", f"{bar['found']['e, friction']:.3f}",
              "the same, with Mindlin's spring that slides", "experiments.tilted_bar")  # fmt: skip
    yield Row(ANALYTIC, "ball on thin discs", "restitution",
              f"{-zener['found']['e below']:+.3f}, never above", "Zener", "experiments.zener",
              of_rows(zener["rows"]))  # fmt: skip
    yield Row(ANALYTIC, "ball on a supported beam", "peaks of two contacts", percent(beam["found"]["peak"]),
              "Timoshenko beam", "experiments.ball_on_beam", of_rows(beam["rows"]))  # fmt: skip
    yield Row(ANALYTIC, "two bars, one clamped", "mean force, duration",
              f"{percent(bars['found']['force'])}, {percent(bars['found']['duration'])}", "waves in bars",
              "experiments.sdnl111", of_rows(bars["rows"][-1:]))  # fmt: skip
    yield Row(ANALYTIC, "block pushed up a slope (NAFEMS CGS-4)", "force when it slides",
              percent(wedge["found"]["ratio"]), "equilibrium", "experiments.cgs4", of_rows(wedge["rows"]))  # fmt: skip
    line = stored("experiments/cgs1")
    yield Row(ANALYTIC, "cylinder on a block (NAFEMS CGS-1)", "half width, largest pressure",
              f"{percent(line['found']['half_width'])}, {percent(line['found']['pressure'])}", "line Hertz",
              "experiments.cgs1", of_rows(line["rows"]))  # fmt: skip
    fit = stored("experiments/lame")
    yield Row(ANALYTIC, "hub pressed on a rigid and on an elastic shaft", "pressure, hoop stress",
              f"{percent(fit['found']['pressure'])}, {percent(fit['found']['hoop'])}", "Lame", "experiments.lame",
              of_rows(fit["rows"]))  # fmt: skip
    yield Row(ANALYTIC, "the same, friction 0.12, pulled off", "pull-off force", percent(fit["found"]["pull"]),
              "coefficient times Lame's pressure", "experiments.lame")  # fmt: skip
    yield Row(ANALYTIC, "chain of beads", "speed of the wave", percent(chain["found"]["point masses"]),
              "point masses on Hertz springs", "experiments.granular_chain", of_rows(chain["rows"]))  # fmt: skip
    time = cost(kharaz["offline_s"], kharaz["online_s"] / kharaz["impacts"])
    yield Row(EXPERIMENT, "alumina on glass, from 20 degrees", "tangential restitution",
              percent(kharaz["found"]["e_t"]), "Kharaz and others", "experiments.kharaz", time)  # fmt: skip
    low = [row for row in kharaz["rows"] if row["quantity"] == "e_t" and row["degrees"] < 20]
    yield Row(EXPERIMENT, "the same, from 20 degrees", "spin, rebound angle",
              f"{percent(kharaz['found']['spin'])}, {percent(kharaz['found']['rebound'])}", "the same",
              "experiments.kharaz")  # fmt: skip
    yield Row(EXPERIMENT, "the same, below 20 degrees", "tangential restitution",
              percent(*(row["error"] for row in low)), "the same; see the script for the reason",
              "experiments.kharaz")  # fmt: skip
    yield Row(OTHER, "alumina on glass, all angles", "tangential restitution", percent(kharaz["found"]["half-spaces"]),
              "elastic half-spaces with friction", "experiments.kharaz")  # fmt: skip
    yield Row(CODE, "alumina ball on a rigid wall, from 20 degrees", "tangential restitution",
              percent(chung["found"]["test 4"]), "Chung and Ooi, point contact", "experiments.chung_ooi",
              cost(chung["time 4"]["offline_s"], chung["time 4"]["online_s"] / len(chung["test 4"])))  # fmt: skip


def others():
    """Of the other folders."""
    maw, spheres = stored("friction/half_space")["found"], stored("inelastic/statics")["found"]
    yield Row(ANALYTIC, "oblique ball on a half-space, friction alone", "Maw's rebound", f"{maw['maw']:.2g}",
              "Maw, Barber, Fawcett", "friction.half_space")  # fmt: skip
    yield Row(ANALYTIC, "pressed spheres at rest", "force, pressure",
              f"{percent(spheres['spheres'])}, {percent(spheres['pressure'])}", "series for whole spheres, Hertz",
              "inelastic.statics")  # fmt: skip
    dent = stored("inelastic/indentation")["found"]
    yield Row(ANALYTIC, "ball pressed into a plate that yields", "load of first yield, unloading",
              f"{percent(dent['first_yield'])}, {percent(dent['unloading'])}", "Hertz, Mesarovic and Johnson",
              "inelastic.indentation")  # fmt: skip
    bearing, gears = stored("wandering/bearing")["found"], stored("wandering/gears")["found"]
    yield Row(ANALYTIC, "ball bearing at rest and turning", "forces of the balls",
              percent(bearing["force"], bearing["moving"]), "Hertz springs", "wandering.bearing")  # fmt: skip
    yield Row(ANALYTIC, "two gears", "stiffness", percent(gears["iso_stiffness"]), "ISO 6336", "wandering.gears")
    for script, scene in (
        ("spheres", "two balls"), ("oblique", "ball on plate, friction"), ("plastic", "ball on a plate that yields"),
        ("rod_on_plate", "rod on plate"),
    ):  # fmt: skip
        found = stored(f"calculix/{script}")["found"]
        name = "force" if "force" in found else "normal"
        yield Row(CODE, scene, f"{'normal ' * (name == 'normal')}force", percent(found[name]), "CalculiX",
                  f"calculix.{script}")  # fmt: skip
    for scene, data in ((s, stored(f"error_against_time/{s}")) for s in ("rod_on_plate", "two_spheres")):
        run = data["runs"]["tolerance=0.01"]
        yield Row(FULL, scene.replace("_", " "), "force, L2", percent(run["error"]["force"]),
                  f"full FE, {data['reference']['time_s']:.0f} s", f"error_against_time.{scene}",
                  cost(run["offline_s"], run["online_s"]))  # fmt: skip
    plastic, rough = stored("inelastic/impact")["found"], stored("friction/oblique")["found"]
    yield Row(FULL, "ball on a plate that yields", "force, rebound",
              percent(plastic["force"], plastic["rebound"]), "full FE", "inelastic.impact")  # fmt: skip
    yield Row(FULL, "rod on plate, friction", "normal, tangential force",
              f"{percent(rough['normal'])}, {percent(rough['tangential'])}", "full FE", "friction.oblique")  # fmt: skip
    clip = stored("friction/clip")["found"]
    yield Row(FULL, "clip that closes on itself and rubs", "normal, tangential force",
              f"{percent(clip['normal'])}, {percent(clip['tangential'])}", "full FE", "friction.clip")  # fmt: skip
    yield Row(OTHER, "clip that rubs, in a frame that turns", "force", f"{clip['turning']:.0e}", "the frame at rest",
              "friction.clip")  # fmt: skip
    spins = stored("joints/rotation")["found"]
    yield Row(OTHER, "bodies that turn freely", "energy, angular momentum",
              f"{max(spins['energy'], spins['angular_momentum']):.0e}", "conservation", "joints.rotation")  # fmt: skip


def table():
    """The rows as Markdown, sorted by what they are compared with."""
    order = (ANALYTIC, EXPERIMENT, CODE, FULL, OTHER)
    rows = sorted([*experiments(), *others()], key=lambda row: order.index(row.kind))
    lines = ["| kind | scene | quantity | largest error | compared with | off-line + on-line | `validation.` |"]
    lines.append("| --- | --- | --- | --- | --- | --- | --- |")
    for row in rows:
        cells = (row.kind, row.scene, row.quantity, row.error, row.against, row.cost, f"`{row.script}`")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main():
    text = table()
    write_between(PAGE, "trust.py", text)
    Console(width=200).print(text, markup=False)


if __name__ == "__main__":
    main()
