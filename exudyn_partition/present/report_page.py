"""A page on one run: scene, what was left out, step, conservation, contacts, timings, versions and figures.

The page is one HTML file; its figures are embedded.
"""

from __future__ import annotations

import base64
import contextlib
import datetime
import html
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..results.compare import versions
from ..support.arrays import Array
from ..support.checks import validate_text
from ..support.files import replacing, writable
from ..support.foreign import Axes
from ..support.optional import require
from . import plot, view
from .graphics import peak_time
from .plot_input import plain, taken_by

_VISIBLE = 0.03  # largest deformation in the picture, relative to the size of the bodies
_ROUNDING = 1e-11  # a deformation below this, relative to that size, is none
_MOST_IMPACTS = 20  # largest number of sub-impacts of a contact to list
_STYLE = """
body { font: 15px/1.45 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; margin: .6em 0 1.4em; }
th, td { border-bottom: 1px solid #ccc; padding: .2em .8em .2em 0; text-align: left; vertical-align: top; }
th { font-weight: 600; } td.number { text-align: right; font-variant-numeric: tabular-nums; }
img { max-width: 100%; } .warning { color: #a00; font-weight: 600; }
"""


def write_report(path: str | Path, result: Result, *, title: str = "", note: str = "") -> Path:
    """Write the page of a run, with a note in fixed width if there is one; see `Result.report`."""
    path = writable(path)
    validate_text("title", title)
    if not len(result.t):
        raise InputError("result: the run kept no samples, so there is nothing to report")
    title = title or path.stem
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        _run(result),
        _warnings(result),
        f"<h2>How it was designed</h2><pre>{html.escape(note)}</pre>" if note else "",
        _figures(result),
        "<h2>Scene</h2>",
        _bodies(result),
        "<h2>Contacts</h2>",
        *(_contact(i, contact, result) for i, contact in enumerate(result.contacts)),
        "<h2>Conservation</h2>",
        _conservation(result),
        "<h2>What was left out</h2>",
        _left_out(result),
        "<h2>Versions</h2>",
        _table([], versions().items()),
    ]
    page = (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"
    )
    with replacing(path, "w") as file:
        file.write(page)
    return path


def _run(result: Result) -> str:
    status = html.escape(f"{result.status}: {result.message}")
    paragraph = f"<p>{status}</p>" if result.status == "finished" else f'<p class="warning">{status}</p>'
    reduction = sum(item.body.reduce_s for item in result.bodies)
    rows = [
        ("time span", f"{result.t[0]:.6g} to {result.t[-1]:.6g} s, {len(result.t)} samples"),
        ("method", result.method or "not known"),
        ("step", _number(result.step, "s") + (f", {result.steps} steps" if result.steps else "")),
        ("reduction of the bodies (off-line)", _number(reduction, "s")),
        ("Exudyn's solver (on-line)", _number(result.time_s, "s")),
        ("written", datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")),
    ]
    return paragraph + _table([], rows)


def _warnings(result: Result) -> str:
    if result.warnings is None:
        return "<p>Warnings of the run are not known: it was read from a file.</p>"
    listed = "".join(f"<li>{html.escape(text)}</li>" for text in result.warnings)
    return f'<ul class="warning">{listed}</ul>' if listed else "<p>The run gave no warning.</p>"


def _bodies(result: Result) -> str:
    head = ["body", "frame", "basis", "f_cut [kHz]", "dofs", "FE dofs", "patch nodes", "mass [kg]", "estimated error"]
    rows = []
    for i, item in enumerate(result.bodies):
        body, estimate = item.body, item.body.estimate
        error = "not estimated" if estimate is None else f"{estimate.error:.2%} (asked {estimate.tolerance:.2%})"
        size = (1e-3 * body.f_cut, body.n_dofs, body.fe_dofs, len(body.partition.patch_nodes), body.total_mass)
        rows.append((item.name or f"body {i}", item.frame, body.basis.name, *size, error))
    return _table(head, rows)


def _contact(number: int, contact: PartitionContact, result: Result) -> str:
    name, force = contact.name or f"contact {number}", contact.force(result)
    master = contact.sides[1][0].name or "a body" if len(contact.sides) > 1 else type(contact.master).__name__
    history, impacts = result.history(contact), contact.impacts(result)
    rows: list[tuple[str, object]] = [
        ("slave, master", f"{contact.slave.name or 'a body'}, {master}"),
        ("contact law", type(result.kept(contact).law).__name__),
        ("rows", contact.n_rows),
    ]
    said = advice = ""
    if impacts:
        peak = int(force.argmax())
        rows += [
            ("peak force", f"{force[peak]:.5g} N at {result.t[peak]:.6g} s"),
            ("impulse", f"{history.impulse:.5g} N s"),
            ("time in contact", f"{sum(i.end - i.start for i in impacts):.5g} s in {len(impacts)} sub-impacts"),
            ("largest contact area", f"{1e6 * contact.area(result).max():.4g} mm2"),
            *_friction_rows(contact, result),
            *_plastic_rows(contact, result),
            ("largest pressure", f"{1e-6 * contact.pressure(result).max():.4g} MPa"),
        ]
        if (stress := contact.largest_stress(result)) is not None:
            rows.append(("Hertz-equivalent pressure", f"{1e-6 * stress.pressure:.4g} MPa at {stress.time:.6g} s"))
            rows += [(f"von Mises stress of {name}", said) for name, said in stress.by_body(contact.side_names)]
            if (stress.yield_ratio or 0.0) > 1.0:
                advice = html.escape(stress.advice(contact.side_names))
        listed = [(i.start, i.end, i.peak, i.impulse) for i in impacts[:_MOST_IMPACTS]]
        said = _table(["from [s]", "to [s]", "peak [N]", "impulse [N s]"], listed)
        if len(impacts) > _MOST_IMPACTS:
            said += f"<p>and {len(impacts) - _MOST_IMPACTS} more.</p>"
    else:
        rows.append(("peak force", f"none: the bodies did not touch; smallest gap {contact.gap(result).min():.4g} m"))
    if advice:
        said += f'<p class="warning">Beyond first yield: {advice}.</p>'
    if (reached := contact.edge_reached(result)) is not None:
        said += (
            f'<p class="warning">Reached the edge of its patch at {reached[0]:.6g} s: '
            "the force is too small from then on.</p>"
        )
    return f"<h3>{html.escape(name)}</h3>" + _table([], rows) + said


def _friction_rows(contact: PartitionContact, result: Result) -> list[tuple[str, str]]:
    """What a contact with friction adds to its table."""
    if contact.friction is None:
        return []
    law, size = contact.friction, np.linalg.norm(contact.tangential_force(result), axis=1)
    coefficients = f"{law.static:g}" if law.constant else f"{law.static:g} in stick, {law.kinetic:g} in slip"
    return [
        ("coefficient of friction", coefficients),
        ("largest tangential force", f"{size.max():.6g} N at {result.t[int(size.argmax())]:.6g} s"),
        ("rows that stick, at most", str(contact.stuck_rows(result).max())),
        ("energy taken by friction", f"{(contact.dissipated_energy(result) - contact.plastic_work(result))[-1]:.4g} J"),
    ]


def _plastic_rows(contact: PartitionContact, result: Result) -> list[tuple[str, str]]:
    """What a contact with plastic zones adds to its table."""
    if contact.yielding is None:
        return []
    dents = ", ".join(f"{depth:.4g} m in the {side}" for side, depth in contact.dents(result).items())
    return [
        ("plastic work", f"{contact.plastic_work(result)[-1]:.4g} J"),
        ("largest plastic strain", f"{contact.plastic_strain(result)[-1]:.3g}"),
        ("depth of the dent", dents),
    ]


def _conservation(result: Result) -> str:
    """Sums over the partition bodies at start and end of the run."""
    if not result.bodies:
        return "<p>No partition bodies.</p>"
    rows: list[Sequence[object]] = []
    bodies, note, with_contacts = np.sum([item.energy(result) for item in result.bodies], axis=0), "", None
    try:
        with_contacts = bodies + np.sum([contact.energy(result) for contact in result.contacts], axis=0)
    except InputError as error:
        note = f"{html.escape(str(error))}. "
    sums, total, takers = (
        [("energy of the bodies [J]", bodies), ("with contacts' [J]", with_contacts)],
        with_contacts,
        [],
    )
    for what, taken in taken_by(result.bodies, result.contacts, result).items():
        sums.append((f"taken by {what} [J]", taken))
        takers.append(what)
        total = None if total is None else total + taken
    if takers:
        sums.append((f"with contacts' and what {' and '.join(takers)} took [J]", total))
    for name, values in sums:
        if values is not None:
            largest = abs(values).max() or 1.0
            rows.append((name, f"{values[0]:.6g}", f"{values[-1]:.6g}", f"{(values[-1] - values[0]) / largest:.2e}"))
    momenta = [item.momentum(result) for item in result.bodies]
    total, largest = np.sum(momenta, axis=0), max(np.linalg.norm(p, axis=1).max() for p in momenta) or 1.0
    for axis, name in enumerate("xyz"):
        p = total[:, axis]
        rows.append((f"momentum {name} [N s]", f"{p[0]:.6g}", f"{p[-1]:.6g}", f"{(p[-1] - p[0]) / largest:.2e}"))
    return (
        _table(["of all partition bodies", "at the start", "at the end", "change, of the largest"], rows)
        + f"<p>{note}Loads, joints and other items of the model may change them; contact between the bodies does not."
        "</p>"
    )


def _left_out(result: Result) -> str:
    entries = [(item.name or f"body {i}", [*item.left_out]) for i, item in enumerate(result.bodies)]
    entries += [(contact.name or f"contact {i}", contact.left_out) for i, contact in enumerate(result.contacts)]
    listed = (f"<li>{html.escape(name)}: {html.escape(one)}</li>" for name, said in entries for one in said)
    return "<ul>" + "".join(listed) + "</ul>"


def _figures(result: Result) -> str:
    images = []
    with require("matplotlib").rc_context({"font.size": 9}):
        for i, contact in enumerate(result.contacts):
            axes = plot.force(None, result, contact=contact)
            axes.set_title(plain(contact.name or f"contact {i}"))
            images.append((_png(axes), "contact force over time"))
        if result.bodies:
            with contextlib.suppress(InputError):  # an energy is not known after the run; `_conservation` says so
                images.append((_png(plot.energy(None, result)), "energies over time"))
    if result.bodies:
        peak = peak_time(result)
        scale = _scale(result.at([peak]))
        said = f", drawn {scale:g} times as large, so that bodies may seem to overlap" if scale > 1 else ""
        caption = f"deformation at {peak:.6g} s{said}"
        images.append((_encoded(view.picture(result, peak, scale=scale)), caption))
    return "".join(
        f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text}</figcaption></figure>'
        for data, text in images
    )


def _scale(sample: Result) -> float:
    """Power of ten by which the deformation must be scaled to be visible."""
    size = max(np.ptp(item.body.points, axis=0).max() for item in sample.bodies)
    largest = max(
        abs(item.kinematics.at(np.unique(item.body.facets)).deformation(item.coordinates(sample)[0])).max()
        for item in sample.bodies
    )
    if largest <= _ROUNDING * size:  # all bodies are rigid but for their contacts
        return 1.0
    return 10.0 ** max(0, math.floor(math.log10(_VISIBLE * size / largest)))


def _png(axes: Axes) -> str:
    buffer = io.BytesIO()
    axes.figure.savefig(buffer, format="png", dpi=120)
    return base64.b64encode(buffer.getvalue()).decode()


def _encoded(image: Array) -> str:
    buffer = io.BytesIO()
    require("matplotlib.image").imsave(buffer, image, format="png")
    return base64.b64encode(buffer.getvalue()).decode()


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = ["<tr>" + "".join(f"<th>{html.escape(h)}</th>" for h in head) + "</tr>"] if head else []
    for first, *others in rows:
        cells = "".join(_cell(value) for value in others)
        lines.append(f"<tr><td>{html.escape(_text(first))}</td>{cells}</tr>")
    return "<table>" + "".join(lines) + "</table>"


def _cell(value: object) -> str:
    kind = ' class="number"' if isinstance(value, int | float) else ""
    return f"<td{kind}>{html.escape(_text(value))}</td>"


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _number(value: float, unit: str) -> str:
    return "not known" if math.isnan(value) else f"{value:.4g} {unit}"
