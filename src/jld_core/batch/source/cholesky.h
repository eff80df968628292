// Cholesky factors of sparse symmetric matrices of Q x Q matrix blocks, one matrix per SIMD lane, (8.5).
//
// The factorisation is left-looking: each matrix block is gathered in registers from all products that are subtracted
// from it, and written once. Large factors do not fit into the cache: right-hand sides are eliminated where the factor
// is formed, and substitutions read it column by column in the order of memory.
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
    // Factor in place, and substitute forward in K right-hand sides, `stride` entries apart. Matrix blocks that only
    // fill enters are not read.
    template <int K = 0>
    static void factor(const FactorPattern& p, T* diagonal, T* off, T* x = nullptr, int stride = 0) {
        for (int j = 0; j < p.nodes; ++j) {
            T* d = diagonal + TRIANGLE<Q> * j;
            T a[TRIANGLE<Q>], unit[TRIANGLE<Q>], lower[TRIANGLE<Q>], y[K + 1][Q];
            JLD_UNROLL
            for (int k = 0; k < TRIANGLE<Q>; ++k) a[k] = d[k];
            JLD_UNROLL
            for (int s = 0; s < K; ++s) JLD_UNROLL
            for (int r = 0; r < Q; ++r) y[s][r] = x[s * stride + Q * j + r];
            for (int n = p.left_start[j]; n < p.left_start[j + 1]; ++n) {
                const T* b = off + Q * Q * p.left[n];
                if constexpr (K > 0) {
                    const T* v = x + Q * p.left_column[n];
                    JLD_UNROLL
                    for (int k = 0; k < Q; ++k) JLD_UNROLL
                    for (int r = 0; r < Q; ++r) JLD_UNROLL
                    for (int s = 0; s < K; ++s) y[s][r] -= b[Q * r + k] * v[s * stride + k];
                }
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
            if constexpr (K > 0) JLD_UNROLL
                for (int s = 0; s < K; ++s) ahead(d, y[s], x + s * stride + Q * j);
            for (int t = p.column_start[j]; t < p.column_start[j + 1]; ++t) {
                T* own = off + Q * Q * t;
                // Take three columns at a time, so that the sums fit into the registers.
                JLD_UNROLL
                for (int first = 0; first < Q; first += 3) {
                    T x[Q][3];
                    JLD_UNROLL
                    for (int r = 0; r < Q; ++r) JLD_UNROLL
                    for (int c = 0; c < 3; ++c) x[r][c] = p.entered[t] ? own[Q * r + first + c] : T{};
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
            for (int s = 0; s < K; ++s) {
                Lane* own = x + s * stride + Q * j;
                JLD_UNROLL
                for (int r = 0; r < Q; ++r) y[s][r] = own[r];
                ahead(diagonal + TRIANGLE<Q> * j, y[s], own);
                JLD_UNROLL
                for (int r = 0; r < Q; ++r) y[s][r] = own[r];
            }
            for (int t = p.column_start[j]; t < p.column_start[j + 1]; ++t) {
                const T* b = off + Q * Q * t;
                Lane* v = x + Q * p.row[t];
                JLD_UNROLL
                for (int s = 0; s < K; ++s) JLD_UNROLL
                for (int r = 0; r < Q; ++r) {
                    Lane sum = v[s * stride + r];
                    JLD_UNROLL
                    for (int k = 0; k < Q; ++k) sum -= b[Q * r + k] * y[s][k];
                    v[s * stride + r] = sum;
                }
            }
        }
        backward<K>(p, diagonal, off, x, stride);
    }

    // Substitute backward in K right-hand sides, `stride` entries apart.
    template <int K>
    static void backward(const FactorPattern& p, const T* diagonal, const T* off, Lane* x, int stride) {
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

    // Substitute forward in the rows of one node, and scale.
    static void ahead(const T* d, Lane* y, Lane* to) {
        JLD_UNROLL
        for (int k = 0; k < Q; ++k) JLD_UNROLL
        for (int r = k + 1; r < Q; ++r) y[r] -= d[at(r, k)] * y[k];
        JLD_UNROLL
        for (int r = 0; r < Q; ++r) to[r] = y[r] * d[at(r, r)];
    }

    static Lane take_root(Lane a) { return root(a); }
    static double take_root(double a) { return __builtin_sqrt(a); }
};

}  // namespace jld
