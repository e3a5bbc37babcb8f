"""The part of a body's static answer to forces that its kept shapes do not contain (mode acceleration).

Theory: examples/site/theory.md, "Stress near a contact".
"""

from __future__ import annotations

import numpy as np

from ..algebra.blas_threads import one_blas_thread
from ..algebra.krylov import mass_normalised
from ..algebra.sparse.flexibility import FreeBodyFlexibility
from ..errors import InputError
from ..fe.model import FEModel, node_dofs
from ..fe.partition import number_of_patch
from ..support.arrays import Array
from ..support.checks import validate_type
from .body import ReducedBody
from .loads import pressure
from .tied import tie


def static_correction(fem: FEModel, body: ReducedBody, patch: int | str | None = None) -> Array:
    """Static displacement by a unit contact force, without the part in the kept shapes: mode acceleration.

    The force is a uniform pressure on the contact patch. So the result is valid where the size of the patch does not
    matter. It completes a recovered history, with `force` positive in compression::

        item.recover(result, rows) + np.outer(contact.force(result), rows @ static_correction(fem, body).ravel())

    The inertia of the cut modes is still missing, as in the contact itself. Its size is of the order of (f / f_cut)^2.

    Parameters
    ----------
    fem : FEModel
    body : ReducedBody
        Of `fem`, with the residual or contact-adapted basis.
    patch : int or str, optional
        Which contact patch, if there are several.

    Returns
    -------
    (n, 3) array
        [m/N]

    Raises
    ------
    InputError
        If an argument is no such thing, the basis has no residual flexibility, or the body is of another FE model.

    References
    ----------
    R. R. Craig, A. J. Kurdila, Fundamentals of Structural Dynamics, 2006, section 11.4.
    """
    answer = StaticAnswer(fem, body)
    return answer(
        -pressure(fem, body.partition.patches[number_of_patch(body.partition, patch, "patch")]).reshape(-1, 3)
    )


class StaticAnswer:
    """What the kept shapes of a body lack of the static answer to nodal forces; see `static_correction`.

    The body's stiffness is factorised once; each answer is one solution with it.

    Parameters
    ----------
    fem : FEModel
    body : ReducedBody
        Of `fem`, with the residual or contact-adapted basis.

    Raises
    ------
    InputError
        If the basis has no residual flexibility, or the body is of another FE model.
    """

    def __init__(self, fem: FEModel, body: ReducedBody) -> None:
        validate_type("body", body, ReducedBody, "reduce() or load_body()")
        checked = body.check_fem(fem)
        if body.basis.flexibility is None:
            raise InputError(
                f"body: basis {body.basis.name!r} has no residual flexibility, and so no static answer to add"
            )
        self._body = body
        with one_blas_thread():
            self._model = tie(checked, body.partition)
            rigid = mass_normalised(self._model.rigid_modes, self._model.mass)
            self._flexibility = FreeBodyFlexibility(self._model.stiffness, self._model.mass, rigid)

    def check(self, body: ReducedBody) -> None:
        """Raise unless the answers are those of `body`.

        Raises
        ------
        InputError
        """
        validate_type("body", body, ReducedBody, "reduce() or load_body()")
        if body.basis is not self._body.basis:
            raise InputError("fem: expected the FE model or the static answer of this body, got one of another body")

    def __call__(self, forces: Array, nodes: Array | None = None) -> Array:
        """Displacements of `nodes`, (k,), or of all, (..., k, 3) [m], by forces on all nodes, (..., n, 3) [N].

        Both are in the body's axes. Several loads, (m, n, 3), are solved at once.

        Raises
        ------
        InputError
            If the body was saved without its inside, and there are forces or nodes in it.
        """
        loads = forces.reshape(-1, *forces.shape[-2:])
        omega, loaded = self._body.basis.omega, np.flatnonzero(loads.any(axis=(0, 2)))
        elastic = omega > 0
        amplitude = np.zeros((len(elastic), len(loads)))
        by_shapes = self._body.shape_rows(loaded).T @ loads[:, loaded].reshape(len(loads), -1).T
        amplitude[elastic] = by_shapes[elastic] / omega[elastic, None] ** 2
        kept = self._body.shape_rows(nodes) @ amplitude
        with one_blas_thread():
            expand = self._model.expand
            answer = expand @ self._flexibility(expand.T @ loads.reshape(len(loads), -1).T)
        whole = answer if nodes is None else answer[node_dofs(nodes)]
        return np.ascontiguousarray((whole - kept).T).reshape(*forces.shape[:-2], -1, 3)
