"""Files that are written whole or not at all, and never over what is no file."""

import contextlib
import functools
import os
import resource
import stat
import subprocess
import sys

import pytest
from oracles import LONGEST

import exudyn_partition as ep
from exudyn_partition.errors import InputError, OutputError
from exudyn_partition.support import files
from exudyn_partition.support.files import replacing


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@contextlib.contextmanager
def full_disk():
    """No file can grow beyond 100 bytes, as on a disk that is full; what pytest itself writes would fail too."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_bytes_and_text_arrive(tmp_path):
    with replacing(tmp_path / "bytes") as file:
        file.write(b"\x00\xff")
    with replacing(str(tmp_path / "text"), "w") as file:
        file.write("µ\n")
    assert (tmp_path / "bytes").read_bytes() == b"\x00\xff"
    assert (tmp_path / "text").read_text(encoding="utf-8") == "µ\n"
    assert names(tmp_path) == ["bytes", "text"]


def test_the_old_file_stands_until_the_new_one_is_whole(tmp_path):
    path = tmp_path / "file"
    path.write_text("old")
    with replacing(path, "w") as file:
        file.write("new")
        file.flush()
        assert path.read_text() == "old"
    assert path.read_text() == "new"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_block_that_raises_changes_nothing(tmp_path, error):
    (tmp_path / "file").write_text("old")

    def write_half(path):
        with replacing(path, "w") as file:
            file.write("half")
            raise error

    for name in ("file", "none"):
        with pytest.raises(error):
            write_half(tmp_path / name)
    assert names(tmp_path) == ["file"]
    assert (tmp_path / "file").read_text() == "old"


def test_a_full_disk_is_named_and_the_old_file_is_kept(tmp_path):
    (tmp_path / "file").write_text("old")
    for name, kept in (("file", "The file that was there is unchanged"), ("none", "No file was left there")):
        message = rf"path: .*{name} cannot be written: File too large\. {kept}"
        with full_disk(), pytest.raises(OutputError, match=message), replacing(tmp_path / name) as file:
            file.write(bytes(1000))
    assert names(tmp_path) == ["file"]
    assert (tmp_path / "file").read_text() == "old"


def test_links_and_modes_survive(tmp_path):
    (tmp_path / "folder").mkdir()
    target = tmp_path / "folder" / "file"
    target.write_text("old")
    target.chmod(0o640)
    (tmp_path / "link").symlink_to("folder/file")
    (tmp_path / "dangling").symlink_to("folder/other")
    for name in ("link", "dangling"):
        with replacing(tmp_path / name, "w") as file:
            file.write("new")
        assert (tmp_path / name).is_symlink()
    assert target.read_text() == (tmp_path / "folder" / "other").read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert names(tmp_path / "folder") == ["file", "other"]


def test_a_new_file_has_the_mode_that_any_file_would_have(tmp_path):
    (tmp_path / "plain").touch()
    with replacing(tmp_path / "file"):
        pass
    assert (tmp_path / "file").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_the_longest_name_that_the_system_takes(tmp_path):
    name = "x" * 251 + ".npz"
    with replacing(tmp_path / name):
        pass
    assert names(tmp_path) == [name]


def test_what_is_no_file_is_refused_and_stays(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "protected").touch(0o444)
    (tmp_path / "circle").symlink_to("circle")
    before = names(tmp_path)
    for path, message in (
        (tmp_path / "pipe", "a device or a pipe"),
        ("/dev/null", "a device or a pipe"),
        (tmp_path / "folder", "got the folder"),
        (tmp_path / "protected", "protected against writing"),
        (tmp_path / "circle", "no file can have the name"),
        (tmp_path / "nowhere" / "file", "no folder .*nowhere to write file into; make it first"),
        (tmp_path / ("x" * 400), "no file can have the name .*too long"),
        ("a\0b", "no file can have the name .*null"),
        ("", "expected the path of a file, got ''"),
        (None, "expected the path of a file, got None"),
        (3, "expected the path of a file, got 3"),
    ):
        with pytest.raises(InputError, match=message), replacing(path):
            raise AssertionError("the file was opened")
    assert names(tmp_path) == before
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)  # noqa: PTH116, for it is a device


def test_pages_fields_and_histories_leave_what_was_there(impact, tmp_path):
    """A page came back as written, a stub stood where a good one had been, saving and ParaView ended raw."""
    mbs, striker, _, contact = impact
    result = ep.solve_dynamic(mbs, end_time=2e-6)
    history = result.history(contact)
    (tmp_path / "fields").mkdir()
    good = [tmp_path / name for name in ("run.html", "history", "body", "fields/run.pvd", "fields/body0_0000.vtu")]
    result.report(good[0])  # numba keeps what it compiles for it, as long as the disk is not full
    for path in good:
        path.write_text("good")
    for call, kept in (
        (lambda: result.report(good[0]), "The file that was there is unchanged"),
        (lambda: history.save(good[1]), "The file that was there is unchanged"),
        (lambda: striker.body.save(good[2]), "The file that was there is unchanged"),
        (lambda: ep.output.write_paraview(tmp_path / "fields", result, times=2), "Files that were there are unchanged"),
        (lambda: ep.output.write_paraview(tmp_path / "new", result, times=2), "nothing can be written into"),
    ):
        with full_disk(), pytest.raises(OutputError, match=kept):
            call()
    assert [path.read_text() for path in good] == ["good"] * 5
    assert {*tmp_path.rglob("*")} == {*good, tmp_path / "fields", tmp_path / "new"}


WRITER = """
import os, sys
from exudyn_partition.support.files import filling, replacing
folder = sys.argv[1]
with replacing(folder + "/file") as file, filling(folder, "last") as new:
    file.write(b"half")
    (new / "last").touch()
    print("in it", flush=True)
    sys.stdin.read()
"""


def test_what_killed_processes_left_is_deleted_and_what_others_write_is_not(tmp_path):
    """Temporary files of killed processes stood in the folder for ever."""
    (tmp_path / ".file.0123.tmp").touch()  # of somebody else
    run = functools.partial(subprocess.Popen, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    writers = [run([sys.executable, "-c", WRITER, str(tmp_path)]) for _ in range(2)]
    try:
        assert [writer.stdout.readline() for writer in writers] == ["in it\n"] * 2
        assert len(names(tmp_path)) == 5
        writers[0].kill()
        writers[0].wait()
        with replacing(tmp_path / "other"):
            pass
        assert len(names(tmp_path)) == 4
        writers[1].communicate("", timeout=LONGEST)
    finally:
        for writer in writers:
            writer.kill()
    assert names(tmp_path) == [".file.0123.tmp", "file", "last", "other"]
    assert (tmp_path / "file").read_bytes() == b"half"


def test_a_temporary_file_that_was_deleted_before_it_was_locked_is_made_again(tmp_path, monkeypatch):
    lock, deleted = files.lock, []

    def late(descriptor, kind):
        if not deleted:
            deleted.extend(tmp_path.glob(".file.*.tmp"))
            deleted[0].unlink()
        return lock(descriptor, kind)

    monkeypatch.setattr(files, "lock", late)
    with replacing(tmp_path / "file", "w") as file:
        file.write("whole")
    assert (tmp_path / "file").read_text() == "whole"
    assert len(deleted) == len(names(tmp_path)) == 1
