// Cholesky factors of sparse symmetric matrices in blocks of Q x Q, as many at once as there are lanes.
//
// The pattern is that of the factor, fill included, in the order of elimination. Left-looking: each block is
// gathered from the products that it loses, in registers, and written once.
#pragma once
#include "simd.h"

namespace jld {

struct FactorPattern {
    int32_t nodes;               // block rows
    const int32_t* column_start; // (nodes + 1) blocks below the diagonal, column by column
    const int32_t* row;          // (blocks) block row of each
    const int32_t* pair_start;   // (blocks + 1) products that each block loses
    const int32_t* pair;         // (2 pairs) the two blocks of a product: of its row and of its column
    const int32_t* left_start;   // (nodes + 1) blocks to the left of each diagonal block
    const int32_t* left;         // (blocks) which
    const int32_t* left_column;  // (blocks) and in which column they stand
};

template <int Q>
constexpr int TRIANGLE = Q*(Q + 1) / 2;

constexpr int at(int r, int c) { return r * (r + 1) / 2 + c; }  // of a lower triangle, row by row

// T is Lane, or double for one matrix that all lanes share. A factored diagonal block holds the unit triangle below its
// diagonal and the inverse roots of its pivots on it, so that what waits for one another is a chain of products alone.
template <int Q, class T>
struct Factor {
    static void factor(const FactorPattern& p, T* diagonal, T* off) {
        for (int j = 0; j < p.nodes; ++j) {
            T* d = diagonal + TRIANGLE<Q> * j;
            T a[TRIANGLE<Q>], unit[TRIANGLE<Q>], lower[TRIANGLE<Q>];
            JLD_WHOLE
            for (int k = 0; k < TRIANGLE<Q>; ++k) a[k] = d[k];
            for (int n = p.left_start[j]; n < p.left_start[j + 1]; ++n) {
                const T* b = off + Q * Q * p.left[n];
                JLD_WHOLE
                for (int k = 0; k < Q; ++k)
                    JLD_WHOLE
                    for (int r = 0; r < Q; ++r)
                        JLD_WHOLE
                        for (int c = 0; c <= r; ++c) a[at(r, c)] -= b[Q * r + k] * b[Q * c + k];
            }
            JLD_WHOLE
            for (int c = 0; c < Q; ++c) {
                // what rounding has left of a pivot must not end the lane
                T pivot = a[at(c, c)], least = 1e-15 * d[at(c, c)];
                pivot = pivot > least ? pivot : least;
                const T inverse = 1.0 / pivot;
                unit[at(c, c)] = take_root(inverse);
                JLD_WHOLE
                for (int r = c + 1; r < Q; ++r) unit[at(r, c)] = a[at(r, c)] * inverse, lower[at(r, c)] = a[at(r, c)] * unit[at(c, c)];
                JLD_WHOLE
                for (int r = c + 1; r < Q; ++r)
                    JLD_WHOLE
                    for (int k = c + 1; k <= r; ++k) a[at(r, k)] -= a[at(r, c)] * unit[at(k, c)];
            }
            JLD_WHOLE
            for (int k = 0; k < TRIANGLE<Q>; ++k) d[k] = unit[k];
            for (int t = p.column_start[j]; t < p.column_start[j + 1]; ++t) {
                T* own = off + Q * Q * t;
                // three columns at a time, so that what is gathered stays in registers
                JLD_WHOLE
                for (int first = 0; first < Q; first += 3) {
                    T x[Q][3];
                    JLD_WHOLE
                    for (int r = 0; r < Q; ++r)
                        JLD_WHOLE
                        for (int c = 0; c < 3; ++c) x[r][c] = own[Q * r + first + c];
                    for (int n = p.pair_start[t]; n < p.pair_start[t + 1]; ++n) {
                        const T* l = off + Q * Q * p.pair[2 * n];
                        const T* m = off + Q * Q * p.pair[2 * n + 1] + Q * first;
                        JLD_WHOLE
                        for (int k = 0; k < Q; ++k)
                            JLD_WHOLE
                            for (int r = 0; r < Q; ++r)
                                JLD_WHOLE
                                for (int c = 0; c < 3; ++c) x[r][c] -= l[Q * r + k] * m[Q * c + k];
                    }
                    JLD_WHOLE
                    for (int k = 0; k < first; ++k)
                        JLD_WHOLE
                        for (int r = 0; r < Q; ++r)
                            JLD_WHOLE
                            for (int c = 0; c < 3; ++c) x[r][c] -= own[Q * r + k] * lower[at(first + c, k)];
                    JLD_WHOLE
                    for (int k = 0; k < 2; ++k)
                        JLD_WHOLE
                        for (int c = k + 1; c < 3; ++c)
                            JLD_WHOLE
                            for (int r = 0; r < Q; ++r) x[r][c] -= x[r][k] * unit[at(first + c, first + k)];
                    JLD_WHOLE
                    for (int r = 0; r < Q; ++r)
                        JLD_WHOLE
                        for (int c = 0; c < 3; ++c) own[Q * r + first + c] = x[r][c] * unit[at(first + c, first + c)];
                }
            }
        }
    }

    // In place, K right-hand sides that stand one after another, `stride` lanes apart.
    template <int K>
    static void solve(const FactorPattern& p, const T* diagonal, const T* off, Lane* x, int stride) {
        for (int j = 0; j < p.nodes; ++j) {
            Lane y[K][Q];
            JLD_WHOLE
            for (int s = 0; s < K; ++s)
                JLD_WHOLE
                for (int r = 0; r < Q; ++r) y[s][r] = x[s * stride + Q * j + r];
            for (int n = p.left_start[j]; n < p.left_start[j + 1]; ++n) {
                const T* b = off + Q * Q * p.left[n];
                const Lane* v = x + Q * p.left_column[n];
                JLD_WHOLE
                for (int k = 0; k < Q; ++k)
                    JLD_WHOLE
                    for (int r = 0; r < Q; ++r)
                        JLD_WHOLE
                        for (int s = 0; s < K; ++s) y[s][r] -= b[Q * r + k] * v[s * stride + k];
            }
            const T* d = diagonal + TRIANGLE<Q> * j;
            JLD_WHOLE
            for (int s = 0; s < K; ++s) {
                JLD_WHOLE
                for (int k = 0; k < Q; ++k)
                    JLD_WHOLE
                    for (int r = k + 1; r < Q; ++r) y[s][r] -= d[at(r, k)] * y[s][k];
                JLD_WHOLE
                for (int r = 0; r < Q; ++r) x[s * stride + Q * j + r] = y[s][r] * d[at(r, r)];
            }
        }
        for (int j = p.nodes - 1; j >= 0; --j) {
            Lane y[K][Q];
            JLD_WHOLE
            for (int s = 0; s < K; ++s)
                JLD_WHOLE
                for (int r = 0; r < Q; ++r) y[s][r] = x[s * stride + Q * j + r];
            for (int t = p.column_start[j]; t < p.column_start[j + 1]; ++t) {
                const T* b = off + Q * Q * t;
                const Lane* v = x + Q * p.row[t];
                JLD_WHOLE
                for (int r = 0; r < Q; ++r)
                    JLD_WHOLE
                    for (int k = 0; k < Q; ++k)
                        JLD_WHOLE
                        for (int s = 0; s < K; ++s) y[s][k] -= b[Q * r + k] * v[s * stride + r];
            }
            const T* d = diagonal + TRIANGLE<Q> * j;
            JLD_WHOLE
            for (int s = 0; s < K; ++s) {
                JLD_WHOLE
                for (int r = 0; r < Q; ++r) y[s][r] *= d[at(r, r)];
                JLD_WHOLE
                for (int k = Q - 1; k >= 0; --k)
                    JLD_WHOLE
                    for (int r = 0; r < k; ++r) y[s][r] -= d[at(k, r)] * y[s][k];
                JLD_WHOLE
                for (int r = 0; r < Q; ++r) x[s * stride + Q * j + r] = y[s][r];
            }
        }
    }

    static Lane take_root(Lane a) { return root(a); }
    static double take_root(double a) { return __builtin_sqrt(a); }
};

}  // namespace jld
