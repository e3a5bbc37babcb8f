"""Scenes of PyVista: they hold what is drawn, at its place, with its values."""

import numpy as np
import pytest
from PIL import Image

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MissingPackageError

pyvista = pytest.importorskip("pyvista")


@pytest.fixture
def run(mbs, bodies):
    """The ball hits a rigid plane."""
    striker = ep.CreatePartitionBody(mbs, bodies[0], name="ball", initialVelocity=[0, 0, -1.0])
    contact = ep.CreatePartitionContact(mbs, striker, ep.RigidPlane((0, 0, -1e-6)))
    mbs.Assemble()
    return striker, contact, ep.solve_dynamic(mbs, end_time=20e-6, step=0.5e-6)


def test_the_scene_holds_the_deformed_body_and_the_plane(run):
    item, _, result = run
    scene = ep.pyvista_view.plotter(result, 10e-6, field="velocity", scale=50.0, size=(80, 60))
    assert scene.screenshot(return_img=True).std() > 20  # which also fills what it draws from
    drawn = pyvista.wrap(scene.actors["ball"].mapper.GetInput())
    frame = result.at([10e-6])
    at, q, q_t = (
        item.kinematics.at(np.unique(item.body.facets)), item.coordinates(frame)[0], item.coordinates_t(frame)[0]
    )  # fmt: skip
    np.testing.assert_allclose(drawn.points, at.place(q) + 49 * at.deformation(q), atol=1e-9)
    speed = np.linalg.norm(at.velocities(q, q_t), axis=1)
    np.testing.assert_allclose(drawn.active_scalars, speed, rtol=1e-9)
    assert scene.scalar_bar.GetTitle() == "velocity [m/s]"
    texts = [actor.GetText(2) for actor in scene.actors.values() if isinstance(actor, pyvista.CornerAnnotation)]
    assert texts == [f"t = {frame.t[0]:.6g} s\ndeformed x 50: bodies may seem to overlap"]
    others = [scene.actors[name] for name in scene.actors if name.startswith("PolyData")]
    (plane,) = (pyvista.wrap(actor.mapper.GetInput()) for actor in others)
    np.testing.assert_allclose(plane.points[:, 2], -1e-6, atol=1e-9)
    scene.close()


def test_a_picture_turns(run, tmp_path):
    _, _, result = run
    path = ep.pyvista_view.turntable(tmp_path / "turn.gif", result, size=(80, 60), frames=4, period=2.0)
    with Image.open(path) as film:
        assert (film.n_frames, film.size, film.info["duration"]) == (4, (80, 60), 500)
        pictures = [np.asarray(film.convert("L"), dtype=float) for i in range(4) if film.seek(i) is None]
    assert all(abs(a - pictures[0]).mean() > 0.1 for a in pictures[1:])


def test_what_is_refused(run, tmp_path, monkeypatch):
    _, _, result = run
    with pytest.raises(InputError, match="lower and the upper end"):
        ep.pyvista_view.plotter(result, limits=(2, 1))
    with pytest.raises(InputError, match="scale: expected at most"):
        ep.pyvista_view.plotter(result, scale=1e13)
    with pytest.raises(InputError, match="frames: expected"):
        ep.pyvista_view.turntable(tmp_path / "turn.gif", result, frames=1)
    with pytest.raises(InputError, match=r"period: expected 0\.01 to 600 s .* got 0\.001 s"):
        ep.pyvista_view.turntable(tmp_path / "turn.gif", result, frames=4, period=4e-3)
    monkeypatch.setitem(__import__("sys").modules, "pyvista", None)
    with pytest.raises(MissingPackageError, match="pip install pyvista"):
        ep.pyvista_view.plotter(result)
