"""Springs, joints and sensors of loads on nodes without a static answer: the local dent that they lack.

A force on a few nodes dents the body around them. Kept shapes are smooth and do not have that, unless the nodes are
those of a patch, an interface or a load. Far from there nothing is missing. But what holds the body at these nodes, or
reads them, finds it too stiff. The dent is about that of a uniform pressure on a half-space.

K. L. Johnson, Contact Mechanics, 1985, section 3.4.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from scipy.spatial import KDTree

from ...exudyn_bodies.joints import HOLONOMIC
from ...exudyn_bodies.partition_body import PartitionBody
from ...fe.partition import Partition
from ...support.arrays import Array
from ...support.foreign import ItemEntry, MainSystem
from ..result import called
from .reviewed_run import Finding, ReviewedRun

_LARGEST = 0.1  # share of the flexibility that a spring, a joint or a sensor may miss
_MEAN = 16 / (3 * np.pi**2)  # mean dent under a uniform pressure, by (1 - nu^2) F / (E a)


def missing_dents(run: ReviewedRun) -> Iterator[Finding]:
    """Springs, joints and sensors that find a body too stiff, because a local dent is missing."""
    loaded = [
        body.item
        for body in run.bodies
        if "oFFRFreducedOrder" in body.item
        and not len(body.item.body.basis.nodal)
        and body.item.body.material is not None
    ]
    attached = [*_connections(run.mbs)] if loaded else []
    for item in loaded:
        for what, marker, stiffness in attached:
            if int(marker.get("bodyNumber", -1)) != int(item["oFFRFreducedOrder"]):
                continue
            nodes = np.asarray(marker.get("meshNodeNumbers", ()), dtype=int)
            if not nodes.size or nodes.max() >= len(item.body.points) or _is_answered(item.body.partition, nodes):
                continue
            dent, kept = _flexibilities(item, nodes, np.asarray(marker["weightingFactors"], dtype=float))
            share = dent / (dent + kept + 1 / stiffness)
            if share > _LARGEST:
                place = item.body.points[nodes].mean(axis=0)
                yield Finding(
                    f"{called(item)}: {what} acts on nodes around {place} m of its mesh, which have no static answer. "
                    f"It lacks their local dent, of about {dent:.2g} m/N, {share:.2g} of the flexibility that it "
                    "should find, so that the body is too stiff there. Join Partition.interface(fem, name, nodes) to "
                    "the partition before reduce(), and take CreateInterfaceMarker"
                )
                break


def _connections(mbs: MainSystem) -> Iterator[tuple[str, ItemEntry, float]]:
    """What feels the local dent at a marker: its name, the marker, and its stiffness [N/m].

    These are connectors, joints, and sensors that read the place of a load. Joints and sensors count as rigid. A load
    without a sensor has no stiffness that the dent could change.
    """
    data = mbs.systemData
    for number in range(data.NumberOfObjects()):
        entry = mbs.GetObject(number)
        joint = entry["objectType"] in HOLONOMIC  # Exudyn's tables may lack items that were added after the run
        stiffness = np.inf if joint else _stiffness(entry.get("stiffness"))
        on = stiffness > 0 and entry.get("activeConnector", True)
        for marker in entry.get("markerNumbers", ()) if on else ():
            yield f"{entry['objectType']} {entry['name']!r}", mbs.GetMarker(marker), stiffness
    loaded = {int(mbs.GetLoad(number)["markerNumber"]): number for number in range(data.NumberOfLoads())}
    for number in range(data.NumberOfSensors()):
        sensor = mbs.GetSensor(number)
        marker = int(sensor.get("markerNumber", -1))
        quantity = str(sensor.get("outputVariableType", "")).rpartition(".")[2]
        if marker in loaded and quantity in ("Position", "Displacement"):
            name = mbs.GetLoad(loaded[marker])["name"]
            yield f"sensor {sensor['name']!r} reads where load {name!r}", mbs.GetMarker(marker), np.inf


def _stiffness(given: object) -> float:
    """Largest translational stiffness of a connector [N/m], by its parameter: a number, three, or a matrix."""
    if not isinstance(given, float | int | list | np.ndarray):
        return 0.0
    values = np.asarray(given, dtype=float)
    if values.ndim == 2:
        values = np.diag(values)[:3]
    return float(values.max(initial=0.0))


def _is_answered(partition: Partition, nodes: Array) -> bool:
    """Whether all nodes are those of one patch, interface or load."""
    parts = [[part.nodes for part in parts] for parts in (partition.patches, partition.interfaces, partition.loads)]
    return any(np.isin(nodes, known).all() for known in itertools.chain(*parts))


def _flexibilities(item: PartitionBody, nodes: Array, weights: Array) -> tuple[float, float]:
    """Flexibility of the local dent of a force on nodes, and the largest one of the kept shapes there [m/N]."""
    body, material = item.body, item.body.material
    assert material is not None
    spacing = KDTree(body.points).query(body.points[nodes], k=2)[0][:, 1].mean()
    spread = weights @ np.sum((body.points[nodes] - weights @ body.points[nodes]) ** 2, axis=1)
    radius = max(spacing / 2, np.sqrt(2 * max(spread, 0.0)))  # of a disc of that spread; weights may be negative
    rows = np.einsum("k,kan->an", weights, np.asarray(body.rows(nodes)).reshape(len(nodes), 3, -1))
    elastic = body.basis.omega > 0
    kept = np.linalg.norm(rows[:, elastic] / body.basis.omega[elastic], 2) ** 2
    return float(_MEAN * (1 - material.nu**2) / (material.E * radius)), float(kept)
