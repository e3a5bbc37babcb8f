"""Matrices of a reduced body, for codes other than Exudyn."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..support.arrays import Array
from ..support.files import distinct, filling, replacing, writable
from ..support.foreign import SecondOrderModel
from ..support.optional import require

_NOT_PLAIN = re.compile(r"[^A-Za-z0-9_]")  # what names of variables in MATLAB must not have
_LONGEST = 40  # letters of a name, of which MATLAB takes 63 with what stands before and behind

_LEGEND = """\
SI units. Coordinates q are those of a body whose frame does not move; the list below says what each is. Shapes have
unit modal mass, so that their coordinates are in m sqrt(kg); those of nodes are in m.
Equations of motion: mass q_tt + damping q_t + stiffness q = forces; without damping if there is none.
A contact's rows q are the displacements of its nodes along its directions [m]. Forces lam [N] on the nodes along these
directions are the forces rows' lam. Besides, they move the nodes by flexibility lam [m], which the coordinates lack.
Directions are the outward normals, or x, y, z of each node.
An interface's rows q are its mean translation [m] and rotation [rad]; rows' are the forces of a unit force and moment.
A load is the forces of a unit of it: of 1 Pa, or of 1 N/m along a line."""


@dataclass(frozen=True, eq=False)
class ContactRows:
    """A contact patch by the coordinates of its body.

    Parameters
    ----------
    points : (k, 3) array
        Its nodes, undeformed [m].
    directions : (r, 3) array
        In the body's axes: outward normals, r = k, or x, y, z of each node, r = 3 k.
    area : (k,) array
        Of each node under a uniform pressure [m2].
    rows : (r, n) array or csr matrix
        Displacements of the nodes along the directions, by the coordinates.
    flexibility : (r, r) array or None
        What forces on the nodes along the directions move there, beyond the coordinates [m/N]; None if the basis has
        none.
    """

    points: Array
    directions: Array
    area: Array
    rows: Array | sp.csr_matrix
    flexibility: Array | None


@dataclass(frozen=True, eq=False)
class BodyMatrices:
    """Matrices of a reduced body; see `legend` for units and meaning.

    Parameters
    ----------
    mass, stiffness : (n, n) csr matrix
    rigid : (n, 6) array
        Coordinates of unit translations and of unit rotations about the centre of mass.
    coordinates : tuple of str
        What each of the n coordinates is.
    contacts : dict of str to ContactRows
        By the names of the patches, or their numbers.
    interfaces : dict of str to (6, n) array
    loads : dict of str to (n,) array
    damping : (n, n) csr matrix or None
    """

    mass: sp.csr_matrix
    stiffness: sp.csr_matrix
    rigid: Array
    coordinates: tuple[str, ...]
    contacts: Mapping[str, ContactRows] = field(default_factory=dict)
    interfaces: Mapping[str, Array] = field(default_factory=dict)
    loads: Mapping[str, Array] = field(default_factory=dict)
    damping: sp.csr_matrix | None = None

    @property
    def legend(self) -> str:
        """What the matrices are, in which units."""
        return _LEGEND

    def arrays(self) -> dict[str, object]:
        """All of them by flat names: mass, ..., contact_NAME_rows, interface_NAME, load_NAME."""
        arrays: dict[str, object] = {"mass": self.mass, "stiffness": self.stiffness, "rigid": self.rigid}
        if self.damping is not None:
            arrays["damping"] = self.damping
        for name, contact in self.contacts.items():
            for key in ("points", "directions", "area", "rows", "flexibility"):
                if (value := getattr(contact, key)) is not None:
                    arrays[f"contact_{name}_{key}"] = value
        arrays |= {f"interface_{name}": rows for name, rows in self.interfaces.items()}
        arrays |= {f"load_{name}": force for name, force in self.loads.items()}
        return arrays

    def to_pymor(self) -> SecondOrderModel:
        """Return a model of pyMOR, for its frequency responses and reductions; needs `pip install pymor`.

        Inputs are forces on the nodes of contacts along their directions, on interfaces (force and moment), and loads,
        in this order. Outputs are the motions of contacts and interfaces. The contacts' own flexibility is the
        feedthrough; that between two patches is left out. Transfer functions of more than 100 outputs need pyMOR's
        `set_defaults({"pymor.operators.interface.as_array_max_length.value": 1000})`.

        Returns
        -------
        pymor.models.iosys.SecondOrderModel

        Raises
        ------
        MissingPackageError
            If pyMOR is not installed.
        """
        iosys = require("pymor.models.iosys", "pymor")
        moved = [*(contact.rows for contact in self.contacts.values()), *self.interfaces.values()]
        none = sp.csr_matrix((0, self.mass.shape[0]))
        outputs = sp.vstack([none, *map(sp.csr_matrix, moved)], format="csr")
        inputs = sp.hstack([outputs.T, *(sp.csr_matrix(load[:, None]) for load in self.loads.values())], format="csr")
        given = [
            sp.csr_matrix((contact.rows.shape[0],) * 2) if contact.flexibility is None else contact.flexibility
            for contact in self.contacts.values()
        ]
        n = sum(len(rows) for rows in self.interfaces.values())
        own = sp.block_diag([*given, sp.csr_matrix((n, n))])
        through = sp.hstack([own, sp.csr_matrix((own.shape[0], len(self.loads)))], format="csr")
        damping = sp.csr_matrix(self.mass.shape) if self.damping is None else self.damping
        dense = [matrix.toarray() for matrix in (inputs, outputs, through)]
        return iosys.SecondOrderModel.from_matrices(
            self.mass, damping, self.stiffness, dense[0], dense[1], D=dense[2], name="body"
        )

    def save(self, path: str | Path) -> Path:
        """Write to a file of MATLAB, `.mat`, or to a folder of Matrix Market files, one for each array.

        Parameters
        ----------
        path : str or Path
            Ending with `.mat`, or a folder, which is made if it is not there; `legend.txt` there says what they are.
            Names are those of `arrays`, with letters, digits and underscores alone; the legend says which are others.

        Returns
        -------
        Path

        Raises
        ------
        InputError
            If it has another ending, or no file can stand there.
        OutputError
            If the system cannot write.
        """
        path, io = Path(path), require("scipy.io")
        plain, renamed = self._with_plain_names()
        labels = [f"{i}: {label}" for i, label in enumerate(self.coordinates)]
        said = "\n".join([self.legend, *renamed, "", *labels])
        if path.suffix == ".mat":
            with replacing(writable(path)) as file:
                io.savemat(file, {"legend": said, **plain.arrays()})
        elif not path.suffix:
            with filling(path, last="legend.txt") as new:
                for name, value in plain.arrays().items():
                    matrix = value if sp.issparse(value) else np.atleast_2d(np.asarray(value))
                    io.mmwrite(new / f"{name}.mtx", matrix, precision=17)
                (new / "legend.txt").write_text(said, encoding="utf-8")
        else:
            raise InputError(f"path: expected a file that ends with .mat, or a folder, got {str(path)!r}")
        return path

    def _with_plain_names(self) -> tuple[BodyMatrices, list[str]]:
        """Return the same with names that MATLAB and file systems take, and a line for each that is another."""
        changed: dict[str, Any] = {}
        said: list[str] = []
        for kind in ("contacts", "interfaces", "loads"):
            given = getattr(self, kind)
            plain = distinct(_NOT_PLAIN.sub("_", name)[:_LONGEST] for name in given)
            changed[kind] = dict(zip(plain, given.values(), strict=True))
            pairs = zip(given, plain, strict=True)
            said += [f"In names of files and variables, {old!r} is {new}." for old, new in pairs if old != new]
        return replace(self, **changed), said
