"""Sphinx configuration of the site; `python -m sphinx -W -b html examples/site out/site` builds it."""

import re

import exudyn_partition

project = "exudyn_partition"
author = "The exudyn_partition developers"
release = exudyn_partition.__version__
extensions = ["myst_parser", "numpydoc", "sphinx.ext.autosummary", "sphinx.ext.mathjax"]
exclude_patterns = ["templates"]
html_theme = "furo"
html_title = f"exudyn_partition {release}"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # pages include sections of README below a title of their own
templates_path = ["templates"]
autodoc_typehints = "none"  # docstrings have the types, with shapes and units
numpydoc_show_class_members = False


def without_links_to_files(app, relative_path, parent_docname, content):
    """Take links to files of the repository out of included pages; the site does not hold these files."""
    content[0] = re.sub(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)[^)]+\)", r"\1", content[0])
    if parent_docname != "guide":  # which has README's sections
        content[0] = content[0].replace("](#", "](guide.md#")


def setup(app):
    """Connect what changes pages as they are read."""
    app.connect("include-read", without_links_to_files)
