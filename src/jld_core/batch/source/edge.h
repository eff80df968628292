// Admissible forces where some yield rows are implicit equations: no admissible force has slack there, (3.9).
//
// The analytic centre shows which rows these are. Forces are projected onto equilibrium (1.1) and onto those rows
// together. Rounding is judged face by face relative to the forces there, as in jld_core.limit.
#pragma once
#include "interior.h"

namespace jld {

template <int PAIRS>
struct Edge {
    typedef PlanarFace<PAIRS> Face;
    typedef Workspace<Face> Lanes;
    static constexpr int ROWS = 2 * PAIRS;
    static constexpr double TIGHT = 1e-5, STIFF = 1e6, LOOSE = 1e-11;
    const JldProblem& problem;
    Sides<3> sides;
    Lanes& lanes;
    Store<Lane> middle, best;
    Lane low;

    Edge(const JldProblem& problem, Lanes& lanes)
        : problem(problem), sides{problem}, lanes(lanes), middle(3 * problem.faces), best(3 * problem.faces) {}

    // Give the rows that are equations stiff springs, the others none.
    void stiffen() {
        lanes.clear(problem);
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            for (int r = 0; r < ROWS; ++r) {
                o.row_multiplier[r] = select(o.row_slack[r] < TIGHT, splat(STIFF), splat(0.0));
                o.row_slack[r] = splat(1.0);
            }
            o.condense(splat(1.0));
            sides.condensed(f, o, lanes.diagonal.data(), lanes.off.data());
        }
        // Regularise: where V is dropped, no spring resists sliding.
        if (problem.drops_shear) lanes.loosen(LOOSE);
        Factor<3, Lane>::factor(problem.pattern, lanes.diagonal.data(), lanes.off.data());
        Lane* reach = lanes.rhs.data();
        for (int k = 0; k < 3 * problem.elements; ++k) reach[k] = lanes.live[k];
        Factor<3, Lane>::template solve<1>(problem.pattern, lanes.diagonal.data(), lanes.off.data(), reach, 0);
    }

    // Return h - G F of one row.
    static Lane room(const Face& o, const Lane* F, int r) {
        int pair = r / 2;
        Lane x = o.row_other[pair] * F[Face::bends(pair) ? 2 : 1];
        return o.row_bound[pair] + o.row_normal[pair] * F[0] - (r % 2 ? -x : x);
    }

    // Project the forces Face::force and lambda onto equilibrium and the tight rows.
    void project(Lane& load) {
        const int n = 3 * problem.elements;
        Lane *reach = lanes.rhs.data(), *left = lanes.left.data();
        Lane corner = lanes.dot(lanes.live, reach) + 1.0;
        for (int pass = 0; pass < 4; ++pass) {
            for (int k = 0; k < n; ++k) left[k] = lanes.dead[k] + lanes.live[k] * load;
            for (int f = 0; f < problem.faces; ++f) {
                Face& o = lanes.face[f];
                Lane t[ROWS], x[3];
                for (int r = 0; r < ROWS; ++r) t[r] = o.row_multiplier[r] * room(o, o.force, r);
                o.turned(t, o.right_side);
                o.apply(o.right_side, x);
                sides.add(f, o.force, o.keep, left);
                sides.add(f, x, o.keep, left);
            }
            Factor<3, Lane>::template solve<1>(problem.pattern, lanes.diagonal.data(), lanes.off.data(), left, 0);
            Lane dl = -lanes.dot(lanes.live, left) / corner;
            for (int k = 0; k < n; ++k) left[k] += reach[k] * dl;
            load += dl;
            for (int f = 0; f < problem.faces; ++f) {
                Face& o = lanes.face[f];
                Lane jump[3], x[3];
                sides.jump(f, left, o.keep, jump);
                for (int k = 0; k < 3; ++k) jump[k] = o.right_side[k] - jump[k];
                o.apply(jump, x);
                for (int k = 0; k < 3; ++k) o.force[k] += x[k];
                o.force[1] *= o.keep;
            }
        }
    }

    // Return where a state is admissible, up to rounding in rows that are equations.
    Mask admissible(Lane load) {
        const int n = 3 * problem.elements;
        Lane *left = lanes.left.data(), *met = lanes.held.data(), largest = splat(1.0);
        for (int k = 0; k < n; ++k) {
            left[k] = lanes.dead[k] + lanes.live[k] * load;
            met[k] = absolute(lanes.dead[k]) + absolute(lanes.live[k] * load);
        }
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            sides.add(f, o.force, o.keep, left);
            sides.weigh(f, o.force, met);
            for (int k = 0; k < 3; ++k) largest = larger(largest, absolute(o.force[k]));
        }
        const double digit = 2.220446049250313e-16;
        // Largest violation. The sum detects NaN, which a maximum may ignore.
        Lane lacks = absolute(load) - 1e30, sum = load;
        for (int k = 0; k < n; ++k) {
            lacks = larger(lacks, absolute(left[k]) - problem.noise * met[k] - digit * largest);
            sum += left[k];
        }
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            Lane own = larger(absolute(o.force[0]), larger(absolute(o.force[1]), absolute(o.force[2])));
            Lane noise = problem.noise * own + digit * largest;
            for (int r = 0; r < ROWS; ++r) {
                Lane slack = room(o, o.force, r), short_of = digit * largest - slack;
                sum += slack;
                lacks = larger(lacks,
                               select(o.row_multiplier[r] > 0.0, smaller(short_of, absolute(slack) - noise), short_of));
            }
        }
        return larger(lacks, absolute(sum) - 1e30) <= 0.0 * sum;
    }

    // On entry the workspace holds the analytic centre, and Face::force_step and `load` the forces of the largest
    // lambda.
    void run(Lane load) {
        stiffen();
        Lane centre = lanes.load;
        project(centre);
        for (int f = 0; f < problem.faces; ++f)
            for (int k = 0; k < 3; ++k)
                middle[3 * f + k] = lanes.face[f].force[k], lanes.face[f].force[k] = lanes.face[f].force_step[k];
        project(load);
        for (int f = 0; f < problem.faces; ++f)
            for (int k = 0; k < 3; ++k) lanes.face[f].force_step[k] = lanes.face[f].force[k];
        low = splat(-std::numeric_limits<double>::infinity());
        for (double share : {0.0, 1e-10, 1e-9, 1e-8, 1e-7, 4e-7}) {
            Lane now = (1.0 - share) * load + share * centre;
            for (int f = 0; f < problem.faces; ++f)
                for (int k = 0; k < 3; ++k)
                    lanes.face[f].force[k] = (1.0 - share) * lanes.face[f].force_step[k] + share * middle[3 * f + k];
            now = select(admissible(now), now, splat(-std::numeric_limits<double>::infinity()));
            Mask better = now > low;
            low = select(better, now, low);
            for (int f = 0; f < problem.faces; ++f)
                for (int k = 0; k < 3; ++k) best[3 * f + k] = select(better, lanes.face[f].force[k], best[3 * f + k]);
        }
    }
};

}  // namespace jld
