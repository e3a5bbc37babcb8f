"""Matrices in files of other programs make the same body as our own assembly; each file that does not fit is refused.

The files are written here from the descriptions of their formats, independently of the readers. Where CalculiX' `ccx`,
pyyeti or ansys-mapdl-reader are installed, files of theirs are read too.
"""

import shutil
import subprocess
from pathlib import Path

import netgen.occ as occ
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse as sp
from oracles import hexahedra, quadratic, split, write_deck

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError, UnitsWarning
from exudyn_partition.meshing.matrix_files import of_ansys

SIZE = (0.01, 0.02, 0.03)
TOP = ((0, 0, SIZE[2]), (0, 0, 1))


@pytest.fixture(scope="module")
def own():
    return ep.fe_model(occ.Box((0, 0, 0), SIZE), ep.STEEL, maxh=1e-2)


@pytest.fixture(scope="module")
def labels(own):
    """Numbers of the nodes, with gaps and in no order."""
    return np.random.default_rng(0).permutation(own.n_nodes) * 3 + 5


def abaqus_deck(path, fem, labels, scale=1.0):
    nodes = (f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in zip(labels, (fem.points * scale).tolist(), strict=True))
    elements = (f"{i + 1}, {', '.join(map(str, cell))}" for i, cell in enumerate(labels[fem.cells]))
    constants = f"*MATERIAL, NAME=S\n*ELASTIC\n{ep.STEEL.E}, {ep.STEEL.nu}\n*DENSITY\n{ep.STEEL.rho}\n"
    path.write_text(
        "\n".join(["*NODE", *nodes, "*ELEMENT, TYPE=C3D10, ELSET=E", *elements])
        + f"\n{constants}*SOLID SECTION, ELSET=E, MATERIAL=S\n*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n10\n*END STEP\n"
    )
    return path


def nastran_deck(path, fem, labels):
    nodes = (f"GRID,{n},,{x!r},{y!r},{z!r}" for n, (x, y, z) in zip(labels, fem.points.tolist(), strict=True))
    rows = labels[fem.cells].tolist()
    elements = (
        f"CTETRA,{i + 1},1,{','.join(map(str, cell[:6]))}\n,{','.join(map(str, cell[6:]))}"
        for i, cell in enumerate(rows)
    )
    path.write_text("\n".join(["BEGIN BULK", *nodes, *elements, "PSOLID,1,1", "MAT1,1,210.+9,,.3,7800.", "ENDDATA"]))
    return path


def entries(matrix, upper=True):
    found = sp.coo_matrix(sp.triu(matrix) if upper else matrix)
    order = np.lexsort((found.row, found.col))
    return zip(found.row[order].tolist(), found.col[order].tolist(), found.data[order].tolist(), strict=True)


def calculix(folder, fem, labels):
    """Upper triangle, column by column; the node and the direction of each row; nodes in the order of their numbers."""
    order = np.argsort(labels)
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    for name, matrix in (("job.sti", fem.stiffness), ("job.mas", fem.mass)):
        lines = (f"{i + 1} {j + 1} {v:20.13e}" for i, j, v in entries(matrix[dofs][:, dofs]))
        (folder / name).write_text("\n".join(lines) + "\n")
    (folder / "job.dof").write_text("\n".join(f"{n}.{d}" for n in labels[order] for d in (1, 2, 3)) + "\n")
    return [folder / "job.sti"]


def abaqus(folder, fem, labels, upper=True, head="** MATRIX INPUT\n*MATRIX ASSEMBLE, STIFFNESS=A\n"):
    for name, matrix in (("job_STIF2.mtx", fem.stiffness), ("job_MASS2.mtx", fem.mass)):
        lines = (
            f"{labels[i // 3]},{i % 3 + 1}, {labels[j // 3]},{j % 3 + 1}, {v:.15e}"
            for i, j, v in entries(matrix, upper)
        )
        (folder / name).write_text(head + "\n".join(lines) + "\n")
    return [folder / "job_STIF2.mtx"]


def in_ascending_order(matrix, labels, each=3):
    """Rows by ascending numbers of nodes; with rotations, each=6, whose rows are empty."""
    spread = sp.kron(sp.identity(len(labels)), sp.eye(each, 3), format="csr")
    order = np.argsort(labels)
    rows = (each * order[:, None] + np.arange(each)).ravel()
    return (spread @ matrix @ spread.T).tocsr()[rows][:, rows]


def abaqus_coordinates(folder, fem, labels):
    for name, matrix in (("job_stif2.mtx", fem.stiffness), ("job_mass2.mtx", fem.mass)):
        lines = (f"{i + 1} {j + 1} {v:.15e}" for i, j, v in entries(in_ascending_order(matrix, labels)))
        (folder / name).write_text("\n".join(lines) + "\n")
    return [folder / "job_stif2.mtx"]


def market(folder, fem, labels):
    names = [folder / "K.mtx", folder / "M.mtx"]
    for name, matrix in zip(names, (fem.stiffness, fem.mass), strict=True):
        scipy.io.mmwrite(name, in_ascending_order(matrix, labels), precision=17)
    return names


def punched(folder, fem, labels, form=6):
    """DMIG with large fields, as PARAM,EXTOUT,DMIGPCH punches it."""
    text = ["$TITLE = RUN", "$LABEL ="]
    for name, matrix in (("KAAX", fem.stiffness), ("MAAX", fem.mass)):
        text.append(f"{'DMIG':8}{name:8}{0:8}{form:8}{2:8}{0:8}")
        columns = sp.csc_matrix(sp.triu(matrix) if form == 6 else matrix)
        for j in range(fem.n_dofs):
            text.append(f"{'DMIG*':8}{name:16}{labels[j // 3]:16}{j % 3 + 1:16}{'':16}")
            part = slice(columns.indptr[j], columns.indptr[j + 1])
            for i, value in zip(columns.indices[part], columns.data[part], strict=True):
                number = f"{value:.9E}".replace("E", "D")
                text.append(f"{'*':8}{labels[i // 3]:16}{i % 3 + 1:16}{number:>16}")
    (folder / "job.pch").write_text("\n".join(text) + "\n")
    return [folder / "job.pch"]


def output4(folder, fem, labels):
    """Text of OUTPUT4 with dense columns: from the first entry that is not zero to the last one."""
    pytest.importorskip("pyyeti")
    lines = []
    for name, matrix in (("KGG", fem.stiffness), ("MGG", fem.mass)):
        dense = in_ascending_order(matrix, labels, 6).toarray()
        n = len(dense)
        lines.append(f"{n:8d}{n:8d}{6:8d}{2:8d}{name:8s}1P,3E23.16")
        for j in range(n):
            filled = np.flatnonzero(dense[:, j])
            if not len(filled):
                continue
            first, last = filled[0], filled[-1]
            values = dense[first : last + 1, j]
            lines.append(f"{j + 1:8d}{first + 1:8d}{len(values):8d}")
            for start in range(0, len(values), 3):
                lines.append("".join(f"{value:23.16E}" for value in values[start : start + 3]))
        lines += [f"{n + 1:8d}{1:8d}{1:8d}", f"{1.0:23.16E}"]
    (folder / "job.op4").write_text("\n".join(lines) + "\n")
    return [folder / "job.op4"]


def output4_of_pyyeti(folder, fem, labels, **options):
    with np.printoptions():
        op4 = pytest.importorskip("pyyeti.nastran.op4")
    matrices = {"KAA": in_ascending_order(fem.stiffness, labels), "MAA": in_ascending_order(fem.mass, labels)}
    op4.write(str(folder / "job.op4"), matrices, **options)
    return [folder / "job.op4"]


FORMATS = {
    "CalculiX": (calculix, abaqus_deck),
    "Abaqus, matrix input": (abaqus, abaqus_deck),
    "Abaqus, labels of both triangles": (lambda *a: abaqus(*a, upper=False, head=""), abaqus_deck),
    "Abaqus, coordinates": (abaqus_coordinates, abaqus_deck),
    "Matrix Market": (market, abaqus_deck),
    "Nastran, punched, one triangle": (punched, nastran_deck),
    "Nastran, punched, square": (lambda *a: punched(*a, form=1), nastran_deck),
    "Nastran, output 4": (output4, nastran_deck),
    "Nastran, output 4, binary": (lambda *a: output4_of_pyyeti(*a, binary=True, sparse="dense"), nastran_deck),
    "Nastran, output 4, sparse": (lambda *a: output4_of_pyyeti(*a, binary=True, sparse="bigmat"), nastran_deck),
    "Nastran, output 4, sparse text": (
        lambda *a: output4_of_pyyeti(*a, binary=False, sparse="nonbigmat"),
        nastran_deck,
    ),
}
TEN_DIGITS = "punched"


def spectrum(fem):
    """Frequencies, and what forces and moments on the top move there at 9 kHz."""
    out = ep.reduce(fem, ep.Partition.interface(fem, "top", plane=TOP), f_cut=1e5).matrices()
    rows = out.interfaces["top"]
    answer = rows @ np.linalg.solve((out.stiffness - (2 * np.pi * 9e3) ** 2 * out.mass).toarray(), rows.T)
    return np.sqrt(out.stiffness.diagonal()[6:]), answer


@pytest.fixture(scope="module")
def own_spectrum(own):
    return spectrum(own)


@pytest.mark.parametrize("name", FORMATS)
def test_the_body_is_that_of_our_own_matrices(tmp_path, own, labels, own_spectrum, name):
    write, deck = FORMATS[name]
    found = ep.read_matrices(*write(tmp_path, own, labels))
    fem = found.fe_model(deck(tmp_path / ("mesh.inp" if deck is abaqus_deck else "mesh.bdf"), own, labels), ep.STEEL)
    np.testing.assert_array_equal(fem.points, own.points)
    digits = 1e-7 if TEN_DIGITS in name else 1e-10
    for one, other in zip(spectrum(fem), own_spectrum, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=digits * abs(other).max())


def test_nodes_without_a_deck(tmp_path, own, labels):
    """Points and facets as arrays, in an order of their own."""
    order = np.random.default_rng(2).permutation(own.n_nodes)
    mass, stiffness = ep.read_matrices(*abaqus(tmp_path, own, labels)).on(labels[order])
    facets = np.argsort(order)[own.facets]
    fem = ep.FEModel.from_matrices(mass, stiffness, own.points[order], facets, material=ep.STEEL)
    np.testing.assert_allclose(fem.inertia_tensor, own.inertia_tensor, atol=1e-17)


def test_t_mm_and_s(tmp_path, own, labels):
    """The program ran in t, mm and s; the model is in SI units."""
    scaled = ep.FEModel(
        own.points * 1e3,
        own.cells,
        own.mass / 1e3,
        own.stiffness / 1e3,
        own.cell_mass / 1e3,
        ep.Material(E=210e3, nu=0.3, rho=7.8e-9),
        {},
    )
    found = ep.read_matrices(*calculix(tmp_path, scaled, labels), mass_unit=1e3, stiffness_unit=1e3)
    fem = found.fe_model(abaqus_deck(tmp_path / "mesh.inp", own, labels, 1e3), ep.STEEL, scale=1e-3)
    np.testing.assert_allclose(fem.rigid_modes.T @ fem.mass @ fem.rigid_modes, _inertia(own), atol=1e-12 * 0.05)
    with pytest.raises(InputError, match="mass: a motion along x moves"):
        ep.read_matrices(tmp_path / "job.sti").fe_model(tmp_path / "mesh.inp", ep.STEEL, scale=1e-3)


def _inertia(fem):
    return fem.rigid_modes.T @ fem.mass @ fem.rigid_modes


def test_matrices_of_ansys_have_one_triangle(own, labels):
    """As ansys-mapdl-reader hands them on: upper triangles, and node and direction, from 0 on, of each row."""
    order = np.argsort(labels)
    dofs = np.column_stack([np.repeat(labels[order], 3), np.tile(np.arange(3), len(labels))])
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    upper = [sp.triu(matrix[rows][:, rows], format="csc") for matrix in (own.stiffness, own.mass)]
    mass, stiffness = of_ansys("file.full", dofs, *upper, held=0).on(labels)
    assert abs(mass - own.mass).max() == abs(stiffness - own.stiffness).max() == 0
    with pytest.raises(InputError, match=r"9 dofs are held in file\.full"):
        of_ansys("file.full", dofs, *upper, held=9)
    with pytest.raises(InputError, match="has no mass; write it by a modal analysis"):
        of_ansys("file.full", dofs, upper[0], None, held=0)


def test_a_file_of_ansys():
    """The example of ansys-mapdl-reader, a beam that is held at one end."""
    examples = pytest.importorskip("ansys.mapdl.reader.examples")
    with pytest.raises(InputError, match=r"63 dofs are held in .*full, expected a free body"):
        ep.read_matrices(examples.fullfile)


def test_the_beam_in_a_file_of_ansys_vibrates_as_ours(tmp_path):
    """The same example: SOLID186, with reduced integration. What is left without the end that is held is compared."""
    examples = pytest.importorskip("ansys.mapdl.reader.examples")
    reader = pytest.importorskip("ansys.mapdl.reader")
    lines = Path(examples.hexarchivefile).read_text().splitlines()
    first = {line[:6]: number for number, line in enumerate(lines) if line[:6] in ("NBLOCK", "EBLOCK")}
    rows = lines[first["NBLOCK"] + 2 : first["NBLOCK"] + 323]
    points = np.array([[float(row[k : k + 21].strip() or 0) for k in (27, 48, 69)] for row in rows])
    pairs = lines[first["EBLOCK"] + 2 : first["EBLOCK"] + 82]
    cells = np.array([(a + b).split()[11:] for a, b in zip(pairs[::2], pairs[1::2], strict=True)], dtype=int) - 1
    deck = write_deck(tmp_path / "beam.inp", points, ("hexahedron20", cells))
    with pytest.warns(UnitsWarning):  # it is in inches
        own = ep.fe_model(deck, ep.Material(E=16.9e6, nu=0.31, rho=4.1408e-4))
    dofs, K, M = reader.read_binary(examples.fullfile).load_km(sort=True)
    both = of_ansys("file.full", dofs, K, M, held=0).on(np.arange(1, len(points) + 1))
    free = np.flatnonzero(both[1].diagonal())
    assert len(free) == 900
    found = []
    for mass, stiffness in (both, (own.mass, own.stiffness)):
        m, k = (matrix[free][:, free].toarray() for matrix in (mass, stiffness))
        found.append(np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True, subset_by_index=[0, 7])))
    np.testing.assert_allclose(found[0], found[1], rtol=5e-3)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
def test_files_of_calculix(tmp_path, own, labels):
    """Its stiffness is ours; its mass is integrated by fewer points, so that only the lowest frequencies are alike."""
    deck = abaqus_deck(tmp_path / "job.inp", own, labels)
    subprocess.run(["ccx", "job"], cwd=tmp_path, check=True, capture_output=True)
    fem = ep.read_matrices(tmp_path / "job.dof").fe_model(deck, ep.STEEL)
    assert abs(fem.stiffness - own.stiffness).max() < 1e-12 * abs(own.stiffness).max()
    assert spectrum(fem)[0][0] == pytest.approx(spectrum(own)[0][0], rel=0.01)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
@pytest.mark.parametrize(
    ("kind", "difference"), [("C3D8", 1e-6), ("C3D20", 1e-8), ("C3D20R", 0.01), ("C3D6", 0.1), ("C3D15", 0.01)]
)
def test_elements_of_calculix(tmp_path, kind, difference):
    """Fully integrated hexahedra are ours but for masses of distorted ones, which CalculiX integrates by fewer points.

    Reduced integration and wedges differ by less than the mesh's own error.
    """
    points, cells = hexahedra(2, 3, 4)
    inner = ((points > points.min(axis=0) + 1e-9) & (points < points.max(axis=0) - 1e-9)).all(axis=1)
    points[inner] += np.random.default_rng(0).normal(size=(inner.sum(), 3)) * 4e-4
    points, blocks = split(points, cells, ["wedge" if kind in ("C3D6", "C3D15") else "hexahedron"] * len(cells))
    if kind not in ("C3D6", "C3D8"):
        points, blocks = quadratic(points, blocks)
    deck = write_deck(tmp_path / "job.inp", np.round(points, 8), *blocks, more=MODAL)
    deck.write_text(deck.read_text().replace("TYPE=C3D20,", f"TYPE={kind},"))
    subprocess.run(["ccx", "job"], cwd=tmp_path, check=True, capture_output=True)
    own, theirs = ep.fe_model(deck), ep.read_matrices(tmp_path / "job.sti").fe_model(deck)
    bare = ep.FEModel.from_matrices(
        theirs.mass, theirs.stiffness, own.points, own.facets, material=own.material, boundaries=own.boundaries
    )
    found = [
        ep.reduce(fem, ep.Partition.interface(fem, "top", plane=TOP), f_cut=70e3).basis.omega[6:9]
        for fem in (own, theirs, bare)
    ]
    np.testing.assert_allclose(found[1], found[0], rtol=difference)
    np.testing.assert_allclose(found[2], found[1], rtol=1e-10)


MODAL = """*MATERIAL, NAME=S
*ELASTIC
210e9, 0.3
*DENSITY
7800.
*SOLID SECTION, ELSET=body, MATERIAL=S
*STEP
*FREQUENCY, SOLVER=MATRIXSTORAGE
10
*END STEP""".splitlines()


def edited(path, change):
    """The same file with other lines."""
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")


def held_node(lines):
    """Entries of one node are missing, as of one that was held."""
    node = lines[2].split(",")[0]
    return [*lines[:2], *(line for line in lines[2:] if node not in line.replace(" ", "").split(",")[:3:2])]


def of_a_shell(lines):
    return [*lines, f"{lines[2].split(',')[0]},4, {lines[2].split(',')[0]},4, 1e3"]


WRONG = {
    "a held node": ("_STIF2.mtx", held_node, None),
    "rotations": ("_STIF2.mtx", of_a_shell, "matrices: direction 4 of node .* has stiffness, but no place"),
    "another node": (
        "_STIF2.mtx",
        lambda lines: [*lines, "100000,1, 100000,1, 1e9"],
        "matrices: direction 1 of node 100000 has stiffness",
    ),
    "internal nodes": ("_STIF2.mtx", lambda lines: [*lines, "-4,1, -4,1, 1e9"], "1 internal nodes"),
    "a penalty": (
        "_STIF2.mtx",
        lambda lines: [*lines, f"{lines[2].split(',')[0]},1, {lines[2].split(',')[0]},1, 1e36"],
        "stiffness: ",
    ),
    "words": ("_STIF2.mtx", lambda lines: [*lines, "the end"], r"_STIF2\.mtx: expected lines of 5 numbers"),
    "a line cut off": ("_MASS2.mtx", lambda lines: [*lines[:-1], lines[-1][:9]], "_MASS2.mtx: expected lines of 5"),
    "four columns": (
        "_MASS2.mtx",
        lambda lines: ["1, 2, 3, 4" for _ in lines],
        "_MASS2.mtx: expected lines of 5 or 3 numbers",
    ),
    "two formats": ("_MASS2.mtx", lambda lines: ["1, 2, 3.0" for _ in lines], "have different formats"),
    "nothing": ("_MASS2.mtx", lambda lines: [], "_MASS2.mtx: expected lines of 5"),
    "half of the mass": ("_MASS2.mtx", lambda lines: lines[: len(lines) // 2], "mass: "),
    "not finite": (
        "_MASS2.mtx",
        lambda lines: [*lines[:-1], lines[-1].rpartition(",")[0] + ", nan"],
        "expected finite numbers",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_file_that_does_not_fit_is_refused(tmp_path, own, labels, name):
    file, change, message = WRONG[name]
    (source,) = abaqus(tmp_path, own, labels)
    deck = abaqus_deck(tmp_path / "mesh.inp", own, labels)
    for path in tmp_path.glob("*.mtx") if name == "a held node" else [tmp_path / f"job{file}"]:
        edited(path, change)
    with pytest.raises(InputError, match=message or "3 of .* dofs are not in the files, the first is x of node"):
        ep.read_matrices(source).fe_model(deck, ep.STEEL)


def test_files_that_are_not_there_or_of_another_kind(tmp_path, own, labels):
    calculix(tmp_path, own, labels)
    (tmp_path / "job.mas").unlink()
    with pytest.raises(InputError, match=r"source: .*job\.mas"):
        ep.read_matrices(tmp_path / "job.sti")
    with pytest.raises(InputError, match=r"mass: .* has the mass, or a file beside it"):
        ep.read_matrices(tmp_path / "job.sti", tmp_path / "job.sti")
    abaqus(tmp_path, own, labels)
    (tmp_path / "job_MASS2.mtx").unlink()
    with pytest.raises(InputError, match="mass: expected the file of the mass matrix, there is none beside"):
        ep.read_matrices(tmp_path / "job_STIF2.mtx")
    (tmp_path / "job.txt").write_text("1 1 1.0")
    with pytest.raises(InputError, match=r"source: expected matrices of CalculiX .* ends with '\.txt'"):
        ep.read_matrices(tmp_path / "job.txt")
    (tmp_path / "K.mtx").write_text("%%MatrixMarket matrix coordinate real general\n2 2 5\n1 1 1.0\n")
    with pytest.raises(InputError, match="could not be read as a file of Matrix Market"):
        ep.read_matrices(tmp_path / "K.mtx", tmp_path / "K.mtx")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("KAAX", "BAAX"), "expected one matrix whose name begins with K, as KGG, got none"),
        (lambda text: text.replace(f"{6:8}{2:8}{0:8}", f"{6:8}{4:8}{0:8}"), "square or symmetric and real"),
        (lambda text: text.replace(f"{6:8}{2:8}{0:8}", f"{9:8}{2:8}{0:8}"), "square or symmetric and real"),
        (lambda text: text.replace("D+", "Q+"), "expected a number in field"),
    ],
)
def test_other_dmig_is_refused(tmp_path, own, labels, change, message):
    (path,) = punched(tmp_path, own, labels)
    path.write_text(change(path.read_text()))
    with pytest.raises((InputError, MeshError), match=message):
        ep.read_matrices(path)


def test_rows_without_names_must_be_those_of_all_nodes(tmp_path, own, labels):
    found = ep.read_matrices(*market(tmp_path, own, labels))
    with pytest.raises(InputError, match=f"{own.n_dofs - 3} rows are expected of {own.n_nodes - 1} nodes"):
        found.on(labels[1:])
    with pytest.raises(InputError, match="labels: expected each node once"):
        found.on(np.r_[labels, labels[0]])
    with pytest.raises(InputError, match="mesh: expected a deck with numbers of nodes"):
        found.fe_model(tmp_path / "K.mtx", ep.STEEL)


def test_of_another_mesh(tmp_path, own, labels):
    """As many nodes, but two of them exchanged."""
    found = ep.read_matrices(*calculix(tmp_path, own, labels))
    other = labels.copy()
    other[[0, 7]] = other[[7, 0]]
    with pytest.raises(InputError, match="stiffness: "):
        found.fe_model(abaqus_deck(tmp_path / "mesh.inp", own, other), ep.STEEL)
