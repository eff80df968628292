"""A load on a block that is joined to a support: a file of blocks that could not be read again is not written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cases import box
from cases import scene_in_space as scene
from command import Command


@pytest.mark.parametrize("kind", ["compas", "compas_dem"])
@pytest.mark.parametrize("glued", [True, False])
def test_export_and_import_agree(kind: str, glued: bool, tmp_path: Path, jld: Command) -> None:
    """Both accept a load on the lower of two blocks, or both refuse it."""
    elements = [
        box("S", [0, 0, -1], [2, 1, 0], support=True),
        box("B", [0, 0, 0], [1, 1, 1]),
        box("C", [0, 0, 1], [1, 1, 2]),
    ]
    live = [{"element": name, "force": [1, 0, 0]} for name in ("B", "C")]
    source, target, back = tmp_path / "s.json", tmp_path / "blocks.json", tmp_path / "back.json"
    source.write_text(json.dumps(scene(elements, live=live, labels={"inner": [["S", "B"]]} if glued else {})))
    written = jld("export", source, "--format", kind, "-o", target)
    if glued:
        assert written.code == 2
        assert "element 'B': it carries a load and is joined to a support" in written.err
        assert not target.exists()
    else:
        assert written.code == 0
        assert jld("import", target, "-o", back).code == 0
