"""The C interface of the batch solver is stated once, in `interface.py`; header and ctypes follow it."""

from __future__ import annotations

import ctypes
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from jld_core import InputError
from jld_core.batch import batch_solver, build, interface, library

STRUCTURES = {
    "JldFactorPattern": library.FactorPattern,
    "JldProblem": library.Problem,
    "JldTry": library.Try,
    "JldMinimization": library.MinimizationOptions,
    "JldAnswers": library.Answers,
    "JldBlocks": library.Blocks,
    "JldBlockTask": library.BlockTask,
    "JldFronts": library.Fronts,
}


def compiles(text: str, folder: Path) -> bool:
    """Whether a C++ compiler takes the header; it checks size and offsets, which ctypes gave."""
    (folder / "header.cpp").write_text(text, encoding="utf-8")
    command = [*build.compilers()[0], "-std=c++17", "-fsyntax-only", str(folder / "header.cpp")]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.mark.parametrize("name", STRUCTURES)
def test_the_header_has_the_fields_of_the_structures_in_use(name: str) -> None:
    body = re.search(rf"struct {name} \{{(.*?)\}};", re.sub(r"//[^\n]*", "", interface.header()), re.DOTALL)
    stated = [tuple(part.strip().rsplit(" ", 1)) for part in body.group(1).split(";") if part.strip()]
    fields = STRUCTURES[name]._fields_
    assert len(fields) > 5
    assert stated == [(kind, field) for field, kind, _ in interface.STRUCTURES[name][1]]
    assert [tuple(field) for field in fields] == [(field, interface.ctypes_type(kind)) for kind, field in stated]


@pytest.mark.skipif(not build.compilers(), reason="no compiler")
def test_a_field_out_of_its_place_does_not_compile(tmp_path: Path) -> None:
    """It would make no noise otherwise: the batch solver would take one array for another."""
    text = interface.header()
    assert compiles(text, tmp_path)
    exchanged = text.replace("int32_t faces;", "X;").replace("double floor;", "int32_t faces;")
    assert not compiles(exchanged.replace("X;", "double floor;"), tmp_path)


def test_codes_are_those_of_the_declaration() -> None:
    verdicts = {
        "OPEN": batch_solver.OPEN,
        "PROVEN": batch_solver.PROVEN,
        "FALLS": batch_solver.FALLS,
        "CARRIES": batch_solver.CARRIES,
        "LOCKED": batch_solver.LOCKED,
    }
    assert interface.codes("JldVerdict") == verdicts
    assert interface.codes("JldFate") == {"LEFT": 0, "REFUTED": batch_solver.REFUTED, "CARRIED": batch_solver.CARRIED}
    assert interface.codes("JldLabel")["DRY"] == int(True)
    assert interface.codes("JldBlockState")["SOLVED"] == batch_solver.SOLVED


@pytest.mark.skipif(library.chosen() is None, reason="no batch solver")
def test_an_exception_of_cpp_is_an_outcome_and_an_error_of_python() -> None:
    """A vector of a negative length throws what is no `bad_alloc`: it ended the process."""
    loaded = library.library(library.chosen() or "")
    outcome = loaded.jld_find_blocks(-1, 0, None, 0, None, None, 0, None, None)
    assert outcome == interface.codes("JldOutcome")["FAILED"]
    with pytest.raises(RuntimeError, match=r"the batch solver failed \(outcome 3\); set JLD_KERNEL=off"):
        library.require_success(outcome)


@pytest.mark.parametrize(
    ("outcome", "error"), [(1, MemoryError), (2, ValueError), (3, RuntimeError), (9, RuntimeError)]
)
def test_each_outcome_has_its_error(outcome: int, error: type[Exception]) -> None:
    library.require_success(0)
    with pytest.raises(error, match="the batch solver"):
        library.require_success(outcome)


def test_a_library_of_other_sources_is_refused_unloaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever it is: it would be run in this process."""
    path = tmp_path / "other.so"
    path.write_bytes(Path(ctypes.__file__).read_bytes())
    monkeypatch.setenv("JLD_KERNEL", str(path))
    with pytest.raises(InputError, match=r"JLD_KERNEL: .*other\.so was not built from these sources; expected"):
        library.chosen()


def test_a_built_library_is_used_without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "built", dict)
    monkeypatch.setattr(library, "_compile_fastest", lambda: pytest.fail("a compiler was run"))
    library._find_library.cache_clear()
    try:
        assert library._find_library("built") is None
    finally:
        library._find_library.cache_clear()


@pytest.mark.parametrize(
    ("compilers", "reason"), [([], "no C++ compiler was found"), ([["none-such"]], "none-such failed")]
)
def test_a_missing_batch_solver_is_explained_once(
    monkeypatch: pytest.MonkeyPatch, compilers: list[list[str]], reason: str, tmp_path: Path
) -> None:
    """Why there is none, what it costs, and the remedy, in one line."""
    monkeypatch.setattr(library, "built", dict)
    monkeypatch.setattr(build, "compilers", lambda: compilers)
    monkeypatch.setattr(build, "cache", lambda: tmp_path)
    library._find_library.cache_clear()
    try:
        with pytest.warns(UserWarning, match=rf"{re.escape(reason)}.*30 times as long; pip install 'jld\[compiler\]'"):
            assert library._find_library("") is None
        assert library._find_library("") is None  # cached: any other warning is an error
    finally:
        library._find_library.cache_clear()


def test_a_compiler_may_stand_in_a_folder_with_blanks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CXX", "'/opt/my tools/c++' -m64")
    assert build.compilers()[0] == ["/opt/my tools/c++", "-m64"]


# The batch solver is compiled beside an installation: all variants, into the package, by a compiler that works.


COMPILER = """
import pathlib, sys
target = pathlib.Path(sys.argv[sys.argv.index("-o") + 1])
if "{fails_on}" in sys.argv:
    sys.exit("cannot compile")
target.write_text(" ".join(sys.argv))
"""


def compile_in_place(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    *fails_on: str,
    options: Sequence[str] = (),
    family: tuple[str, ...] = ("avx2", "base"),
) -> None:
    """Run `build.py --in-place` in a folder, with one made-up compiler per flag that it cannot take."""
    names = []
    for number, flag in enumerate(fails_on):
        script = folder / f"compiler{number}.py"
        script.write_text(COMPILER.format(fails_on=flag))
        names.append([sys.executable, "-I", "-S", str(script)])
    monkeypatch.setattr(build, "compilers", lambda: names)
    monkeypatch.setattr(build, "variants", lambda: family)
    monkeypatch.setattr(build, "__file__", str(folder / "build.py"))
    monkeypatch.setattr(sys, "argv", ["build.py", "--in-place", *options])
    build.main()


def test_make_demo_compiles_the_best_variant_if_it_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`make demo` compiles one variant, `make setup` after it the base, and `make bench` the others."""
    monkeypatch.setattr(build, "processor_flags", lambda: frozenset({"avx2", "fma"}))
    assert build.runs_here("avx2")
    assert not build.runs_here("avx512")
    compile_in_place(tmp_path, monkeypatch, "none", options=["--best"])
    assert [path.name for path in tmp_path.glob("*.so")] == ["_avx2.so"]
    capsys.readouterr()
    for options, printed in (
        (["--ends"], f"base: {tmp_path / '_base.so'}\n"),
        (["--ends"], ""),
        ([], f"avx512: {tmp_path / '_avx512.so'}\n"),
        ([], ""),
    ):
        compile_in_place(tmp_path, monkeypatch, "none", options=options, family=("avx512", "avx2", "base"))
        assert capsys.readouterr().out == printed


def test_processor_flags_of_numpy_are_those_of_the_system() -> None:
    """Systems without /proc/cpuinfo, as macOS and Windows, ask numpy."""
    listed, found = build.processor_flags(), build._numpy_flags()
    if not listed:
        pytest.skip("no /proc/cpuinfo")
    needed = {flag for flags in build.NEEDED.values() for flag in flags}
    assert found & needed == listed & needed


def test_every_variant_is_compiled_into_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Libraries under other names, as an installation leaves them, would be found first and are removed."""
    for name in ("_avx2.cpython-311-x86_64-linux-gnu.so", "_avx512.so"):
        (tmp_path / name).write_text("old")
    compile_in_place(tmp_path, monkeypatch, "-mavx2", "none")
    assert sorted(path.name for path in tmp_path.glob("*.so")) == ["_avx2.so", "_avx512.so", "_base.so"]
    assert "-mavx2" in (tmp_path / "_avx2.so").read_text()
    assert "-mavx2" not in (tmp_path / "_base.so").read_text()
    assert build.digest() in (tmp_path / "_base.so").read_text()
    printed = capsys.readouterr()
    assert printed.out == f"avx2: {tmp_path / '_avx2.so'}\nbase: {tmp_path / '_base.so'}\n"
    assert printed.err.count("avx2 by ") == printed.err.count("\n") == 1
    assert printed.err.endswith(": exit status 1\n")


def test_a_variant_that_fails_to_compile_is_named_after_the_others_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit, match=r"^avx2: no compiler that works; pip install jld\[compiler\] brings one$"):
        compile_in_place(tmp_path, monkeypatch, "-mavx2")
    assert [path.name for path in tmp_path.glob("*.so")] == ["_base.so"]
