"""The cache of reductions: keys of all that a body depends on, damaged files, folders."""

import dataclasses
import inspect
import os
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from samples import assert_same

import exudyn_partition as ep
from exudyn_partition.errors import CacheWarning, InputError
from exudyn_partition.fe.material import Regions
from exudyn_partition.fe.patches import Interface, Patch, PlasticRegion
from exudyn_partition.reduction import loads, reduction
from exudyn_partition.support import archive, cache

BASES = ["free", "residual", "contact-adapted"]


F_CUT = 150e3


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


TURNED = [1, 2, 0, 3, 5, 6, 4, 8, 9, 7]  # the same element with its corners in another order


MODELS = {
    "points": lambda fem: fem.points + np.array([0, 0, 1e-12]),
    "cells": lambda fem: np.vstack([fem.cells[:1, TURNED], fem.cells[1:]]),
    "mass": lambda fem: nudged(fem.mass),
    "stiffness": lambda fem: nudged(fem.stiffness),
    "cell_mass": lambda fem: fem.cell_mass * (1 + 1e-15),
    "material": lambda fem: replace(fem.material, yield_stress=300e6),
    "boundaries": lambda fem: {**fem.boundaries, "more": np.arange(2)},
    "regions": lambda fem: Regions(
        ("",), (fem.material,), np.zeros(len(fem.cells), dtype=int), np.full(len(fem.cells), fem.material.E)
    ),
}


PARTITIONS = {
    "nodes": lambda part, _: np.union1d(part.nodes, [part.nodes[0] - 1, 0]),
    "patches": lambda part, fem: (part | ep.Partition.ball(fem, (0, 0, 0), 4e-3)).patches,
    "interfaces": lambda part, fem: (
        ep.Partition.interface(fem, "base", np.flatnonzero(fem.points[:, 2] < 1e-9)).interfaces
    ),
    "loads": lambda part, fem: ep.Partition.load(fem, "push", [0, 1]).loads,
}


PATCHES = {
    "facets": lambda patch: patch.facets[1:].copy(),
    "direction": lambda patch: np.array([0, 0.6, 0.8]),
    "rim": lambda patch: patch.rim[1:].copy(),
    "axes": lambda patch: "xyz",
    "direction_given": lambda patch: True,
    "name": lambda patch: "top",
    "plastic": lambda patch: PlasticRegion(np.arange(10)[None], np.arange(3)),
    "material": lambda patch: ep.ALUMINIUM,
    "normals": lambda patch: np.tile(patch.direction, (len(patch.nodes), 1)),
    "extent": lambda patch: np.ones(3),
    "ends": lambda patch: patch.nodes[:1].copy(),
}


INTERFACES = {
    "name": lambda joint: "bottom",
    "nodes": lambda joint: joint.nodes + 1,
    "kind": lambda joint: "averaged",
    "position": lambda joint: joint.position + 1e-6,
    "weights": lambda joint: 1.01 * joint.weights,
    "motion": lambda joint: 1.01 * joint.motion,
}


OPTIONS = {"f_cut": 1.001 * F_CUT, "basis": "residual", "geometric_stiffness": True}


IMPACTS = {"tolerance": 0.2, "speed": 2.0, "duration": 1e-4}
SLIDING = {"friction": 0.2, "tangential_speed": 0.6}


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
    for changed in ({}, {"geometric_stiffness": True}, *({name: value} for name, value in IMPACTS.items())):
        ep.reduce_pair((block, top), (block, top), **{**options, **changed})
    other = replace(top, patches=(replace(top.patches[0], name="top"),))
    ep.reduce_pair((block, other), (block, top), **options)
    ep.reduce_pair((block, top), (block, other), **options)
    rough = replace(top, patches=(replace(top.patches[0], axes="xyz"),))
    oblique = {**options, "friction": 0.3, "tangential_speed": 0.5}
    for changed in ({}, *({name: value} for name, value in SLIDING.items()), {"friction": ep.Coulomb(0.3, 0.2)}):
        ep.reduce_pair((block, rough), (block, rough), **{**oblique, **changed})
    assert len(set(keys)) == len(keys) == 11


def test_no_input_is_forgotten_in_the_tests_above():
    # A model of the same cells has no other `hexahedra`, and none with cells has a `surface`.
    assert MODELS.keys() == {f.name for f in dataclasses.fields(ep.FEModel)} - {"hexahedra", "surface"}
    # A partition with another number of nodes, or another fingerprint, is of another mesh, and refused.
    assert PARTITIONS.keys() == {f.name for f in dataclasses.fields(ep.Partition)} - {"n_nodes", "mesh"}
    assert PATCHES.keys() == {f.name for f in dataclasses.fields(Patch)}
    assert INTERFACES.keys() == {f.name for f in dataclasses.fields(Interface)}
    models = {"fem", "partition", "skin", "slave", "master", "patches"}  # patches are in the partitions, by number
    told = OPTIONS.keys() | IMPACTS.keys() | SLIDING.keys() | models | {"progress", "cache"}
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


def test_a_file_of_other_inputs_under_the_name_is_computed_anew(block, top, computed, tmp_path):
    """Another body was returned without a word, whose file had been copied to the name."""
    first = ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path)
    (path,) = tmp_path.iterdir()
    ep.reduce(block, top, f_cut=0.9 * F_CUT, cache=tmp_path / "others")
    (other,) = (tmp_path / "others").iterdir()
    saved = tmp_path / "saved"
    replace(first, f_cut=0.9 * F_CUT).save(saved)
    for count, wrong in enumerate((other, saved), 3):
        path.write_bytes(wrong.read_bytes())
        with pytest.warns(CacheWarning, match=r"holds another reduced body than its name says.*computed anew"):
            again = ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path)
        assert_same(replace(again, reduce_s=first.reduce_s), first)
        assert len(computed) == count
    assert_same(ep.reduce(block, top, f_cut=F_CUT, cache=tmp_path), again)


def test_the_key_does_not_depend_on_orders_in_memory():
    """Neither on that of a dict's keys nor on that of an array's numbers."""
    numbers = np.arange(6.0).reshape(2, 3)
    one, other = {"a": numbers, "b": {"c": 1}}, {"b": {"c": 1}, "a": np.asfortranarray(numbers)}
    assert archive.digest(one) == archive.digest(other)
    assert archive.digest(one) != archive.digest({"a": numbers.T, "b": {"c": 1}})
    dotted = {"a.b": numbers, "a": {"b": numbers + 1}}  # both have the dotted name a.b
    assert archive.digest(dotted) != archive.digest(dotted | {"a.b": numbers + 2})


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
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    folder = cache.user_folder()
    assert folder.is_absolute()
    assert "exudyn_partition" in folder.parts
    if sys.platform == "linux":
        assert folder == tmp_path / "home" / ".cache" / "exudyn_partition"
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "big"))
        assert cache.user_folder() == tmp_path / "big" / "exudyn_partition"
