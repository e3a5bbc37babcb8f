"""A page on one run: scene, what was left out, step, conservation, contacts, timings, versions and figures.

The page is one HTML file by a template of Jinja; its figures are embedded, curves as SVG.
"""

from __future__ import annotations

import base64
import datetime
import io
import math
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..exudyn_contacts.balance import Balance
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..results.compare import versions
from ..results.impacts import Ringing, SubImpact
from ..support.checks import validate_text
from ..support.files import replacing, writable
from ..support.foreign import Axes
from ..support.optional import require
from . import plot
from .plot_input import plain
from .scene import scene_of

_ROUNDING = 1e-3  # of a speed: steps change it by less
_MOST_IMPACTS = 20  # largest number of sub-impacts of a contact to list
_ADAPTIVE = 1.01  # mean step by that in contact, above which steps are adaptive
_OTHERS = "joints, springs and loads (ep.CreateWorkSensor tells them apart)"
_TEMPLATE = "report_page.html"


def write_report(path: str | Path, result: Result, *, title: str = "", note: str = "") -> Path:
    """Write the page of a run, with a note in fixed width if there is one; see `Result.report`."""
    path = writable(path)
    validate_text("title", title)
    if not len(result.t):
        raise InputError("result: the run kept no samples, so there is nothing to report")
    balance, balance_note = _balance(result)
    jinja2 = require("jinja2")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.filters["shown"] = _text
    page = environment.get_template(_TEMPLATE).render(
        title=title or path.stem,
        note=note,
        finished=result.status == "finished",
        status=f"{result.status}: {result.message}",
        run=_run(result),
        warnings=result.warnings,
        figures=_figures(result),
        scene=_scene(result),
        bodies_head=_BODIES_HEAD,
        bodies=_bodies(result),
        contacts=[_contact(contact, result) for contact in result.contacts],
        balance=balance,
        balance_note=balance_note,
        left_out=_left_out(result),
        versions=list(versions().items()),
    )
    with replacing(path, "w") as file:
        file.write(page)
    return path


def _run(result: Result) -> list[tuple[str, str]]:
    return [
        ("time span", f"{result.t[0]:.6g} to {result.t[-1]:.6g} s, {len(result.t)} samples"),
        ("method", result.method or "not known"),
        ("step", _step(result)),
        ("reduction of the bodies (off-line)", _number(sum(item.body.reduce_s for item in result.bodies), "s")),
        ("Exudyn's solver (on-line)", _number(result.time_s, "s")),
        ("written", datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")),
    ]


def _step(result: Result) -> str:
    """Return the step, or the range of adaptive steps."""
    if not result.steps:
        return _number(result.step, "s")
    mean = (result.t[-1] - result.t[0]) / result.steps
    if mean > _ADAPTIVE * result.step:
        return f"adaptive, {result.step:.4g} s in contact, {mean:.4g} s in the mean, {result.steps} steps"
    return f"{_number(result.step, 's')}, {result.steps} steps"


_BODIES_HEAD = (
    "body",
    "frame",
    "basis",
    "f_cut [kHz]",
    "dofs",
    "FE dofs",
    "patch nodes",
    "mass [kg]",
    "estimated error",
)


def _bodies(result: Result) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = []
    for i, item in enumerate(result.bodies):
        body, estimate = item.body, item.body.estimate
        error = "not estimated" if estimate is None else f"{estimate.error:.2%} (asked {estimate.tolerance:.2%})"
        size = (1e-3 * body.f_cut, body.n_dofs, body.fe_dofs, len(body.partition.patch_nodes), body.total_mass)
        rows.append((item.name or f"body {i}", item.frame, body.basis.name, *size, error))
    return rows


def _contact(contact: PartitionContact, result: Result) -> dict[str, object]:
    name, force = contact.name, contact.force(result)
    master = contact.sides[1][0].name or "a body" if len(contact.sides) > 1 else type(contact.master).__name__
    impacts = [] if result.method == "static" else contact.impacts(result)
    rows: list[tuple[str, object]] = [
        ("slave, master", f"{contact.slave.name or 'a body'}, {master}"),
        ("contact law", result.kept(contact).law_name),
        ("rows", contact.n_rows),
    ]
    said, warnings = result.warnings or (), []  # those of the run stand on top of the page
    if force.any():
        peak = int(force.argmax())
        rings = contact.ringing(result)
        of_impacts = [
            ("impulse", f"{np.trapezoid(force, result.t):.5g} N s"),
            ("time in contact", f"{sum(i.end - i.start for i in impacts):.5g} s in {len(impacts)} sub-impacts"),
        ]
        rows += [
            ("peak force", f"{force[peak]:.5g} N at {result.t[peak]:.6g} s"),
            *([] if rings is None else [("it rings: read means", _ringing(rings))]),
            *(of_impacts if impacts else []),
            ("largest contact area", f"{1e6 * contact.area(result).max():.4g} mm2"),
            *_friction_rows(contact, result),
            *_plastic_rows(contact, result),
            ("largest pressure", f"{1e-6 * contact.pressure(result).max():.4g} MPa"),
        ]
        if (stress := contact.largest_stress(result)) is not None:
            rows.append(("Hertz-equivalent pressure", f"{1e-6 * stress.pressure:.4g} MPa at {stress.time:.6g} s"))
            flows = {side for side, _ in contact.plastic.zones}
            rows += [
                (f"von Mises stress of {name}", "its patch yields, see the plastic strain" if side in flows else said)
                for side, (name, said) in enumerate(stress.by_body(contact.side_names))
            ]
            advice = stress.advice(contact.side_names)
            if (stress.yield_ratio or 0.0) > 1.0 and not any(advice in text for text in said):
                peak_of = f" {rings.beside(stress.yield_force)}." if rings is not None and stress.yield_force else ""
                warnings.append(f"Beyond first yield: {advice}.{peak_of}")
    else:
        rows.append(("peak force", f"none: the bodies did not touch; smallest gap {contact.gap(result).min():.4g} m"))
    reached = contact.edge_reached(result)
    told = [text for text in said if "reached the edge of its patch" in text]
    if reached is not None and not any(f"t = {reached[0]:.6g} s" in text for text in told):
        warnings.append(f"Reached the edge of its patch at {reached[0]:.6g} s: the force is too small from then on.")
    return {
        "name": name,
        "rows": rows,
        "impacts": [
            (
                *(i.start, i.end, i.peak, i.mean_force, i.impulse),
                *map(_known, (i.speed_before, i.speed_after, i.restitution)),
            )
            for i in impacts[:_MOST_IMPACTS]
        ],
        "more": max(0, len(impacts) - _MOST_IMPACTS),
        "faster": _faster(contact, impacts, result),
        "warnings": warnings,
    }


def _faster(contact: PartitionContact, impacts: list[SubImpact], result: Result) -> str:
    """Why bodies separate faster than they approach, or do not approach at all; empty if none does."""
    known = [i for i in impacts if i.speed_before is not None and i.speed_after is not None]
    fast = [i for i in known if i.speed_after > (1 + _ROUNDING) * max(i.speed_before, 0.0)]  # type: ignore[operator,type-var]
    if not fast:
        return ""
    own = {item for item, _ in contact.sides}
    others = [other for other in result.contacts if other is not contact and own & {item for item, _ in other.sides}]
    pushed = [i for i in fast if any(_acts(other, result, i) for other in others)]
    why = f"In {len(fast)} of {len(known)} sub-impacts the bodies separate faster than they approach. "
    if pushed:
        why += f"In {len(pushed)} of these another contact pushed one of the bodies meanwhile. "
    if len(pushed) < len(fast):
        why += (
            "Vibration from before, a load or a joint gave the rigid motion energy there. If the balance below grows "
            "too, steps are too long. "
        )
    return why


def _acts(contact: PartitionContact, result: Result, impact: SubImpact) -> bool:
    """Whether a contact has a force during an impact of another one."""
    during = (result.t >= impact.start) & (result.t <= impact.end)
    return bool(contact.force(result)[during].any())


def _ringing(rings: Ringing) -> str:
    """What a force that rings amounts to."""
    return (
        f"with {1e-3 / rings.period:.3g} kHz; means over {rings.window:.3g} s, two periods, reach {rings.mean:.5g} N "
        f"from {rings.start:.6g} s to {rings.end:.6g} s"
    )


def _friction_rows(contact: PartitionContact, result: Result) -> list[tuple[str, str]]:
    """What a contact with friction adds to its table."""
    if (law := contact.friction.coulomb) is None:
        return []
    size = np.linalg.norm(contact.friction.tangential_force(result), axis=1)
    coefficients = f"{law.static:g}" if law.constant else f"{law.static:g} in stick, {law.kinetic:g} in slip"
    return [
        ("coefficient of friction", coefficients),
        ("largest tangential force", f"{size.max():.6g} N at {result.t[int(size.argmax())]:.6g} s"),
        ("rows that stick, at most", str(contact.friction.stuck_rows(result).max())),
        ("energy taken by friction", f"{contact.friction.work(result)[-1]:.4g} J"),
    ]


def _plastic_rows(contact: PartitionContact, result: Result) -> list[tuple[str, str]]:
    """What a contact with plastic zones adds to its table."""
    if not contact.plastic:
        return []
    dents = ", ".join(f"{depth:.4g} m in the {side}" for side, depth in contact.plastic.dents(result).items())
    return [
        ("plastic work", f"{contact.plastic.work(result)[-1]:.4g} J"),
        ("largest plastic strain", f"{contact.plastic.strain(result)[-1]:.3g}"),
        ("depth of the dent", dents),
    ]


def _balance(result: Result) -> tuple[list[tuple[object, ...]], str]:
    """Sums over the partition bodies at start and end of the run, and a note."""
    if not result.bodies:
        return [], ""
    balance = Balance.of_run(result)
    sums = [("energy of the bodies [J]", balance.bodies), ("with contacts' [J]", balance.total)]
    sums += [(f"taken by {what} [J]", taken) for what, taken in balance.taken.items()]
    if balance.taken:
        sums.append((f"with contacts' and what {' and '.join(balance.taken)} took [J]", balance.with_taken))
    sums += [(f"given by {name} [J]", work) for name, work in balance.given.items()]
    givers = "other items" if result.item_work is not None and balance.given else _OTHERS
    sums.append((f"given by {givers}; else the steps' error [J]", balance.rest))
    momentum = np.sum([item.momentum(result) for item in result.bodies], axis=0)
    sums += [(f"momentum {axis} [N s]", momentum[:, i]) for i, axis in enumerate("xyz")]
    rows: list[tuple[object, ...]] = [(name, f"{v[0]:.6g}", f"{v[-1]:.6g}", f"{v[-1] - v[0]:.3g}") for name, v in sums]
    note = (
        "What drives the model changes energy and momentum: joints, springs, loads, prescribed motion; rigid surfaces "
        "change momentum. Without these a change is the error of the steps. Contact between the bodies does not."
    )
    return rows, note


def _left_out(result: Result) -> list[tuple[str, list[str]]]:
    """What was left out, each sentence once, with the names of the items that say it."""
    said: dict[str, list[str]] = {}
    for i, item in enumerate(result.bodies):
        for text in item.left_out:
            said.setdefault(text, []).append(item.name or f"body {i}")
    for contact in result.contacts:
        for text in contact.left_out:
            said.setdefault(text, []).append(contact.name)
    return list(said.items())


def _figures(result: Result) -> list[dict[str, str]]:
    figures = []
    # Texts as texts: small, and sharp at any size. A fixed salt makes equal runs equal pages.
    with require("matplotlib").rc_context({"font.size": 9, "svg.fonttype": "none", "svg.hashsalt": "report"}):
        for contact in result.contacts:
            axes = plot.force(None, result, contact=contact)
            axes.set_title(plain(contact.name))
            figures.append(_drawn(axes, "contact force over time"))
        if result.bodies:
            figures.append(_drawn(plot.energy(None, result), "energies over time"))
    return figures


def _scene(result: Result) -> str:
    """Page with the moving bodies, to stand in a frame of this one."""
    return scene_of(result).page if result.bodies else ""


def _drawn(axes: Axes, caption: str) -> dict[str, str]:
    buffer = io.BytesIO()
    axes.figure.savefig(buffer, format="svg")
    return {"kind": "svg+xml", "data": base64.b64encode(buffer.getvalue()).decode(), "caption": caption}


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _known(value: float | None) -> float | str:
    return "" if value is None else value


def _number(value: float, unit: str) -> str:
    return "not known" if math.isnan(value) else f"{value:.4g} {unit}"
