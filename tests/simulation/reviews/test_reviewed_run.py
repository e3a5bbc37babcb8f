"""What reviews have in common: bounds against brute force, what is found once a body, and how findings are told."""

import logging

import exudyn as exu
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning
from exudyn_partition.simulation.reviews import bending
from exudyn_partition.simulation.reviews.review import OF_SAMPLES, reviewed
from exudyn_partition.simulation.reviews.reviewed_run import Finding, ReviewedBody, ReviewedRun, evenly


@pytest.fixture(scope="module")
def rod():
    fem = ep.fe_model(box(0.004, 0.004, 0.04), ep.STEEL, maxh=0.004)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0.04), 2.5e-3), f_cut=100e3)


def flying(rod, n=1, frame="inertial"):
    """Rods that fly without touching anything, and their run."""
    mbs = exu.SystemContainer().AddSystem()
    items = [
        ep.CreatePartitionBody(mbs, rod, referencePosition=[i, 0, 0], frame=frame, initialVelocity=[0, 0, 1.0])
        for i in range(n)
    ]
    mbs.Assemble()
    return mbs, items, ep.solve_dynamic(mbs, end_time=2e-5, method="implicit", step=1e-6)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize("share", [0.0, 1e-3])
def test_no_node_of_the_surface_goes_further_than_the_bound(rod, frame, share):
    """Nor is the bound far above a motion in which the body flies, turns and shakes by a share of its length."""
    _, (item,), result = flying(rod, frame=frame)
    history, t = ReviewedBody(item, result), np.linspace(0, 1, 21)[:, None]
    rigid = np.array([1e-3, -2e-3, 5e-3, 0.02, -0.01, 0.03])
    shapes = share * 0.04 / abs(rod.shape_rows(np.unique(rod.facets))).max(axis=0)
    shaken = np.where(np.arange(rod.n_dofs) > 5, shapes, 0.0) * np.sin(np.arange(rod.n_dofs) + 7 * t)
    history.q = shaken + (
        t * (rod.rigid @ rigid) if frame == "inertial" else np.pad(t * rigid, ((0, 0), (0, rod.n_dofs - 6)))
    )
    places = item.kinematics.at(np.unique(rod.facets)).place(history.q)
    furthest = np.linalg.norm(places - places[0], axis=2).max()
    assert furthest <= history.way < (1.6 if share == 0.0 else 10) * furthest


def test_no_facet_has_more_stress_than_the_bound(rod):
    """The sum over coordinates of the largest stress that each of them makes."""
    bound, facets = bending.largest_stresses(rod), bending.free_facets(rod)
    assert len(facets) > 10
    q = np.random.default_rng(1).normal(size=(50, rod.n_dofs)) * 1e-6
    stress = bending.surface_stress(rod, facets, q, rod.material)[0].max(axis=1)
    assert (stress <= abs(q) @ bound * (1 + 1e-9)).all()
    one = np.eye(rod.n_dofs)[10:11]
    assert bending.surface_stress(rod, facets, one, rod.material)[0].max() == pytest.approx(bound[10])


def test_what_depends_on_a_body_is_found_once_for_all_its_items_and_runs(rod, monkeypatch):
    asked, find = [], bending.far_from_loads
    monkeypatch.setattr(bending, "far_from_loads", lambda body: asked.append(body) or find(body))
    body = rod.without_inside()  # another one, of which nothing is known yet
    for _ in range(2):
        flying(body, n=3)
    assert len(asked) == 1


def test_findings_are_told_once_at_the_user_s_line_or_logged(rod, caplog):
    mbs, _, result = flying(rod)
    caplog.set_level(logging.INFO, logger="exudyn_partition")
    findings = Finding("a limit is exceeded"), Finding("a remark", category=None)
    with pytest.warns(ModelLimitWarning, match="a limit is exceeded") as caught:
        told = reviewed(ReviewedRun(mbs, result), lambda run: findings)
    assert [(warning.filename, str(warning.message)) for warning in caught] == [(__file__, "a limit is exceeded")]
    assert told.warnings == ("a limit is exceeded",)
    assert "a remark" in caplog.messages


@pytest.mark.parametrize("review", OF_SAMPLES)
def test_each_review_is_a_function_of_the_run_alone_and_changes_nothing(rod, review):
    mbs, _, result = flying(rod)
    run = ReviewedRun(mbs, result)
    assert [*review(run)] == [*review(run)] == []


def test_samples_are_spread_evenly():
    assert evenly(5, 10).tolist() == [0, 1, 2, 3, 4]
    assert evenly(101, 5).tolist() == [0, 25, 50, 75, 100]
    assert evenly(1, 5).tolist() == [0]
