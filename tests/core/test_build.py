"""The batch solver is compiled beside an installation: all variants, into the package, by a compiler that works."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from jld_core.batch import build

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
