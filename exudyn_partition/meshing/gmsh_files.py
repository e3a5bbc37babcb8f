"""Gmsh's formats 1 and 4.1 as meshio needs them: the first as 2.2, and every geometric entity in a physical group."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator

_FIRST = re.compile(rb"\s*\$NOD\s(.*?)\$ENDNOD\s+\$ELM\s(.*?)\$ENDELM", re.DOTALL)
_FORMAT = re.compile(rb"\s*\$MeshFormat\s+4\.1\s+([01])\s+8\b")
_SECTION = re.compile(rb"\$Entities[^\S\n]*\n(.*?)\s?\$EndEntities", re.DOTALL)

NextNumbers = Callable[[str, int], list[bytes]]  # the next numbers of a kind: "i" int, "d" double, "Q" size


def for_meshio(data: bytes) -> bytes:
    """Content of a file as meshio reads it; those of other formats come back as they are."""
    first = _FIRST.match(data)
    return _as_second(first[1], first[2]) if first else in_groups(data)


def _as_second(nodes: bytes, elements: bytes) -> bytes:
    """Format 2.2 of sections of format 1, whose elements have physical group, entity and number of nodes."""
    count, *rows = elements.strip().splitlines()
    lines = []
    for row in rows:
        number, kind, group, entity, _, *nodes_of = row.split()
        lines.append(b" ".join([number, kind, b"2", group, entity, *nodes_of]))
    head = b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n" + nodes.strip() + b"\n$EndNodes\n$Elements\n"
    return head + b"\n".join([count.strip(), *lines]) + b"\n$EndElements\n"


def in_groups(data: bytes) -> bytes:
    """Content of a file in which entities of no physical group, as "save all" writes them, are of group 0.

    meshio gives up where some entities are in groups and others are not. Other files come back as they are.
    """
    head, section = _FORMAT.match(data), _SECTION.search(data)
    if not head or not section:
        return data
    grouped = _binary(section[1]) if head[1] == b"1" else _text(section[1])
    return data[: section.start(1)] + grouped + data[section.end(1) :]


def _text(section: bytes) -> bytes:
    tokens = iter(section.split())
    entities = _entities(lambda _, count: [next(tokens) for _ in range(count)], int, b"1", b"0")
    return b"\n".join(b" ".join(entity) for entity in entities)


def _binary(section: bytes) -> bytes:
    place = 0

    def next_numbers(kind: str, count: int) -> list[bytes]:
        nonlocal place
        size = struct.calcsize(f"<{kind}")
        first, place = place, place + size * count
        if place > len(section):
            raise ValueError("the section of entities ends early")
        return [section[i : i + size] for i in range(first, place, size)]

    def number(size: bytes) -> int:
        return int.from_bytes(size, "little")

    entities = _entities(next_numbers, number, struct.pack("<Q", 1), struct.pack("<i", 0))
    return b"".join(part for entity in entities for part in entity)


def _entities(
    next_numbers: NextNumbers, number: Callable[[bytes], int], one: bytes, zero: bytes
) -> Iterator[list[bytes]]:
    """Numbers of the section: how many entities of each dimension there are, then those of each entity."""
    counts = next_numbers("Q", 4)
    yield counts
    for dimension, count in enumerate(counts):
        for _ in range(number(count)):
            place = next_numbers("i", 1) + next_numbers("d", 6 if dimension else 3)  # its number, and the box around it
            (groups,) = next_numbers("Q", 1)
            if number(groups):
                place += [groups, *next_numbers("i", number(groups))]
            else:
                place += [one, zero]
            if dimension:
                (bounds,) = next_numbers("Q", 1)
                place += [bounds, *next_numbers("i", number(bounds))]
            yield place
