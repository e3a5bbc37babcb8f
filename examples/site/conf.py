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


def links_as_on_the_site(app, relative_path, parent_docname, content):
    """In included pages: link to pages of the site, and take away links to files that it does not hold."""
    text = re.sub(r"\]\(examples/site/([\w-]+\.md)", r"](\1", content[0])
    text = re.sub(r"(?<!!)\[([^\]]+)\]\((?!https?:|#|[\w-]+\.md)[^)]+\)", r"\1", text)
    content[0] = text.replace("](#limits)", "](limits.md)")


def setup(app):
    """Connect what changes pages as they are read."""
    app.connect("include-read", links_as_on_the_site)
