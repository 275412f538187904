"""What the documentation shows is run, page by page, and prints what the page says."""

import re
from pathlib import Path

import pytest

import hybridsens
from hybridsens.scenes import SCENES

DOCS = Path(__file__).parents[2] / "docs"
PYTHON, PRINTED = re.compile(r"```python\n(.*?)```", re.DOTALL), re.compile(r"```text\n(.*?)```", re.DOTALL)
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")
PAGES = sorted(str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md") if PYTHON.search(page.read_text()))
QUICK = {"start.md"}
ELSEWHERE = {"hybrid_systems.md"}
"""Its closed form is met in test_readme.py."""


def _runs(page: str):
    return pytest.param(page, marks=() if page in QUICK else pytest.mark.slow)


@pytest.mark.parametrize("page", [_runs(page) for page in PAGES if page not in ELSEWHERE])
def test_the_code_of_a_page_runs_and_prints_what_it_says(page, monkeypatch, tmp_path, capsys):
    """All blocks of a page one after the other, in an empty folder."""
    monkeypatch.setattr(hybridsens, "configure", lambda: None)  # JAX has started in this process
    monkeypatch.chdir(tmp_path)
    text = (DOCS / page).read_text()
    names: dict = {"__name__": page}
    for block in PYTHON.findall(text):
        exec(compile(block, page, "exec"), names)
    lines = capsys.readouterr().out.splitlines()
    shown = [line for block in PRINTED.findall(text) for line in block.splitlines()]
    assert [line for line in shown if not any(_alike(line, printed) for printed in lines)] == []


def _alike(line: str, printed: str) -> bool:
    """Whether two lines have the same words, and numbers that are the same but for rounding."""
    if NUMBER.sub("#", line).split() != NUMBER.sub("#", printed).split():
        return False
    numbers = zip(NUMBER.findall(line), NUMBER.findall(printed), strict=True)
    return all(abs(float(a) - float(b)) <= 1e-9 + 1e-5 * abs(float(b)) for a, b in numbers)


def test_every_picture_and_page_that_the_docs_point_to_exists():
    """No link within the documentation leads nowhere."""
    links = [(page, link) for page in DOCS.rglob("*.md") for link in re.findall(r"\]\(([^)#\s]+)", page.read_text())]
    inner = [(page, link) for page, link in links if "://" not in link]
    assert len(inner) > 20
    assert [(page.name, link) for page, link in inner if not (page.parent / link).is_file()] == []


def test_every_public_name_has_its_place_in_the_reference():
    """Each name of the facade is put into a page of the reference by its docstring."""
    text = "\n".join(page.read_text() for page in (DOCS / "reference").glob("*.md"))
    documented = re.findall(r"^::: hybridsens\.(?:\w+\.)*(\w+)$", text, re.MULTILINE)
    assert sorted(documented) == sorted(hybridsens.__all__)


@pytest.mark.parametrize("name", hybridsens.__all__)
def test_every_public_name_is_used_in_an_example_of_its_page(name):
    """Behind its docstring there is code, which is run with the rest of the page."""
    entry = re.compile(
        rf"^::: hybridsens\.(?:\w+\.)*{name}\n(?:    [^\n]*\n)*\n```python\n(.*?)```", re.MULTILINE | re.DOTALL
    )
    (example,) = [code for page in (DOCS / "reference").glob("*.md") for code in entry.findall(page.read_text())]
    assert f"hs.{name}" in example


def test_the_reference_lists_every_status():
    """With what it means and what to do, as the message says it."""
    page = (DOCS / "reference" / "motions.md").read_text().lower()
    rows = [
        f"| `{name}` | {text}".lower()
        for name, text in zip(hybridsens.Status.names(), hybridsens.Status.messages(), strict=True)
    ]
    assert [row for row in rows if row not in page and "`running`" not in row] == []


def test_the_reference_says_which_scenes_the_command_line_runs():
    """Assert that it names those, and no others, in backquotes."""
    page = (DOCS / "reference" / "scenes.md").read_text()
    (sentence,) = re.findall(r"by name: (.*?)\.\s", page, re.DOTALL)
    assert re.findall(r"`(.*?)`", sentence) == [*SCENES]
