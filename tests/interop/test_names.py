"""The package's namespace: listed names, and hints for names of other libraries."""

from __future__ import annotations

from collections import Counter

import pytest

import spatialdyn as sd
from spatialdyn.interop.names import NAMES, Aliases


def test_only_public_names_are_listed() -> None:
    assert set(dir(sd)) == {*sd.__all__, "__version__"}
    assert not [name for name in dir(sd) if type(getattr(sd, name)).__name__ == "module"]


def test_suggested_names_exist_and_no_name_leads_two_ways() -> None:
    assert set(NAMES) <= set(sd.__all__)
    words = Counter(word for others in NAMES.values() for word in {w.lower() for f in others for w in f.split()})
    assert [word for word, n in words.items() if n > 1] == []
    assert {word for word in words if word in sd.__all__} <= set(NAMES)


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("mass_matrix", "crba"),
        ("computeGeneralizedGravity", "generalized_gravity"),
        ("mj_inverse", "rnea"),
        ("gravload", "generalized_gravity"),
        ("jacob0", "frame_jacobian"),
        ("inverse_dynamics", "rnea"),
        ("coriolis_matrx", "coriolis_matrix"),
    ],
)
def test_names_of_other_libraries_lead_to_ours(name: str, ours: str) -> None:
    with pytest.raises(AttributeError, match=rf"no attribute '{name}', did you mean {ours}$"):
        getattr(sd, name)


def test_names_like_none_get_no_suggestion() -> None:
    with pytest.raises(AttributeError, match=r"no attribute 'zzz'$"):
        _ = sd.zzz
    assert not hasattr(sd, "_private")


def test_pinocchios_names_are_pinocchios() -> None:
    pin = pytest.importorskip("pinocchio")
    assert [w for others in NAMES.values() for w in others.pinocchio.split() if not hasattr(pin, w)] == []


def test_every_column_of_the_table_is_used() -> None:
    for column in Aliases._fields:
        assert any(getattr(others, column) for others in NAMES.values())
