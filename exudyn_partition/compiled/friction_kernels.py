"""Compiled evaluation of contacts with friction in explicit steps; `friction_steps` does the same by NumPy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..algebra.friction_kernels import (
    FrictionLimits,
    FrictionObject,
    close_by_state,
    close_rows,
    iterate_friction,
    turn_to,
)
from ..algebra.product_kernels import matrix_at
from ..contact.kernels import choose_near, coordinates_of, gaps_of_contact, pushed_gap, slid
from ..support.arrays import Array
from ..support.compiled import compiled, inner
from .rubbing_kernels import accept_rubbing, anchor_rubbing, push_rubbing, rub
from .rubbing_pair_kernels import accept_pairs, anchor_pairs, lack_rough_rows, push_pairs, rub_pairs, watch_rough_edges

if TYPE_CHECKING:
    from .friction_plan import Choosing
    from .loops import Peaks, Samples
    from .rough_kernels import Friction, Rubs

N_ROWS, N_CLOSED, STALE, STEPS, ITERATIONS = range(5)  # see `algebra.flat_friction`
OPEN, STICK, SLIP = 0, 1, 2


@inner
def places_of_rows(f: Friction, q: Array, q_from: Array) -> bool:
    """Set gaps at coordinates q, ways since q_from and coefficients; whether pairs stay frozen and gaps are finite."""
    starts, total = f.rows.starts, 0.0
    for j in range(len(f.ways)):
        first, end = starts[j], starts[j + 1]
        q_j, from_j, nr = coordinates_of(f.rows, j, q), coordinates_of(f.rows, j, q_from), end - first
        if not slid(f.rows, j, q_j) <= f.rows.reach[j]:
            return False
        gaps_of_contact(f.rows, j, q_j, f.gap[first:end])
        n, static, kinetic, decay = len(q_j), f.coulomb[j, 0], f.coulomb[j, 1], f.coulomb[j, 2]
        along = f.numbers[f.ways[j] :][: 2 * nr * n].reshape(n, nr, 2)
        for i in range(first, end):
            f.way[i, 0], f.way[i, 1], f.pushed[i], f.mu[i] = 0.0, 0.0, f.gap[i], static
            total += f.gap[i]
            if f.slipped[i]:
                share = math.exp(-f.speed[i] / decay) if decay > 0.0 else 0.0
                f.mu[i] = kinetic + (static - kinetic) * share
        for k in range(n):
            moved = q_j[k] - from_j[k]
            for i in range(nr):
                f.way[first + i, 0] += moved * along[k, i, 0]
                f.way[first + i, 1] += moved * along[k, i, 1]
    return math.isfinite(total)


@inner
def close_pushed_rows(f: Friction, g: int, shut: float) -> bool:
    """Let rows enter that forces on their contact push shut; whether there are any."""
    starts, top, found = f.rows.starts, f.rows.starts[f.groups[g]], False
    size = 3 * (starts[f.groups[g + 1]] - top)
    F, lam = matrix_at(f.flexible, f.F_starts[g], size, size), f.lam.reshape(-1)
    for j in range(f.groups[g], f.groups[g + 1]):
        first, end, least = starts[j], starts[j + 1], 0.0
        for i in range(first, end):
            least = min(least, f.pushed[i])
        for i in range(first, end if least < 0.0 else first):
            if not f.near[i]:
                own = F[3 * (i - top), 3 * (first - top) : 3 * (end - top)]
                if pushed_gap(f.pushed[i], own, lam[3 * first : 3 * end]) < shut * least:
                    f.near[i] = found = True
    f.fresh[g] = f.fresh[g] or found
    return found


@inner
def set_up(f: Friction, g: int, choosing: Choosing) -> None:
    """Take the problem of the chosen rows of a group, with states of the last answer as a guess."""
    starts, p = f.rows.starts, f.problem
    top, end = starts[f.groups[g]], starts[f.groups[g + 1]]
    size, n = 3 * (end - top), 0
    F_all = matrix_at(f.flexible, f.F_starts[g], size, size)
    for i in range(top, end):
        if f.near[i]:
            f.chosen[top + n] = i - top
            n += 1
    F = matrix_at(p.F, 0, 3 * n, 3 * n)
    for i in range(n):
        for a in range(3):
            of_all, of_near = F_all[3 * f.chosen[top + i] + a], F[3 * i + a]
            for j in range(n):
                for b in range(3):
                    of_near[3 * j + b] = of_all[3 * f.chosen[top + j] + b]
        p.state[i] = f.status[top + f.chosen[top + i]]
    i = 0
    for contact in range(f.groups[g], f.groups[g + 1]):
        first, d, trace = i, 3 if f.frictional[contact] else 1, 0.0
        while i < n and f.chosen[top + i] + top < starts[contact + 1]:
            for a in range(d):
                trace += F[3 * i + a, 3 * i + a]
            i += 1
        for k in range(first, i):
            for a in range(d):
                F[3 * k + a, 3 * k + a] += choosing[5] * trace / (d * (i - first))
    for k in range(n):
        u, v = 1.0 / F[3 * k + 1, 3 * k + 1], 1.0 / F[3 * k + 2, 3 * k + 2]
        p.inverse[3 * k] = 1.0 / F[3 * k, 3 * k]
        p.inverse[3 * k + 1] = p.inverse[3 * k + 2] = 0.5 * (u + v)
    p.counts[N_ROWS], f.fresh[g] = n, False
    close_by_state(p)


@inner
def moved_by(p: FrictionObject, forces: Array, moved: Array) -> None:
    """Set how far forces, (3 n,), move the rows of a problem, (3 n,)."""
    m = 3 * p.counts[N_ROWS]
    F = matrix_at(p.F, 0, m, m)
    for i in range(m):
        moved[i] = 0.0
    for j in range(m):
        push, column = forces[j], F[j]
        if push != 0.0:
            for i in range(m):
                moved[i] += push * column[i]


@inner
def push_others(f: Friction, g: int) -> None:
    """Set gaps with the displacements that the last forces on the other contacts of the group cause."""
    starts, first = f.rows.starts, f.groups[g]
    top, end = starts[first], starts[f.groups[g + 1]]
    size = 3 * (end - top)
    F = matrix_at(f.flexible, f.F_starts[g], size, size)
    for j in range(first, f.groups[g + 1]):
        for i in range(starts[j], starts[j + 1]):
            f.pushed[i], of_row = f.gap[i], F[3 * (i - top)]
            for k in range(top, end):
                if (k < starts[j] or k >= starts[j + 1]) and f.lam[k, 0] != 0.0:
                    for a in range(3):
                        f.pushed[i] += of_row[3 * (k - top) + a] * f.lam[k, a]


@inner
def open_rows(f: Friction, top: int, end: int) -> None:
    """Open rows."""
    for i in range(top, end):
        f.status[i] = OPEN
        for a in range(3):
            f.lam[i, a] = 0.0
        f.slips[i, 0], f.slips[i, 1] = 0.0, 0.0


@inner
def solve_near(f: Friction, top: int, end: int, fresh: bool, guess: bool, limits: FrictionLimits) -> bool:
    """Find the forces on the chosen rows, which are those of the problem; whether they settle.

    With `guess`, they are guessed from those of the last two steps.
    """
    p, last, before, least = f.problem, f.forces, f.before, 0.0
    n = p.counts[N_ROWS]
    for i in range(n):
        row = top + f.chosen[top + i]
        for a in range(3):
            p.step[3 * i + a] = last[row, a]
    moved_by(p, p.step, f.moved)
    for i in range(n):
        row = top + f.chosen[top + i]
        f.h[i, 0], f.mu_near[i], least = f.gap[row], f.mu[row], min(least, f.gap[row])
        ahead = 2.0 * last[row, 0] - before[row, 0]
        go_on = guess and last[row, 0] > 0.0 and before[row, 0] > 0.0 and ahead > 0.0
        for a in range(3):
            if a > 0:
                f.h[i, a] = f.way[row, a - 1] - f.moved[3 * i + a]
            if go_on:
                p.lam[3 * i + a] = 2.0 * last[row, a] - before[row, a]
            elif guess or fresh:
                p.lam[3 * i + a] = last[row, a]
    if least >= 0.0:
        open_rows(f, top, end)
        p.counts[N_CLOSED] = 0
        for i in range(n):
            p.state[i], p.lam[3 * i], p.lam[3 * i + 1], p.lam[3 * i + 2] = OPEN, 0.0, 0.0, 0.0
        close_rows(p)
        return True
    if p.counts[N_CLOSED] == 0:
        na = 0
        for i in range(n):
            if f.h[i, 0] < 0.0:
                p.closed[na] = i
                na += 1
        p.counts[N_CLOSED] = na
        close_rows(p)
    if not iterate_friction(p, f.h[:n], f.mu_near, limits):
        return False
    open_rows(f, top, end)
    moved_by(p, p.lam, f.moved)
    for i in range(n):
        row = top + f.chosen[top + i]
        f.status[row], f.energy[row] = p.state[i], 0.0
        for a in range(3):
            f.lam[row, a] = p.lam[3 * i + a]
            f.energy[row] += 0.5 * p.lam[3 * i + a] * f.moved[3 * i + a]
        f.slips[row, 0], f.slips[row, 1] = f.h[i, 1] + f.moved[3 * i + 1], f.h[i, 2] + f.moved[3 * i + 2]
    return True


@inner
def count_iterations(f: Friction, g: int, count: int) -> None:
    """Count iterations for the contacts with friction of a group, of several for those with closed rows."""
    several = f.groups[g + 1] - f.groups[g] > 1
    for j in range(f.groups[g], f.groups[g + 1]):
        closed = not several
        for i in range(f.rows.starts[j], f.rows.starts[j + 1]):
            closed = closed or f.status[i] != OPEN
        if closed and f.frictional[j]:
            f.iterations[j] += count


# Rows that follow the motion. What a run does not have is None, so that loops are not compiled for it.


@inner
def place_moving(f: Friction, rubs: Rubs | None, q: Array) -> bool:
    """Set gaps, tangents and ways of these rows; False if gaps are not finite, or other rows must be found."""
    if rubs is not None:
        return rub(f, rubs, rubs.surfaces, q) and rub_pairs(f, rubs, rubs.pairs, q)
    return True


@inner
def anchor_moving(f: Friction, rubs: Rubs | None, g: int, q: Array) -> None:
    """Find the flexibility of the rows of a group again that have moved far since."""
    if rubs is not None:
        anchor_rubbing(f, rubs, rubs.surfaces, g, q)
        anchor_pairs(f, rubs, rubs.pairs, g, q)


@inner
def lack_rows(f: Friction, rubs: Rubs | None) -> bool:
    """Whether forces may push rows shut that are not followed."""
    return rubs is not None and lack_rough_rows(f, rubs, rubs.pairs)


@inner
def push_moving(f: Friction, rubs: Rubs | None, q: Array, force: Array) -> None:
    """Add the generalised forces of these rows."""
    if rubs is not None:
        push_rubbing(f, rubs, rubs.surfaces, q, force)
        push_pairs(f, rubs, rubs.pairs, q, force)


@inner
def accept_moving(f: Friction, rubs: Rubs | None) -> None:
    """Take the answer as the end of a step, from which rows slide in the next one."""
    if rubs is not None:
        accept_rubbing(f, rubs, rubs.surfaces)
        accept_pairs(f, rubs, rubs.pairs)


@inner
def watch_edges_of_rough(f: Friction, rubs: Rubs | None, q: Array) -> None:
    """Keep the coordinates of the first sample in which a closed row of two bodies leaves its patch."""
    if rubs is not None:
        watch_rough_edges(f, rubs, rubs.pairs, q)


@inner
def solve_group(f: Friction, rubs: Rubs | None, g: int, q: Array, limits: FrictionLimits, choosing: Choosing) -> bool:
    """Find the forces of a group of contacts; whether they settle."""
    starts, first, last = f.rows.starts, f.groups[g], f.groups[g + 1]
    top, end, least, pushing = starts[first], starts[last], 0.0, False
    for i in range(top, end):
        least = min(least, f.gap[i])
        pushing = pushing or f.lam[i, 0] != 0.0 or f.forces[i, 0] != 0.0
    several = last - first > 1
    if least >= 0.0 and not (several and pushing):
        open_rows(f, top, end)
        return True
    anchor_moving(f, rubs, g, q)
    if several and pushing:
        push_others(f, g)
    if f.owner[0] != g:
        turn_to(f.problem, f.pool, g, top, f.F_starts[g], end - top, limits[4])
        f.owner[0] = g
    before = f.problem.counts[ITERATIONS]
    for number in range(choosing[6]):
        fresh = f.fresh[g]
        for j in range(first, last):
            some = slice(starts[j], starts[j + 1])
            changed = choose_near(f.pushed[some], f.forces[some], f.near[some], number > 0, choosing[:5])
            fresh = changed or fresh
        if fresh:
            set_up(f, g, choosing)
        if not solve_near(f, top, end, fresh, number == 0, limits):
            return False
        if several:
            push_others(f, g)
        if not close_pushed_rows(f, g, choosing[7]):
            count_iterations(f, g, f.problem.counts[ITERATIONS] - before)
            return True
    return False


@inner
def values_of_contact(f: Friction, j: int, force: Array) -> None:
    """Set values of sensors and energies of a contact, and add its generalised forces."""
    flat, start, end = f.rows, f.rows.starts[j], f.rows.starts[j + 1]
    nr, dofs, least = end - start, flat.dofs[flat.places[j] : flat.places[j + 1]], np.inf
    n, values, friction = len(dofs), f.values[j], f.friction[j]
    normals = matrix_at(flat.numbers, flat.normals[j], nr, 3)
    H = matrix_at(flat.numbers, flat.H[j], n, nr)
    along = f.numbers[f.ways[j] :][: 2 * nr * n].reshape(n, nr, 2)
    for k in range(len(values)):
        values[k] = 0.0
    for k in range(len(friction)):
        friction[k] = 0.0
    stored = taken = 0.0
    for i in range(nr):
        row = start + i
        least = min(least, f.pushed[row])
        taken -= 0.5 * f.slips[row, 0] * (f.forces[row, 1] + f.lam[row, 1])
        taken -= 0.5 * f.slips[row, 1] * (f.forces[row, 2] + f.lam[row, 2])
        if f.status[row] != OPEN:
            push, u, v = f.lam[row, 0], f.lam[row, 1], f.lam[row, 2]
            stored += f.energy[row]
            values[0] += push
            values[1] += 1.0
            friction[3 if f.status[row] == STICK else 4] += 1.0
            for a in range(3):
                tangential = u * f.tangents[row, 0, a] + v * f.tangents[row, 1, a]
                values[2 + a] += push * normals[i, a] + tangential
                friction[a] += tangential
    for k in range(n if values[1] > 0.0 else 0):
        total = 0.0
        for i in range(nr):
            row = start + i
            total += f.lam[row, 0] * H[k, i] + f.lam[row, 1] * along[k, i, 0] + f.lam[row, 2] * along[k, i, 1]
        force[dofs[k]] += total
    closed = values[1] > 0.0
    values[5], f.taken[j] = least, taken if closed and f.frictional[j] else 0.0
    f.stored[j], friction[6] = stored, stored
    friction[5] = f.dissipated[j] + f.taken[j]


@compiled
def find_friction(f: Friction, rubs: Rubs | None, q: Array, q_from: Array, force: Array) -> bool:
    """Add generalised forces at coordinates q, in a step from q_from.

    False, and no forces are added, if pairs slide, forces do not settle, or other rows must be found.
    """
    limits, choosing = f.limits, f.choosing
    if not places_of_rows(f, q, q_from) or not place_moving(f, rubs, q):
        return False
    for g in range(len(f.F_starts)):
        if not solve_group(f, rubs, g, q, limits, choosing):
            return False
    if lack_rows(f, rubs):
        return False
    for j in range(len(f.ways)):
        values_of_contact(f, j, force)
    push_moving(f, rubs, q, force)
    return True


@compiled
def accept_friction(f: Friction, rubs: Rubs | None, step: float) -> None:
    """Take the answer as the end of a step [s], see `contact.memory.RowMemory.after`."""
    for i in range(len(f.gap)):
        slides = f.status[i] == SLIP
        way = math.sqrt(f.slips[i, 0] * f.slips[i, 0] + f.slips[i, 1] * f.slips[i, 1]) if slides else 0.0
        f.slipped[i], f.speed[i] = slides, way / step
        f.path[i] += way
        for a in range(3):
            f.before[i, a], f.forces[i, a] = f.forces[i, a], f.lam[i, a]
    for j in range(len(f.taken)):
        f.dissipated[j] += f.taken[j]
    accept_moving(f, rubs)


@inner
def watch_friction(f: Friction, peaks: Peaks, q: Array) -> None:
    """Keep the largest force of each contact, as `kernels.watch`; contacts with friction come last."""
    starts = f.rows.starts
    j_0, i_0 = len(peaks.force) - len(f.values), len(peaks.lam) - len(f.lam)
    for j in range(len(f.values)):
        if f.values[j, 1] > 0.0:
            for i in range(starts[j], starts[j + 1]):
                if f.lam[i, 0] > 0.0 and -f.gap[i] > peaks.depth[i_0 + i]:
                    peaks.depth[i_0 + i] = -f.gap[i]
        if f.values[j, 0] > peaks.force[j_0 + j]:
            peaks.force[j_0 + j] = f.values[j, 0]
            for k in range(len(q)):
                peaks.q[j_0 + j, k] = q[k]
            for i in range(starts[j], starts[j + 1]):
                peaks.lam[i_0 + i] = f.lam[i, 0]


@inner
def keep_friction(f: Friction, samples: Samples, place: int) -> None:
    """Write a sample of what is kept, as `kernels.keep`."""
    j_0 = samples.values.shape[1] - len(f.values)
    for j in range(len(f.values)):
        for k in range(f.values.shape[1]):
            samples.values[place, j_0 + j, k] = f.values[j, k]
        for k in range(f.friction.shape[1]):
            samples.friction[place, j, k] = f.friction[j, k]
    if len(samples.stored) > 0:
        i_0 = samples.lam.shape[1] - len(f.lam)
        for j in range(len(f.stored)):
            samples.stored[place, j_0 + j] = f.stored[j]
        for i in range(len(f.lam)):
            samples.lam[place, i_0 + i], samples.status[place, i] = f.lam[i, 0], f.status[i]
            for a in range(3):
                traction = f.lam[i, 1] * f.tangents[i, 0, a] + f.lam[i, 2] * f.tangents[i, 1, a]
                samples.traction[place, 3 * i + a] = traction
