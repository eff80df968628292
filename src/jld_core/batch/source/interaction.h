// Rows in which V and M interact, for undecided faces whose joints crush, (6.3) with (2.7), (2.9) and (2.10).
//
// The hull satisfies |M| <= w m + N1 - N1^2 / ((1 - w) C). Here w is the share of an inner corner (n, m) that |V| = c +
// mu N + w more requires, C the crushing force, and N1 = N - w n. Four rows +-b V +- M <= h + a N are its tangent
// plane. The class also gives the dissipation (6.3) of such faces. Derivation: docs/guide/batch_solver.md.
#pragma once
#include "simd.h"

namespace jld {

template <bool COUPLES>
struct MomentShearInteraction {
    static constexpr int ROWS = 0, NUMBERS = 0;
};

template <>
struct MomentShearInteraction<true> {
    static constexpr int ROWS = 4, NUMBERS = 12;
    // N and M of the corner; its shear above the dry line, 0 where nothing interacts; range of N in which planes touch
    // the dry parabola.
    Lane normal, moment, more, first, last;
    // Dry: crushing force (0 for a decided face), friction, cohesion. Inner: tensile, crushing and shear strength,
    // friction.
    Lane limit, friction, cohesion, tension, inner_limit, shear, inner_friction;
    // Tangent plane, and half the second derivative of M along (along_n, along_v), its only curved direction.
    Lane plane_normal, plane_shear, plane_moment, plane_bound, curve, along_n, along_v;

    // Signs of V and M in row r: (+, +), (-, -), (+, -), (-, +).
    static constexpr double sign_v(int r) { return r % 2 ? -1.0 : 1.0; }
    static constexpr double sign_m(int r) { return r == 0 || r == 3 ? 1.0 : -1.0; }

    template <class Call>
    void numbers(Call call) {
        for (Lane* x : {&normal, &moment, &more, &first, &last}) call(*x);
        for (Lane* x : {&limit, &friction, &cohesion, &tension, &inner_limit, &shear, &inner_friction}) call(*x);
    }

    void put(int lane, const double* from) {
        numbers([&](Lane& x) { lanes_of(x)[lane] = *from++; });
    }

    void copy(MomentShearInteraction& from, int source, int lane) {
        Lane* all[NUMBERS];
        int n = 0;
        numbers([&](Lane& x) { all[n++] = &x; });
        n = 0;
        from.numbers([&](Lane& x) { lanes_of(*all[n++])[lane] = lanes_of(x)[source]; });
    }

    // Compute the tangent plane at given forces, or the nearest one.
    void touch(const Lane* F) {
        const Lane none = splat(0.0), one = splat(1.0);
        Mask meets = more > 0.0;
        Lane by = select(meets, 1.0 / select(meets, more, one), none), c0 = 1.0 / select(meets, limit, one);
        Lane share = (absolute(F[1]) - cohesion - friction * F[0]) * by, rest = larger(one - share, splat(1e-9));
        Lane own = (F[0] - share * normal) / rest, n = smaller(larger(own, first), last);
        Lane slope = one - 2.0 * c0 * n;
        plane_shear = (slope * normal + c0 * n * n - moment) * by;
        plane_normal = select(meets, slope + friction * plane_shear, none),
        plane_bound = select(meets, c0 * n * n + plane_shear * cohesion, one);
        plane_moment = select(meets, one, none);
        // Shift of the point of contact along the parabola as N and |V| change the share.
        Lane reach = (n - normal) * by;
        curve = select(meets & (own >= first) & (own <= last), c0 / rest, none);
        along_n = one - friction * reach, along_v = select(F[1] < 0.0, -reach, reach);
    }

    // Return -G of N, V or M in a row.
    Lane row(int r, int of) const {
        return of == 0 ? plane_normal : of == 1 ? -sign_v(r) * plane_shear : -sign_m(r) * plane_moment;
    }

    Lane slack(const Lane* F) const {
        MomentShearInteraction there = *this;
        there.touch(F);
        return there.plane_bound + there.plane_normal * F[0] - absolute(there.plane_shear * F[1]) -
               absolute(there.plane_moment * F[2]);
    }

    // Return the larger dissipation of a jump under both labels, (6.3) with (3.4) to (3.7).
    Lane dissipation(const Lane* jump, Lane keep) const {
        Lane opening = jump[0], slip = absolute(jump[1] * keep), turn = absolute(jump[2]);
        Lane p = turn + friction * slip - opening, none = splat(0.0), turns = select(turn > 0.0, turn, splat(1.0));
        Lane crushed = select(p < 2.0 * turn, 0.25 * limit * p * p / turns, limit * (p - turn));
        Lane dry = select(p > 0.0, crushed, none) + cohesion * slip;
        Lane cracked = opening - inner_friction * slip;
        Lane top = 0.5 * (tension - inner_limit) * cracked + (inner_limit + tension) * turn / 6.0;
        Lane inner = larger(tension * cracked, larger(-inner_limit * cracked, top)) + shear * slip;
        return larger(dry, inner);
    }
};

}  // namespace jld
