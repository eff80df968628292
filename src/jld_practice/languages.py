"""Texts of the printed report in English, German and Italian."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from matplotlib.figure import Figure

from jld_explore.report import words

LANGUAGES: Final = ("en", "de", "it")  # languages of a printed report

# texts of the printed report by key, in the order of LANGUAGES
WORDS: Final[dict[str, tuple[str, str, str]]] = {
    "title": ("Layout of stones", "Steinschnitt", "Disposizione dei conci"),
    "loads": ("Loads", "Lasten", "Carichi"),
    "case": ("load case", "Lastfall", "caso di carico"),
    "load": ("load", "Last", "carico"),
    "times": ("λ × load", "λ × Last", "λ × carico"),
    "body": ("share of the weight", "Anteil des Gewichts", "quota del peso"),
    "at": ("at", "bei", "in"),
    "on": ("on", "auf", "su"),
    "on_stone": ("on stone {numbers}", "auf Stein {numbers}", "sul concio {numbers}"),
    "on_stones": ("on stones {numbers}", "auf den Steinen {numbers}", "sui conci {numbers}"),
    "pressure": ("pressure", "Druck", "pressione"),
    "line": ("force per length", "Kraft je Länge", "forza per lunghezza"),
    "traction": ("force per area", "Kraft je Fläche", "forza per area"),
    "moment": ("moment", "Moment", "momento"),
    "proven": ("What is proven", "Was bewiesen ist", "Che cosa è dimostrato"),
    "by_fields": (
        "The stones carry at least {low} times the live load wherever they crack; no more than {high} times.",
        "Die Steine tragen mindestens das {low}-fache der Last, wo immer sie reißen; höchstens das {high}-fache.",
        "I conci portano almeno {low} volte il carico, ovunque si fessurino; al massimo {high} volte.",
    ),
    "most_by_fields": (
        "The stones carry no more than {high} times the live load wherever they crack; how much is not proven.",
        "Die Steine tragen höchstens das {high}-fache der Last, wo immer sie reißen; wie viel, ist nicht bewiesen.",
        "I conci portano al massimo {high} volte il carico, ovunque si fessurino; quanto, non è dimostrato.",
    ),
    "falls_by_fields": (
        "Wherever the stones crack, the layout falls under its own weight.",
        "Wo immer die Steine reißen: der Steinschnitt fällt unter seinem Eigengewicht.",
        "Ovunque i conci si fessurino, la disposizione cade sotto il peso proprio.",
    ),
    "by_faces": (
        "Cracks along the faces of the cells only: λ lies between {low} and {high}.",
        "Risse nur entlang der Zellflächen: λ liegt zwischen {low} und {high}.",
        "Fessure solo lungo le facce delle celle: λ è compreso tra {low} e {high}.",
    ),
    "at_faces": (
        "Cracks along the faces of the cells only: λ = {low}.",
        "Risse nur entlang der Zellflächen: λ = {low}.",
        "Fessure solo lungo le facce delle celle: λ = {low}.",
    ),
    "locked": (
        "No live load of this pattern is too large for the model: the stones are locked.",
        "Keine Last dieser Art ist dem Modell zu groß: die Steine sind verkeilt.",
        "Nessun carico di questo tipo è eccessivo per il modello: i conci sono bloccati.",
    ),
    "nothing": (
        "Nothing is proven of this layout ({status}).",
        "Über diesen Steinschnitt ist nichts bewiesen ({status}).",
        "Di questa disposizione nulla è dimostrato ({status}).",
    ),
    "strongest": (
        "Proven: no other layout of these cells is stronger by faces.",
        "Bewiesen: kein anderer Schnitt dieser Zellen ist nach Flächen stärker.",
        "Dimostrato: nessun'altra disposizione di queste celle è più forte secondo le facce.",
    ),
    "not_strongest": (
        "Not proven: that no stronger layout exists.",
        "Nicht bewiesen: dass es keinen stärkeren Steinschnitt gibt.",
        "Non dimostrato: che non esista una disposizione più forte.",
    ),
    "stronger_cut": (
        words.STRONGER_CUT,
        "Nach Flächen trägt das Bauwerk ohne diese Schnitte höchstens das {high}-fache der Last, weniger als dieser "
        "Steinschnitt. Ein Riss entlang einer Zellfläche versagt bei seiner Zug- oder Schubfestigkeit; die Reibung "
        "einer trockenen Fuge wächst mit der Last, die auf sie drückt.",
        "Secondo le facce, la struttura senza questi tagli porta al massimo {high} volte il carico, meno di questa "
        "disposizione. Una fessura lungo una faccia delle celle cede alla sua resistenza a trazione o a taglio; "
        "l'attrito di un giunto a secco cresce con il carico che lo preme.",
    ),
    "weaker_cut": (
        "Wherever the stones crack, however, the structure without these cuts carries at least {low} times the load, "
        "more than this layout can.",
        "Wo immer die Steine reißen, trägt das Bauwerk ohne diese Schnitte jedoch mindestens das {low}-fache der Last, "
        "mehr als dieser Steinschnitt tragen kann.",
        "Tuttavia, ovunque i conci si fessurino, la struttura senza questi tagli porta almeno {low} volte il carico, "
        "più di quanto possa questa disposizione.",
    ),
    "stones": ("Stones", "Steine", "Conci"),
    "stone": ("stone", "Stein", "concio"),
    "block": ("block", "Block", "blocco"),
    "mould": ("mould", "Form", "forma"),
    "mass": ("mass", "Masse", "massa"),
    "size": ("smallest cuboid", "kleinster Quader", "cuboide minimo"),
    "cuts": ("cuts", "Schnitte", "tagli"),
    "set_ups": ("set-ups", "Einstellungen", "regolazioni"),
    "waste": ("waste", "Verschnitt", "sfrido"),
    "making": ("Making", "Herstellung", "Lavorazione"),
    "making_words": (
        "{stones} stones of {moulds} moulds; {cuts} sawn faces in {set_ups} set-ups, {sawn}; {mass} in all, the "
        "heaviest lift {heaviest}. One cuboid for each stone: {stock} of stock, {waste} lost.",
        "{stones} Steine aus {moulds} Formen; {cuts} Sägeflächen in {set_ups} Einstellungen, {sawn}; zusammen {mass}, "
        "der schwerste Hub {heaviest}. Je Stein ein Quader: {stock} Rohstein, {waste} Verschnitt.",
        "{stones} conci di {moulds} forme; {cuts} facce segate in {set_ups} regolazioni, {sawn}; in tutto {mass}, il "
        "sollevamento maggiore {heaviest}. Un parallelepipedo per concio: {stock} di grezzo, {waste} di sfrido.",
    ),
    "least": (
        "No other choice of one cuboid per stone loses less.",
        "Keine andere Wahl eines Quaders je Stein verliert weniger.",
        "Nessun'altra scelta di un parallelepipedo per concio perde meno.",
    ),
    "axes": (
        "Cuboids lie along the axes; turned ones may be smaller.",
        "Die Quader liegen entlang der Achsen; gedrehte können kleiner sein.",
        "I parallelepipedi sono paralleli agli assi; ruotati possono essere più piccoli.",
    ),
    "moulds": ("Moulds, lengths in {unit}", "Formen, Längen in {unit}", "Forme, lunghezze in {unit}"),
    "pieces": ("{count} ×", "{count} ×", "{count} ×"),
    "more": ("and {count} more", "und {count} weitere", "e altri {count}"),
    "laying": ("Order of laying", "Reihenfolge des Versetzens", "Ordine di posa"),
    "step": ("step", "Schritt", "passo"),
    "prop": ("prop", "Stütze", "puntello"),
    "way": ("comes", "kommt", "arriva"),
    "from_above": ("from above", "von oben", "dall'alto"),
    "from_below": ("from below", "von unten", "dal basso"),
    "from_left": ("from the left", "von links", "da sinistra"),
    "from_right": ("from the right", "von rechts", "da destra"),
    "along": ("along {axis}", "entlang {axis}", "lungo {axis}"),
    "stands": ("stands", "steht", "sta in piedi"),
    "undecided": ("undecided", "offen", "indeciso"),
    "no_order": (
        "There is no order by translations: stones {names} lock one another.",
        "Keine Reihenfolge aus Verschiebungen: die Steine {names} verkeilen einander.",
        "Nessun ordine per traslazioni: i conci {names} si bloccano a vicenda.",
    ),
    "assumptions": ("Assumptions", "Annahmen", "Ipotesi"),
    "low": ("{value} (low value {low})", "{value} (unterer Wert {low})", "{value} (valore basso {low})"),
    "friction": ("friction of joints {value}", "Reibung der Fugen {value}", "attrito dei giunti {value}"),
    "strength": (
        "tensile and shear strength of the stone {tension} and {shear}",
        "Zug- und Schubfestigkeit des Steins {tension} und {shear}",
        "resistenza a trazione e a taglio della pietra {tension} e {shear}",
    ),
    "whole_thickness": ("thickness {value}", "Dicke {value}", "spessore {value}"),
    "whole_weight": ("weight of all stones {value}", "Gewicht aller Steine {value}", "peso di tutti i conci {value}"),
    "density": ("density {value}", "Dichte {value}", "densità {value}"),
    "rigid": (
        "rigid stones and plastic joints: no settlement, no dynamics, no creep; associative friction",
        "starre Steine und plastische Fugen: keine Setzung, keine Dynamik, kein Kriechen; assoziierte Reibung",
        "conci rigidi e giunti plastici: niente cedimenti, dinamica o viscosità; attrito associato",
    ),
    "warnings": ("Warnings", "Warnungen", "Avvertenze"),
    "page": ("page", "Seite", "pagina"),
}

# texts in the legend of a drawing in German and Italian, by the English text without its number
LEGEND: Final[dict[str, tuple[str, str]]] = {
    "dry face": ("trockene Fuge", "giunto a secco"),
    "inner face": ("innere Fläche", "faccia interna"),
    "support": ("Auflager", "appoggio"),
    "1 block": ("1 Block", "1 blocco"),
    "blocks, by tint": ("Blöcke, nach Farbton", "blocchi, per tinta"),
    "live load, × λ": ("Last, × λ", "carico, × λ"),
    "live load on all bodies, × λ": ("Last auf alle Körper, × λ", "carico su tutti i corpi, × λ"),
    "live couple, × λ": ("Moment, × λ", "coppia, × λ"),
}

# sentences that reports print, as patterns, and their texts in German and Italian
PHRASES: Final[tuple[tuple[re.Pattern[str], str, str], ...]] = tuple(
    (re.compile(english), german, italian)
    for english, german, italian in (
        (r"load at (\S+)", r"Last bei \1", r"carico a \1"),
        (r"push to the right", "Schub nach rechts", "spinta verso destra"),
        (r"push to the left", "Schub nach links", "spinta verso sinistra"),
        (r"each (\S+ \S+)", r"je \1", r"ognuno \1"),
        (
            r"supports below the lowest (?:edges|faces): the (?:drawing|file) names none",
            "Auflager unter den tiefsten Kanten: die Zeichnung nennt keine",
            "appoggi sotto i bordi più bassi: il disegno non ne indica",
        ),
        (
            r"supports beside the raked sides of a flat arch: the drawing names none",
            "Auflager neben den schrägen Seiten eines scheitrechten Bogens: die Zeichnung nennt keine",
            "appoggi accanto ai lati inclinati di una piattabanda: il disegno non ne indica",
        ),
        (
            r"lengths in m: the file names no unit, give --unit",
            "Längen in m: die Datei nennt keine Einheit (--unit)",
            "lunghezze in m: il file non indica unità (--unit)",
        ),
        (
            r"order of laying: not found within (\d+) s; jld assembly searches on",
            r"Reihenfolge des Versetzens: in \1 s nicht gefunden; jld assembly sucht weiter",
            r"ordine di posa: non trovato in \1 s; jld assembly continua la ricerca",
        ),
        (r"thickness 1: give --thickness", "Dicke 1 m (--thickness)", "spessore 1 m (--thickness)"),
        (
            r"the live load is the weight acting sideways: no load was given or drawn",
            "die Last ist das seitlich wirkende Gewicht: es war keine Last angegeben oder gezeichnet",
            "il carico è il peso che agisce di lato: nessun carico era indicato o disegnato",
        ),
        (
            r"the (\d+) elements of the scene are one outline, whose joints are chosen anew",
            r"die \1 Elemente der Szene sind ein Umriss, dessen Fugen neu gewählt werden",
            r"i \1 elementi della scena sono un contorno, i cui giunti sono scelti di nuovo",
        ),
    )
)

_DECIMAL: Final = re.compile(r"(?<![\w.])(\d+)\.(\d+)(?!\.\d)")
_VECTOR: Final = re.compile(r"\(([-−+\d., e]*\.[-−+\d., e]*)\)")


def words_in(language: str, words: Mapping[str, tuple[str, str, str]] = WORDS) -> dict[str, str]:
    index = LANGUAGES.index(language)
    return {key: texts[index] for key, texts in words.items()}


def phrase_in(language: str, text: str) -> str:
    """Return a text in a language, unchanged without a translation."""
    index = LANGUAGES.index(language)
    if index > 0:
        for pattern, *others in PHRASES:
            match = pattern.fullmatch(text)
            if match is not None:
                return match.expand(others[index - 1])
    return text


def digits(value: float) -> str:
    """Write a number with four significant digits, large ones without an exponent."""
    text = f"{value:.4g}"
    return f"{float(text):.0f}" if "e+" in text else text


def decimal_commas(text: str) -> str:
    """Write decimal points of numbers in a text as commas, commas between entries as ";"."""
    separated = _VECTOR.sub(lambda match: match.group().replace(", ", "; "), text)
    return _DECIMAL.sub(r"\1,\2", separated)


def localise(page: Figure, language: str, names: Container[str] = ()) -> None:
    # 5.062 would be five thousand in German and Italian.
    from matplotlib.text import Text

    if language == LANGUAGES[0]:
        return
    index = LANGUAGES.index(language) - 1
    for axes in page.axes:
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(lambda value, _: decimal_commas(f"{value:g}").replace("-", "−"))
        legend = axes.get_legend()
        for entry in legend.get_texts() if legend is not None else ():
            number, separator, remainder = entry.get_text().partition(" ")
            counted = separator and number.isdigit() and remainder in LEGEND
            translated = LEGEND.get(remainder if counted else entry.get_text())
            if translated is not None:
                entry.set_text(f"{number} {translated[index]}" if counted else translated[index])
    for text in page.findobj(Text):
        if isinstance(text, Text) and text.get_text() not in names:
            text.set_text(decimal_commas(phrase_in(language, text.get_text())))
