"""How many nodes and elements a mesh file says that it has, beside what its reader returns."""

from __future__ import annotations

import re
import struct
from pathlib import Path

_PIECE = re.compile(rb"<Piece\b[^>]*>")
_SOLIDS_OF_MEDIT = rb"(?:Tetrahedra|Hexahedra|Prisms|Pyramids)"


def counts_said(path: Path) -> dict[str, int]:
    """Numbers of "nodes" and of "elements" or "volume elements" that a file says; none of a format that does not tell.

    Formats are those of Gmsh, VTU, VTK and Medit.
    """
    suffix = path.suffix.lower()
    if suffix == ".msh":
        return _gmsh(path.read_bytes())
    if suffix == ".vtu":
        pieces = _PIECE.findall(path.read_bytes())
        return {
            name: sum(int(number) for piece in pieces for number in re.findall(key + rb'\s*=\s*"\s*(\d+)', piece))
            for name, key in (("nodes", rb"NumberOfPoints"), ("elements", rb"NumberOfCells"))
        }
    if suffix == ".vtk":
        data = path.read_bytes()
        keys = {"nodes": rb"^POINTS\s+(\d+)", "elements": rb"^CELL_TYPES\s+(\d+)"}
        found = {name: re.search(key, data, re.MULTILINE) for name, key in keys.items()}
        return {name: int(match[1]) for name, match in found.items() if match}
    if suffix == ".mesh":
        data = path.read_bytes()
        nodes = re.search(rb"^\s*Vertices\s+(\d+)", data, re.MULTILINE)
        solids = re.findall(rb"^\s*" + _SOLIDS_OF_MEDIT + rb"\s+(\d+)", data, re.MULTILINE)
        return {"nodes": int(nodes[1]), "volume elements": sum(map(int, solids))} if nodes else {}
    return {}


def _gmsh(data: bytes) -> dict[str, int]:
    """Counts of Gmsh's formats 1, 2 and 4, in text or binary."""
    head = re.match(rb"\s*\$MeshFormat\s+(\d)\S*\s+([01])\s+(\d+)", data)
    first = re.match(rb"\s*\$NOD\s+(\d+).*\$ELM\s+(\d+)", data, re.DOTALL)
    if first:
        return {"nodes": int(first[1]), "elements": int(first[2])}
    found = {}
    for name, key in (("nodes", rb"\$Nodes"), ("elements", rb"\$Elements")):
        section = re.search(key + rb"[^\S\n]*\n", data)
        if not head or not section:
            continue
        if head[1] == b"4" and head[2] == b"1":  # blocks, then those that we want
            found[name] = struct.unpack_from("<Q", data, section.end() + 8)[0]
        else:
            numbers = data[section.end() : section.end() + 200].split()
            found[name] = int(numbers[1 if head[1] == b"4" else 0])
    return found
