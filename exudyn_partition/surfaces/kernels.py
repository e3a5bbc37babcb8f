"""Compiled loops over pairs of points and facets; `pairs`, `surface` and `points` do the same by NumPy."""

from __future__ import annotations

import math

import numpy as np

from ..support.arrays import Array
from ..support.compiled import called, compiled, inlined
from .projection import CONVEX, SETTLED

Vector = tuple[float, float, float]


@inlined
def nearest_edge(r: float, s: float, quad: bool) -> tuple[float, int]:
    """Least distance from the edges of a facet, in its coordinates, and the number of that edge; positive inside."""
    least, edge = s, 0
    other = 1 - r if quad else 1 - r - s
    if other < least:
        least, edge = other, 1
    if quad and 1 - s < least:
        least, edge = 1 - s, 2
    if r < least:
        least, edge = r, 3 if quad else 2
    return least, edge


@inlined
def past_ends(r: float, s: float, f: int, ends: Array, quad: bool) -> tuple[float, float]:
    """How far a point of a facet is past the ends of its patch [m], and from its other edges, see `holders`."""
    out, inner = 0.0, np.inf
    for edge in range(ends.shape[1]):
        opposite = 1 - s if quad else r
        depth = s if edge == 0 else (1 - r if quad else 1 - r - s) if edge == 1 else opposite if edge == 2 else r
        if ends[f, edge] > 0.0:
            out = max(out, -depth * ends[f, edge])
        else:
            inner = min(inner, depth)
    return out, inner


@inlined
def is_quad(facets: Array) -> bool:
    """Whether facets are quadrilaterals, of four or eight nodes."""
    return bool(facets.shape[1] == 4 or facets.shape[1] == 8)


@inlined
def add_polynomials(which: Array, facets: Array, x_m: Array, table: Array, known: Array, out: Array, n: int) -> None:
    """See `find_polynomials`; n is the number of a facet's nodes."""
    for f in which:
        if known[f]:
            continue
        known[f] = True
        for power in range(len(table)):
            x, y, z = 0.0, 0.0, 0.0
            for j in range(n):
                share, node = table[power, j], facets[f, j]
                if share != 0.0:
                    x += share * x_m[node, 0]
                    y += share * x_m[node, 1]
                    z += share * x_m[node, 2]
            out[f, power, 0], out[f, power, 1], out[f, power, 2] = x, y, z


@compiled
def find_polynomials(which: Array, facets: Array, x_m: Array, table: Array, known: Array, out: Array) -> None:
    """Places on some facets as polynomials of their coordinates: coefficients, out (nf, 6 or 10, 3).

    A number that the compiler knows makes short loops straight ones; most facets have six nodes.
    """
    n = facets.shape[1]
    if n == 6:
        add_polynomials(which, facets, x_m, table, known, out, 6)
    else:
        add_polynomials(which, facets, x_m, table, known, out, n)


expand = called(find_polynomials)


@inlined
def coordinate_at(c: Array, f: int, r: float, s: float, axis: int, cubic: bool) -> tuple[float, float, float]:
    """A coordinate of a place on a facet, from `find_polynomials`, and its derivatives by r and s."""
    value = c[f, 0, axis] + r * (c[f, 1, axis] + r * c[f, 3, axis] + s * c[f, 4, axis])
    value += s * (c[f, 2, axis] + s * c[f, 5, axis])
    by_r = c[f, 1, axis] + 2 * r * c[f, 3, axis] + s * c[f, 4, axis]
    by_s = c[f, 2, axis] + r * c[f, 4, axis] + 2 * s * c[f, 5, axis]
    if cubic:
        value += r * r * (r * c[f, 6, axis] + s * c[f, 7, axis]) + s * s * (r * c[f, 8, axis] + s * c[f, 9, axis])
        by_r += 3 * r * r * c[f, 6, axis] + 2 * r * s * c[f, 7, axis] + s * s * c[f, 8, axis]
        by_s += r * r * c[f, 7, axis] + 2 * r * s * c[f, 8, axis] + 3 * s * s * c[f, 9, axis]
    return value, by_r, by_s


@inlined
def bends_on(c: Array, f: int, r: float, s: float, miss: Vector, cubic: bool) -> tuple[float, float, float]:
    """Second derivatives rr, rs and ss of a place on a facet, times a vector."""
    rr = rs = ss = 0.0
    for axis in range(3):
        by_rr, by_rs, by_ss = 2 * c[f, 3, axis], c[f, 4, axis], 2 * c[f, 5, axis]
        if cubic:
            by_rr += 6 * r * c[f, 6, axis] + 2 * s * c[f, 7, axis]
            by_rs += 2 * r * c[f, 7, axis] + 2 * s * c[f, 8, axis]
            by_ss += 2 * r * c[f, 8, axis] + 6 * s * c[f, 9, axis]
        rr += miss[axis] * by_rr
        rs += miss[axis] * by_rs
        ss += miss[axis] * by_ss
    return rr, rs, ss


@inlined
def newton_steps(
    first: int, end: int, x: Array, c: Array, facet: Array, local: Array, step: Array, normal: Array, gap: Array,
    frames: Array, cubic: bool,
) -> None:  # fmt: skip
    """Set steps of Newton's method, normals and gaps of points, x (k, 3), on their facets, see `pairs.follow`.

    Facets are looked up in a loop of its own, because the compiler makes vectors of the other one only. `frames`,
    (12, k), is room between them.
    """
    for i in range(first, end):
        f, r, s = facet[i], local[i, 0], local[i, 1]
        for axis in range(3):
            value, by_r, by_s = coordinate_at(c, f, r, s, axis, cubic)
            frames[axis, i], frames[3 + axis, i], frames[6 + axis, i] = x[i, axis] - value, by_r, by_s
        bends = bends_on(c, f, r, s, (frames[0, i], frames[1, i], frames[2, i]), cubic)
        frames[9, i], frames[10, i], frames[11, i] = bends
    for i in range(first, end):
        mx, my, mz = frames[0, i], frames[1, i], frames[2, i]
        ax, ay, az = frames[3, i], frames[4, i], frames[5, i]
        bx, by, bz = frames[6, i], frames[7, i], frames[8, i]
        aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
        am, bm = ax * mx + ay * my + az * mz, bx * mx + by * my + bz * mz
        squared = aa * bb - ab * ab
        scale = 1 / math.sqrt(squared)
        rr, rs, ss = aa - frames[9, i], ab - frames[10, i], bb - frames[11, i]
        det = rr * ss - rs * rs
        convex = det > CONVEX * squared and rr > CONVEX * aa
        rr, rs, ss, det = (rr, rs, ss, det) if convex else (aa, ab, bb, squared)
        step[i, 0], step[i, 1] = (ss * am - rs * bm) / det, (rr * bm - rs * am) / det
        nx, ny, nz = (ay * bz - az * by) * scale, (az * bx - ax * bz) * scale, (ax * by - ay * bx) * scale
        normal[i, 0], normal[i, 1], normal[i, 2] = nx, ny, nz
        gap[i] = mx * nx + my * ny + mz * nz


@compiled
def settle(
    some: Array, x: Array, c: Array, facet: Array, local: Array, step: Array, normal: Array, gap: Array,
    frames: Array, enough: float, steps: int, cubic: bool,
) -> None:  # fmt: skip
    """Go on with some points by Newton's method until their last steps are no more than `enough`.

    `local`, `step`, `normal` and `gap` of these points change.
    """
    for i in some:
        for _ in range(steps - 1):
            if max(abs(step[i, 0]), abs(step[i, 1])) <= enough:
                break
            local[i, 0] += min(max(step[i, 0], -1.0), 1.0)
            local[i, 1] += min(max(step[i, 1], -1.0), 1.0)
            newton_steps(i, i + 1, x, c, facet, local, step, normal, gap, frames, cubic)


go_on = called(settle)


@inlined
def place_all(nodes: Array, shares: Array, values: Array, result: Array) -> None:
    """Set vectors at points, (p, 3), of those at nodes, see `points.at_points`."""
    for i in range(len(nodes)):
        x, y, z = 0.0, 0.0, 0.0
        for j in range(nodes.shape[1]):
            share, node = shares[i, j], nodes[i, j]
            x += share * values[node, 0]
            y += share * values[node, 1]
            z += share * values[node, 2]
        result[i, 0], result[i, 1], result[i, 2] = x, y, z


@inlined
def weigh(local: Array, step: Array, table: Array, weights: Array) -> None:
    """Set the shape functions at points plus their change to first order by a step."""
    for j in range(weights.shape[1]):
        t0, t1, t2, t3, t4, t5 = table[0, j], table[1, j], table[2, j], table[3, j], table[4, j], table[5, j]
        for i in range(len(weights)):
            r, s, dr, ds = local[i, 0], local[i, 1], step[i, 0], step[i, 1]
            rr, rs, ss = r * (r + 2 * dr), r * s + dr * s + r * ds, s * (s + 2 * ds)
            weights[i, j] = t0 + (r + dr) * t1 + (s + ds) * t2 + rr * t3 + rs * t4 + ss * t5
    if len(table) == 10:
        for j in range(weights.shape[1]):
            t6, t7, t8, t9 = table[6, j], table[7, j], table[8, j], table[9, j]
            for i in range(len(weights)):
                r, s, dr, ds = local[i, 0], local[i, 1], step[i, 0], step[i, 1]
                rrr, rrs = r * r * (r + 3 * dr), r * r * (s + ds) + 2 * r * s * dr
                rss, sss = s * s * (r + dr) + 2 * r * s * ds, s * s * (s + 3 * ds)
                weights[i, j] += rrr * t6 + rrs * t7 + rss * t8 + sss * t9


@compiled
def follow_on(x: Array, nodes: Array, start: Array, table: Array, steps: int) -> tuple[Array, Array, Array, Array]:
    """Coordinates, (k, 2), weights, (k, n), normals, (k, 3), and gaps, (k,), see `pairs.follow`."""
    k, n, cubic = len(x), nodes.shape[1], len(table) == 10
    # Laid out as in `moving_kernels`: for others, `settle` would be compiled again.
    local, step, normal, frames = np.empty((2, k)).T, np.empty((2, k)).T, np.empty((3, k)).T, np.empty((12, k))
    facet, gap, places = np.arange(k), np.empty(k), np.zeros((k, len(table), 3))
    for i in range(k):
        local[i, 0], local[i, 1] = start[i, 0], start[i, 1]
        for power in range(len(table)):
            for j in range(n):
                for axis in range(3):
                    places[i, power, axis] += table[power, j] * nodes[i, j, axis]
    if cubic:
        newton_steps(0, k, x, places, facet, local, step, normal, gap, frames, True)
    else:
        newton_steps(0, k, x, places, facet, local, step, normal, gap, frames, False)
    go_on(facet, x, places, facet, local, step, normal, gap, frames, SETTLED, steps, cubic)
    weights, there, normals = np.empty((k, n)), np.empty((k, 2)), np.empty((k, 3))
    weigh(local, step, table, weights)
    for i in range(k):
        there[i, 0], there[i, 1] = local[i, 0] + step[i, 0], local[i, 1] + step[i, 1]
        normals[i, 0], normals[i, 1], normals[i, 2] = normal[i, 0], normal[i, 1], normal[i, 2]
    return there, weights, normals, gap


@inlined
def turned(turns: Array, f: int, edge: int, r: float, s: float) -> tuple[float, float]:
    """A step in the coordinates of a facet, in those of its neighbour across an edge."""
    return (
        turns[f, edge, 0, 0] * r + turns[f, edge, 0, 1] * s,
        turns[f, edge, 1, 0] * r + turns[f, edge, 1, 1] * s,
    )


@inlined
def cross_edge(
    facet: int, edge: int, r: float, s: float, across: Array, its_edge: Array, turns: Array, middles: Array
) -> tuple[int, float, float]:
    """The neighbour of a facet across an edge, and a point in its coordinates."""
    there = its_edge[facet, edge]
    dr, ds = turned(turns, facet, edge, r - middles[edge, 0], s - middles[edge, 1])
    return across[facet, edge], middles[there, 0] + dr, middles[there, 1] + ds


@compiled
def cross_all(
    some: Array, x: Array, facets: Array, x_m: Array, table: Array, known: Array, places: Array,
    facet: Array, local: Array, step: Array, normal: Array, gap: Array, frames: Array,
    across: Array, its_edge: Array, turns: Array, middles: Array, by: float, steps: int,
) -> Array:  # fmt: skip
    """Project some points, which have left their facets, on the neighbours; return those that are not there either."""
    lost, n_lost, quad, cubic = np.empty_like(some), 0, is_quad(facets), len(table) == 10
    for k in range(len(some)):
        i = some[k]
        f, r, s = facet[i], local[i, 0] + step[i, 0], local[i, 1] + step[i, 1]
        edge = nearest_edge(r, s, quad)[1]
        is_lost = across[f, edge] < 0
        if not is_lost:
            f, r, s = cross_edge(f, edge, r, s, across, its_edge, turns, middles)
            facet[i], local[i, 0], local[i, 1] = f, r, s
            expand(facet[i : i + 1], facets, x_m, table, known, places)
            newton_steps(i, i + 1, x, places, facet, local, step, normal, gap, frames, cubic)
            go_on(some[k : k + 1], x, places, facet, local, step, normal, gap, frames, SETTLED, steps, cubic)
            is_lost = nearest_edge(local[i, 0] + step[i, 0], local[i, 1] + step[i, 1], quad)[0] < -by
        if is_lost:
            lost[n_lost] = i
            n_lost += 1
    return lost[:n_lost]


cross = called(cross_all)


@inlined
def place_beside(r: float, s: float, quad: bool, within: float) -> int:
    """Corner, or edge after all corners, to which a point of a facet is near, -1 if to none; see `holders`."""
    at_0, at_1, at_last = s < within, (1 - r if quad else 1 - r - s) < within, r < within
    at_2 = 1 - s < within if quad else at_last
    if at_0 or at_1 or at_2 or at_last:
        n = 4 if quad else 3
        if at_last and at_0:
            return 0
        if at_0 and at_1:
            return 1
        if at_1 and at_2:
            return 2
        if quad and at_2 and at_last:
            return 3
        return n if at_0 else n + 1 if at_1 else n + 2 if at_2 else n + 3
    return -1


@compiled
def hold_all(
    some: Array, x: Array, facets: Array, x_m: Array, table: Array, known: Array, places: Array,
    facet: Array, local: Array, step: Array, last: Array, normal: Array, gap: Array, frames: Array,
    around: Array, lean: Array, by: float, beside: float, as_near: float, steps: int,
) -> None:  # fmt: skip
    """Put some points on the facets that have them, see `pairs.hold`; those that change facets have not moved last."""
    quad, cubic = is_quad(facets), len(table) == 10
    middle, away = 0.5 if quad else 1 / 3, np.empty(around.shape[2])
    for k in range(len(some)):
        i = some[k]
        own, r, s = facet[i], local[i, 0] + step[i, 0], local[i, 1] + step[i, 1]
        here = place_beside(r, s, quad, beside + lean[own] * abs(gap[i]))
        if here < 0:
            continue
        r, s, dr, ds = local[i, 0], local[i, 1], step[i, 0], step[i, 1]
        nx, ny, nz, gap_here = normal[i, 0], normal[i, 1], normal[i, 2], gap[i]
        least, unknown, n = abs(gap_here), False, 0
        while n < len(away) and around[own, here, n] >= 0:
            facet[i], away[n] = around[own, here, n], abs(gap_here)
            if facet[i] != own:
                local[i, 0] = local[i, 1] = middle
                expand(facet[i : i + 1], facets, x_m, table, known, places)
                newton_steps(i, i + 1, x, places, facet, local, step, normal, gap, frames, cubic)
                go_on(some[k : k + 1], x, places, facet, local, step, normal, gap, frames, SETTLED, steps, cubic)
                inside = nearest_edge(local[i, 0] + step[i, 0], local[i, 1] + step[i, 1], quad)[0]
                away[n], unknown = abs(gap[i]) if inside >= -by else np.inf, unknown or math.isnan(gap[i])
                least = min(least, away[n])
            n += 1
        first = 0
        while first < n and not away[first] <= least + as_near:
            first += 1
        if first < n and around[own, here, first] != own:
            facet[i], local[i, 0], local[i, 1] = around[own, here, first], middle, middle
            last[i, 0] = last[i, 1] = 0.0
            newton_steps(i, i + 1, x, places, facet, local, step, normal, gap, frames, cubic)
            go_on(some[k : k + 1], x, places, facet, local, step, normal, gap, frames, SETTLED, steps, cubic)
        else:
            facet[i], local[i, 0], local[i, 1], step[i, 0], step[i, 1] = own, r, s, dr, ds
            normal[i, 0], normal[i, 1], normal[i, 2], gap[i] = nx, ny, nz, gap_here
        if unknown:
            gap[i] = math.nan


hold = called(hold_all)


@compiled
def average(starts: Array, columns: Array, shares: Array, values: Array) -> Array:
    """Products of a csr matrix, (m, p), with values, (p, d)."""
    m, d = len(starts) - 1, values.shape[1]
    result = np.zeros((m, d))
    for row in range(m):
        for k in range(starts[row], starts[row + 1]):
            for axis in range(d):
                result[row, axis] += shares[k] * values[columns[k], axis]
    return result


@compiled
def spread(starts: Array, columns: Array, shares: Array, values: Array, n: int) -> Array:
    """Products of the transpose of a csr matrix, (m, n), with values, (m, d)."""
    d = values.shape[1]
    result = np.zeros((n, d))
    for row in range(len(starts) - 1):
        some = False
        for axis in range(d):
            some = some or values[row, axis] != 0.0
        if some:
            for k in range(starts[row], starts[row + 1]):
                for axis in range(d):
                    result[columns[k], axis] += shares[k] * values[row, axis]
    return result


@compiled
def on_nodes(nodes: Array, weights: Array, forces: Array, n: int) -> Array:
    """Forces on n nodes, (n, 3), of forces at points, (p, 3), see `points.on_nodes`."""
    result = np.zeros((n, 3))
    for i in range(len(nodes)):
        x, y, z = forces[i, 0], forces[i, 1], forces[i, 2]
        if x != 0.0 or y != 0.0 or z != 0.0:
            for j in range(nodes.shape[1]):
                node, weight = nodes[i, j], weights[i, j]
                result[node, 0] += weight * x
                result[node, 1] += weight * y
                result[node, 2] += weight * z
    return result


@compiled
def at_points(nodes: Array, weights: Array, values: Array) -> Array:
    """Vectors at points, (p, 3), of those at nodes, see `points.at_points`."""
    result = np.empty((len(nodes), 3))
    place_all(nodes, weights, values, result)
    return result


@inlined
def clipped(
    r: float, s: float, dr: float, ds: float, rr: float, rs: float, ss: float, domain: Array
) -> tuple[float, float]:
    """The point of a domain that is closest to (r + dr, s + ds) in a metric, see `projection.clip`."""
    r, s = r + dr, s + ds
    if r >= 0.0 and s >= 0.0 and (r + s if len(domain) == 3 else max(r, s)) <= 1.0:
        return r, s
    best_r, best_s, least = r, s, np.inf
    for i in range(len(domain)):
        start_r, start_s = domain[i, 0], domain[i, 1]
        edge_r, edge_s = domain[(i + 1) % len(domain), 0] - start_r, domain[(i + 1) % len(domain), 1] - start_s
        weighted_r, weighted_s = rr * edge_r + rs * edge_s, rs * edge_r + ss * edge_s
        along = (r - start_r) * weighted_r + (s - start_s) * weighted_s
        along = min(max(along / (weighted_r * edge_r + weighted_s * edge_s), 0.0), 1.0)
        foot_r, foot_s = start_r + along * edge_r, start_s + along * edge_s
        miss_r, miss_s = r - foot_r, s - foot_s
        distance = rr * miss_r * miss_r + 2 * rs * miss_r * miss_s + ss * miss_s * miss_s
        if distance < least:
            best_r, best_s, least = foot_r, foot_s, distance
    return best_r, best_s


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def place_on(c: Array, f: int, r: float, s: float, point: Vector, cubic: bool) -> tuple[Vector, Vector, Vector]:
    """Tangents on a facet, and the vector from the place there to the point; see `coordinate_at`."""
    px, ax, bx = coordinate_at(c, f, r, s, 0, cubic)
    py, ay, by = coordinate_at(c, f, r, s, 1, cubic)
    pz, az, bz = coordinate_at(c, f, r, s, 2, cubic)
    return (ax, ay, az), (bx, by, bz), (point[0] - px, point[1] - py, point[2] - pz)


@inlined
def closest_on(
    c: Array, f: int, point: Vector, domain: Array, steps: int, converged: float, convex: float, cubic: bool
) -> tuple[float, float]:
    """Coordinates of the closest point of a facet, see `surface.closest_points`."""
    r = s = 0.0
    for i in range(len(domain)):
        r, s = r + domain[i, 0] / len(domain), s + domain[i, 1] / len(domain)
    for _ in range(steps):
        a, b, miss = place_on(c, f, r, s, point, cubic)
        aa, ab, bb, am, bm = dot(a, a), dot(a, b), dot(b, b), dot(a, miss), dot(b, miss)
        bend_rr, bend_rs, bend_ss = bends_on(c, f, r, s, miss, cubic)
        rr, rs, ss = aa - bend_rr, ab - bend_rs, bb - bend_ss
        squared, det = aa * bb - ab * ab, rr * ss - rs * rs
        if not (det > convex * squared and rr > convex * aa):
            rr, rs, ss, det = aa, ab, bb, squared
        dr, ds = (ss * am - rs * bm) / det, (rr * bm - rs * am) / det
        there_r, there_s = clipped(r, s, dr, ds, rr, rs, ss, domain)
        change = max(abs(there_r - r), abs(there_s - s))
        r, s = there_r, there_s
        if change < converged:
            break
    return r, s


@inlined
def enclose(c: Array, f: int, domain: Array, ball: Array) -> None:
    """Set a ball around a facet, (4,): its centre, and its radius by the linear part and the sum of all others."""
    n, radius = len(domain), 0.0
    for axis in range(3):
        ball[axis] = c[f, 0, axis]
        for i in range(n):
            ball[axis] += (domain[i, 0] * c[f, 1, axis] + domain[i, 1] * c[f, 2, axis]) / n
    for i in range(n):
        squared = 0.0
        for axis in range(3):
            arm = c[f, 0, axis] + domain[i, 0] * c[f, 1, axis] + domain[i, 1] * c[f, 2, axis] - ball[axis]
            squared += arm * arm
        radius = max(radius, math.sqrt(squared))
    for term in range(3, c.shape[1]):
        bent = c[f, term, 0], c[f, term, 1], c[f, term, 2]
        radius += math.sqrt(dot(bent, bent))
    ball[3] = radius


@compiled
def nearest(places: Array, points: Array, count: int) -> Array:
    """Numbers of the places nearest to each point, (k, count), in ascending distance; -1 if there are none."""
    found, distances = np.full((len(points), count), -1), np.empty(count)
    for i in range(len(points)):
        for j in range(count):
            distances[j] = np.inf
        for f in range(len(places)):
            x, y, z = points[i, 0] - places[f, 0], points[i, 1] - places[f, 1], points[i, 2] - places[f, 2]
            distance, j = x * x + y * y + z * z, count
            while j > 0 and distance < distances[j - 1]:
                if j < count:
                    distances[j], found[i, j] = distances[j - 1], found[i, j - 1]
                j -= 1
            if j < count:
                distances[j], found[i, j] = distance, f
    return found


@compiled
def closest(
    points: Array, facets: Array, nearest: Array, domain: Array, table: Array,
    steps: int, converged: float, convex: float, same: float,
) -> tuple[Array, Array, Array, Array, Array, Array]:  # fmt: skip
    """Closest points on the nearest facets, (k, c), of each point: what `surface.Projection` holds.

    `facets`, (nf, n, 3), are the places of their nodes.
    """
    k, (nf, n, _), cubic = len(points), facets.shape, len(table) == 10
    facet, local, step, weights = np.empty(k, np.int64), np.empty((k, 2)), np.empty((k, 2)), np.empty((k, n))
    normal, gap, offset = np.empty((k, 3)), np.empty(k), np.empty(k)
    places, distances = np.empty((nearest.shape[1], 2)), np.empty(nearest.shape[1])
    known, c, nodes = np.empty(nf, np.bool_), np.empty((nf, len(table), 3)), np.empty((nf, n), np.int64)
    for f in range(nf):
        known[f] = False
        for j in range(n):
            nodes[f, j] = f * n + j
    expand(nearest.reshape(nearest.size), nodes, facets.reshape(nf * n, 3), table, known, c)
    balls = np.empty((nf, 4))
    for f in range(nf):
        if known[f]:
            enclose(c, f, domain, balls[f])
    for i in range(k):
        point, least = (points[i, 0], points[i, 1], points[i, 2]), np.inf
        for j in range(nearest.shape[1]):
            f = nearest[i, j]
            x, y, z = point[0] - balls[f, 0], point[1] - balls[f, 1], point[2] - balls[f, 2]
            beyond = math.sqrt(x * x + y * y + z * z) - balls[f, 3]
            distances[j] = np.inf
            if beyond > 0.0 and beyond * beyond > least:
                continue  # the whole facet is further away than another one
            r, s = closest_on(c, f, point, domain, steps, converged, convex, cubic)
            miss = place_on(c, f, r, s, point, cubic)[2]
            places[j, 0], places[j, 1], distances[j] = r, s, dot(miss, miss)
            least = min(least, distances[j] * (1 + same))
        best = -1
        for j in range(len(distances)):
            if distances[j] <= least and (best < 0 or nearest[i, j] < nearest[i, best]):
                best = j
        f, r, s = nearest[i, best], places[best, 0], places[best, 1]
        a, b, miss = place_on(c, f, r, s, point, cubic)
        facet[i], local[i, 0], local[i, 1], step[i, 0], step[i, 1] = f, r, s, 0.0, 0.0
        x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        length = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        normal[i, 0], normal[i, 1], normal[i, 2] = x, y, z
        gap[i] = away = dot(miss, (x, y, z))
        aside = (miss[0] - away * x, miss[1] - away * y, miss[2] - away * z)
        offset[i] = math.sqrt(dot(aside, aside))
    weigh(local, step, table, weights)
    return facet, local, weights, normal, gap, offset
