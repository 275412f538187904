"""Statuses of any motion know no contacts; mechanics adds its own, and all are of one kind."""

import importlib
import re
from pathlib import Path

import pytest

import hybridsens as hs
from hybridsens.mechanics.status import ContactStatus


def test_statuses_are_of_one_kind_and_mechanics_adds_its_own():
    """Those of any motion say nothing of contacts by themselves; what they mean in a scene is told behind it."""
    module = importlib.import_module("hybridsens.status")
    words = re.compile("contact|impact|captur|penetrat|restitution|mass|gap", re.IGNORECASE)
    assert not words.search(Path(module.__file__).read_text())
    added = {"gap_not_smooth", "penetration", "bad_restitution", "bad_mass_matrix"}
    assert added == {name for name in hs.Status.names() if name in vars(ContactStatus)}
    assert hs.Status.penetration == ContactStatus.penetration and hs.Status.penetration != hs.Status.grazing
    assert "capture_speed" in hs.Status.max_events_reached.message
    with pytest.raises(TypeError, match="must be compared with a status"):
        hs.Status.successful == 0  # noqa: B015
