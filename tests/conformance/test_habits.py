"""What a stranger expects of a repository: workflows, hooks, citation, changelog and guide, all true."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import jld_core
from command import ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yaml"))


def valid(schema: str, *files: Path) -> None:
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def recipe(target: str) -> list[str]:
    """Commands of a target of the Makefile, without the folder of the environment."""
    text = (ROOT / "Makefile").read_text("utf-8")
    lines = text.split(f"\n{target}:", 1)[1].splitlines()[1:]
    own = [line.strip() for line in lines[: next(i for i, line in enumerate(lines) if not line.startswith("\t"))]]
    return [line.removeprefix("$(BIN)/") for line in own]


def test_workflows_are_valid() -> None:
    assert [path.stem for path in WORKFLOWS] == ["checks", "docs", "wheels"]
    valid("vendor.github-workflows", *WORKFLOWS)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_may_only_read_and_end(path: Path) -> None:
    found = yaml.safe_load(path.read_text("utf-8"))
    assert found["permissions"] == {"contents": "read"}
    for job in found["jobs"].values():
        assert job["timeout-minutes"] <= 60
        for step in job["steps"]:
            if step.get("uses", "").startswith("actions/checkout"):
                assert step["with"]["persist-credentials"] is False


@pytest.mark.parametrize("name", ["checks", "wheels"])
def test_workflows_run_on_three_systems(name: str) -> None:
    found = yaml.safe_load((ROOT / ".github" / "workflows" / f"{name}.yaml").read_text("utf-8"))
    systems = [job["strategy"]["matrix"]["os"] for job in found["jobs"].values() if "strategy" in job]
    assert [{system.split("-")[0] for system in each} for each in systems] == [{"ubuntu", "macos", "windows"}]


def test_targets_and_commands_of_workflows_exist() -> None:
    text = "".join(path.read_text("utf-8") for path in WORKFLOWS)
    for target in re.findall(r"run: make (\w+)", text):
        assert recipe(target), target
    commands = [
        line for job in yaml.safe_load(WORKFLOWS[0].read_text("utf-8"))["jobs"].values() for line in job["steps"]
    ]
    ran = [step["run"] for step in commands if "run" in step]
    assert set(recipe("check")) <= set(ran)


def test_hooks_are_those_of_make_check() -> None:
    found = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text("utf-8"))
    (local,) = found["repos"]
    assert local["repo"] == "local"
    assert [hook["entry"].removeprefix(".venv/bin/") for hook in local["hooks"]] == recipe("check")


def test_citation_and_changelog_name_the_version() -> None:
    valid("vendor.citation-file-format", ROOT / "CITATION.cff")
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert found["version"] == jld_core.__version__
    # a version in the making is "(unreleased)", and its citation has no date
    first = re.search(r"^## (\S+) \((\S+)\)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), flags=re.M)
    released = found.get("date-released")
    assert first.groups() == (jld_core.__version__, released.isoformat() if released else "unreleased")


def test_files_and_targets_named_in_contributing_exist() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    named = [path for path in re.findall(r"`([\w.]+(?:/[\w.]+)+)`", text) if "NAME" not in path and ".venv" not in path]
    assert len(set(named)) > 40
    for path in named:
        assert (ROOT / path).exists(), path
    for target in re.findall(r"^make (\w+)", text, flags=re.M):
        assert f"\n{target}:" in (ROOT / "Makefile").read_text("utf-8"), target
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        assert (ROOT / link).exists(), link


KNOWING = {
    "a yield criterion": ("cohesion", r"\bcohesion\b"),
    "a search driver": ("hillclimb", r"\bhillclimb\b"),
    "a count": ("dry_length", r"\bdry_length\b"),
    "a file format": ("dxf", r"(?i)(?<![a-z])dxf(?![a-z])"),
    "a kind of load": ("body", r"entry\.body\b|\bBodyLoad\b|[{\[ (]\"body\"(?! *:.*request)"),
}
"""Extension point → an example that is there already, and how code that knows it mentions it."""
NO_PLACE = {"src/jld_core/scene/__init__.py", "src/jld_core/mechanics/__init__.py", "src/jld_studio/server.py"}
"""Files that mention an example in passing: lists of names, and the body of a request."""
NO_PLACE |= {"src/jld_studio/server.py", "src/jld_samples", "tools/try_wheel.py"}
"""Scenes that use the example as anybody's would."""
NO_PLACE |= {"src/jld_core/scene/materials.py", "src/jld_core/build/fill.py"}
"""Soil, whose cohesion is no yield criterion of a face."""


@pytest.mark.parametrize("point", KNOWING)
def test_lists_of_extension_points_are_complete(point: str) -> None:
    """Files of the code that know an example are named in the list of its extension point."""
    example, mention = KNOWING[point]
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    _, section = text.split(f"\n**{point}** (", 1)
    section = section.split("\n**", 1)[0]
    assert example in section.split(")", 1)[0].lower()
    listed = {path.replace("NAME", example) for path in re.findall(r"`([\w./]+)`", section)}
    sources = [*sorted((ROOT / "src").rglob("*.py")), *sorted((ROOT / "src").rglob("*.h"))]
    sources += sorted((ROOT / "tools").glob("*.py"))
    knowing = [str(path.relative_to(ROOT)) for path in sources if re.search(mention, path.read_text("utf-8"))]
    assert [path for path in knowing if path not in listed and not path.startswith(tuple(NO_PLACE))] == []
    assert len(set(knowing) & listed) >= 2


def test_the_way_a_wheel_is_tried_works_here() -> None:
    """Not of a wheel, which takes a minute to install: of this environment, which must be called a checkout."""
    command = [sys.executable, "-m", "tools.try_wheel", "--installed"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "is a checkout, not an installation" in done.stderr
