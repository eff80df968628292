"""Files that make a reader expand or loop without end are refused in one line."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

from jld_core import InputError, parse_scene
from jld_core.exchange import ImportOptions, import_file
from jld_core.exchange.libraries import in_own_process

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">'


def bomb(levels: int, copies: int, href: str = "xlink:href") -> str:
    """An SVG in which each of some levels copies the one before several times."""
    groups = ['<rect id="l0" width="1" height="1"/>']
    for k in range(1, levels + 1):
        groups.append(f'<g id="l{k}">' + f'<use {href}="#l{k - 1}"/>' * copies + "</g>")
    return HEAD + "".join(groups) + "</svg>"


@pytest.mark.parametrize(("levels", "copies"), [(9, 10), (30, 2), (3, 60), (400, 3)])
@pytest.mark.parametrize("href", ["xlink:href", "href"])
def test_copies_of_copies_are_counted_before_they_are_made(levels: int, copies: int, href: str, tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path = tmp_path / "bomb.svg"
    path.write_text(bomb(levels, copies, href))
    with pytest.raises(InputError, match=r"it expands to .* shapes by <use>; expected at most"):
        import_file(path)


def test_a_copy_of_itself_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path = tmp_path / "loop.svg"
    path.write_text(HEAD + '<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g></svg>')
    with pytest.raises(InputError, match="contains itself"):
        import_file(path)


def test_a_few_copies_are_no_fault(tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path = tmp_path / "few.svg"
    path.write_text(HEAD + '<rect id="supports" width="1" height="1"/><rect y="1" width="1" height="1"/>' + "</svg>")
    with pytest.raises(InputError, match="support"):  # read, and it has no support
        import_file(path)


def test_a_reader_that_does_not_end_is_ended() -> None:
    with pytest.raises(InputError, match="does not end in 1 s"):
        in_own_process(time.sleep, 60.0, seconds=1.0)


def test_a_reader_that_breaks_down_is_a_line() -> None:
    import os

    with pytest.raises(InputError, match="its reader broke down"):
        in_own_process(os._exit, 3, seconds=60.0)


def test_results_and_errors_come_back() -> None:
    """In a forked process, and in a new one where there is no fork."""
    assert in_own_process(pow, 2, 5, seconds=60.0) == 32
    with pytest.raises(ZeroDivisionError):
        in_own_process(divmod, 1, 0, seconds=60.0)


def test_where_processes_cannot_be_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "other")
    test_results_and_errors_come_back()
    test_a_reader_that_does_not_end_is_ended()


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_3dm_ends(seed: int, tmp_path: Path) -> None:
    """Bytes of a Rhino file changed at random: read, or refused in one line."""
    rhino = pytest.importorskip("rhino3dm")
    model = rhino.File3dm()
    for k in range(3):
        line = rhino.Polyline(5)
        for x, y in [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]:
            line.Add(x + k, y, 0.0)
        model.Objects.AddCurve(line.ToPolylineCurve())
    path = tmp_path / "a.3dm"
    assert model.Write(str(path), 8)
    content = bytearray(path.read_bytes())
    for place in range(200 + 37 * seed, len(content), 997):
        content[place] ^= 0x5A
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:  # it has no support in any case
        import_file(path)
    assert "\n" not in str(caught.value)


def test_too_many_forces_and_chords_are_refused_with_their_number(tmp_path: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    document = {
        "name": "cart",
        "grid": {"cell": [1, 1], "rows": ["a", "#"]},
        "materials": {"density": 1, "dry": {"friction_coefficient": 0.5}},
        "loads": {"moving": [{"path": [[0, 2], [1, 2]], "axles": [{"weight": 1.0}] * 100_000, "steps": 1000}]},
    }
    with pytest.raises(InputError, match="100000 axles at 1000 positions are 100000000 forces; expected at most"):
        parse_scene(document)
    drawing = ezdxf.new()
    for k in range(60):
        for j in range(50):
            drawing.modelspace().add_circle((3.0 * k, 3.0 * j), 1.0)
    drawing.saveas(tmp_path / "circles.dxf")
    with pytest.raises(InputError, match=r"its arcs are 1\.\d+e\+07 chords within 1e-07"):
        import_file(tmp_path / "circles.dxf", ImportOptions(facet=1e-7, unit="m"))


def test_blocks_in_blocks_are_counted_before_they_are_made(tmp_path: Path) -> None:
    """Ten levels of ten copies each are ten thousand million squares."""
    ezdxf = pytest.importorskip("ezdxf")
    document = ezdxf.new()
    block = document.blocks.new("B0")
    block.add_lwpolyline([(0, 0), (1, 0), (1, 1), (0, 1)], close=True)
    for level in range(1, 11):
        block = document.blocks.new(f"B{level}")
        for k in range(10):
            block.add_blockref(f"B{level - 1}", (k * 10**level, 0))
    document.modelspace().add_blockref("B10", (0, 0))
    document.saveas(tmp_path / "bomb.dxf")
    with pytest.raises(InputError, match="at most 50000 entities"):
        import_file(tmp_path / "bomb.dxf")


@pytest.mark.parametrize(
    ("ending", "words"), [("dwg", "a DXF"), ("skp", "an OBJ"), ("fcstd", "a STEP"), ("zip", "one of")]
)
def test_files_of_other_kinds_are_refused_with_what_to_save_instead(ending: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_bytes(b"PK\x03\x04")
    with pytest.raises(InputError, match=f"not read; expected {words}"):
        import_file(path)
