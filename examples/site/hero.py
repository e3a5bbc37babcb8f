"""Draw the moving picture of README and front page: the wave in the plate under the rod.

    python examples/site/hero.py

writes examples/site/wave.gif.
"""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from models import rod_on_plate as model  # noqa: E402, for the folder of the models must be known first

UNTIL, FRAMES = 0.35e-3, 50  # [s]; the wave has been to the plate's edges and back


def main(path=HERE / "wave.gif"):
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
