// Bending of a spatial face: rows -a N + c.m <= h, as two pairs or along the edges of any hull.
//
// Each eliminates its moments and says what is left of N: chains of pivots that are sums of positive terms, never entries
// of an inverse. Source of the reductions: docs/guide/batch_solver.md.
#pragma once
#include "simd.h"

namespace jld {

// Rectangles whose moments do not meet: -a N +- b M <= h for each.
struct PairBending {
    static constexpr int ROWS = 4, NUMBERS = 6, COLUMNS = 4;
    Lane a[2], b[2], h[2], m[2], im[2], k[4];

    void put(int lane, const double* row) {
        JLD_WHOLE
        for (int j = 0; j < 2; ++j, row += 3)
            lanes_of(a[j])[lane] = row[0], lanes_of(b[j])[lane] = row[1], lanes_of(h[j])[lane] = row[2];
    }

    static void recede(double* row) { row[2] = row[5] = 0.0; }

    template <class Move>
    void copy(const PairBending& from, Move move) {
        JLD_WHOLE
        for (int j = 0; j < 2; ++j) move(a[j], from.a[j]), move(b[j], from.b[j]), move(h[j], from.h[j]);
    }

    // h - G F of a row of numbers, and the multiplier that a jump asks for
    static double slack(const double* row, int r, const double* F) {
        const double* own = row + 3 * (r / 2);
        return own[2] + own[0] * F[0] - (r % 2 ? -1.0 : 1.0) * own[1] * F[3 + r / 2];
    }

    static double turn(const double* row, int r, const double* jump) {
        double by = (r % 2 ? 1.0 : -1.0) * jump[3 + r / 2] / row[3 * (r / 2) + 1];
        return by > 0.0 ? by : 0.0;
    }

    Lane side(int r) const { return h[r / 2]; }

    // out += G't
    void turned(const Lane* t, Lane* out) const {
        JLD_WHOLE
        for (int j = 0; j < 2; ++j) {
            out[0] -= a[j] * (t[2 * j] + t[2 * j + 1]);
            out[3 + j] += b[j] * (t[2 * j] - t[2 * j + 1]);
        }
    }

    // 1 / s with one division for every two pairs
    static void invert(const Lane* s, Lane* is) {
        Lane one = s[0] * s[1], two = s[2] * s[3], both = 1.0 / (one * two), x = both * two, y = both * one;
        is[0] = x * s[1], is[1] = x * s[0], is[2] = y * s[3], is[3] = y * s[2];
    }

    // what the rows leave of the pivot of N
    Lane condense(const Lane* w, Lane delta) {
        Lane left = splat(0.0);
        JLD_WHOLE
        for (int j = 0; j < 2; ++j) {
            Lane plus = w[2 * j] + w[2 * j + 1], two = 2.0 * b[j] * b[j];
            im[j] = 1.0 / (b[j] * b[j] * plus + delta);
            m[j] = a[j] * b[j] * (w[2 * j] - w[2 * j + 1]) * im[j];
            left += a[j] * a[j] * (4.0 * (b[j] * b[j]) * w[2 * j] * w[2 * j + 1] + delta * plus) * im[j];
            k[2 * j] = -a[j] * (two * w[2 * j + 1] + delta) * im[j];
            k[2 * j + 1] = -a[j] * (two * w[2 * j] + delta) * im[j];
        }
        return left;
    }

    // what moments add to the side of N; y: M1, M2
    Lane lean(const Lane* y) const { return m[0] * y[0] + m[1] * y[1]; }

    void solve(Lane n, const Lane* y, Lane* x, Lane* rows) const {
        JLD_WHOLE
        for (int j = 0; j < 2; ++j) {
            Lane own = y[j] * im[j], part = b[j] * own;
            x[j] = m[j] * n + own;
            rows[2 * j] = k[2 * j] * n + part, rows[2 * j + 1] = k[2 * j + 1] * n - part;
        }
    }

    // moments that follow a unit of N; of each pivot of moments alone that moment, its weight, and what follows it
    void follow(Lane* out) const { out[0] = m[0], out[1] = m[1]; }
    void couples(Lane* out) const { out[0] = im[0], out[1] = im[1]; }
    void further(Lane (*)[6], Lane*) const {}

    Lane slack(const Lane* y) const {
        Lane least = h[0] + a[0] * y[0] - absolute(b[0] * y[3]);
        return smaller(least, h[1] + a[1] * y[0] - absolute(b[1] * y[4]));
    }

    // opening that the moments of a jump need, and what a unit of opening beyond it costs
    Lane need(const Lane* jump) const { return a[0] * absolute(jump[3]) / b[0] + a[1] * absolute(jump[4]) / b[1]; }
    Lane cost(const Lane* jump) const { return h[0] * absolute(jump[3]) / b[0] + h[1] * absolute(jump[4]) / b[1]; }
    Lane rate() const { return smaller(h[0] / a[0], h[1] / a[1]); }
};

// Any hull, one row for each edge, idle ones at the end: -a N + p M1 + q M2 <= h, h / a the same for all of a face.
// Sums over pairs and triples of rows (Cauchy and Binet) keep what cancels apart; the stiffer moment goes first.
template <int R>
struct HullBending {
    static constexpr int ROWS = R, NUMBERS = 6 * R, COLUMNS = 5;
    Lane a[R], p[R], q[R], h[R], corner[R][2];
    // which moment goes first; 1 / pivots; what follows what; what N and the second moment do to rows when others follow
    Mask swap;
    Lane ix, iy, xy, xn, yn, k[R], l[R], first[R];

    void put(int lane, const double* row) {
        JLD_WHOLE
        for (int r = 0; r < R; ++r) {
            const double* own = row + 4 * r;
            lanes_of(a[r])[lane] = own[0], lanes_of(p[r])[lane] = own[1], lanes_of(q[r])[lane] = own[2];
            lanes_of(h[r])[lane] = own[3];
            JLD_WHOLE
            for (int j = 0; j < 2; ++j) lanes_of(corner[r][j])[lane] = row[4 * R + 2 * r + j];
        }
    }

    static bool idle(const double* own) { return own[1] == 0.0 && own[2] == 0.0; }

    static void recede(double* row) {
        JLD_WHOLE
        for (int r = 0; r < R; ++r) row[4 * r + 3] = idle(row + 4 * r) ? 1.0 : 0.0;
    }

    template <class Move>
    void copy(const HullBending& from, Move move) {
        JLD_WHOLE
        for (int r = 0; r < R; ++r) {
            move(a[r], from.a[r]), move(p[r], from.p[r]), move(q[r], from.q[r]), move(h[r], from.h[r]);
            JLD_WHOLE
            for (int j = 0; j < 2; ++j) move(corner[r][j], from.corner[r][j]);
        }
    }

    static double slack(const double* row, int r, const double* F) {
        const double* own = row + 4 * r;
        return own[3] + own[0] * F[0] - own[1] * F[3] - own[2] * F[4];
    }

    static double turn(const double*, int, const double*) { return 0.0; }
    Lane side(int r) const { return h[r]; }

    void turned(const Lane* t, Lane* out) const {
        JLD_WHOLE
        for (int r = 0; r < R; ++r) out[0] -= a[r] * t[r], out[3] += p[r] * t[r], out[4] += q[r] * t[r];
    }

    static void invert(const Lane* s, Lane* is) {
        JLD_WHOLE
        for (int r = 0; r < R; ++r) is[r] = 1.0 / s[r];
    }

    JLD_ONCE Lane condense(const Lane* w, Lane delta) {
        Lane pp = delta, qq = delta, aa = splat(0.0), none = splat(0.0);
        JLD_WHOLE
        for (int r = 0; r < R; ++r) pp += w[r] * p[r] * p[r], qq += w[r] * q[r] * q[r], aa += w[r] * a[r] * a[r];
        swap = qq > pp;
        Lane x[R], y[R], d[R][R];
        JLD_WHOLE
        for (int r = 0; r < R; ++r) first[r] = x[r] = select(swap, q[r], p[r]), y[r] = select(swap, p[r], q[r]);
        Lane pivot = select(swap, qq, pp), det = delta * (pp + qq - delta), follows = none, second = none, pairs = none;
        Lane cross = none;
        JLD_WHOLE
        for (int r = 0; r < R; ++r) {
            cross += w[r] * x[r] * y[r], follows += w[r] * x[r] * a[r], second += w[r] * y[r] * a[r];
            k[r] = -delta * delta * a[r], l[r] = delta * y[r];
        }
        second *= delta;
        JLD_WHOLE
        for (int r = 0; r < R; ++r)
            JLD_WHOLE
            for (int s = r + 1; s < R; ++s) {
                Lane both = w[r] * w[s], e = x[r] * y[s] - x[s] * y[r], f = x[r] * a[s] - x[s] * a[r];
                Lane g = y[r] * a[s] - y[s] * a[r], dot = x[r] * x[s] + y[r] * y[s];
                d[r][s] = e;
                det += both * e * e;
                second += both * e * f;
                pairs += both * (f * f + g * g);
                k[r] += delta * w[s] * (a[s] * dot - a[r] * (x[s] * x[s] + y[s] * y[s]));
                k[s] += delta * w[r] * (a[r] * dot - a[s] * (x[r] * x[r] + y[r] * y[r]));
                l[r] -= w[s] * x[s] * e, l[s] += w[r] * x[r] * e;
            }
        Lane triples = none;
        JLD_WHOLE
        for (int r = 0; r < R; ++r)
            JLD_WHOLE
            for (int s = r + 1; s < R; ++s)
                JLD_WHOLE
                for (int t = s + 1; t < R; ++t) {
                    Lane T = a[r] * d[s][t] - a[s] * d[r][t] + a[t] * d[r][s];
                    Lane rs = w[r] * w[s], rt = w[r] * w[t], st = w[s] * w[t];
                    triples += rs * w[t] * T * T;
                    k[r] -= st * d[s][t] * T, k[s] += rt * d[r][t] * T, k[t] -= rs * d[r][s] * T;
                }
        Lane by = 1.0 / det;
        ix = 1.0 / pivot, iy = pivot * by;
        xy = -cross * ix, xn = follows * ix, yn = second * by;
        JLD_WHOLE
        for (int r = 0; r < R; ++r) k[r] *= by, l[r] *= ix;
        return (triples + delta * pairs + delta * delta * aa) * by;
    }

    Lane lean(const Lane* y) const {
        Lane one = select(swap, y[1], y[0]), two = select(swap, y[0], y[1]);
        return xn * one + yn * (two + xy * one);
    }

    void solve(Lane n, const Lane* y, Lane* x, Lane* rows) const {
        Lane one = select(swap, y[1], y[0]), two = select(swap, y[0], y[1]);
        Lane own = iy * (two + xy * one), start = ix * one, last = own + yn * n, lead = start + xy * last + xn * n;
        x[0] = select(swap, last, lead), x[1] = select(swap, lead, last);
        JLD_WHOLE
        for (int r = 0; r < R; ++r) rows[r] = k[r] * n + l[r] * own + first[r] * start;
    }

    void follow(Lane* out) const {
        Lane lead = xn + xy * yn;
        out[0] = select(swap, yn, lead), out[1] = select(swap, lead, yn);
    }

    void couples(Lane* out) const {
        out[0] = select(swap, splat(0.0), ix), out[1] = select(swap, ix, splat(0.0));
    }

    void further(Lane (*columns)[6], Lane* weight) const {
        Lane none = splat(0.0), one = splat(1.0);
        JLD_WHOLE
        for (int j = 0; j < 6; ++j) columns[4][j] = none;
        columns[4][3] = select(swap, one, xy), columns[4][4] = select(swap, xy, one), weight[4] = iy;
    }

    Lane slack(const Lane* y) const {
        Lane least = splat(1e300);
        JLD_WHOLE
        for (int r = 0; r < R; ++r) least = smaller(least, h[r] + a[r] * y[0] - p[r] * y[3] - q[r] * y[4]);
        return least;
    }

    Lane need(const Lane* jump) const {
        Lane most = splat(0.0);
        JLD_WHOLE
        for (int r = 0; r < R; ++r) most = larger(most, -(corner[r][0] * jump[3] + corner[r][1] * jump[4]));
        return most;
    }

    Lane cost(const Lane* jump) const { return rate() * need(jump); }
    Lane rate() const { return h[0] / a[0]; }
};

}  // namespace jld
