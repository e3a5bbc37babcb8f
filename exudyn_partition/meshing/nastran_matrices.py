"""Mass and stiffness in files of Nastran: output 4 by pyyeti, and direct matrix input (DMIG) as punched."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, MissingPackageError
from ..support.arrays import Array
from ..support.optional import require
from .nastran_cards import Card, cards
from .triples import Triples, joined

_SYMMETRIC, _SQUARE = 6, 1  # forms of matrices
_REAL = (1, 2)  # types: single and double


def read_op4(path: Path) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Mass and stiffness, whose names begin with M and K, of a text or binary file.

    Raises
    ------
    InputError
        If it cannot be read, or has none or several of them.
    MissingPackageError
        If pyyeti is not installed.
    """
    op4 = require("pyyeti.nastran.op4")
    try:
        read = op4.load(str(path), into="dct", sparse=True)
    except MissingPackageError:
        raise
    except Exception as error:  # it raises whatever a broken file makes it run into
        raise InputError(f"source: {path} could not be read as output 4 of Nastran: {error}") from error
    matrices = {name: entry[0] for name, entry in read.items()}
    both = []
    for letter in "mk":
        found = sp.coo_matrix(matrices[_named(path, letter, matrices)])
        if found.shape[0] != found.shape[1] or np.iscomplexobj(found.data):
            raise InputError(f"source: {path}: expected square, real matrices, got {found.shape} of {found.dtype}")
        both.append(Triples(found.row, found.col, found.data).matrix(found.shape[0]))
    return both[0], both[1]


def read_dmig(path: Path) -> tuple[Array, Array, list[sp.csr_matrix]]:
    """Nodes and directions of the rows, and mass and stiffness, whose names begin with M and K, of DMIG cards.

    Raises
    ------
    InputError
        If there is none or several of them, or if one is not square, symmetric and real.
    MeshError
        If a card cannot be read.
    """
    heads: dict[str, Card] = {}
    columns: dict[str, list[Card]] = {}
    for card in cards(path):
        if card.name == "DMIG":
            name = card.field(1).upper()
            if name in heads:
                columns[name].append(card)
            else:
                heads[name], columns[name] = card, []
    tables = []
    for letter in "MK":
        name = _named(path, letter, heads)
        form, kind = heads[name].integer(3, 0), heads[name].integer(4, 0)
        if form not in (_SYMMETRIC, _SQUARE) or kind not in _REAL:
            raise heads[name].line.refuse(
                f"expected {name} to be square or symmetric and real, IFO 1 or 6 and TIN 1 or 2, got {form} and {kind}"
            )
        tables.append(_entries(columns[name]))
    return joined(tables)


def _entries(columns: list[Card]) -> list[Array]:
    """Node and direction of row and of column, and value, of the entries of the columns of one matrix."""
    whole, values = [], []
    for card in columns:
        node, way = card.integer(2), max(card.integer(3, 0), 1)
        for i in range(5, len(card.fields) + 1, 4):
            if card.field(i):
                whole.append((card.integer(i), max(card.integer(i + 1, 0), 1), node, way))
                values.append(card.real(i + 2))
    numbers = np.array(whole, dtype=np.int64).reshape(-1, 4)
    return [*numbers.T, np.array(values)]


def _named(path: Path, letter: str, names: Iterable[str]) -> str:
    """The one name that begins with a letter."""
    found = [name for name in names if name.startswith(letter)]
    if len(found) != 1:
        raise InputError(
            f"source: {path}: expected one matrix whose name begins with {letter.upper()}, as {letter.upper()}GG, got "
            f"{', '.join(found) or 'none'} of {', '.join(names) or 'no matrices'}"
        )
    return found[0]
