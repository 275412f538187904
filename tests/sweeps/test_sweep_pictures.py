"""Maps and diagrams show what the sweep found, and the command line makes them."""

import inspect

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import hybridsens
from hybridsens.scenes import ElasticStop
from hybridsens.sweeps import grid, plot_bifurcation, plot_sweep, sweep
from hybridsens.sweeps.plot import border_lines, draw_map


def test_borders_lie_between_points_with_different_sequences():
    """Assert that the sides of one odd cell, and no others, are drawn."""
    sequence = np.array([[1, 1, 1], [1, 2, 1], [1, 1, 1]])
    sides = {tuple(map(tuple, line)) for line in border_lines(np.arange(4.0), np.arange(4.0), sequence)}
    assert sides == {((1, 1), (1, 2)), ((2, 1), (2, 2)), ((1, 1), (2, 1)), ((1, 2), (2, 2))}


def test_a_map_of_unsorted_values_is_that_of_sorted_ones():
    """Assert that each cell lies around its own point, whatever the order of the grid."""
    scene = {"a": jnp.array(1.0), "b": jnp.array(1.0)}
    found = sweep(lambda s: 10 * s["a"] + s["b"], grid(scene, {"a": [3.0, 1.0, 2.0], "b": [2.0, 1.0]}), progress=False)
    cells = plot_sweep(found).axes[0].collections[0]
    np.testing.assert_array_equal(cells.get_array().reshape(2, 3), [[11, 21, 31], [12, 22, 32]])
    np.testing.assert_array_equal(cells.get_coordinates()[0, :, 0], [0.5, 1.5, 2.5, 3.5])


def test_a_derivative_of_zero_is_no_failed_point():
    """Assert that a failed point alone is blank, and that a zero has the colour below all others."""
    values = xr.DataArray([[np.nan, 0.0], [0.5, 2.0]], {"a": [1.0, 2.0], "b": [1.0, 2.0]}, ("a", "b"), "dJ_da")
    axes = Figure().subplots()
    draw_map(axes, values, logarithmic=True)
    (cells,) = axes.collections
    colours = cells.to_rgba(cells.get_array().reshape(2, 2).T)
    assert [[colour[3] > 0 for colour in row] for row in colours] == [[False, True], [True, True]]
    assert colours[0, 1].tolist() == colours[1, 0].tolist() != colours[1, 1].tolist()


def test_a_map_shows_value_both_derivatives_and_needs_two_parameters():
    """Assert that one map each of J and its two derivatives holds the numbers of the Dataset, and a line has no map."""
    scene = {"a": jnp.array(1.0), "b": jnp.array(1.0), "c": jnp.array(1.0)}
    axis = np.linspace(1, 2, 5)
    found = sweep(lambda s: s["a"] * s["b"] ** 2 + s["c"], grid(scene, {"a": axis, "b": axis[:4]}), progress=False)
    maps = [axes for axes in plot_sweep(found).axes if axes.get_title()]
    assert [axes.get_title() for axes in maps] == ["J", "|dJ/d a|", "|dJ/d b|"]
    np.testing.assert_array_equal(maps[2].collections[0].get_array().reshape(4, 5), abs(found.dJ_db.values.T))
    with pytest.raises(ValueError, match="must have a grid of two parameters"):
        plot_sweep(found.isel(a=0))


def test_a_map_over_an_entry_shows_the_derivative_by_it():
    """Assert that of an array's derivative the entry that is varied is drawn."""
    scene = {"a": jnp.array(1.0), "m": jnp.ones((1, 2))}
    design = grid(scene, {"a": [1.0, 2.0], "m[0, 1]": [1.0, 2.0, 3.0]})
    found = sweep(lambda s: s["a"] * s["m"][0, 1] ** 2 + s["m"][0, 0], design, progress=False)
    maps = {axes.get_title(): axes for axes in plot_sweep(found).axes if axes.get_title()}
    assert list(maps) == ["J", "|dJ/d a|", "|dJ/d m[0, 1]|"]
    cells = maps["|dJ/d m[0, 1]|"].collections[0].get_array().reshape(3, 2)
    np.testing.assert_allclose(cells, 2 * np.outer([1.0, 2.0, 3.0], [1.0, 2.0]))


def test_a_map_of_one_number_says_it_and_a_logarithmic_one_has_both_ends():
    """Assert that no bar shows numbers that are not there, and that ticks beside a logarithmic bar do not run into each
    other."""
    coords = {"a": [1.0, 2.0], "b": [1.0, 2.0]}
    array = lambda values, name: xr.DataArray(values, coords, ("a", "b"), name)
    figure = Figure()
    counts, none, narrow, wide = figure.subplots(1, 4)
    draw_map(counts, array([[3, 3], [3, 3]], "event_count"))
    draw_map(none, array([[0.0, 0.0], [0.0, 0.0]], "dJ_dc"), logarithmic=True)
    draw_map(narrow, array([[0.89, 1.3], [1.9, 1.1]], "dJ_da"), logarithmic=True)
    draw_map(wide, array([[1e-9, 1], [0, 9]], "dJ_db"), logarithmic=True)
    figure.draw_without_rendering()
    shown = [[label.get_text() for label in bar.get_yticklabels()] for bar in figure.axes[4:]]
    assert shown[0] == ["0.89", "1", "1.9"]
    assert (shown[1][0], shown[1][-1]) == ("1e-09", "9") and 4 < len(shown[1]) < 9
    assert [axes.texts[0].get_text() for axes in (counts, none)] == ["3", "0"]


def test_a_derivative_of_both_signs_is_drawn_with_its_sign():
    """Zero is white, and a single huge one does not take the colours of all others."""
    a, b = np.linspace(-1, 1, 8), np.linspace(0, 1, 9)
    derivative = np.tile(2 * a[:, None], (1, 9))
    derivative[2, 3] = -300.0
    found = xr.Dataset({"J": (("a", "b"), derivative**2), "dJ_da": (("a", "b"), derivative)}, {"a": a, "b": b})
    panel, bar = plot_sweep(found).axes[1:4:2]
    assert panel.get_title() == "dJ/d a"
    norm, cells = panel.collections[0].norm, panel.collections[0].get_array()
    assert norm.vmax == -norm.vmin == 20 and cells.min() == -300
    assert norm(0.0) == 0.5 and norm(2.0) > 0.8


def test_lines_are_spoken_of_where_there_are_any():
    """Where all points have one sequence of events, none is drawn, nor where each has its own and they would hide the
    map."""
    lines, none = "lines: between sequences of events", "almost each point has a sequence of its own"
    for sequence, words in (
        (np.zeros((2, 2)), ""), (np.eye(2), lines), (np.eye(9), lines), (np.arange(81).reshape(9, 9), none),
    ):  # fmt: skip
        coords = {dim: np.arange(len(sequence)) for dim in "ab"}
        grid = {"J": (("a", "b"), np.ones(sequence.shape)), "event_sequence": (("a", "b"), sequence)}
        figure = plot_sweep(xr.Dataset(grid, coords))
        assert figure.get_supxlabel() == words
        drawn = [part.get_segments() for part in figure.axes[0].collections if isinstance(part, LineCollection)]
        assert bool(*drawn) == (words == lines)


@pytest.mark.slow
def test_a_bifurcation_diagram_shows_period_one_where_the_motion_repeats():
    """Assert that without impacts the state once a period is the linear oscillator's, also on the picture."""

    def stroboscope(stop):
        period = 2 * jnp.pi / stop.frequency
        ts = period * jnp.arange(30, 33)
        trajectory = hybridsens.simulate(
            stop, stop.initial_state(), t1=33.5 * period, ts=ts, max_events=2, max_steps=4096, throw=False
        )
        return trajectory.final.q[0], trajectory

    frequencies = np.array([2.0, 2.5, 3.0])
    far = ElasticStop(distance=10.0, damping=1.0)
    found = sweep(stroboscope, grid(far, {"frequency": frequencies}), gradient=False, states=True, progress=False)
    amplitude = 1 / ((1 - frequencies**2) + 1j * frequencies)  # q = Re(amplitude exp(i Omega t))
    expected = np.repeat(amplitude.real[:, None], 3, axis=1)
    np.testing.assert_allclose(found.q[..., 0], expected, atol=1e-7)
    axes = plot_bifurcation(found).axes[0]
    drawn = axes.lines[0]
    assert axes.get_ylabel() == "displacement [m], sampled"
    assert plot_bifurcation(found, "v").axes[0].get_ylabel() == "displacement rate [m/s], sampled"
    np.testing.assert_allclose(drawn.get_ydata(), expected.ravel(), atol=1e-7)
    np.testing.assert_array_equal(drawn.get_xdata(), np.repeat(frequencies, 3))
    np.testing.assert_allclose(found.sample_time, (2 * np.pi / frequencies)[:, None] * np.arange(30, 33))
    with pytest.raises(ValueError, match="the sweep kept none"):
        plot_bifurcation(found.drop_vars(["q", "v"]), axes=Figure().subplots())


@pytest.mark.parametrize("state, dims", [("x", ()), ("x.v", ()), ("x.r", ("x.r_0",))])
def test_a_bifurcation_diagram_of_a_system_takes_a_leaf_of_its_state(state, dims):
    """A number as it is, and of an array the component asked for."""
    values = np.arange(12.0).reshape(2, 3, 2)
    leaf = xr.DataArray(values if dims else values[..., 1], {"a": [1.0, 2.0]}, ("a", "sample", *dims))
    axes = plot_bifurcation(xr.Dataset({state: leaf}), component=1).axes[0]  # the only one is meant
    assert axes.lines[0].get_ydata().tolist() == values[..., 1].ravel().tolist()
    assert axes.get_ylabel() == (f"{state}[1], sampled" if dims else f"{state}, sampled")
    several = xr.Dataset({state: leaf, "x.other": leaf, "sample_time": leaf})
    with pytest.raises(ValueError, match=f"is not told which: say state='{state}', state='x.other'"):
        plot_bifurcation(several)
    if dims:
        with pytest.raises(ValueError, match="`component` must be one of the 2 of"):
            plot_bifurcation(xr.Dataset({state: leaf}), component=2)


@pytest.mark.slow
def test_the_command_writes_a_dataset_and_a_picture(tmp_path, capsys):
    """Assert that `hybridsens sweep` gives the same J as the library, says how points ended, and draws the map."""
    from hybridsens.cli.sweep import sweep as command

    output, picture = tmp_path / "sweep.nc", tmp_path / "map.png"
    vary = ["amplitude=0.5:1.5:3", "frequency=1.2:1.4:2"]
    command("elastic-stop", vary, output, plot=picture, t1=5.0, events=3, max_events=8, max_steps=256)
    stop = ElasticStop(amplitude=1.5, frequency=1.2)
    trajectory = hybridsens.simulate(
        stop, stop.initial_state(), t1=5.0, running_cost=lambda s, t, q, v: q @ q, max_events=8, max_steps=256
    )
    with xr.open_dataset(output) as found:
        np.testing.assert_allclose(found.J.sel(amplitude=1.5, frequency=1.2), trajectory.cost, rtol=1e-12)
        assert found.amplitude.attrs["units"] == "N" and found.sizes["event"] == 3
    assert picture.stat().st_size > 10_000 and "successful" in capsys.readouterr().out


def test_the_command_has_the_room_of_a_simulation():
    """Assert that a point which succeeds in Python does so in a terminal, where less room is asked for."""
    from hybridsens.cli.sweep import sweep as command

    defaults = [inspect.signature(of).parameters for of in (command, hybridsens.simulate)]
    assert [[of[name].default for name in ("max_events", "max_steps")] for of in defaults] == [[256, 4096]] * 2


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ("amplitude", "must have the form"),
        ("amplitude=1:2", "a grid needs NAME=LOW:HIGH:COUNT"),
        ("a=1:2:2.5", "must have the form"),
    ],
)
def test_the_command_explains_a_bad_range(vary, words, tmp_path):
    """Assert that a range that cannot be read is refused in one line."""
    import typer

    from hybridsens.cli.sweep import sweep as command

    with pytest.raises(typer.BadParameter, match=words):
        command("elastic-stop", [vary], tmp_path / "sweep.nc")
