"""Reading files: time and memory of bombs, and of large files.

`python -m benchmarks.imports [shelf|bombs]` writes a table for each part. Each bomb or large file is read by `jld
import` in a process of its own: processor seconds of it and of the one that reads, and the larger memory of both.
Bombs are small files that expand, nest or
branch (`tests/files/bombs.py`): each has to end in one line. Large ones are cells of lines beside a closed outline, in
n × n cells, and blocks of solids. Memory is an upper bound: a process begins with the peak of the one that started it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.common import ROOT, about, load_of_machine, run_parts, table, write
from benchmarks.scenes import cubes
from jld_core import InputError, Layout, build_assembly
from jld_formats import ImportOptions, export, import_file

_MB: Final = 1e6


def _walls(count: int) -> Callable[[Path], None]:
    """Cells of lines beside a closed outline, on a support."""

    def write_wall(path: Path) -> None:
        document = import_module("ezdxf").new(units=6)
        space = document.modelspace()
        for i in range(count + 1):
            for j in range(count):
                space.add_line((i, j), (i, j + 1))
                space.add_line((j, i), (j + 1, i))
        ground = [(0, -1), (count + 1, -1), (count + 1, 0), (0, 0)]
        space.add_lwpolyline(ground, close=True, dxfattribs={"layer": "SUPPORT"})
        space.add_lwpolyline([(count, 0), (count + 1, 0), (count + 1, 1), (count, 1)], close=True)
        document.saveas(path)

    return write_wall


def _solids(kind: str) -> Callable[[Path], None]:
    """1 000 cubes in a file that `jld export` writes."""

    def write_cubes(path: Path) -> None:
        scene = cubes(10)
        assembly = build_assembly(scene)
        export(Layout(scene, assembly, np.ones(len(assembly.interfaces), bool)), kind, path, cells=True)

    return write_cubes


def read(path: Path, out: Path, *options: str) -> tuple[float, float, int, str]:
    """Processor seconds, memory in MB, exit code and last line of `jld import` of a file."""
    command = [sys.executable, "-m", "jld_explore", "import", str(path), "-o", str(out), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        said = process.stdout.read().replace(f"{path.parent}/", "")
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return used.ru_utime + used.ru_stime, 1024 * used.ru_maxrss / _MB, process.returncode, said


def shelf() -> None:
    """Files as programs write them (`tests/files`): what is right, and what is read.

    Right: number of elements, area (m²) or volume (m³) and unit as they were drawn, or the words of a true refusal.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for file in import_module("files.make").shelf():
            path = Path(folder) / file.name
            file.write(path)
            right = file.refused or f"{file.elements}; {file.amount:.4g}; {file.unit}"
            try:
                facts = import_file(path, ImportOptions(**file.options)).facts()
                amount = facts.get("area", facts.get("volume"))
                read = f"{facts['elements']}; {amount:.4g}; {facts['unit']}"
                same = not file.refused and facts["elements"] == file.elements and facts["unit"] == file.unit
                same &= abs(amount - file.amount) <= 5e-3 * abs(file.amount)
            except InputError as error:
                read, same = error.problem, bool(file.refused) and file.refused in str(error)
            options = " ".join(f"{key}={value}" for key, value in file.options.items())
            rows.append(
                [file.name, file.program, options, right, read[:90].replace("|", "/"), "yes" if same else "**no**"]
            )
    count = f"{sum(row[-1] == 'yes' for row in rows)} of {len(rows)} as they were drawn."
    head = "file | program | options | right | read | as drawn"
    write("shelf", f"# The shelf of files\n\n{about(shelf.__doc__)}\n\n{count}\n\n{table(head, rows)}")


def bombs_and_large() -> None:
    """Read every bomb and every large file, and write the table."""
    bombs = import_module("files.bombs").bombs
    files: list[tuple[str, str, Callable[[Path], None]]] = [("bomb", name, one) for name, (one, _) in bombs().items()]
    files += [("large", f"wall_{count}x{count}.dxf", _walls(count)) for count in (30, 100)]
    kinds = {"obj": "obj", "stl": "stl", "ply": "ply", "step": "step", "ifc": "ifc", "3dm": "3dm", "compas": "json"}
    files += [("large", f"1000_cubes.{ending}", _solids(kind)) for kind, ending in kinds.items()]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for group, name, make in files:
            path = Path(folder) / name
            make(path)
            seconds, memory, code, said = read(path, Path(folder) / "out.json", "--support", "lowest")
            line = said.strip().splitlines()[0].removeprefix("jld: ").removeprefix("found        ")[:110]
            kilobytes = f"{path.stat().st_size / 1e3:.0f}"
            rows.append([group, name, kilobytes, f"{seconds:.1f}", f"{memory:.0f}", str(code), line.replace("|", "/")])
            print(rows[-1], flush=True)
    head = "group | file | kB | s | MB | exit code | what it says"
    write("imports", f"# Reading files\n\n{about(__doc__)}\n\n{table(head, rows)}\n\n{load_of_machine()}")


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT / "tests"))
    run_parts(shelf=shelf, bombs=bombs_and_large)
