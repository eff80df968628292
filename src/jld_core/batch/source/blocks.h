// The linear program of the relaxation by blocks under many choices of allowed blocks, one choice to a lane.
//
// Standard form: min -lambda, A x + a lambda = b, x >= 0. Every column is one block's. Rows are those of one block
// alone, which are eliminated block by block, or of nodes that blocks share, three to a node, which are factored by the
// pattern of all blocks: rows of blocks that a lane does not have stand alone there. Mehrotra's predictor and corrector.
#pragma once
#include <cmath>
#include <cstdlib>
#include <new>
#include <vector>

#include "cholesky.h"

extern "C" {

struct JldBlocks {
    int32_t blocks, nodes;
    jld::FactorPattern pattern;
    const int32_t* own_start;    // (blocks + 1) rows of a block alone
    const int32_t* shared_start; // (blocks + 1)
    const int32_t* shared;       // rows that a block shares, 3 node + k in the order of elimination
    const int32_t* column_start; // (blocks + 1)
    const int32_t* entry_start;  // (columns + 1)
    const int32_t* entry_row;    // rows of the block: its own ones, then shared ones
    const double* entry;
    const double* of_x;          // (rows of all blocks) entries of a block's share, block by block
    const double* of_load;       // and of its load factor times its share
    const int32_t* place_start;  // (blocks + 1)
    const int32_t* place;        // of each pair of shared rows, lower triangle: in the diagonal, or -1 - in the rest
    const double* rhs;           // (3 nodes)
    int32_t loads;
    const int32_t* load;         // (loads) shared rows that lambda enters, with -1
};

struct JldBlockTask {
    int64_t count;
    const uint8_t* allowed;     // (count, blocks)
    const double* thresholds;   // (count) lambda that is to be reached
    const double* least;        // (count) range of the lambda of every block
    const double* most;
    double gap;                 // relative, at which one is done,
    double near, fine;          // and within `near` of the threshold, relative
    double room;                // error of the multipliers with which one is done
    int32_t iterations;         // most of one
    double* dual;               // (count, own rows + shared rows) multipliers
    double* share;              // (count, blocks)
    double* load;               // (count)
    int32_t* spent;             // (count) iterations
    uint8_t* state;             // (count) 0 open, 1 solved, 2 below the threshold
};

}

namespace jld {

class BlockRun {
    static constexpr int Q = 3, MOST = 96;  // rows of one block
    static constexpr int TRI = MOST * (MOST + 1) / 2;
    static constexpr double BEGIN = 0.3;   // of columns and their multipliers; the same whatever is left of others
    static constexpr double LEFT = 1e-13;  // part of itself added to a pivot, more than rounding takes from it
    const JldBlocks& p;
    const JldBlockTask& t;
    const int columns, own, shared, diagonals, offs;
    std::vector<Lane*> held;
    Lane *x, *z, *dx, *dz, *rest, *on, *lo, *hi, *y, *yo, *dy, *dyo, *first, *diagonal, *off, *fill;
    std::vector<int64_t> fill_start;
    std::vector<char> any;
    int64_t job[W];
    int age[W];
    double last[W];  // gap
    int64_t given = 0;
    Lane load = splat(0.0), number = splat(1.0);

    Lane* take(int64_t n) {
        void* q = std::aligned_alloc(64, ((sizeof(Lane) * (n + 1) + 63) / 64) * 64);
        if (!q) throw std::bad_alloc();
        Lane* v = static_cast<Lane*>(q);
        for (int64_t k = 0; k <= n; ++k) v[k] = splat(0.0);
        held.push_back(v);
        return v;
    }
    int begin(int b) const { return p.column_start[b] + 2 * b; }
    int wide(int b) const { return p.own_start[b + 1] - p.own_start[b] + p.shared_start[b + 1] - p.shared_start[b]; }

public:
    BlockRun(const JldBlocks& problem, const JldBlockTask& task)
        : p(problem), t(task), columns(problem.column_start[problem.blocks] + 2 * problem.blocks),
          own(problem.own_start[problem.blocks]), shared(Q * problem.nodes), diagonals(TRIANGLE<Q> * problem.nodes),
          offs(Q * Q * problem.pattern.column_start[problem.nodes]) {
        try {
            for (Lane** one : {&x, &z, &dx, &dz, &rest}) *one = take(columns);
            for (Lane** one : {&on, &lo, &hi}) *one = take(p.blocks);
            y = take(shared), dy = take(2 * shared), first = take(shared);
            yo = take(own), dyo = take(own);
            diagonal = take(diagonals), off = take(offs);
            int64_t total = 0;
            for (int b = 0; b < p.blocks; ++b) {
                fill_start.push_back(total);
                const int n = p.own_start[b + 1] - p.own_start[b], s = p.shared_start[b + 1] - p.shared_start[b];
                total += n * (n + 1) / 2 + n * s;
            }
            fill = take(total);
        } catch (...) {
            release();
            throw;
        }
        any.assign(p.blocks, 0);
    }
    ~BlockRun() { release(); }

    static bool fits(const JldBlocks& p) {
        for (int b = 0; b < p.blocks; ++b)
            if (p.own_start[b + 1] - p.own_start[b] + p.shared_start[b + 1] - p.shared_start[b] > MOST) return false;
        return true;
    }

    BlockRun(const BlockRun&) = delete;
    BlockRun& operator=(const BlockRun&) = delete;

    void run() {
        int busy = 0;
        for (int i = 0; i < W; ++i) busy += put(i);
        while (busy) {
            for (int b = 0; b < p.blocks; ++b) {
                bool some = false;
                for (int i = 0; i < W; ++i) some |= lanes_of(on[b])[i] > 0.0;
                any[b] = some;
            }
            const Measures m = step();
            for (int i = 0; i < W; ++i) {
                if (job[i] < 0) continue;
                ++age[i];
                const double bound = lanes_of(m.bound)[i];
                const double away = lanes_of(m.away)[i];
                const double size = std::fabs(bound) > 1.0 ? std::fabs(bound) : 1.0, least = t.thresholds[job[i]];
                const bool fell = bound < least - 1e-6 * size && away <= t.room;
                // multipliers alone are what is asked for: late forces, which rounding takes out of balance, are not
                const double gap = lanes_of(m.product)[i] / size;
                const bool rough = gap <= t.gap && away <= t.room;
                const bool near = bound < least + t.near * size;
                // where rounding lets the gap fall no more, nothing is gained by going on
                const bool done = rough && (!near || gap <= t.fine || gap > 0.5 * last[i]);
                last[i] = gap;
                const bool lost = !(std::fabs(bound) < 1e12) || !(away < 1e12);
                if (!fell && !done && !lost && age[i] < t.iterations) continue;
                give(i, fell ? 2 : rough ? 1 : 0);
                busy += put(i) - 1;
            }
        }
    }

private:
    struct Measures {
        Lane bound, away, product;  // -b'y, largest error of multipliers, x'z
    };

    void release() {
        for (Lane* one : held) std::free(one);
        held.clear();
    }

    // The next task in lane i; 0 where there is none.
    int put(int i) {
        const bool some = given < t.count;
        job[i] = some ? given++ : -1;
        age[i] = 0, last[i] = 1e300;
        const uint8_t* allowed = some ? t.allowed + job[i] * p.blocks : nullptr;
        double count = 0.0;
        for (int b = 0; b < p.blocks; ++b) {
            const bool here = some && allowed[b];
            lanes_of(on[b])[i] = here;
            lanes_of(lo[b])[i] = some ? t.least[job[i]] : 0.0;
            lanes_of(hi[b])[i] = some ? t.most[job[i]] : 0.0;
            for (int j = begin(b); j < begin(b + 1); ++j) {
                lanes_of(x[j])[i] = here ? BEGIN : 0.0;
                lanes_of(z[j])[i] = here ? BEGIN : 1.0;
                count += here;
            }
        }
        lanes_of(number)[i] = count > 0.0 ? count : 1.0;
        for (int k = 0; k < own; ++k) lanes_of(yo[k])[i] = 0.0;
        for (int k = 0; k < shared; ++k) lanes_of(y[k])[i] = 0.0;
        lanes_of(load)[i] = 0.0;
        return some;
    }

    void give(int i, int state) {
        const int64_t who = job[i];
        double* dual = t.dual + who * (own + shared);
        for (int k = 0; k < own; ++k) dual[k] = lanes_of(yo[k])[i];
        for (int k = 0; k < shared; ++k) dual[own + k] = lanes_of(y[k])[i];
        for (int b = 0; b < p.blocks; ++b)
            t.share[who * p.blocks + b] = lanes_of(x[begin(b + 1) - 2])[i] + lanes_of(x[begin(b + 1) - 1])[i];
        t.load[who] = lanes_of(load)[i], t.spent[who] = age[i], t.state[who] = state;
    }

    // Calls with each column of a block: its place, and how its entries are met. Those of its share come last.
    template <class Call>
    void each(int b, Call call) {
        const int base = begin(b);
        for (int j = p.column_start[b]; j < p.column_start[b + 1]; ++j)
            call(base + j - p.column_start[b], p.entry_start[j], p.entry_start[j + 1]);
    }

    // a'v of every column of a block and of both columns of its share. v: rows of the block.
    template <class Call>
    void products(int b, const Lane* v, Call call) {
        each(b, [&](int j, int from, int to) {
            Lane sum = splat(0.0);
            for (int e = from; e < to; ++e) sum += p.entry[e] * v[p.entry_row[e]];
            call(j, sum);
        });
        Lane of_x = splat(0.0), of_load = splat(0.0);
        const int at = p.own_start[b] + p.shared_start[b];
        for (int r = 0; r < wide(b); ++r) of_x += p.of_x[at + r] * v[r], of_load += p.of_load[at + r] * v[r];
        call(begin(b + 1) - 2, of_x + lo[b] * of_load);
        call(begin(b + 1) - 1, of_x + hi[b] * of_load);
    }

    // Adds A u to rows of a block. u(j): what a column is taken times.
    template <class Call>
    void add(int b, Lane* rows, Call u) {
        each(b, [&](int j, int from, int to) {
            const Lane v = u(j);
            for (int e = from; e < to; ++e) rows[p.entry_row[e]] += p.entry[e] * v;
        });
        const Lane low = u(begin(b + 1) - 2), high = u(begin(b + 1) - 1);
        const Lane both = low + high, loaded = lo[b] * low + hi[b] * high;
        const int at = p.own_start[b] + p.shared_start[b];
        for (int r = 0; r < wide(b); ++r) rows[r] += p.of_x[at + r] * both + p.of_load[at + r] * loaded;
    }

    void gather(int b, const Lane* of_own, const Lane* of_shared, Lane* v) const {
        const int n = p.own_start[b + 1] - p.own_start[b], s = p.shared_start[b + 1] - p.shared_start[b];
        for (int r = 0; r < n; ++r) v[r] = of_own[p.own_start[b] + r];
        for (int r = 0; r < s; ++r) v[n + r] = of_shared[p.shared[p.shared_start[b] + r]];
    }

    // A D A' of a block without its own rows, to the common matrix; how to get those back is put away.
    void condense(int b, Lane* K) {
        const int n = p.own_start[b + 1] - p.own_start[b], m = wide(b), s = m - n;
        Lane* L = fill + fill_start[b];
        Lane* C = L + n * (n + 1) / 2;
        const Lane stays = 1.0 - on[b];
        for (int c = 0; c < n; ++c) {
            Lane d = K[at(c, c)] + stays;
            const Lane before = d;
            for (int k = 0; k < c; ++k) d -= L[at(c, k)] * L[at(c, k)];
            const Lane inverse = 1.0 / root(larger(d, splat(0.0)) + LEFT * before);
            L[at(c, c)] = inverse;
            for (int r = c + 1; r < n; ++r) {
                Lane v = K[at(r, c)];
                for (int k = 0; k < c; ++k) v -= L[at(r, k)] * L[at(c, k)];
                L[at(r, c)] = v * inverse;
            }
        }
        for (int r = 0; r < s; ++r)
            for (int c = 0; c < n; ++c) {
                Lane v = K[at(n + r, c)];
                for (int k = 0; k < c; ++k) v -= C[n * r + k] * L[at(c, k)];
                C[n * r + c] = v * L[at(c, c)];
            }
        const int32_t* place = p.place + p.place_start[b];
        for (int r = 0; r < s; ++r)
            for (int c = 0; c <= r; ++c) {
                Lane v = K[at(n + r, n + c)];
                const Lane more = LEFT * v;
                for (int k = 0; k < n; ++k) v -= C[n * r + k] * C[n * c + k];
                if (r == c) v = larger(v, splat(0.0)) + more;
                const int to = *place++;
                (to >= 0 ? diagonal[to] : off[-1 - to]) += v;
            }
    }

    // Right-hand sides of a block's own rows, in place, and what they leave to shared ones.
    void forward(int b, Lane* h, Lane* common) {
        const int n = p.own_start[b + 1] - p.own_start[b], s = wide(b) - n;
        const Lane* L = fill + fill_start[b];
        const Lane* C = L + n * (n + 1) / 2;
        for (int r = 0; r < n; ++r) {
            Lane v = h[r];
            for (int k = 0; k < r; ++k) v -= L[at(r, k)] * h[k];
            h[r] = v * L[at(r, r)];
        }
        for (int r = 0; r < s; ++r) {
            Lane v = h[n + r];
            for (int k = 0; k < n; ++k) v -= C[n * r + k] * h[k];
            common[p.shared[p.shared_start[b] + r]] += v;
        }
    }

    // Own rows of a block from shared ones. v: rows of the block, own ones as `forward` left them.
    void backward(int b, Lane* v) {
        const int n = p.own_start[b + 1] - p.own_start[b], s = wide(b) - n;
        const Lane* L = fill + fill_start[b];
        const Lane* C = L + n * (n + 1) / 2;
        for (int r = 0; r < s; ++r)
            for (int k = 0; k < n; ++k) v[k] -= C[n * r + k] * v[n + r];
        for (int r = n - 1; r >= 0; --r) {
            v[r] *= L[at(r, r)];
            for (int k = 0; k < r; ++k) v[k] -= L[at(r, k)] * v[r];
        }
    }

    Measures step() {
        Lane K[TRI], v[MOST], h[MOST];
        for (int k = 0; k < diagonals; ++k) diagonal[k] = splat(0.0);
        for (int k = 0; k < p.nodes; ++k)
            for (int c = 0; c < Q; ++c) diagonal[TRIANGLE<Q> * k + at(c, c)] = splat(1e-12);
        for (int k = 0; k < offs; ++k) off[k] = splat(0.0);
        for (int k = 0; k < shared; ++k) dy[k] = splat(p.rhs[k]), dy[shared + k] = splat(0.0);
        Lane away = splat(0.0), product = splat(0.0);
        for (int b = 0; b < p.blocks; ++b) {
            if (!any[b]) continue;
            const int n = p.own_start[b + 1] - p.own_start[b], m = wide(b);
            gather(b, yo, y, v);
            products(b, v, [&](int j, Lane sum) {
                rest[j] = on[b] * (-sum - z[j]);
                away = larger(away, absolute(rest[j]));
                product += x[j] * z[j];
            });
            for (int k = 0; k < m; ++k) h[k] = splat(0.0);
            for (int k = 0; k < at(m - 1, m - 1) + 1; ++k) K[k] = splat(0.0);
            each(b, [&](int j, int from, int to) {
                const Lane d = x[j] / z[j], u = d * rest[j];
                for (int e = from; e < to; ++e) {
                    const int row = p.entry_row[e];
                    const Lane w = d * p.entry[e];
                    h[row] += p.entry[e] * u;
                    for (int f = from; f <= e; ++f) K[at(row, p.entry_row[f])] += w * p.entry[f];
                }
            });
            const int low = begin(b + 1) - 2;
            for (int j = low; j < low + 2; ++j) {
                const Lane d = x[j] / z[j], u = d * rest[j], own_load = j == low ? lo[b] : hi[b];
                Lane a[MOST];
                int filled[MOST], count = 0;
                const int from = p.own_start[b] + p.shared_start[b];
                for (int k = 0; k < m; ++k)
                    if (p.of_x[from + k] != 0.0 || p.of_load[from + k] != 0.0) {
                        a[count] = p.of_x[from + k] + own_load * p.of_load[from + k];
                        filled[count++] = k;
                    }
                for (int e = 0; e < count; ++e) {
                    const Lane w = d * a[e];
                    h[filled[e]] += a[e] * u;
                    for (int f = 0; f <= e; ++f) K[at(filled[e], filled[f])] += w * a[f];
                }
            }
            condense(b, K);
            forward(b, h, dy);
            for (int k = 0; k < n; ++k) dyo[p.own_start[b] + k] = h[k];
        }
        Lane bound = splat(0.0), unit = splat(-1.0);  // what lambda's own column lacks
        for (int k = 0; k < p.loads; ++k) dy[shared + p.load[k]] = splat(-1.0), unit += y[p.load[k]];
        for (int k = 0; k < shared; ++k) bound -= p.rhs[k] * y[k];
        const Measures measures{bound, larger(away, absolute(unit)), product};

        for (int k = 0; k < p.nodes; ++k)
            for (int c = 0; c < Q; ++c) diagonal[TRIANGLE<Q> * k + at(c, c)] *= 1.0 + LEFT;
        Factor<Q, Lane>::factor(p.pattern, diagonal, off);
        Factor<Q, Lane>::solve<2>(p.pattern, diagonal, off, dy, shared);
        Lane whole = splat(0.0);
        for (int k = 0; k < shared; ++k) first[k] = dy[shared + k];
        for (int k = 0; k < p.loads; ++k) whole -= first[p.load[k]];
        Lane next = border(whole, unit);

        // predictor
        Lane shrink_x = splat(0.0), shrink_z = splat(0.0), xdz = splat(0.0), dxz = splat(0.0), dxdz = splat(0.0);
        for (int b = 0; b < p.blocks; ++b) {
            if (!any[b]) continue;
            gather(b, dyo, dy, v);
            backward(b, v);
            products(b, v, [&](int j, Lane sum) {
                const Lane up = on[b] * (rest[j] - sum), over = x[j] / z[j], way = -x[j] - over * up;
                dz[j] = up, dx[j] = way;
                shrink_z = larger(shrink_z, -up / z[j]);
                shrink_x = larger(shrink_x, on[b] * (1.0 + up / z[j]));
                xdz += x[j] * up, dxz += way * z[j], dxdz += way * up;
            });
        }
        const Lane one = splat(1.0);
        Lane step_x = 1.0 / larger(shrink_x, one), step_z = 1.0 / larger(shrink_z, one);
        const Lane mean = product / number;
        Lane part = (product + step_z * xdz + step_x * dxz + step_x * step_z * dxdz) / larger(product, splat(1e-300));
        part = smaller(larger(part, splat(0.0)), one);
        const Lane centre = part * part * part * mean;

        // corrector
        for (int k = 0; k < shared; ++k) dy[k] = splat(p.rhs[k]);
        for (int b = 0; b < p.blocks; ++b) {
            if (!any[b]) continue;
            const int n = p.own_start[b + 1] - p.own_start[b], m = wide(b);
            for (int k = 0; k < m; ++k) h[k] = splat(0.0);
            add(b, h, [&](int j) {
                const Lane inverse = 1.0 / z[j], right = on[b] * (centre - dx[j] * dz[j]) * inverse;
                dx[j] = right;
                return x[j] * inverse * rest[j] - right;
            });
            forward(b, h, dy);
            for (int k = 0; k < n; ++k) dyo[p.own_start[b] + k] = h[k];
        }
        Factor<Q, Lane>::solve<1>(p.pattern, diagonal, off, dy, shared);
        next = border(whole, unit);
        shrink_x = shrink_z = splat(0.0);
        for (int b = 0; b < p.blocks; ++b) {
            if (!any[b]) continue;
            gather(b, dyo, dy, v);
            backward(b, v);
            for (int k = 0; k < p.own_start[b + 1] - p.own_start[b]; ++k) dyo[p.own_start[b] + k] = v[k];
            products(b, v, [&](int j, Lane sum) {
                const Lane up = on[b] * (rest[j] - sum), way = dx[j] - x[j] - x[j] / z[j] * up;
                dz[j] = up, dx[j] = way;
                shrink_z = larger(shrink_z, -up / z[j]);
                shrink_x = larger(shrink_x, on[b] * -way / larger(x[j], splat(1e-300)));
            });
        }
        const Lane share = larger(splat(0.9), 1.0 - 0.1 * part);
        step_x = smaller(one, share / larger(shrink_x, splat(1e-12)));
        step_z = smaller(one, share / larger(shrink_z, splat(1e-12)));
        for (int b = 0; b < p.blocks; ++b) {
            if (!any[b]) continue;
            for (int j = begin(b); j < begin(b + 1); ++j) x[j] += step_x * dx[j], z[j] += step_z * dz[j];
            for (int k = p.own_start[b]; k < p.own_start[b + 1]; ++k) yo[k] += step_z * dyo[k];
        }
        for (int k = 0; k < shared; ++k) y[k] += step_z * dy[k];
        load += step_x * (next - load);
        return measures;
    }

    // Turns the solution for the right-hand side into that with lambda's own column met; the new lambda.
    Lane border(Lane whole, Lane unit) {
        // columns of lambda: -1 where it enters; unit = -1 + sum y there, to become zero
        Lane sum = splat(0.0);
        for (int k = 0; k < p.loads; ++k) sum -= dy[p.load[k]];
        const Lane next = (sum - unit) / whole;
        for (int k = 0; k < shared; ++k) dy[k] -= next * first[k];
        return next;
    }
};

}  // namespace jld
