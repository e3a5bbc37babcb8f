"""When Newton's method of implicit steps gets a new Jacobian: where the age of the present one has cost as much."""

from __future__ import annotations

from dataclasses import dataclass

from ..support.foreign import MainSystem

_JACOBIAN = 5  # iterations of Newton's method that take as long as a Jacobian, in mechanisms of some 50 equations


@dataclass(frozen=True)
class Iterations:
    """How many iterations Newton's method has made, and what the age of its Jacobian has cost.

    Parameters
    ----------
    steps, jacobians : int
        Iterations and Jacobians of the run.
    fewest : int
        Least number of iterations in a step since the last Jacobian; 0 before there is one.
    excess : int
        Iterations above that since then.
    """

    steps: int = 0
    jacobians: int = 0
    fewest: int = 0
    excess: int = 0

    def after(self, steps: int, jacobians: int) -> Iterations:
        """Return the same after a step, with numbers of iterations and Jacobians of the run."""
        made = steps - self.steps
        if jacobians != self.jacobians or not self.fewest:
            return Iterations(steps, jacobians, made)
        fewest = min(made, self.fewest)
        return Iterations(steps, jacobians, fewest, self.excess + made - fewest)

    @property
    def too_many(self) -> bool:
        """Whether the age of the Jacobian has cost as much as a new one."""
        return self.excess >= _JACOBIAN


def renew(mbs: MainSystem, before: Iterations) -> Iterations:
    """Ask for a new Jacobian in the step that comes, if that saves time; return what is known of the run now.

    Exudyn's own rule looks at each iteration alone, and keeps a Jacobian with which all steps take some iterations
    more.
    """
    it = mbs.sys["dynamicSolver"].it
    now = before.after(it.newtonStepsCount, it.newtonJacobiCount)
    if now.too_many:
        mbs.solverSignalJacobianUpdate = True
    return now
