"""Page of a design check: the same content as PDF of one sheet and as HTML."""

from __future__ import annotations

import html
import textwrap
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

import jld_core
from jld_core import files
from jld_practice.design_check.check import DesignCheck
from jld_practice.design_check.tables import Content, Table, content_of
from jld_views import figures, look, moved_joints, writing

_PAPER: Final = (8.27, 11.69)  # size of a sheet, DIN A4, inches

_MARGIN: Final = 0.07  # margin of a sheet, relative to its width

_SIZE: Final = 7.0  # largest size of letters in tables, points

_STEP: Final = 1.5  # distance of lines over the size of letters

_PICTURES: Final = 0.21  # height of the pictures, relative to that of the sheet

# Style sheet of the HTML page
_STYLE: Final = """body{font:14px/1.45 sans-serif;color:#1b1b1b;max-width:60em;margin:2em auto;padding:0 1em}
table{border-collapse:collapse;margin:.3em 0 1em;width:100%}
td,th{text-align:left;padding:.15em .8em .15em 0;vertical-align:top}
th{font-weight:normal;color:#5c5c5c;border-bottom:1px solid #ccc}h2{font-size:1.05em;margin:1.2em 0 0}
svg{max-width:100%;height:auto}.result{font-size:1.1em}footer{color:#5c5c5c;margin-top:2em}"""


def write_pages(check: DesignCheck, folder: Path, language: str = "en") -> list[Path]:
    content = content_of(check, language)
    pdf, page = folder / "design_check.pdf", folder / "design_check.html"
    figure = sheet_of(check, content)
    facts = {"CreationDate": None, "Title": content.title}
    with (
        mpl.rc_context({"pdf.fonttype": 42}),
        files.whole_file(pdf) as fresh,
        PdfPages(fresh, metadata=facts) as book,
        writing.as_written(figure),
    ):
        book.savefig(figure)
    files.write_text(page, html_of(check, content, language))
    return [pdf, page]


def html_of(check: DesignCheck, content: Content, language: str) -> str:
    figure = Figure(figsize=(10.0, 3.2))
    _draw(check, content, figure, 0.03, 0.94, 0.02, 0.86)
    parts = [f"<h1>{html.escape(content.title)}</h1>"]
    parts += [f'<p class="result">{html.escape(line)}</p>' for line in content.result]
    parts.append(figures.svg_of(figure))
    for table in content.tables:
        parts.append(f"<h2>{html.escape(table.title)}</h2>{_rows(table)}")
        if table.more:
            parts.append(f"<p>{html.escape(content.words['more'].format(count=table.more))}</p>")
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in content.notes)
    parts.append(f"<h2>{html.escape(content.words['notes'])}</h2><ul>{notes}</ul>")
    parts.append(f"<footer>{html.escape(_foot(check))}</footer>")
    body = "\n".join(parts)
    title = html.escape(content.title)
    return (
        f'<!doctype html>\n<html lang="{language}"><head><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def _rows(table: Table) -> str:
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in table.head if cell)
    rows = ("".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in table.rows)
    return f"<table><tr>{head}</tr>" + "".join(f"<tr>{row}</tr>" for row in rows) + "</table>"


def sheet_of(check: DesignCheck, content: Content) -> Figure:
    """Return the sheet of a design check; letters shrink where the tables would not fit on it."""
    figure = Figure(figsize=_PAPER)
    figure.text(
        _MARGIN, 0.965, textwrap.shorten(content.title, 70, placeholder=" …"), fontsize=14, color=look.INK, va="top"
    )
    top = 0.93
    for line in content.result:
        top = _text(figure, top, line, 9.0)
    _draw(check, content, figure, _MARGIN, 1.0 - 2.0 * _MARGIN, top - _PICTURES, _PICTURES - 0.025)
    top -= _PICTURES + 0.012
    size = min(_SIZE, _fitting(content, top - 0.05))
    for table in content.tables:
        top = _table(figure, top, table, content, size)
    top = _text(figure, top, content.words["notes"], 1.2 * size)
    for note in content.notes:
        top = _text(figure, top, f"– {note}", size)
    figure.text(_MARGIN, 0.025, _foot(check), fontsize=7.0, color=look.SOFT)
    return figure


def _foot(check: DesignCheck) -> str:
    return f"{check.scene.name} · {check.scene.fingerprint[:12]} · {check.factors.name} · jld {jld_core.__version__}"


def _line(size: float) -> float:
    """Return the height of a line, relative to the sheet; size: of letters, points."""
    return _STEP * size / 72.0 / _PAPER[1]


def _drop(size: float) -> float:
    """Return the height from a line's top to its base line, likewise."""
    return 0.8 * size / 72.0 / _PAPER[1]


def _wrapped(text: str, size: float) -> list[str]:
    """Return the lines of a text on the sheet; size: of letters, points."""
    return textwrap.wrap(text, int(_PAPER[0] * 72.0 * (1.0 - 2.0 * _MARGIN) / (0.53 * size))) or [""]


def _fitting(content: Content, room: float) -> float:
    """Return the font size, points, at which tables and notes fit a height of the sheet."""
    size = _SIZE
    while size > 3.5:
        lines = sum(
            1.7 + len(one.rows) + 1.0 + 0.6 + (one.more > 0) + 1.2 * (len(_wrapped(one.title, 1.2 * size)) - 1)
            for one in content.tables
        )
        lines += 1.2 + sum(len(_wrapped(f"– {note}", size)) for note in content.notes)
        if lines * _line(size) <= room:
            break
        size -= 0.1
    return size


def _text(figure: Figure, top: float, text: str, size: float) -> float:
    """Write a wrapped text from the height `top` on; return the height below."""
    for part in _wrapped(text, size):
        figure.text(_MARGIN, top - _drop(size), part, fontsize=size, color=look.INK)
        top -= _line(size)
    return top


def _table(figure: Figure, top: float, table: Table, content: Content, size: float) -> float:
    """Write a table from the height `top` on; return the height below."""
    top = _text(figure, top, table.title, 1.2 * size)
    width = 1.0 - 2.0 * _MARGIN
    left = _MARGIN + width * np.concatenate([[0.0], np.cumsum(table.widths)[:-1]])
    head = [table.head] if any(table.head) else []
    for number, row in enumerate([*head, *table.rows], 1 - len(head)):
        for x, share, cell in zip(left, table.widths, row, strict=True):
            letters = int(_PAPER[0] * 72.0 * width * share / (0.56 * size))
            told = cell if len(cell) <= letters else cell[: max(1, letters - 1)] + "…"
            figure.text(float(x), top - _drop(size), told, fontsize=size, color=look.SOFT if number == 0 else look.INK)
        top -= _line(size)
    if table.more:
        told = content.words["more"].format(count=table.more)
        figure.text(_MARGIN, top - _drop(size), told, fontsize=size, color=look.SOFT)
        top -= _line(size)
    return top - 0.6 * _line(size)


def _draw(
    check: DesignCheck, content: Content, figure: Figure, left: float, width: float, low: float, height: float
) -> None:
    """Draw structure, governing mechanism and λ along the path of moving loads."""
    worst, solved, words = check.as_drawn, check.solved, content.words
    values = path_of(check)
    kinds = ["structure", *(["mechanism"] if solved is not None and solved.mechanism is not None else [])]
    kinds += ["path"] if values else []
    share = width / len(kinds)
    for k, kind in enumerate(kinds):
        ax: Axes = figure.add_axes((left + k * share, low, 0.94 * share, height))
        if kind == "structure":
            figures.draw_assembly(ax, worst.structure, check.labels)
        elif kind == "mechanism" and solved is not None:
            figures.draw_mechanism(ax, solved)
        else:
            inset = 0.1 * share
            ax.set_position((left + k * share + inset, low + 0.14 * height, 0.94 * share - inset, 0.82 * height))
            moved_joints.draw_path(ax, values, check.assembly.units[0], distance=words["distance"])
        if kind != "path":
            ax.set_axis_off()
        if legend := ax.get_legend():
            legend.set_visible(kind == "path")
        ax.set_title(words[kind].format(load=f"{worst.bounds.load_factor:.4g}"), fontsize=8, color=look.INK)


def path_of(check: DesignCheck) -> list[moved_joints.PathValue]:
    """Return λ of each position of moving loads under its worst combination."""
    return [
        moved_joints.PathValue(*one.place, one.bounds.low, one.bounds.high, one.required)
        for one in check.cases
        if one.place is not None
    ]
