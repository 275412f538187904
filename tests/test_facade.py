"""What `import hybridsens as hs` offers can be found: by TAB, by help, by an editor."""

import inspect
from pathlib import Path

import jedi
import pytest

import hybridsens as hs


@pytest.mark.parametrize("name", hs.__all__)
def test_a_public_name_has_a_docstring_of_its_own(name):
    """Not that of a base class or of its type, so that `help` says what it is."""
    value = getattr(hs, name)
    text = (
        value.__doc__ if inspect.ismodule(value) else value.__dict__.get("__doc__") if inspect.isclass(value) else None
    )
    text = inspect.getdoc(value) if inspect.isroutine(value) else text
    assert text and len(text) > 15 and not text.startswith(f"{name}(")


def test_tab_shows_what_is_public_and_no_more():
    """`dir` is `__all__` and the version; a name that there is not is an error."""
    assert sorted(dir(hs)) == sorted([*hs.__all__, "__version__"])
    assert len(set(hs.__all__)) == len(hs.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        hs.nothing  # noqa: B018


def test_an_editor_sees_every_public_name():
    """jedi, which IPython and other editors complete by, finds each name without running the package."""
    project = jedi.Project(Path(__file__).parents[1])
    source = "import hybridsens as hs\nhs."
    found = {completion.name for completion in jedi.Script(source, project=project).complete(2, 3)}
    assert set(hs.__all__) - found == set()


@pytest.mark.parametrize(("name", "argument"), [("simulate", "state"), ("fit", "data"), ("animate", "draw")])
def test_an_editor_shows_the_arguments(name, argument):
    """Of functions that are imported when first asked for, too."""
    project = jedi.Project(Path(__file__).parents[1])
    (signature, *_) = jedi.Script(f"import hybridsens as hs\nhs.{name}(", project=project).get_signatures()
    assert argument in {parameter.name for parameter in signature.params}


def test_the_package_says_that_it_is_typed():
    """A type checker reads the annotations of a package only where it finds this file."""
    assert (Path(hs.__file__).parent / "py.typed").is_file()
