// Where V and M meet in faces of no label that crush: |M| <= w m + N1 - N1^2 / ((1 - w) C), w the share of an inner corner
// (n, m) that |V| = c + mu N + w more asks for, N1 = N - w n; as four rows +-b V +- M <= h + a N of its tangent plane. And
// what such faces cost a motion, whatever their rows. Source of the reductions: docs/guide/batch_solver.md.
#pragma once
#include "simd.h"

namespace jld {

template <bool MEETS>
struct Meeting {
    static constexpr int ROWS = 0, NUMBERS = 0;
};

template <>
struct Meeting<true> {
    static constexpr int ROWS = 4, NUMBERS = 12;
    // N and M of the corner, what its shear is above the dry line, 0 where nothing meets, and between which N of the dry
    // parabola planes touch it
    Lane normal, moment, more, first, last;
    // both labels: N that crushes dry joints, 0 of a decided face, their friction and cohesion; tension, N that crushes
    // inner ones, their shear strength and friction
    Lane limit, friction, cohesion, tension, inner_limit, shear, inner_friction;
    // the plane; half the second derivative of M along (along_n, along_v), which alone has one
    Lane a, b, c, h, curve, along_n, along_v;

    // of V and M in row r, which go through (+, +), (-, -), (+, -), (-, +)
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

    void copy(Meeting& from, int source, int lane) {
        Lane* all[NUMBERS];
        int n = 0;
        numbers([&](Lane& x) { all[n++] = &x; });
        n = 0;
        from.numbers([&](Lane& x) { lanes_of(*all[n++])[lane] = lanes_of(x)[source]; });
    }

    // The plane at forces, which is exact there, or the nearest one.
    void touch(const Lane* F) {
        const Lane none = splat(0.0), one = splat(1.0);
        Mask meets = more > 0.0;
        Lane by = select(meets, 1.0 / select(meets, more, one), none), c0 = 1.0 / select(meets, limit, one);
        Lane share = (absolute(F[1]) - cohesion - friction * F[0]) * by, rest = larger(one - share, splat(1e-9));
        Lane own = (F[0] - share * normal) / rest, n = smaller(larger(own, first), last);
        Lane slope = one - 2.0 * c0 * n;
        b = (slope * normal + c0 * n * n - moment) * by;
        a = select(meets, slope + friction * b, none), h = select(meets, c0 * n * n + b * cohesion, one);
        c = select(meets, one, none);
        // what the share moves by with N and |V| moves the point of touch along the parabola
        Lane reach = (n - normal) * by;
        curve = select(meets & (own >= first) & (own <= last), c0 / rest, none);
        along_n = one - friction * reach, along_v = select(F[1] < 0.0, -reach, reach);
    }

    // -G of N, V and M in a row
    Lane row(int r, int of) const { return of == 0 ? a : of == 1 ? -sign_v(r) * b : -sign_m(r) * c; }

    Lane slack(const Lane* F) const {
        Meeting there = *this;
        there.touch(F);
        return there.h + there.a * F[0] - absolute(there.b * F[1]) - absolute(there.c * F[2]);
    }

    // What a jump takes at the most under either label, docs/method.md (3.4) to (3.7).
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
