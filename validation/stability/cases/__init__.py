"""The stiff and extreme cases: each function makes a run and returns what must hold, name -> (value, limit).

`@case` says what must happen: that all of it holds, with the library's warnings in `warns` and no other, or that the
error in `raises` comes. Functions take the integrator, "explicit" or "implicit".
"""

# In the order of the table.
from validation.stability.cases import (  # isort: skip
    speeds,  # noqa: F401
    materials,  # noqa: F401
    meshes,  # noqa: F401
    bases,  # noqa: F401
    rest,  # noqa: F401
    many_rows,  # noqa: F401
    rotation,  # noqa: F401
    steps,  # noqa: F401
    units,  # noqa: F401
    formulations,  # noqa: F401
)
from validation.stability.cases.registry import CASES as CASES
