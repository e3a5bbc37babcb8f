"""An answer of a contact is a value: it stays what it was, and what follows from it may be asked for later."""

import numpy as np
import pytest
from oracles import compliant, floating, inertial, moved

from exudyn_partition import Coulomb
from exudyn_partition.contact.formulations.choices import Penalty
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps, RigidSphere

ASKED = ("generalised", "stored", "dissipated", "traction", "row_nodes")
ELSEWHERE = [0.03e-3, 0, -5e-6], [0.15e-3, 0.05e-3, -6e-6], [0, 0, 2e-5]  # near, on other facets, and open [m]
FOUND = ("tangent", "resultant", "row_jacobian", "edge_reached")


def contact_of(kind, frame, friction, bodies):
    """A contact with the slave's side, and the number of coordinates of its master."""
    slave, master = frame(bodies[0]), inertial(bodies[1])
    coulomb = None if friction is None else Coulomb(friction)
    if kind == "sphere":
        return compliant(RigidGaps(slave, RigidSphere((0, 0, -2e-3), 2e-3)), coulomb), slave, 0
    gaps = PatchGaps(slave, master)
    return (PatchContact(gaps, Penalty(), coulomb) if kind == "penalty" else compliant(gaps, coulomb)), slave, master.n


@pytest.mark.parametrize("friction", [None, 0.3])
@pytest.mark.parametrize("frame", [inertial, floating])
@pytest.mark.parametrize("kind", ["patches", "sphere", "penalty"])
def test_an_answer_stays_when_the_contact_answers_elsewhere(round_body, flat_body, kind, frame, friction):
    """Pairs slide to other facets, rows open, a step begins: what is asked for then is what a fresh contact answers."""
    law, side, n = contact_of(kind, frame, friction, (round_body, flat_body))
    places = [np.r_[moved(side, way), np.zeros(n)] for way in ([0, 0, -4e-6], *ELSEWHERE)]
    kept, fresh = law.for_run(), law.for_run()
    for contact in (kept, fresh):
        contact.at(places[0])
        contact.accept(0.0)
    near = places[0] + 0.1 * (places[1] - places[0])
    answer, expected = kept.at(near), fresh.at(near)
    wanted = [getattr(expected, name) for name in ASKED] + [getattr(expected, name)() for name in FOUND]
    nodal, after = expected.nodal_forces(), expected.after(1e-6)
    for place in places[1:]:
        kept.at(place)
    found = [getattr(answer, name) for name in ASKED] + [getattr(answer, name)() for name in FOUND]
    for value, right in zip(found, wanted, strict=True):
        if right is None:
            assert value is None
        else:
            value, right = (x.toarray() if hasattr(x, "toarray") else np.asarray(x) for x in (value, right))
            np.testing.assert_allclose(value, right, rtol=0, atol=1e-12 * max(abs(right).max(initial=0.0), 1e-9))
    for value, right in zip(answer.nodal_forces(), nodal, strict=True):
        np.testing.assert_allclose(value, right, rtol=0, atol=1e-12 * abs(right).max())
    state = answer.after(1e-6)
    np.testing.assert_array_equal(state.gaps.q, after.gaps.q)
    assert (state.gaps.anchor is None) == (after.gaps.anchor is None)
    if after.gaps.anchor is not None:  # where the flexibility was found on which this answer rests
        np.testing.assert_array_equal(state.gaps.anchor.q, after.gaps.anchor.q)
    np.testing.assert_allclose(state.memory.forces, after.memory.forces, atol=1e-12 * abs(after.memory.forces).max())
    assert (abs(expected.lam) > 0).any()
