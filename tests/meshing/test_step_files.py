"""STEP files: endings, files that crash their reader, several roots and solids, and what belongs to no solid."""

import logging
import re

import netgen.occ as occ
import ngsolve
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError
from exudyn_partition.meshing import netgen_mesh, ngsolve_fem, step_files

BLOCK = box(0.01, 0.02, 0.03)


@pytest.mark.parametrize("name", ["block.STP", "block.Step", "block.stp"])
def test_endings_of_step_files_in_any_case(tmp_path, name):
    BLOCK.WriteStep(str(tmp_path / "block.step"))
    (tmp_path / "block.step").rename(tmp_path / name)
    assert ep.fe_model(tmp_path / name, ep.STEEL, maxh=0.02).total_mass == pytest.approx(7800 * 6e-6, rel=1e-9)


def test_a_step_file_that_crashes_its_reader(tmp_path, monkeypatch):
    path = tmp_path / "block.step"
    BLOCK.WriteStep(str(path))
    monkeypatch.setattr(step_files, "TRIAL", "import os; os.abort()")
    with pytest.raises(InputError, match=r"could not be read by Netgen \(it crashes, exit code -6\)"):
        ep.fe_model(path, ep.STEEL, maxh=0.02)
    monkeypatch.undo()
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if "CARTESIAN_POINT" not in line))
    with pytest.raises(InputError, match=r"could not be read|expected a solid, got none"):
        ep.fe_model(path, ep.STEEL, maxh=0.02)


def join_roots(path, *shapes):
    """Write a STEP file in which each shape is a root product of its own, as CAD writes parts side by side."""
    head, data, last = "", "", 0
    for shape in shapes:
        shape.WriteStep(str(path))
        head, _, rest = path.read_text().partition("DATA;")
        shifted = re.sub(r"#(\d+)", lambda found, by=last: f"#{int(found[1]) + by}", rest.partition("ENDSEC;")[0])
        data, last = data + shifted, max(map(int, re.findall(r"#(\d+)\s*=", shifted)))
    path.write_text(f"{head}DATA;{data}ENDSEC;\nEND-ISO-10303-21;\n")
    return path


def test_all_roots_of_a_file_are_read(tmp_path):
    boxes = [occ.Box((30 * i, 0, 0), (30 * i + 10, 10, 10 * (i + 1))) for i in range(3)]
    path = join_roots(tmp_path / "roots.step", boxes[0], occ.Compound(boxes[1:]))
    shape = netgen_mesh.step_shape(path)
    assert sorted(solid.mass for solid in shape.solids) == pytest.approx([1000, 2000, 3000])
    assert sorted(solid.center.x for solid in shape.solids) == pytest.approx([5, 35, 65])
    with pytest.raises(MeshError, match=r"got 3 parts that share no face, of 3 solids: solid 0 around \(0\.005"):
        ep.fe_model(path, ep.STEEL, scale=1e-3, maxh=5e-3)


def test_a_root_without_a_solid_before_the_one_with_it(tmp_path):
    sheet = occ.Rectangle(5, 5).Face().Move(occ.Vec(0, 0, 30))
    path = join_roots(tmp_path / "roots.step", sheet, occ.Box((0, 0, 0), (10, 10, 10)))
    fem = ep.fe_model(path, ep.STEEL, scale=1e-3, maxh=5e-3)
    assert fem.total_mass == pytest.approx(7.8e-3, rel=1e-9)


def test_solids_that_netgen_does_not_read(tmp_path):
    path = tmp_path / "block.step"
    occ.Box((0, 0, 0), (10, 10, 10)).WriteStep(str(path))
    text = path.read_text().replace("'Unknown'", "'a text; #9 = MANIFOLD_SOLID_BREP(it''s none);'")
    path.write_text(text)
    assert step_files.solids_said(path) == 1
    shell = re.search(r"MANIFOLD_SOLID_BREP\('',(#\d+)\)", text)[1]
    path.write_text(text.replace("ENDSEC;\nEND-", f"#9999 = MANIFOLD_SOLID_BREP('lost',{shell});\nENDSEC;\nEND-"))
    with pytest.raises(MeshError, match=r"defines 2 solids, of which Netgen reads 1\. Are the others damaged"):
        ep.fe_model(path, ep.STEEL, scale=1e-3, maxh=5e-3)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_what_belongs_to_no_solid_is_left_out(tmp_path, caplog, order):
    block, sketch = occ.Box((0, 0, 0), (10, 10, 10)), occ.Segment((0, 0, 20), (10, 0, 20))
    sheet = occ.Rectangle(5, 5).Face().Move(occ.Vec(0, 0, 30))
    block.WriteStep(str(tmp_path / "alone.step"))
    occ.Compound([sketch, block, sheet]).WriteStep(str(tmp_path / "beside.step"))
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        alone, beside = (
            ep.fe_model(tmp_path / f"{name}.step", ep.STEEL, scale=1e-3, maxh=5e-3, order=order)
            for name in ("alone", "beside")
        )
    np.testing.assert_array_equal(beside.points, alone.points)
    assert beside.total_mass == pytest.approx(7.8e-3, rel=1e-9)
    left_out = [line for line in caplog.messages if "left out" in line]
    assert left_out == ["shape: left out 1 faces, 5 edges, 6 vertices that belong to no solid"]


@pytest.mark.parametrize("beside", [occ.Segment((0, 0, 0.02), (0.01, 0, 0.02)), occ.Rectangle(0.01, 0.01).Face()])
@pytest.mark.parametrize("order", [1, 2])
def test_a_mesh_with_vertices_of_no_solid(beside, order):
    shape = occ.Compound([occ.Box((0, 0, 0), (0.01, 0.01, 0.01)), beside.Move(occ.Vec(0, 0, 0.02))])
    mesh = ngsolve.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=5e-3))
    with pytest.raises(MeshError, match="vertices belong to no tetrahedron, as those of free edges and faces"):
        ep.fe_model(mesh, ep.STEEL, order=order)


def test_parts_and_materials_are_known_before_meshing(monkeypatch):
    def meshed(*_):
        raise AssertionError("meshed")

    monkeypatch.setattr(ngsolve_fem, "meshed", meshed)
    boxes = [occ.Box((i, 0, 0), (i + 1, 1, 1)).mat(name) for i, name in enumerate(("rod", "pin", "rod"))]
    for apart in (occ.Compound(boxes), occ.Glue([boxes[0], boxes[2]])):  # those of the first touch, but share no face
        with pytest.raises(MeshError, match=r"expected one connected body, got [23] parts that share no face.*'rod'"):
            ep.fe_model(apart, ep.STEEL, maxh=1.0)
    with pytest.raises(MeshError, match=r"3 regions by solids: 0: 'rod', 1: 'pin', 2: 'rod'\."):
        ep.fe_model(occ.Glue(boxes), ep.STEEL, maxh=1.0)
    with pytest.raises(InputError, match="each region of shape, 'rod', 'pin', got 'rod', 'bolt'"):
        ep.fe_model(occ.Glue(boxes), {"rod": ep.STEEL, "bolt": ep.STEEL}, maxh=1.0)


def named_solids(path):
    """A machine of three named solids, two of them alike, beside a sketch; in millimetres."""
    base = occ.Box((0, 0, 0), (40, 20, 5))
    rod = occ.Cylinder(occ.Pnt(10, 10, 5), occ.Z, r=4, h=20)
    base.name, rod.name = "base", "rod"
    next(face for face in rod.faces if face.center.z > 24).name = "tip"
    other = rod.Move(occ.Vec(20, 0, 0))
    other.name = "rod"
    occ.Compound([base, rod, other]).WriteStep(str(path))
    return path


def test_solids_of_an_assembly_by_name_and_place(tmp_path):
    assembly = ep.read_step(named_solids(tmp_path / "machine.step"), scale=1e-3)
    assert assembly.names == ("base", "rod", "rod.2")
    assert "base: 4e-06 m3 around (0.02, 0.01, 0.0025) m" in str(assembly)
    models = ep.fe_models(assembly, {"base": ep.ALUMINIUM, "rod.2": ep.STEEL}, maxh={"base": 0.01, "rod.2": 6e-3})
    assert list(models) == ["base", "rod.2"]
    np.testing.assert_allclose(models["base"].centre_of_mass, [0.02, 0.01, 0.0025], atol=1e-9)
    np.testing.assert_allclose(models["rod.2"].centre_of_mass, [0.03, 0.01, 0.015], atol=1e-6)
    assert models["base"].material == ep.ALUMINIUM
    tip = ep.Partition.surface(models["rod.2"], "tip")
    assert tip.patches[0].direction == pytest.approx([0, 0, 1])
    alone = ep.fe_model(tmp_path / "machine.step", ep.STEEL, solid="rod.2", scale=1e-3, maxh=6e-3)
    assert alone.total_mass == pytest.approx(models["rod.2"].total_mass, rel=1e-9)
    same = ep.fe_model(assembly, ep.STEEL, solid="rod", maxh=6e-3)
    np.testing.assert_allclose(same.centre_of_mass, [0.01, 0.01, 0.015], atol=1e-6)


def test_balls_refine_the_solids_that_they_meet(tmp_path):
    assembly = ep.read_step(named_solids(tmp_path / "machine.step"), scale=1e-3)
    wanted = {"base": ep.STEEL, "rod": ep.STEEL, "rod.2": ep.STEEL}
    plain = ep.fe_models(assembly, wanted, maxh=8e-3)
    fine = ep.fe_models(assembly, wanted, maxh=8e-3, refine=[ep.Refine((0.01, 0.01, 0.005), 2e-3, 1e-3)])
    more = {name: fine[name].n_nodes > 1.2 * plain[name].n_nodes for name in wanted}
    assert more == {"base": True, "rod": True, "rod.2": False}
    with pytest.raises(InputError, match=r"refine: the ball around .* meets none of 'base', 'rod', 'rod.2'"):
        ep.fe_models(assembly, wanted, maxh=8e-3, refine=[ep.Refine((0.5, 0, 0), 2e-3, 1e-3)])


def test_roots_without_names_and_what_is_wrong(tmp_path):
    boxes = [occ.Box((30 * i, 0, 0), (30 * i + 10, 10, 10)) for i in range(3)]
    sheet = occ.Rectangle(5, 5).Face().Move(occ.Vec(0, 0, 30))
    path = join_roots(tmp_path / "roots.step", boxes[0], sheet, occ.Compound(boxes[1:]))
    assembly = ep.read_step(path)
    assert len(assembly.names) == 3
    assert sorted(shape.center.x for shape in assembly.solids.values()) == pytest.approx([5, 35, 65])
    with pytest.raises(InputError, match=r"solid: expected one of .* in .*roots.step, or ep.fe_models for several"):
        ep.fe_model(assembly, ep.STEEL, maxh=5)
    with pytest.raises(InputError, match=r"solid: expected one of 'solid', .* got 'rod'"):
        ep.fe_models(assembly, {"rod": ep.STEEL}, maxh=5)
    with pytest.raises(InputError, match="maxh: expected one for each of 'solid', got"):
        ep.fe_models(assembly, {"solid": ep.STEEL}, maxh={"rod": 5})
    with pytest.raises(InputError, match="path: expected a file of STEP, IGES or BREP"):
        ep.read_step(tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match="solid: has no effect here"):
        ep.fe_model(boxes[0], ep.STEEL, solid="rod", maxh=5)
    with pytest.raises(MeshError, match="expected a solid, got none"):
        ep.read_step(join_roots(tmp_path / "sheet.step", sheet))


FACES = [(0, 2, 1, 3), (4, 5, 6, 7), (0, 1, 4, 5), (2, 6, 3, 7), (0, 4, 2, 6), (1, 3, 5, 7)]  # of a box, by corners


def write_iges(path, size, faces=FACES):
    """A box of bilinear surfaces (entity 128) that share no edges, as IGES has them; in millimetres."""
    corners = [[(k & 1) * size[0], (k >> 1 & 1) * size[1], (k >> 2) * size[2]] for k in range(8)]
    head = "1H,,1H;,3Hbox,7Hbox.igs,4Htest,4Htest,32,38,6,308,15,3Hbox,1.0,2,2HMM,1,0.1,15H20260101.000000,1E-6,1000.,"
    lines = {"S": ["a box"], "G": [head[:72], head[72:] + "4Htest,4Htest,11,0;"], "D": [], "P": []}
    for face in faces:
        values = [128, 1, 1, 1, 1, 0, 0, 1, 0, 0, *2 * [0.0, 0.0, 1.0, 1.0], *4 * [1.0]]
        values += [float(x) for k in face for x in corners[k]] + [0.0, 1.0, 0.0, 1.0]
        own = [",".join(map(str, values[i : i + 8])) + "," for i in range(0, len(values), 8)]
        own[-1] = own[-1][:-1] + ";"
        number, first = len(lines["D"]) + 1, len(lines["P"]) + 1
        lines["P"] += [f"{line:64}{number:8}" for line in own]
        lines["D"] += [f"{128:8}{first:8}" + 7 * f"{0:8}", f"{128:8}{0:8}{0:8}{len(own):8}{0:8}{'':24}{0:8}"]
    text = [f"{line:72}{key}{i:7}" for key, own in lines.items() for i, line in enumerate(own, 1)]
    counts = "".join(f"{key}{len(own):7}" for key, own in lines.items())
    path.write_text("\n".join([*text, f"{counts:72}T{1:7}", ""]))
    return path


@pytest.mark.parametrize("ending", [".iges", ".igs", ".IGS", ".brep", ".BREP"])
def test_shapes_in_other_files(tmp_path, ending):
    path = tmp_path / f"box{ending}"
    if "g" in ending.lower():
        write_iges(path, (10, 20, 30))
    else:
        occ.Box((0, 0, 0), (10, 20, 30)).WriteBrep(str(path.with_suffix(".brep")))
        path.with_suffix(".brep").rename(path)
    fem = ep.fe_model(path, ep.STEEL, maxh=0.01, scale=1e-3)
    assert fem.total_mass == pytest.approx(7800 * 6e-6, rel=1e-9)
    np.testing.assert_allclose(fem.centre_of_mass, [0.005, 0.01, 0.015], atol=1e-9)
    assert ep.read_step(path, scale=1e-3).names == ("solid",)


def test_faces_of_iges_that_enclose_no_volume(tmp_path):
    """Or that bound two boxes; an opening by opposite faces has a volume in formulas that sum over faces."""
    for missing in (1, 2):
        path = write_iges(tmp_path / "open.iges", (10, 20, 30), FACES[missing:])
        with pytest.raises(MeshError, match="expected a solid, got none: its faces enclose no volume, or some are mis"):
            ep.fe_model(path, ep.STEEL, maxh=0.01, scale=1e-3)
    path.write_text("what is this?")
    with pytest.raises(InputError, match=r"could not be read by Netgen .* a complete IGES file\?"):
        ep.fe_model(path, ep.STEEL, maxh=0.01)
