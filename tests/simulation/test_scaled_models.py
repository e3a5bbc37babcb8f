"""Models 2^10 times smaller and larger: nothing in the library knows how long a metre is.

With lengths, times and 1 / frequencies scaled by s, and the same material and velocities, forces grow by s^2, and
energies and momenta by s^3. Scaled by a power of two, floating-point numbers have the same digits. So results are equal
but for what Exudyn's own absolute numbers, such as 1e-10 s, leave in the time.
"""

import dataclasses

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import add_springs, ground

import exudyn_partition as ep
from exudyn_partition.errors import InputError

SCALES = (2.0**-10, 2.0**10)
SPEED, SPAN = 0.3, 20e-6
FINE = 1e-11


def scaled(fem, s):
    return dataclasses.replace(
        fem, points=fem.points * s, mass=fem.mass * s**3, stiffness=fem.stiffness * s, cell_mass=fem.cell_mass * s**3
    )


@pytest.fixture(scope="module")
def body_of(ball):
    """The ball of any scale, by basis and axes."""

    def reduced(s, **options):
        fem = scaled(ball[0], s)
        region = ep.Partition.ball(fem, (0, 0, 0), 1.0e-3 * s, axes="xyz")
        return ep.reduce(fem, region, f_cut=100e3 / s, **options)

    return reduced


def dropped(body, s, *, method="explicit", **options):
    """A ball hits a plane aslant, with friction; what a scale does not change."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 1e-6 * s], initialVelocity=[0.1, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=0.3)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=SPAN * s, method=method, **options)
    return {
        "times": result.t / s,
        "force": contact.force(result) / s**2,
        "momentum": item.momentum(result) / s**3,
        "dissipated": contact.dissipated_energy(result) / s**3,
    }


@pytest.mark.parametrize(
    "options",
    [{}, {"method": "implicit"}, {"method": "implicit", "adaptive": True}],
    ids=["explicit", "implicit", "adaptive"],
)
def test_impacts_of_any_size(body_of, options):
    """Also a last step of less than 1e-10 s, and forces of nanonewtons, to which Newton's method must solve."""
    expected = dropped(body_of(1.0), 1.0, **options)
    assert expected["force"].max() > 0
    for s in SCALES:
        for name, values in dropped(body_of(s), s, **options).items():
            of_one = expected[name]
            assert values.shape == of_one.shape, name
            np.testing.assert_allclose(values, of_one, rtol=0, atol=FINE * abs(of_one).max(), err_msg=name)


@pytest.fixture(scope="module")
def cantilever():
    """A steel bar of 200 mm with an interface at its root."""
    bar = occ.Box((0, -5e-3, -5e-3), (0.2, 5e-3, 5e-3))
    bar.faces.Min(occ.X).name = "root"
    return ep.fe_model(bar, ep.STEEL, maxh=1.5e-2)


def clamped(fem, s, frame, **options):
    """The bar of scale s, clamped by one of Exudyn's joints."""
    fem = scaled(fem, s)
    mbs = exu.SystemContainer().AddSystem()
    body = ep.reduce(fem, ep.Partition.interface(fem, "root", "root"), f_cut=20e3 / s)
    item = ep.CreatePartitionBody(mbs, body, frame=frame, **options)
    joint = items.GenericJoint(
        markerNumbers=[ground(mbs), item.CreateInterfaceMarker(mbs, "root")], constrainedAxes=[1] * 6
    )
    mbs.AddObject(joint)
    mbs.Assemble()
    return mbs, item


@pytest.mark.parametrize("s", [SCALES[0], 1.0, SCALES[1]])
def test_a_preloaded_bar_stays_at_rest_in_explicit_steps(cantilever, frame, s):
    """Joints begin with the static solver's round-off, and are solved for as well in large units as in small ones."""
    mbs, item = clamped(cantilever, s, frame, gravity=[0, 0, -2000.0 / s])
    ep.solve_static(mbs, load_steps=3, update_initial=True)
    result = ep.solve_dynamic(mbs, end_time=5e-5 * s)
    tip = item.displacement(result, (0.2 * s, 0, 0))[:, 2]
    assert result.status == "finished"
    assert tip[0] < -1e-3 * s
    assert np.ptp(tip) < 1e-4 * abs(tip[0])


@pytest.mark.parametrize("s", [SCALES[0], 1.0, SCALES[1]])
def test_velocities_that_violate_a_joint_in_any_units(cantilever, frame, s):
    mbs, _ = clamped(cantilever, s, frame, initialVelocity=[0, 0, 1e-2])
    with pytest.raises(InputError, match=r"violated by the initial velocities, by 0\.01"):
        ep.solve_dynamic(mbs, end_time=1e-5 * s)


@pytest.mark.parametrize("s", [SCALES[0], 1.0, SCALES[1]])
def test_soft_springs_of_any_size_hold_a_body(body_of, s):
    """All frequencies are 1e-5 of f_cut: low ones in rad/s, of a large body, but no motion that nothing holds."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body_of(s), gravity=[0, 0, -9.81])
    add_springs(mbs, item, (2 * np.pi * 1.0 / s) ** 2)
    mbs.Assemble()
    assert ep.solve_static(mbs, load_steps=1).status == "finished"
