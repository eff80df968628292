"""Files that make a reader expand or loop without end are refused in one line."""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from command import refused
from files.bombs import bombs
from jld_core import InputError, parse_scene
from jld_formats import ImportOptions, Notes, import_file, libraries

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">'

BOMBS = bombs()


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", BOMBS)
def test_what_expands_or_branches_ends_in_one_line(name: str, tmp_path: Path) -> None:
    for library in ("ezdxf", "svgelements", "meshio", "rhino3dm", "ifcopenshell"):
        pytest.importorskip(library)
    write, words = BOMBS[name]
    write(tmp_path / name)
    with refused(words):
        import_file(tmp_path / name)


@pytest.mark.skipif(sys.platform != "linux", reason="small files are read in this process where it cannot be copied")
def test_a_clock_says_how_far_the_reader_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(path: Path, options: ImportOptions, notes: Notes) -> None:
        for k in range(10_000):
            notes.reached("lines", k, 10_000)
            time.sleep(0.01)

    monkeypatch.setattr("jld_formats.read_mesh.read_mesh", slow)
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\n")
    seen: list[tuple[str, int]] = []
    said = r"reading it does not end in 2 s, \d+ of 10000 lines so far; expected more `seconds`"
    with pytest.raises(InputError, match=said):
        import_file(path, ImportOptions(seconds=2.0), progress=lambda what, done, total: seen.append((what, total)))
    assert set(seen) == {("lines", 10_000)}


def test_a_few_copies_are_no_fault(tmp_path: Path) -> None:
    pytest.importorskip("svgelements")
    path = tmp_path / "few.svg"
    path.write_text(HEAD + '<rect id="supports" width="1" height="1"/><rect y="1" width="1" height="1"/>' + "</svg>")
    with pytest.raises(InputError, match="support"):  # read, and it has no support
        import_file(path)


def test_a_reader_that_does_not_end_is_ended() -> None:
    with pytest.raises(InputError, match="does not end in 1 s"):
        libraries.in_own_process(time.sleep, 60.0, seconds=1.0)


def test_a_reader_that_breaks_down_is_a_line() -> None:
    with pytest.raises(InputError, match="its reader broke down"):
        libraries.in_own_process(os._exit, 3, seconds=60.0)


def test_results_and_errors_come_back() -> None:
    assert libraries.in_own_process(pow, 2, 5, seconds=60.0) == 32
    with pytest.raises(ZeroDivisionError):
        libraries.in_own_process(divmod, 1, 0, seconds=60.0)


def test_beside_a_running_thread_no_process_is_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the studio: a copy of a process with threads waited for ever for a lock of one of them."""
    monkeypatch.setattr(os, "fork", None)
    with ThreadPoolExecutor(2) as threads:
        for test in (
            test_results_and_errors_come_back,
            test_a_reader_that_does_not_end_is_ended,
            test_a_reader_that_breaks_down_is_a_line,
            test_results_and_errors_come_back,
        ):
            threads.submit(test).result()
        for _ in range(2):  # a process that waits for a file and is killed is replaced
            process = psutil.Process(threads.submit(libraries.in_own_process, os.getpid, seconds=60.0).result())
            process.kill()
            process.wait()


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
    with refused():
        import_file(path)


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


@pytest.mark.parametrize(
    ("ending", "words"), [("dwg", "a DXF"), ("skp", "an OBJ"), ("fcstd", "a STEP"), ("zip", "one of")]
)
def test_files_of_other_kinds_are_refused_with_what_to_save_instead(ending: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_bytes(b"PK\x03\x04")
    with pytest.raises(InputError, match=f"not read; expected {words}"):
        import_file(path)
