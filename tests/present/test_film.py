"""Films: frames show the motion of the run, with the force beneath and its mark at the right time."""

import numpy as np
import pytest
from oracles import MARBLE_RADIUS
from PIL import Image

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MissingPackageError

pytest.importorskip("pyvista")


@pytest.fixture(scope="module")
def run(bodies):
    """The ball hits a rigid plane and flies away."""
    import exudyn as exu

    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(
        mbs, bodies[0], name="ball", initialVelocity=[0, 0, -1.0], referencePosition=[0, 0, 1e-6]
    )
    ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=150e-6, step=0.5e-6)


def test_frames_show_the_motion_and_the_force(run, tmp_path):
    size = (400, 320)
    first = run.film(tmp_path / "run.png", frames=4, size=size, scale=1.0, colour="deformation")
    assert first == tmp_path / "run_0000.png"
    pictures = [np.asarray(Image.open(tmp_path / f"run_{i:04d}.png"), dtype=int) for i in range(4)]
    assert all(picture.shape == (320, 400, 3) for picture in pictures)
    marks = []
    for picture in pictures:
        strip = picture[-60:]
        red = (abs(strip - (200, 60, 40)).sum(axis=2) == 0).all(axis=0)
        assert red.sum() == 0  # the mark stays within the frame, off the numbers beneath
        strip = picture[-60:-24]
        red = (abs(strip - (200, 60, 40)).sum(axis=2) == 0).any(axis=0)
        marks.append(np.flatnonzero(red).mean())
    # The mark moves with time, at equal distances.
    np.testing.assert_allclose(np.diff(marks), np.diff(marks)[0], atol=1.0)
    assert marks[0] > 50
    assert 300 < marks[-1] < 390
    assert abs(pictures[1][:250] - pictures[0][:250]).max() > 50


def test_texts_stand_on_a_box_before_bodies(run, tmp_path):
    """Seen from near, a dark ball is behind the text, whose letters are black on a light box."""
    path = run.film(tmp_path / "near.png", frames=[40e-6], size=(500, 400), view="contact", scale=1.0)
    corner = np.asarray(Image.open(path).convert("L"), dtype=int)[:16, 2:60]
    assert corner.min() < 60
    assert np.percentile(corner, 70) > 180


def test_a_long_run_shows_its_impact(marble, mbs, tmp_path):
    """Of an impact that lasts less than the time between equal pictures, a film has more than one."""
    ball = ep.CreatePartitionBody(
        mbs, marble, referencePosition=[0, 0, MARBLE_RADIUS + 2e-6], initialVelocity=[0, 0, -0.5]
    )
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south")
    mbs.Assemble()
    long = ep.solve_dynamic(mbs, end_time=6e-3, method="implicit", adaptive=True)
    long.film(tmp_path / "long.png", frames=24, size=(240, 240), colour="contact_pressure", view="contact")
    pictures = [np.asarray(Image.open(path), dtype=int) for path in sorted(tmp_path.glob("long_*.png"))]
    assert 30 <= len(pictures) <= 40
    long.film(tmp_path / "even.png", frames=np.linspace(0, 6e-3, 24), size=(240, 240))
    assert len([*tmp_path.glob("even_*.png")]) == 24
    closed = long.t[contact.force(long) > 0]
    assert np.ptp(closed[closed < closed[0] + 1e-3]) < 6e-3 / 24


def test_kinds_of_films(run, tmp_path):
    path = run.film(tmp_path / "run.gif", frames=3, size=(120, 80), period=0.1, view="contact")
    with Image.open(path) as film:
        assert (film.n_frames, film.size, film.info["duration"]) == (3, (120, 80), 100)
    imageio = pytest.importorskip("imageio_ffmpeg")
    path = run.film(tmp_path / "run.mp4", frames=5, size=(160, 120), period=0.05, view="ball")
    reader = imageio.read_frames(str(path))
    facts = next(reader)
    assert facts["size"] == (160, 120)
    assert facts["fps"] == pytest.approx(20)
    assert len([*reader]) == 5
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_one_instant(run, tmp_path, recwarn):
    with Image.open(run.at([40e-6]).film(tmp_path / "run.gif", size=(120, 80))) as film:
        assert film.n_frames >= 1
    assert len(recwarn) == 0


def test_what_is_refused(run, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"path: expected .*mp4.*got '.avi'"):
        run.film(tmp_path / "run.avi")
    for period in (1e-3, 656.0):  # GIF files would show the first at once, and cannot hold the second
        with pytest.raises(InputError, match=r"period: expected 0\.01 to 600 s"):
            run.film(tmp_path / "run.gif", period=period)
    with pytest.raises(InputError, match="view: expected"):
        run.film(tmp_path / "run.gif", view="plate")
    with pytest.raises(InputError, match="direction"):
        run.film(tmp_path / "run.gif", direction=(0, 0, 0))
    with pytest.raises(InputError, match="needs its FE model"):
        run.film(tmp_path / "run.gif", colour="von_mises")
    monkeypatch.setitem(__import__("sys").modules, "pyvista", None)
    with pytest.raises(MissingPackageError, match="pip install"):
        run.film(tmp_path / "run.gif")
