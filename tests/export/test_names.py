"""What coordinates and their rates are called."""

import types

from hybridsens.export.names import coordinate_names


def test_a_rate_has_the_unit_of_its_coordinate_by_the_second():
    """Of what is counted by seconds, what is left: a flux linkage changes by a voltage."""
    scene = types.SimpleNamespace(coordinates=("flux [V s]", "y [m]"))
    assert coordinate_names(scene, 2) == (["flux [V s]", "y [m]"], ["flux rate [V]", "y rate [m/s]"])
