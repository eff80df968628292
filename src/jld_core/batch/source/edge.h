// States where some yield rows are equations in disguise: no admissible force leaves them any slack.
//
// Which ones they are the middle of what is admissible tells. Forces are projected on equilibrium and on those rows
// together; rounding is judged face by face, by the numbers that meet there, as the core does.
#pragma once
#include "interior.h"

namespace jld {

template <int PAIRS>
struct Edge {
    typedef PlanarFace<PAIRS> Face;
    typedef Work<Face> Lanes;
    static constexpr int ROWS = 2 * PAIRS;
    static constexpr double TIGHT = 1e-5, STIFF = 1e6, LOOSE = 1e-11;
    const JldProblem& p;
    Sides<3> sides;
    Lanes& w;
    Store<Lane> middle, best;
    Lane low;

    Edge(const JldProblem& problem, Lanes& lanes)
        : p(problem), sides{problem}, w(lanes), middle(3 * problem.faces), best(3 * problem.faces) {}

    // Each row's weight stands for its spring: stiff where the row is an equation.
    void stiffen() {
        w.clear();
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            for (int r = 0; r < ROWS; ++r) {
                o.z[r] = select(o.s[r] < TIGHT, splat(STIFF), splat(0.0));
                o.s[r] = splat(1.0);
            }
            o.condense(splat(1.0));
            sides.condensed(f, o, w.diagonal.data(), w.off.data());
        }
        // where V is dropped no spring holds what slides
        if (p.dropping) w.loosen(LOOSE);
        Factor<3, Lane>::factor(p.pattern, w.diagonal.data(), w.off.data());
        Lane* reach = w.rhs.data();
        for (int k = 0; k < 3 * p.elements; ++k) reach[k] = splat(p.live[k]);
        Factor<3, Lane>::template solve<1>(p.pattern, w.diagonal.data(), w.off.data(), reach, 0);
    }

    // h - G F of one row
    static Lane room(const Face& o, const Lane* F, int r) {
        int pair = r / 2;
        Lane x = o.b[pair] * F[Face::bends(pair) ? 2 : 1];
        return o.h[pair] + o.a[pair] * F[0] - (r % 2 ? -x : x);
    }

    // Forces in Face::F and lambda onto equilibrium and the tight rows.
    void project(Lane& load) {
        const int n = 3 * p.elements;
        Lane *reach = w.rhs.data(), *left = w.left.data();
        Lane corner = w.dot(p.live, reach) + 1.0;
        for (int pass = 0; pass < 4; ++pass) {
            for (int k = 0; k < n; ++k) left[k] = p.dead[k] + p.live[k] * load;
            for (int f = 0; f < p.faces; ++f) {
                Face& o = w.face[f];
                Lane t[ROWS], x[3];
                for (int r = 0; r < ROWS; ++r) t[r] = o.z[r] * room(o, o.F, r);
                o.turned(t, o.c);
                o.apply(o.c, x);
                sides.add(f, o.F, o.keep, left);
                sides.add(f, x, o.keep, left);
            }
            Factor<3, Lane>::template solve<1>(p.pattern, w.diagonal.data(), w.off.data(), left, 0);
            Lane dl = -w.dot(p.live, left) / corner;
            for (int k = 0; k < n; ++k) left[k] += reach[k] * dl;
            load += dl;
            for (int f = 0; f < p.faces; ++f) {
                Face& o = w.face[f];
                Lane jump[3], x[3];
                sides.jump(f, left, o.keep, jump);
                for (int k = 0; k < 3; ++k) jump[k] = o.c[k] - jump[k];
                o.apply(jump, x);
                for (int k = 0; k < 3; ++k) o.F[k] += x[k];
                o.F[1] *= o.keep;
            }
        }
    }

    // Is a state admissible but for rounding in rows that are equations?
    Mask admissible(Lane load) {
        const int n = 3 * p.elements;
        Lane *left = w.left.data(), *met = w.held.data(), largest = splat(1.0);
        for (int k = 0; k < n; ++k) {
            left[k] = p.dead[k] + p.live[k] * load;
            met[k] = std::fabs(p.dead[k]) + absolute(p.live[k] * load);
        }
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            sides.add(f, o.F, o.keep, left);
            sides.weigh(f, o.F, met);
            for (int k = 0; k < 3; ++k) largest = larger(largest, absolute(o.F[k]));
        }
        const double digit = 2.220446049250313e-16;
        // what is missing to admissibility; a sum remembers what is no number, a maximum does not
        Lane lacks = absolute(load) - 1e30, sum = load;
        for (int k = 0; k < n; ++k) {
            lacks = larger(lacks, absolute(left[k]) - p.noise * met[k] - digit * largest);
            sum += left[k];
        }
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane own = larger(absolute(o.F[0]), larger(absolute(o.F[1]), absolute(o.F[2])));
            Lane noise = p.noise * own + digit * largest;
            for (int r = 0; r < ROWS; ++r) {
                Lane slack = room(o, o.F, r), short_of = digit * largest - slack;
                sum += slack;
                lacks = larger(lacks, select(o.z[r] > 0.0, smaller(short_of, absolute(slack) - noise), short_of));
            }
        }
        return larger(lacks, absolute(sum) - 1e30) <= 0.0 * sum;
    }

    // The middle stands in the lanes, the forces of largest lambda in Face::dF and `load`.
    void run(Lane load) {
        stiffen();
        Lane centre = w.load;
        project(centre);
        for (int f = 0; f < p.faces; ++f)
            for (int k = 0; k < 3; ++k) middle[3 * f + k] = w.face[f].F[k], w.face[f].F[k] = w.face[f].dF[k];
        project(load);
        for (int f = 0; f < p.faces; ++f)
            for (int k = 0; k < 3; ++k) w.face[f].dF[k] = w.face[f].F[k];
        low = splat(-std::numeric_limits<double>::infinity());
        for (double share : {0.0, 1e-10, 1e-9, 1e-8, 1e-7, 4e-7}) {
            Lane now = (1.0 - share) * load + share * centre;
            for (int f = 0; f < p.faces; ++f)
                for (int k = 0; k < 3; ++k)
                    w.face[f].F[k] = (1.0 - share) * w.face[f].dF[k] + share * middle[3 * f + k];
            now = select(admissible(now), now, splat(-std::numeric_limits<double>::infinity()));
            Mask better = now > low;
            low = select(better, now, low);
            for (int f = 0; f < p.faces; ++f)
                for (int k = 0; k < 3; ++k) best[3 * f + k] = select(better, w.face[f].F[k], best[3 * f + k]);
        }
    }
};

}  // namespace jld
