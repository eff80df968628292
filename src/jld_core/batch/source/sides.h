// Equilibrium (1.1) of elements and faces: one dense matrix block of A per face and side, without its zeros.
#pragma once
#include <cmath>

#include "cholesky.h"
#include "simd.h"

namespace jld {

template <int Q>
struct Sides;

// Planar: columns of N and V, and M, which enters moments only; 7 numbers per side.
template <>
struct Sides<3> {
    const JldProblem& problem;

    // out += A x of one face; V counts where it is kept.
    void add(int f, const Lane* x, Lane keep, Lane* out) const {
        Lane slip = x[1] * keep;
        const double* b = problem.sides + 14 * f;
        const int end[2] = {problem.low[f], problem.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0) {
                Lane* o = out + 3 * end[side];
                o[0] += b[0] * x[0] + b[1] * slip;
                o[1] += b[2] * x[0] + b[3] * slip;
                o[2] += b[4] * x[0] + b[5] * slip + b[6] * x[2];
            }
    }

    // out += |A| |x| of one face.
    void weigh(int f, const Lane* x, Lane* out) const {
        const double* b = problem.sides + 14 * f;
        const int end[2] = {problem.low[f], problem.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0)
                for (int r = 0; r < 3; ++r) {
                    Lane& o = out[3 * end[side] + r];
                    o += std::fabs(b[2 * r]) * absolute(x[0]) + std::fabs(b[2 * r + 1]) * absolute(x[1]);
                    if (r == 2) o += std::fabs(b[6]) * absolute(x[2]);
                }
    }

    // out = A'u of one face, the jump (3.1).
    void jump(int f, const Lane* u, Lane keep, Lane* out) const {
        Lane n = splat(0.0), s = splat(0.0), m = splat(0.0);
        const double* b = problem.sides + 14 * f;
        const int end[2] = {problem.low[f], problem.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0) {
                const Lane* o = u + 3 * end[side];
                n += b[0] * o[0] + b[2] * o[1] + b[4] * o[2];
                s += b[1] * o[0] + b[3] * o[1] + b[5] * o[2];
                m += b[6] * o[2];
            }
        out[0] = n, out[1] = s * keep, out[2] = m;
    }

    // S += A (g v v' + iv t t' + diag(0, 0, im)) A' of one face, (8.5), with inverse pivots g, iv, im of N, V, M, v =
    // (1, v, m), and t = (0, 1, 0), where V and M interact (0, 1, vm).
    template <class Face>
    void condensed(int f, const Face& o, Lane* diagonal, Lane* off) const {
        const Lane g = o.normal_pivot, v = o.shear_follows, m = o.moment_follows, iv = o.shear_pivot * o.keep,
                   im = o.moment_pivot;
        const double* b = problem.sides + 14 * f;
        const int end[2] = {problem.low[f], problem.high[f]};
        Lane q[2][3], gq[2][3], sv[2][3], t[2][3];
        for (int side = 0; side < 2; ++side, b += 7) {
            if (end[side] < 0) continue;
            q[side][0] = b[0] + b[1] * v, q[side][1] = b[2] + b[3] * v, q[side][2] = b[4] + b[5] * v + b[6] * m;
            for (int r = 0; r < 3; ++r) {
                t[side][r] = splat(b[2 * r + 1]);
                if constexpr (Face::COUPLED)
                    if (r == 2) t[side][r] += b[6] * o.moment_follows_shear;
                gq[side][r] = g * q[side][r], sv[side][r] = iv * t[side][r];
            }
            Lane* d = diagonal + 6 * end[side];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c <= r; ++c) d[at(r, c)] += gq[side][r] * q[side][c] + sv[side][r] * t[side][c];
            d[5] += im * (b[6] * b[6]);
        }
        if (problem.block[f] >= 0) {
            b = problem.sides + 14 * f;  // the matrix block stands in the row of the later element
            Lane* at_block = off + 9 * problem.block[f];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) at_block[3 * r + c] += gq[1][r] * q[0][c] + sv[1][r] * t[0][c];
            at_block[8] += im * (b[6] * b[13]);
        }
    }

    // S += A K A', K without the V that a label drops; `in` is 0 for faces that carry nothing.
    template <class T>
    void squared(int f, T keep, T* diagonal, T* off, T in) const {
        const T none = T{} * keep, P[6] = {in, none, keep * in, none, none, in};
        full<T>(f, P, diagonal, off);
    }

    // S += A P A', P symmetric (NN, NV, VV, NM, VM, MM).
    template <class T>
    void full(int f, const T* P, T* diagonal, T* off) const {
        const double* b = problem.sides + 14 * f;
        const int end[2] = {problem.low[f], problem.high[f]};
        T half[2][3][3];
        for (int side = 0; side < 2; ++side) {
            if (end[side] < 0) continue;
            const double* own = b + 7 * side;
            for (int r = 0; r < 3; ++r) {
                const int index[3][3] = {{0, 1, 3}, {1, 2, 4}, {3, 4, 5}};
                for (int c = 0; c < 3; ++c) {
                    half[side][r][c] = own[2 * r] * P[index[0][c]] + own[2 * r + 1] * P[index[1][c]];
                    if (r == 2) half[side][r][c] += own[6] * P[index[2][c]];
                }
            }
            T* d = diagonal + 6 * end[side];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c <= r; ++c) {
                    d[at(r, c)] += half[side][r][0] * own[2 * c] + half[side][r][1] * own[2 * c + 1];
                    if (c == 2) d[at(r, c)] += half[side][r][2] * own[6];
                }
        }
        if (problem.block[f] >= 0) {
            T* o = off + 9 * problem.block[f];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) {
                    o[3 * r + c] += half[1][r][0] * b[2 * c] + half[1][r][1] * b[2 * c + 1];
                    if (c == 2) o[3 * r + c] += half[1][r][2] * b[6];
                }
        }
    }
};

// Spatial: columns of N, V1, V2, and of moments, which enter moments only; 27 numbers per side, nine each of forces, of
// their arms and of moments. Forces on both sides differ in sign only.
template <>
struct Sides<6> {
    const JldProblem& problem;

    const double* side(int f, int which) const { return problem.sides + 54 * f + 27 * which; }
    int end(int f, int which) const { return which ? problem.high[f] : problem.low[f]; }

    // out = B x, of columns `first` up to `last`.
    template <int first = 0, int last = 3>
    static void apply(const double* b, const Lane* x, Lane* out) {
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) {
            out[r] = b[3 * r + first] * x[first];
            JLD_UNROLL
            for (int c = first + 1; c < last; ++c) out[r] += b[3 * r + c] * x[c];
        }
    }

    // out += B'x
    static void turned(const double* b, const Lane* x, Lane* out) {
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) JLD_UNROLL
        for (int c = 0; c < 3; ++c) out[c] += b[3 * r + c] * x[r];
    }

    // V and torsion count where they are kept.
    void add(int f, const Lane* x, Lane keep, Lane* out) const {
        if (end(f, 0) < 0) return;
        const Lane forces[3] = {x[0], x[1] * keep, x[2] * keep}, couples[3] = {x[3], x[4], x[5] * keep};
        const double *low = side(f, 0), *high = side(f, 1);
        Lane force[3], arm[3], couple[3], *o = out + 6 * end(f, 0);
        apply(low, forces, force), apply(low + 9, forces, arm), apply(low + 18, couples, couple);
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) o[r] += force[r], o[3 + r] += arm[r] + couple[r];
        if (end(f, 1) < 0) return;
        o = out + 6 * end(f, 1);
        apply(high + 9, forces, arm), apply(high + 18, couples, couple);
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) o[r] -= force[r], o[3 + r] += arm[r] + couple[r];
    }

    void jump(int f, const Lane* u, Lane keep, Lane* out) const {
        Lane j[6], apart[3];
        JLD_UNROLL
        for (int c = 0; c < 6; ++c) j[c] = splat(0.0);
        if (end(f, 0) >= 0) {
            const double *low = side(f, 0), *high = side(f, 1);
            const Lane *o = u + 6 * end(f, 0), *other = u + 6 * end(f, 1);
            JLD_UNROLL
            for (int r = 0; r < 3; ++r) apart[r] = o[r];
            if (end(f, 1) >= 0) {
                JLD_UNROLL
                for (int r = 0; r < 3; ++r) apart[r] -= other[r];
                turned(high + 9, other + 3, j), turned(high + 18, other + 3, j + 3);
            }
            turned(low, apart, j), turned(low + 9, o + 3, j), turned(low + 18, o + 3, j + 3);
        }
        out[0] = j[0], out[1] = j[1] * keep, out[2] = j[2] * keep;
        out[3] = j[3], out[4] = j[4], out[5] = j[5] * keep;
    }

    // Compute moments on one side due to the columns of the pivots: N and what follows it, t and what follows it, V
    // along and across, and a second moment of a hull.
    template <int C>
    static void moments(const double* b, const Lane (*columns)[6], Lane (*out)[3]) {
        Lane turn[3];
        apply(b + 9, columns[0], out[0]), apply(b + 18, columns[0] + 3, turn);
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) out[0][r] += turn[r];
        apply<1>(b + 9, columns[1], out[1]);
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) out[1][r] += b[18 + 3 * r + 2] * columns[1][5];
        apply<1>(b + 9, columns[2], out[2]), apply<1>(b + 9, columns[3], out[3]);
        if constexpr (C == 5) apply<0, 2>(b + 18, columns[4] + 3, out[4]);
    }

    // Add products of moments on two sides: `to` gains a lower triangle if the sides are the same, else a whole matrix
    // block.
    template <int C, bool ONE>
    static void bent(const Lane* weight, const Lane (*rows)[3], const Lane (*columns)[3], const Lane* couple,
                     const double* high, const double* low, Lane* to) {
        Lane sum[3][3];
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) JLD_UNROLL
        for (int c = 0; c < 3; ++c) sum[r][c] = splat(0.0);
        JLD_UNROLL
        for (int k = 0; k < C; ++k) JLD_UNROLL
        for (int r = 0; r < 3; ++r) {
            const Lane by = weight[k] * rows[k][r];
            JLD_UNROLL
            for (int c = 0; c < (ONE ? r + 1 : 3); ++c) sum[r][c] += by * columns[k][c];
        }
        JLD_UNROLL
        for (int k = 0; k < 3; ++k) JLD_UNROLL
        for (int r = 0; r < 3; ++r) {
            const Lane by = couple[k] * high[18 + 3 * r + k];
            JLD_UNROLL
            for (int c = 0; c < (ONE ? r + 1 : 3); ++c) sum[r][c] += by * low[18 + 3 * c + k];
        }
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) JLD_UNROLL
        for (int c = 0; c < (ONE ? r + 1 : 3); ++c) to[ONE ? at(3 + r, 3 + c) : 6 * (3 + r) + 3 + c] += sum[r][c];
    }

    // S += A H^-1 A', (8.5): one square for each pivot of the face, with its column and what follows it.
    template <class Face>
    void condensed(int f, const Face& o, Lane* diagonal, Lane* off) const {
        constexpr int C = Face::COLUMNS;
        if (end(f, 0) < 0) return;
        Lane columns[C][6], weight[C], couple[3];
        o.pivots(columns, weight), o.couples(couple);
        const double *low = side(f, 0), *high = side(f, 1);
        const bool both = problem.block[f] >= 0;
        Lane* d = diagonal + 21 * end(f, 0);
        Lane *e = diagonal + 21 * (both ? end(f, 1) : 0), *to = off + 36 * (both ? problem.block[f] : 0);
        Lane force[4][3], pressed[4][3], here[C][3], there[C][3];
        apply(low, columns[0], force[0]);
        apply<1>(low, columns[1], force[1]), apply<1>(low, columns[2], force[2]), apply<1>(low, columns[3], force[3]);
        moments<C>(low, columns, here);
        JLD_UNROLL
        for (int k = 0; k < 4; ++k) JLD_UNROLL
        for (int r = 0; r < 3; ++r) pressed[k][r] = weight[k] * force[k][r];
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) JLD_UNROLL
        for (int c = 0; c < 3; ++c) {
            if (c <= r) {
                Lane sum = pressed[0][r] * force[0][c];
                JLD_UNROLL
                for (int k = 1; k < 4; ++k) sum += pressed[k][r] * force[k][c];
                d[at(r, c)] += sum;
                if (both) e[at(r, c)] += sum, to[6 * r + c] -= sum;
                if (both && c < r) to[6 * c + r] -= sum;
            }
            Lane sum = here[0][r] * pressed[0][c];
            JLD_UNROLL
            for (int k = 1; k < 4; ++k) sum += here[k][r] * pressed[k][c];
            d[at(3 + r, c)] += sum;
            if (both) to[6 * c + 3 + r] -= sum;
        }
        bent<C, true>(weight, here, here, couple, low, low, d);
        if (!both) return;
        moments<C>(high, columns, there);
        JLD_UNROLL
        for (int r = 0; r < 3; ++r) JLD_UNROLL
        for (int c = 0; c < 3; ++c) {
            Lane sum = there[0][r] * pressed[0][c];
            JLD_UNROLL
            for (int k = 1; k < 4; ++k) sum += there[k][r] * pressed[k][c];
            e[at(3 + r, c)] -= sum, to[6 * (3 + r) + c] += sum;
        }
        bent<C, true>(weight, there, there, couple, high, high, e);
        bent<C, false>(weight, there, here, couple, high, low, to);
    }

    template <class T>
    void squared(int f, T keep, T* diagonal, T* off, T in) const {
        const T slide = keep * in, by[6] = {in, slide, slide, in, in, slide};
        auto entry = [&](const double* x, const double* y, int r, int c) {
            T sum = by[0] * (x[3 * r] * y[3 * c]);
            for (int k = 1; k < 3; ++k) sum += by[k] * (x[3 * r + k] * y[3 * c + k]);
            if (r >= 3 && c >= 3)
                for (int k = 0; k < 3; ++k) sum += by[3 + k] * (x[9 + 3 * r + k] * y[9 + 3 * c + k]);
            return sum;
        };
        for (int which = 0; which < 2; ++which)
            if (end(f, which) >= 0)
                for (int r = 0; r < 6; ++r)
                    for (int c = 0; c <= r; ++c)
                        diagonal[21 * end(f, which) + at(r, c)] += entry(side(f, which), side(f, which), r, c);
        if (problem.block[f] >= 0)
            for (int r = 0; r < 6; ++r)
                for (int c = 0; c < 6; ++c)
                    off[36 * problem.block[f] + 6 * r + c] += entry(side(f, 1), side(f, 0), r, c);
    }
};

}  // namespace jld
