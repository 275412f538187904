"""What the README shows is run."""

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import hybridsens

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def _height_after_one_impact(weight, e):
    """Closed form of the example: a unit mass from height 1 at rest, one impact, at time 1."""
    fall = jnp.sqrt(2 / weight)
    return e * weight * fall * (1 - fall) - weight * (1 - fall) ** 2 / 2


def test_the_example_prints_the_closed_form_gradient(monkeypatch):
    """The example of the README runs as it stands, and its gradient is that of the closed form."""
    monkeypatch.setattr(hybridsens, "configure", lambda: None)  # JAX has started in this process
    code, _ = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict = {}
    exec(code, names)
    expected = jax.grad(_height_after_one_impact, argnums=(0, 1))(9.81, 0.8)
    gradient = names["gradient"]
    np.testing.assert_allclose([gradient.weight, gradient.e], expected, rtol=1e-7)


def test_the_study_sweeps_its_grid(monkeypatch):
    """The study of the README runs as it stands, and finishes every point of its grid."""
    monkeypatch.setattr(hybridsens, "configure", lambda: None)  # JAX has started in this process
    _, code = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict = {}
    exec(code.replace("print(", "dataset = ("), names)
    assert names["dataset"].J.shape == (3, 2)
    assert np.all(np.isfinite(names["dataset"].J))


def test_the_first_forty_lines_hold_what_a_new_user_needs():
    """A picture that exists, both commands, and an example of at most 12 lines stand above the fold."""
    head = "\n".join(README.splitlines()[:40])
    (picture,) = re.findall(r"!\[[^\]]*\]\(([^)]*)\)", head)
    assert (ROOT / picture).is_file()
    assert len(re.findall(r"```bash\npython3 -m venv .*(?:demo|pytest)\n```", head)) == 2
    (example,) = re.findall(r"```python\n(.*?)```", head, re.DOTALL)
    assert len(example.splitlines()) <= 12


def test_every_file_that_the_readme_points_to_exists():
    """No link of the README leads nowhere."""
    links = [link for link in re.findall(r"\]\(([^)]*)\)", README) if "://" not in link]
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
