"""Optional imports: what is missing is named together with the pip line that installs it.

Also imports of what few runs need and takes long, as `scipy.signal`, which brings `scipy.stats`.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType

import numpy as np

from ..errors import MissingPackageError


def require(package: str, distribution: str | None = None) -> ModuleType:
    """Import `package`, or raise `MissingPackageError` with the pip line, where it may have another name."""
    if (module := sys.modules.get(package)) is not None:
        return module
    try:
        with np.printoptions():  # some packages change how all numbers are printed
            return importlib.import_module(package)
    except ImportError as error:
        name = distribution or package.split(".")[0]
        raise MissingPackageError(
            f"{name} is needed for this and could not be imported ({error}): pip install {name}"
        ) from error
