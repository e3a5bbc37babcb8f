"""Files in many dialects, quickly."""

import json

from validation.mesh import imports


def test_all_dialects_give_one_body(tmp_path):
    result = imports.main(["--quick", "--out", str(tmp_path / "found.json")])
    assert len(result["dialects"]) >= 40
    assert all(value <= result["limits"][name] for name, value in result["found"].items())
    assert json.loads((tmp_path / "found.json").read_text())["found"] == result["found"]


def test_public_decks_are_counted(tmp_path):
    points, blocks = imports.block((1, 1, 1))
    lines = ["*NODE", *imports.nodes(points, range(1, len(points) + 1)), *imports.elements(blocks)]
    (tmp_path / "one.inp").write_text("\n".join([*lines, ""]))
    (tmp_path / "beam.inp").write_text("\n".join([*lines, "*BEAM SECTION, ELSET=b, MATERIAL=m", ""]))
    counts = imports.public_decks(tmp_path)
    assert counts["files"] == 2
    assert counts["ends"]["loads"] == 1
