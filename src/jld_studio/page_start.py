"""Assemble the data with which the page of the studio shows a scene or a study."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jld_core import Scene, build_assembly
from jld_explore import read_folder
from jld_formats import FORMATS
from jld_studio.session import CHANGEABLE, StudioSession
from jld_views import page_contract, page_of_study
from jld_views import page_data as report_page_data


def first_data(desk: StudioSession, root: Path, study: Path | None) -> page_contract.PageData:
    """Return the data with which the page starts: the table of a study, or the scene with its own labels solved."""
    if study is not None:
        extra = _extra(desk, root)
        done = read_folder(study)
        found = page_of_study.study_data(done, patience=0.5, kind="studio", studio=extra)
        best = done.summary.best_labelling
        if found["solutions"] or best is None:
            return found
        # a table by fields holds no forces of rigid elements, which the page begins with
        return {
            **found,
            "solutions": {"0": report_page_data.solution_of(desk.setup({}).solver.solve(desk.labels(best)))},
        }
    return scene_data(desk, root)


def scene_data(desk: StudioSession, root: Path) -> page_contract.PageData:
    """Return the page data of a scene with its own labels, solved; arguments are those of `first_data`."""
    setup = desk.setup({})
    assembly = setup.assembly
    return report_page_data.page_data(
        kind="studio",
        scene=desk.scene,
        assembly=assembly,
        candidates=assembly.free_faces if setup.space is None else setup.space.candidates,
        facts={},
        solutions={0: report_page_data.solution_of(setup.solver.solve(assembly.labels))},
        studio=_extra(desk, root),
    )


def drawing_data(scene: Scene) -> page_contract.PageData:
    assembly = build_assembly(scene)
    return report_page_data.page_data(
        kind="studio", scene=scene, assembly=assembly, candidates=assembly.free_faces, facts={}
    )


def _extra(desk: StudioSession, root: Path) -> dict[str, Any]:
    """Return data for the studio alone: folder, formats, changeable keys, vertices."""
    return {
        "folder": str(root),
        "formats": list(FORMATS),
        "changes": {key: desk.document.get(key, {}) for key in CHANGEABLE},
        "joints": None if desk.joints is None else desk.joints.facts(),
    }
