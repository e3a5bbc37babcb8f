"""Friction of a contact at a point: Cattaneo's and Mindlin's partial slip for any history, by rings of springs.

The method of dimensionality reduction is exact for circular contacts of similar materials: a contact of radius a is a
row of independent springs, of stiffness E* along the normal and G* across it per length, under the profile x^2 / R.
Each spring slips by itself. So partial slip needs no case for each history of forces.

An elliptic contact has a G* along each semi-axis, and R is that of the ball that yields as much. This too is exact for
forces along one of them: what slips and what sticks are ellipses of one shape.

Between bodies of different stiffness, pressure also moves the surfaces along each other, towards the middle of the
softer one. In round contacts each spring then has spokes, one for each direction from the middle, whose ends are moved
so. By projection of the half-space's equations on a line, this motion is the Hilbert transform of the pressure there.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".

References
----------
V.L. Popov, M. Hess, Method of Dimensionality Reduction in Contact Mechanics and Friction, 2015, chapter 5.

D.A. Spence, The Hertz contact problem with finite friction, Journal of Elasticity 5 (1975) 297.

R.D. Mindlin, Compliance of elastic bodies in contact, Journal of Applied Mechanics 16 (1949) 259.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...algebra.friction import OPEN, SLIP, STICK
from ...algebra.products import dense
from ...prediction.point_contact import PointContact
from ...support.arrays import Array
from ...support.attributes import FoundOnce
from ..law import Forces, Law, Places, RowDirections
from ..spot_directions import SpotDirections
from .hertz import LEFT_OUT, WIDEST, HertzCurve
from .point_step import settled

_SPRINGS = 24
_SPOKES = 6
_INNERMOST = 1 / 30  # of the largest radius of contact: where the first spring ends
_MOST, _SLIPPED = 60, 1e-13  # steps of Newton's method for slips of springs, and relative change of the last one
_SETTLED = 1e-12  # relative change of normal force and stretch that is none
_ALIKE = 0.02  # Dundurs' constant of bodies whose normal forces hardly move the springs
_SMALL = 1e-5  # change by which a derivative is found
_TINY = 1e-300  # whose logarithm is finite
_SLIPS = 1 - 1e-9  # share of the largest tangential force with which all springs slip
_ONE = np.zeros(1, dtype=np.int64)
_AS_TANGENTS = np.array([1.0, 0.0])  # direction of the first spoke in a contact that begins


class Held(NamedTuple):
    """Springs at a stretch of their ends.

    Parameters
    ----------
    forces : (n, 2) array
        Of the springs; they oppose the way of the slave [N].
    total : (2,) array
        Their sum [N].
    stiffness : (2, 2) array
        Derivative of the sum by the way [N/m].
    by_bounds : (n, 2) array
        Derivative of the force of each spring by its largest one; zero where it sticks.
    of_each : (n, 2, 2) array
        Derivative of the force of each spring by its elongation [N/m].
    """

    forces: Array
    total: Array
    stiffness: Array
    by_bounds: Array
    of_each: Array


class Driven(NamedTuple):
    """How the normal force moves the ends of springs against each other, along their spokes.

    Parameters
    ----------
    change : (n, 2) array
        Since the last accepted step, in parts that touch [m].
    by_force : (n, 2) array
        Derivative by the normal force [m/N].
    """

    change: Array
    by_force: Array


class Springs:
    """Springs beneath a contact, by their places x from its middle; each stands for both x and -x, or has spokes.

    Parameters
    ----------
    radius, modulus : float
        R [m] and E* [Pa].
    shear : (float, float)
        G* along the ellipse of contact and across it [Pa], see `PointContact.shear_moduli`.
    mismatch : float
        Dundurs' constant, if springs have spokes; by default they have none.
    """

    def __init__(self, radius: float, modulus: float, shear: tuple[float, float], mismatch: float = 0.0) -> None:
        self.radius, self.modulus, self.shear = radius, modulus, np.array(shear)
        self.ends = WIDEST * radius * np.r_[0.0, np.geomspace(_INNERMOST, 1.0, _SPRINGS)]
        self.spokes = spokes_of(mismatch)
        self.count = _SPRINGS * self.spokes
        turn = 2 * np.pi / self.spokes * np.arange(self.spokes)
        self._ways = np.tile(np.column_stack([np.cos(turn), np.sin(turn)]), (_SPRINGS, 1))
        # The springs have G*, and radial tractions move a half-space by E*.
        self._drive = -mismatch * modulus / (np.pi * radius * float(np.mean(shear)))

    def _ends(self, reach: float) -> Array:
        """Where springs begin and end up to a reach, (m + 1,) [m]; the last one has all beyond."""
        ends = np.minimum(self.ends, reach)
        ends[-1] = max(ends[-1], reach)
        return np.asarray(ends)

    def _on_spokes(self, values: Array) -> Array:
        """Values of rings, (m,), shared by their spokes, (n,)."""
        return np.asarray(np.repeat(values, self.spokes) / self.spokes)

    def reach(self, force: float) -> float:
        """Half the length that springs cover under a force [N]: [m]; in a round contact its radius."""
        return float((0.75 * force * self.radius / self.modulus) ** (1 / 3))

    def lengths(self, reach: float) -> Array:
        """Length that each spring stands for, (n,) [m], up to a reach [m]; the last one has all beyond."""
        return self._on_spokes(2 * np.diff(self._ends(reach)))

    def normal(self, reach: float) -> Array:
        """Normal forces of the springs, (n,) [N]."""
        ends = self._ends(reach)
        return self._on_spokes(2 * self.modulus / self.radius * np.diff(reach**2 * ends - ends**3 / 3))

    def normal_slope(self, reach: float) -> Array:
        """Derivative of the normal forces of springs by their sum, (n,)."""
        covered = self.lengths(reach)
        return np.asarray(covered / covered.sum()) if reach else covered

    def driven(self, since: float, reach: float, force: float, spoke: Array = _AS_TANGENTS) -> Driven | None:
        """How a normal force [N] moves springs up to its reach [m], after the reach `since` [m]; None without spokes.

        Free of tractions, the ends at x would have moved by W = (a^2 - x^2) ln((a + x) / (a - x)) + 2 a x, times a
        factor, since the contact of radius a was a point; in a part that begins to touch, only what follows counts.
        The first spoke is along a unit vector, (2,).
        """
        if self.spokes == 1 or not force:
            return None
        ends = self._ends(max(since, reach))
        width, directions = np.diff(ends), self._ways @ np.array([spoke, [-spoke[1], spoke[0]]])
        (before, _), (now, slope) = (_integrals_of_free_way(ends, a) for a in (since, reach))
        ways = []
        for along in (now - before, slope * reach / (3 * force)):
            mean = np.divide(np.diff(along), width, out=np.zeros_like(width), where=width > 0.0)
            ways.append((self._drive * np.repeat(mean, self.spokes))[:, None] * directions)
        return Driven(*ways)

    def bent(self, reach: float, force: float, spoke: Array) -> Array:
        """Derivative of `Driven.by_force` by the force, (n, 2) [m/N2], at a force [N] and its reach [m]."""
        there = (1 + _SMALL) * force, self.reach((1 + _SMALL) * force)
        now, later = self.driven(0.0, reach, force, spoke), self.driven(0.0, there[1], there[0], spoke)
        return np.zeros(2) if now is None or later is None else (later.by_force - now.by_force) / (_SMALL * force)

    def elongations(self, forces: Array, lengths: Array) -> Array:
        """Elongations of springs, (n, 2) [m], under forces, (n, 2) [N]; zero where they have no length."""
        stiffness = lengths[:, None] * self.shear
        return np.asarray(np.divide(forces, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0))

    def forces_up_to(self, elongations: Array, lengths: Array, bounds: Array) -> Held:
        """Springs that would have elongations, (n, 2) [m], along the ellipse and across it, by forces up to bounds.

        A spring that slips moves against its force, whatever its stiffness along both axes. With `lengths` and
        `bounds`, (n,) [m] and [N], its force f has |f| = bound and f (1 / (G* length) + slip / bound) = elongation.
        """
        stiffness = lengths[:, None] * self.shear
        forces, by_bounds = stiffness * elongations, np.zeros_like(elongations)
        slipping = np.einsum("nk,nk->n", forces, forces) > bounds**2
        forces[slipping & (bounds <= 0.0)] = stiffness[slipping & (bounds <= 0.0)] = 0.0
        slipping &= bounds > 0.0
        limit, yielding = bounds[slipping, None], 1 / stiffness[slipping]
        yielding += _slips(elongations[slipping], yielding, limit)
        forces[slipping], stiffness[slipping] = elongations[slipping] / yielding, 1 / yielding
        turns = forces[slipping] / yielding
        size = np.einsum("nk,nk->n", turns, forces[slipping])[:, None]
        by_bounds[slipping] = turns * limit / size
        of_each = stiffness[:, :, None] * np.eye(2)
        of_each[slipping] -= (turns / size)[:, :, None] * turns[:, None, :]
        return Held(forces, forces.sum(axis=0), of_each.sum(axis=0), by_bounds, of_each)


def spokes_of(mismatch: float) -> int:
    """Number of spokes of springs between bodies with Dundurs' constant."""
    return _SPOKES if abs(mismatch) > _ALIKE else 1


def _integrals_of_free_way(x: Array, a: float) -> tuple[Array, Array]:
    """Integrals from 0 to x of W in `Springs.driven`, and of its derivative by a; outside W stays as at the edge."""
    if not a:
        return 2 / 3 * x**3, np.zeros_like(x)
    inside = np.minimum(x, a)
    plus, minus = a + inside, a - inside
    logs = np.log(plus / a), np.log(np.maximum(minus / a, _TINY))
    way = (plus**2 * (minus + a) * logs[0] + minus**2 * (plus + a) * logs[1] + 2 * a * inside**2) / 3
    return way + 2 / 3 * (x**3 - inside**3), 2 * a * (plus * logs[0] + minus * logs[1])


def _slips(elongations: Array, yielding: Array, bounds: Array) -> Array:
    """Slip by the largest force of springs that slip, (k, 1) [m/N], by Newton's method from below."""
    slips = np.zeros_like(bounds)
    for _ in range(_MOST):
        forces = elongations / (yielding + slips)
        square = (forces**2).sum(axis=1, keepdims=True)
        slope = (forces**2 / (yielding + slips)).sum(axis=1, keepdims=True)
        # The inverse of the force's size is nearly linear in the slip, and linear with one G*.
        more = (np.sqrt(square) / bounds - 1) * square / slope
        slips = slips + more
        if (abs(more) <= _SLIPPED * (yielding[:, :1] + slips)).all():
            break
    return slips


class Yielding(NamedTuple):
    """How bodies yield beside the contact itself, in the axes of the ellipse.

    Parameters
    ----------
    normal : HertzCurve
    springs : Springs
    contact : PointContact
    between : (2,) array
        Tangential motion under a unit normal force, and the reverse [m/N].
    across : (2, 2) array
        Tangential flexibility where the contact has a radius of 1 m [m/N].
    curved : (2, 2) array
        What curved bodies add to it for each factor of e by which the contact is smaller [m/N].
    turn : (2, 2) array
        The axes of the ellipse in the tangents of the row, as rows.
    """

    normal: HertzCurve
    springs: Springs
    contact: PointContact
    between: Array
    across: Array
    curved: Array
    turn: Array

    def beside(self, force: float) -> Array:
        """Tangential flexibility of bodies, (2, 2) [m/N], where the contact is as large as under a normal force [N]."""
        if not force:
            return self.across
        a, b = self.contact.semi_axes(force)
        return np.asarray(self.across - 0.5 * math.log(a * b) * self.curved)


class FrictionTouch(NamedTuple):
    """Forces at a point, as far as they are found.

    Parameters
    ----------
    on_row : (3,) array
        On the slave, along the normal and the tangents of the row [N].
    stretch : (2,) array
        How far the ends of the springs move in this step, in the axes of the ellipse [m].
    held : Held
        The springs there.
    driven : Driven or None
    F : (2, 2) array
        Tangential flexibility of the bodies [m/N].
    slopes : _Slopes
        Without the curvature of `driven` over the normal force.
    size : float
        Largest elongation of the springs before this step [m].
    settled : bool
        See `Touch`.
    """

    on_row: Array
    stretch: Array
    held: Held
    driven: Driven | None
    F: Array
    slopes: _Slopes
    size: float = math.nan
    settled: bool = False

    @property
    def force(self) -> float:
        """Normal force [N]."""
        return float(self.on_row[0])

    @property
    def pushed(self) -> float:
        """Approach of the bodies by which forces of springs add to a normal force that moves them [m]."""
        return 0.0 if self.driven is None else float(np.sum(self.driven.by_force * self.held.forces))


class _Before(NamedTuple):
    """What a step begins with, in the axes of the ellipse.

    Parameters
    ----------
    force : float
        Normal force at the end of the last accepted step [N].
    last : (2,) array
        Tangential force then [N].
    reach : float
        Of the springs then [m].
    covered : (n,) array
        Their lengths then [m].
    carried : (n, 2) array
        Their forces then [N].
    spoke : (2,) array
        Unit vector along the first spoke, which turns with these forces.
    rest : (2,) array
        Way in this step, without what tangential forces of this step move the bodies [m].
    driven : Driven or None
        Motion of the springs' ends until then.
    """

    force: float
    last: Array
    reach: float
    covered: Array
    carried: Array
    spoke: Array
    rest: Array
    driven: Driven | None


class FrictionStep:
    """A step of a contact at a point with friction, see `point_step.PointStep`.

    Newton's method finds the approach and the stretch of the springs together.

    Parameters
    ----------
    law : HertzFriction
    places : Places
    """

    def __init__(self, law: HertzFriction, places: Places) -> None:
        self._law, self._places = law, places
        self._gap, self._force_before = float(places.gap[0]), float(places.last[0, 0])

    @FoundOnce
    def _mu(self) -> float:
        return float(self._places.mu[0])

    @FoundOnce
    def _yielding(self) -> Yielding:
        return self._law.yielding()

    @FoundOnce
    def _before(self) -> _Before:
        """What is known at the start of the step, with remembered forces in the axes of now."""
        yielding, places, force = self._yielding, self._places, self._force_before
        springs, turn = yielding.springs, yielding.turn
        last, reach = turn @ places.last[0, 1:], springs.reach(force)
        remembered = places.memory[0].reshape(-1, 2) @ turn.T
        remembered = remembered @ _turning(remembered[: springs.count], last)
        carried = remembered[: springs.count]
        spoke = remembered[-1] if springs.spokes > 1 and force else _AS_TANGENTS
        rest = turn @ places.way[0] - yielding.between * force - yielding.beside(force) @ last
        driven = springs.driven(0.0, reach, force, spoke)
        return _Before(force, last, reach, springs.lengths(reach), carried, spoke, rest, driven)

    def begin(self) -> FrictionTouch:
        """See `PointStep`: the forces of the last step, with springs that all stick or all slip."""
        if not self._force_before:
            return _OPEN
        before, yielding = self._before, self._yielding
        sticks = np.linalg.norm(before.last) < _SLIPS * self._mu * before.force
        stiffness = np.diag(sticks * before.covered.sum() * yielding.springs.shear)
        none = np.zeros_like(before.carried)
        held = Held(before.carried, -before.last, stiffness, none, none)
        on_row = np.array([before.force, *(yielding.turn.T @ before.last)])
        share = before.last / before.force
        slopes = _Slopes(np.zeros(2) if sticks else -share, np.zeros(2), 0.0)
        return FrictionTouch(on_row, np.zeros(2), held, before.driven, yielding.beside(before.force), slopes)

    def better(self, touch: FrictionTouch, moved: Array) -> FrictionTouch:
        """See `PointStep`."""
        gap, force = self._gap + float(moved[0]), touch.force
        if not force and gap >= 0.0:
            return _OPEN
        yielding, T = self._yielding, -touch.held.total
        curve, between, turning = yielding.normal, yielding.between, yielding.curved @ T / (3 * force or 1.0)
        approach = -gap - float(between @ T) + float(T @ turning) / 2 + touch.pushed
        if approach <= 0.0:
            return _OPEN._replace(settled=not force)
        rest = self._before.rest + yielding.turn @ moved[1:]
        if not force:
            P = curve.force(approach)
            return self._forces_at(P, rest + between * P)
        deep = curve.approach(force)
        off = np.array([deep - approach, *(touch.stretch - rest - between * force - touch.F @ T)])
        step = np.linalg.solve(self._derivative(touch, turning), off)
        deeper, stretch = deep - float(step[0]), touch.stretch - step[1:]
        P = curve.force(deeper if deeper > 0.0 else approach)
        most = _SETTLED * (touch.size + np.abs(stretch).max())
        if abs(P - force) <= _SETTLED * P and np.abs(step[1:]).max() <= most:
            return touch._replace(settled=True)
        return self._forces_at(P, stretch)

    def _derivative(self, touch: FrictionTouch, turning: Array) -> Array:
        """Derivative of the residual of `better` by the approach and the stretch, (3, 3)."""
        yielding, slopes, held = self._yielding, touch.slopes, touch.held
        k, between = yielding.normal.stiffness(touch.force), yielding.between - turning
        result = np.eye(3)
        result[0, 0] -= k * (between @ slopes.tangential + held.total @ turning / (2 * touch.force) + slopes.own)
        result[0, 1:] = -between @ held.stiffness - slopes.by_way
        result[1:, 0] = k * (touch.F @ slopes.tangential - between)
        result[1:, 1:] += touch.F @ held.stiffness
        return result

    def _forces_at(self, P: float, stretch: Array) -> FrictionTouch:
        """Forces under a normal force [N], where the ends of the springs move by `stretch`, (2,) [m]."""
        before, springs = self._before, self._yielding.springs
        reach = springs.reach(P)
        lengths, bounds = springs.lengths(reach), self._mu * springs.normal(reach)
        # Where the contact grows, new parts of springs have no elongation.
        kept = springs.elongations(before.carried, np.maximum(before.covered, lengths))
        driven = springs.driven(before.reach, reach, P, before.spoke)
        kept = kept if driven is None else kept + driven.change
        held = springs.forces_up_to(kept + stretch, lengths, bounds)
        on_row = np.array([P, *(self._yielding.turn.T @ -held.total)])
        slopes = _Slopes.of(held, self._mu * springs.normal_slope(reach), driven)
        F, size = self._yielding.beside(P), float(np.abs(kept).max())
        return FrictionTouch(on_row, stretch, held, driven, F, slopes, size)

    def forces(self, touch: FrictionTouch) -> Forces:
        """See `PointStep`."""
        if not touch.force:
            return self._opened()
        before, yielding, P, T = self._before, self._yielding, touch.force, -touch.held.total
        curve, springs, between, curved = yielding.normal, yielding.springs, yielding.between, yielding.curved
        turn, stretch, forces, F = yielding.turn, touch.stretch, touch.held.forces, touch.F
        reach = springs.reach(P)
        stored = 0.5 * float(np.sum(forces * springs.elongations(forces, springs.lengths(reach))))
        lost = 0.5 * float(np.sum(before.carried * springs.elongations(before.carried, before.covered))) - stored
        mean, pushed = (T + before.last) / 2, (touch.pushed + _pushed(before.driven, before.carried)) / 2
        taken, size = lost - float(mean @ stretch) + pushed * (P - before.force), float(mean @ mean)
        along = taken
        if touch.driven is not None:  # springs slip towards the middle, too
            along = min(taken, math.sqrt(size * float(stretch @ stretch)))
        remembered = forces if springs.spokes == 1 else np.vstack([forces, before.spoke])
        status = SLIP if np.linalg.norm(T) >= _SLIPS * self._mu * P else STICK
        stored += float(0.5 * T @ F @ T - T @ curved @ T / 6 + P * (between @ T)) - P * touch.pushed

        def stiffness() -> Array:
            bent = float(np.sum(touch.held.forces * springs.bent(reach, P, before.spoke)))
            slopes = touch.slopes._replace(own=touch.slopes.own + bent)
            moved = between - curved @ T / (3 * P)
            return _stiffness(curve.stiffness(P), slopes, touch.held.stiffness, F, moved, turn)

        return Forces(
            touch.on_row[None],
            _ONE,
            np.array([status], dtype=np.int8),
            -along * (turn.T @ mean)[None] / size if size > 0 else np.zeros((1, 2)),
            taken=taken - along,
            memory=(remembered @ turn).reshape(1, -1),
            stored=curve.stored(P) + stored,
            stiffness=stiffness,
        )

    def _opened(self) -> Forces:
        """Answer without contact."""
        none, memory = np.zeros((1, 3)), np.zeros((1, self._law.memory))
        return Forces(none, _ONE[:0], np.array([OPEN], dtype=np.int8), none[:, 1:], memory=memory, stored=0.0)


class HertzFriction(Law):
    """Forces of a contact at a point with Coulomb friction, see `hertz.HertzPoint` for the normal one.

    The tangential way of the kernels, less what the tangential flexibility of the bodies yields, stretches springs.
    From the flexibility under the kernels a half-space's is taken away, (2 - nu) / (2 (1 - nu)) times that along the
    normal. What curved bodies add to a half-space's grows with the logarithm of kernel by contact, so that it has the
    present contact. Between unlike bodies, normal forces move the ends of springs, and the springs' forces push back.

    Parameters
    ----------
    rows : SpotDirections
    """

    elastic = False

    def __init__(self, rows: RowDirections) -> None:
        assert isinstance(rows, SpotDirections)
        self.rows, self.gaps = rows, rows.gaps
        self._mismatch = self.gaps.own.mismatch if self.gaps.own.circular else 0.0
        spokes = spokes_of(self._mismatch)
        self.memory = 2 * (_SPRINGS * spokes + (spokes > 1))  # forces, and the direction of the first spoke
        self._known: tuple[Array, PointContact, float, HertzCurve] | None = None
        self._springs: tuple[PointContact, Springs] | None = None

    def _curve(self, share: float) -> tuple[HertzCurve, Array, Springs]:
        """Force by approach of a share of the contact, flexibility without that of the point, (3, 3) [m/N], springs."""
        F, lacking = self.rows.flexibility(_ONE), self.gaps.spot_rows.lacking
        series = F + np.diag([lacking[0], lacking[1], lacking[1]])
        contact, then, known = self.gaps.contact, self.gaps.spot_rows.contact, self._known
        if known is None or known[1:3] != (contact, share) or not np.array_equal(known[0], series):
            known = self._known = series, contact, share, HertzCurve(float(series[0, 0]), contact, share)
        if self._springs is None or self._springs[0] != then:
            self._springs = then, Springs(then.sphere, then.modulus, self.gaps.spot_rows.shear, self._mismatch)
        return known[3], series, self._springs[1]

    def yielding(self, share: float | None = None) -> Yielding:
        """How bodies yield beside the contact, of which a share is on the present faces; by default that of now."""
        curve, F, springs = self._curve(share or self.gaps.spot_stage.share or 1.0)
        turn, curved, fixed = self.gaps.stage.once(("point", self.rows.axis), self._axes)
        return Yielding(
            curve, springs, self.gaps.spot_rows.contact, turn @ F[1:, 0], turn @ (F[1:, 1:] + fixed) @ turn.T,
            turn @ curved @ turn.T, turn,
        )  # fmt: skip

    def _axes(self) -> tuple[Array, Array, Array]:
        """Axes of the ellipse as rows, (2, 2), and what curved bodies add, (2, 2) [m/N], see `SpotGaps.curved`."""
        tangents = self.rows.tangents[0]
        curved, fixed = self.gaps.curved(tangents)
        # Also where other faces, that share the contact, make an ellipse of it.
        if self.gaps.own.circular or self.gaps.spot_rows.even:
            return np.eye(2), curved, fixed
        along = tangents @ self.gaps.long_axis
        along /= np.linalg.norm(along)
        return np.array([along, [-along[1], along[0]]]), curved, fixed

    def beside(self, force: float) -> Array:
        """Residual flexibility of the bodies beside the contact, along the ellipse and across it, (2, 2) [m/N].

        It is that beyond half-spaces, with a contact under a normal force [N].
        """
        return self.yielding(1.0).beside(force)

    def step(self, places: Places) -> FrictionStep:
        """See `point_step.PointLaw`."""
        return FrictionStep(self, places)

    def answer(self, places: Places) -> Forces:
        """See `Law`."""
        return settled(self.step(places))

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`; that at the largest contact for which the law is Hertz's."""
        H, yielding = dense(rows.jacobian(_ONE)), self.yielding(1.0)
        largest, turn, springs = yielding.normal.largest, yielding.turn, yielding.springs
        k = np.diag(springs.lengths(springs.reach(largest)).sum() * springs.shear)
        F = yielding.beside(largest)
        K = _stiffness(yielding.normal.stiffest, _Slopes(np.zeros(2), np.zeros(2), 0.0), k, F, np.zeros(2), turn)
        return np.asarray(H.T @ ((K + K.T) / 2) @ H)

    @property
    def left_out(self) -> list[str]:
        """See `Law`."""
        said, mismatch = [*LEFT_OUT, "friction against spin about the line of contact"], abs(self.gaps.own.mismatch)
        if mismatch > _ALIKE and not self.gaps.own.circular:
            said.append(
                "the slip at the edge of an elliptic contact that normal forces cause between bodies of different "
                f"stiffness, rigid ones too (Dundurs' constant {mismatch:.2g}): where it would stick, it is too stiff "
                "along the surface"
            )
        return said

    def semi_axes(self, force: float) -> tuple[float, float]:
        """See `Law`."""
        return self.gaps.contact.semi_axes(force)


def _pushed(driven: Driven | None, forces: Array) -> float:
    """Approach of the bodies by which forces of springs, (n, 2) [N], add to a normal force that moves them [m]."""
    return 0.0 if driven is None else float(np.sum(driven.by_force * forces))


class _Slopes(NamedTuple):
    """How forces of springs follow the normal one, and what that does to the approach.

    Parameters
    ----------
    tangential : (2,) array
        Derivative of the tangential force of the springs by the normal one.
    by_way : (2,) array
        Derivative of `_pushed` by the stretch of the springs.
    own : float
        Derivative of `_pushed` by the normal force [m/N].
    """

    tangential: Array
    by_way: Array
    own: float

    @classmethod
    def of(cls, held: Held, by_force: Array, driven: Driven | None) -> _Slopes:
        """Slopes of springs whose largest forces have the derivatives `by_force`, (n,), by the normal force.

        With `driven`, how the normal force moves the springs, which is linear in their forces.
        """
        forces = by_force[:, None] * held.by_bounds
        if driven is None:
            return cls(forces.sum(axis=0), np.zeros(2), 0.0)
        pulled = np.einsum("nij,nj->ni", held.of_each, driven.by_force)
        forces = forces + pulled
        through_force = float(np.sum(forces * driven.by_force))
        return cls(forces.sum(axis=0), pulled.sum(axis=0), through_force)


def _stiffness(normal: float, slopes: _Slopes, own: Array, F: Array, moved: Array, turn: Array) -> Array:
    """See `Forces`, (3, 3) [N/m].

    Parameters
    ----------
    normal : float
        Of the normal force by Hertz [N/m].
    slopes : _Slopes
    own : (2, 2) array
        Tangential stiffness of the springs [N/m].
    F, moved : (2, 2) and (2,) arrays
        Tangential flexibility of the bodies, and their tangential motion under a unit normal force [m/N].
    turn : (2, 2) array
        From the tangents of the row to the axes of all these.
    """
    eased = np.linalg.inv(np.eye(2) + own @ F)
    by_force, by_way = eased @ (slopes.tangential + own @ moved), eased @ slopes.by_way
    K = np.zeros((3, 3))
    if normal:
        pushed = slopes.own + slopes.by_way @ (moved - F @ by_force)
        K[0, 0] = 1 / (1 / normal - pushed)
    K[0, 1:], K[1:, 0] = -K[0, 0] * turn.T @ by_way, -K[0, 0] * turn.T @ by_force
    K[1:, 1:] = turn.T @ (eased @ own + K[0, 0] * np.outer(by_force, by_way)) @ turn
    return K


def _turning(forces: Array, last: Array) -> Array:
    """Rotation, (2, 2), of vectors that were remembered in earlier axes, into the present ones; for use from the right.

    It turns the sum of the springs' forces, (n, 2) [N], to the direction of `last`, (2,) [N], which is the same force
    on the slave in the present axes.
    """
    remembered = -forces.sum(axis=0)
    size = np.hypot(*remembered) * np.hypot(*last)
    if size == 0.0:
        return np.eye(2)
    c = float(remembered @ last) / size
    s = float(remembered[0] * last[1] - remembered[1] * last[0]) / size
    return np.array([[c, s], [-s, c]])


_OPEN = FrictionTouch(
    np.zeros(3),
    np.zeros(2),
    Held(np.zeros((0, 2)), np.zeros(2), np.zeros((2, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2))),
    None,
    np.zeros((2, 2)),
    _Slopes(np.zeros(2), np.zeros(2), 0.0),
    settled=True,
)
