"""The likeliest wrong calls: each message leads to the fix. Those tested beside what they call are not repeated here.

Elsewhere: forgot Assemble, body used twice, unknown frame and formulation (test_solve), rotation in an inertial frame
(test_solve), patches that do not face each other (test_rows), old body files (test_body_files), mesh files
(test_mesh_files), a missing display (test_view).
"""

import subprocess
import sys
from functools import partial

import exudyn as exu
import meshio
import netgen.occ as occ
import numpy as np
import pytest
from oracles import TOP, box

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError, PenetrationError, RunError, UnitsWarning

BLOCK = box(0.01, 0.02, 0.03)


@pytest.fixture
def step_file(tmp_path):
    """A block of 10 x 20 x 30 mm, in millimetres."""
    path = tmp_path / "block.step"
    occ.Box(occ.Pnt(-5, -10, 0), occ.Pnt(5, 10, 30)).WriteStep(str(path))
    return path


def test_millimetres_for_metres_and_what_the_warning_proposes(step_file):
    with pytest.warns(UnitsWarning, match=r"the body is 30 long .* if it is in millimetres, .*scale=1e-3 of fe_model"):
        ep.fe_model(step_file, ep.STEEL, maxh=10)
    fem = ep.fe_model(step_file, ep.STEEL, maxh=5e-3, scale=1e-3)
    assert fem.total_mass == pytest.approx(7800 * 6e-6, rel=1e-9)
    with pytest.raises(
        EmptyRegionError, match=r"no node lies within 6 m of \(0, 0, 30\): .* the body spans .* 0.03\) m"
    ):
        ep.Partition.ball(fem, (0, 0, 30), 6)


@pytest.mark.parametrize("units", [{"E": 210.0}, {"E": 210e3}, {"rho": 7.8}])
def test_a_material_of_no_solid(units):
    slipped = ep.Material(**({"E": 210e9, "nu": 0.3, "rho": 7800.0} | units))
    with pytest.warns(
        UnitsWarning, match="speed of waves in a bar, .*, that of no solid: expected 10 to 2e4"
    ) as caught:
        ep.fe_model(BLOCK, slipped, maxh=1e-2)
    assert (len(caught), caught[0].filename) == (1, __file__)


@pytest.mark.parametrize(
    ("sizes", "message"),
    [
        ({"maxh": 2}, r"maxh: 2 m is longer than the body, 0\.03 m; lengths are"),
        (
            {"refine": ep.Refine((0, 0, 0), 0.5, 0.2)},
            r"refine: h=0\.2 m has no effect, .* maxh=0\.01 m; .* 0\.03 m long",
        ),
        (
            {"refine": ep.Refine((0, 0, 30), 5e-3, 2e-3)},
            r"refine: the ball .* at \(0\.0, 0\.0, 30\.0\) misses the body",
        ),
    ],
)
def test_mesh_sizes_in_millimetres(sizes, message):
    for call in (partial(ep.generate_mesh, BLOCK), partial(ep.fe_model, BLOCK, ep.STEEL)):
        with pytest.warns(UnitsWarning, match=message) as caught:
            call(**{"maxh": 1e-2, **sizes})
        assert (len(caught), caught[0].filename) == (1, __file__)


def test_a_ball_of_more_elements_than_memory_holds():
    with pytest.raises(InputError, match=r"radius 0\.5 m with elements of 0\.0002 m takes 6\.5e\+10 of them, .*metres"):
        ep.fe_model(BLOCK, ep.STEEL, maxh=1e-2, refine=[ep.Refine((0, 0, 0), 0.5, 0.2e-3)])


def test_scale_of_shapes_meshes_and_files(step_file, tmp_path, block):
    shape = occ.Box(occ.Pnt(-5, -10, 0), occ.Pnt(5, 10, 30))
    fine = ep.Refine((0, 0, 0.03), 3e-3, 1.5e-3)  # in the lengths after scaling
    fem = ep.fe_model(shape, ep.STEEL, maxh=5e-3, scale=1e-3, refine=fine)
    np.testing.assert_allclose(np.ptp(fem.points, axis=0), [0.01, 0.02, 0.03])
    near = np.linalg.norm(fem.points - [0, 0, 0.03], axis=1) < 3e-3
    assert near.sum() > 2 * (np.linalg.norm(block.points - [0, 0, 0.03], axis=1) < 3e-3).sum()
    meshio.Mesh(1e3 * block.points, [("tetra10", block.cells)]).write(tmp_path / "block.vtu")
    read = ep.fe_model(tmp_path / "block.vtu", ep.STEEL, scale=1e-3)
    np.testing.assert_allclose(read.points, block.points, atol=1e-15)
    assert abs(read.stiffness - block.stiffness).max() < 1e-9 * abs(block.stiffness).max()
    with pytest.raises(
        InputError, match=r"scale: a mesh is taken as it is, got 0\.001; scale its shape before meshing"
    ):
        ep.fe_model(ep.generate_mesh(shape, maxh=10), ep.STEEL, scale=1e-3)
    with pytest.raises(InputError, match="scale: expected a finite number above zero"):
        ep.fe_model(step_file, ep.STEEL, maxh=5, scale=0)


def test_lists_are_arrays(block):
    partition = ep.Partition.ball(block, center=[0, 0, 0.03], radius=6e-3, direction=[0, 0, 2])
    np.testing.assert_array_equal(partition.patches[0].direction, [0, 0, 1])
    with pytest.raises(InputError, match=r"center: expected shape \(3,\), got \(2,\)"):
        ep.Partition.ball(block, center=[0, 0.03], radius=6e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nu": "0.3"}, r"nu: expected a Poisson's ratio in \(-1, 0.5\), got '0.3'"),
        ({"nu": None}, r"nu: expected a Poisson's ratio in \(-1, 0.5\), got None"),
        ({"nu": float("nan")}, "nu: expected .* got nan"),
        ({"nu": 30}, "nu: expected .* got 30.0"),
        ({"E": "210e9"}, "E: expected a finite number above zero in Pa, got '210e9'"),
        ({"rho": [7800]}, r"rho: expected a finite number above zero in kg/m3, got \[7800\]"),
    ],
)
def test_a_material_is_three_numbers(change, message):
    with pytest.raises(InputError, match=message):
        ep.Material(**({"E": 210e9, "nu": 0.3, "rho": 7800.0} | change))
    with pytest.raises(InputError, match=r"material: expected an ep\.Material, such as ep\.STEEL, got str"):
        ep.fe_model(box(1, 1, 1), "steel", maxh=1)


def test_what_belongs_where(mbs, block, top, bodies):
    for call, message in (
        (
            lambda: ep.reduce(block, None, f_cut=8e4),
            r"partition: expected one, as of Partition.ball\(\), or skin=True .* got None",
        ),
        (
            lambda: ep.reduce(top, block, f_cut=8e4),
            r"fem: expected what fe_model\(\) returns, a FEModel, got Partition",
        ),
        (lambda: ep.reduce_pair((block, None), (block, top), tolerance=0.1, speed=1), "partition: expected what Part"),
        (
            lambda: ep.reduce_pair(block, top, tolerance=0.1, speed=1),
            r"slave: expected \(FEModel, Partition\), got FEModel",
        ),
        (
            lambda: ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=["0", "0", "-1"]),
            r"initialVelocity: expected numbers of shape \(3,\), got \['0', '0', '-1'\]",
        ),
        (
            lambda: ep.Partition.ball(bodies[0], (0, 0, 0), 1e-3),
            r"fem: expected what fe_model\(\) returns, .*ReducedBody",
        ),
        (lambda: ep.CreatePartitionBody(mbs, block), r"body: .* reduce\(\) or load_body\(\) returns, got FEModel"),
        (lambda: ep.CreatePartitionContact(mbs, *bodies), "expected what CreatePartitionBody returns, .*ReducedBody"),
        (
            lambda: ep.reduce(block, top, f_cut=8e4, basis="Craig-Bampton"),
            "one of 'free', 'craig-bampton', .* 'Craig-B",
        ),
        (lambda: ep.generate_mesh(box(1, 1, 1), maxh=1, refine=[((0, 0, 0), 1, 1)]), r"refine: expected ep.Refine\("),
        (lambda: ep.solve_dynamic(None, end_time=1.0), "mbs: expected a model of Exudyn, a MainSystem, got NoneType"),
        (lambda: ep.solve_dynamic(exu.SystemContainer(), end_time=1.0), r"SystemContainer; .*AddSystem\(\)"),
        (lambda: ep.CreatePartitionBody(exu.SystemContainer(), bodies[0]), r"SystemContainer; .*AddSystem\(\)"),
        (lambda: ep.CreatePartitionContact(None, *bodies), "mbs: expected a model of Exudyn, .*got NoneType"),
        (lambda: ep.collect(exu.SystemContainer()), r"SystemContainer; .*AddSystem\(\)"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_kilohertz_for_hertz(block, top):
    with pytest.warns(UnitsWarning, match=r"f_cut: no elastic mode lies anywhere near 80 Hz, .* not in kHz") as said:
        ep.reduce(block, top, f_cut=80)
    assert said[0].filename == __file__


def test_a_point_of_space_for_one_of_the_body(impact):
    mbs, striker, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    in_space = np.add(TOP, (0, 0, 0.02))
    with pytest.raises(InputError, match="given in the body's own coordinates, without referencePosition"):
        striker.velocity(result, in_space)


def test_results_before_a_run(impact):
    with pytest.raises(RunError, match="no sensor stored anything; run the model first"):
        ep.collect(impact[0])


def test_missing_files_name_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for call in (
        lambda: ep.fe_model("rod.step", ep.STEEL, maxh=1e-3),
        lambda: ep.fe_model("rod.vtu", ep.STEEL),
        lambda: ep.load_body("rod.npz"),
    ):
        with pytest.raises(InputError, match=rf"there is no(ne| file).*rod\..*\(working directory {tmp_path}\)"):
            call()


@pytest.mark.parametrize(
    ("package", "call"),
    [
        ("ngsolve", "ep.generate_mesh(None, maxh=1.0)"),
        ("ngsolve", "ep.fe_model('rod.step', ep.STEEL, maxh=1e-3)"),
        ("exudyn", "ep.solve_dynamic(None, end_time=1.0)"),
    ],
)
def test_without_a_package(package, call):
    """In an interpreter that cannot import it, the error has the line that installs it, and the rest works."""
    code = f"import sys; sys.modules[{package!r}] = None; import exudyn_partition as ep; ep.hertz; {call}"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr.strip().splitlines()[-1].startswith("exudyn_partition.errors.MissingPackageError")
    assert f"pip install {package}" in run.stderr


def counts(mbs):
    data = mbs.systemData
    return (
        data.NumberOfNodes(),
        data.NumberOfObjects(),
        data.NumberOfMarkers(),
        data.NumberOfLoads(),
        data.NumberOfSensors(),
    )


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_name_that_is_taken_leaves_the_model_as_it_was(mbs, bodies, frame):
    """As a notebook cell that is run again; the model still runs."""
    ball = ep.CreatePartitionBody(mbs, bodies[0], name="ball", frame=frame, referencePosition=TOP)
    block = ep.CreatePartitionBody(mbs, bodies[1], name="block", frame=frame)
    ep.CreatePartitionContact(mbs, ball, block, name="tip")
    before = counts(mbs)
    with pytest.raises(InputError, match=r"name: the model already has the object 'ball'.*notebook cell"):
        ep.CreatePartitionBody(mbs, bodies[0], name="ball", frame=frame)
    third = ep.CreatePartitionBody(mbs, bodies[0], frame=frame)
    fourth = ep.CreatePartitionBody(mbs, bodies[0], frame=frame, referencePosition=[0, 0, -0.1])
    between = counts(mbs)
    for kind, name in (("sensor", "tip"), ("object", "ball")):
        with pytest.raises(InputError, match=f"name: the model already has the {kind} '{name}'"):
            ep.CreatePartitionContact(mbs, third, ep.RigidPlane((0, 0, -0.01)), name=name)
    assert counts(mbs) == between != before
    mbs.Assemble()
    assert ep.solve_dynamic(mbs, end_time=1e-6).status == "finished"
    assert len(fourth.nodes) == len(third.nodes)


def test_patches_by_number_and_name(block, top, bodies):
    body = bodies[1]
    assert top.patch(np.int64(0)) == body.partition.patch(0) == 0
    np.testing.assert_array_equal(body.flexibility(np.int32(0)), body.flexibility())
    calls = {top.patch: "key", body.flexibility: "patch", lambda key: body.surface(np.zeros(3), key): "patch"}
    for call, argument in calls.items():
        for key in (-1, 1, 7, "nose", True, 0.0):
            with pytest.raises(InputError, match=f"^{argument}: expected the name or number of one"):
                call(key)


def test_moment_sensors_of_another_model(impact):
    other = exu.SystemContainer().AddSystem()
    before = counts(other)
    with pytest.raises(InputError, match="mbs: contact 'tip' belongs to another model"):
        impact[3].AddMomentSensor(other)
    assert counts(other) == before


def test_whole_numbers_of_numpy(impact):
    result = ep.solve_dynamic(impact[0], end_time=1e-6, step=0.25e-6)
    np.testing.assert_array_equal(result.at(np.int64(3)).t, result.at(3).t)


@pytest.mark.parametrize("option", [{"speed": -5}, {"speed": 5.0}, {"duration": 1e-3}])
def test_options_of_a_tolerance_beside_a_frequency(block, top, option):
    with pytest.raises(InputError, match=f"{next(iter(option))}: .* has no effect beside f_cut"):
        ep.reduce(block, top, f_cut=8e4, **option)


def test_bodies_that_overlap_are_moved_by_what_there_is(ball, block, top):
    """The ball's tip lies at the block's lower face: where no item has a referencePosition, none is named."""
    with pytest.raises(
        PenetrationError, match=r"or the master the other way \(the points of its mesh, which are taken as they ar"
    ):
        ep.reduce_pair(ball, (block, top), tolerance=0.5, speed=1.0)
    bodies = [ep.reference.FullBody(*ball), ep.reference.FullBody(block, top)]
    with pytest.raises(PenetrationError, match=r"or the master the other way \(position of FullBody\)"):
        ep.reference.simulate(bodies, end_time=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda fem, part, body: ep.reduce(fem, part, f_cut=60e3, progress=3), "progress: expected"),
        (
            lambda fem, part, body: ep.reduce(fem, part, tolerance=0.5, speed=1e300),
            "speed: expected 1e-30 to 1e.30 in m/s",
        ),
        (lambda fem, part, body: ep.reduce(fem, part, tolerance=0.5, duration=1e9), "duration: expected .* crossings"),
        (
            lambda fem, part, body: ep.reduce(fem, part, tolerance=0.5, duration=1e-30),
            "duration: expected .* crossings",
        ),
        (
            lambda fem, part, body: ep.reduce_pair((fem, part), (fem, part), tolerance=0.5, speed=1.0, patches=0),
            "patches: expected the slave's and the master's, two names or numbers, got 0",
        ),
        (lambda fem, part, body: body.rows(None), "nodes: expected numbers of nodes"),
        (lambda fem, part, body: body.rows([10**6]), "nodes: expected numbers of nodes"),
        (lambda fem, part, body: body.reduced_rows("x"), "rows: expected a csr matrix"),
        (lambda fem, part, body: body.reduced_rows(np.full((1, fem.n_dofs), "x")), "rows: expected real numbers, got"),
        (lambda fem, part, body: ep.Refine((0, 0, 0), 1.0, 4e-276), "h: expected 1e-30 to 1e.30"),
        (lambda fem, part, body: body.displacement("x"), "q: expected numbers of shape"),
        (lambda fem, part, body: body.displacement(np.full(body.n_dofs, np.nan)), "q: expected finite numbers"),
        (lambda fem, part, body: body.surface(float("nan")), "position: expected shape"),
        (lambda fem, part, body: body.flexibility(7), "patch: expected the name or number"),
        (lambda fem, part, body: body.flexibility(0, "nose"), "other: expected the name or number"),
        (lambda fem, part, body: body.interface_rows(np.ones(2)), "name: expected one of none"),
    ],
)
def test_reductions_and_bodies_are_not_given_anything(block, top, bodies, call, message):
    with pytest.raises(InputError, match=message):
        call(block, top, bodies[1])
