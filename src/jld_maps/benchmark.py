"""Provide `jld benchmark`: problems with proven answers, and the check of layouts that others found for them."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer

from jld_core import InputError, ParameterError, Status, build_assembly, files, load_scene, solve
from jld_explore import search_space
from jld_explore.cli import ending, options, streams
from jld_explore.space import from_string, reasons_against

PROBLEMS: Final = Path(__file__).with_name("problems")
RECORDS: Final = "records.json"
_SECONDS: Final = 600.0  # for each layout: what decides is the gap, also on slow machines
_EQUAL: Final = 1e-6  # relative difference up to which two load factors are one

Entry = dict[str, Any]


def entries_of(path: Path, records: dict[str, Entry]) -> list[Entry]:
    """Return the layouts of a submission; raise InputError for a file that is none."""
    try:
        document = files.json_of(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(str(path), error.strerror or "it cannot be read", "a JSON file") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "it is not UTF-8 text", "a JSON file") from None
    except ValueError as error:
        raise InputError(str(path), str(error), "a JSON file") from None
    layouts = document.get("layouts") if isinstance(document, dict) else None
    if not isinstance(layouts, list) or not layouts:
        remedy = '{"method": …, "layouts": [{"problem", "labels", "load_factor"}]}'
        raise InputError(str(path), "it has no layouts", remedy)
    for k, layout in enumerate(layouts):
        where = f"{path}: layouts[{k}]"
        if not isinstance(layout, dict) or sorted(layout) != ["labels", "load_factor", "problem"]:
            raise InputError(where, "its keys are wrong", "problem, labels and load_factor")
        if not isinstance(layout["problem"], str) or layout["problem"] not in records:
            raise InputError(f"{where}.problem", f"there is no {layout['problem']!r}", "a name of jld benchmark list")
        claim = layout["load_factor"]
        if isinstance(claim, bool) or not isinstance(claim, int | float) or not math.isfinite(claim):
            raise InputError(f"{where}.load_factor", f"{claim!r} is wrong", "a finite number")
        if not isinstance(layout["labels"], str) or set(layout["labels"]) - set("di"):
            raise InputError(f"{where}.labels", "they are wrong", "a text of the letters d and i, one for each face")
    return layouts


def checked(entry: Entry, record: Entry, folder: Path) -> Entry:
    """Check one layout of a submission: whether it is admitted, carries what is claimed, and beats the record."""
    scene = load_scene(folder / f"{entry['problem']}.json")
    assembly = build_assembly(scene)
    verdict = {
        "problem": entry["problem"],
        "claimed": entry["load_factor"],
        "bracket": None,
        "best_known": record["best"],
    }
    if len(entry["labels"]) != assembly.faces:
        return verdict | {
            "verdict": "refused",
            "why": f"{len(entry['labels'])} labels; there are {assembly.faces} faces",
        }
    labels = from_string(entry["labels"] + "i" * (len(assembly.interfaces) - assembly.faces))
    space = search_space(scene, assembly)
    if reasons := reasons_against(space, labels):
        return verdict | {"verdict": "refused", "why": reasons[0]}
    result = solve(assembly, labels, seconds=_SECONDS)
    low, high = result.bracket
    verdict["bracket"] = [None if math.isnan(end) else end for end in (low, high)]
    claim, best, bound = entry["load_factor"], record["best"], record["bound"]
    if result.status is Status.LOCKED:
        low = high = math.inf
    if high < claim - _EQUAL * abs(claim):
        return verdict | {"verdict": "not carried", "why": f"it carries at most {high:.9g}"}
    if not low >= claim - _EQUAL * abs(claim):
        return verdict | {"verdict": "undecided", "why": "λ is not proven to reach what is claimed"}
    size = max(abs(best), 1e-300)
    if low > best + _EQUAL * size:
        above = bound is not None and low > bound + _EQUAL * size
        why = f"{low / best - 1.0:+.2%} over the best known" + (", above its proven bound: tell us" if above else "")
        return verdict | {"verdict": "beats the record", "why": why}
    if low >= best - _EQUAL * size:
        return verdict | {
            "verdict": "equals the record",
            "why": "optimal, proven" if record["proven"] else "best known",
        }
    return verdict | {"verdict": "verified", "why": f"{low / best - 1.0:+.2%} of the best known"}


def benchmark(
    action: Annotated[
        Literal["list", "copy", "check"], typer.Argument(help="list the problems, copy them, or check a submission.")
    ],
    file: Annotated[
        Path | None, typer.Argument(help="copy: folder for scenes and certificates; check: JSON file with layouts.")
    ] = None,
    problems: Annotated[Path, typer.Option(help="Folder of the problems.", show_default=False)] = PROBLEMS,
    as_json: options.AsJson = False,
) -> None:
    """List or copy forty problems with their best layouts known, or check layouts found by another method.

    A submission is {"method": …, "layouts": [{"problem": NAME, "labels": "ddi…", "load_factor": λ}]}, a letter for
    each face in the order of faces.csv. Each is solved anew. The exit code is 4 if a claim is not verified.
    """
    # the record of each problem of a folder, by name; raise InputError without any
    try:
        records: dict[str, Entry] = files.json_of((problems / RECORDS).read_text(encoding="utf-8"))
    except OSError:
        raise InputError(str(problems), f"there is no {RECORDS} in it", "no `--problems`, or another folder") from None
    except ValueError as error:
        raise InputError(str(problems / RECORDS), str(error), "the file of the package") from None
    if action == "list":
        if file is not None:
            raise ParameterError("file", "a list takes none", "jld benchmark check FILE")
        streams.say(json.dumps(records, indent=1) if as_json else "\n".join(_lines(records)))
        return
    if file is None:
        raise ParameterError(
            "file", "none is given", f"jld benchmark {action} {'FILE' if action == 'check' else 'FOLDER'}"
        )
    if action == "copy":
        files.require_folder(file)
        shutil.copytree(problems, file, dirs_exist_ok=True)
        streams.say(f"{len(records)} problems in {file}")
        return
    checks = [checked(entry, records[entry["problem"]], problems) for entry in entries_of(file, records)]
    beaten = sorted({check["problem"] for check in checks if check["verdict"] == "beats the record"})
    lines = [f"{check['problem']:<24} {check['verdict']:<18} {check['why']}" for check in checks]
    lines.append(f"{len(beaten)} records beaten" + (f": {', '.join(beaten)}" if beaten else ""))
    streams.say(json.dumps({"layouts": checks, "beaten": beaten}, indent=1) if as_json else "\n".join(lines))
    if any(check["verdict"] in ("refused", "not carried", "undecided") for check in checks):
        raise typer.Exit(ending.UNCERTIFIED)


def _lines(records: dict[str, Entry]) -> list[str]:
    head = f"{'problem':<24} {'faces':>5} {'candidates':>10} {'cases':>5}  {'best known':>12} {'bound':>12}  proven"
    lines = [head + "  gap    seconds"]
    for name, record in records.items():
        best, bound, proven = record["best"], record["bound"], record["proven"]
        lines.append(
            f"{name:<24} {record['faces']:>5} {record['candidates']:>10} {record['cases']:>5}  {best:>12.7g} "
            f"{'' if bound is None else format(bound, '.7g'):>12}  {'yes' if proven else 'no':<6}  "
            f"{'' if proven or bound is None else format(1.0 - best / bound, '.1%'):<6} {record['seconds']:>7.1f}"
        )
    return lines
