"""Sphinx configuration of the site; `python -m sphinx -W -b html examples/site out/site` builds it."""

import functools
import re
import runpy
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert
from numpydoc.xref import DEFAULT_LINKS
from sphinx.environment.adapters.toctree import global_toctree_for_doc
from sphinx.ext import autosummary

import exudyn_partition

project = "exudyn_partition"
author = copyright = "The exudyn_partition developers"
release = exudyn_partition.__version__
extensions = ["myst_nb", "numpydoc", "sphinx.ext.autosummary", "sphinx.ext.viewcode", "sphinx_design"]
html_math_renderer = "mathml"  # which browsers show by themselves, without a script from elsewhere
exclude_patterns = ["templates"]
html_theme = "furo"
html_static_path, html_css_files = ["static"], ["site.css"]
html_title = f"exudyn_partition {release}"
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # pages include sections of README below a title of their own
nb_execution_timeout = 1800
nb_execution_raise_on_error = True
nb_merge_streams = True
templates_path = ["templates"]
autodoc_typehints = "none"  # docstrings have the types, with shapes and units
numpydoc_show_class_members = False
if tags.has("linked"):  # noqa: F821, Sphinx has it; `-t linked` asks these sites, and their names become links
    extensions.append("sphinx.ext.intersphinx")
    intersphinx_mapping = {
        "python": ("https://docs.python.org/3/", None),
        "numpy": ("https://numpy.org/doc/stable/", None),
        "scipy": ("https://docs.scipy.org/doc/scipy/", None),
        "matplotlib": ("https://matplotlib.org/stable/", None),
        "pandas": ("https://pandas.pydata.org/docs/", None),
    }
numpydoc_xref_param_type = True  # types of parameters lead to their pages
numpydoc_xref_ignore = "all"  # but those that follow
numpydoc_xref_aliases = {name: name for name in DEFAULT_LINKS}  # which lead to other sites
numpydoc_xref_aliases |= {
    name: f"exudyn_partition.{name}" for name in exudyn_partition.__all__ if name[0].isupper() and not name.isupper()
}
autosummary.WELL_KNOWN_ABBREVIATIONS += ("eq.",)  # summaries of the reference do not end at it
linkcheck_timeout, linkcheck_retries = 20, 2  # seconds; of `-b linkcheck`, which asks the pages that ours link to


def links_as_on_the_site(app, relative_path, parent_docname, content):
    """In included pages: link to pages of the site, and take away links to files that it does not hold."""
    text = re.sub(r"\]\(examples/site/([\w-]+\.md)", r"](\1", content[0])
    text = re.sub(r"(?<!!)\[([^\]]+)\]\((?!https?:|#|[a-z_-]+\.md)[^)]+\)", r"\1", text)
    content[0] = text.replace("](#limits)", "](limits.md)")


def examples():
    """Lines of the short examples in api_examples.py, by the name that they show."""
    blocks = re.split(
        r"^# %% ?(.*)\n", Path(__file__).with_name("api_examples.py").read_text(encoding="utf-8"), flags=re.M
    )
    shown = {}
    for names, block in zip(blocks[3::2], blocks[4::2], strict=True):  # after the imports
        shown |= dict.fromkeys(names.split(", "), block.strip().splitlines())
    return shown


def add_example(app, what, name, thing, options, lines):
    """Show the example of a public name beneath its docstring."""
    short = (
        re.sub(r"^exudyn_partition\.(?:.*\.)?", "", name)
        if what == "module"
        else name.removeprefix("exudyn_partition.")
    )
    short = {"compare": "report"}.get(short, short) if what == "module" else short
    if short in EXAMPLES:
        lines += [
            "",
            ".. rubric:: Example",
            "",
            ".. code-block:: python",
            "",
            *(f"   {line}" for line in EXAMPLES[short]),
        ]


@functools.cache
def tree(builder, **options):
    """Tree of the sidebar as the front page shows it. To make it for each page takes long."""
    found = global_toctree_for_doc(builder.env, "index", builder, tags=builder.tags, **options)
    return builder.render_partial(found)["fragment"]


def tree_of(builder, page, **options):
    """Tree of the sidebar as a page shows it: links that begin there, and the way to the page marked as current."""
    up, own, above, marked = "../" * page.count("/"), builder.get_target_uri(page), {}, set()
    entry = re.compile(r'<li class="toctree-l(\d)"><a class="reference internal" href="([^"#:]+)"')
    for found in entry.finditer(shown := tree(builder, **options)):
        above = {level: start for level, start in above.items() if level < found[1]} | {found[1]: found.start()}
        if found[2] == own:
            marked |= {*above.values()}

    def turned(found):
        way = " current" if found.start() in marked else ""
        here, to = ("current ", "#") if found[2] == own else ("", up + found[2])
        return f'<li class="toctree-l{found[1]}{way}"><a class="{here}reference internal" href="{to}"'

    return entry.sub(turned, shown)


def take_tree(app, pagename, templatename, context, doctree):
    """Let furo take the tree that was made once."""
    context["toctree"] = functools.partial(tree_of, app.builder, pagename)


def write_formula(translator, node):
    """Write a formula of a page as MathML."""
    if isinstance(node, nodes.math_block):  # furo scrolls it, upwards too where its font is high
        formula = convert(node.astext(), display="block").replace("<math ", '<math style="overflow: visible" ', 1)
        translator.body.append(f'<div class="math" style="overflow: auto hidden; padding-block: 0.5em">{formula}</div>')
    else:
        translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def run_the_notebook_or_not(app, config):
    """The tutorial runs where the examples do."""
    config.nb_execution_mode = "force" if config.run_examples else "off"


EXAMPLES = examples()


def setup(app):
    """Connect what writes pages, and what changes them as they are read."""
    app.add_html_math_renderer("mathml", (write_formula, None), (write_formula, None))
    app.add_config_value("run_examples", True, "env", [bool])
    app.connect("config-inited", run_the_notebook_or_not)
    app.connect("builder-inited", runpy.run_path(str(Path(__file__).with_name("gallery.py")))["write_pages"])
    app.connect("autodoc-process-docstring", add_example, priority=900)  # after numpydoc
    app.connect("html-page-context", take_tree, priority=400)  # before furo
    app.connect("include-read", links_as_on_the_site)
