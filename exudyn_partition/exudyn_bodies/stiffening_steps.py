"""Geometric stiffness in implicit steps: a force that is linear within a step, so that Newton's method needs no more.

The force is of third order in the coordinates, and Exudyn's Newton method iterates to 1e-8 of a step's first residual.
That is far below the error of the step itself. Without geometric stiffness, steps of bodies are often linear, and one
iteration is enough.

So the force f of a step is linear about an anchor x, with a tangent T that the Jacobian has:

    f(q) = f(x) + T (q - x) .

The solver guesses the step's end from its last accelerations. Its errors in the last steps improve the guess: that is
the anchor. What the force lacks then is of second order, (T(q) - T) (q - x). It may change the step by a small share of
what the solver changed of its guess, which is the size of the step's own error. If it is more, the true force comes
back, and Newton's method goes on. The Jacobian is computed again when such iterations have taken as long.

Theory: examples/site/theory.md, "Geometric stiffness".
"""

from __future__ import annotations

import numpy as np

from ..frames import loops
from ..reduction.body import ReducedBody
from ..reduction.geometric_stiffness import GeometricStiffness
from ..reduction.inertia_relief import static_answers
from ..support.arrays import Array
from ..support.foreign import MainSolver, MainSystem

_PAYS = 5  # number of iterations that take as long as a Jacobian, or longer
_LACKING = 2e-3  # share of the change of the solver's guess in a step, below which a force counts as linear
_RIGID = 1e-12  # of the largest flexibility: what is less is that of rigid motion
_SAME = 1e-6  # share of a step: rounding of times


class SteppedStiffening:
    """Force of a body's geometric stiffness, and its derivative, for Exudyn's solvers.

    Explicit and static solvers get the true force.

    Parameters
    ----------
    stiffening : GeometricStiffness
    body : ReducedBody
        The body that has it, on all its coordinates.
    """

    def __init__(self, stiffening: GeometricStiffness, body: ReducedBody) -> None:
        self._stiffening, self._static = stiffening, _stiffnesses(body)[-stiffening.states.shape[1] :]
        k = stiffening.states.shape[1]
        self._solver: MainSolver | None = None  # whose Jacobian has the tangent
        self._tangent = np.zeros((k, k))
        self._errors = np.zeros((3, k))
        self._guess, self._last, self._told, self._anchor, self._at_anchor = np.zeros((5, k))
        self._more = 0  # iterations since the last Jacobian that a better one might have spared
        self._t, self._step, self._dynamic = -np.inf, 0.0, self._static

    def force(self, mbs: MainSystem, t: float, q: Array) -> Array:
        """Generalised forces, (n_dofs,), that oppose deformation, by coordinates q, (n_dofs,), in a step to t [s]."""
        solver, stiffening = mbs.sys.get("dynamicSolver"), self._stiffening
        if self._solver is None or solver != self._solver:
            return loops.stiffening_force(stiffening, q)
        motion, it = stiffening.motion(q), solver.it
        if it.newtonSteps == 0:
            self._begin(t, it.currentStepSize)
            self._guess[:] = motion
            force = loops.stiffening_at_guess(
                stiffening, self._tangent, self._dynamic, self._errors, motion, self._anchor, self._at_anchor
            )
        else:
            force, linear = loops.stiffening_in_step(
                stiffening, self._tangent, self._dynamic, self._guess, _LACKING, motion, self._anchor, self._at_anchor
            )
            if not linear:
                self._more += 1
                if self._more == _PAYS:
                    mbs.solverSignalJacobianUpdate = True
        self._last[:], self._told[:] = motion, force
        return stiffening.on_coordinates(force)

    def tangent(self, mbs: MainSystem, q: Array, by_velocity: float) -> Array:
        """Derivative of `force`, (n_dofs, n_dofs), for a Jacobian with a factor of derivatives by velocities."""
        motion = self._stiffening.motion(q)
        tangent = self._stiffening.tangent_on_motion(motion)
        solver = mbs.sys.get("dynamicSolver") if by_velocity else None  # neither statics nor eigenvalues
        if solver != self._solver or solver is None:
            self._solver, self._t, self._guess[:], self._last[:] = solver, -np.inf, motion, np.nan
            self._set_step(0.0 if solver is None else solver.it.currentStepSize)
        self._tangent, self._anchor[:], self._more = tangent, motion, 0
        # The residual that the solver has at this motion must stay as it is, or Newton's method begins anew.
        told = np.array_equal(motion, self._last)
        self._at_anchor[:] = self._told if told else self._stiffening.force_on_motion(motion)
        return self._stiffening.matrix_on_coordinates(tangent)

    def _begin(self, t: float, step: float) -> None:
        """Begin a step to a time t [s], or begin it again."""
        if step == self._step and abs(t - self._t - step) < _SAME * step:
            self._errors[1:] = self._errors[:-1]
            self._errors[0] = self._last - self._guess
        elif t != self._t:
            self._errors[:] = 0.0
        if step != self._step:
            self._set_step(step)
        self._t = t

    def _set_step(self, step: float) -> None:
        self._step, self._dynamic = step, self._static + (4 / step**2 if step else 1.0)


def _stiffnesses(body: ReducedBody) -> Array:
    """Stiffness of each motion of a body's geometric stiffness, (k,), of unit mass [1/s2]; zero of rigid motion."""
    stiffening = body.stiffening
    assert stiffening is not None
    if stiffening.onto is None:
        return np.asarray(body.basis.omega**2)
    onto = stiffening.onto
    flexibility = np.sum(onto.T * static_answers(body.stiffness, body.mass, body.rigid, onto.T), axis=0)
    elastic = flexibility > _RIGID * flexibility.max()
    return np.where(elastic, 1 / np.where(elastic, flexibility, 1.0), 0.0)
