"""Files of values: what is read is what was written, or is refused by name."""

import io
import multiprocessing
import os
import tracemalloc
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from samples import PACKED, SAMPLES, Sample, assert_same, rewrite, sample, save_for_ever

from exudyn_partition.errors import InputError
from exudyn_partition.support import archive


def test_every_kind_of_field_survives(tmp_path):
    value = replace(sample(), matrix=sp.csr_array(np.eye(3)), array=np.asfortranarray([[1, 2], [3, 4]]))
    SAMPLES.save(tmp_path / "any name", value)
    assert_same(SAMPLES.load(tmp_path / "any name"), value)
    for odd in (object(), np.array([None])):
        with pytest.raises(TypeError, match=r"array: a .* cannot be stored"):
            SAMPLES.save(tmp_path / "odd", replace(value, array=odd))
    assert [path.name for path in tmp_path.iterdir()] == ["any name"]


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


def test_a_file_that_would_unpack_to_much_is_refused_before(tmp_path, monkeypatch):
    """750 MB of zeros in a file of 0.7 MB were unpacked, and refused then."""
    monkeypatch.setattr(archive, "ALWAYS", 1 << 20)
    path = tmp_path / "sample.npz"
    PACKED.save(path, replace(sample(), array=np.zeros(1 << 18)))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"is damaged .*: its \d+ bytes would unpack to 2100"):
            PACKED.load(path)
        assert tracemalloc.get_traced_memory()[1] < 5e5
    finally:
        tracemalloc.stop()


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


def test_any_damage_of_packed_arrays_is_refused_or_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "PACK_FROM", 1)
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
    for field, size, message in (
        (24, 2**26, r"array: .* bytes cannot hold the 67108864 that it claims"),
        (24, 2**32 - 2, r"its \d+ bytes would unpack to 4294"),
        (20, 2**32 - 2, "its members claim to be larger than the file"),
    ):
        claimed = whole.copy()
        claimed[entry + field : entry + field + 4] = size.to_bytes(4, "little")
        path.write_bytes(claimed)
        with pytest.raises(InputError, match=message):
            PACKED.load(path)
