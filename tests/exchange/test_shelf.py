"""Files of other programs come in as they were drawn: number, size, unit, what is doubtful and what is dropped."""

from __future__ import annotations

from pathlib import Path

import pytest

from files.make import File, shelf
from jld_core import InputError, build_assembly, parse_scene
from jld_core.exchange import ImportOptions, import_file
from jld_core.exchange.options import measure
from jld_core.scene.units import METRES

for library in ("ezdxf", "svgelements", "meshio", "rhino3dm", "ifcopenshell"):
    pytest.importorskip(library)
SHELF = shelf()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("file", SHELF, ids=[file.name for file in SHELF])
def test_file(file: File, tmp_path: Path) -> None:
    path = tmp_path / file.name
    file.write(path)
    if file.refused:
        with pytest.raises(InputError) as caught:
            import_file(path, ImportOptions(**file.options))
        assert file.refused in str(caught.value)
        assert "\n" not in str(caught.value)
        return
    found = import_file(path, ImportOptions(**file.options))
    build_assembly(parse_scene(found.document))
    facts = found.facts()
    amount = facts.get("area", facts.get("volume"))
    near = pytest.approx(file.amount, rel=5e-3)
    assert (facts["elements"], facts["unit"], amount) == (file.elements, file.unit, near), found.report
    assert any(file.doubtful in words for words in facts["doubtful"]) == bool(file.doubtful), facts["doubtful"]
    assert any(file.dropped in words for words in facts["dropped"]) or not file.dropped, facts["dropped"]
    if file.whole is not None:
        entries = [{**entry, "support": False} for entry in found.document["elements"]]
        size = METRES[file.unit] ** (2 if "area" in facts else 3)
        assert measure(entries).amount == pytest.approx(size * file.whole(path), rel=5e-3)


def test_the_shelf_is_large_and_its_files_are_small(tmp_path: Path) -> None:
    assert len(SHELF) >= 120
    assert len({file.name for file in SHELF}) == len(SHELF)
