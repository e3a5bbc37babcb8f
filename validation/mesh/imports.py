"""Mesh files in many dialects: the same body comes from each, and what a deck's other elements are is said.

Reference: a steel block, 10 x 20 x 30 mm, in cubic tetrahedra of NGSolve. One mesh of hexahedra with 20 nodes is
written in each dialect of Abaqus, CalculiX, Nastran, Gmsh and VTK below; finer meshes of each kind of elements in one.
Quantity: volume and mass, six elastic frequencies, and the faces of a name.
Limit: volume 2e-14, mass 2e-10 (NGSolve moves the tips of pyramids by 1e-10); frequencies 1e-9 between dialects, 1e-3
from the reference for each kind; no faces other than those of the name. To read 200 000 nodes takes 5 s more than
meshio does, at most.

    python -m validation.mesh.imports [--decks FOLDER] [--out FILE]

`--decks` also reads all decks in a folder, and counts which load and why others do not.
"""

import argparse
import json
import re
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import meshio
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from exudyn_partition.algebra.krylov import eigenmodes, mass_normalised
from exudyn_partition.fe.elements import BY_NAME, faces_of
from exudyn_partition.fe.facets import part_sizes
from exudyn_partition.meshing.mesh_files import DECKS, read_bodies, volume_mesh

SIZE = np.array([0.01, 0.02, 0.03])
TYPES = {"hexahedron20": "C3D20", "wedge15": "C3D15", "pyramid13": "C3D13", "tetra10": "C3D10"}
LIMITS = {"volume": 2e-14, "mass": 2e-10, "between_dialects": 1e-9, "faces_wrong": 0, "frequencies": 1e-3,
          "longer_than_meshio_s": 5}  # fmt: skip
QUADRATIC = {"hexahedron": "hexahedron20", "wedge": "wedge15", "pyramid": "pyramid13", "tetra": "tetra10"}
SIDES = [[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]]
# Nodes of a hexahedron, as Nastran lists them, in the order that mirrors it.
MIRRORED = [*range(4, 8), *range(4), *range(16, 20), *range(12, 16), *range(8, 12)]
NASTRAN_ORDER = [*range(12), *range(16, 20), *range(12, 16)]


def block(n, kind="hexahedron"):
    """Points and elements of the block with quadratic elements of a kind, n = (nx, ny, nz) boxes."""
    axes = [np.linspace(0, length, k + 1) for length, k in zip(SIZE, n, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape([k + 1 for k in n])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    parts = [number[tuple(slice(a, a + k) for a, k in zip(c, n, strict=True))].ravel() for c in corners]
    cells, linear, middles = np.stack(parts, axis=1), {}, []
    for cell in cells:
        own = kind if kind != "mixed" else ("wedge" if points[cell, 1].mean() < SIZE[1] / 2 else "foot")
        if own == "hexahedron":
            linear.setdefault(own, []).append(cell)
        elif own == "wedge":
            linear.setdefault(own, []).extend([cell[[0, 1, 2, 4, 5, 6]], cell[[0, 2, 3, 4, 6, 7]]])
        else:
            middle = len(points) + len(middles)
            middles.append(points[cell].mean(axis=0))
            for i, (a, b, c, d) in enumerate(cell[SIDES]):
                if own == "foot" and i == 0 and points[cell[0], 2] == 0:
                    linear.setdefault("tetra", []).extend([[a, b, c, middle], [a, c, d, middle]])
                else:
                    linear.setdefault("pyramid", []).append([a, b, c, d, middle])
    points = np.vstack([points, np.reshape(middles, (-1, 3))])
    blocks = {name: np.array(rows) for name, rows in linear.items()}
    ends = [np.sort(rows[:, BY_NAME[name].edges], axis=2) for name, rows in blocks.items()]
    edges, place = np.unique(np.concatenate([part.reshape(-1, 2) for part in ends]), axis=0, return_inverse=True)
    split = np.split(len(points) + place.ravel(), np.cumsum([part[..., 0].size for part in ends])[:-1])
    quadratic = [
        (QUADRATIC[name], np.hstack([rows, own.reshape(len(rows), -1)]))
        for (name, rows), own in zip(blocks.items(), split, strict=True)
    ]
    return np.vstack([points, points[edges].mean(axis=1)]), quadratic


def nodes(points, numbers, form="{}, {!r}, {!r}, {!r}"):
    return [form.format(i, *map(float, x)) for i, x in zip(numbers, points, strict=True)]


def elements(blocks, per_line=16, first=1):
    lines = []
    for name, rows in blocks:
        lines.append(f"*ELEMENT, TYPE={TYPES[name]}, ELSET=body")
        for i, row in enumerate(rows + 1, first):
            data = [i, *row]
            parts = [data[k : k + per_line] for k in range(0, len(data), per_line)]
            lines.append(",\n".join(", ".join(map(str, part)) for part in parts))
        first += len(rows)
    return lines


def abaqus_dialects(points, blocks):
    """Decks of Abaqus and CalculiX by their names, as texts of files by their names."""
    foot = np.flatnonzero(points[:, 2] == 0) + 1
    low = np.flatnonzero(points[blocks[0][1]][:, :8, 2].min(axis=1) == 0) + 1
    head, count = ["*NODE", *nodes(points, range(1, len(points) + 1))], len(blocks[0][1])
    plain = [*head, *elements(blocks)]
    some = [", ".join(map(str, foot[i : i + 16])) for i in range(0, len(foot), 16)]
    sets = {
        "numbers": ["*NSET, NSET=foot", *some],
        "trailing commas": ["*NSET, NSET=foot", *(line + "," for line in some)],
        "one a line": ["*NSET, NSET=foot", *(f"{i}," for i in foot)],
        "generate with three": ["*NSET, NSET=foot, GENERATE", *(f"{i}, {i}, 1" for i in foot)],
        "generate with two": ["*NSET, NSET=foot, GENERATE", *(f"{i}, {i}" for i in foot)],
        "names in sets": ["*NSET, NSET=part", *some[:1], "*NSET, NSET=foot", "part", *some[1:]],
        "two keywords": ["*NSET, NSET=foot", *some[:1], "*NSET, NSET=foot", *some[1:]],
        "unsorted": ["*NSET, NSET=foot, UNSORTED", *some[::-1]],
        "small letters": ["*nset, nset=foot", *some],
        "blanks": ["*NSET ,  NSET = foot ", *(f"   {line}" for line in some)],
        "comments": ["** a set", "*NSET, NSET=foot", some[0], "** goes on", *some[1:]],
        "surface of elements": ["*SURFACE, NAME=foot", *(f"{i}, S1" for i in low)],
        "surface of a set": ["*ELSET, ELSET=low", *(f"{i}," for i in low),
                             "*SURFACE, NAME=foot, TYPE=ELEMENT", "low, S1"],
        "surface of nodes": ["*NSET, NSET=f", *some, "*SURFACE, NAME=foot, TYPE=NODE", "f"],
        "set of elements' nodes": ["*ELSET, ELSET=all, GENERATE", f"1, {count}", "*NSET, NSET=everything, ELSET=all",
                                   "*NSET, NSET=foot", *some],
    }  # fmt: skip
    found = {f"set by {name}": {"m.inp": [*plain, *lines]} for name, lines in sets.items()}
    some_set = sets["numbers"]
    found["lines of ten numbers"] = {"m.inp": [*head, *elements(blocks, 10), *some_set]}
    found["included nodes"] = {"m.inp": ["*INCLUDE, INPUT=n.inc", *elements(blocks), *some_set], "n.inc": head}
    found["nodes from a file"] = {"m.inp": ["*NODE, INPUT=n.txt", *elements(blocks), *some_set], "n.txt": head[1:]}
    turned = points[:, [1, 2, 0]]  # x of the system is y of the mesh, and so on
    found["nodes in a system"] = {
        "m.inp": ["*SYSTEM", "0, 0, 0, 0, 1, 0", "0, 0, 1", "*NODE", *nodes(turned, range(1, len(points) + 1)),
                  "*SYSTEM", "0, 0, 0", *elements(blocks), *some_set]
    }  # fmt: skip
    part = ["*PART, NAME=p", *plain, *some_set, "*END PART", "*ASSEMBLY, NAME=a"]
    found["a part"] = {"m.inp": [*part, "*INSTANCE, NAME=i, PART=p", "*END INSTANCE", "*END ASSEMBLY"]}
    away = nodes(turned - [0, 0, 0.5], range(1, len(points) + 1))
    moved = ["*PART, NAME=p", "*NODE", *away, *elements(blocks), *some_set]
    found["an instance that is moved and turned"] = {
        "m.inp": [*moved, "*END PART", "*ASSEMBLY, NAME=a", "*INSTANCE, NAME=i, PART=p", "0, 0, 0.5",
                  "0, 0, 0, 1, 1, 1, 120.", "*END INSTANCE", "*END ASSEMBLY"]
    }  # fmt: skip
    beside = ["*NODE", "900001, 1., 1., 1.", *plain, *some_set]
    found["a reference point"] = {"m.inp": beside}
    found["nodes from the end"] = {"m.inp": ["*NODE", *head[:0:-1], *elements(blocks), *some_set]}
    steps = ["*STEP", "*STATIC", "*BOUNDARY", "foot, 1, 3", "*END STEP"]
    found["a step"] = {"m.inp": [*plain, *some_set, *steps]}
    material = ["*MATERIAL, NAME=steel", "*ELASTIC", "2.1e11, 0.3", "*DENSITY", "7800."]
    section = ["*SOLID SECTION, ELSET=body, MATERIAL=steel"]
    found["its own material"] = {"m.inp": [*plain, *some_set, *material, *section]}
    skin = blocks[0][1][0][[0, 1, 2, 3, 8, 9, 10, 11]] + 1
    shell = ["*ELEMENT, TYPE=S8R, ELSET=skin", "90001, " + ", ".join(map(str, skin))]
    found["a shell beside"] = {"m.inp": [*plain, *shell, "*SHELL SECTION, ELSET=skin", "1e-3", *some_set]}
    found["text before the first keyword"] = {"m.inp": [">**", "A block,", *plain, *some_set]}
    found["an instance in a flat deck"] = {"m.inp": [*plain, *(line.replace("NSET=foot", "NSET=foot, INSTANCE=i")
                                                               for line in some_set)]}  # fmt: skip
    alone = ["*PART, NAME=p", *plain, *some_set, "*END PART"]
    found["a part alone, its section beside it"] = {"m.inp": [*alone, *material, *section]}
    found["reduced integration"] = {"m.inp": [line.replace("C3D20,", "C3D20R,") for line in [*plain, *some_set]]}
    return found


def nastran_dialects(points, blocks):
    """Bulk data by names; one kind of elements."""
    rows, labels = blocks[0][1][:, NASTRAN_ORDER] + 1, range(1, len(points) + 1)

    def hexa(i, row, sep, marks=True):
        text, data = "", [i, 1, *row]
        for k in range(0, len(data), 8):
            head = "CHEXA" if k == 0 else ("+" if marks else "")
            mark = "+" if marks and k + 8 < len(data) else ""
            if sep == ",":
                text += ",".join([head, *map(str, data[k : k + 8]), mark]).rstrip(",") + "\n"
            else:
                text += head.ljust(8) + "".join(str(x).rjust(8) for x in data[k : k + 8]) + mark + "\n"
        return text.rstrip("\n")

    def large(i, x, system=""):
        values = [f"{v:.9E}".rjust(16) for v in x]
        return f"{'GRID*':8}{i:16d}{system!s:>16}{values[0]}{values[1]}\n{'*':8}{values[2]}"

    free = [f"GRID,{i},,{x!r},{y!r},{z!r}" for i, (x, y, z) in zip(labels, points.tolist(), strict=True)]
    of_free = [hexa(i, row, ",") for i, row in enumerate(rows, 1)]
    of_small = [hexa(i, row, "") for i, row in enumerate(rows, 1)]
    blank = [hexa(i, row, "", marks=False) for i, row in enumerate(rows, 1)]
    of_marks = [hexa(i, row, "").replace("+\n+       ", f"+{i:<7}\n+{i:<7}", 1) for i, row in enumerate(rows, 1)]
    of_marks = [[text.partition("\n")[0], text.partition("\n")[2]] for text in of_marks]
    wide = [large(i, x) for i, x in zip(labels, points, strict=True)]
    system = "CORD2R,7,,0.,0.,0.,1.,0.,0.,+\n+,0.,1.,0."  # its z is x, its x is y
    turned = points[:, [1, 2, 0]]
    turn = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    round_ = np.column_stack([np.hypot(*points.T[:2]), turn, points[:, 2]])
    size = np.linalg.norm(points, axis=1)
    fall = np.degrees(np.arccos(np.divide(points[:, 2], size, out=np.ones(len(size)), where=size > 0)))
    sphere = np.column_stack([size, fall, turn])
    origin = ",,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0."

    def grids(places, cp):
        return [f"GRID,{i},{cp},{x!r},{y!r},{z!r}" for i, (x, y, z) in zip(labels, places.tolist(), strict=True)]

    bulk = {
        "free fields": [*free, *of_free],
        "large nodes, marks": [*wide, *of_small],
        "large nodes, no marks": [*wide, *blank],
        "CORD2R": [system, *grids(turned, 7), *of_free],
        "CORD2C": [f"CORD2C,8{origin}", *grids(round_, 8), *of_free],
        "CORD2S": [f"CORD2S,9{origin}", *grids(sphere, 9), *of_free],
        "GRDSET": [system, "GRDSET,,7", *grids(turned, ""), *of_free],
        "comments and small letters": ["$ a block", *[line.lower() for line in free], "$ its elements", *of_free],
        "a mass beside": [*free, *of_free, "CONM2,9001,1,,5."],
        "CORD1R": [
            *free[:1],
            *(f"GRID,{90001 + i},,{x}" for i, x in enumerate(("0.,0.,0.", "1.,0.,0.", "0.,1.,0."))),
            "CORD1R,5,90001,90002,90003",
            *grids(turned, 5)[1:],
            *of_free,
        ],
        "MAT1": [*free, *of_free, "PSOLID,1,3", "MAT1,3,2.1+11,,.3,7800."],
        "marks in other places": [line + "\n" for card in of_marks for line in card[:1]]
        + free
        + [line for card in of_marks[::-1] for line in card[1:]],
        "long lines": [*free, *(f"CHEXA,{i},1,{','.join(map(str, row))}" for i, row in enumerate(rows, 1))],
        "elements in either order": [
            *free,
            *(hexa(i, row[MIRRORED] if i % 2 else row, ",") for i, row in enumerate(rows, 1)),
        ],
        "nodes on edges left out": [
            *free,
            *(
                hexa(i, [*row[:8], *("" if (i + k) % 3 else node for k, node in enumerate(row[8:-1])), row[-1]], ",")
                for i, row in enumerate(rows, 1)
            ),
        ],
    }
    found = {f"Nastran, {name}": {"m.bdf": ["BEGIN BULK", *lines, "ENDDATA"]} for name, lines in bulk.items()}
    found["Nastran, a file .dat"] = {"m.dat": ["SOL 101", "CEND", "BEGIN BULK", *free, *of_small, "ENDDATA"]}
    found["Nastran, without BEGIN BULK"] = {"m.nas": [*free, *of_free]}
    found["Nastran, included"] = {"m.bdf": ["BEGIN BULK", "INCLUDE 'g.inc'", *of_free, "ENDDATA"], "g.inc": free}
    return found


def of_meshio(folder, points, blocks):
    """Files that meshio writes, with text and with binary numbers."""
    written = {}
    for form, ending in (("vtu", "vtu"), ("vtk", "vtk"), ("gmsh22", "msh"), ("gmsh", "msh")):
        for binary in (True, False):
            name = f"{form}, {'binary' if binary else 'text'}"
            written[name] = folder / f"{form}{binary:d}.{ending}"
            more = {} if binary else {"float_fmt": ".16e"} if "gmsh" in form else {}
            meshio.write(written[name], meshio.Mesh(points, blocks), file_format=form, binary=binary, **more)
    return written


def collapsed(blocks):
    """Elements as hexahedra whose nodes have fallen together."""
    return np.concatenate([cells[:, BY_NAME[kind].of_row] for kind, cells in blocks])


def frequencies(fem, most=1.6e5):
    modes = eigenmodes(fem.stiffness, fem.mass, mass_normalised(fem.rigid_modes, fem.mass), 2 * np.pi * most)
    return modes.omega[:6] / (2 * np.pi)


def loaded(path):
    """FE model of a file; what is no solid element is left out."""
    deck = path.suffix in DECKS
    material = None if deck and re.search("MATERIAL,|MAT1", path.read_text()) else ep.STEEL
    return ep.fe_model(path, material, only_solids=deck)


def row_of(name, fem, expected, first=None):
    """Errors of a file's model."""
    found = frequencies(fem)
    row = {"name": name, "nodes": fem.n_nodes, "volume": float(fem.cell_volume.sum() / SIZE.prod() - 1)}
    row["mass"] = float(fem.mass.sum() / 3 / (ep.STEEL.rho * SIZE.prod()) - 1)
    row["frequencies"] = float(abs(found / expected - 1).max())
    if first is not None:
        row["to_first"] = float(abs(found / first - 1).max())
    if "foot" in fem.boundaries:
        at_foot = (fem.points[fem.facets, 2] < 1e-9).all(axis=1)
        row["foot"] = bool(np.array_equal(np.sort(fem.boundaries["foot"]), np.flatnonzero(at_foot)))
    return row


def public_decks(folder):
    """Which decks of a folder load, which hold several bodies, and why others are refused, with a name of each."""
    ends, seconds = {}, 0.0
    for path in sorted(p for p in folder.rglob("*") if p.suffix in DECKS and p.is_file()):
        start = time.perf_counter()
        try:
            file = volume_mesh(read_bodies(path), several=True)
            bodies = len(part_sizes(faces_of(file.cells, file.hexahedra)[1]))
            end = "loads" if bodies == 1 else "several bodies"
        except ep.errors.PartitionError as error:
            end = re.sub(r"[-+\d.e]+", "#", str(error).replace(str(path), "FILE"))[:70]
        seconds += time.perf_counter() - start
        ends[path.name] = end
    counts = Counter(ends.values())
    return {"files": len(ends), "seconds": seconds, "ends": dict(counts.most_common())}


def loading(folder):
    """Processor time [s] to read 200 000 nodes beside that of meshio alone, for a deck of each family."""
    points, blocks = block((32, 40, 38))
    rows = []
    for ending, form in ((".inp", "abaqus"), (".bdf", "nastran")):
        path = folder / f"large{ending}"
        if form == "abaqus":
            lines = ["*NODE", *nodes(points, range(1, len(points) + 1)), *elements(blocks)]
            path.write_text("\n".join([*lines, ""]))
        else:
            meshio.write(path, meshio.Mesh(points, blocks), file_format=form)
        times = []
        for read in (lambda path: volume_mesh(read_bodies(path)), meshio.read):
            start = time.process_time()
            read(path)
            times.append(time.process_time() - start)
        rows.append({"file": ending, "nodes": len(points), "ours_s": times[0], "meshio_s": times[1]})
    return rows


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--decks", type=Path, help="folder of decks to be read as well")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--quick", action="store_true", help="coarser meshes of each kind, without limits for them")
    options = parser.parse_args(argv)
    warnings.simplefilter("error", ep.errors.PartitionWarning)
    shape = occ.Box((0, 0, 0), tuple(SIZE.tolist()))
    expected = frequencies(ep.fe_model(shape, ep.STEEL, order=3, maxh=3e-3))
    rows, kinds = [], []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        points, blocks = block((1, 2, 3))
        dialects, first = {}, None
        texts = abaqus_dialects(points, blocks) | nastran_dialects(points, blocks)
        for number, (name, files) in enumerate(texts.items()):
            own = folder / str(number)
            own.mkdir()
            for file, lines in files.items():
                (own / file).write_text("\n".join([*lines, ""]))
            dialects[name] = own / next(iter(files))
        for name, path in (dialects | of_meshio(folder, points, blocks)).items():
            fem = loaded(path)
            first = frequencies(fem) if first is None else first
            rows.append(row_of(name, fem, expected, first))
        for kind in ("hexahedron", "wedge", "pyramid", "mixed"):
            points, blocks = block((2, 4, 5) if options.quick else (4, 8, 10), kind)
            path = folder / f"{kind}.inp"
            lines = ["*NODE", *nodes(points, range(1, len(points) + 1)), *elements(blocks)]
            path.write_text("\n".join([*lines, ""]))
            kinds.append(row_of(kind, loaded(path), expected))
            if kind != "hexahedron":
                lines = [*lines[: len(points) + 1], *elements([("hexahedron20", collapsed(blocks))])]
                path.write_text("\n".join([*lines, ""]))
                kinds.append(row_of(f"{kind}, as collapsed hexahedra", loaded(path), expected))
    found = {
        "volume": max(abs(row["volume"]) for row in rows + kinds),
        "mass": max(abs(row["mass"]) for row in rows + kinds),
        "between_dialects": max(row["to_first"] for row in rows),
        "faces_wrong": sum(not row.get("foot", True) for row in rows),
    }
    large = []
    if not options.quick:
        found["frequencies"] = max(row["frequencies"] for row in kinds)
        with tempfile.TemporaryDirectory() as place:
            large = loading(Path(place))
        found["longer_than_meshio_s"] = max(row["ours_s"] - row["meshio_s"] for row in large)
    result = {
        "loading": large,
        "found": found,
        "limits": LIMITS,
        "dialects": rows,
        "kinds": kinds,
        "versions": ep.versions(),
    }
    if options.decks:
        result["decks"] = public_decks(options.decks)
    print(f"{len(rows)} dialects:", json.dumps(found, indent=1))
    options.out.write_text(json.dumps(result, indent=1) + "\n")
    return result


if __name__ == "__main__":
    main()
