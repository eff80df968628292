// Rays of unbounded load: A R + l = 0 with R in the recession cones, (3.12), sought as max lambda <= 1 and checked like
// forces. A ray and any admissible forces prove that every load is carried, (3.14).
#pragma once
#include "interior.h"

namespace jld {

// Problem of rays: rows without strength, no dead load, and -lambda for lambda, so that the row of lambda bounds it.
template <class Face>
struct Recession {
    JldProblem problem;
    std::vector<double> rows, keep, dead, live, nothing;

    // Return how many numbers all live loads have.
    static size_t loads(const JldProblem& p) {
        return size_t(p.own_loads ? p.labels : 1) * Face::FREEDOMS * p.elements;
    }

    explicit Recession(const JldProblem& from)
        : problem(from),
          rows(from.rows, from.rows + size_t(from.labels) * from.faces * Face::NUMBERS),
          keep(from.keep, from.keep + size_t(from.labels) * from.faces),
          dead(loads(from), 0.0),
          live(from.live, from.live + loads(from)),
          nothing(Face::FREEDOMS * (from.faces > from.elements ? from.faces : from.elements), 0.0) {
        for (double& x : live) x = -x;
        for (size_t face = 0; face < keep.size(); ++face)
            if (Face::recede(&rows[face * Face::NUMBERS])) keep[face] = 0.0, problem.drops_shear = 1;
        problem.rows = rows.data(), problem.keep = keep.data(), problem.dead = dead.data(), problem.live = live.data();
        problem.forces = problem.jumps = problem.velocity = nothing.data();
        problem.load = 0.0, problem.least_slack = 1.0, problem.least_multiplier = 1.0, problem.floor = 1.0,
        problem.opening = nullptr, problem.parabolas = nullptr;
    }
};

template <class Face>
struct Ray {
    static constexpr int FREEDOMS = Face::FREEDOMS;
    // A face with less slack, relative to the forces, carries nothing; added to A K A'.
    static constexpr double TIGHT = 1e-6, LOOSE = 1e-10;
    static constexpr double LAST_DIGIT = 8.0 * 2.220446049250313e-16;  // share of the largest force that counts as zero
    const JldProblem& problem;                                         // of rays
    Sides<FREEDOMS> sides;
    Workspace<Face>& lanes;
    Mask found;

    Ray(const JldProblem& problem, Workspace<Face>& lanes) : problem(problem), sides{problem}, lanes(lanes) {}

    void run() {
        const int n = FREEDOMS * problem.elements;
        Lane *left = lanes.left.data(), by = 1.0 / select(lanes.load < 0.0, -lanes.load, splat(1.0));
        lanes.clear(problem);
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            Lane least = o.row_slack[0];
            for (int r = 1; r < Face::ROWS; ++r) least = smaller(least, o.row_slack[r]);
            // Weight 0 marks a face that carries nothing.
            o.row_multiplier[0] = select(least * by > TIGHT, splat(1.0), splat(0.0));
            for (int k = 0; k < FREEDOMS; ++k)
                o.force[k] *= by * o.row_multiplier[0] * (Face::drops(k) ? o.keep : splat(1.0));
            sides.template squared<Lane>(f, o.keep, lanes.diagonal.data(), lanes.off.data(), o.row_multiplier[0]);
        }
        lanes.loosen(LOOSE);
        Factor<FREEDOMS, Lane>::factor(problem.pattern, lanes.diagonal.data(), lanes.off.data());
        Lane unbalanced = splat(0.0), largest = splat(1.0), error = splat(0.0), sum = by;
        for (int pass = 0; pass < 5; ++pass) {
            const bool last = pass == 4;
            for (int k = 0; k < n; ++k) left[k] = -lanes.live[k];
            for (int f = 0; f < problem.faces; ++f) sides.add(f, lanes.face[f].force, lanes.face[f].keep, left);
            if (last)
                for (int k = 0; k < n; ++k)
                    unbalanced = select(absolute(left[k]) <= unbalanced, unbalanced, absolute(left[k]));
            Factor<FREEDOMS, Lane>::template solve<1>(problem.pattern, lanes.diagonal.data(), lanes.off.data(), left,
                                                      0);
            for (int f = 0; f < problem.faces; ++f) {
                Face& o = lanes.face[f];
                Lane x[FREEDOMS];
                sides.jump(f, left, o.keep, x);
                for (int k = 0; k < FREEDOMS; ++k) {
                    x[k] *= o.row_multiplier[0];
                    if (last) error = select(absolute(x[k]) <= error, error, absolute(x[k]));
                    else o.force[k] -= x[k];
                    sum += o.force[k], largest = larger(largest, absolute(o.force[k]));
                }
            }
        }
        found = (lanes.load < 0.0) & (error <= problem.noise) & (unbalanced <= problem.noise * largest) &
                (absolute(sum) < 1e30) & holds(largest);
    }

    // Return where each face and each element by itself holds up to rounding relative to the forces there, at most
    // relative to 1. Rounding of large live loads elsewhere must not hide a small load here (jld_core.limit.bounds).
    Mask holds(Lane largest) {
        const int n = FREEDOMS * problem.elements;
        Lane *left = lanes.left.data(), *met = lanes.held.data(), lacks = splat(-1.0);
        for (int k = 0; k < n; ++k) left[k] = -lanes.live[k];
        for (int e = 0; e < problem.elements; ++e) {
            met[e] = splat(0.0);
            for (int k = 0; k < FREEDOMS; ++k) met[e] = larger(met[e], absolute(left[FREEDOMS * e + k]));
        }
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            Lane own = splat(0.0);
            for (int k = 0; k < FREEDOMS; ++k) own = larger(own, absolute(o.force[k]));
            // Forces of elements that carry nothing are rounding of the factors.
            Mask bears = own > LAST_DIGIT * largest;
            for (int k = 0; k < FREEDOMS; ++k) o.force[k] = select(bears, o.force[k], splat(0.0));
            own = select(bears, own, splat(0.0));
            sides.add(f, o.force, o.keep, left);
            for (int e : {problem.low[f], problem.high[f]})
                if (e >= 0) met[e] += own;
            lacks = larger(lacks, -o.slack(o.force) - problem.noise * smaller(own, splat(1.0)));
        }
        for (int e = 0; e < problem.elements; ++e)
            for (int k = 0; k < FREEDOMS; ++k)
                lacks = larger(lacks, absolute(left[FREEDOMS * e + k]) - problem.noise * smaller(met[e], splat(1.0)));
        return lacks <= 0.0;
    }
};

}  // namespace jld
