"""One field proves bounds of many labellings: against the bounds computed for each of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import grid_assembly
from jld_core import Assembly
from jld_core.fields import bounds

PUSHED: list[dict[str, Any]] = [{"element": "c1r0", "force": [0.3, -1], "at": [0.15, 0.3]}]
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "friction": {"inner_friction": 0.4, "tension": 4e5},
    "crushing": {"crush_dry": 3e5, "crush_inner": 4e5},
    "cohesion": {"cohesion": 2e4},
}


def frame(**more: Any) -> Assembly:
    return grid_assembly(["aaa", "aaa", "#.#"], live=PUSHED, **{"tension": 2e6, "shear": 2e5, **more})


@pytest.mark.parametrize("kind", KINDS)
def test_one_field_bounds_other_labellings(kind: str) -> None:
    """Upper bounds of mechanisms lie above every lower bound, those of the own labelling are the certified ones."""
    assembly = frame(**KINDS[kind])
    coarse = bounds.CoarseBounds(bounds.FieldSetting.of(assembly))
    rng = np.random.default_rng(3)
    labellings = rng.random((14, len(assembly.interfaces))) < 0.5
    lows, highs, mechanisms, stresses = [], [], [], []
    for labels in labellings:
        low, field = coarse.lower(labels)
        high, mechanism = coarse.upper(labels)
        lows.append(low)
        highs.append(high)
        if mechanism is not None:
            own = float(mechanism.bounds(labels[None])[0])
            assert high * (1 - 1e-9) <= own <= high + 1e-3 * abs(high)
            mechanisms.append(mechanism)
        if field is not None:
            assert field.bounds(labels[None])[0] == low
            stresses.append(field)
    above = np.min([one.bounds(labellings) for one in mechanisms], axis=0)
    below = np.max([one.bounds(labellings) for one in stresses], axis=0)
    # both programs are solved to their optimum on this mesh, so that no other field of the mesh is better
    assert (above >= np.array(highs) - 1e-6 * np.abs(highs)).all()
    assert (below <= np.array(lows) + 1e-6 * np.abs(lows)).all()
    assert np.isfinite(above).all()
    # a field does speak of others than its own labelling
    assert sum(np.isfinite(one.bounds(labellings)).sum() for one in mechanisms) > 2 * len(mechanisms)


@pytest.mark.parametrize("kind", KINDS)
def test_power_of_faces_is_that_of_the_certified_field(kind: str) -> None:
    """Each face weighed alone, against the power of the whole field computed under other labels."""
    assembly = frame(**KINDS[kind])
    setting = bounds.FieldSetting.of(assembly)
    rng = np.random.default_rng(5)
    labels = rng.random(len(assembly.interfaces)) < 0.4
    fields = bounds.Fields.on(setting, setting.coarse, labels)
    assert fields.velocity is not None
    mechanism = fields.for_all[1]
    assert mechanism is not None
    upper = fields.upper
    compared = 0
    for _ in range(12):
        other = rng.random(len(labels)) < 0.5
        bound = float(mechanism.bounds(other[None])[0])
        opened = upper.certify(fields.velocity.velocity, other)
        if np.isfinite(bound) and opened is not None:
            # certify moves the field, but never above what it was given, up to what opens still faces
            assert opened.factor * setting.units.load <= bound + 2e-3 * abs(bound)
            compared += 1
    assert compared >= 3


def test_a_face_that_may_be_dry() -> None:
    """A column pressed down: joints across it may be dry, glued cells beside one another by no stress at all."""
    assembly = grid_assembly(["ab", "ab", "##"], live=[{"body": [0, 1]}])
    labels = np.zeros(len(assembly.interfaces), dtype=bool)
    low, field = bounds.CoarseBounds(bounds.FieldSetting.of(assembly)).lower(labels)
    assert field is not None
    bed = np.array([abs(normal[1]) > 0.5 for normal in assembly.interfaces.normal])
    assert low > 1.0
    assert field.bounds(labels[None])[0] == low
    lifted = field.bounds((labels | bed)[None])[0]
    # lifted by more than its weight, no bed joint may be dry
    assert lifted == -np.inf
