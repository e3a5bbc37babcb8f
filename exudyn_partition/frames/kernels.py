"""Compiled motion of bodies, and inertia forces of floating frames; the modules beside do the same by NumPy."""

from __future__ import annotations

import math

import numpy as np

from ..support.arrays import Array
from ..support.compiled import compiled, exact, inlined, inner


@inner
def body_axes(q: Array, rotation: Array, node_axes: Array) -> Array:
    """Axes of the body in space, (3, 3), see `FloatingKinematics.frame`."""
    x, y, z = rotation[0] + q[3], rotation[1] + q[4], rotation[2] + q[5]
    angle = math.sqrt(x * x + y * y + z * z)
    a, b = 1.0, 0.5
    if angle > 0.0:
        half = math.sin(angle / 2) / angle
        a, b = math.sin(angle) / angle, 2 * half * half
    turn, axes = np.empty((3, 3)), np.zeros((3, 3))
    turn[0, 0], turn[1, 1], turn[2, 2] = 1 - b * (y * y + z * z), 1 - b * (x * x + z * z), 1 - b * (x * x + y * y)
    turn[0, 1], turn[1, 0] = b * x * y - a * z, b * x * y + a * z
    turn[0, 2], turn[2, 0] = b * x * z + a * y, b * x * z - a * y
    turn[1, 2], turn[2, 1] = b * y * z - a * x, b * y * z + a * x
    for i in range(3):
        for j in range(3):
            for k in range(3):
                axes[i, j] += turn[i, k] * node_axes[j, k]
    return axes


@compiled
def in_axes(q: Array, rotation: Array, node_axes: Array, directions: Array) -> Array:
    """Directions in space, (m, 3), in the body's axes, see `FloatingKinematics.in_frame`."""
    axes, result = body_axes(q, rotation, node_axes), np.empty(directions.shape)
    for i in range(len(directions)):
        for a in range(3):
            result[i, a] = directions[i, 0] * axes[0, a] + directions[i, 1] * axes[1, a] + directions[i, 2] * axes[2, a]
    return result


@exact
def compose(v: Array, way: Array, result: Array) -> None:
    """Set a rotation vector, (3,), see `rotations.composed`; Exudyn rounds as this does, without fused products."""
    before, turn = 0.0, 0.0
    along = v[0] * way[0] + v[1] * way[1] + v[2] * way[2]
    for i in range(3):
        before += v[i] * v[i]
        turn += way[i] * way[i]
    before, turn = math.sqrt(before) / 2, math.sqrt(turn) / 2
    a, b = math.cos(before), math.cos(turn)
    s = math.sin(before) / before / 2 if before > 0.0 else 0.5
    t = math.sin(turn) / turn / 2 if turn > 0.0 else 0.5
    size = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        result[i] = s * b * v[i] + t * a * way[i] + s * t * (v[j] * way[k] - v[k] * way[j])
        size += result[i] * result[i]
    if size > 0.0:
        angle = 2 * math.acos(min(max(a * b - s * t * along, -1.0), 1.0))
        for i in range(3):
            result[i] *= angle / math.sqrt(size)


@inlined
def place_moved(start: Array, rows: Array, q: Array, first: int, node: int, result: Array) -> None:
    """Set the place of a node, see `InertialKinematics.place`; its body's coordinates begin at q[first]."""
    x, y, z = start[node, 0], start[node, 1], start[node, 2]
    for k in range(rows.shape[1]):
        x += rows[3 * node, k] * q[first + k]
        y += rows[3 * node + 1, k] * q[first + k]
        z += rows[3 * node + 2, k] * q[first + k]
    result[node, 0], result[node, 1], result[node, 2] = x, y, z


@compiled
def moved_places(start: Array, rows: Array, q: Array) -> Array:
    """Places of nodes, (k, 3) [m], see `InertialKinematics.place`."""
    result = np.empty((len(start), 3))
    for node in range(len(start)):
        place_moved(start, rows, q, 0, node, result)
    return result


@inlined
def add_on_shapes(rows: Array, forces: Array, result: Array, first: int) -> None:
    """Add generalised forces of forces on nodes, (k, 3), to a result, from its entry `first` on."""
    n = rows.shape[1]
    for node in range(len(forces)):
        x, y, z = forces[node, 0], forces[node, 1], forces[node, 2]
        if x != 0.0 or y != 0.0 or z != 0.0:
            for k in range(n):
                result[first + k] += x * rows[3 * node, k] + y * rows[3 * node + 1, k] + z * rows[3 * node + 2, k]


@compiled
def on_shapes(rows: Array, forces: Array) -> Array:
    """Generalised forces, (n,), of forces on nodes, (k, 3), see `InertialKinematics.generalised`."""
    result = np.zeros(rows.shape[1])
    add_on_shapes(rows, forces, result, 0)
    return result


@inner
def _turning(x: float, y: float, z: float) -> Array:
    """Matrix of the cross product with a vector, (3, 3)."""
    turn = np.zeros((3, 3))
    turn[0, 1], turn[0, 2], turn[1, 2] = -z, y, -x
    turn[1, 0], turn[2, 0], turn[2, 1] = z, -y, x
    return turn


@inlined
def _sines(part: float, before: float, after: float, longer: float) -> tuple[float, float, float]:
    """See `rotations._sines`."""
    of_start = math.sin(part * before) / before if before > 0.0 else part
    of_end = math.sin(part * after) / after if after > 0.0 else part
    if 2 * abs(longer) < after:
        sine = 2 * math.cos(part * (before + after) / 2) * math.sin(part * longer / 2)
        return of_start, of_end, (sine - of_start * longer) / after
    return of_start, of_end, of_end - of_start


@inner
def change_of_axes(q: Array, rotation: Array, node_axes: Array) -> Array:
    """Change of `body_axes` from q = 0, (3, 3), see `rotations.rotation_change`."""
    u, v, w = rotation[0], rotation[1], rotation[2]
    p, r, s = q[3], q[4], q[5]
    x, y, z = u + p, v + r, w + s
    before, after = math.sqrt(u * u + v * v + w * w), math.sqrt(x * x + y * y + z * z)
    longer = p * (u + x) + r * (v + y) + s * (w + z)
    if before + after > 0.0:
        longer /= before + after
    _, a, a_more = _sines(1.0, before, after, longer)
    h_start, h, h_more = _sines(0.5, before, after, longer)
    b, b_more = 2 * h * h, 2 * (h_start + h) * h_more
    turn, more, turned = _turning(u, v, w), _turning(p, r, s), _turning(x, y, z)
    change, result = np.empty((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            total = a * more[i, j] + a_more * turn[i, j]
            for k in range(3):
                total += b * (more[i, k] * turned[k, j] + turn[i, k] * more[k, j]) + b_more * turn[i, k] * turn[k, j]
            change[i, j] = total
    for i in range(3):
        for j in range(3):
            for k in range(3):
                result[i, j] += change[i, k] * node_axes[j, k]
    return result


@inlined
def place_turned(
    q: Array, axes: Array, change: Array, start: Array, arms: Array, rows: Array, node: int, result: Array, at: int
) -> None:
    """Set the place of a node of a body whose axes, (3, 3), have changed by a matrix, (3, 3); see `loops.places`."""
    x = y = z = 0.0
    for k in range(rows.shape[1]):
        x += rows[3 * node, k] * q[6 + k]
        y += rows[3 * node + 1, k] * q[6 + k]
        z += rows[3 * node + 2, k] * q[6 + k]
    for i in range(3):
        way = q[i] + axes[i, 0] * x + axes[i, 1] * y + axes[i, 2] * z
        way += change[i, 0] * arms[node, 0] + change[i, 1] * arms[node, 1] + change[i, 2] * arms[node, 2]
        result[at, i] = start[node, i] + way


@compiled
def places(q: Array, start: Array, rotation: Array, node_axes: Array, arms: Array, rows: Array) -> Array:
    """Places of nodes, (k, 3) [m], see `loops.places`."""
    axes, change = body_axes(q, rotation, node_axes), change_of_axes(q, rotation, node_axes)
    result = np.empty((len(arms), 3))
    for node in range(len(arms)):
        place_turned(q, axes, change, start, arms, rows, node, result, node)
    return result


@inlined
def add_generalised(
    q: Array,
    axes: Array,
    arms: Array,
    rows: Array,
    node: int,
    f: float,
    g: float,
    h: float,
    torque: Array,
    result: Array,
) -> None:
    """Add generalised forces of a force on a node of a body with axes, (3, 3), but for its torque in these axes."""
    n, (x, y, z) = rows.shape[1], (arms[node, 0], arms[node, 1], arms[node, 2])
    result[0] += f
    result[1] += g
    result[2] += h
    u = axes[0, 0] * f + axes[1, 0] * g + axes[2, 0] * h
    v = axes[0, 1] * f + axes[1, 1] * g + axes[2, 1] * h
    w = axes[0, 2] * f + axes[1, 2] * g + axes[2, 2] * h
    for k in range(n):
        x += rows[3 * node, k] * q[6 + k]
        y += rows[3 * node + 1, k] * q[6 + k]
        z += rows[3 * node + 2, k] * q[6 + k]
        result[6 + k] += u * rows[3 * node, k] + v * rows[3 * node + 1, k] + w * rows[3 * node + 2, k]
    torque[0] += y * w - z * v
    torque[1] += z * u - x * w
    torque[2] += x * v - y * u


@inlined
def set_torque(torque: Array, node_axes: Array, result: Array) -> None:
    """Set a torque in the axes of the frame's node."""
    for i in range(3):
        result[3 + i] = torque[0] * node_axes[0, i] + torque[1] * node_axes[1, i] + torque[2] * node_axes[2, i]


@compiled
def generalised(q: Array, rotation: Array, node_axes: Array, arms: Array, rows: Array, forces: Array) -> Array:
    """Generalised forces, (n,), of forces on nodes, (k, 3), see `FloatingKinematics.generalised`."""
    axes, result, torque = body_axes(q, rotation, node_axes), np.zeros(6 + rows.shape[1]), np.zeros(3)
    for node in range(len(arms)):
        f, g, h = forces[node, 0], forces[node, 1], forces[node, 2]
        if f != 0.0 or g != 0.0 or h != 0.0:
            add_generalised(q, axes, arms, rows, node, f, g, h, torque, result)
    set_torque(torque, node_axes, result)
    return result


@compiled
def on_constant_mass(integrals: Array, cross: Array, tensor: Array, z: Array, force: Array) -> Array:
    """See `FloatingKinematics.on_constant_mass`; `integrals` and `cross` as in `inertia_force`."""
    n, J, C = len(z), np.empty(6), np.zeros((3, len(z)))
    for c in range(6):
        J[c] = integrals[c, 0, 0]
        for i in range(n):
            entry = integrals[c, i + 1, 0] + integrals[c, 0, i + 1]
            for k in range(n):
                entry += integrals[c, i + 1, k + 1] * z[k]
            J[c] += entry * z[i]
    for a in range(3):
        for i in range(n):
            for k in range(n):
                C[a, i] -= cross[a, i, k] * z[k]
    omega_t, result = angular_acceleration(J, C, force[3:6], force[6:]), force.copy()
    for a in range(3):
        result[3 + a] = 0.0
        for b in range(3):
            result[3 + a] += tensor[a, b] * omega_t[b]
        for i in range(n):
            result[6 + i] -= C[a, i] * omega_t[a]
    return result


@inner
def angular_acceleration(J: Array, C: Array, torque: Array, force: Array) -> Array:
    """See `inertia.angular_acceleration`; J by its components, (6,). The equations are solved by Cramer's rule."""
    A, b = np.empty((3, 3)), torque.copy()
    A[0, 0], A[1, 1], A[2, 2] = J[0], J[1], J[2]
    A[1, 2], A[0, 2], A[0, 1] = J[3], J[4], J[5]
    for a in range(3):
        for i in range(len(force)):
            b[a] -= C[a, i] * force[i]
            for c in range(a, 3):
                A[a, c] -= C[a, i] * C[c, i]
    d, e, f = A[0, 0], A[1, 1], A[2, 2]
    u, v, w = A[1, 2], A[0, 2], A[0, 1]
    xx, yy, zz = e * f - u * u, d * f - v * v, d * e - w * w
    yz, xz, xy = v * w - d * u, u * w - e * v, u * v - f * w
    x, determinant = np.empty(3), d * xx + w * xy + v * xz
    x[0] = (xx * b[0] + xy * b[1] + xz * b[2]) / determinant
    x[1] = (xy * b[0] + yy * b[1] + yz * b[2]) / determinant
    x[2] = (xz * b[0] + yz * b[1] + zz * b[2]) / determinant
    return x


@inner
def end_velocities(cross: Array, middle: Array, change: Array, q_t: Array, q_tt: Array, half_step: float) -> Array:
    """See `InertiaForces.end_velocities`; `cross` as in `inertia_force`."""
    n, v, gained = len(change), np.empty(len(middle)), np.empty(len(change))
    for i in range(len(v)):
        v[i] = middle[i] + half_step * q_tt[i]
    for i in range(n):
        v[3 + i] -= half_step * change[i]
        gained[i] = v[3 + i] - q_t[3 + i]
    for i in range(n):
        force = 0.0
        for a in range(3):
            for k in range(n):
                force += v[a] * cross[a, i, k] * gained[k]
        v[3 + i] += 2 * half_step * force
    return v


@inner
def inertia_force(
    integrals: Array, cross: Array, tensor: Array, elastic: Array, coupling: bool, omega: Array, z: Array, z_t: Array
) -> Array:
    """Torque and forces on the elastic coordinates, (3 + n,), with all other terms; see `InertiaForces.force`.

    Parameters
    ----------
    integrals, cross : (6, n + 1, n + 1), (3, n, n) array
        Of `InertiaIntegrals`.
    tensor : (3, 3) array
        Inertia of the undeformed body.
    elastic : (n,) array
        K z.
    coupling : bool
    omega, z, z_t : (3,), (n,), (n,) array
    """
    n = len(z)
    by_place, J, J_t = np.empty((6, n)), np.empty(6), np.zeros(6)
    for c in range(6):
        total = integrals[c, 0, 0]
        for i in range(n):
            entry = integrals[c, i + 1, 0]
            for k in range(n):
                entry += integrals[c, i + 1, k + 1] * z[k]
            by_place[c, i] = entry
            total += (entry + integrals[c, 0, i + 1]) * z[i]
            J_t[c] += 2 * entry * z_t[i]
        J[c] = total
    C, force, spin = np.empty((3, n)), np.zeros(n), np.zeros(3)
    for a in range(3):
        for i in range(n):
            of_z, of_z_t = 0.0, 0.0
            for k in range(n):
                of_z += cross[a, i, k] * z[k]
                of_z_t += cross[a, i, k] * z_t[k]
            C[a, i] = -of_z
            spin[a] -= of_z * z_t[i]
            force[i] += 2 * omega[a] * of_z_t
    p, q, r = omega
    weights = (p * p, q * q, r * r, 2 * q * r, 2 * p * r, 2 * p * q)
    for c in range(6):
        for i in range(n):
            force[i] += weights[c] * by_place[c, i]
    x = J[0] * p + J[5] * q + J[4] * r + spin[0]
    y = J[5] * p + J[1] * q + J[3] * r + spin[1]
    w = J[4] * p + J[3] * q + J[2] * r + spin[2]
    torque = np.empty(3)
    torque[0] = r * y - q * w - (J_t[0] * p + J_t[5] * q + J_t[4] * r)
    torque[1] = p * w - r * x - (J_t[5] * p + J_t[1] * q + J_t[3] * r)
    torque[2] = q * x - p * y - (J_t[4] * p + J_t[3] * q + J_t[2] * r)
    result = np.zeros(3 + n)
    if not coupling:
        for a in range(3):
            result[a] = torque[a]
        for i in range(n):
            result[3 + i] = force[i]
        return result
    acting = np.empty(n)
    for i in range(n):
        acting[i] = force[i] - elastic[i]
    omega_t = angular_acceleration(J, C, torque, acting)
    for a in range(3):
        for b in range(3):
            result[a] += tensor[a, b] * omega_t[b]
        for i in range(n):
            result[3 + i] -= C[a, i] * omega_t[a]
    for i in range(n):
        result[3 + i] += force[i]
    return result


@compiled
def frame_force(
    integrals: Array,
    cross: Array,
    tensor: Array,
    elastic: Array,
    change: Array,
    coupling: bool,
    q: Array,
    q_t: Array,
    start: tuple[Array, Array],
    half_step: float,
) -> Array:
    """Inertia forces of a body, (6 + n,), see `loops.frame_force`."""
    v, n = q_t[3:], len(q) - 6
    if half_step > 0.0:
        v = end_velocities(cross, v, change, start[0], start[1], half_step)
    found, result = inertia_force(integrals, cross, tensor, elastic, coupling, v[:3], q[6:], v[3:]), np.zeros(6 + n)
    for i in range(3 + n):
        result[3 + i] = found[i]
    return result


@compiled
def stiffening_force(states: Array, matrices: Array, q: Array) -> Array:
    """Forces of geometric stiffness, (n,), by states (m, n) and matrices (m, n, n); see `GeometricStiffness.force`."""
    m, n = states.shape
    result = np.zeros(n)
    for k in range(m):
        turned = np.zeros(n)
        for j in range(n):
            for i in range(n):  # innermost, so that it is done in vectors: the matrices are symmetric
                turned[i] += matrices[k, j, i] * q[j]
        amplitude, stretch = 0.0, 0.0
        for i in range(n):
            amplitude += states[k, i] * q[i]
            stretch += turned[i] * q[i] / 2
        for i in range(n):
            result[i] += (amplitude + stretch) * turned[i] + stretch * states[k, i]
    return result


@inlined
def _linear_stiffening(tangent: Array, anchor: Array, at_anchor: Array, q: Array) -> Array:
    """Forces, (n,), linear about an anchor, see `stiffening_steps`."""
    result, n = at_anchor.copy(), len(q)
    for j in range(n):
        way = q[j] - anchor[j]
        for i in range(n):
            result[i] += tangent[j, i] * way
    return result


@compiled
def stiffening_at_guess(
    states: Array,
    matrices: Array,
    tangent: Array,
    dynamic: Array,
    errors: Array,
    q: Array,
    anchor: Array,
    at_anchor: Array,
) -> Array:
    """See `loops.stiffening_at_guess`."""
    n, order, least = len(q), 0, np.inf
    sizes = np.zeros(3)
    for i in range(n):
        first, second, third = errors[0, i], errors[1, i], errors[2, i]
        sizes[0] += dynamic[i] * first**2
        sizes[1] += dynamic[i] * (first - second) ** 2
        sizes[2] += dynamic[i] * (first - 2 * second + third) ** 2
    for k in range(3):
        if sizes[k] < least:
            order, least = k, sizes[k]
    for i in range(n):
        anchor[i] = q[i]
        if order > 0:
            anchor[i] += errors[0, i] if order == 1 else 2 * errors[0, i] - errors[1, i]
    force = stiffening_force(states, matrices, anchor)
    for i in range(n):
        at_anchor[i] = force[i]
    return _linear_stiffening(tangent, anchor, at_anchor, q)


@compiled
def stiffening_in_step(
    states: Array,
    matrices: Array,
    tangent: Array,
    dynamic: Array,
    guess: Array,
    share: float,
    q: Array,
    anchor: Array,
    at_anchor: Array,
) -> tuple[Array, bool]:
    """See `loops.stiffening_in_step`."""
    linear, force = _linear_stiffening(tangent, anchor, at_anchor, q), stiffening_force(states, matrices, q)
    missing, way = 0.0, 0.0
    for i in range(len(q)):
        missing += (force[i] - linear[i]) ** 2 / dynamic[i]
        way += dynamic[i] * (q[i] - guess[i]) ** 2
    if missing <= share**2 * way:
        return linear, True
    for i in range(len(q)):
        anchor[i], at_anchor[i] = q[i], force[i]
    return force, False


@compiled
def inertia_derivatives(integrals: Array, cross: Array, omega: Array, z: Array, z_t: Array) -> tuple[Array, Array]:
    """Derivatives by z, (3 + n, n), and by omega and z_t, (3 + n, 3 + n), see `InertiaForces.derivatives`."""
    n = len(z)
    place = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    by_z, by_velocity = np.zeros((3 + n, n)), np.zeros((3 + n, 3 + n))
    p, q, r = omega
    turn = _turning(p, q, r)
    weights = (p * p, q * q, r * r, 2 * q * r, 2 * p * r, 2 * p * q)
    by_place, by_shape_t, J, J_t = np.empty((6, n)), np.empty((6, n)), np.empty(6), np.zeros(6)
    for c in range(6):
        J[c] = integrals[c, 0, 0]
        for i in range(n):
            entry, entry_t = integrals[c, i + 1, 0], 0.0
            for k in range(n):
                entry += integrals[c, i + 1, k + 1] * z[k]
                entry_t += integrals[c, i + 1, k + 1] * z_t[k]
                by_z[3 + i, k] += weights[c] * integrals[c, i + 1, k + 1]
            by_place[c, i], by_shape_t[c, i] = entry, entry_t
            J[c] += (entry + integrals[c, 0, i + 1]) * z[i]
            J_t[c] += 2 * entry * z_t[i]
    C, cross_t, momentum = np.zeros((3, n)), np.zeros((3, n)), np.zeros(3)
    for a in range(3):
        for i in range(n):
            for k in range(n):
                C[a, i] -= cross[a, i, k] * z[k]
                cross_t[a, i] += cross[a, i, k] * z_t[k]
                by_velocity[3 + i, 3 + k] += 2 * omega[a] * cross[a, i, k]
            momentum[a] += C[a, i] * z_t[i]
        for b in range(3):
            momentum[a] += J[place[a, b]] * omega[b]
    of_momentum = _turning(momentum[0], momentum[1], momentum[2])
    for a in range(3):
        for b in range(3):
            by_velocity[a, b] = of_momentum[a, b]
            by_velocity[a, b] -= J_t[place[a, b]]
            for c in range(3):
                by_velocity[a, b] -= turn[a, c] * J[place[c, b]]
            for i in range(n):
                J_omega = by_place[place[b, 0], i] * p + by_place[place[b, 1], i] * q + by_place[place[b, 2], i] * r
                by_z[a, i] -= turn[a, b] * (2 * J_omega + cross_t[b, i]) + 2 * by_shape_t[place[a, b], i] * omega[b]
                by_velocity[a, 3 + i] -= turn[a, b] * C[b, i]
                if a == b:
                    by_velocity[a, 3 + i] -= 2 * J_omega
                    by_velocity[3 + i, a] += 2 * (cross_t[a, i] + J_omega)
    return by_z, by_velocity
