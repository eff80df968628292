// Proven bounds (3.3) from any iterate: forces are projected onto equilibrium, (3.9), and measured in every yield set;
// velocities are checked for finite dissipation, (3.4) to (3.7). No result of the iterations is trusted.
#pragma once
#include "interior.h"

namespace jld {

template <class Face>
struct Proof {
    typedef Workspace<Face> Lanes;
    static constexpr int FREEDOMS = Face::FREEDOMS;
    // Added to A K A'. Share of the largest velocity that rounding may make of a jump. Least live power relative to
    // what a load could do at that speed. Multiplier, relative to the velocities, above which a row moves.
    static constexpr double LOOSE = 1e-10, SNAP = 1e-12, IDLE = 1e-3, MOVES = 1e-5;
    const JldProblem& problem;
    const JldTry& how;
    const Shared<FREEDOMS>& shared;
    Sides<FREEDOMS> sides;
    Lanes& lanes;
    Lane slack, error, margin, low, high, speed;
    Mask falls;

    Proof(const JldProblem& problem, const JldTry& settings, const Shared<FREEDOMS>& common, Lanes& lanes)
        : problem(problem), how(settings), shared(common), sides{problem}, lanes(lanes) {}

    void run() {
        state();
        motion();
    }

    // Solve (A K A') x = r in place, with one factor for all lanes, or one per lane where labels drop V.
    void solve(Lane* r) {
        if (problem.drops_shear)
            Factor<FREEDOMS, Lane>::template solve<1>(problem.pattern, lanes.diagonal.data(), lanes.off.data(), r, 0);
        else
            Factor<FREEDOMS, double>::template solve<1>(problem.pattern, shared.diagonal.data(), shared.off.data(), r,
                                                        0);
    }

    JLD_NOINLINE void state() {
        const int n = FREEDOMS * problem.elements;
        if (problem.drops_shear) {
            lanes.clear(problem);
            for (int f = 0; f < problem.faces; ++f)
                sides.template squared<Lane>(f, lanes.face[f].keep, lanes.diagonal.data(), lanes.off.data(),
                                             splat(1.0));
            lanes.loosen(LOOSE);
            Factor<FREEDOMS, Lane>::factor(problem.pattern, lanes.diagonal.data(), lanes.off.data());
        }
        // Where V is dropped, equilibrium may hold at one lambda only, so lambda is corrected with the forces.
        Lane *left = lanes.left.data(), *reach = lanes.rhs.data(), corner = splat(1.0);
        const int passes = problem.drops_shear ? 5 : 3;
        if (problem.drops_shear) {
            for (int k = 0; k < n; ++k) reach[k] = lanes.live[k];
            solve(reach);
            corner += lanes.dot(lanes.live, reach);
        }
        // The sum detects NaN, which a maximum may ignore.
        Lane unbalanced = splat(0.0), largest = splat(1.0), sum = lanes.load;
        error = splat(0.0), slack = splat(1e300);
        for (int pass = 0; pass < passes; ++pass) {
            const bool last = pass == passes - 1;
            for (int k = 0; k < n; ++k) left[k] = lanes.dead[k] + lanes.live[k] * lanes.load;
            for (int f = 0; f < problem.faces; ++f) sides.add(f, lanes.face[f].force, lanes.face[f].keep, left);
            // Residual that no force can balance; the correction does not show it.
            unbalanced = splat(0.0);
            for (int k = 0; k < n; ++k)
                unbalanced = select(absolute(left[k]) <= unbalanced, unbalanced, absolute(left[k]));
            solve(left);
            if (problem.drops_shear) {
                Lane dl = lanes.dot(lanes.live, left) / corner;
                for (int k = 0; k < n; ++k) left[k] -= reach[k] * dl;
                if (!last) lanes.load -= dl;
                else error = select(absolute(dl) <= error, error, absolute(dl));
            }
            for (int f = 0; f < problem.faces; ++f) {
                Face& o = lanes.face[f];
                Lane x[FREEDOMS];
                sides.jump(f, left, o.keep, x);
                for (int k = 0; k < FREEDOMS; ++k) {
                    if (!last) o.force[k] -= x[k], o.force[k] *= Face::drops(k) ? o.keep : splat(1.0);
                    else error = select(absolute(x[k]) <= error, error, absolute(x[k]));
                }
                if (last) {
                    for (int k = 0; k < FREEDOMS; ++k) largest = larger(largest, absolute(o.force[k]));
                    Lane s = o.slack(o.force);
                    sum += s;
                    slack = select(s >= slack, slack, s);
                }
            }
        }
        sum += lanes.load;
        Mask good = (slack >= 2.0 * error) & (unbalanced <= problem.noise * largest) & (absolute(sum) < 1e30);
        low = select(good, lanes.load, splat(-std::numeric_limits<double>::infinity()));
    }

    void polished(Lane* u) {
        const int n = FREEDOMS * problem.elements;
        lanes.clear(problem);
        Lane* left = lanes.left.data();
        // Where velocities are very large, multipliers show which rows move; slacks do not.
        Lane wild = select(speed > 1e3, MOVES * speed, splat(1e300));
        Store<Lane>& spans = span;
        spans.resize(6 * problem.faces);
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            if constexpr (Face::PARABOLIC) o.touch();
            Lane P[6] = {splat(1.0), splat(0.0), splat(1.0), splat(0.0), splat(0.0), splat(1.0)};
            for (int r = 0; r < Face::ROWS; ++r) {
                Lane normal[3] = {o.normal(r, 0), o.normal(r, 1), o.normal(r, 2)};
                Lane v[3];
                v[0] = P[0] * normal[0] + P[1] * normal[1] + P[3] * normal[2];
                v[1] = P[1] * normal[0] + P[2] * normal[1] + P[4] * normal[2];
                v[2] = P[3] * normal[0] + P[4] * normal[1] + P[5] * normal[2];
                Lane size = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
                Lane whole = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
                Mask on = ((o.row_slack[r] < how.active) | (o.row_multiplier[r] > wild)) & (size > 1e-12 * whole);
                Lane by = select(on, 1.0 / select(on, size, splat(1.0)), splat(0.0));
                P[0] -= by * v[0] * v[0], P[1] -= by * v[0] * v[1], P[2] -= by * v[1] * v[1];
                P[3] -= by * v[0] * v[2], P[4] -= by * v[1] * v[2], P[5] -= by * v[2] * v[2];
            }
            P[1] *= o.keep, P[2] *= o.keep, P[4] *= o.keep;
            // Parabolas have finite dissipation for any jump; where no motion opens all faces, only other rows restrict
            // it.
            if constexpr (Face::PARABOLIC)
                for (int k = 0; k < 6 && !problem.opening; ++k) P[k] = select(o.curvature > 0.0, splat(0.0), P[k]);
            for (int k = 0; k < 6; ++k) spans[6 * f + k] = P[k];
            sides.template full<Lane>(f, P, lanes.diagonal.data(), lanes.off.data());
        }
        for (int e = 0; e < problem.elements; ++e)
            for (int k = 0; k < 3; ++k) lanes.diagonal[6 * e + at(k, k)] += 1e-9;
        Factor<FREEDOMS, Lane>::factor(problem.pattern, lanes.diagonal.data(), lanes.off.data());
        for (int pass = 0; pass < 3; ++pass) {
            for (int k = 0; k < n; ++k) left[k] = splat(0.0);
            for (int f = 0; f < problem.faces; ++f) {
                const Lane* P = &spans[6 * f];
                Lane j[3], x[3];
                sides.jump(f, u, lanes.face[f].keep, j);
                x[0] = P[0] * j[0] + P[1] * j[1] + P[3] * j[2];
                x[1] = P[1] * j[0] + P[2] * j[1] + P[4] * j[2];
                x[2] = P[3] * j[0] + P[4] * j[1] + P[5] * j[2];
                sides.add(f, x, lanes.face[f].keep, left);
            }
            Factor<FREEDOMS, Lane>::template solve<1>(problem.pattern, lanes.diagonal.data(), lanes.off.data(), left,
                                                      0);
            for (int k = 0; k < n; ++k) u[k] -= left[k];
        }
    }

    // Compute least margin and bound (3.3). snapped: jumps are projected onto the spans of `polished` first.
    Lane measure(const Lane* u, Lane& bound, bool snapped = false) {
        Lane least = splat(1e300), total = splat(0.0), noise = splat(0.0);
        if (snapped)
            for (int k = 0; k < FREEDOMS * problem.elements; ++k) noise = larger(noise, absolute(u[k]));
        noise *= SNAP;
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            Lane j[FREEDOMS], m, d;
            sides.jump(f, u, o.keep, j);
            if constexpr (FREEDOMS == 3)
                if (snapped) {
                    Lane off = snap(&span[6 * f], j, noise);
                    least = smaller(least, noise - off);
                    o.dissipation(j, m, d);
                    // On a proper subspace a margin of the size of rounding counts as zero.
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
        bound = total - lanes.dot(lanes.dead, u);
        return least;
    }

    // Project a jump onto its span, P being the projector onto the complement; return its distance.
    static Lane snap(const Lane* P, Lane* j, Lane noise) {
        Lane x[3] = {P[0] * j[0] + P[1] * j[1] + P[3] * j[2], P[1] * j[0] + P[2] * j[1] + P[4] * j[2],
                     P[3] * j[0] + P[4] * j[1] + P[5] * j[2]};
        Lane off = splat(0.0), size = splat(0.0);
        for (int k = 0; k < 3; ++k) {
            off = larger(off, absolute(x[k]));
            j[k] -= x[k], size = larger(size, absolute(j[k]));
        }
        // A jump below the rounding of its sums is zero.
        for (int k = 0; k < 3; ++k) j[k] = select(size <= 1e-3 * noise, splat(0.0), j[k]);
        return off;
    }

    Lane opened() {
        Lane least = splat(1e300);
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            Lane j[FREEDOMS], m, d;
            Lane* u = lanes.velocity_step.data();
            sides.jump(f, u, o.keep, j);
            o.dissipation(j, m, d);
            least = smaller(least, m);
        }
        return least;
    }

    // Bound by the motion as it is and, in the plane, by the polished one; the better bound counts.
    JLD_NOINLINE void motion() {
        const int n = FREEDOMS * problem.elements;
        Lane* u = lanes.velocity.data();
        Lane work = lanes.dot(lanes.live, u), fastest = splat(0.0);
        for (int k = 0; k < n; ++k) fastest = larger(fastest, absolute(u[k]));
        speed = fastest;
        // Normalise by the speed where the live load does hardly any work.
        Lane by = 1.0 / select(work > 1e-6 * fastest, work, fastest);
        for (int k = 0; k < n; ++k) u[k] *= by;
        best.resize(n);
        for (int k = 0; k < n; ++k) best[k] = u[k];
        high = splat(std::numeric_limits<double>::infinity());
        falls = high < 0.0;
        bound(best.data(), best.data());
        if constexpr (FREEDOMS == 3) again(u);
    }

    // Move the velocities so that each face jumps along the normals of its tight rows. In space the direction of
    // sliding is known only to the root of the gap, so polishing would lose accuracy.
    void again(Lane* u) {
        const int n = FREEDOMS * problem.elements;
        polished(u);
        Lane unit = lanes.dot(lanes.live, u);
        Mask works = unit > 1e-9;
        Lane once = select(works, 1.0 / select(works, unit, splat(1.0)), splat(1.0));
        for (int k = 0; k < n; ++k) u[k] *= once;
        bound(u, best.data(), !problem.opening);
    }

    // Add the opening motion as far as needed, (3.11), and keep the motion if its bound is the best so far.
    JLD_NOINLINE void bound(Lane* u, Lane* kept, bool snapped = false) {
        const int n = FREEDOMS * problem.elements;
        Lane total, fastest, missing = measure(u, total, snapped);
        margin = missing;
        if (problem.opening) {
            Lane* opening = lanes.velocity_step.data();
            for (int k = 0; k < n; ++k) opening[k] = splat(problem.opening[k]);
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
        Lane work = lanes.dot(lanes.live, u), sum = splat(0.0), heavy = splat(0.0);
        Lane weight = splat(0.0), strongest = splat(0.0);
        fastest = splat(0.0);
        for (int k = 0; k < n; ++k) {
            const Lane speed = absolute(u[k]), dead = absolute(lanes.dead[k]), live = absolute(lanes.live[k]);
            heavy += dead * speed, sum += live * speed, weight += dead;
            strongest = larger(strongest, live);
            fastest = larger(fastest, speed);
        }
        Lane noise = problem.noise * (heavy + absolute(total) + 1e-3 * weight * fastest);
        Mask finite = (missing >= 0.0) & (absolute(total) < 1e30) & (fastest < 1e30);
        // A live work of the size of rounding proves nothing.
        Mask useful = finite & (work > 1e3 * problem.noise * sum) & (work > 1e-3 * fastest * problem.noise);
        if (snapped) useful = useful & (work > IDLE * strongest * fastest);
        Lane found = select(useful, total / work, splat(std::numeric_limits<double>::infinity()));
        Mask falling = finite & (work >= 0.0) & (total < -larger(noise, splat(problem.noise) * fastest));
        Mask better = (found < high) | (falling & ~falls);
        for (int k = 0; k < n; ++k) kept[k] = select(better, u[k], kept[k]);
        high = smaller(high, found);
        falls = falls | falling;
    }

    Store<Lane> best;
    Store<Lane> span;
};

}  // namespace jld
