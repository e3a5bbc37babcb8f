"""Draw the moving picture of README and the site's front page: the wave in the plate under the rod.

    python -m validation.wave

writes examples/site/wave.gif. It needs the extra `pictures`.
"""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
UNTIL, FRAMES = 0.35e-3, 50  # [s]; the wave has been to the plate's edges and back


def main(path=EXAMPLES / "site" / "wave.gif"):
    model = SimpleNamespace(**runpy.run_path(str(EXAMPLES / "models" / "rod_on_plate.py")))
    fems, partitions, _ = model.fe_models(quick=False)
    *_, result, _ = model.partition_run(fems, partitions, "contact-adapted", 40e3, "explicit", UNTIL)
    return result.film(
        path,
        frames=np.linspace(0, UNTIL, FRAMES),
        colour="speed",
        end=1.0,
        scale=100.0,
        view="plate",
        direction=(1.0, -1.8, 0.9),
        size=(560, 360),
        period=0.06,
    )


if __name__ == "__main__":
    main()
