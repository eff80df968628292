"""Page of a design check: the same content as PDF of one sheet and as HTML."""

from __future__ import annotations

import html
import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

import jld_core
from jld_core import Status, blocks_of, files, tolerances
from jld_core.build import materials, weight_facts
from jld_core.limit import effects, number
from jld_core.scene import cracks as scene_cracks
from jld_core.scene import design as scene_design
from jld_core.scene import standard, uncertain
from jld_practice import languages
from jld_practice.design_check.check import LISTED, CaseCheck, DesignCheck, at_design_values
from jld_practice.reactions.thrust import Reserve
from jld_views import figures, look, moved_joints, writing

# texts by key, in the order of `languages.LANGUAGES`
WORDS: Final[dict[str, tuple[str, str, str]]] = {
    "title": ("Design check", "Nachweis", "Verifica di progetto"),
    "verified": (
        "Verified: utilisation {use} ≤ 1, proven for every load case and combination.",
        "Nachgewiesen: Ausnutzung {use} ≤ 1, bewiesen für jeden Lastfall und jede Kombination.",
        "Verificato: utilizzo {use} ≤ 1, dimostrato per ogni caso di carico e combinazione.",
    ),
    "refuted": (
        "Not verified: utilisation {use} > 1, proven.",
        "Nicht nachgewiesen: Ausnutzung {use} > 1, bewiesen.",
        "Non verificato: utilizzo {use} > 1, dimostrato.",
    ),
    "fallen": (
        "Not verified: the design permanent loads alone have no equilibrium, proven.",
        "Nicht nachgewiesen: die Bemessungswerte der ständigen Lasten allein haben kein Gleichgewicht, bewiesen.",
        "Non verificato: i soli carichi permanenti di progetto non hanno equilibrio, dimostrato.",
    ),
    "undecided": (
        "Not proven: utilisation lies between {low} and {high}.",
        "Nicht bewiesen: die Ausnutzung liegt zwischen {low} und {high}.",
        "Non dimostrato: l'utilizzo è compreso tra {low} e {high}.",
    ),
    "worst": (
        "Governing: {case}; {combination}.",
        "Maßgebend: {case}; {combination}.",
        "Determinante: {case}; {combination}.",
    ),
    "by_faces": (
        "By the faces drawn: {value}.",
        "Nach den gezeichneten Flächen: {value}.",
        "Per le facce date: {value}.",
    ),
    "by_cells": ("By cells: {value}.", "Nach Zellen: {value}.", "Per celle: {value}."),
    "by_anywhere": (
        "Wherever blocks crack: {value}.",
        "Wo immer Blöcke reißen: {value}.",
        "Ovunque i blocchi si fessurino: {value}.",
    ),
    "governs": ("This governs.", "Dies ist maßgebend.", "Questo è determinante."),
    "between": ("between {low} and {high}", "zwischen {low} und {high}", "tra {low} e {high}"),
    "unbounded": ("no bound found in time", "keine Schranke in der Zeit", "nessun limite nel tempo dato"),
    "any_load": ("no live load brings it down", "keine Nutzlast bringt es zum Einsturz", "nessun carico lo abbatte"),
    "falls": ("falls under its permanent loads", "fällt unter ständigen Lasten", "cade sotto i carichi permanenti"),
    "rigid": (
        "Blocks do not crack: the scene states no strengths of theirs.",
        "Blöcke reißen nicht: die Szene nennt keine Festigkeiten.",
        "I blocchi non si fessurano: la scena non indica resistenze.",
    ),
    "equilibrium": (
        "Bodies are rigid in a check of static equilibrium (EN 1990, 6.4.1(1)P).",
        "Körper sind starr im Nachweis der Lagesicherheit (EN 1990, 6.4.1(1)P).",
        "I corpi sono rigidi nella verifica di equilibrio statico (EN 1990, 6.4.1(1)P).",
    ),
    "not_anywhere": (
        "Cracks elsewhere in the blocks are not checked: {reason}.",
        "Risse anderswo in den Blöcken sind nicht geprüft: {reason}.",
        "Fessure altrove nei blocchi non sono verificate: {reason}.",
    ),
    "only": ("the live load", "die Nutzlast", "il carico variabile"),
    "factors": ("Partial factors: {name}", "Teilsicherheitsbeiwerte: {name}", "Coefficienti parziali: {name}"),
    "factor": ("factor", "Beiwert", "coefficiente"),
    "value": ("favourable / unfavourable", "günstig / ungünstig", "favorevole / sfavorevole"),
    "source": ("source", "Quelle", "fonte"),
    "self_weight": ("γG, self-weight", "γG, Eigengewicht", "γG, peso proprio"),
    "dead": ("γG, other permanent loads", "γG, andere ständige Lasten", "γG, altri carichi permanenti"),
    "prestressing": ("γP, prestress", "γP, Vorspannung", "γP, precompressione"),
    "live": ("γQ, live loads", "γQ, veränderliche Lasten", "γQ, carichi variabili"),
    "strength": ("γM, strengths, cohesion", "γM, Festigkeiten, Kohäsion", "γM, resistenze, coesione"),
    "friction": ("γM, friction tan φ", "γM, Reibung tan φ", "γM, attrito tan φ"),
    "members": ("γM, members", "γM, Zugglieder, Bolzen", "γM, tiranti, perni"),
    scene_design.STATED: (scene_design.STATED, "in der Szene angegeben", "indicato nella scena"),
    scene_design.UNREDUCED: (scene_design.UNREDUCED, "nicht in diesem Satz", "non in questa serie"),
    "masonry": (
        "Masonry units of category {units}, {mortar} mortar, class {execution} of execution control.",
        "Mauersteine der Kategorie {units}, {mortar}, Ausführungsklasse {execution}.",
        "Elementi di categoria {units}, {mortar}, classe di esecuzione {execution}.",
    ),
    "designed": ("designed", "Mörtel nach Eignungsprüfung", "malta a prestazione garantita"),
    "prescribed": ("prescribed", "Rezeptmörtel", "malta a composizione prescritta"),
    "largest": (
        "Units, mortar and execution are not stated: the largest γM is taken.",
        "Steine, Mörtel und Ausführung sind nicht angegeben: der größte Wert γM gilt.",
        "Elementi, malta ed esecuzione non sono indicati: vale il γM maggiore.",
    ),
    "materials": (
        "Materials in {force} and {length}: characteristic and design values",
        "Baustoffe in {force} und {length}: charakteristische Werte und Bemessungswerte",
        "Materiali in {force} e {length}: valori caratteristici e di progetto",
    ),
    "dry": ("joints", "Fugen", "giunti"),
    "inner": ("blocks", "Blöcke", "blocchi"),
    "tan_phi": ("tan φ", "tan φ", "tan φ"),
    "cohesion": ("cohesion", "Kohäsion", "coesione"),
    "tensile_strength": ("tensile strength", "Zugfestigkeit", "resistenza a trazione"),
    "shear_strength": ("shear strength", "Schubfestigkeit", "resistenza a taglio"),
    "compressive_strength": ("compressive strength", "Druckfestigkeit", "resistenza a compressione"),
    "whole_thickness": ("thickness", "Dicke", "spessore"),
    "whole_density": ("density", "Dichte", "densità"),
    "whole_weight": ("characteristic weight of all", "charakteristisches Gewicht", "peso caratteristico totale"),
    "of_faces": (
        "Faces with values of their own are reduced alike.",
        "Flächen mit eigenen Werten werden ebenso abgemindert.",
        "Le facce con valori propri sono ridotte allo stesso modo.",
    ),
    "cases": ("Utilisation", "Ausnutzung", "Utilizzo"),
    "case": ("load case", "Lastfall", "caso di carico"),
    "required": ("required", "verlangt", "richiesto"),
    "combination": ("permanent loads", "ständige Lasten", "carichi permanenti"),
    "use": ("required / λ", "verlangt / λ", "richiesto / λ"),
    "verdict": ("result", "Ergebnis", "esito"),
    "yes": ("verified", "erfüllt", "verificato"),
    "no": ("not verified", "nicht erfüllt", "non verificato"),
    "open": ("not proven", "nicht bewiesen", "non dimostrato"),
    "weight": ("self-weight", "Eigengewicht", "peso proprio"),
    "stated": ("others", "andere", "altri"),
    "prestress": ("prestress", "Vorspannung", "precompressione"),
    "reactions": (
        "Reactions under the governing design loads, in {force} and {length}: least … greatest, proven",
        "Auflagerkräfte unter den maßgebenden Bemessungslasten in {force} und {length}: kleinste … größte, bewiesen",
        "Reazioni sotto i carichi di progetto determinanti, in {force} e {length}: minima … massima, dimostrate",
    ),
    "support": ("support", "Auflager", "appoggio"),
    "joints": (
        "Joints nearest to their limit: a state exists in which no face uses more than {share} of its capacity",
        "Fugen nahe der Grenze: es gibt einen Zustand, in dem keine Fläche mehr als {share} ihrer Grenze nutzt",
        "Giunti più vicini al limite: esiste uno stato in cui nessuna faccia usa più di {share} della sua capacità",
    ),
    "joint": ("joint", "Fuge", "giunto"),
    "eccentricity": ("eccentricity", "Ausmitte", "eccentricità"),
    "of_limit": ("of its limit", "der Grenze", "del limite"),
    "slip": ("slip reserve", "Gleitreserve", "riserva di attrito"),
    "share": ("share used", "genutzt", "quota usata"),
    "blocks": ("Blocks nearest to cracking", "Blöcke nahe am Riss", "Blocchi più vicini alla fessurazione"),
    "block": ("block", "Block", "blocco"),
    "face": ("face", "Fläche", "faccia"),
    "bars": ("Members in this state", "Zugglieder und Bolzen in diesem Zustand", "Tiranti e perni in questo stato"),
    "member": ("member", "Bauteil", "elemento"),
    "force": ("force", "Kraft", "forza"),
    "notes": (
        "Assumptions, and what the check does not cover",
        "Annahmen, und was der Nachweis nicht enthält",
        "Ipotesi, e che cosa la verifica non comprende",
    ),
    "psi": (
        "All live loads of a case have the factor γQ; ψ of accompanying actions belongs into the loads of the scene.",
        "Alle veränderlichen Lasten eines Falls haben γQ; ψ von Begleitlasten gehört in die Lasten der Szene.",
        "Tutti i carichi variabili di un caso hanno γQ; ψ delle azioni concomitanti va nei carichi della scena.",
    ),
    "parts": (
        "Self-weight is one action, all its parts have the same factor (EN 1990, 6.4.3.1(4) is for EQU: --set).",
        "Das Eigengewicht ist eine Einwirkung, seine Teile haben denselben Beiwert (EN 1990, 6.4.3.1(4): EQU, --set).",
        "Il peso proprio è una sola azione, con lo stesso coefficiente (EN 1990, 6.4.3.1(4) vale per EQU: --set).",
    ),
    "each_part": (
        "Each element's self-weight and dead load is an individual action (EN 1990, 6.4.3.1(4)); the bounds hold for "
        "all choices of their factors. Strengths are not reduced: strength is another check (EN 1990, 6.4.1(1)).",
        "Eigengewicht und ständige Last jedes Elements sind eigene Einwirkungen (EN 1990, 6.4.3.1(4)); die Schranken "
        "gelten für alle Wahlen der Beiwerte. Festigkeiten sind nicht abgemindert: eigener Nachweis (6.4.1(1)).",
        "Peso proprio e carico permanente di ogni elemento sono azioni distinte (EN 1990, 6.4.3.1(4)); i limiti "
        "valgono per ogni scelta dei coefficienti. Le resistenze non sono ridotte: verifica a parte (6.4.1(1)).",
    ),
    "of_parts": (
        "by parts γG = {low} / {high}, unfavourable: {names}",
        "nach Teilen γG = {low} / {high}, ungünstig: {names}",
        "per parti γG = {low} / {high}, sfavorevoli: {names}",
    ),
    "nothing_else": (
        "Recommended values, no national annex. No serviceability, fatigue, fire, accidental or seismic situation, "
        "settlement, second order, slenderness or soil.",
        "Empfohlene Werte, kein nationaler Anhang. Keine Gebrauchstauglichkeit, Ermüdung, Brand, außergewöhnliche oder "
        "Erdbebensituation, Setzung, Theorie II. Ordnung, Schlankheit, kein Boden.",
        "Valori raccomandati, nessun annesso nazionale. Nessuno stato di esercizio, fatica, incendio, situazione "
        "eccezionale o sismica, cedimento, secondo ordine, snellezza o terreno.",
    ),
    "model": (
        "Rigid blocks that crack {cracks}; plastic joints, associative friction. Without dilation λ may be smaller.",
        "Starre Blöcke, Risse {cracks}; plastische Fugen mit assoziierter Reibung. Ohne Dilatanz kann λ kleiner sein.",
        "Blocchi rigidi con fessure {cracks}; giunti plastici, attrito associato. Senza dilatanza λ può essere minore.",
    ),
    "faces": ("along stated faces", "entlang gegebener Flächen", "lungo facce date"),
    "cells": ("along the faces of cells", "entlang von Zellflächen", "lungo le facce delle celle"),
    "fields": ("anywhere (fields)", "überall (Felder)", "ovunque (campi)"),
    "and": ("and", "und", "e"),
    "by_fields": (
        "Fields give no reactions and no reserves of joints.",
        "Felder liefern keine Auflagerkräfte und keine Reserven von Fugen.",
        "I campi non danno reazioni né riserve dei giunti.",
    ),
    "no_state": (
        "Reactions and reserves are those of a structure that is verified; there are none here.",
        "Auflagerkräfte und Reserven gibt es nur, wenn der Nachweis gelingt; hier fehlen sie.",
        "Reazioni e riserve esistono solo se la verifica riesce; qui mancano.",
    ),
    "uncertain": (
        "Of values with a distribution, strengths count by their 5 % fractile (EN 1990, 4.2(3)), live loads by their "
        "98 % fractile (4.1.2(7)), permanent loads by their mean (4.1.2(3)).",
        "Von Werten mit Verteilung gilt für Festigkeiten das 5-%-Fraktil (EN 1990, 4.2(3)), für veränderliche Lasten "
        "das 98-%-Fraktil (4.1.2(7)), für ständige Lasten das Mittel (4.1.2(3)).",
        "Dei valori con distribuzione valgono il frattile 5 % (resistenze; EN 1990, 4.2(3)), il frattile 98 % (carichi "
        "variabili; 4.1.2(7)) e la media (carichi permanenti; 4.1.2(3)).",
    ),
    "with_members": (
        "Reactions are those of the faces of supports; forces of members anchored there add to them. A member without "
        "stated tension keeps its design prestress.",
        "Auflagerkräfte sind die der Auflagerflächen, Kräfte dort verankerter Bauteile kommen hinzu. Ein Spannglied "
        "ohne angegebene Zugkraft behält den Bemessungswert der Vorspannung.",
        "Le reazioni sono quelle delle facce; si aggiungono le forze degli elementi ancorati. Un elemento senza "
        "trazione indicata mantiene la precompressione di progetto.",
    ),
    "more": (
        "and {count} more, in design_check.json",
        "und {count} weitere, in design_check.json",
        "e altri {count}, in design_check.json",
    ),
    "structure": ("structure, governing load", "Tragwerk, maßgebende Last", "struttura, carico determinante"),
    "mechanism": (
        "collapse as drawn at λ = {load}",
        "Versagen wie gezeichnet bei λ = {load}",
        "collasso come disegnato a λ = {load}",
    ),
    "path": ("λ along the path", "λ entlang des Weges", "λ lungo il percorso"),
    "distance": ("first axle along the path", "erste Achse entlang des Weges", "primo asse lungo il percorso"),
}


@dataclass(frozen=True)
class Table:
    """Table of a page: title, head and rows of texts; `more` counts rows that are left out."""

    title: str
    head: list[str]
    rows: list[list[str]]
    widths: list[float]  # shares of the page's width
    more: int = 0


@dataclass(frozen=True)
class Content:
    title: str
    result: list[str]
    tables: list[Table]
    notes: list[str]
    words: Mapping[str, str] = field(default_factory=dict)


def content_of(check: DesignCheck, language: str = "en") -> Content:
    """Return the content of the page in one language: "en", "de" or "it"."""
    words = languages.words_in(language, WORDS)
    tables = [_factors(check, words), _materials(check, words), _cases(check, words)]
    if check.reactions:
        tables.append(_reactions(check, words))
    if check.reserve is not None:
        tables += [
            table for table in (_joints(check, words), _blocks(check, words), _members(check, words)) if table.rows
        ]
    return Content(
        f"{words['title']}: {check.scene.name}", _result(check, words), tables, notes_of(check, words), words
    )


def _result(check: DesignCheck, words: Mapping[str, str]) -> list[str]:
    """Return the sentences of the verdict."""
    worst = check.governing
    low, high = worst.range
    if worst.verified is None:
        first = words["undecided"].format(low=_shown(low), high=_shown(high))
    elif worst.verified:
        first = words["verified"].format(use=_shown(worst.utilisation))
    else:
        use = _shown(low) if high - low <= 1e-3 * high else f"{_shown(low)} … {_shown(high)}"
        first = words["fallen"] if math.isinf(low) else words["refuted"].format(use=use)
    case = worst.name or words["only"]
    governing = words["worst"].format(case=case, combination=_combination(check, worst, words))
    return [first, governing, *_by_model(check, words)]


def _by_model(check: DesignCheck, words: Mapping[str, str]) -> list[str]:
    """Return the sentence that sets λ by the faces drawn beside λ wherever blocks crack."""
    if kind_of(check) == "fields":
        return [words["by_anywhere"].format(value=_values(check.as_drawn, words))]
    sentences = [words[f"by_{kind_of(check)}"].format(value=_values(check.as_drawn, words))]
    anywhere = check.if_anywhere
    if anywhere is not None:
        more = "" if anywhere is not check.governing else f" {words['governs']}"
        sentences.append(words["by_anywhere"].format(value=_values(anywhere, words)) + more)
    else:
        reason = {"rigid": words["rigid"], "equilibrium": words["equilibrium"]}.get(check.not_anywhere)
        sentences.append(reason or words["not_anywhere"].format(reason=check.not_anywhere))
    return [" ".join(sentences)]


def kind_of(check: DesignCheck) -> str:
    """Return the kind of the crack model of the scene: faces, cells or fields."""
    return check.scene.cracks if isinstance(check.scene.cracks, str) else check.scene.cracks.kind


def _values(case: CaseCheck, words: Mapping[str, str]) -> str:
    """Return λ and utilisation of a case in words: one number each where proven closely, else both bounds."""
    low, high = case.range
    if case.bounds.status is Status.LOCKED:
        return words["any_load"]
    if case.stands is False or case.bounds.status is Status.UNSTABLE:
        return words["falls"]
    if high - low <= 1e-3 * high < math.inf:
        return f"λ = {_shown(case.bounds.load_factor)}, {words['use']} = {_shown(case.utilisation)}"
    if not (math.isfinite(case.bounds.low) or math.isfinite(case.bounds.high)):
        return words["unbounded"]
    ends = (_shown(end) if math.isfinite(end) else "?" for end in (case.bounds.low, case.bounds.high))
    load = words["between"].format(low=next(ends), high=next(ends))
    use = words["between"].format(low=_shown(low), high=_shown(high))
    return f"λ {load}, {words['use']} {use}"


def _combination(check: DesignCheck, case: CaseCheck, words: Mapping[str, str]) -> str:
    """Describe the factors of permanent loads that differ or act alone."""
    chosen = case.combination.factors(check.factors)
    if check.factors.by_parts:
        (low, high), heavier = check.factors.self_weight, case.combination.heavier
        names = textwrap.shorten(", ".join(heavier), 60, placeholder=" …") or "–"
        parts_text = words["of_parts"].format(low=f"{low:g}", high=f"{high:g}", names=names)
        return parts_text + (
            f", {words['prestress']} γP = {chosen['prestressing']:g}" if check.assembly.members else ""
        )
    varied = {
        name for other in check.tried[0] for name, value in vars(other.combination).items() if value != "unfavourable"
    }
    parts = []
    for name, word, sign in (
        ("self_weight", "weight", "γG"),
        ("dead", "stated", "γG"),
        ("prestressing", "prestress", "γP"),
    ):
        if name in varied:
            parts.append(f"{words[word]} {sign} = {chosen[name]:g}")
    return ", ".join(parts) or f"γG = {chosen['self_weight']:g}"


def _factors(check: DesignCheck, words: Mapping[str, str]) -> Table:
    rows = []
    for factor in fields(check.factors)[1:-1]:
        value = getattr(check.factors, factor.name)
        text = f"{value[0]:g} / {value[1]:g}" if isinstance(value, tuple) else f"{value:g}"
        source = check.factors.clauses[factor.name]
        rows.append([words[factor.name], text, words.get(source, source)])
    title = words["factors"].format(name=check.factors.name)
    return Table(title, [words["factor"], words["value"], words["source"]], rows, [0.27, 0.25, 0.48])


def _materials(check: DesignCheck, words: Mapping[str, str]) -> Table:
    """Return the table of the values that the scene states for all joints and blocks."""
    low, _ = check.factors.prestressing
    scenes = (check.scene, at_design_values(check.scene, check.factors, low))
    parts: list[tuple[str, str, list[float]]] = []
    for key in ("dry", "inner"):
        both = [getattr(scene.materials, key) for scene in scenes]
        if both[0] is None:
            continue
        if any(materials.friction(label) for label in both):
            parts.append((key, "tan_phi", [materials.friction(label) or 0.0 for label in both]))
        for name in standard.STRESS_KEYS:
            values = [getattr(label, name, None) for label in both]
            if values[0]:
                parts.append((key, name, [float(value or 0.0) for value in values]))
    cells = [f"{words[key]}: {words[name]} {first:.4g} / {second:.4g}" for key, name, (first, second) in parts]
    rows = [[*cells[k : k + 2], ""][:2] for k in range(0, len(cells), 2)]
    facts = weight_facts(check.scene, check.assembly)
    lines = [f"{words[f'whole_{name}']}: {facts[name]}" for name in ("thickness", "density", "weight") if name in facts]
    rows += [[*lines[k : k + 2], ""][:2] for k in range(0, len(lines), 2)]
    length, force = check.assembly.units
    return Table(words["materials"].format(force=force, length=length), ["", ""], rows, [0.5, 0.5])


def _cases(check: DesignCheck, words: Mapping[str, str]) -> Table:
    """Return the load cases, the most utilised first where there are many."""
    verdicts = {True: words["yes"], False: words["no"], None: words["open"]}
    every = (*check.cases, *check.anywhere)
    order = sorted(range(len(every)), key=lambda k: (-every[k].range[1], k))
    listed = sorted(order[:LISTED])
    rows = []
    for k in listed:
        case = every[k]
        load = "∞" if str(case.bounds.status) == "locked" else _shown(case.bounds.load_factor)
        name = textwrap.shorten(case.name or words["only"], 30, placeholder=" …")
        name += f", {words['fields']}" if k >= len(check.cases) else ""
        combination = _combination(check, case, words)
        rows.append([name, f"{case.required:g}", combination, load, _shown(case.utilisation), verdicts[case.verified]])
    head = [words["case"], words["required"], words["combination"], "λ", words["use"], words["verdict"]]
    return Table(words["cases"], head, rows, [0.22, 0.09, 0.36, 0.09, 0.11, 0.13], len(order) - len(listed))


def _reactions(check: DesignCheck, words: Mapping[str, str]) -> Table:
    """Return the table of reactions: supports by components."""
    ranges: dict[str, dict[str, str]] = {}  # by support, then component
    largest = max(abs(end) for reaction in check.reactions for end in (*reaction.interval, 0.0) if end is not None)
    for reaction in check.reactions:
        low, high = (_end(end, largest) for end in reaction.interval)
        support = reaction.resultant.place.removeprefix("support ")
        ranges.setdefault(support, {})[reaction.resultant.component] = low if low == high != "–" else f"{low} … {high}"
    components = list(next(iter(ranges.values())))
    rows = [[textwrap.shorten(support, 14, placeholder=" …"), *row.values()] for support, row in ranges.items()]
    length, force = check.assembly.units
    title = words["reactions"].format(force=force, length=length)
    widths = [0.14, *[0.86 / len(components)] * len(components)]
    listed = rows[:LISTED]
    return Table(title, [words["support"], *components], listed, widths, len(rows) - len(listed))


def _joints(check: DesignCheck, words: Mapping[str, str]) -> Table:
    length, force = check.assembly.units
    joints = joints_of(check)
    share = "–" if check.reserve is None else f"{100.0 * check.reserve.bracket[1]:.1f} %"
    rows = [
        [
            "–".join(joint["elements"]),
            f"{joint['N']:.4g}",
            "–" if joint["eccentricity"] is None else f"{joint['eccentricity']:.4g}",
            _percent(joint["bending_share"]),
            _percent(joint["slip_reserve"]),
            _percent(joint["share"]),
        ]
        for joint in joints[:LISTED]
    ]
    head = [
        words["joint"],
        f"N [{force}]",
        f"{words['eccentricity']} [{length}]",
        words["of_limit"],
        words["slip"],
        words["share"],
    ]
    widths = [0.28, 0.14, 0.18, 0.14, 0.14, 0.12]
    return Table(words["joints"].format(share=share), head, rows, widths, max(0, len(joints) - LISTED))


def _blocks(check: DesignCheck, words: Mapping[str, str]) -> Table:
    blocks = blocks_near_cracking(check)
    rows = [[block["block"], "–".join(block["face"]), _percent(block["share"])] for block in blocks[:LISTED]]
    head = [words["block"], words["face"], words["share"]]
    return Table(words["blocks"], head, rows, [0.3, 0.5, 0.2], max(0, len(blocks) - LISTED))


def _members(check: DesignCheck, words: Mapping[str, str]) -> Table:
    members = members_of(check)
    rows = [[member["name"], f"{member['force']:.4g}", _percent(member["share"])] for member in members[:LISTED]]
    head = [words["member"], f"{words['force']} [{check.assembly.units[1]}]", words["share"]]
    return Table(words["bars"], head, rows, [0.5, 0.25, 0.25], max(0, len(members) - LISTED))


def notes_of(check: DesignCheck, words: Mapping[str, str]) -> list[str]:
    """Return sentences on what a check assumes and does not cover."""
    kind = kind_of(check)
    parts = words["each_part" if check.factors.by_parts else "parts"]
    cracks = words[kind] + (f" {words['and']} {words['fields']}" if check.anywhere else "")
    notes = [words["model"].format(cracks=cracks), words["psi"], parts, words["nothing_else"]]
    design = check.scene.design
    if check.factors.name == "EN 1996-1-1" and check.factors.clauses["strength"].startswith("EN"):
        has_design = design is not None and design.model_fields_set & {"units", "mortar", "execution"}
        largest = words["largest"]
        if design is not None and has_design:
            masonry = {"units": design.units, "mortar": words[design.mortar], "execution": design.execution}
            largest = words["masonry"].format(**masonry)
        notes.insert(0, largest)
    if any(True for _ in uncertain.uncertain_values(check.scene)):
        notes.append(words["uncertain"])
    if check.scene.materials.faces or check.scene.interfaces:
        notes.append(words["of_faces"])
    if check.scene.members:
        notes.append(words["with_members"])
    if kind == "fields":
        notes.append(words["by_fields"])
    elif check.reserve is None:
        notes.append(words["no_state"])
    return notes


def joints_of(check: DesignCheck) -> list[dict[str, Any]]:
    """Return the dry faces as plain values, those that use most of their capacity first."""
    reserve, worst = check.reserve, check.as_drawn.structure
    if reserve is None:
        return []
    faces = np.flatnonzero(check.labels & ~worst.of_members)
    order = sorted(faces.tolist(), key=lambda k: (-round(float(reserve.share[k]), 6), k))
    return [_joint(check, reserve, k) for k in order]


def _joint(check: DesignCheck, reserve: Reserve, face: int) -> dict[str, Any]:
    """Return one joint as plain values; the eccentricity is None where nothing presses it."""
    structure = check.as_drawn.structure
    ids, joints = structure.elements.ids, structure.interfaces
    normal, forces = float(reserve.forces[face, 0]), reserve.forces[face]
    moment = abs(float(forces[2])) if structure.dimension == 2 else float(np.hypot(forces[3], forces[4]))
    idle = not normal > 1e-9 * float(np.abs(reserve.forces[:, 0]).max(initial=0.0))
    return {
        "face": face,
        "elements": [ids[joints.a[face]], ids[joints.b[face]]],
        "N": normal,
        "eccentricity": None if idle else moment / normal,
        "bending_share": float(reserve.bending[face]),
        "slip_reserve": 1.0 - float(reserve.slip[face]),
        "share": float(reserve.share[face]),
    }


def blocks_near_cracking(check: DesignCheck) -> list[dict[str, Any]]:
    """Return each block that may crack, with its most utilised inner face, nearest first."""
    reserve, structure = check.reserve, check.as_drawn.structure
    if reserve is None:
        return []
    block, joints, ids = blocks_of(structure, check.labels), structure.interfaces, structure.elements.ids
    worst: dict[int, int] = {}
    for face in np.flatnonzero(~check.labels & ~structure.of_members).tolist():
        owner = int(block[joints.a[face]])
        if owner not in worst or reserve.share[face] > reserve.share[worst[owner]] + 1e-6:
            worst[owner] = face
    blocks = []
    for owner, face in sorted(worst.items(), key=lambda pair: (-round(float(reserve.share[pair[1]]), 6), pair[0])):
        elements = np.flatnonzero(block == owner)
        name = structure.elements.blocks[elements[0]] or ids[elements[0]]
        pair = [ids[joints.a[face]], ids[joints.b[face]]]
        blocks.append({"block": name, "face": pair, "share": float(reserve.share[face])})
    return blocks


def members_of(check: DesignCheck) -> list[dict[str, Any]]:
    """Return forces of members, and the share used of the capacity beyond the prestress."""
    reserve, structure = check.reserve, check.as_drawn.structure
    if reserve is None or not structure.members:
        return []
    force = effects(structure, reserve.forces)
    share = [0.0 if face < 0 else float(reserve.share[face]) for face in structure.members.face.tolist()]
    return [
        {"name": name, "force": float(axial), "share": used}
        for name, axial, used in zip(structure.members.names, force, share, strict=True)
    ]


def to_json(check: DesignCheck) -> dict[str, Any]:
    worst = check.governing
    length, force = check.assembly.units
    return {
        "name": check.scene.name,
        "version": jld_core.__version__,
        "units": {"length": length, "force": force},
        **check.factors.to_json(),
        "verified": check.verified,
        "utilisation": number(worst.utilisation),
        "governing": worst.name or None,
        "combination": vars(worst.combination),
        "by_drawn": {"cracks": scene_cracks.cracks_to_json(check.scene.cracks), **check.as_drawn.to_json()},
        "anywhere": None if check.if_anywhere is None else check.if_anywhere.to_json(),
        "not_anywhere": check.not_anywhere or None,
        "cases": [
            {"case": case.name or None, **case.to_json(), "combinations": [other.to_json() for other in tried]}
            for case, tried in zip(check.cases, check.tried, strict=True)
        ],
        "reactions": [reaction.to_json() for reaction in check.reactions],
        "share_of_capacity": None if check.reserve is None else list(check.reserve.bracket),
        "joints": joints_of(check),
        "blocks": blocks_near_cracking(check),
        "members": members_of(check),
        "not_covered": notes_of(check, languages.words_in("en", WORDS)),
        "warnings": list(check.assembly.warnings),
    }


def in_words(check: DesignCheck) -> str:
    content = content_of(check)
    lines = [content.title, *content.result]
    for table in content.tables:
        widths = [max(len(row[k]) for row in [table.head, *table.rows]) for k in range(len(table.head))]
        lines += ["", table.title]
        for row in ([table.head] if any(table.head) else []) + table.rows:
            lines.append("  " + "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip())
        if table.more:
            lines.append("  " + content.words["more"].format(count=table.more))
    return "\n".join([*lines, "", content.words["notes"], *(f"  {note}" for note in content.notes)])


def _shown(value: float) -> str:
    """Return a number in four digits; ∞ for infinity, a dash for NaN."""
    return "–" if math.isnan(value) else "∞" if math.isinf(value) else f"{value:.4g}"


def _end(value: float | None, largest: float) -> str:
    """Return an end of a range in four digits, a dash where there is none."""
    return "–" if value is None else f"{0.0 if abs(value) <= tolerances.GAP * largest else value:.4g}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


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


def _wrap(text: str, size: float) -> list[str]:
    """Return the lines of a text on the sheet; size: of letters, points."""
    return textwrap.wrap(text, int(_PAPER[0] * 72.0 * (1.0 - 2.0 * _MARGIN) / (0.53 * size))) or [""]


def _fitting(content: Content, room: float) -> float:
    """Return the font size, points, at which tables and notes fit a height of the sheet."""
    size = _SIZE
    while size > 3.5:
        lines = sum(
            1.7 + len(table.rows) + 1.0 + 0.6 + (table.more > 0) + 1.2 * (len(_wrap(table.title, 1.2 * size)) - 1)
            for table in content.tables
        )
        lines += 1.2 + sum(len(_wrap(f"– {note}", size)) for note in content.notes)
        if lines * _line(size) <= room:
            break
        size -= 0.1
    return size


def _text(figure: Figure, top: float, text: str, size: float) -> float:
    """Write a wrapped text from the height `top` on; return the height below."""
    for part in _wrap(text, size):
        figure.text(_MARGIN, top - _drop(size), part, fontsize=size, color=look.INK)
        top -= _line(size)
    return top


def _table(figure: Figure, top: float, table: Table, content: Content, size: float) -> float:
    """Write a table from the height `top` on; return the height below."""
    top = _text(figure, top, table.title, 1.2 * size)
    width = 1.0 - 2.0 * _MARGIN
    left = _MARGIN + width * np.concatenate([[0.0], np.cumsum(table.widths)[:-1]])
    head = [table.head] if any(table.head) else []
    for line, row in enumerate([*head, *table.rows], 1 - len(head)):
        for x, share, cell in zip(left, table.widths, row, strict=True):
            letters = int(_PAPER[0] * 72.0 * width * share / (0.56 * size))
            more = cell if len(cell) <= letters else cell[: max(1, letters - 1)] + "…"
            figure.text(float(x), top - _drop(size), more, fontsize=size, color=look.SOFT if line == 0 else look.INK)
        top -= _line(size)
    if table.more:
        more = content.words["more"].format(count=table.more)
        figure.text(_MARGIN, top - _drop(size), more, fontsize=size, color=look.SOFT)
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
        moved_joints.PathValue(*case.place, case.bounds.low, case.bounds.high, case.required)
        for case in check.cases
        if case.place is not None
    ]
