"""Bodies in files, and the cache: what is read is what was written, or is refused by name."""

import dataclasses
import inspect
import io
import json
import multiprocessing
import os
import shutil
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from conftest import TOP

import exudyn_partition as ep
from exudyn_partition.contact.formulations.compliance import ComplianceContact
from exudyn_partition.contact.formulations.forward_increment import ForwardIncrement
from exudyn_partition.contact.formulations.lagrange import LagrangeContact
from exudyn_partition.contact.gaps import Side
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.errors import CacheWarning, InputError
from exudyn_partition.fe.patches import Interface, Patch
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.reduction import loads, reduction
from exudyn_partition.support import archive, cache

BASES = ["free", "residual", "contact-adapted"]
F_CUT = 150e3


@dataclass(frozen=True, eq=False)
class Sample:
    """A small value with a field of every kind."""

    name: str
    array: np.ndarray
    matrix: sp.csr_matrix
    labels: tuple[str, ...] = ("µ", "")
    nothing: np.ndarray | None = None
    limits: tuple[float, ...] = (0.1, float("inf"), -0.0)
    named: dict[str, np.ndarray] = dataclasses.field(default_factory=lambda: {"a b": np.empty((0, 3))})


SAMPLES = archive.Format("sample", 3, "none", (Sample,))
PACKED = replace(SAMPLES, packed=True)


def sample(number=1.0, n=5):
    return Sample("s", np.full((n, n), number), sp.diags(np.full(n, number), format="csr"))


def assert_same(x, y):
    """Same types, bits, memory order and write protection, down to the last field."""
    assert type(x) is type(y)
    if dataclasses.is_dataclass(x):
        for f in dataclasses.fields(x):
            assert_same(getattr(x, f.name), getattr(y, f.name))
    elif isinstance(x, np.ndarray):
        assert (x.dtype, x.shape) == (y.dtype, y.shape)
        assert x.tobytes() == y.tobytes()
        for flag in ("C_CONTIGUOUS", "F_CONTIGUOUS", "WRITEABLE"):
            assert x.flags[flag] == y.flags[flag]
    elif sp.issparse(x):
        assert x.shape == y.shape
        for part in ("data", "indices", "indptr"):
            assert_same(getattr(x, part), getattr(y, part))
    elif isinstance(x, dict):
        assert_same(tuple(x), tuple(y))
        assert_same(tuple(x.values()), tuple(y.values()))
    elif isinstance(x, tuple):
        assert len(x) == len(y)
        for a, b in zip(x, y, strict=True):
            assert_same(a, b)
    else:
        assert repr(x) == repr(y)


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
            law = LagrangeContact(gaps)
            return ForwardIncrement([law], [np.arange(len(q))]).increment([(q, q_t, np.zeros(len(q)))], 1e-8)[0]
        return ComplianceContact(gaps).force(q)

    expected = answer(*pair)
    assert np.abs(expected).max() > 0
    assert answer(*(reloaded(body, tmp_path) for body in pair)).tobytes() == expected.tobytes()


def test_every_kind_of_field_survives(tmp_path):
    value = replace(sample(), matrix=sp.csr_array(np.eye(3)), array=np.asfortranarray([[1, 2], [3, 4]]))
    SAMPLES.save(tmp_path / "any name", value)
    assert_same(SAMPLES.load(tmp_path / "any name"), value)
    for odd in (object(), np.array([None])):
        with pytest.raises(TypeError, match=r"array: a .* cannot be stored"):
            SAMPLES.save(tmp_path / "odd", replace(value, array=odd))
    assert [path.name for path in tmp_path.iterdir()] == ["any name"]


def test_a_file_says_what_it_is(pair, tmp_path):
    pair[0].save(tmp_path / "body.npz")
    arrays, about = content(tmp_path / "body.npz")
    np.testing.assert_array_equal(arrays["basis.shapes"], pair[0].basis.shapes)
    np.testing.assert_array_equal(arrays["facets"], pair[0].facets)
    assert about["format"] == "exudyn_partition reduced body"
    assert about["library"] == ep.__version__
    assert "kg" in about["units"]
    assert about["content"]["fields"].keys() == {f.name for f in dataclasses.fields(ep.ReducedBody)}


def content(path):
    """Arrays of an npz file, and what it says about itself, by NumPy alone; none of them packed any more."""
    with np.load(path) as data:
        arrays = dict(data)
    about = json.loads(str(arrays["about"]))

    def unpack(node):
        match node:
            case {"array": name, "dtype": dtype, "shape": shape}:
                if node.pop("planes", None):
                    numbers = np.frombuffer(arrays[name].T.tobytes(), dtype)
                    arrays[name] = np.ascontiguousarray(numbers.reshape(shape, order="F"))
            case dict():
                for child in node.values():
                    unpack(child)
            case list():
                for child in node:
                    unpack(child)

    unpack(about["content"])
    return arrays, about


def rewrite(path, change):
    """Pass the arrays of an npz file, and what it says about itself, through `change`."""
    arrays, about = content(path)
    change(arrays, about)
    np.savez(path, **{**arrays, "about": np.array(json.dumps(about))})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a, about: about.update(version=4), "is of version 4, .* reads version 3: update the library, or comp"),
        (lambda a, about: about.update(version=2), "is of version 2, .* reads version 3: compute and save the sample"),
        (lambda a, about: about.update(format="trace"), "npz file of another kind, with .*; expected a saved sample"),
        (lambda a, about: about.pop("version"), "is damaged or cannot be read"),
        (lambda a, about: a.pop("array"), "is damaged .*array.*compute and save the sample anew"),
        (lambda a, about: about["content"]["fields"].pop("name"), r"only the file or only the library has: \['name'\]"),
        (lambda a, about: about["content"]["fields"].update(more=1), r"only the library has: \['more'\]"),
        (lambda a, about: about["content"].update({"class": "Path"}), "is damaged"),
        (lambda a, about: a.update(array=np.ones((5, 4))), r"array: expected <f8 of shape \(5, 5\), got .*\(5, 4\)"),
        (lambda a, about: a.update(array=np.ones((5, 5), int)), "array: expected <f8 .*, got <i8"),
        (lambda a, about: a.update({"matrix.indptr": np.full(6, 99, np.int32)}), "is damaged"),
    ],
)
def test_refusal_of_what_is_not_understood(tmp_path, change, message):
    path = tmp_path / "sample.npz"
    SAMPLES.save(path, sample())
    rewrite(path, change)
    with pytest.raises(InputError, match=message):
        SAMPLES.load(path)


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


def test_any_damage_is_refused_or_changes_nothing(tmp_path):
    """Every byte flipped, every length cut."""
    path = tmp_path / "sample.npz"
    value = Sample("s", np.arange(3.0), sp.csr_matrix((1, 1)), (), None, (), {})
    SAMPLES.save(path, value)
    whole = path.read_bytes()
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"not an npz file|is damaged"):
            SAMPLES.load(path)
    harmless = 0
    for i, byte in enumerate(whole):
        path.write_bytes(whole[:i] + bytes([byte ^ 0xFF]) + whole[i + 1 :])
        try:
            assert_same(SAMPLES.load(path), value)
            harmless += 1
        except InputError:
            pass
    # Dates, attributes and the padding of zip's directory.
    assert harmless < 0.15 * len(whole)


def test_any_damage_of_packed_arrays_is_refused_or_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "_PACK_FROM", 1)
    path = tmp_path / "sample.npz"
    value = Sample("s", np.arange(30.0), sp.csr_matrix((1, 1)), (), None, (), {})
    PACKED.save(path, value)
    assert_same(PACKED.load(path), value)
    whole = path.read_bytes()
    begin, end = (whole.index(name) for name in (b"array.npy", b"matrix.data.npy"))
    harmless = 0
    for i in range(begin, end):
        path.write_bytes(whole[:i] + bytes([whole[i] ^ 0x10]) + whole[i + 1 :])
        try:
            assert_same(PACKED.load(path), value)
            harmless += 1
        except InputError:
            pass
    assert 100 < end - begin
    assert harmless < 0.3 * (end - begin)  # the local header of the next member, which its directory repeats


def test_packed_arrays_are_smaller_and_the_same(tmp_path):
    """Of every kind and order; the bits of what has nothing in common with its neighbours survive too."""
    random = np.random.default_rng(0)
    noise = random.integers(0, 256, 8 * 9000, dtype=np.uint8).view(np.float64)  # NaN and infinities among them
    ramp = np.arange(9000)
    kinds = {
        "noise": noise,
        "C": noise.reshape(90, 100),
        "F": np.asfortranarray(noise.reshape(90, 100)),
        "cube": np.asfortranarray(noise.reshape(9, 10, 100)),
        "single": ramp.astype(np.float32),
        "small": ramp.astype(np.int16),
        "big endian": ramp.astype(">i4"),
        "flags": ramp % 2 == 0,
        "text": np.array(["µ"] * 9000),
        "none": np.empty((0, 5)),
        "one": np.array(3.0),
    }
    value = replace(sample(), array=ramp, named=kinds)
    for file, name in ((SAMPLES, "plain"), (PACKED, "packed")):
        file.save(tmp_path / name, value)
        assert_same(file.load(tmp_path / name), value)
    with zipfile.ZipFile(tmp_path / "packed") as packed, zipfile.ZipFile(tmp_path / "plain") as plain:
        ratio = {
            name: packed.getinfo(name).compress_size / plain.getinfo(name).compress_size
            for name in plain.namelist()[1:]  # the description comes first
        }
    assert ratio["array.npy"] < 0.1  # high bytes of numbers of nodes
    assert max(ratio.values()) < 1.01


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


def test_sizes_are_checked_before_memory_is_asked_for(tmp_path):
    """A header that claims a petabyte, and members that unpack to more than the file has."""
    path = tmp_path / "sample.npz"
    SAMPLES.save(path, sample())
    with zipfile.ZipFile(path) as whole:
        members = {name: whole.read(name) for name in whole.namelist()}
    old, huge = b"(5, 5), }", b"(10000000, 10000000), }"
    claimed = members["array.npy"].replace(old + b" " * (len(huge) - len(old)), huge)
    assert len(claimed) == len(members["array.npy"])
    assert claimed != members["array.npy"]
    with zipfile.ZipFile(path, "w") as altered_file:
        for name, data in (members | {"array.npy": claimed}).items():
            altered_file.writestr(name, data)
    with pytest.raises(InputError, match=r"array: its header claims 800000000000000 bytes .*, the file has 200"):
        SAMPLES.load(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as altered_file:
        for name, data in members.items():
            altered_file.writestr(name, data)
    with pytest.raises(InputError, match="about: expected a member that is not compressed"):
        SAMPLES.load(path)


def directory(path):
    """Where the directory of a zip file has its first entry."""
    return path.read_bytes().index(b"PK\x01\x02")


def test_what_packed_members_claim_is_checked_before_memory_is_asked_for(tmp_path):
    path = tmp_path / "sample.npz"
    PACKED.save(path, replace(sample(), array=np.arange(9000)))
    with zipfile.ZipFile(path) as whole:
        members = {info.filename: (whole.read(info), info.compress_type) for info in whole.infolist()}

    def write(name, data, kind):
        with zipfile.ZipFile(path, "w") as file:
            for other, (old, old_kind) in members.items():
                file.writestr(other, data if other == name else old, kind if other == name else old_kind)

    write("array.npy", members["array.npy"][0], zipfile.ZIP_STORED)
    with pytest.raises(InputError, match="array: expected a member that is deflated"):
        PACKED.load(path)
    short = io.BytesIO()
    np.save(short, np.zeros((8, 8999), np.uint8))
    write("array.npy", short.getvalue(), zipfile.ZIP_DEFLATED)
    with pytest.raises(InputError, match=r"array: expected planes of <i8 in shape \(9000,\), so \(8, 9000\) bytes"):
        PACKED.load(path)
    write("array.npy", members["array.npy"][0], zipfile.ZIP_DEFLATED)
    whole = bytearray(path.read_bytes())
    entry = whole.index(b"array.npy", directory(path)) - 46
    for field, message in (
        (24, r"array: .* bytes cannot hold the 4294967294 that it claims"),
        (20, "its members claim to be larger than the file"),
    ):
        claimed = whole.copy()
        claimed[entry + field : entry + field + 4] = (2**32 - 2).to_bytes(4, "little")
        path.write_bytes(claimed)
        with pytest.raises(InputError, match=message):
            PACKED.load(path)


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


def save_for_ever(path, number):
    while True:
        SAMPLES.save(path, sample(number, n=300))


def assert_whole(value):
    number = value.array[0, 0]
    assert_same(value, sample(number, n=300))
    return number


def test_two_processes_that_write_one_file_and_are_killed(tmp_path):
    """Whenever it is read, during and after, it is the one's or the other's, whole."""
    path = tmp_path / "shared.npz"
    SAMPLES.save(path, sample(0.0, n=300))
    spawn = multiprocessing.get_context("spawn")
    writers = [spawn.Process(target=save_for_ever, args=(path, number)) for number in (1.0, 2.0)]
    for writer in writers:
        writer.start()
    try:
        seen = set()
        for _ in range(20_000):
            seen.add(assert_whole(SAMPLES.load(path)))
            if {1.0, 2.0} <= seen:
                break
    finally:
        for writer in writers:
            writer.kill()
            writer.join()
    assert {1.0, 2.0} <= seen
    assert_whole(SAMPLES.load(path))


def test_a_save_that_fails_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "sample.npz"
    SAMPLES.save(path, sample(1.0))

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        SAMPLES.save(path, sample(2.0))
    assert_same(SAMPLES.load(path), sample(1.0))
    assert list(tmp_path.iterdir()) == [path]


@pytest.fixture(scope="module")
def store(block, top):
    return {basis: reduction.BASES[basis](block, top, F_CUT) for basis in BASES}


@pytest.fixture
def computed(monkeypatch, store):
    """Names of the bases that were computed; here they come from a store."""
    calls = []

    def counting(basis):
        def make(fem, partition, f_cut, progress):
            calls.append(basis)
            kept = store[basis]
            if kept.flexibility is None:
                return kept
            return replace(kept, flexibility=np.zeros((loads.patch_rows(fem, partition).shape[0],) * 2))

        return make

    monkeypatch.setattr(reduction, "BASES", {basis: counting(basis) for basis in BASES})
    return calls


def test_a_reduction_is_kept(block, top, computed, tmp_path):
    said = []
    first, second = (ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path, progress=said.append) for _ in range(2))
    assert len(computed) == 1
    assert_same(second, first)
    assert said == [1.0, 1.0]
    ep.reduce(block, top, f_cut=F_CUT)
    assert len(computed) == 2


def test_an_equal_model_made_anew_finds_what_was_kept(block, top, computed, tmp_path):
    for _ in range(2):
        copy = replace(block, points=block.points.copy(), mass=block.mass.copy(), cells=block.cells.copy())
        ep.reduce(copy, replace(top, nodes=top.nodes.copy()), f_cut=F_CUT, cache=str(tmp_path))
    assert len(computed) == 1


def nudged(matrix):
    """The same but for the last bit of one number."""
    data = matrix.data.copy()
    data[0] = np.nextafter(data[0], np.inf)
    return sp.csr_matrix((data, matrix.indices, matrix.indptr), matrix.shape)


MODELS = {
    "points": lambda fem: fem.points + np.array([0, 0, 1e-12]),
    "cells": lambda fem: fem.cells[::-1].copy(),
    "mass": lambda fem: nudged(fem.mass),
    "stiffness": lambda fem: nudged(fem.stiffness),
    "cell_mass": lambda fem: fem.cell_mass * (1 + 1e-15),
    "material": lambda fem: replace(fem.material, nu=0.29),
    "boundaries": lambda fem: {**fem.boundaries, "more": np.arange(2)},
}
PARTITIONS = {
    "nodes": lambda part, _: np.union1d(part.nodes, [part.nodes[0] - 1, 0]),
    "patches": lambda part, fem: (part | ep.Partition.ball(fem, (0, 0, 0), 4e-3)).patches,
    "interfaces": lambda part, fem: (
        ep.Partition.interface(fem, "base", np.flatnonzero(fem.points[:, 2] < 1e-9)).interfaces
    ),
}
PATCHES = {
    "facets": lambda patch: patch.facets[1:].copy(),
    "direction": lambda patch: np.array([0, 0.6, 0.8]),
    "rim": lambda patch: patch.rim[1:].copy(),
    "axes": lambda patch: "xyz",
    "direction_given": lambda patch: True,
    "name": lambda patch: "top",
}
INTERFACES = {
    "name": lambda joint: "bottom",
    "nodes": lambda joint: joint.nodes + 1,
    "kind": lambda joint: "averaged",
    "position": lambda joint: joint.position + 1e-6,
    "weights": lambda joint: 1.01 * joint.weights,
    "motion": lambda joint: 1.01 * joint.motion,
}
OPTIONS = {"f_cut": 1.001 * F_CUT, "basis": "residual"}
IMPACTS = {"tolerance": 0.2, "speed": 2.0, "duration": 1e-4}


def test_the_key_changes_with_all_that_the_body_depends_on(block, top, computed, tmp_path, monkeypatch):
    options = {"f_cut": F_CUT, "basis": "contact-adapted"}
    variants = [(block, top, options)]
    variants += [(replace(block, **{name: change(block)}), top, options) for name, change in MODELS.items()]
    variants += [(block, replace(top, **{name: change(top, block)}), options) for name, change in PARTITIONS.items()]
    variants += [(block, top, {**options, name: value}) for name, value in OPTIONS.items()]
    for _ in range(2):
        for fem, partition, others in variants:
            ep.reduce(fem, partition, **others, cache=tmp_path)
    assert len(computed) == len(variants) == len(list(tmp_path.iterdir()))

    for owner, name, value in (
        (cache, "__version__", "99"),
        (cache, "code_digest", lambda: "other"),
        (reduction, "FILE", replace(reduction.FILE, version=99)),
    ):
        monkeypatch.setattr(owner, name, value)
        ep.reduce(block, top, **options, cache=tmp_path)
        variants.append(name)
        assert len(computed) == len(variants), name


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


def test_the_key_changes_with_all_fields_of_patches_and_interfaces(block, top):
    base = ep.Partition.interface(block, "base", np.flatnonzero(block.points[:, 2] < 1e-9))
    for value, changes in ((top.patches[0], PATCHES), (base.interfaces[0], INTERFACES)):
        keys = {archive.digest(replace(value, **{name: change(value)})) for name, change in changes.items()}
        assert len(keys | {archive.digest(value)}) == len(changes) + 1


def test_the_key_changes_with_the_impact_that_a_tolerance_is_for(block, top, tmp_path, monkeypatch):
    keys = []

    def remember(cache, inputs, file, make):
        keys.append(archive.digest(inputs))
        return 2 * (SimpleNamespace(estimate=SimpleNamespace(limit="")),)

    monkeypatch.setattr(reduction, "cached", remember)
    options = {"tolerance": 0.1, "speed": 1.0, "duration": 2e-4}
    for changed in ({}, *({name: value} for name, value in IMPACTS.items())):
        ep.reduce_pair((block, top), (block, top), **{**options, **changed})
    other = replace(top, patches=(replace(top.patches[0], name="top"),))
    ep.reduce_pair((block, other), (block, top), **options)
    ep.reduce_pair((block, top), (block, other), **options)
    assert len(set(keys)) == len(keys) == 6


def test_no_input_is_forgotten_in_the_tests_above():
    assert MODELS.keys() == {f.name for f in dataclasses.fields(ep.FEModel)}
    # A partition with another number of nodes, or another fingerprint, is of another mesh, and refused.
    assert PARTITIONS.keys() == {f.name for f in dataclasses.fields(ep.Partition)} - {"n_nodes", "mesh"}
    assert PATCHES.keys() == {f.name for f in dataclasses.fields(Patch)}
    assert INTERFACES.keys() == {f.name for f in dataclasses.fields(Interface)}
    models = {"fem", "partition", "slave", "master", "patches"}  # patches are in the partitions, by number
    told = OPTIONS.keys() | IMPACTS.keys() | models | {"progress", "cache"}
    for function in (ep.reduce, ep.reduce_pair):
        assert inspect.signature(function).parameters.keys() <= told


@pytest.mark.parametrize("damage", [lambda whole: whole[: len(whole) // 2], lambda whole: b"", lambda whole: b"x" * 99])
def test_a_damaged_file_is_computed_anew(block, top, computed, tmp_path, damage):
    body = ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path)
    (path,) = tmp_path.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    (tmp_path / f".{path.name}.0123.tmp").write_bytes(b"of a process that was killed")
    with pytest.warns(CacheWarning, match=r"npz is .*\. It is computed anew") as warned:
        again = ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path)
    assert warned[0].filename == __file__
    assert_same(replace(again, reduce_s=body.reduce_s), body)
    assert_same(ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path), again)
    assert len(computed) == 2


def test_a_folder_that_cannot_be_written_warns(block, top, computed, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.warns(CacheWarning, match=r"cannot be used: .*by cache= or by EXUDYN_PARTITION_CACHE"):
        ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path / "file" / "folder")

    def denied(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "fsync", denied)  # whoever runs the tests may be root, who may write anywhere
    with pytest.warns(CacheWarning, match=r"is not kept: .*Permission denied"):
        ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path)
    assert len(computed) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_cache_is_a_bool_or_a_folder(block, top):
    with pytest.raises(InputError, match="cache: expected True, False or a folder, got 3"):
        ep.reduce(block, top, f_cut=F_CUT, cache=3)


def test_the_user_s_folder(block, top, computed, tmp_path, monkeypatch):
    monkeypatch.setenv("EXUDYN_PARTITION_CACHE", str(tmp_path / "own"))
    ep.reduce(block, top, f_cut=F_CUT, cache=True)
    assert len(list((tmp_path / "own").iterdir())) == 1

    monkeypatch.delenv("EXUDYN_PARTITION_CACHE")
    monkeypatch.setattr(Path, "home", lambda: Path("/home/me"))
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", "/big")
    assert cache.user_folder() == Path("/big/exudyn_partition")
    for ignored in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", ignored)
        assert cache.user_folder() == Path("/home/me/.cache/exudyn_partition")
    monkeypatch.setattr("sys.platform", "darwin")
    assert cache.user_folder() == Path("/home/me/Library/Caches/exudyn_partition")
    monkeypatch.setattr("sys.platform", "win32")
    monkeypatch.delenv("LOCALAPPDATA", raising=False)
    assert cache.user_folder() == Path("/home/me/AppData/Local/exudyn_partition")
