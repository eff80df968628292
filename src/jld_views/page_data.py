"""Assemble the data of a page as JSON, docs/guide/page.md: structure, loads and solutions, rounded."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import TYPE_CHECKING, Any, Final, Literal, cast

import numpy as np

import jld_core
from jld_core import Assembly, Bools, LimitAnalysisResult, Scene
from jld_core import assembly as core_assembly
from jld_core.limit import effects
from jld_core.limit import mechanism as core_mechanism
from jld_explore.report import columns as explore_columns
from jld_explore.space import Count, labelling, registered, to_string
from jld_views import look, quantities
from jld_views.page_contract import (
    FORMAT,
    VERSION,
    CaseSolution,
    Column,
    Curve,
    Edge,
    Load,
    Look,
    PageData,
    Picture,
    Solution,
    Structure,
    Table,
)

if TYPE_CHECKING:
    import pandas as pd

rounded, rounded_each, ranked_by = explore_columns.rounded, explore_columns.rounded_each, explore_columns.ranked_by

DIGITS: Final = explore_columns.DIGITS


def page_data(
    *,
    kind: Literal["report", "studio"],
    scene: Scene | None,
    assembly: Assembly,
    candidates: Bools,
    facts: Mapping[str, str],
    warnings: Sequence[str] = (),
    how: str = "",
    table: Table | None = None,
    solutions: Mapping[int, Solution] | None = None,
    convergence: Sequence[Curve] = (),
    pictures: Sequence[Picture] = (),
    summary: Mapping[str, Any] | None = None,
    studio: Mapping[str, Any] | None = None,
) -> PageData:
    """Assemble the data of a page; candidates: (m,) faces whose label may be chosen."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "title": assembly.name if scene is None else scene.name,
        "facts": [{"name": name, "value": value} for name, value in facts.items()],
        "warnings": list(warnings),
        "how": how,
        "look": cast(Look, look.rules()),
        "structure": structure_of(assembly, candidates),
        "cases": cases_of(assembly),
        "loads": loads_of(assembly),
        "table": table,
        "solutions": {str(row): solution for row, solution in (solutions or {}).items()},
        "convergence": list(convergence),
        "pictures": list(pictures),
        "scene": {} if scene is None else scene.model_dump(mode="json", exclude_defaults=True),
        "summary": dict(summary or {}),
        "studio": None if studio is None else dict(studio),
        "notebook": None,
    }


def structure_of(assembly: Assembly, candidates: Bools) -> Structure:
    """Return the elements and faces, with candidates (m,), of an assembly for a page."""
    assembly = core_assembly.faces_of(assembly)
    elements, faces = assembly.elements, assembly.interfaces
    planar, bars = assembly.dimension == 2, assembly.members
    weight = rounded(np.linalg.norm(elements.weight, axis=1), DIGITS)
    shapes, centroids = rounded_each(elements.shape), rounded(elements.centroid)
    polygons, areas = (rounded_each(faces.polygon), rounded(faces.area, DIGITS))
    origins, normals = rounded(faces.origin), rounded(faces.normal)
    return {
        "dimension": 2 if planar else 3,
        "units": {"length": assembly.units[0], "force": assembly.units[1]},
        "size": rounded(assembly.size),
        "typical": rounded(quantities.typical(assembly)),
        "elements": [
            {
                "id": name,
                "support": bool(elements.support[k]),
                "shape": shapes[k],
                "faces": [] if planar else [list(ring) for ring in elements.faces[k]],
                "centroid": centroids[k],
                "weight": weight[k],
            }
            for k, name in enumerate(elements.ids)
        ],
        "faces": [
            {
                "elements": [int(faces.a[k]), int(faces.b[k])],
                "polygon": polygons[k],
                "origin": origins[k],
                "normal": normals[k],
                "area": areas[k],
                "candidate": bool(candidates[k]),
            }
            for k in range(len(faces))
        ],
        "edges": _bare_edges(assembly) if planar else [],
        "resultants": list(assembly.resultants),
        "touching": [list(pair) for pair in assembly.touching],
        "members": [
            {"name": name, "kind": cast(Any, kind), "elements": elements_of_bar.tolist(), "points": rounded(points)}
            for name, kind, elements_of_bar, points in zip(
                bars.names, bars.kinds, bars.elements, bars.points, strict=True
            )
        ],
        "fill": [rounded(outline) for outline in assembly.fill],
    }


def _bare_edges(assembly: Assembly) -> list[Edge]:
    """Return the pieces of the outlines of free elements that no interface covers."""
    touching: list[list[list[list[float]]]] = [[] for _ in assembly.elements.ids]
    for k, polygon in enumerate(assembly.interfaces.polygon):
        ends = np.asarray(polygon).tolist()
        touching[assembly.interfaces.a[k]].append(ends)
        touching[assembly.interfaces.b[k]].append(ends)
    near = 1e-6 * assembly.size
    pieces: list[Edge] = []
    # plain numbers: arrays of two points take ten times as long
    for element in assembly.elements.free.tolist():
        corners = assembly.elements.shape[element].tolist()
        for (x, y), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
            length = math.hypot(x1 - x, y1 - y)
            along = (x1 - x) / length, (y1 - y) / length
            most, covered = max(near, 1e-3 * length), []
            for ends in touching[element]:
                if all(abs((u - x) * along[1] - (v - y) * along[0]) <= most for u, v in ends):
                    positions = [(u - x) * along[0] + (v - y) * along[1] for u, v in ends]
                    covered.append((max(min(positions), 0.0), min(max(positions), length)))
            for part in _gaps(covered, length, near):
                low, high = ([x + position * along[0], y + position * along[1]] for position in part)
                pieces.append({"element": element, "from": rounded(low), "to": rounded(high)})
    return pieces


def _gaps(covered: Iterable[tuple[float, float]], length: float, near: float) -> list[tuple[float, float]]:
    """Return the parts of [0, length] that intervals leave uncovered, if longer than `near`."""
    gaps, at = [], 0.0
    for low, high in sorted(covered):
        if low - at > near:
            gaps.append((at, low))
        at = max(at, high)
    if length - at > near:
        gaps.append((at, length))
    return gaps


def cases_of(assembly: Assembly) -> list[str]:
    """Return the names of the load cases for a page; one empty name for a single load."""
    return [case.name for case in assembly.cases] or [""]


def loads_of(assembly: Assembly) -> list[Load]:
    """List the live loads for drawing: on points, on all bodies together, and couples."""
    planar, ids, d = assembly.dimension == 2, assembly.elements.ids, assembly.dimension
    loads: list[Load] = []
    for name, case in zip(cases_of(assembly), assembly.by_case, strict=True):
        for element, at, vector in case.live_loads.arrows():
            loads.append(_load(name, "live", ids[element], at, vector))
        total = quantities.body_load(case)
        if total is not None:
            loads.append(_load(name, "body", "", np.zeros(d), total))
        for k in quantities.live_couples(case):
            moment = case.live[k, d:] if not planar else case.live[k, 2:]
            loads.append(_load(name, "couple", ids[k], assembly.elements.centroid[k], moment))
    return loads


def _load(case: str, kind: Literal["live", "body", "couple"], element: str, at: Any, vector: Any) -> Load:
    return {"case": case, "kind": kind, "element": element, "at": rounded(at), "vector": rounded(vector, DIGITS)}


def solution_of(result: LimitAnalysisResult) -> Solution:
    """Convert a limit analysis result to the data of a drawing, by load case."""
    cases = result.cases or {"": result}
    names = list(cases)
    return {
        "labelling": to_string(result.labels[: result.assembly.faces]),
        "load_factor": rounded(result.load_factor),
        "bracket": [rounded(end, 15) for end in result.bracket],
        "status": str(result.status),
        "governing": names.index(result.governing) if result.governing in names else 0,
        "cases": [
            _case(name, case, float(required))
            for (name, case), required in zip(cases.items(), result.assembly.required, strict=True)
        ],
    }


def within(solution: Solution, assembly: Assembly, text: str) -> Solution:
    """Extend the solution of a structure with omitted cells to the whole structure."""
    gone = labelling.omitted(assembly, text)
    faces = np.flatnonzero(~labelling.beside_nothing(text)).tolist()
    elements = np.flatnonzero(~gone).tolist()

    def spread(values: Any, rows: list[int], count: int, none: Any) -> Any:
        if values is None:
            return None
        ranges = [none] * count
        for row, value in zip(rows, values, strict=True):
            ranges[row] = value
        return ranges

    freedoms = assembly.freedoms
    empty = {
        "forces": [0.0] * freedoms, "utilisation": 0.0, "vectors": [0.0] * assembly.dimension, "on_face": False,
        "movements": "still", "pressure": [0.0] * assembly.dimension, "places": [0.0] * assembly.dimension,
    }  # fmt: skip
    cases: list[CaseSolution] = []
    for case in solution["cases"]:
        values: dict[str, Any] = {**case}
        wide = {name: spread(values[name], faces, len(text), none) for name, none in empty.items()}
        wide["mechanism"] = spread(case["mechanism"], elements, len(gone), [0.0] * freedoms)
        cases.append(cast(CaseSolution, values | wide))
    return {**solution, "labelling": text, "cases": cases}


def _case(name: str, result: LimitAnalysisResult, required: float) -> CaseSolution:
    """Return the data of one load case: λ, forces, thrust and mechanism."""
    if result.instability_mechanism is not None:
        result = replace(result, mechanism=result.instability_mechanism)  # Show the mechanism that proves instability.
    with_members, result = result, core_mechanism.result_of_faces(result)
    assembly, forces, mechanism = result.assembly, result.forces, result.mechanism
    solution: CaseSolution = {
        "name": name,
        "required": required,
        "load_factor": rounded(result.load_factor),
        "bracket": [rounded(end, 15) for end in result.bracket],
        "gap": rounded(result.gap, DIGITS),
        "status": str(result.status),
        "friction": result.friction,
        "forces": None,
        "utilisation": None,
        "pressure": None,
        "on_face": None,
        "vectors": None,
        "members": None,
        "thrust": [],
        "mechanism": None,
        "scale": 0.0,
        "movements": None,
        "places": None,
    }
    if forces is not None:
        pressure, on_face = quantities.pressure_points(assembly, forces)
        solution |= {
            "forces": rounded(forces, DIGITS),
            "utilisation": rounded(quantities.utilisation(result), 4),
            "pressure": rounded(pressure, DIGITS),
            "on_face": [bool(on) for on in on_face],
            "vectors": rounded(
                quantities.down_the_load_path(assembly, quantities.face_vectors(assembly, forces)), DIGITS
            ),
            "members": rounded(effects(with_members.assembly, with_members.forces), DIGITS)
            if with_members.forces is not None
            else None,
            "thrust": [rounded(piece, DIGITS) for piece in quantities.thrust_segments(assembly, forces)],
        }
    if mechanism is not None:
        kinds, points = quantities.movements(result)
        solution |= {
            "mechanism": rounded(mechanism, DIGITS),
            "scale": rounded(quantities.mechanism_scale(assembly, mechanism), DIGITS),
            "movements": [str(kind) for kind in kinds],
            "places": rounded(points, DIGITS),
        }
    return solution


_IMPORT: Final = re.compile(r'^import \{([^}]*)\} from "\./([\w./]+)";\n', re.M)
_STAR: Final = re.compile(r'^import \* as (\w+) from "\./([\w./]+)";\n', re.M)
_EXPORT: Final = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.M)
_BUNDLE: Final = re.compile(r"export\{([^}]*)\};?\s*$")
_TOKEN: Final = re.compile(r"\{\{(\w+)\}\}")

PLANAR: Final = {"figures.js": "figures_planar.js"}  # modules replaced in pages of planar scenes, which need no WebGL


def asset(name: str, wing: str = "report") -> str:
    return _assets(wing).joinpath(name).read_text(encoding="utf-8")


def asset_names(wing: str = "report") -> list[str]:
    """List the modules and styles that a browser loads, modules of vendors as "vendor/..."."""
    names = [entry.name for entry in _assets(wing).iterdir() if entry.name.endswith((".js", ".css"))]
    vendor = _assets(wing).joinpath("vendor")
    theirs = [f"vendor/{entry.name}" for entry in vendor.iterdir()] if vendor.is_dir() else []
    return sorted([*names, *(name for name in theirs if name.endswith(".js"))])


def _assets(wing: str) -> Traversable:
    """Return the folder of front-end files of a sub-package."""
    return files("jld_studio" if wing == "studio" else "jld_views").joinpath("assets")


def linked(entry: str, instead: Mapping[str, str] | None = None) -> str:
    """Join a JavaScript module of the page and all its imports into one script."""
    # Imported modules come first, each in a scope of its own.
    instead = instead or {}
    texts: dict[str, str] = {}

    def visit(name: str, above: tuple[str, ...]) -> None:
        if name in above:
            raise ValueError(f"the modules {' → '.join((*above, name))} import one another in a circle")
        if name in texts:
            return
        text = asset(name)
        for _, imported in (*_IMPORT.findall(text), *_STAR.findall(text)):
            visit(instead.get(imported, imported), (*above, name))
        texts[name] = _scoped(name, text, instead, last=name == entry)

    visit(entry, ())
    script = "const $modules = {};\n" + "".join(texts.values())
    if "</script" in script.lower() or "<!--" in script:
        raise ValueError("a module contains text that would end its script")
    return script


def _scoped(name: str, text: str, instead: Mapping[str, str], last: bool) -> str:
    """Return a module as a block with its own scope, with imports and exports rewritten."""
    text = _IMPORT.sub(lambda m: f"const {{{m[1].replace(' as ', ': ')}}} = {_place(m[2], instead)};\n", text)
    text = _STAR.sub(lambda m: f"const {m[1]} = {_place(m[2], instead)};\n", text)
    bundle = _BUNDLE.search(text)
    if bundle:
        pairs = [pair.strip().split(" as ") for pair in bundle[1].split(",")]
        names = ", ".join(f"{pair[-1]}: {pair[0]}" for pair in pairs)
        text = text[: bundle.start()]
    else:
        names = ", ".join(found for _, found in _EXPORT.findall(text))
        text = _EXPORT.sub(r"\1", text)
    if last:
        return f"{{\n{text}}}\n"
    return f'$modules["{name}"] = (() => {{\n{text}\nreturn {{ {names} }};\n}})();\n'


def _place(name: str, instead: Mapping[str, str]) -> str:
    return f'$modules["{instead.get(name, name)}"]'


def page(data: Mapping[str, Any]) -> str:
    """Return the HTML of a page, with all its data, scripts and style inside."""
    script = linked("report.js", PLANAR if data["structure"]["dimension"] == 2 else None)
    style = asset("page.css")
    policy = (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    return filled(
        asset("report.html"),
        {
            "policy": html.escape(policy, quote=False),
            "version": html.escape(jld_core.__version__),
            "title": html.escape(str(data["title"])),
            "style": style,
            "data": packed(data),
            "script": script,
        },
    )


def packed(data: Mapping[str, Any]) -> str:
    """Return data as base64 of gzipped JSON, which is safe in HTML for any content."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode("utf-8"), compresslevel=6, mtime=0)).decode("ascii")


def filled(template: str, parts: Mapping[str, str]) -> str:
    """Replace each {{name}} in a template by its part; parts are not expanded again."""
    return _TOKEN.sub(lambda match: parts[match[1]], template)


def _hash(text: str) -> str:
    """Return the SHA-256 of a text in the form of a content security policy."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


MOST: Final = 20_000  # largest number of strongest rows on a page; the front is added

# titles of columns whose name is not a good title
TITLES: Final = {
    "multiplicity": "mirror images",
    "load_factor_associative": "λ associative",
    "load_factor_zero_dilation": "λ without dilation",
    "seconds": "seconds",
}
_FIRST: Final = ("rank", "load_factor", "bracket_lo", "bracket_hi", "governing", "status")  # columns shown first
# Columns shown last
_LAST: Final = ("load_factor_associative", "load_factor_zero_dilation", "multiplicity", "settled", "seconds", "driver")
# Beginnings of the names of numeric columns that are no counts
_NO_COUNT: Final = ("rank", "multiplicity", "seconds", "load_factor", "bracket_lo", "bracket_hi")


def chosen_rows(results: pd.DataFrame, front: pd.DataFrame, most: int = MOST) -> pd.DataFrame:
    if len(results) <= most:
        return results
    chosen = np.arange(len(results)) < most
    chosen |= results.index.isin(front.index)
    return results[chosen]


def table_of(
    results: pd.DataFrame, front: pd.DataFrame, assembly: Assembly, *, axes: Sequence[tuple[str, str]], left_out: int
) -> Table:
    """Return the table of layouts for a page: columns, labellings and evidence."""
    import pandas as pd  # here and below: slow to import and needed for tables only

    count, sense = axes[0]
    bits, nothing = labelling.of_texts(results["labelling"].astype(str).tolist(), assembly.faces)
    beside = nothing if nothing.any() else np.zeros((0, assembly.faces), dtype=bool)
    evidence = pd.Series("visited", index=results.index, dtype=object)
    common = front.index.intersection(results.index)
    evidence.loc[common] = front.loc[common, "evidence"].astype(str)
    value = ranked_by(results)
    ranked = {"load_factor": value, "bracket_lo": f"{value} at least", "bracket_hi": f"{value} at most"}
    columns = [
        _column(name, ranked.get(name) or _title(name, assembly), results[name], assembly)
        for name in _ordered(list(map(str, results.columns)))
        if name != "labelling" and (name == "load_factor" or results[name].notna().any())
    ]
    counts = [c["name"] for c in columns if c["kind"] != "text" and not c["name"].startswith(_NO_COUNT)]
    return {
        "rows": len(results),
        "columns": columns,
        "labellings": base64.b64encode(labelling.pack(bits).tobytes()).decode("ascii"),
        "evidence": cast(list[Any], evidence.tolist()),
        "beside": base64.b64encode(labelling.pack(beside).tobytes()).decode("ascii"),
        "count": count,
        "sense": "max" if sense == "max" else "min",
        "line": len(axes) == 1,
        "counts": sorted(counts, key=lambda name: name != count),
        "left_out": left_out,
    }


def _ordered(names: list[str]) -> list[str]:
    """Order column names: rank and λ first, then counts, then the origin of each row."""
    first = [name for name in _FIRST if name in names]
    last = [name for name in _LAST if name in names]
    return [*first, *(name for name in names if name not in first and name not in last), *last]


def _column(name: str, title: str, values: pd.Series[Any], assembly: Assembly) -> Column:
    kind, texts = _values(values, digits=4 if name == "seconds" else 10)
    return {"name": name, "title": title, "unit": _unit(name, assembly), "kind": kind, "values": texts}


def _values(values: pd.Series[Any], digits: int) -> tuple[Literal["integer", "number", "text"], list[Any]]:
    import pandas as pd

    if pd.api.types.is_integer_dtype(values):
        return "integer", values.astype(object).where(values.notna(), None).tolist()
    if pd.api.types.is_float_dtype(values):
        return "number", rounded(values.to_numpy(dtype=float, na_value=np.nan), digits)
    return "text", list(map(str, values.astype(object).where(values.notna(), "").tolist()))


def _title(name: str, assembly: Assembly) -> str:
    if name.startswith("load_factor["):
        return f"λ, {name[len('load_factor[') : -1]}"
    count = _counts().get(name)
    return TITLES.get(name, name.replace("_", " ")) if count is None else count.heading(assembly)


def _unit(name: str, assembly: Assembly) -> str:
    count = _counts().get(name)
    return "" if count is None else count.unit(assembly)


def _counts() -> dict[str, Count]:
    return {count.name: count for count in registered()}


def curve_of(name: str, history: pd.DataFrame) -> Curve:
    """Return a convergence curve for a page from the table of convergence.csv."""
    finite = history[np.isfinite(history["best"].astype(float))]
    return {
        "name": name,
        "solves": [int(v) for v in finite["solves"]],
        "seconds": rounded(finite["seconds"].to_numpy(dtype=float), 5),
        "best": rounded(finite["best"].to_numpy(dtype=float), 10),
    }


def facts_of_summary(summary: Mapping[str, Any], results: pd.DataFrame) -> dict[str, str]:
    """Describe the proven results of a search by name: bracket of the best, bound, gap."""
    # The versions of libraries are added if the summary has them.
    facts: dict[str, str] = {}
    best = results[results["load_factor"].notna()].head(1)
    if summary.get("best") is not None and len(best):
        row = best.iloc[0]
        facts["bracket of the best"] = f"{row['bracket_lo']:.9g} … {row['bracket_hi']:.9g}"
    bound, gap = summary.get("bound"), summary.get("gap")
    by = f" ({summary['bound_by']})" if summary.get("bound_by") else ""
    facts["bound over all layouts"] = "none is known" if bound is None else f"{bound:.9g}{by}"
    if gap is not None:
        facts["gap to the bound"] = f"{gap:.2g}"
    versions = summary.get("versions", {})
    if versions:
        facts["versions"] = ", ".join(f"{name} {version}" for name, version in versions.items())
    return facts
