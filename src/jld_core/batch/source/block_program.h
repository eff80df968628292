// Linear program of the relaxation by blocks, (6.5) and (6.6), for many choices of allowed blocks, one choice per SIMD
// lane.
//
// Standard form: min -lambda, A x + a lambda = b, x >= 0. Each column belongs to one block. Rows of one block alone are
// eliminated block by block. Rows of nodes, three per node, are shared by blocks and factored with the pattern of all
// blocks; a lane without a block has a unit diagonal in the block's own rows. Method: Mehrotra's predictor-corrector.
#pragma once
#include <cmath>
#include <vector>

#include "cholesky.h"
#include "store.h"

namespace jld {

class BlockProgram {
    static constexpr int NODE_ROWS = 3, MOST = JLD_BLOCK_ROWS;
    static constexpr int TRIANGLE_MOST = MOST * (MOST + 1) / 2;
    static constexpr double BEGIN = 0.3;   // starting value of columns and multipliers, the same for every choice
    static constexpr double LEFT = 1e-13;  // share of a pivot that is added to it, more than rounding takes away
    const JldBlocks& problem;
    const JldBlockTask& task;
    const int columns, own, shared, diagonals, offs;
    std::vector<Store<Lane>> held;  // owns the arrays below; their addresses do not change as `held` grows
    Lane *primal, *dual, *primal_step, *dual_step, *dual_residual, *is_allowed, *least_load, *most_load,
        *shared_multiplier, *own_multiplier, *shared_step, *own_step, *border_column, *diagonal, *off, *fill;
    std::vector<int64_t> fill_start;
    std::vector<char> in_any_lane;
    int64_t job[LANES];
    int age[LANES];
    double last[LANES];  // relative gap of the previous iteration
    int64_t given = 0;
    Lane load = splat(0.0), number = splat(1.0);

    Lane* take(int64_t n) {
        held.emplace_back(n + 1, splat(0.0));
        return held.back().data();
    }
    int begin(int b) const { return problem.column_start[b] + 2 * b; }
    int wide(int b) const {
        return problem.own_start[b + 1] - problem.own_start[b] + problem.shared_start[b + 1] - problem.shared_start[b];
    }

public:
    BlockProgram(const JldBlocks& problem, const JldBlockTask& task)
        : problem(problem),
          task(task),
          columns(problem.column_start[problem.blocks] + 2 * problem.blocks),
          own(problem.own_start[problem.blocks]),
          shared(NODE_ROWS * problem.nodes),
          diagonals(TRIANGLE<NODE_ROWS> * problem.nodes),
          offs(NODE_ROWS * NODE_ROWS * problem.pattern.column_start[problem.nodes]) {
        for (Lane** one : {&primal, &dual, &primal_step, &dual_step, &dual_residual}) *one = take(columns);
        for (Lane** one : {&is_allowed, &least_load, &most_load}) *one = take(problem.blocks);
        shared_multiplier = take(shared), shared_step = take(2 * shared), border_column = take(shared);
        own_multiplier = take(own), own_step = take(own);
        diagonal = take(diagonals), off = take(offs);
        int64_t total = 0;
        for (int b = 0; b < problem.blocks; ++b) {
            fill_start.push_back(total);
            const int n = problem.own_start[b + 1] - problem.own_start[b],
                      s = problem.shared_start[b + 1] - problem.shared_start[b];
            total += n * (n + 1) / 2 + n * s;
        }
        fill = take(total);
        in_any_lane.assign(problem.blocks, 0);
    }

    static bool fits(const JldBlocks& p) {
        for (int b = 0; b < p.blocks; ++b)
            if (p.own_start[b + 1] - p.own_start[b] + p.shared_start[b + 1] - p.shared_start[b] > MOST) return false;
        return true;
    }

    BlockProgram(const BlockProgram&) = delete;
    BlockProgram& operator=(const BlockProgram&) = delete;

    void run() {
        int busy = 0;
        for (int i = 0; i < LANES; ++i) busy += put(i);
        while (busy) {
            for (int b = 0; b < problem.blocks; ++b) {
                bool some = false;
                for (int i = 0; i < LANES; ++i) some |= lanes_of(is_allowed[b])[i] > 0.0;
                in_any_lane[b] = some;
            }
            const Measures m = step();
            for (int i = 0; i < LANES; ++i) {
                if (job[i] < 0) continue;
                ++age[i];
                const double bound = lanes_of(m.bound)[i];
                const double away = lanes_of(m.away)[i];
                const double size = std::fabs(bound) > 1.0 ? std::fabs(bound) : 1.0, least = task.thresholds[job[i]];
                const bool fell = bound < least - 1e-6 * size && away <= task.error;
                // Only multipliers matter for a bound, so stop although rounding takes late forces out of balance.
                const double gap = lanes_of(m.product)[i] / size;
                const bool rough = gap <= task.gap && away <= task.error;
                const bool near = bound < least + task.near * size;
                // Stop where rounding keeps the gap from decreasing further.
                const bool done = rough && (!near || gap <= task.fine_gap || gap > 0.5 * last[i]);
                last[i] = gap;
                const bool lost = !(std::fabs(bound) < 1e12) || !(away < 1e12);
                if (!fell && !done && !lost && age[i] < task.iterations) continue;
                give(i, fell ? 2 : rough ? 1 : 0);
                busy += put(i) - 1;
            }
        }
    }

private:
    struct Measures {
        Lane bound, away, product;  // -b'y, largest dual residual, x'z
    };

    // Put the next choice into lane i; return 0 if none is left.
    int put(int i) {
        const bool some = given < task.count;
        job[i] = some ? given++ : -1;
        age[i] = 0, last[i] = 1e300;
        const uint8_t* allowed = some ? task.allowed + job[i] * problem.blocks : nullptr;
        double count = 0.0;
        for (int b = 0; b < problem.blocks; ++b) {
            const bool here = some && allowed[b];
            lanes_of(is_allowed[b])[i] = here;
            lanes_of(least_load[b])[i] = some ? task.least_load[job[i]] : 0.0;
            lanes_of(most_load[b])[i] = some ? task.most_load[job[i]] : 0.0;
            for (int j = begin(b); j < begin(b + 1); ++j) {
                lanes_of(primal[j])[i] = here ? BEGIN : 0.0;
                lanes_of(dual[j])[i] = here ? BEGIN : 1.0;
                count += here;
            }
        }
        lanes_of(number)[i] = count > 0.0 ? count : 1.0;
        for (int k = 0; k < own; ++k) lanes_of(own_multiplier[k])[i] = 0.0;
        for (int k = 0; k < shared; ++k) lanes_of(shared_multiplier[k])[i] = 0.0;
        lanes_of(load)[i] = 0.0;
        return some;
    }

    void give(int i, int state) {
        const int64_t who = job[i];
        double* dual = task.dual + who * (own + shared);
        for (int k = 0; k < own; ++k) dual[k] = lanes_of(own_multiplier[k])[i];
        for (int k = 0; k < shared; ++k) dual[own + k] = lanes_of(shared_multiplier[k])[i];
        for (int b = 0; b < problem.blocks; ++b)
            task.share[who * problem.blocks + b] =
                lanes_of(primal[begin(b + 1) - 2])[i] + lanes_of(primal[begin(b + 1) - 1])[i];
        task.load[who] = lanes_of(load)[i], task.iterations_used[who] = age[i], task.state[who] = state;
    }

    // Call with each column of a block: position, first and last entry. Columns of its share are separate and come
    // last.
    template <class Call>
    void each(int b, Call call) {
        const int base = begin(b);
        for (int j = problem.column_start[b]; j < problem.column_start[b + 1]; ++j)
            call(base + j - problem.column_start[b], problem.entry_start[j], problem.entry_start[j + 1]);
    }

    // Call with a'v of every column of a block, and of both columns of its share. v: (rows of the block).
    template <class Call>
    void products(int b, const Lane* v, Call call) {
        each(b, [&](int j, int from, int to) {
            Lane sum = splat(0.0);
            for (int e = from; e < to; ++e) sum += problem.entry[e] * v[problem.entry_row[e]];
            call(j, sum);
        });
        Lane of_x = splat(0.0), of_load = splat(0.0);
        const int at = problem.own_start[b] + problem.shared_start[b];
        for (int r = 0; r < wide(b); ++r)
            of_x += problem.of_x[at + r] * v[r], of_load += problem.of_load[at + r] * v[r];
        call(begin(b + 1) - 2, of_x + least_load[b] * of_load);
        call(begin(b + 1) - 1, of_x + most_load[b] * of_load);
    }

    // Add A u to the rows of a block. u(j): multiplier of column j.
    template <class Call>
    void add(int b, Lane* rows, Call u) {
        each(b, [&](int j, int from, int to) {
            const Lane v = u(j);
            for (int e = from; e < to; ++e) rows[problem.entry_row[e]] += problem.entry[e] * v;
        });
        const Lane low = u(begin(b + 1) - 2), high = u(begin(b + 1) - 1);
        const Lane both = low + high, loaded = least_load[b] * low + most_load[b] * high;
        const int at = problem.own_start[b] + problem.shared_start[b];
        for (int r = 0; r < wide(b); ++r) rows[r] += problem.of_x[at + r] * both + problem.of_load[at + r] * loaded;
    }

    void gather(int b, const Lane* of_own, const Lane* of_shared, Lane* v) const {
        const int n = problem.own_start[b + 1] - problem.own_start[b],
                  s = problem.shared_start[b + 1] - problem.shared_start[b];
        for (int r = 0; r < n; ++r) v[r] = of_own[problem.own_start[b] + r];
        for (int r = 0; r < s; ++r) v[n + r] = of_shared[problem.shared[problem.shared_start[b] + r]];
    }

    // Form the Schur complement of A D A' of a block in the shared rows, and store the factor of its own rows.
    void condense(int b, Lane* K) {
        const int n = problem.own_start[b + 1] - problem.own_start[b], m = wide(b), s = m - n;
        Lane* L = fill + fill_start[b];
        Lane* C = L + n * (n + 1) / 2;
        const Lane stays = 1.0 - is_allowed[b];
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
        const int32_t* place = problem.place + problem.place_start[b];
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

    // Eliminate a block's own right-hand sides in place, and subtract their part from the shared ones.
    void forward(int b, Lane* h, Lane* common) {
        const int n = problem.own_start[b + 1] - problem.own_start[b], s = wide(b) - n;
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
            common[problem.shared[problem.shared_start[b] + r]] += v;
        }
    }

    // Compute a block's own rows from the shared ones. v: (rows of the block), own rows as `forward` left them.
    void backward(int b, Lane* v) {
        const int n = problem.own_start[b + 1] - problem.own_start[b], s = wide(b) - n;
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
        Lane K[TRIANGLE_MOST], v[MOST], h[MOST];
        for (int k = 0; k < diagonals; ++k) diagonal[k] = splat(0.0);
        for (int k = 0; k < problem.nodes; ++k)
            for (int c = 0; c < NODE_ROWS; ++c) diagonal[TRIANGLE<NODE_ROWS> * k + at(c, c)] = splat(1e-12);
        for (int k = 0; k < offs; ++k) off[k] = splat(0.0);
        for (int k = 0; k < shared; ++k) shared_step[k] = splat(problem.rhs[k]), shared_step[shared + k] = splat(0.0);
        Lane away = splat(0.0), product = splat(0.0);
        for (int b = 0; b < problem.blocks; ++b) {
            if (!in_any_lane[b]) continue;
            const int n = problem.own_start[b + 1] - problem.own_start[b], m = wide(b);
            gather(b, own_multiplier, shared_multiplier, v);
            products(b, v, [&](int j, Lane sum) {
                dual_residual[j] = is_allowed[b] * (-sum - dual[j]);
                away = larger(away, absolute(dual_residual[j]));
                product += primal[j] * dual[j];
            });
            for (int k = 0; k < m; ++k) h[k] = splat(0.0);
            for (int k = 0; k < at(m - 1, m - 1) + 1; ++k) K[k] = splat(0.0);
            each(b, [&](int j, int from, int to) {
                const Lane d = primal[j] / dual[j], u = d * dual_residual[j];
                for (int e = from; e < to; ++e) {
                    const int row = problem.entry_row[e];
                    const Lane w = d * problem.entry[e];
                    h[row] += problem.entry[e] * u;
                    for (int f = from; f <= e; ++f) K[at(row, problem.entry_row[f])] += w * problem.entry[f];
                }
            });
            const int low = begin(b + 1) - 2;
            for (int j = low; j < low + 2; ++j) {
                const Lane d = primal[j] / dual[j], u = d * dual_residual[j],
                           own_load = j == low ? least_load[b] : most_load[b];
                Lane a[MOST];
                int filled[MOST], count = 0;
                const int from = problem.own_start[b] + problem.shared_start[b];
                for (int k = 0; k < m; ++k)
                    if (problem.of_x[from + k] != 0.0 || problem.of_load[from + k] != 0.0) {
                        a[count] = problem.of_x[from + k] + own_load * problem.of_load[from + k];
                        filled[count++] = k;
                    }
                for (int e = 0; e < count; ++e) {
                    const Lane w = d * a[e];
                    h[filled[e]] += a[e] * u;
                    for (int f = 0; f <= e; ++f) K[at(filled[e], filled[f])] += w * a[f];
                }
            }
            condense(b, K);
            forward(b, h, shared_step);
            for (int k = 0; k < n; ++k) own_step[problem.own_start[b] + k] = h[k];
        }
        Lane bound = splat(0.0), unit = splat(-1.0);  // residual of the column of lambda
        for (int k = 0; k < problem.loads; ++k)
            shared_step[shared + problem.load[k]] = splat(-1.0), unit += shared_multiplier[problem.load[k]];
        for (int k = 0; k < shared; ++k) bound -= problem.rhs[k] * shared_multiplier[k];
        const Measures measures{bound, larger(away, absolute(unit)), product};

        for (int k = 0; k < problem.nodes; ++k)
            for (int c = 0; c < NODE_ROWS; ++c) diagonal[TRIANGLE<NODE_ROWS> * k + at(c, c)] *= 1.0 + LEFT;
        Factor<NODE_ROWS, Lane>::factor(problem.pattern, diagonal, off);
        Factor<NODE_ROWS, Lane>::solve<2>(problem.pattern, diagonal, off, shared_step, shared);
        Lane whole = splat(0.0);
        for (int k = 0; k < shared; ++k) border_column[k] = shared_step[shared + k];
        for (int k = 0; k < problem.loads; ++k) whole -= border_column[problem.load[k]];
        Lane next = border(whole, unit);

        // Predictor step.
        Lane shrink_x = splat(0.0), shrink_z = splat(0.0), xdz = splat(0.0), dxz = splat(0.0), dxdz = splat(0.0);
        for (int b = 0; b < problem.blocks; ++b) {
            if (!in_any_lane[b]) continue;
            gather(b, own_step, shared_step, v);
            backward(b, v);
            products(b, v, [&](int j, Lane sum) {
                const Lane up = is_allowed[b] * (dual_residual[j] - sum), over = primal[j] / dual[j],
                           way = -primal[j] - over * up;
                dual_step[j] = up, primal_step[j] = way;
                shrink_z = larger(shrink_z, -up / dual[j]);
                shrink_x = larger(shrink_x, is_allowed[b] * (1.0 + up / dual[j]));
                xdz += primal[j] * up, dxz += way * dual[j], dxdz += way * up;
            });
        }
        const Lane one = splat(1.0);
        Lane step_x = 1.0 / larger(shrink_x, one), step_z = 1.0 / larger(shrink_z, one);
        const Lane mean = product / number;
        Lane part = (product + step_z * xdz + step_x * dxz + step_x * step_z * dxdz) / larger(product, splat(1e-300));
        part = smaller(larger(part, splat(0.0)), one);
        const Lane centre = part * part * part * mean;

        // Corrector step.
        for (int k = 0; k < shared; ++k) shared_step[k] = splat(problem.rhs[k]);
        for (int b = 0; b < problem.blocks; ++b) {
            if (!in_any_lane[b]) continue;
            const int n = problem.own_start[b + 1] - problem.own_start[b], m = wide(b);
            for (int k = 0; k < m; ++k) h[k] = splat(0.0);
            add(b, h, [&](int j) {
                const Lane inverse = 1.0 / dual[j],
                           right = is_allowed[b] * (centre - primal_step[j] * dual_step[j]) * inverse;
                primal_step[j] = right;
                return primal[j] * inverse * dual_residual[j] - right;
            });
            forward(b, h, shared_step);
            for (int k = 0; k < n; ++k) own_step[problem.own_start[b] + k] = h[k];
        }
        Factor<NODE_ROWS, Lane>::solve<1>(problem.pattern, diagonal, off, shared_step, shared);
        next = border(whole, unit);
        shrink_x = shrink_z = splat(0.0);
        for (int b = 0; b < problem.blocks; ++b) {
            if (!in_any_lane[b]) continue;
            gather(b, own_step, shared_step, v);
            backward(b, v);
            for (int k = 0; k < problem.own_start[b + 1] - problem.own_start[b]; ++k)
                own_step[problem.own_start[b] + k] = v[k];
            products(b, v, [&](int j, Lane sum) {
                const Lane up = is_allowed[b] * (dual_residual[j] - sum),
                           way = primal_step[j] - primal[j] - primal[j] / dual[j] * up;
                dual_step[j] = up, primal_step[j] = way;
                shrink_z = larger(shrink_z, -up / dual[j]);
                shrink_x = larger(shrink_x, is_allowed[b] * -way / larger(primal[j], splat(1e-300)));
            });
        }
        const Lane share = larger(splat(0.9), 1.0 - 0.1 * part);
        step_x = smaller(one, share / larger(shrink_x, splat(1e-12)));
        step_z = smaller(one, share / larger(shrink_z, splat(1e-12)));
        for (int b = 0; b < problem.blocks; ++b) {
            if (!in_any_lane[b]) continue;
            for (int j = begin(b); j < begin(b + 1); ++j)
                primal[j] += step_x * primal_step[j], dual[j] += step_z * dual_step[j];
            for (int k = problem.own_start[b]; k < problem.own_start[b + 1]; ++k)
                own_multiplier[k] += step_z * own_step[k];
        }
        for (int k = 0; k < shared; ++k) shared_multiplier[k] += step_z * shared_step[k];
        load += step_x * (next - load);
        return measures;
    }

    // Correct the solution so that the column of lambda is met as well; return the new lambda.
    Lane border(Lane whole, Lane unit) {
        // Lambda enters `loads` rows with -1; `unit` = -1 + sum of their multipliers, which must become 0.
        Lane sum = splat(0.0);
        for (int k = 0; k < problem.loads; ++k) sum -= shared_step[problem.load[k]];
        const Lane next = (sum - unit) / whole;
        for (int k = 0; k < shared; ++k) shared_step[k] -= next * border_column[k];
        return next;
    }
};

}  // namespace jld
