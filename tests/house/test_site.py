"""The site: its reference has every public name, its links lead somewhere, it builds without a warning."""

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import exudyn as exu
import pytest
from exudyn.FEM import ObjectFFRFreducedOrderInterface

import exudyn_partition as ep
from validation import tutorials

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "examples" / "site"
PAGES = {path.stem: path.read_text() for path in sorted(SITE.glob("*.md"))}


def test_every_page_is_in_the_table_of_contents():
    lists = re.findall(r"\{toctree\}.*?\n\n(.*?)```", PAGES["index"], re.S)
    assert sorted(" ".join(lists).split()) == sorted({*PAGES, "gallery/index"} - {"index"})


def test_the_reference_has_every_public_name():
    modules = {getattr(ep, name).__name__.removeprefix("exudyn_partition."): name for name in ep.__all__
               if inspect.ismodule(getattr(ep, name))}  # fmt: skip
    listed = re.findall(r"^   (\w[\w.]*)$", PAGES["api"], re.M)
    assert sorted(modules.get(name, name) for name in listed) == ep.__all__


def test_arguments_of_exudyn_s_functions_exist():
    """As the page `ffrf` says."""
    known = set(inspect.signature(ep.CreatePartitionBody).parameters)
    for theirs in (
        exu.MainSystem.CreateFFRFReducedOrderObject,
        ObjectFFRFreducedOrderInterface.AddObjectFFRFreducedOrder,
    ):
        assert set(inspect.signature(theirs).parameters) - {"mbs", "self", "femInterface"} <= known


def test_what_pages_include_is_there():
    for name, page in PAGES.items():
        for file, options in re.findall(r"\{include\} (\S+)\n(.*?)```", page, re.S):
            text = (SITE / file).read_text()
            for mark in re.findall(r'^:(?:start-after|end-before): "(.*)"$', options, re.M):
                assert text.count(mark.replace("\\n", "\n")) == 1, (name, mark)


def test_sources_are_cited():
    text = "".join(path.read_text() for path in [*(ROOT / "exudyn_partition").rglob("*.py"), SITE / "theory.md"])
    for key, author in re.findall(r"^- \*\*\[(\w+)\]\*\* (?:[A-Z]\. )+([A-Z]\w+)", PAGES["bibliography"], re.M):
        assert author in text or key in text, author


def test_each_section_of_the_theory_is_where_docstrings_look_for_it():
    text = "".join(path.read_text() for path in (ROOT / "exudyn_partition").rglob("*.py"))
    cited = set(re.findall(r'examples/site/theory\.md, "(.+)"\.', text))
    assert len(cited) > 15
    assert cited <= set(re.findall(r"^###? (.+)$", PAGES["theory"], re.M))


def test_files_that_sources_cite_are_in_the_repository():
    files = [
        path for folder in ("exudyn_partition", "validation", "examples") for path in (ROOT / folder).rglob("*.py")
    ]
    names = {path.name for path in ROOT.rglob("*.md") if ".venv" not in path.parts} | {
        "report.md"
    }  # which a script writes
    for path in files:
        for name in re.findall(r"\b([\w-]+\.md)\b", path.read_text()):
            assert name in names, (path, name)


def test_each_source_of_the_theory_is_in_the_bibliography():
    for keys in re.findall(r"\{ref\}`\[([\w, ]+)\]", PAGES["theory"]):
        for key in keys.split(", "):
            assert f"**[{key}]**" in PAGES["bibliography"], key


def test_links_between_pages_lead_to_a_heading():
    """As the build holds too, where Sphinx is."""
    included = {"start": "A complete program", "limits": "", "contributing": "", "changes": ""}
    for name, text in PAGES.items():
        for page, anchor in re.findall(r"\]\(([\w-]+)\.md(?:#([\w-]+))?\)", text):
            headings = re.findall(r"^#+ (.+)$", PAGES[page] + f"\n# {included.get(page, '')}", re.M)
            anchors = {re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in headings}
            assert not anchor or anchor in anchors, (name, page, anchor)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the site, built without a warning and without a run of the examples."""
    for package in ("sphinx", "myst_nb", "numpydoc", "furo", "sphinx_design", "latex2mathml"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("built") / "site"
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-D", "run_examples=0", str(SITE), str(folder)]
    subprocess.run(command, check=True)
    return folder


def test_each_page_of_the_reference_has_an_example_and_its_source(site):
    pages = [path for path in (site / "reference").glob("*.html")]
    assert len(pages) == len(ep.__all__)
    for path in pages:
        text = path.read_text()
        assert ">Example</p>" in text, path.name
        assert "[source]" in text or "Module" in text or path.stem.split(".")[-1] in ("STEEL", "ALUMINIUM"), path.name
    contact = (site / "reference" / "exudyn_partition.CreatePartitionContact.html").read_text()
    assert 'href="exudyn_partition.RigidPlane.html' in contact  # types lead to their pages


@pytest.mark.parametrize(
    ("name", "way"),
    [
        ("contact", ["Contact"]),
        ("reference/exudyn_partition.reduce", ["API reference", "reduce"]),
        ("_modules/exudyn_partition/reduction/reduction", []),
    ],
)
def test_the_sidebar_leads_to_all_pages_and_shows_where_one_is(site, name, way):
    """`conf.py` makes it once for all of them."""
    page = site / f"{name}.html"
    tree = re.search(r'<div class="sidebar-tree">(.*?)</div>', page.read_text(), re.S)[1]
    links = [(page.parent / link).resolve() for link in re.findall(r'href="([^"#]+)"', tree)]
    every = {path.resolve() for folder in (".", "reference", "gallery") for path in (site / folder).glob("*.html")}
    beside = {site.resolve() / f"{other}.html" for other in ("index", "genindex", "search", "py-modindex")}
    assert {*links} == every - beside - {page.resolve()}
    marked = re.findall(r'<li class="[^"]*\bcurrent\b[^"]*"><a class="([^"]*)" href="([^"]*)">([^<]*)', tree)
    assert [text for *_, text in marked] == way
    assert [text for kind, link, text in marked if "current" in kind and link == "#"] == way[-1:]


def test_summaries_of_the_reference_are_whole_sentences(site):
    """Sphinx takes the full stop of "paper, eq. 30" for the end of one."""
    shown = (site / "api.html").read_text()
    assert not re.search(r"\beq\.\s*</p>", shown)
    assert re.search(r"\beq\. \d", shown)


def test_tutorials_have_what_their_script_keeps():
    """Each program that has marks shows what it printed, and each picture is there."""
    for page in tutorials.PAGES:
        shown = re.findall(rf"tutorials\.py, {page} \d+: begin -->\n```text\n(.+?)```", PAGES[page], re.S)
        assert len(shown) == PAGES[page].count(": begin -->") >= 2, page
        pictures = re.findall(r"\]\((tutorials/[\w.-]+)\)", PAGES[page])
        assert pictures, page
        assert all((SITE / picture).is_file() for picture in pictures)


def test_the_gallery_has_a_picture_and_the_costs_of_each_example():
    kept = json.loads((ROOT / "validation" / "gallery.json").read_text())
    names = {path.stem for path in (ROOT / "examples").glob("*.py")}
    assert set(kept) == names
    for name, one in kept.items():
        assert one["figures"], name
        assert all((SITE / "full" / figure).stat().st_size < 200_000 for figure in one["figures"]), name
        assert one["seconds"] > 0, name
    assert {path.name for path in (SITE / "full").iterdir()} == {f for one in kept.values() for f in one["figures"]}


@pytest.mark.parametrize("width", [1300, 390])
def test_no_name_is_broken_in_the_sidebar_and_phones_need_no_scrolling(site, opened, width):
    for name in ("reference/exudyn_partition.CreatePartitionContact.html", "gallery/index.html"):
        page, faults = opened(site / name, width=width, ready="document.readyState === 'complete'")
        lines = page.evaluate(
            """[...document.querySelectorAll('.sidebar-tree a, .toc-tree a')].map(link => {
                const range = document.createRange();
                range.selectNodeContents(link);
                const tops = [...range.getClientRects()].map(box => Math.round(box.top / 8));
                return [link.textContent.trim(), new Set(tops).size];
            })"""
        )
        assert len(lines) > 20
        assert [text for text, count in lines if count > 1 and " " not in text] == []
        assert page.evaluate("document.documentElement.scrollWidth") == width
        assert faults == []


@pytest.mark.parametrize("name", ["pictures-and-output", "damping", "twelve-names", "genindex"])
def test_tables_of_words_fit_a_phone(site, opened, name):
    """With long calls in their first column."""
    page, faults = opened(site / f"{name}.html", width=390, ready="document.readyState === 'complete'")
    cells = "[...document.querySelectorAll('article td')].map(cell => cell.getBoundingClientRect().right)"
    assert max(page.evaluate(cells)) <= 390
    assert faults == []


def test_nothing_in_the_site_comes_from_elsewhere(site):
    """When a page is shown; formulas are MathML."""
    pages = {path.name: path.read_text() for path in site.rglob("*.html")}
    assert pages["theory.html"].count("<math ") > 200
    for name, text in pages.items():
        assert not re.findall(
            r"<(?:script|link|img)[^>]* (?:src|href)=\"(?:https?:)?//[^\"]*\.(?:js|css|png|svg)", text
        ), name


def test_a_broken_link_fails_the_build(tmp_path):
    """With the site's own settings: to a page, a heading here, one of another page, and a label."""
    for package in ("sphinx", "latex2mathml"):
        pytest.importorskip(package)
    (tmp_path / "index.md").write_text("# Title\n\n[a](no.md) [b](#none) [c](index.md#none) {ref}`none` [d](#title)\n")
    options = ["-W", "--keep-going", "-q", "-c", str(SITE), "-D", "run_examples=0"]
    command = [sys.executable, "-m", "sphinx", *options, str(tmp_path), str(tmp_path / "site")]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.count("WARNING") == 4
