"""Work of a run: number of repeated steps, Jacobians and iterations of active sets, and the time in contacts."""

from __future__ import annotations

from dataclasses import dataclass

from ..exudyn_contacts.model_run import ModelRun
from ..exudyn_contacts.run_record import Solver


@dataclass(frozen=True)
class Work:
    """Counts of a run.

    Parameters
    ----------
    rejected_steps : int
        Number of steps that were repeated with a shorter length.
    jacobians, newton_iterations : int
        Counts of implicit steps.
    active_set_iterations : int
        Iterations of the active sets of all contacts.
    pair_searches : int
        Number of projections of all points of a contact onto its master.
    contact_s : float
        Time in contacts [s]; the rest of the run's time is Exudyn's.
    """

    rejected_steps: int = 0
    jacobians: int = 0
    newton_iterations: int = 0
    active_set_iterations: int = 0
    pair_searches: int = 0
    contact_s: float = 0.0

    @classmethod
    def counted(cls, solver: Solver | None, run: ModelRun | None) -> Work:
        """Work of a run, as far as Exudyn's solver and the contacts record it."""
        of_solver = (0, 0, 0) if solver is None else (solver.rejected_steps, solver.jacobians, solver.newton_iterations)
        of_contacts = (0, 0, 0.0) if run is None else (run.active_set_iterations, run.pair_searches, run.contact_s)
        return cls(*of_solver, *of_contacts)
