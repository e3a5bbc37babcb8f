"""Bodies in files, and the cache: what is read is what was written, or is refused by name."""

import dataclasses
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from oracles import TOP, compliant, multipliers
from samples import SAMPLES, assert_same, content, rewrite, sample

import exudyn_partition as ep
from exudyn_partition.contact.formulations.explicit_multipliers import ForwardIncrement, ForwardRows
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.side import Side
from exudyn_partition.errors import InputError
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.reduction import reduction
from exudyn_partition.support import cache

BASES = ["free", "residual", "contact-adapted"]


F_CUT = 150e3


@pytest.fixture(scope="module", params=BASES)
def pair(request, pair_of):
    """Ball and block."""
    return pair_of(request.param)


@pytest.fixture(scope="module")
def small(pair_of):
    return pair_of("contact-adapted")[1]


def reloaded(body, folder):
    body.save(folder / "body.npz")
    return ep.load_body(str(folder / "body.npz"))


def test_a_loaded_body_is_the_saved_one(pair, tmp_path):
    for body in pair:
        again = reloaded(body, tmp_path)
        assert_same(again, body)
        assert_same(again.rigid, body.rigid)
        assert (again.table(), repr(again), again.left_out) == (body.table(), repr(body), body.left_out)


def test_loaded_bodies_meet_with_the_same_force(pair, tmp_path):
    def answer(striker, target):
        places = zip((striker, target), (TOP, (0, 0, 0)), strict=True)
        gaps = PatchGaps(*[Side.of(InertialKinematics(body, np.array(at))) for body, at in places])
        down = np.r_[0, 0, -1.0, 0, 0, 0]
        q = np.r_[striker.rigid @ (2e-6 * down), np.zeros(target.n_dofs)]
        if striker.basis.name == "free":
            q_t = np.r_[striker.rigid @ down, np.zeros(target.n_dofs)]
            rows = ForwardRows(multipliers(gaps))
            together = ForwardIncrement([rows], [np.arange(len(q))])
            return together.increment([rows.begin()], [(q, q_t, np.zeros(len(q)))], 1e-8)[0][0]
        return compliant(gaps).at(q).generalised

    expected = answer(*pair)
    assert np.abs(expected).max() > 0
    assert answer(*(reloaded(body, tmp_path) for body in pair)).tobytes() == expected.tobytes()


def test_a_file_says_what_it_is(pair, tmp_path):
    pair[0].save(tmp_path / "body.npz")
    arrays, about = content(tmp_path / "body.npz")
    np.testing.assert_array_equal(arrays["basis.shapes"], pair[0].basis.shapes)
    np.testing.assert_array_equal(arrays["facets"], pair[0].facets)
    assert about["format"] == "exudyn_partition reduced body"
    assert about["library"] == ep.__version__
    assert "kg" in about["units"]
    assert about["content"]["fields"].keys() == {f.name for f in dataclasses.fields(ep.ReducedBody)}


def test_refusal_of_other_files(tmp_path):
    with pytest.raises(InputError, match=r"expected a saved reduced body, but there is no file .*nothing\.npz"):
        ep.load_body(tmp_path / "nothing.npz")
    with pytest.raises(InputError, match=r"cannot be read: .*directory"):
        ep.load_body(tmp_path)
    (tmp_path / "text.npz").write_text("x")
    with pytest.raises(InputError, match=r"text\.npz is not an npz file; expected a saved reduced body"):
        ep.load_body(tmp_path / "text.npz")
    ep.History(np.zeros(2), np.zeros(2), {}).save(tmp_path / "history.npz")
    with pytest.raises(InputError, match=r"npz file of another kind, with format, t, force, info; expected a saved"):
        ep.load_body(tmp_path / "history.npz")
    np.savez(tmp_path / "pickled.npz", about=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="cannot be read"):
        ep.load_body(tmp_path / "pickled.npz")
    SAMPLES.save(tmp_path / "sample.npz", sample())
    with pytest.raises(InputError, match="of another kind"):
        ep.load_body(tmp_path / "sample.npz")


def test_refusal_of_bad_places(pair, tmp_path):
    with pytest.raises(InputError, match=r"there is no folder .*nowhere to write body\.npz into; make it first"):
        pair[0].save(tmp_path / "nowhere" / "body.npz")
    with pytest.raises(InputError, match="expected the name of a file, got the folder"):
        pair[0].save(tmp_path)


def altered(body, path, change):
    """Save a body with other content, whole by every checksum."""
    body.save(path)
    rewrite(path, change)
    return path


def with_content(a, about, part, value):
    """Put an array in place of another, and say so in the description."""

    def visit(node):
        if isinstance(node, dict):
            if node.get("array") == part:
                node.update(dtype=value.dtype.str, shape=list(value.shape))
            for child in node.values():
                visit(child)
        elif isinstance(node, list):
            for child in node:
                visit(child)

    a[part] = value
    visit(about["content"])


def first_nan(array):
    result = array.copy()
    result.flat[0] = np.nan
    return result


ALTERED = {
    "points": (lambda x: first_nan(x), "points: expected finite numbers"),
    "basis.shapes": (lambda x: first_nan(x), "shapes: expected finite numbers"),
    "basis.flexibility": (lambda x: x[1:, 1:].copy(), r"flexibility: expected shape \(21, 21\), got \(20, 20\)"),
    "basis.omega": (lambda x: -x, "omega: expected frequencies that are not negative"),
    "basis.rigid": (lambda x: x[1:].copy(), "rigid: expected shape"),
    "mass.data": (lambda x: 0 * x, "mass: expected a positive mass"),
    "stiffness.data": (lambda x: first_nan(x), "stiffness: expected finite numbers"),
    "mass.indices": (lambda x: x + 10**6, "is damaged"),
    "facets": (lambda x: x + 10**6, "facets: expected numbers from 0 to 519"),
    "partition.nodes": (lambda x: x[::-1].copy(), "nodes: expected each node once, ascending"),
    "partition.patches.0.facets": (lambda x: -x, "facets: expected numbers from 0"),
    "partition.patches.0.direction": (lambda x: 2 * x, "direction: expected a unit vector"),
    "inertia.cross": (lambda x: x[:, 1:].copy(), "cross: expected shape"),
    "centre_of_mass": (lambda x: x[:2].copy(), r"centre_of_mass: expected shape \(3,\), got \(2,\)"),
}


@pytest.mark.parametrize("part", ALTERED)
def test_altered_content_is_refused_by_name(small, tmp_path, part):
    change, message = ALTERED[part]
    path = altered(small, tmp_path / "body.npz", lambda a, about: with_content(a, about, part, change(a[part])))
    with pytest.raises(InputError, match=rf"body\.npz is damaged or cannot be read: .*{message}|{message}"):
        ep.load_body(path)


SCALARS = {"total_mass": 0.0, "f_cut": float("nan"), "reduce_s": "x", "estimate": 3, "partition": 1}


@pytest.mark.parametrize("field", SCALARS)
def test_altered_numbers_are_refused_by_name(small, tmp_path, field):
    path = altered(
        small, tmp_path / "body.npz", lambda a, about: about["content"]["fields"].update({field: SCALARS[field]})
    )
    with pytest.raises(InputError, match=rf"is damaged or cannot be read: {field}: expected"):
        ep.load_body(path)


def test_another_class_is_refused(small, tmp_path):
    def a_patch(a, about):
        about["content"] = about["content"]["fields"]["partition"]["fields"]["patches"]["tuple"][0]

    for change, got in ((a_patch, "Patch"), (lambda a, about: about.update(content=3), "int")):
        with pytest.raises(InputError, match=f"expected a ReducedBody in it, got a {got}"):
            ep.load_body(altered(small, tmp_path / "body.npz", change))
    reduction.FILE.save(tmp_path / "pair.npz", (small, small))
    with pytest.raises(InputError, match="expected a saved reduced body, got 2 of them"):
        ep.load_body(tmp_path / "pair.npz")


def test_what_is_no_path_or_no_file_is_refused(small, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, message in (
        (tmp_path / "pipe", "expected a saved reduced body, got .*a device or a pipe"),
        ("/dev/zero", "a device or a pipe"),
        (None, "path: expected a path"),
        (small, "path: expected a path"),
        ("a\0b", "path: expected a path"),
        ("x" * 400, "cannot be read: .*too long"),
    ):
        with pytest.raises(InputError, match=message):
            ep.load_body(path)
    for path in (tmp_path / "pipe", "/dev/null", None, "a\0b", "x" * 400):
        with pytest.raises(InputError, match="path: "):
            small.save(path)
    assert (tmp_path / "pipe").is_fifo()


def test_the_key_changes_with_the_source_of_every_folder(tmp_path):
    package = tmp_path / "package"
    shutil.copytree(Path(ep.__file__).parent, package)
    keys = [cache.code_digest(), cache.code_digest(package)]
    assert keys[0] == keys[1]
    for folder in sorted({path.parent for path in package.rglob("*.py")}):
        source = min(folder.glob("*.py"))
        source.write_text(source.read_text() + "# changed\n")
        keys.append(cache.code_digest(package))
    assert len(set(keys)) == len(keys) - 1 > 10
