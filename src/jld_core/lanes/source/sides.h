// Equilibrium between faces and elements: A has one block per face and side, its zeros left out.
#pragma once
#include <cmath>

#include "problem.h"
#include "simd.h"

namespace jld {

template <int Q>
struct Sides;

// Planar: N and V in two columns, and M, which is a moment alone: 7 numbers a side.
template <>
struct Sides<3> {
    const JldProblem& p;

    // out += A x, of one face; V counts where it is kept
    void add(int f, const Lane* x, Lane keep, Lane* out) const {
        Lane slip = x[1] * keep;
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0) {
                Lane* o = out + 3 * end[side];
                o[0] += b[0] * x[0] + b[1] * slip;
                o[1] += b[2] * x[0] + b[3] * slip;
                o[2] += b[4] * x[0] + b[5] * slip + b[6] * x[2];
            }
    }

    // out += |A| |x|, of one face
    void weigh(int f, const Lane* x, Lane* out) const {
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0)
                for (int r = 0; r < 3; ++r) {
                    Lane& o = out[3 * end[side] + r];
                    o += std::fabs(b[2 * r]) * absolute(x[0]) + std::fabs(b[2 * r + 1]) * absolute(x[1]);
                    if (r == 2) o += std::fabs(b[6]) * absolute(x[2]);
                }
    }

    // A'u of one face
    void jump(int f, const Lane* u, Lane keep, Lane* out) const {
        Lane n = splat(0.0), s = splat(0.0), m = splat(0.0);
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0) {
                const Lane* o = u + 3 * end[side];
                n += b[0] * o[0] + b[2] * o[1] + b[4] * o[2];
                s += b[1] * o[0] + b[3] * o[1] + b[5] * o[2];
                m += b[6] * o[2];
            }
        out[0] = n, out[1] = s * keep, out[2] = m;
    }

    // S += A (g v v' + iv t t' + diag(0, 0, im)) A', v = (1, v, m), of one face; t = (0, 1, 0) but where V and M meet
    template <class Face>
    void condensed(int f, const Face& o, Lane* diagonal, Lane* off) const {
        const Lane g = o.g, v = o.v, m = o.m, iv = o.iv * o.keep, im = o.im;
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        Lane q[2][3], gq[2][3], sv[2][3], t[2][3];
        for (int side = 0; side < 2; ++side, b += 7) {
            if (end[side] < 0) continue;
            q[side][0] = b[0] + b[1] * v, q[side][1] = b[2] + b[3] * v, q[side][2] = b[4] + b[5] * v + b[6] * m;
            for (int r = 0; r < 3; ++r) {
                t[side][r] = splat(b[2 * r + 1]);
                if constexpr (Face::COUPLED)
                    if (r == 2) t[side][r] += b[6] * o.vm;
                gq[side][r] = g * q[side][r], sv[side][r] = iv * t[side][r];
            }
            Lane* d = diagonal + 6 * end[side];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c <= r; ++c) d[at(r, c)] += gq[side][r] * q[side][c] + sv[side][r] * t[side][c];
            d[5] += im * (b[6] * b[6]);
        }
        if (p.block[f] >= 0) {
            b = p.sides + 14 * f;  // the block stands in the row of the later element
            Lane* at_block = off + 9 * p.block[f];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) at_block[3 * r + c] += gq[1][r] * q[0][c] + sv[1][r] * t[0][c];
            at_block[8] += im * (b[6] * b[13]);
        }
    }

    // S += A K A', K without the V that a label drops, and without faces that are out of it
    template <class T>
    void squared(int f, T keep, T* diagonal, T* off, T in) const {
        const T none = T{} * keep, P[6] = {in, none, keep * in, none, none, in};
        full<T>(f, P, diagonal, off);
    }

    // S += A P A', P symmetric (NN, NV, VV, NM, VM, MM)
    template <class T>
    void full(int f, const T* P, T* diagonal, T* off) const {
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
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
        if (p.block[f] >= 0) {
            T* o = off + 9 * p.block[f];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) {
                    o[3 * r + c] += half[1][r][0] * b[2 * c] + half[1][r][1] * b[2 * c + 1];
                    if (c == 2) o[3 * r + c] += half[1][r][2] * b[6];
                }
        }
    }
};

// Forces N, V1, V2 in the first three columns, couples, which are moments alone, in the others: 27 numbers a side.
template <>
struct Sides<6> {
    const JldProblem& p;

    const double* side(int f, int which) const { return p.sides + 54 * f + 27 * which; }
    int end(int f, int which) const { return which ? p.high[f] : p.low[f]; }

    // V and the torsion that go with it count where they are kept
    void add(int f, const Lane* x, Lane keep, Lane* out) const {
        const Lane one = x[1] * keep, two = x[2] * keep, twist = x[5] * keep;
        for (int which = 0; which < 2; ++which)
            if (end(f, which) >= 0) {
                const double* b = side(f, which);
                Lane* o = out + 6 * end(f, which);
                for (int r = 0; r < 6; ++r) {
                    Lane sum = b[3 * r] * x[0] + b[3 * r + 1] * one + b[3 * r + 2] * two;
                    if (r >= 3) sum += b[9 + 3 * r] * x[3] + b[10 + 3 * r] * x[4] + b[11 + 3 * r] * twist;
                    o[r] += sum;
                }
            }
    }

    void jump(int f, const Lane* u, Lane keep, Lane* out) const {
        for (int c = 0; c < 6; ++c) out[c] = splat(0.0);
        for (int which = 0; which < 2; ++which)
            if (end(f, which) >= 0) {
                const double* b = side(f, which);
                const Lane* o = u + 6 * end(f, which);
                for (int r = 0; r < 6; ++r)
                    for (int c = 0; c < 3; ++c) {
                        out[c] += b[3 * r + c] * o[r];
                        if (r >= 3) out[3 + c] += b[9 + 3 * r + c] * o[r];
                    }
            }
        out[1] *= keep, out[2] *= keep, out[5] *= keep;
    }

    // A x of one side, x in the axes of the face
    static void column(const double* b, const Lane* x, Lane* out) {
        for (int r = 0; r < 6; ++r) {
            out[r] = b[3 * r] * x[0] + b[3 * r + 1] * x[1] + b[3 * r + 2] * x[2];
            if (r >= 3) out[r] += b[9 + 3 * r] * x[3] + b[10 + 3 * r] * x[4] + b[11 + 3 * r] * x[5];
        }
    }

    // S += A H^-1 A': one square for each pivot of the face, of its own column and those that follow it
    template <class Face>
    void condensed(int f, const Face& o, Lane* diagonal, Lane* off) const {
        constexpr int C = Face::COLUMNS;
        Lane columns[C][6], weight[C], couple[3];
        o.pivots(columns, weight), o.couples(couple);
        Lane q[2][C][6];
        for (int which = 0; which < 2; ++which) {
            if (end(f, which) < 0) continue;
            const double* b = side(f, which);
            Lane* d = diagonal + 21 * end(f, which);
            for (int k = 0; k < C; ++k) {
                Lane* own = q[which][k];
                column(b, columns[k], own);
                for (int r = 0; r < 6; ++r) {
                    Lane by = weight[k] * own[r];
                    for (int c = 0; c <= r; ++c) d[at(r, c)] += by * own[c];
                }
            }
            for (int r = 3; r < 6; ++r)
                for (int c = 3; c <= r; ++c)
                    for (int k = 0; k < 3; ++k) d[at(r, c)] += couple[k] * (b[9 + 3 * r + k] * b[9 + 3 * c + k]);
        }
        if (p.block[f] < 0) return;
        Lane* to = off + 36 * p.block[f];
        const double *low = side(f, 0), *high = side(f, 1);
        for (int r = 0; r < 6; ++r) {
            Lane by[C];
            for (int k = 0; k < C; ++k) by[k] = weight[k] * q[1][k][r];
            for (int c = 0; c < 6; ++c) {
                Lane sum = to[6 * r + c];
                for (int k = 0; k < C; ++k) sum += by[k] * q[0][k][c];
                to[6 * r + c] = sum;
            }
        }
        for (int r = 3; r < 6; ++r)
            for (int c = 3; c < 6; ++c)
                for (int k = 0; k < 3; ++k) to[6 * r + c] += couple[k] * (high[9 + 3 * r + k] * low[9 + 3 * c + k]);
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
        if (p.block[f] >= 0)
            for (int r = 0; r < 6; ++r)
                for (int c = 0; c < 6; ++c) off[36 * p.block[f] + 6 * r + c] += entry(side(f, 1), side(f, 0), r, c);
    }
};

}  // namespace jld
