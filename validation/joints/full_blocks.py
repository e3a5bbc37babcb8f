"""The crank slider around its first impact with full FE blocks: a separate time integration of what the impact adds."""

import math
import time

import numpy as np
import scipy.sparse as sp

from examples.models.crank_slider_parts import CONTACT_ANGLE, CRANK, DAMPING, LENGTHS, LINK, SPEED, STIFFNESS, slider
from exudyn_partition.algebra.blas_threads import one_blas_thread
from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.fe.model import node_dofs
from exudyn_partition.reference.full_body import FullBody, rows_on_dofs
from exudyn_partition.reference.integrator import HHT
from exudyn_partition.surfaces.rows import pair_surfaces


def interface_rows(fem, partition, name):
    """(6, 3n) csr rows of an interface on the nodal displacements."""
    interface = partition.find_interface(name)
    dofs = node_dofs(interface.nodes)
    where = np.repeat(np.arange(6), len(dofs)), np.tile(dofs, 6)
    return sp.csr_matrix((interface.motion.ravel(), where), shape=(6, fem.n_dofs))


@one_blas_thread()
def full_blocks(parts, link_body, angle, window, step, rows_kind, slave_is_3, alpha=0.1):
    """Histories of contact force and of the torque that the impact adds, with full FE blocks.

    `parts` are FE model and partition of the blocks 3 and 4, `angle` the crank's at the start of `window` [s].
    """
    begin = time.perf_counter()
    (fem3, part3), (fem4, part4) = parts
    x = slider(angle)[0]
    pin = -CRANK * np.array([math.cos(angle), math.sin(angle), 0])
    arm = np.array([x, 0, 0]) - pin
    A = np.array([[arm[0], -arm[1], 0], [arm[1], arm[0], 0], [0, 0, LINK]]) / LINK
    ends = [np.kron(np.eye(2), A) @ link_body.interface_rows(name) for name in ("crank pin", "slider pin")]
    back3, back4 = interface_rows(fem3, part3, "back"), interface_rows(fem4, part4, "back")

    # Joints, all on the motion that the impact adds.
    n_link = link_body.n_dofs
    nothing = sp.csr_matrix((5, fem3.n_dofs))
    joints_a = sp.vstack(
        [
            sp.hstack([nothing, ends[0][:5]]),  # the crank's pin has the prescribed motion
            sp.hstack([back3[:2], -ends[1][:2]]),  # the slider's pin
            sp.hstack([back3[1:], sp.csr_matrix((5, n_link))]),  # the slide
        ],
        format="csr",
    )
    joints_b = back4[1:]
    spring = back4[:1]

    heads = x + LENGTHS[0], slider(CONTACT_ANGLE)[0] + LENGTHS[0]
    bodies = [FullBody(*part, position=(head, 0, 0), patch=0) for part, head in zip(parts, heads, strict=True)]
    order = (0, 1) if slave_is_3 else (1, 0)
    contact = pair_surfaces(*(bodies[i].surface for i in order), rows_kind)
    G = contact.matrices(*(len(bodies[i].contact.nodes) for i in order))
    G = [G[order.index(i)] for i in (0, 1)]
    wide = [rows_on_dofs(body, g) for body, g in zip(bodies, G, strict=True)]
    along = np.asarray(G[0] @ np.tile([1.0, 0, 0], G[0].shape[1] // 3)).ravel()  # gaps by the slider's motion
    nc = len(contact)

    mass_a = sp.block_diag([fem3.mass, link_body.mass], format="csr")
    stiffness_a = sp.block_diag([fem3.stiffness, link_body.stiffness], format="csr")
    rows_a = sp.vstack([sp.hstack([wide[0], sp.csr_matrix((nc, n_link))]), joints_a], format="csr")
    rows_b = sp.vstack([wide[1], joints_b, spring], format="csr")
    stiffness_b = sp.csr_matrix(fem4.stiffness + STIFFNESS * spring.T @ spring)
    a = HHT(mass_a, stiffness_a, rows_a, step, alpha=alpha)
    b = HHT(fem4.mass, stiffness_b, rows_b, step, alpha=alpha)

    # Compliances of contact rows (c), joints (j) and the damper's row (the last of b).
    Fa, Fb = a.compliance(), b.compliance()
    ja, jb = np.arange(nc, nc + joints_a.shape[0]), np.arange(nc, nc + 5)
    F = Fa[:nc, :nc] + Fb[:nc, :nc]
    for full, j in ((Fa, ja), (Fb, jb)):
        F -= full[:nc][:, j] @ np.linalg.solve(full[np.ix_(j, j)], full[j][:, :nc])
    problem = Complementarity((F + F.T) / 2)
    steps = round(window / step)
    t = step * np.arange(steps + 1)
    force, torque = np.zeros(steps + 1), np.zeros(steps + 1)
    setup_s, begin = time.perf_counter() - begin, time.perf_counter()
    damper = 0.0
    for n in range(1, steps + 1):
        moved = slider(angle + SPEED * t[n])[0] - x
        ga, gb = a.predict(), b.predict()
        gb = gb + Fb[:, -1] * damper
        joint = [-np.linalg.solve(full[np.ix_(j, j)], g[j]) for full, j, g in ((Fa, ja, ga), (Fb, jb, gb))]
        gap = contact.gap + along * moved + ga[:nc] + gb[:nc] + Fa[:nc][:, ja] @ joint[0] + Fb[:nc][:, jb] @ joint[1]
        lam = problem.solve(gap)
        joint[0] -= np.linalg.solve(Fa[np.ix_(ja, ja)], Fa[ja][:, :nc] @ lam)
        joint[1] -= np.linalg.solve(Fb[np.ix_(jb, jb)], Fb[jb][:, :nc] @ lam)
        a.correct(np.r_[lam, joint[0]])
        b.correct(np.r_[lam, joint[1], damper])
        damper = -DAMPING * float((spring @ b.v)[0])
        force[n] = lam.sum()
        torque[n] = pin[0] * joint[0][1] - pin[1] * joint[0][0]  # torque of the drive on the link through the pin
    mean = lambda x: np.r_[(x[:-1] + x[1:]) / 2, x[-1]]  # noqa: E731 multipliers are of the step that ends at t
    return {
        "t": t,
        "force": mean(force),
        "torque": mean(torque),
        "setup_s": setup_s,
        "time_s": time.perf_counter() - begin,
        "dofs": fem3.n_dofs + fem4.n_dofs + n_link,
        "contact_nodes": nc,
    }
