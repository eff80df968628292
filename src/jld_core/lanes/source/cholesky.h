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

// T is Lane, or double for one matrix that all lanes share.
template <int Q, class T>
struct Factor {
    static void factor(const FactorPattern& p, T* diagonal, T* off) {
        for (int j = 0; j < p.nodes; ++j) {
            T* d = diagonal + TRIANGLE<Q> * j;
            T a[TRIANGLE<Q>];
            for (int k = 0; k < TRIANGLE<Q>; ++k) a[k] = d[k];
            for (int n = p.left_start[j]; n < p.left_start[j + 1]; ++n) {
                const T* b = off + Q * Q * p.left[n];
                for (int r = 0; r < Q; ++r)
                    for (int c = 0; c <= r; ++c)
                        for (int k = 0; k < Q; ++k) a[at(r, c)] -= b[Q * r + k] * b[Q * c + k];
            }
            for (int c = 0; c < Q; ++c) {
                T pivot = a[at(c, c)];
                for (int k = 0; k < c; ++k) pivot -= a[at(c, k)] * a[at(c, k)];
                // what rounding has left of a pivot must not end the lane
                T least = 1e-15 * d[at(c, c)];
                pivot = pivot > least ? pivot : least;
                T inverse = 1.0 / take_root(pivot);
                a[at(c, c)] = inverse;
                for (int r = c + 1; r < Q; ++r) {
                    T x = a[at(r, c)];
                    for (int k = 0; k < c; ++k) x -= a[at(r, k)] * a[at(c, k)];
                    a[at(r, c)] = x * inverse;
                }
            }
            for (int k = 0; k < TRIANGLE<Q>; ++k) d[k] = a[k];
            for (int t = p.column_start[j]; t < p.column_start[j + 1]; ++t) {
                T* own = off + Q * Q * t;
                // three columns at a time, so that what is gathered stays in registers
                for (int first = 0; first < Q; first += 3) {
                    T x[Q][3];
                    for (int r = 0; r < Q; ++r)
                        for (int c = 0; c < 3; ++c) x[r][c] = own[Q * r + first + c];
                    for (int n = p.pair_start[t]; n < p.pair_start[t + 1]; ++n) {
                        const T* l = off + Q * Q * p.pair[2 * n];
                        const T* m = off + Q * Q * p.pair[2 * n + 1] + Q * first;
                        for (int k = 0; k < Q; ++k)
                            for (int r = 0; r < Q; ++r)
                                for (int c = 0; c < 3; ++c) x[r][c] -= l[Q * r + k] * m[Q * c + k];
                    }
                    for (int r = 0; r < Q; ++r)
                        for (int c = 0; c < 3; ++c) own[Q * r + first + c] = x[r][c];
                }
                for (int r = 0; r < Q; ++r) {
                    T x[Q];
                    for (int c = 0; c < Q; ++c) {
                        T y = own[Q * r + c];
                        for (int k = 0; k < c; ++k) y -= x[k] * a[at(c, k)];
                        x[c] = y * a[at(c, c)];
                    }
                    for (int c = 0; c < Q; ++c) own[Q * r + c] = x[c];
                }
            }
        }
    }

    // In place, K right-hand sides that stand one after another, `stride` lanes apart.
    template <int K>
    static void solve(const FactorPattern& p, const T* diagonal, const T* off, Lane* x, int stride) {
        for (int j = 0; j < p.nodes; ++j) {
            Lane y[K][Q];
            for (int s = 0; s < K; ++s)
                for (int r = 0; r < Q; ++r) y[s][r] = x[s * stride + Q * j + r];
            for (int n = p.left_start[j]; n < p.left_start[j + 1]; ++n) {
                const T* b = off + Q * Q * p.left[n];
                const Lane* v = x + Q * p.left_column[n];
                for (int k = 0; k < Q; ++k)
                    for (int r = 0; r < Q; ++r)
                        for (int s = 0; s < K; ++s) y[s][r] -= b[Q * r + k] * v[s * stride + k];
            }
            const T* d = diagonal + TRIANGLE<Q> * j;
            for (int s = 0; s < K; ++s)
                for (int r = 0; r < Q; ++r) {
                    for (int k = 0; k < r; ++k) y[s][r] -= d[at(r, k)] * y[s][k];
                    y[s][r] *= d[at(r, r)];
                    x[s * stride + Q * j + r] = y[s][r];
                }
        }
        for (int j = p.nodes - 1; j >= 0; --j) {
            Lane y[K][Q];
            for (int s = 0; s < K; ++s)
                for (int r = 0; r < Q; ++r) y[s][r] = x[s * stride + Q * j + r];
            for (int t = p.column_start[j]; t < p.column_start[j + 1]; ++t) {
                const T* b = off + Q * Q * t;
                const Lane* v = x + Q * p.row[t];
                for (int r = 0; r < Q; ++r)
                    for (int k = 0; k < Q; ++k)
                        for (int s = 0; s < K; ++s) y[s][k] -= b[Q * r + k] * v[s * stride + r];
            }
            const T* d = diagonal + TRIANGLE<Q> * j;
            for (int s = 0; s < K; ++s)
                for (int r = Q - 1; r >= 0; --r) {
                    for (int k = r + 1; k < Q; ++k) y[s][r] -= d[at(k, r)] * y[s][k];
                    y[s][r] *= d[at(r, r)];
                    x[s * stride + Q * j + r] = y[s][r];
                }
        }
    }

    static Lane take_root(Lane a) { return root(a); }
    static double take_root(double a) { return __builtin_sqrt(a); }
};

}  // namespace jld
