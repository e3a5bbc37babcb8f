"""Pages of the gallery: figures and output of each example at full size, moving bodies, and source.

Results at full size are those that `python -m validation.gallery` has kept. The build itself runs the examples with
`--quick`, for the moving bodies. `python -m sphinx -D run_examples=0 ...` runs none: its pages lack these.
"""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from sphinx.errors import ExtensionError
from sphinx.util import logging

EXAMPLES = Path(__file__).resolve().parents[1]
FOLDER = Path(__file__).resolve().parent / "gallery"  # written anew by each build
LIST = (EXAMPLES / "README.md").read_text()  # names of all examples, in the order of learning
NAMES = re.findall(r"^\d+\. \[`(\w+)\.py`\]", LIST, re.M)
LIMIT_S = 1800.0  # ends examples that hang; beside other work each may take minutes
GROUPS = {
    "Impact": ("two_spheres", "rod_on_plate", "own_part", "newtons_cradle", "gauge_and_vibrometer"),
    "Friction": ("oblique_impact",),
    "Yield": ("restitution",),
    "Mechanisms": (
        "assembly",
        "existing_model",
        "take_elsewhere",
        "crank_slider",
        "cam_follower",
        "gear_pair",
        "ball_bearing",
    ),
    "Accuracy and studies": (
        "choose_accuracy",
        "parameter_study",
        "sobol_indices",
        "restitution_map",
        "quiet_pin",
        "gym_arm",
        "hammer_test",
        "buffer_design",
        "impact_map",
    ),
}
EXTRAS = {"gym_arm": "learning"}  # that an example needs
FULL = json.loads((EXAMPLES.parent / "validation" / "gallery.json").read_text(encoding="utf-8"))
SCENES = "moving"  # folder of the pages with moving bodies, in the site


def write_pages(app):
    """Write the gallery's index, a page for each example, and the tutorial; run the examples if asked to."""
    FOLDER.mkdir(exist_ok=True)
    if sorted(name for names in GROUPS.values() for name in names) != sorted(NAMES):
        raise ExtensionError(f"gallery.py: GROUPS must hold each example of examples/README.md once: {NAMES}")
    if app.config.run_examples:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(run, NAMES))
    scenes = FOLDER / "extra" / SCENES
    scenes.mkdir(parents=True, exist_ok=True)
    for name in NAMES:
        for path in (FOLDER / name).glob("*.html"):
            shutil.copy(path, scenes / f"{name}.html")
    app.config.html_extra_path.append(str(scenes.parent))
    pages = {"index": index(), **{name: page(name) for name in NAMES}}
    for name, text in pages.items():
        (FOLDER / f"{name}.md").write_text(text, encoding="utf-8")
    notebook = (EXAMPLES / "tutorial.ipynb").read_text(encoding="utf-8")
    (FOLDER / "tutorial.ipynb").write_text(as_on_the_site(notebook), encoding="utf-8")


def as_on_the_site(text):
    """Let links to examples lead to their pages, and take those to other files away."""
    text = re.sub(r"\]\((\w+)\.(?:py|ipynb)\)", r"](\1)", text).replace("](README.md)", "](index)")
    for name in re.findall(r"\]\((\w+)\)", text):
        text = text.replace(f"]({name})", f"]({name}.{'ipynb' if name == 'tutorial' else 'md'})")
    return re.sub(r"\[([^\]]+)\]\(models[^)]*\)", r"\1", text)


def index():
    """Cards of the examples by what they are for, the list in the order of learning, and the table of contents."""
    parts = ["# Gallery"]
    for group, names in GROUPS.items():
        parts += [f"## {group}", "\n".join(["::::{grid} 1 2 3 3", ":gutter: 3", "", *map(card, names), "::::"])]
    toc = "\n".join(["tutorial", *NAMES])
    parts += [as_on_the_site(LIST).replace("# Examples", "## Examples", 1), f"```{{toctree}}\n:hidden:\n\n{toc}\n```"]
    return "\n\n".join(parts) + "\n"


def card(name):
    """An example's first sentence, beneath its first figure, and what it takes."""
    picture = [f":img-top: ../full/{FULL[name]['figures'][0]}", f":img-alt: figure of {name}"] if name in FULL else []
    return "\n".join([f":::{{grid-item-card}} {title(name)}", f":link: {name}", ":link-type: doc", *picture, "",
                      said(name).split("\n\n")[0].replace("\n", " "), "", f"*{taken(name)}*", ":::", ""])  # fmt: skip


def taken(name):
    """Time and memory of an example at full size."""
    full = FULL.get(name)
    if full is None:  # a new example: tests ask for a run of validation/gallery.py
        return "not run at full size yet"
    seconds = full["processor_s"] or full["seconds"]
    time = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
    return f"{time} of a processor, {full['memory_GB']:.1f} GB" if full["memory_GB"] else time


def title(name):
    """Name of an example in print."""
    return name.replace("_", " ").capitalize()


def said(name):
    """What an example says of itself."""
    return ast.get_docstring(ast.parse((EXAMPLES / f"{name}.py").read_text(encoding="utf-8")))


def run(name):
    """Run an example, for its moving bodies."""
    logging.getLogger(__name__).info("running %s.py", name)
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "--quick", "--out", str(FOLDER / name)]
    environment = {**os.environ, "MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1"}
    try:
        subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, env=environment, check=True)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        raise ExtensionError(f"examples/{name}.py failed: {error}\n{(error.stderr or '')[-2000:]}") from error


def page(name):
    """A page: what the example is, its figures, what it printed, its moving bodies, and its source."""
    parts = [f"# {title(name)}", said(name), *(full_size(name) if name in FULL else [])]
    if (FOLDER / "extra" / SCENES / f"{name}.html").exists():
        frame = f'src="../{SCENES}/{name}.html" title="moving bodies" loading="lazy"'
        parts += ["The bodies move here as with `--quick`, on a coarser mesh and over a shorter time:"]
        parts += [f'```{{raw}} html\n<iframe {frame} style="width:100%;height:560px;border:0"></iframe>\n```']
    parts += [f"```{{literalinclude}} ../../{name}.py\n:language: python\n```"]
    return "\n\n".join(parts) + "\n"


def full_size(name):
    """What an example needed, drew and printed at full size, as parts of its page."""
    full = FULL[name]
    with_extra = f' and `pip install ".[{EXTRAS[name]}]"`' if name in EXTRAS else " alone"
    needed = (
        f"`python examples/{name}.py` needs the [base installation](../start.md){with_extra}. With version "
        f"{full['version']} ({full['date']}) it took {taken(name)}, drew and printed:"
    )
    figures = [f"```{{image}} ../full/{figure}\n:alt: {figure}\n```" for figure in full["figures"]]
    return [needed, *figures, f"```text\n{full['printed']}\n```"]
