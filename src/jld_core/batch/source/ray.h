// Forces that may grow for ever: A R + l = 0 with R in the recession cones, sought as max lambda <= 1 and checked like
// a state. Where one is found, and any state besides, every load is carried.
#pragma once
#include "interior.h"

namespace jld {

// The problem of rays: rows without strength, no dead load, and -lambda in the place of lambda, so that what bounds
// it is the bound that there is.
template <class Face>
struct Recession {
    JldProblem p;
    std::vector<double> rows, keep, dead, live, nothing;

    explicit Recession(const JldProblem& from)
        : p(from), rows(from.rows, from.rows + size_t(from.labels) * from.faces * Face::NUMBERS),
          keep(from.keep, from.keep + size_t(from.labels) * from.faces), dead(Face::Q * from.elements, 0.0),
          live(from.live, from.live + Face::Q * from.elements),
          nothing(Face::Q * (from.faces > from.elements ? from.faces : from.elements), 0.0) {
        for (double& x : live) x = -x;
        for (size_t face = 0; face < keep.size(); ++face)
            if (Face::recede(&rows[face * Face::NUMBERS])) keep[face] = 0.0, p.dropping = 1;
        p.rows = rows.data(), p.keep = keep.data(), p.dead = dead.data(), p.live = live.data();
        p.forces = p.jumps = p.speed = nothing.data();
        p.load = 0.0, p.room = 1.0, p.push = 1.0, p.floor = 1.0, p.opening = nullptr, p.bows = nullptr;
    }
};

template <class Face>
struct Ray {
    static constexpr int Q = Face::Q;
    // a face with less slack than that, beside what is carried, takes nothing; added to A K A'
    static constexpr double TIGHT = 1e-6, LOOSE = 1e-10;
    static constexpr double LAST_DIGIT = 8.0 * 2.220446049250313e-16;  // share of the largest force that is zero
    const JldProblem& p;  // of rays
    Sides<Q> sides;
    Work<Face>& w;
    Mask found;

    Ray(const JldProblem& problem, Work<Face>& lanes) : p(problem), sides{problem}, w(lanes) {}

    void run() {
        const int n = Q * p.elements;
        Lane *left = w.left.data(), by = 1.0 / select(w.load < 0.0, -w.load, splat(1.0));
        w.clear();
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane least = o.s[0];
            for (int r = 1; r < Face::ROWS; ++r) least = smaller(least, o.s[r]);
            // of a face that takes nothing the first weight is zero
            o.z[0] = select(least * by > TIGHT, splat(1.0), splat(0.0));
            for (int k = 0; k < Q; ++k) o.F[k] *= by * o.z[0] * (Face::drops(k) ? o.keep : splat(1.0));
            sides.template squared<Lane>(f, o.keep, w.diagonal.data(), w.off.data(), o.z[0]);
        }
        w.loosen(LOOSE);
        Factor<Q, Lane>::factor(p.pattern, w.diagonal.data(), w.off.data());
        Lane unbalanced = splat(0.0), largest = splat(1.0), error = splat(0.0), sum = by;
        for (int pass = 0; pass < 5; ++pass) {
            const bool last = pass == 4;
            for (int k = 0; k < n; ++k) left[k] = splat(-p.live[k]);
            for (int f = 0; f < p.faces; ++f) sides.add(f, w.face[f].F, w.face[f].keep, left);
            if (last)
                for (int k = 0; k < n; ++k)
                    unbalanced = select(absolute(left[k]) <= unbalanced, unbalanced, absolute(left[k]));
            Factor<Q, Lane>::template solve<1>(p.pattern, w.diagonal.data(), w.off.data(), left, 0);
            for (int f = 0; f < p.faces; ++f) {
                Face& o = w.face[f];
                Lane x[Q];
                sides.jump(f, left, o.keep, x);
                for (int k = 0; k < Q; ++k) {
                    x[k] *= o.z[0];
                    if (last) error = select(absolute(x[k]) <= error, error, absolute(x[k]));
                    else o.F[k] -= x[k];
                    sum += o.F[k], largest = larger(largest, absolute(o.F[k]));
                }
            }
        }
        found = (w.load < 0.0) & (error <= p.noise) & (unbalanced <= p.noise * largest) & (absolute(sum) < 1e30) &
                holds(largest);
    }

    // Does each face and each element by itself hold but for rounding, beside what meets there where that is below 1?
    // Rounding of large live loads elsewhere must not hide what a small one asks for (jld_core.limit.bounds.Prover.ray).
    Mask holds(Lane largest) {
        const int n = Q * p.elements;
        Lane *left = w.left.data(), *met = w.held.data(), lacks = splat(-1.0);
        for (int k = 0; k < n; ++k) left[k] = splat(-p.live[k]);
        for (int e = 0; e < p.elements; ++e) {
            met[e] = splat(0.0);
            for (int k = 0; k < Q; ++k) met[e] = larger(met[e], absolute(left[Q * e + k]));
        }
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane own = splat(0.0);
            for (int k = 0; k < Q; ++k) own = larger(own, absolute(o.F[k]));
            // what elements that bear nothing show is the last digit of the factors
            Mask bears = own > LAST_DIGIT * largest;
            for (int k = 0; k < Q; ++k) o.F[k] = select(bears, o.F[k], splat(0.0));
            own = select(bears, own, splat(0.0));
            sides.add(f, o.F, o.keep, left);
            for (int e : {p.low[f], p.high[f]})
                if (e >= 0) met[e] += own;
            lacks = larger(lacks, -o.slack(o.F) - p.noise * smaller(own, splat(1.0)));
        }
        for (int e = 0; e < p.elements; ++e)
            for (int k = 0; k < Q; ++k)
                lacks = larger(lacks, absolute(left[Q * e + k]) - p.noise * smaller(met[e], splat(1.0)));
        return lacks <= 0.0;
    }
};

}  // namespace jld
