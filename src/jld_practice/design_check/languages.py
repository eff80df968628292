"""Texts of the page of a design check in English, German and Italian."""

from __future__ import annotations

from typing import Final

from jld_core.scene.design import STATED, UNREDUCED

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
    "any_load": ("no live load brings it down", "keine Nutzlast bringt es zum Einsturz", "nessun carico lo abbatte"),
    "falls": (
        "falls under its permanent loads",
        "fällt unter seinen ständigen Lasten",
        "cade sotto i carichi permanenti",
    ),
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
    STATED: (STATED, "in der Szene angegeben", "indicato nella scena"),
    UNREDUCED: (UNREDUCED, "nicht in diesem Satz", "non in questa serie"),
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
"""Texts by key, in the order of `report.languages.LANGUAGES`."""
