// Both bounds from what an interior point left, whatever that is: forces projected on equilibrium and measured in
// every yield set, velocities whose dissipation is finite. Nothing here trusts what came before.
#pragma once
#include "interior.h"

namespace jld {

template <class Face>
struct Proof {
    typedef Work<Face> Lanes;
    static constexpr int Q = Face::Q;
    // added to A K A'; share of the fastest velocity that rounding may make of a jump; least live work beside what a
    // load could do at that speed
    static constexpr double LOOSE = 1e-10, SNAP = 1e-12, IDLE = 1e-3, MOVES = 1e-5;
    const JldProblem& p;
    const JldTry& how;
    const Shared<Q>& shared;
    Sides<Q> sides;
    Lanes& w;
    Lane slack, error, margin, low, high, speed;
    Mask falls;

    Proof(const JldProblem& problem, const JldTry& settings, const Shared<Q>& common, Lanes& lanes)
        : p(problem), how(settings), shared(common), sides{problem}, w(lanes) {}

    void run() {
        state();
        motion();
    }

    // (A K A')^-1 r in place: one factor for all lanes, or one each where labels drop V
    void solve(Lane* r) {
        if (p.dropping)
            Factor<Q, Lane>::template solve<1>(p.pattern, w.diagonal.data(), w.off.data(), r, 0);
        else
            Factor<Q, double>::template solve<1>(p.pattern, shared.diagonal.data(), shared.off.data(), r, 0);
    }

    JLD_ONCE void state() {
        const int n = Q * p.elements;
        if (p.dropping) {
            w.clear();
            for (int f = 0; f < p.faces; ++f)
                sides.template squared<Lane>(f, w.face[f].keep, w.diagonal.data(), w.off.data(), splat(1.0));
            w.loosen(LOOSE);
            Factor<Q, Lane>::factor(p.pattern, w.diagonal.data(), w.off.data());
        }
        // without V equilibrium may hold at one lambda alone, which then moves with the forces
        Lane *left = w.left.data(), *reach = w.rhs.data(), corner = splat(1.0);
        const int passes = p.dropping ? 5 : 3;
        if (p.dropping) {
            for (int k = 0; k < n; ++k) reach[k] = splat(p.live[k]);
            solve(reach);
            corner += w.dot(p.live, reach);
        }
        // a sum remembers what is no number, a maximum may not
        Lane unbalanced = splat(0.0), largest = splat(1.0), sum = w.load;
        error = splat(0.0), slack = splat(1e300);
        for (int pass = 0; pass < passes; ++pass) {
            const bool last = pass == passes - 1;
            for (int k = 0; k < n; ++k) left[k] = p.dead[k] + p.live[k] * w.load;
            for (int f = 0; f < p.faces; ++f) sides.add(f, w.face[f].F, w.face[f].keep, left);
            // a correction does not see what no force can balance
            unbalanced = splat(0.0);
            for (int k = 0; k < n; ++k) unbalanced = select(absolute(left[k]) <= unbalanced, unbalanced, absolute(left[k]));
            solve(left);
            if (p.dropping) {
                Lane dl = w.dot(p.live, left) / corner;
                for (int k = 0; k < n; ++k) left[k] -= reach[k] * dl;
                if (!last) w.load -= dl;
                else error = select(absolute(dl) <= error, error, absolute(dl));
            }
            for (int f = 0; f < p.faces; ++f) {
                Face& o = w.face[f];
                Lane x[Q];
                sides.jump(f, left, o.keep, x);
                for (int k = 0; k < Q; ++k) {
                    if (!last) o.F[k] -= x[k], o.F[k] *= Face::drops(k) ? o.keep : splat(1.0);
                    else error = select(absolute(x[k]) <= error, error, absolute(x[k]));
                }
                if (last) {
                    for (int k = 0; k < Q; ++k) largest = larger(largest, absolute(o.F[k]));
                    Lane s = o.slack(o.F);
                    sum += s;
                    slack = select(s >= slack, slack, s);
                }
            }
        }
        sum += w.load;
        Mask good = (slack >= 2.0 * error) & (unbalanced <= p.noise * largest) & (absolute(sum) < 1e30);
        low = select(good, w.load, splat(-std::numeric_limits<double>::infinity()));
    }

    void polished(Lane* u) {
        const int n = Q * p.elements;
        w.clear();
        Lane* left = w.left.data();
        // where velocities outgrow all bounds multipliers tell what moves, forces do not
        Lane wild = select(speed > 1e3, MOVES * speed, splat(1e300));
        Store<Lane>& spans = span;
        spans.resize(6 * p.faces);
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            if constexpr (Face::BOWED) o.touch();
            Lane P[6] = {splat(1.0), splat(0.0), splat(1.0), splat(0.0), splat(0.0), splat(1.0)};
            for (int r = 0; r < Face::ROWS; ++r) {
                Lane normal[3] = {o.normal(r, 0), o.normal(r, 1), o.normal(r, 2)};
                Lane v[3];
                v[0] = P[0] * normal[0] + P[1] * normal[1] + P[3] * normal[2];
                v[1] = P[1] * normal[0] + P[2] * normal[1] + P[4] * normal[2];
                v[2] = P[3] * normal[0] + P[4] * normal[1] + P[5] * normal[2];
                Lane size = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
                Lane whole = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
                Mask on = ((o.s[r] < how.active) | (o.z[r] > wild)) & (size > 1e-12 * whole);
                Lane by = select(on, 1.0 / select(on, size, splat(1.0)), splat(0.0));
                P[0] -= by * v[0] * v[0], P[1] -= by * v[0] * v[1], P[2] -= by * v[1] * v[1];
                P[3] -= by * v[0] * v[2], P[4] -= by * v[1] * v[2], P[5] -= by * v[2] * v[2];
            }
            P[1] *= o.keep, P[2] *= o.keep, P[4] *= o.keep;
            // any jump of a row that bows is paid for: where others cannot open they alone say how it moves
            if constexpr (Face::BOWED)
                for (int k = 0; k < 6 && !p.opening; ++k) P[k] = select(o.bow > 0.0, splat(0.0), P[k]);
            for (int k = 0; k < 6; ++k) spans[6 * f + k] = P[k];
            sides.template full<Lane>(f, P, w.diagonal.data(), w.off.data());
        }
        for (int e = 0; e < p.elements; ++e)
            for (int k = 0; k < 3; ++k) w.diagonal[6 * e + at(k, k)] += 1e-9;
        Factor<Q, Lane>::factor(p.pattern, w.diagonal.data(), w.off.data());
        for (int pass = 0; pass < 3; ++pass) {
            for (int k = 0; k < n; ++k) left[k] = splat(0.0);
            for (int f = 0; f < p.faces; ++f) {
                const Lane* P = &spans[6 * f];
                Lane j[3], x[3];
                sides.jump(f, u, w.face[f].keep, j);
                x[0] = P[0] * j[0] + P[1] * j[1] + P[3] * j[2];
                x[1] = P[1] * j[0] + P[2] * j[1] + P[4] * j[2];
                x[2] = P[3] * j[0] + P[4] * j[1] + P[5] * j[2];
                sides.add(f, x, w.face[f].keep, left);
            }
            Factor<Q, Lane>::template solve<1>(p.pattern, w.diagonal.data(), w.off.data(), left, 0);
            for (int k = 0; k < n; ++k) u[k] -= left[k];
        }
    }

    // Margin and bound. snapped: jumps are those on the spans of `polished`, where they lie but for rounding.
    Lane measure(const Lane* u, Lane& bound, bool snapped = false) {
        Lane least = splat(1e300), total = splat(0.0), noise = splat(0.0);
        if (snapped)
            for (int k = 0; k < Q * p.elements; ++k) noise = larger(noise, absolute(u[k]));
        noise *= SNAP;
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane j[Q], m, d;
            sides.jump(f, u, o.keep, j);
            if constexpr (Q == 3)
                if (snapped) {
                    Lane off = snap(&span[6 * f], j, noise);
                    least = smaller(least, noise - off);
                    o.dissipation(j, m, d);
                    // on a span that is no whole space a margin that is rounding is none
                    const Lane* P = &span[6 * f];
                    Mask held = (P[0] + P[2] + P[5] > 0.5) & (absolute(m) <= noise);
                    least = select((m >= least) | held, least, m);
                    total += d;
                    continue;
                }
            o.dissipation(j, m, d);
            least = select(m >= least, least, m);
            total += d;
        }
        bound = total - w.dot(p.dead, u);
        return least;
    }

    // A jump onto its span, P being what is left of it; how far off it was.
    static Lane snap(const Lane* P, Lane* j, Lane noise) {
        Lane x[3] = {P[0] * j[0] + P[1] * j[1] + P[3] * j[2], P[1] * j[0] + P[2] * j[1] + P[4] * j[2],
                     P[3] * j[0] + P[4] * j[1] + P[5] * j[2]};
        Lane off = splat(0.0), size = splat(0.0);
        for (int k = 0; k < 3; ++k) {
            off = larger(off, absolute(x[k]));
            j[k] -= x[k], size = larger(size, absolute(j[k]));
        }
        // what is below the rounding of the sums it comes from is no jump
        for (int k = 0; k < 3; ++k) j[k] = select(size <= 1e-3 * noise, splat(0.0), j[k]);
        return off;
    }

    Lane opened() {
        Lane least = splat(1e300);
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane j[Q], m, d;
            Lane* u = w.du.data();
            sides.jump(f, u, o.keep, j);
            o.dissipation(j, m, d);
            least = smaller(least, m);
        }
        return least;
    }

    // The motion as it is and, planar, polished; the better bound counts.
    JLD_ONCE void motion() {
        const int n = Q * p.elements;
        Lane* u = w.u.data();
        Lane work = w.dot(p.live, u), fastest = splat(0.0);
        for (int k = 0; k < n; ++k) fastest = larger(fastest, absolute(u[k]));
        speed = fastest;
        // where the live load hardly works the motion is measured by its speed
        Lane by = 1.0 / select(work > 1e-6 * fastest, work, fastest);
        for (int k = 0; k < n; ++k) u[k] *= by;
        best.resize(n);
        for (int k = 0; k < n; ++k) best[k] = u[k];
        high = splat(std::numeric_limits<double>::infinity());
        falls = high < 0.0;
        bound(best.data(), best.data());
        if constexpr (Q == 3) again(u);
    }

    // Velocities moved so that each face jumps along the normals of the rows it lies at. In space the direction of
    // sliding is known to the root of the gap only, and moving there would lose more than it mends.
    void again(Lane* u) {
        const int n = Q * p.elements;
        polished(u);
        Lane unit = w.dot(p.live, u);
        Mask works = unit > 1e-9;
        Lane once = select(works, 1.0 / select(works, unit, splat(1.0)), splat(1.0));
        for (int k = 0; k < n; ++k) u[k] *= once;
        bound(u, best.data(), !p.opening);
    }

    // Opens a motion just enough, and keeps it where its bound is the lowest yet.
    JLD_ONCE void bound(Lane* u, Lane* kept, bool snapped = false) {
        const int n = Q * p.elements;
        Lane total, fastest, missing = measure(u, total, snapped);
        margin = missing;
        if (p.opening) {
            Lane* opening = w.du.data();
            for (int k = 0; k < n; ++k) opening[k] = splat(p.opening[k]);
            Lane open = opened();
            for (int round = 0; round < 3; ++round) {
                fastest = splat(0.0);
                for (int k = 0; k < n; ++k) fastest = larger(fastest, absolute(u[k]));
                Mask lacks = (missing < 1e-16 * fastest) & (open > 0.0);
                Lane most = (2e-16 * fastest - missing) / select(open > 0.0, open, splat(1.0));
                Lane share = select(lacks, (1.0 + round) * most, splat(0.0));
                for (int k = 0; k < n; ++k) u[k] += share * opening[k];
                missing = measure(u, total);
            }
        }
        Lane work = w.dot(p.live, u), sum = splat(0.0), heavy = splat(0.0);
        double weight = 0.0, strongest = 0.0;
        fastest = splat(0.0);
        for (int k = 0; k < n; ++k) {
            Lane speed = absolute(u[k]);
            double dead = std::fabs(p.dead[k]);
            heavy += dead * speed, sum += std::fabs(p.live[k]) * speed, weight += dead;
            strongest = std::fabs(p.live[k]) > strongest ? std::fabs(p.live[k]) : strongest;
            fastest = larger(fastest, speed);
        }
        Lane noise = p.noise * (heavy + absolute(total) + 1e-3 * weight * fastest);
        Mask finite = (missing >= 0.0) & (absolute(total) < 1e30) & (fastest < 1e30);
        // a live work that is rounding bounds nothing
        Mask useful = finite & (work > 1e3 * p.noise * sum) & (work > 1e-3 * fastest * p.noise);
        if (snapped) useful = useful & (work > IDLE * strongest * fastest);
        Lane found = select(useful, total / work, splat(std::numeric_limits<double>::infinity()));
        Mask falling = finite & (work >= 0.0) & (total < -larger(noise, splat(p.noise) * fastest));
        Mask better = (found < high) | (falling & ~falls);
        for (int k = 0; k < n; ++k) kept[k] = select(better, u[k], kept[k]);
        high = smaller(high, found);
        falls = falls | falling;
    }

    Store<Lane> best;
    Store<Lane> span;
};

}  // namespace jld
