"""Packages that only some functions need."""

import numpy as np
import pytest

from exudyn_partition.errors import MissingPackageError
from exudyn_partition.support.optional import require


def test_a_missing_package_is_named_with_its_pip_line():
    with pytest.raises(MissingPackageError, match="pip install no_such_package"):
        require("no_such_package")
    with pytest.raises(MissingPackageError, match="pip install no-such-package"):
        require("no.such.package", "no-such-package")


def test_a_package_does_not_change_how_numbers_are_printed(tmp_path, monkeypatch):
    """Some set NumPy's options when they are imported, for all the program."""
    (tmp_path / "prints_otherwise.py").write_text("import numpy\nnumpy.set_printoptions(legacy='1.13')\n")
    monkeypatch.syspath_prepend(tmp_path)
    before = str(np.array([0.005, 0.01]))
    require("prints_otherwise")
    assert str(np.array([0.005, 0.01])) == before
