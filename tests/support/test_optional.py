"""Packages that only some functions need."""

import pytest

from exudyn_partition.errors import MissingPackageError
from exudyn_partition.support.optional import require


def test_a_missing_package_is_named_with_its_pip_line():
    with pytest.raises(MissingPackageError, match="pip install no_such_package"):
        require("no_such_package")
    with pytest.raises(MissingPackageError, match="pip install no-such-package"):
        require("no.such.package", "no-such-package")
