"""What the README shows is run."""

import inspect
import json
import re
import textwrap
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens
from hybridsens.cli.main import run

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


def _blocks(path: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / path).read_text(), re.DOTALL)


EXAMPLES = _blocks("README.md")


def _height_after_one_impact(weight, e):
    """Closed form of the example: a unit mass from height 1 at rest, one impact, at time 1."""
    fall = jnp.sqrt(2 / weight)
    return e * weight * fall * (1 - fall) - weight * (1 - fall) ** 2 / 2


def test_the_example_prints_the_closed_form_gradient(monkeypatch, capsys):
    """The example of the README runs as it stands, prints what is shown, and has the closed form's gradient."""
    monkeypatch.setattr(hybridsens, "configure", lambda: None)  # JAX has started in this process
    (code,) = EXAMPLES
    names: dict = {}
    exec(code, names)
    (answer,) = re.findall(r"```text\n(.*?)```", README, re.DOTALL)
    assert capsys.readouterr().out == answer
    expected = jax.grad(_height_after_one_impact, argnums=(0, 1))(9.81, 0.8)
    gradient = names["gradient"]
    np.testing.assert_allclose([gradient.weight, gradient.e], expected, rtol=1e-7)


@pytest.mark.slow
def test_from_the_readme_to_a_fitted_parameter_of_a_scene_of_one_s_own(tmp_path, capsys):
    """The class of the README in a file of one's own, with a start and guesses, fitted to a record by the command line:
    the restitution with which the record was made, by its closed form, comes back."""
    (code,) = EXAMPLES
    own = tmp_path / "own.py"
    own.write_text(
        code.partition("def height")[0] + "class Dropped(Ball):\n"
        "    weight: float = 9.81\n    e: float = 0.6\n"
        "    def initial_state(self): return hs.State([1.0], [0.0])\n"
    )
    t, fall = np.linspace(0.05, 0.9, 18), np.sqrt(2 / 9.81)
    flight = np.maximum(t - fall, 0)
    heights = np.where(t < fall, 1 - 9.81 * t**2 / 2, 0.8 * 9.81 * fall * flight - 9.81 * flight**2 / 2)
    record = tmp_path / "record.csv"
    record.write_text("\n".join(["t,q0", *(f"{a:.17g},{b:.17g}" for a, b in zip(t, heights, strict=True))]))
    assert run(["fit", f"{own}:Dropped", "--data", str(record), "--sigma", "0.001", "--parameters", "e", "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["parameters"]
    assert found["name"] == "e" and abs(found["value"] - 0.8) < 1e-6
    assert found["interval_95"][0] < 0.8 < found["interval_95"][1]


def test_the_control_with_knots_has_the_closed_form_gradient():
    """A unit mass from rest under a piecewise linear control u: q(2) is the integral of (2 - t) u(t).

    That of a hat over a knot t_j is h (2 - t_j), at the ends h / 2 (2 - t) but for the half hat's own first moment,
    h^2 / 6."""
    names: dict = {}
    exec(_blocks("docs/howto/controls.md")[-1], names)
    by_values = jax.grad(names["distance"])(names["Cart"](jnp.linspace(0.0, 2.0, 5), jnp.zeros(5))).values
    h, hats = 0.5, 2 - np.linspace(0.0, 2.0, 5)
    expected = h * hats
    expected[0], expected[-1] = h * 2 / 2 - h**2 / 6, h**2 / 6
    np.testing.assert_allclose(by_values, expected, rtol=1e-7)


@pytest.mark.slow
def test_the_periodic_orbit_has_its_closed_form(monkeypatch):
    """A ball that comes back after a period has v = weight / 2; its impact turns v round if the table moves at
    u = weight (1 - e) / (1 + e) / 2 = 2 pi a cos(2 pi t). Its multipliers are a complex pair of the product e^2."""
    monkeypatch.setattr(hybridsens, "configure", lambda: None)
    names: dict = {}
    for code in _blocks("docs/howto/periodic.md"):
        exec(code, names)

    def exact(table):
        u = table.weight * (1 - table.e) / (1 + table.e) / 2
        return jnp.stack([jnp.arccos(u / (2 * jnp.pi * table.a)) / (2 * jnp.pi), table.weight / 2])

    table, orbit = names["table"], names["orbit"]
    np.testing.assert_allclose(orbit(table), exact(table), rtol=1e-8)
    found, expected = (jax.tree.leaves(jax.jacfwd(way)(table)) for way in (orbit, exact))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)
    assert abs(names["largest"](table) - table.e) < 1e-8
    np.testing.assert_allclose(jax.tree.leaves(jax.jacfwd(names["largest"])(table)), [0, 1, 0], atol=1e-6)


def test_the_neuron_has_the_closed_form_gradient(capsys):
    """Spike k comes log(i_k / (i_k - 1)) after the one before, with i_k = 1.6 + k w."""
    exec(_blocks("docs/howto/neuron.md")[0], {})
    third = lambda w: jnp.sum(jnp.log((1.6 + jnp.arange(3) * w) / (0.6 + jnp.arange(3) * w)))
    np.testing.assert_allclose(float(capsys.readouterr().out), jax.grad(third)(0.3), rtol=1e-7)


@pytest.mark.slow
def test_the_systems_of_the_docs_print_their_closed_forms(monkeypatch, capsys):
    """A thermostat switches on at log(10 / (low - 10)) / 0.3, low = 18; of a dose exp(-0.2 (24 - t)) is left; of
    an echo exp(-(1 - log 2 - delay)); what slides lets go at arcsin(1 / load); a cart goes to `far`
    and on to the wall under constant forces; another one loses friction times way of its energy; a tank is full at
    -10 log(1 - brim / 10)."""
    monkeypatch.setattr(hybridsens, "configure", lambda: None)
    names: dict = {}
    found, printed = [], []
    for code in _blocks("docs/hybrid_systems.md"):
        exec(code, names)
        printed += capsys.readouterr().out.splitlines()
        found += [float(word) for word in re.sub(r"[\[\]]", " ", printed[-1]).split()]
    left = 5 * np.exp(-0.2 * (24 - np.array([0.0, 8.0, 16.0])))

    def wall(far):
        speed = jnp.sqrt(4.0 * (far - 0.5))
        return speed / 2.0 + (speed - jnp.sqrt(speed**2 - 4.0 * (1.0 - far))) / 2.0

    def stopped(friction):
        after_two = 0.64 * (0.64 * (9 - 2 * friction) - 4 * friction)
        return -1 + after_two / (2 * friction)

    echo = 2 * np.exp(0.2 - 1)
    of_carts = jax.grad(wall)(0.85), stopped(1.0), jax.grad(stopped)(1.0)
    slides = np.cos(np.arcsin(1 / 1.4)) - np.cos(2.0)
    expected = [-1 / (0.3 * 8), left.sum(), *0.2 * left, echo, slides, *of_carts, 1 / 0.8]
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    shown = re.findall(r"```text\n(.*?)```", (ROOT / "docs/hybrid_systems.md").read_text(), re.DOTALL)
    assert [line for block in shown for line in block.splitlines() if line not in printed] == []


@pytest.mark.slow
def test_the_example_of_a_hybrid_system_is_a_ball():
    """What `help(AbstractHybridSystem)` shows runs: the ball falls for sqrt(2 / g), and is thrown up with 0.8 of it."""
    lines = inspect.cleandoc(hybridsens.AbstractHybridSystem.__doc__ or "").splitlines()
    names = {"jax": jax, "jnp": jnp, "hybridsens": hybridsens}
    exec(textwrap.dedent("\n".join(line for line in lines if line.startswith("    "))), names)
    events, fall = names["solution"].events, np.sqrt(2 / 9.81)
    np.testing.assert_allclose([events.time[0], events.after["speed"][0]], [fall, 0.8 * 9.81 * fall], rtol=1e-9)
    assert int(names["solution"].mode) == 1


@pytest.mark.slow
def test_the_sweep_of_the_docs_finishes_its_grid(monkeypatch, tmp_path):
    """It runs as it stands, with a value at every point."""
    monkeypatch.setattr(hybridsens, "configure", lambda: None)  # JAX has started in this process
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(_blocks("docs/howto/batches.md")[0], names)
    assert names["results"].J.shape == (3, 2)
    assert np.all(np.isfinite(names["results"].J))


def test_the_first_fifty_lines_hold_what_a_new_user_needs():
    """A picture that exists, both commands, and an example of at most 14 lines stand above the fold."""
    head = "\n".join(README.splitlines()[:50])
    (picture,) = re.findall(r"!\[[^\]]*\]\(([^)]*)\)", head)
    assert (ROOT / picture).is_file()
    assert len(re.findall(r"```bash\npython3 -m venv .*(?:demo|pytest)\n```", head)) == 2
    (example,) = re.findall(r"```python\n(.*?)```", head, re.DOTALL)
    assert len(example.splitlines()) <= 14


def test_every_file_that_the_readme_points_to_exists():
    """No link of the README leads nowhere."""
    links = [link for link in re.findall(r"\]\(([^)]*)\)", README) if "://" not in link]
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
