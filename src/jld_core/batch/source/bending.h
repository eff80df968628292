// Bending rows of a spatial face, -a N + c.m <= h: two pairs, (2.2) and (2.5), or the edges of a hull, (2.3), (2.6) and
// (6.3).
//
// Each class eliminates its moments from H of (8.5) and returns what is left of the pivot of N. All pivots are sums of
// positive terms, so that nothing cancels. Derivation: docs/guide/batch_solver.md.
#pragma once
#include "simd.h"

namespace jld {

// Rectangles under uncoupled bending, (2.2) and (2.5): -a N +- b M <= h for each of M1 and M2.
struct PairBending {
    static constexpr int ROWS = 4, NUMBERS = 6, COLUMNS = 4;
    Lane row_normal[2], row_other[2], row_bound[2], moment_follows[2], moment_pivot[2], normal_effect[4];

    void put(int lane, const double* row) {
        JLD_UNROLL
        for (int j = 0; j < 2; ++j, row += 3)
            lanes_of(row_normal[j])[lane] = row[0], lanes_of(row_other[j])[lane] = row[1],
            lanes_of(row_bound[j])[lane] = row[2];
    }

    static void recede(double* row) { row[2] = row[5] = 0.0; }

    template <class Move>
    void copy(const PairBending& from, Move move) {
        JLD_UNROLL
        for (int j = 0; j < 2; ++j)
            move(row_normal[j], from.row_normal[j]), move(row_other[j], from.row_other[j]),
                move(row_bound[j], from.row_bound[j]);
    }

    // Return h - G F of one row from its numbers; `turn` returns the multiplier that a jump needs.
    static double slack(const double* row, int r, const double* F) {
        const double* own = row + 3 * (r / 2);
        return own[2] + own[0] * F[0] - (r % 2 ? -1.0 : 1.0) * own[1] * F[3 + r / 2];
    }

    static double turn(const double* row, int r, const double* jump) {
        double by = (r % 2 ? 1.0 : -1.0) * jump[3 + r / 2] / row[3 * (r / 2) + 1];
        return by > 0.0 ? by : 0.0;
    }

    Lane side(int r) const { return row_bound[r / 2]; }

    // out += G't
    void turned(const Lane* t, Lane* out) const {
        JLD_UNROLL
        for (int j = 0; j < 2; ++j) {
            out[0] -= row_normal[j] * (t[2 * j] + t[2 * j + 1]);
            out[3 + j] += row_other[j] * (t[2 * j] - t[2 * j + 1]);
        }
    }

    // Compute 1 / slack with one division for two pairs.
    static void invert(const Lane* s, Lane* is) {
        Lane one = s[0] * s[1], two = s[2] * s[3], both = 1.0 / (one * two), x = both * two, y = both * one;
        is[0] = x * s[1], is[1] = x * s[0], is[2] = y * s[3], is[3] = y * s[2];
    }

    // Eliminate the moments with the weights of the rows; return what is left of the pivot of N.
    Lane condense(const Lane* w, Lane delta) {
        Lane left = splat(0.0);
        JLD_UNROLL
        for (int j = 0; j < 2; ++j) {
            Lane plus = w[2 * j] + w[2 * j + 1], two = 2.0 * row_other[j] * row_other[j];
            moment_pivot[j] = 1.0 / (row_other[j] * row_other[j] * plus + delta);
            moment_follows[j] = row_normal[j] * row_other[j] * (w[2 * j] - w[2 * j + 1]) * moment_pivot[j];
            left += row_normal[j] * row_normal[j] *
                    (4.0 * (row_other[j] * row_other[j]) * w[2 * j] * w[2 * j + 1] + delta * plus) * moment_pivot[j];
            normal_effect[2 * j] = -row_normal[j] * (two * w[2 * j + 1] + delta) * moment_pivot[j];
            normal_effect[2 * j + 1] = -row_normal[j] * (two * w[2 * j] + delta) * moment_pivot[j];
        }
        return left;
    }

    // Return what the moments y = (M1, M2) add to the right-hand side of N.
    Lane lean(const Lane* y) const { return moment_follows[0] * y[0] + moment_follows[1] * y[1]; }

    void solve(Lane n, const Lane* y, Lane* x, Lane* rows) const {
        JLD_UNROLL
        for (int j = 0; j < 2; ++j) {
            Lane own = y[j] * moment_pivot[j], part = row_other[j] * own;
            x[j] = moment_follows[j] * n + own;
            rows[2 * j] = normal_effect[2 * j] * n + part, rows[2 * j + 1] = normal_effect[2 * j + 1] * n - part;
        }
    }

    // follow: moments per unit of N. couples: inverse pivots of M1 and M2. further: columns and weights of further
    // pivots.
    void follow(Lane* out) const { out[0] = moment_follows[0], out[1] = moment_follows[1]; }
    void couples(Lane* out) const { out[0] = moment_pivot[0], out[1] = moment_pivot[1]; }
    void further(Lane (*)[6], Lane*) const {}

    Lane slack(const Lane* y) const {
        Lane least = row_bound[0] + row_normal[0] * y[0] - absolute(row_other[0] * y[3]);
        return smaller(least, row_bound[1] + row_normal[1] * y[0] - absolute(row_other[1] * y[4]));
    }

    // Opening that the rotations of a jump need, (3.4); their dissipation; and the cost of a unit of opening beyond
    // that.
    Lane need(const Lane* jump) const {
        return row_normal[0] * absolute(jump[3]) / row_other[0] + row_normal[1] * absolute(jump[4]) / row_other[1];
    }
    Lane cost(const Lane* jump) const {
        return row_bound[0] * absolute(jump[3]) / row_other[0] + row_bound[1] * absolute(jump[4]) / row_other[1];
    }
    Lane rate() const { return smaller(row_bound[0] / row_normal[0], row_bound[1] / row_normal[1]); }
};

// Any hull, one row for each edge, unused ones last: -a N + p M1 + q M2 <= h. The ratio h / a is the same for all
// edges. The sums over pairs and triples of rows (Cauchy-Binet) avoid cancellation; the moment with the larger pivot is
// eliminated first.
template <int R>
struct HullBending {
    static constexpr int ROWS = R, NUMBERS = 6 * R, COLUMNS = 5;
    Lane row_normal[R], row_moment1[R], row_moment2[R], row_bound[R], corner[R][2];
    // True where M2 is eliminated first; inverse pivots; elimination columns; effects of N and of each moment on the
    // rows.
    Mask second_leads;
    Lane lead_pivot, last_pivot, lead_follows_last, lead_follows_normal, last_follows_normal, normal_effect[R],
        last_effect[R], lead_effect[R];

    void put(int lane, const double* row) {
        JLD_UNROLL
        for (int r = 0; r < R; ++r) {
            const double* own = row + 4 * r;
            lanes_of(row_normal[r])[lane] = own[0], lanes_of(row_moment1[r])[lane] = own[1],
            lanes_of(row_moment2[r])[lane] = own[2];
            lanes_of(row_bound[r])[lane] = own[3];
            JLD_UNROLL
            for (int j = 0; j < 2; ++j) lanes_of(corner[r][j])[lane] = row[4 * R + 2 * r + j];
        }
    }

    static bool idle(const double* own) { return own[1] == 0.0 && own[2] == 0.0; }

    static void recede(double* row) {
        JLD_UNROLL
        for (int r = 0; r < R; ++r) row[4 * r + 3] = idle(row + 4 * r) ? 1.0 : 0.0;
    }

    template <class Move>
    void copy(const HullBending& from, Move move) {
        JLD_UNROLL
        for (int r = 0; r < R; ++r) {
            move(row_normal[r], from.row_normal[r]), move(row_moment1[r], from.row_moment1[r]),
                move(row_moment2[r], from.row_moment2[r]), move(row_bound[r], from.row_bound[r]);
            JLD_UNROLL
            for (int j = 0; j < 2; ++j) move(corner[r][j], from.corner[r][j]);
        }
    }

    static double slack(const double* row, int r, const double* F) {
        const double* own = row + 4 * r;
        return own[3] + own[0] * F[0] - own[1] * F[3] - own[2] * F[4];
    }

    static double turn(const double*, int, const double*) { return 0.0; }
    Lane side(int r) const { return row_bound[r]; }

    void turned(const Lane* t, Lane* out) const {
        JLD_UNROLL
        for (int r = 0; r < R; ++r)
            out[0] -= row_normal[r] * t[r], out[3] += row_moment1[r] * t[r], out[4] += row_moment2[r] * t[r];
    }

    static void invert(const Lane* s, Lane* is) {
        JLD_UNROLL
        for (int r = 0; r < R; ++r) is[r] = 1.0 / s[r];
    }

    JLD_NOINLINE Lane condense(const Lane* w, Lane delta) {
        Lane pp = delta, qq = delta, aa = splat(0.0), none = splat(0.0);
        JLD_UNROLL
        for (int r = 0; r < R; ++r)
            pp += w[r] * row_moment1[r] * row_moment1[r], qq += w[r] * row_moment2[r] * row_moment2[r],
                aa += w[r] * row_normal[r] * row_normal[r];
        second_leads = qq > pp;
        Lane x[R], y[R], d[R][R];
        JLD_UNROLL
        for (int r = 0; r < R; ++r)
            lead_effect[r] = x[r] = select(second_leads, row_moment2[r], row_moment1[r]),
            y[r] = select(second_leads, row_moment1[r], row_moment2[r]);
        Lane pivot = select(second_leads, qq, pp), det = delta * (pp + qq - delta), follows = none, second = none,
             pairs = none;
        Lane cross = none;
        JLD_UNROLL
        for (int r = 0; r < R; ++r) {
            cross += w[r] * x[r] * y[r], follows += w[r] * x[r] * row_normal[r], second += w[r] * y[r] * row_normal[r];
            normal_effect[r] = -delta * delta * row_normal[r], last_effect[r] = delta * y[r];
        }
        second *= delta;
        JLD_UNROLL
        for (int r = 0; r < R; ++r) JLD_UNROLL
        for (int s = r + 1; s < R; ++s) {
            Lane both = w[r] * w[s], e = x[r] * y[s] - x[s] * y[r], f = x[r] * row_normal[s] - x[s] * row_normal[r];
            Lane g = y[r] * row_normal[s] - y[s] * row_normal[r], dot = x[r] * x[s] + y[r] * y[s];
            d[r][s] = e;
            det += both * e * e;
            second += both * e * f;
            pairs += both * (f * f + g * g);
            normal_effect[r] += delta * w[s] * (row_normal[s] * dot - row_normal[r] * (x[s] * x[s] + y[s] * y[s]));
            normal_effect[s] += delta * w[r] * (row_normal[r] * dot - row_normal[s] * (x[r] * x[r] + y[r] * y[r]));
            last_effect[r] -= w[s] * x[s] * e, last_effect[s] += w[r] * x[r] * e;
        }
        Lane triples = none;
        JLD_UNROLL
        for (int r = 0; r < R; ++r) JLD_UNROLL
        for (int s = r + 1; s < R; ++s) JLD_UNROLL
        for (int t = s + 1; t < R; ++t) {
            Lane T = row_normal[r] * d[s][t] - row_normal[s] * d[r][t] + row_normal[t] * d[r][s];
            Lane rs = w[r] * w[s], rt = w[r] * w[t], st = w[s] * w[t];
            triples += rs * w[t] * T * T;
            normal_effect[r] -= st * d[s][t] * T, normal_effect[s] += rt * d[r][t] * T,
                normal_effect[t] -= rs * d[r][s] * T;
        }
        Lane by = 1.0 / det;
        lead_pivot = 1.0 / pivot, last_pivot = pivot * by;
        lead_follows_last = -cross * lead_pivot, lead_follows_normal = follows * lead_pivot,
        last_follows_normal = second * by;
        JLD_UNROLL
        for (int r = 0; r < R; ++r) normal_effect[r] *= by, last_effect[r] *= lead_pivot;
        return (triples + delta * pairs + delta * delta * aa) * by;
    }

    Lane lean(const Lane* y) const {
        Lane one = select(second_leads, y[1], y[0]), two = select(second_leads, y[0], y[1]);
        return lead_follows_normal * one + last_follows_normal * (two + lead_follows_last * one);
    }

    void solve(Lane n, const Lane* y, Lane* x, Lane* rows) const {
        Lane one = select(second_leads, y[1], y[0]), two = select(second_leads, y[0], y[1]);
        Lane own = last_pivot * (two + lead_follows_last * one), start = lead_pivot * one,
             last = own + last_follows_normal * n, lead = start + lead_follows_last * last + lead_follows_normal * n;
        x[0] = select(second_leads, last, lead), x[1] = select(second_leads, lead, last);
        JLD_UNROLL
        for (int r = 0; r < R; ++r) rows[r] = normal_effect[r] * n + last_effect[r] * own + lead_effect[r] * start;
    }

    void follow(Lane* out) const {
        Lane lead = lead_follows_normal + lead_follows_last * last_follows_normal;
        out[0] = select(second_leads, last_follows_normal, lead),
        out[1] = select(second_leads, lead, last_follows_normal);
    }

    void couples(Lane* out) const {
        out[0] = select(second_leads, splat(0.0), lead_pivot), out[1] = select(second_leads, lead_pivot, splat(0.0));
    }

    void further(Lane (*columns)[6], Lane* weight) const {
        Lane none = splat(0.0), one = splat(1.0);
        JLD_UNROLL
        for (int j = 0; j < 6; ++j) columns[4][j] = none;
        columns[4][3] = select(second_leads, one, lead_follows_last),
        columns[4][4] = select(second_leads, lead_follows_last, one), weight[4] = last_pivot;
    }

    Lane slack(const Lane* y) const {
        Lane least = splat(1e300);
        JLD_UNROLL
        for (int r = 0; r < R; ++r)
            least = smaller(least, row_bound[r] + row_normal[r] * y[0] - row_moment1[r] * y[3] - row_moment2[r] * y[4]);
        return least;
    }

    Lane need(const Lane* jump) const {
        Lane most = splat(0.0);
        JLD_UNROLL
        for (int r = 0; r < R; ++r) most = larger(most, -(corner[r][0] * jump[3] + corner[r][1] * jump[4]));
        return most;
    }

    Lane cost(const Lane* jump) const { return rate() * need(jump); }
    Lane rate() const { return row_bound[0] / row_normal[0]; }
};

}  // namespace jld
