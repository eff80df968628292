# fmt: off
# mypy: ignore-errors
"""Check a certificate: ``check_certificate.py FILE``. docs/certificate.md is all it knows, and says what it leaves out.

Doubles are used, points are complex numbers: confirmed is a bound SLACK higher, if no face without crushing carries
more than CAP times all loads. It shares no code with jld."""
import hashlib, json, math, sys  # noqa: E401, I001
from itertools import combinations, pairwise, product
from pathlib import Path
SLACK, CAP, TOUCH, NEAR = 1e-6, 1e4, 1e-7, 1e-3
RULES = ("candidates segmentation block_cells block_weight block_mass block_extent symmetry front block_aspect blocks "
         "convex_blocks shapes moulds require assemble sawn_length saw_cuts saw_set_ups")  # after "front": less
def need(condition, text):
    return condition or sys.exit(f"refused: {text}")
def only(part, keys, where):
    return need(isinstance(part, dict) and part.keys() <= set(keys.split()), f"a key in {where} beside {keys}") and part
def whole(values):
    return need(isinstance(values, list) and all(type(v) is int for v in values), "no whole numbers") and values
class Scene:
    def __init__(self, s):
        only(s, "name units source notes expected grid elements thickness materials loads search", "a scene")
        self.materials, self.search = only(s["materials"], "density gravity dry inner", "m"), s.get("search", {})
        need(not (more := self.search.keys() - {*RULES.split()}), f"search.{', search.'.join(more)}")
        values = {type(v) for kind in ("dry", "inner") for v in self.materials.get(kind, {}).values()} <= {int, float}
        need(values and "tensile_strength" not in self.materials.get("dry", {}), "a material with a spread or bond")
        entries, self.thickness = s.get("elements", []), s.get("grid", s).get("thickness", 1.0)
        rows, (w, h) = s.get("grid", {}).get("rows", []), s.get("grid", {}).get("cell", (0, 0))
        for (r, row), c in product(enumerate(rows), range(len(rows[0]) if rows else 0)):
            corners = [((c + i) * w, (len(rows) - 1 - r + j) * h) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
            entries += [{"id": f"c{c}r{r}", "polygon": corners, "support": row[c] == "#"}] * (row[c] != ".")
        need(all("polygon" in e for e in entries), "a spatial scene")
        self.support = [only(e, "id polygon weight density block support", "elements").get("support") for e in entries]
        g = complex(*g) if isinstance(g := self.materials.get("gravity", 9.81), list) else complex(0, -g)
        self.names, self.xy, self.c, self.w, self.gravity = [e["id"] for e in entries], [], [], [], abs(g)
        for e in entries:
            z = [complex(*p) for p in e["polygon"]]
            turns = [(((p - z[0]).conjugate() * (q - z[0])).imag / 2, p + q - 2 * z[0]) for p, q in pairwise(z + z[:1])]
            area = sum(t for t, _ in turns)
            self.xy.append(z if area > 0 else z[::-1])
            self.c.append(z[0] + sum(t * v for t, v in turns) / 3 / area)
            density = e.get("density", self.materials.get("density") or 0)
            self.w.append(e.get("weight", density * abs(area) * self.thickness * self.gravity))
        self.faces, self.touching = [], []  # (a, b, middle, normal from a to b, length); pairs of supports
        for a, b in combinations(range(len(entries)), 2):
            hits = []
            for (p, q), (r, z) in product(*(pairwise(self.xy[k] + self.xy[k][:1]) for k in (a, b))):
                u, short = (q - p) / abs(q - p), min(abs(q - p), abs(z - r))
                far, near = (r - p) / u, (z - p) / u
                low, high, off = max(near.real, 0), min(far.real, abs(q - p)), (abs(near.imag), abs(far.imag))
                if high - low > TOUCH * short and min(off) <= NEAR * short:
                    need(max(off) <= TOUCH * short, "edges that nearly touch")
                    hits.append((a, b, p + (low + high) / 2 * u, -1j * u, high - low))
            need(len(hits) < 2, "two elements that touch along several edges")
            (self.touching if self.support[a] and self.support[b] else self.faces).extend(hits)
        loads, down = only(s["loads"], "dead live cases", "loads"), g / self.gravity if g else -1j  # of stated weights
        own = [{"body": (down.real, down.imag)}, *loads.get("dead", [])]
        self.cases = [(self.forces(own + case.get("dead", [])), self.forces(case["live"]), case.get("required", 1))
                      for case in loads.get("cases", [{"live": loads.get("live")}])]
        need((what := self.search.get("candidates", "all")) in ("all", "all+supports"), "other candidates")
        beside = [f for f, (a, b, *_) in enumerate(self.faces) if self.support[a] or self.support[b]]
        self.fixed = dict.fromkeys(beside if what == "all" else (), True)
        self.inner = {*range(len(self.faces))} - {*beside}
    def forces(self, entries):  # (force, moment) on every element
        found = [(0j, 0.0)] * len(self.w)
        for e in entries:
            k = None if "body" in e else self.names.index(only(e, "element force at moment", "a load")["element"])
            for j in range(len(self.w)) if k is None else [k]:
                size = 1 if k is not None else 0 if self.support[j] else self.w[j]
                f = size * complex(*(e.get("body") or e.get("force") or (0, 0)))
                arm = complex(*e["at"]) - self.c[j] if e.get("at") else 0j
                found[j] = found[j][0] + f, found[j][1] + (arm.conjugate() * f).imag + e.get("moment", 0)
        return found
    def cost(self, length, jump, turn, dry, cap):  # dissipation (3.4) to (3.7)
        m = need(self.materials.get("dry" if dry else "inner"), "a label without a material")
        area, crush, slip = length * self.thickness, m.get("compressive_strength"), abs(jump.imag)
        mu = math.tan(math.radians(m.get("friction_angle", 0))) + m.get("friction_coefficient", 0)
        opening, turn, most = jump.real - mu * slip, length * abs(turn), area * crush if crush else cap
        if dry:
            p = turn / 2 - opening
            part = p if not crush else p * p / (2 * turn) if p < turn else p - turn / 2
            return area * m.get("cohesion", 0) * slip + (most * part if p > 0 else 0)
        tension = area * m["tensile_strength"]
        corner = (tension + most) * turn / 12 + (tension - most) * opening / 2
        ends = (-most * opening, corner) if crush else (tension * turn / 6 + most * (turn / 6 - opening),)
        return area * m["shear_strength"] * slip + max(tension * opening, *ends)
    def stated(self, reason, bound):  # case, digits, labels, bound on λ of the case, limit on normal forces
        case, digits = whole([reason["case"], reason["digits"]])
        need(0 <= case < len(self.cases) and 0 <= digits < 10_000, "a case that is none, or digits")
        stated = [(f, kind == "dry") for kind in ("dry", "inner") for f in whole(reason[kind])]
        known, (dead, live, required) = self.fixed | dict(stated), self.cases[case]
        need(all(0 <= f < len(self.faces) and known[f] is self.fixed.get(f, dry) is dry for f, dry in stated), "labels")
        total, unit = (sum(abs(f) for f, _ in forces) for forces in (dead, live))
        bound = bound * required + SLACK * max(abs(bound * required), total / unit / 1e3 if unit else 0)
        return case, digits, known, bound, CAP * (total + abs(bound) * unit)
    def power(self, forces, moves):
        return sum((forces[k][0].conjugate() * u).real + forces[k][1] * turn for k, (u, turn) in moves.items())
    def speed(self, face, k, moves):  # of the side of an element, along and across the normal, and its turn
        (u, turn), (_, _, mid, n, _) = moves[k], self.faces[face]
        return (u + 1j * turn * (mid - self.c[k])) * n.conjugate(), turn
    def bounds(self, reason, bound):  # the bound of a case, work and dissipation of a mechanism
        case, digits, known, bound, cap = self.stated(reason, bound)
        (dead, live, _), moves = self.cases[case], dict.fromkeys(range(len(self.w)), (0j, 0.0))
        for k, (x, y, turn) in ((int(k), [v / 2**digits for v in whole(u)]) for k, u in reason["moves"].items()):
            need(k in moves and not self.support[k], "an element that does not move")
            moves[k] = complex(x, y), turn
        spent = -self.power(dead, moves)
        for f, (a, b, *_, length) in enumerate(self.faces):
            (va, ta), (vb, tb) = (self.speed(f, k, moves) for k in (a, b))
            labels = [known[f]] if f in known else [True, False]
            spent += max(self.cost(length, vb - va, tb - ta, dry, cap) for dry in labels)
        return bound, self.power(live, moves), spent
    def sizes(self, free):  # with the limits of the scene
        side = max(max(x) - min(x) for x in zip(*((p.real, p.imag) for k in free for p in self.xy[k]), strict=True))
        w = sum(self.w[k] for k in free)
        sizes = {"cells": len(free), "weight": w, "mass": w / (self.gravity or math.inf), "extent": side}
        return [(size, *self.search.get(f"block_{name}", (None, None))) for name, size in sizes.items()]
    def possible(self):  # blocks of a segmentation, with the faces inside and around
        level, found = {frozenset([k]) for k in range(len(self.w)) if not self.support[k]}, []
        while level:
            fine = [m for m in level if not any(top and size > top * (1 + 1e-9) for size, _, top in self.sizes(m))]
            touched = [[f for f, (a, b, *_) in enumerate(self.faces) if a in m or b in m] for m in fine]
            parts = [(m, *([f for f in own if (m >= {*self.faces[f][:2]}) is x] for x in (True, False)))
                     for m, own in zip(fine, touched, strict=True)]
            found += [one for one in parts if not any(self.fixed.get(f) for f in one[1])
                      and not any(low and size < low * (1 - 1e-9) for size, low, _ in self.sizes(one[0]))]
            level = {m | {*self.faces[f][:2]} for m, _, around in parts for f in around if f in self.inner}
        return found
    def by_blocks(self, reason, bound, ceilings):  # whether mechanisms of all possible blocks keep λ below the bound
        case, digits, known, bound, cap = self.stated(reason, bound)
        (dead, live, _), loads = self.cases[case], (bound, max(bound, ceilings[case]))
        walls, prices = ({int(k): [v / 2**digits for v in whole(u)] for k, u in reason[key].items()}
                         for key in ("walls", "prices"))
        own = {frozenset(members): (members, whole(u)) for members, u in reason["blocks"]}
        fine = all(known.get(f) for f in range(len(self.faces)) if f not in self.inner) and walls.keys() <= self.inner
        need(fine and self.search.get("segmentation", True) and not any(self.support[k] for k in prices), "blocks")
        left = [sum(load * s - v for v, s in prices.values()) for load in loads]
        for block, inside, around in self.possible():
            if any(known.get(f) for f in inside) or any(known.get(f) is False for f in around):
                continue
            members, u = own.get(block, (block, [0] * 3 * len(block)))
            parts = zip(members, *([value / 2**digits for value in u[i::3]] for i in range(3)), strict=True)
            moves = {k: (complex(x, y), turn) for k, x, y, turn in parts}
            spent = -self.power(dead, moves)
            for f in inside + around:
                (a, b, *_, length), (x, y, turn) = self.faces[f], walls.get(f, (0, 0, 0))
                (va, ta), (vb, tb) = (self.speed(f, k, moves) if k in moves else (complex(x, y), turn) for k in (a, b))
                spent += self.cost(length, vb - va, tb - ta, f in around, cap)
            held = [prices[k] for k in block if k in prices]
            for i, load in enumerate(loads):
                left[i] += min(0, load * self.power(live, moves) - spent - sum(load * s - v for v, s in held))
        return left[0] >= 0 and (left[1] > 0 or ceilings[case] <= bound)
    def rule(self, kind, given):  # its clause, None where the scene does not ask for it
        if not given or any(not 0 <= k < len(self.w if kind == "small" else self.faces) for k in given):
            return None
        members = set(given if kind == "small" else self.faces[given[0]][:1])
        joining = [] if kind == "small" else [self.faces[f] for f in given[kind == "slit":]]
        pairs = [face[:2] for face in self.touching + joining]
        while kind != "small" and (grown := {k for pair in pairs if members & set(pair) for k in pair} - members):
            members |= grown  # what inner faces join, and supports that touch
        if kind == "slit":
            fine = self.search.get("segmentation", True) and given[0] not in given[1:]
            return [given[0] + 1, *(-f - 1 for f in given[1:])] if fine and self.faces[given[0]][1] in members else None
        if not (free := [k for k in members if not self.support[k]]) or any(len(members & {*p}) == 1 for p in pairs):
            return None
        limits = self.sizes(free)
        if kind == "large" and all(self.faces[f][0] in members for f in given):
            return [-f - 1 for f in given] if any(top and size > top * (1 + 1e-9) for size, _, top in limits) else None
        small = kind == "small" and any(low and size < low * (1 - 1e-9) for size, low, _ in limits)
        return [f + 1 for f, (a, b, *_) in enumerate(self.faces) if (a in members) != (b in members)] if small else None
def follows(lemma, by, clauses):
    false = set(lemma)
    for name in by:
        left = set(clauses[name]) - false if name in clauses else {0, 1}
        if len(left) != 1:
            return not left
        false.add(-left.pop())
    return False
raw = Path(sys.argv[1]).read_bytes()
lines = [json.loads(line) for line in raw.splitlines()]
head, digest = lines[0], hashlib.sha256(raw[: raw.rstrip(b"\n").rfind(b"\n") + 1]).hexdigest()
need(head.get("jld certificate") == 1 and lines[-1] == {"sha256": digest}, "another version, or another digest")
bound, found, scene = head["bound"], head["load_factor"], Scene(head["scene"])
need(type(bound) in (int, float) and math.isfinite(bound) and (found is None or found <= bound), "the claim")
ceilings = [math.inf] * len(scene.cases)
clauses = dict(enumerate(([-f - 1 if dry else f + 1] for f, dry in scene.fixed.items()), 1))
for number, reason in enumerate(lines[1:-1], len(clauses) + 1):
    clause = [f + 1 for f in reason.get("dry", ())] + [-f - 1 for f in reason.get("inner", ())]
    if "moves" in reason:
        top, work, spent = scene.bounds(reason, bound)
        if work < 0 or spent > top * work or (work == 0 and spent >= 0):  # it may bound all labellings, if less
            ceilings[reason["case"]] = min(ceilings[reason["case"]], spent / work if work > 0 else math.inf)
            clause = None if clause or work <= 0 else [1, -1]
    elif "walls" in reason:
        clause = clause if scene.by_blocks(reason, bound, ceilings) else None
    elif "lemma" in reason:
        clause = reason["lemma"] if follows(whole(reason["lemma"]), whole(reason["by"]), clauses) else None
    else:
        clause = scene.rule(*reason, whole(*reason.values())) if [*reason] in (["slit"], ["large"], ["small"]) else None
    clauses[number] = need(clause is not None, f"reason {number}, which does not hold") and clause
need([] in clauses.values(), "reasons that leave labellings")
print(f"verified: no labelling carries more than {bound:.9g} ({SLACK:g} allowed for rounding)")
