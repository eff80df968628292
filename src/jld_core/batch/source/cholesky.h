// Cholesky factors of sparse symmetric matrices of Q x Q matrix blocks, one matrix per SIMD lane, (8.5).
//
// The factorisation is left-looking: each matrix block is gathered in registers from all products that are subtracted
// from it, and written once.
#pragma once
#include "interface.h"
#include "simd.h"

namespace jld {

using FactorPattern = ::JldFactorPattern;

template <int Q>
constexpr int TRIANGLE = Q * (Q + 1) / 2;

constexpr int at(int r, int c) { return r * (r + 1) / 2 + c; }  // position in a lower triangle, row by row

// T is Lane, or double for one matrix that all lanes share. A factored diagonal block holds a unit triangle below its
// diagonal, and the inverse roots of the pivots on it. Dependent operations are then products alone, which have a short
// latency.
template <int Q, class T>
struct Factor {
    static void factor(const FactorPattern& p, T* diagonal, T* off) {
        for (int j = 0; j < p.nodes; ++j) {
            T* d = diagonal + TRIANGLE<Q> * j;
            T a[TRIANGLE<Q>], unit[TRIANGLE<Q>], lower[TRIANGLE<Q>];
            JLD_UNROLL
            for (int k = 0; k < TRIANGLE<Q>; ++k) a[k] = d[k];
            for (int n = p.left_start[j]; n < p.left_start[j + 1]; ++n) {
                const T* b = off + Q * Q * p.left[n];
                JLD_UNROLL
                for (int k = 0; k < Q; ++k) JLD_UNROLL
                for (int r = 0; r < Q; ++r) JLD_UNROLL
                for (int c = 0; c <= r; ++c) a[at(r, c)] -= b[Q * r + k] * b[Q * c + k];
            }
            JLD_UNROLL
            for (int c = 0; c < Q; ++c) {
                // Keep the pivot positive, because rounding may have consumed it.
                T pivot = a[at(c, c)], least = 1e-15 * d[at(c, c)];
                pivot = pivot > least ? pivot : least;
                const T inverse = 1.0 / pivot;
                unit[at(c, c)] = take_root(inverse);
                JLD_UNROLL
                for (int r = c + 1; r < Q; ++r)
                    unit[at(r, c)] = a[at(r, c)] * inverse, lower[at(r, c)] = a[at(r, c)] * unit[at(c, c)];
                JLD_UNROLL
                for (int r = c + 1; r < Q; ++r) JLD_UNROLL
                for (int k = c + 1; k <= r; ++k) a[at(r, k)] -= a[at(r, c)] * unit[at(k, c)];
            }
            JLD_UNROLL
            for (int k = 0; k < TRIANGLE<Q>; ++k) d[k] = unit[k];
            for (int t = p.column_start[j]; t < p.column_start[j + 1]; ++t) {
                T* own = off + Q * Q * t;
                // Take three columns at a time, so that the sums fit into the registers.
                JLD_UNROLL
                for (int first = 0; first < Q; first += 3) {
                    T x[Q][3];
                    JLD_UNROLL
                    for (int r = 0; r < Q; ++r) JLD_UNROLL
                    for (int c = 0; c < 3; ++c) x[r][c] = own[Q * r + first + c];
                    for (int n = p.pair_start[t]; n < p.pair_start[t + 1]; ++n) {
                        const T* l = off + Q * Q * p.pair[2 * n];
                        const T* m = off + Q * Q * p.pair[2 * n + 1] + Q * first;
                        JLD_UNROLL
                        for (int k = 0; k < Q; ++k) JLD_UNROLL
                        for (int r = 0; r < Q; ++r) JLD_UNROLL
                        for (int c = 0; c < 3; ++c) x[r][c] -= l[Q * r + k] * m[Q * c + k];
                    }
                    JLD_UNROLL
                    for (int k = 0; k < first; ++k) JLD_UNROLL
                    for (int r = 0; r < Q; ++r) JLD_UNROLL
                    for (int c = 0; c < 3; ++c) x[r][c] -= own[Q * r + k] * lower[at(first + c, k)];
                    JLD_UNROLL
                    for (int k = 0; k < 2; ++k) JLD_UNROLL
                    for (int c = k + 1; c < 3; ++c) JLD_UNROLL
                    for (int r = 0; r < Q; ++r) x[r][c] -= x[r][k] * unit[at(first + c, first + k)];
                    JLD_UNROLL
                    for (int r = 0; r < Q; ++r) JLD_UNROLL
                    for (int c = 0; c < 3; ++c) own[Q * r + first + c] = x[r][c] * unit[at(first + c, first + c)];
                }
            }
        }
    }

    // Solve in place for K right-hand sides, `stride` entries apart.
    template <int K>
    static void solve(const FactorPattern& p, const T* diagonal, const T* off, Lane* x, int stride) {
        for (int j = 0; j < p.nodes; ++j) {
            Lane y[K][Q];
            JLD_UNROLL
            for (int s = 0; s < K; ++s) JLD_UNROLL
            for (int r = 0; r < Q; ++r) y[s][r] = x[s * stride + Q * j + r];
            for (int n = p.left_start[j]; n < p.left_start[j + 1]; ++n) {
                const T* b = off + Q * Q * p.left[n];
                const Lane* v = x + Q * p.left_column[n];
                JLD_UNROLL
                for (int k = 0; k < Q; ++k) JLD_UNROLL
                for (int r = 0; r < Q; ++r) JLD_UNROLL
                for (int s = 0; s < K; ++s) y[s][r] -= b[Q * r + k] * v[s * stride + k];
            }
            const T* d = diagonal + TRIANGLE<Q> * j;
            JLD_UNROLL
            for (int s = 0; s < K; ++s) {
                JLD_UNROLL
                for (int k = 0; k < Q; ++k) JLD_UNROLL
                for (int r = k + 1; r < Q; ++r) y[s][r] -= d[at(r, k)] * y[s][k];
                JLD_UNROLL
                for (int r = 0; r < Q; ++r) x[s * stride + Q * j + r] = y[s][r] * d[at(r, r)];
            }
        }
        for (int j = p.nodes - 1; j >= 0; --j) {
            Lane y[K][Q];
            JLD_UNROLL
            for (int s = 0; s < K; ++s) JLD_UNROLL
            for (int r = 0; r < Q; ++r) y[s][r] = x[s * stride + Q * j + r];
            for (int t = p.column_start[j]; t < p.column_start[j + 1]; ++t) {
                const T* b = off + Q * Q * t;
                const Lane* v = x + Q * p.row[t];
                JLD_UNROLL
                for (int r = 0; r < Q; ++r) JLD_UNROLL
                for (int k = 0; k < Q; ++k) JLD_UNROLL
                for (int s = 0; s < K; ++s) y[s][k] -= b[Q * r + k] * v[s * stride + r];
            }
            const T* d = diagonal + TRIANGLE<Q> * j;
            JLD_UNROLL
            for (int s = 0; s < K; ++s) {
                JLD_UNROLL
                for (int r = 0; r < Q; ++r) y[s][r] *= d[at(r, r)];
                JLD_UNROLL
                for (int k = Q - 1; k >= 0; --k) JLD_UNROLL
                for (int r = 0; r < k; ++r) y[s][r] -= d[at(k, r)] * y[s][k];
                JLD_UNROLL
                for (int r = 0; r < Q; ++r) x[s * stride + Q * j + r] = y[s][r];
            }
        }
    }

    static Lane take_root(Lane a) { return root(a); }
    static double take_root(double a) { return __builtin_sqrt(a); }
};

}  // namespace jld
