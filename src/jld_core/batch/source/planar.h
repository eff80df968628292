// Planar faces in lanes: rows -a N +- b M <= h (rocking) and -a N +- b V <= h (sliding), with a third pair for
// compressive strength, whatever their label. Source of the reductions: docs/guide/batch_solver.md.
#pragma once
#include "iteration.h"
#include "meeting.h"

namespace jld {

template <int PAIRS, bool BOWS = false, bool MEETS = false>
struct PlanarFace {
    static constexpr int Q = 3, P = PAIRS, ROWS = 2 * PAIRS + Meeting<MEETS>::ROWS, CONES = 0, SIDES = 7;
    static constexpr int NUMBERS = 3 * PAIRS, BENT = 2 + Meeting<MEETS>::NUMBERS;
    static constexpr bool BOWED = BOWS, COUPLED = MEETS;
    Lane a[PAIRS], b[PAIRS], h[PAIRS], keep;
    Lane F[3], s[ROWS], z[ROWS], lack[ROWS];
    // of one iteration: 1/s, G H^-1 e_N by rows, pivot of N, columns of the elimination, inverse pivots of V and M
    Lane is[ROWS], k[ROWS], g, v, m, iv, im, c[3], second[ROWS], dF[3], ds[ROWS], dz[ROWS];

    // of a first pair that bows: its numbers before a tangent takes their place, c, n0, and what its rows lack
    Lane a0, h0, bow, knee, off[ROWS];

    // rows in which V and M meet; how M follows V there, and rows that follow V
    Meeting<MEETS> meeting;
    Lane vm, l[ROWS];

    static constexpr bool bends(int pair) { return pair != 1; }
    // resultants that a face without friction has not
    static constexpr bool drops(int resultant) { return resultant == 1; }

    // The tangent at a normal force, which is exact there: slope and height.
    void tangent(Lane n, Lane& slope, Lane& height) const {
        Lane at = larger(n, knee);
        slope = a0 - 2.0 * bow * at, height = h0 + bow * at * at;
    }

    // -G of N, V and M in a row
    Lane normal(int r, int of) const {
        if constexpr (COUPLED)
            if (r >= 2 * PAIRS) return meeting.row(r - 2 * PAIRS, of);
        if (of == 0) return a[r / 2];
        return bends(r / 2) == (of == 2) ? (r % 2 ? b[r / 2] : -b[r / 2]) : splat(0.0);
    }

    Lane height(int r) const {
        if constexpr (COUPLED)
            if (r >= 2 * PAIRS) return meeting.h;
        return h[r / 2];
    }

    void touch() {
        tangent(F[0], a[0], h[0]);
        for (int r = 0; r < 2; ++r) off[r] = s[r] - (h[0] + a[0] * F[0] - (r ? -b[0] : b[0]) * F[2]);
        if constexpr (COUPLED) {
            meeting.touch(F);
            for (int r = 2 * PAIRS; r < ROWS; ++r)
                off[r] = s[r] - (height(r) + normal(r, 0) * F[0] + normal(r, 1) * F[1] + normal(r, 2) * F[2]);
        }
    }

    void bend(int lane, const double* numbers, double space, double push) {
        lanes_of(a0)[lane] = lanes_of(a[0])[lane], lanes_of(h0)[lane] = lanes_of(h[0])[lane];
        lanes_of(bow)[lane] = numbers[0], lanes_of(knee)[lane] = numbers[1];
        double n = lanes_of(F[0])[lane], at = n > numbers[1] ? n : numbers[1];
        double lower = numbers[0] * (at * at - 2.0 * at * n);
        for (int r = 0; r < 2; ++r) {
            double own = lanes_of(s[r])[lane] - lanes_of(lack[r])[lane] + lower, slack = own > space ? own : space;
            lanes_of(s[r])[lane] = slack, lanes_of(lack[r])[lane] = slack - own;
        }
        if constexpr (COUPLED) {
            meeting.put(lane, numbers + 2);
            meeting.touch(F);
            for (int r = 2 * PAIRS; r < ROWS; ++r) {
                Lane room = height(r) + normal(r, 0) * F[0] + normal(r, 1) * F[1] + normal(r, 2) * F[2];
                double own = lanes_of(room)[lane], slack = own > space ? own : space;
                lanes_of(s[r])[lane] = slack, lanes_of(lack[r])[lane] = slack - own;
                lanes_of(z[r])[lane] = push;
            }
        }
    }

    // 1/s of two pairs with one division, which is what takes the time
    void invert() {
        Lane bend = s[0] * s[1], slide = s[2] * s[3], both = 1.0 / (bend * slide);
        Lane first = both * slide, last = both * bend;
        is[0] = first * s[1], is[1] = first * s[0], is[2] = last * s[3], is[3] = last * s[2];
        if constexpr (PAIRS == 3) {
            Lane by = 1.0 / (s[4] * s[5]);
            is[4] = by * s[5], is[5] = by * s[4];
        }
        if constexpr (COUPLED)
            for (int r = 2 * PAIRS; r < ROWS; r += 2) {
                Lane by = 1.0 / (s[r] * s[r + 1]);
                is[r] = by * s[r + 1], is[r + 1] = by * s[r];
            }
    }

    // The same elimination where V and M meet: first M, then V. What is left of N is the least sum of squares that V and
    // M can make of it, positive terms again, in which what they follow may be wrong by a digit.
    void couple(const Lane* w, Lane delta) {
        const Lane none = splat(0.0), *meet = w + 2 * PAIRS, *push = z + 2 * PAIRS;
        const Lane same = meet[0] + meet[1], other = meet[2] + meet[3];
        const Lane bb = meeting.b * meeting.b, cc = meeting.c * meeting.c, pushed = push[0] + push[1] + push[2] + push[3];
        const Lane curve = 2.0 * meeting.curve * pushed, along_n = meeting.along_n, along_v = meeting.along_v;
        Lane bending = none, sliding = b[1] * b[1] * (w[2] + w[3]) + curve * along_v * along_v;
        for (int p = 0; p < PAIRS; ++p)
            if (bends(p)) bending += b[p] * b[p] * (w[2 * p] + w[2 * p + 1]);
        Lane both = same + other, pm = delta + bending + cc * both, pv = delta + sliding + bb * both;
        Lane det = bending * sliding + (bending * bb + sliding * cc) * both + 4.0 * bb * cc * same * other;
        det += delta * (pm + pv - delta);
        im = 1.0 / pm, iv = pm / det, vm = -(meeting.b * meeting.c * (same - other)) * im;
        Lane with_m = none, with_v = curve * along_n * along_v;
        for (int r = 0; r < ROWS; ++r) with_v += w[r] * normal(r, 0) * normal(r, 1), with_m += w[r] * normal(r, 0) * normal(r, 2);
        v = -iv * (with_v + vm * with_m), m = vm * v - im * with_m;
        Lane left = delta * (1.0 + m * m + v * v) + select(F[0] >= knee, 2.0 * bow * (z[0] + z[1]), none);
        left += curve * (along_n + along_v * v) * (along_n + along_v * v);
        for (int r = 0; r < ROWS; ++r) {
            k[r] = -(normal(r, 0) + normal(r, 1) * v + normal(r, 2) * m);
            l[r] = -(normal(r, 1) + normal(r, 2) * vm);
            left += w[r] * k[r] * k[r];
        }
        g = 1.0 / left;
    }

    // H = G'WG + delta, eliminated in the order M, V, N so that every pivot is a sum of positive terms.
    void condense(Lane delta) {
        Lane w[ROWS];
        invert();
        for (int r = 0; r < ROWS; ++r) w[r] = z[r] * is[r];
        if constexpr (COUPLED) return couple(w, delta);
        Lane pm = delta, pv = delta, cm = splat(0.0), plus[PAIRS];
        for (int p = 0; p < PAIRS; ++p) {
            plus[p] = w[2 * p] + w[2 * p + 1];
            Lane minus = a[p] * b[p] * (w[2 * p] - w[2 * p + 1]);
            if (bends(p)) pm += b[p] * b[p] * plus[p], cm += minus;
        }
        pv += b[1] * b[1] * plus[1];
        Lane both = 1.0 / (pm * pv);
        im = both * pv, iv = both * pm;
        m = cm * im;
        v = a[1] * b[1] * (w[2] - w[3]) * iv;
        // products of two weights and the square of their rows' determinant
        Lane bend = 4.0 * (a[0] * a[0]) * (b[0] * b[0]) * w[0] * w[1] + delta * (a[0] * a[0]) * plus[0];
        Lane lean = splat(0.0), tilt = splat(0.0);
        if constexpr (PAIRS == 3) {
            bend += 4.0 * (a[2] * a[2]) * (b[2] * b[2]) * w[4] * w[5] + delta * (a[2] * a[2]) * plus[2];
            lean = a[0] * b[2] - a[2] * b[0], tilt = a[0] * b[2] + a[2] * b[0];
            bend += lean * lean * (w[0] * w[4] + w[1] * w[5]) + tilt * tilt * (w[0] * w[5] + w[1] * w[4]);
        }
        Lane slide = a[1] * a[1] * (4.0 * (b[1] * b[1]) * w[2] * w[3] + delta * plus[1]);
        if constexpr (BOWS) bend = bend * im + select(F[0] >= knee, 2.0 * bow * (z[0] + z[1]), splat(0.0));
        else bend *= im;
        g = 1.0 / (bend + slide * iv + delta);
        // what a unit of N does to each row when M and V follow it
        for (int p = 0; p < PAIRS; ++p) {
            Lane by = bends(p) ? im : iv;
            Lane two = 2.0 * b[p] * b[p];
            k[2 * p] = -a[p] * (two * w[2 * p + 1] + delta) * by;
            k[2 * p + 1] = -a[p] * (two * w[2 * p] + delta) * by;
        }
        if constexpr (PAIRS == 3) {
            k[0] += b[2] * (-lean * w[4] - tilt * w[5]) * im;
            k[1] += b[2] * (-tilt * w[4] - lean * w[5]) * im;
            k[4] += b[0] * (lean * w[0] - tilt * w[1]) * im;
            k[5] += b[0] * (-tilt * w[0] + lean * w[1]) * im;
        }
    }

    // x = H^-1 y
    void apply(const Lane* y, Lane* x) const {
        if constexpr (COUPLED) return follow(y, x, nullptr);
        Lane n = g * (y[0] + v * y[1] + m * y[2]);
        x[0] = n, x[1] = v * n + iv * y[1], x[2] = m * n + im * y[2];
    }

    // x = H^-1 y, and G x without the digits that x has lost
    void apply(const Lane* y, Lane* x, Lane* rows) const {
        if constexpr (COUPLED) return follow(y, x, rows);
        Lane n = g * (y[0] + v * y[1] + m * y[2]), slip = iv * y[1], turn = im * y[2];
        x[0] = n, x[1] = v * n + slip, x[2] = m * n + turn;
        for (int p = 0; p < PAIRS; ++p) {
            Lane part = b[p] * (bends(p) ? turn : slip);
            rows[2 * p] = k[2 * p] * n + part;
            rows[2 * p + 1] = k[2 * p + 1] * n - part;
        }
    }

    void follow(const Lane* y, Lane* x, Lane* rows) const {
        Lane n = g * (y[0] + v * y[1] + m * y[2]), slip = iv * (y[1] + vm * y[2]), turn = im * y[2];
        x[0] = n, x[1] = v * n + slip, x[2] = m * n + turn + vm * slip;
        if (rows)
            for (int r = 0; r < ROWS; ++r) rows[r] = k[r] * n + l[r] * slip - normal(r, 2) * turn;
    }

    // out = G't
    void turned(const Lane* t, Lane* out) const {
        Lane n = splat(0.0), q = splat(0.0), x = splat(0.0);
        for (int p = 0; p < PAIRS; ++p) {
            n -= a[p] * (t[2 * p] + t[2 * p + 1]);
            Lane d = b[p] * (t[2 * p] - t[2 * p + 1]);
            if (bends(p)) x += d; else q += d;
        }
        if constexpr (COUPLED)
            for (int r = 2 * PAIRS; r < ROWS; ++r)
                n -= normal(r, 0) * t[r], q -= normal(r, 1) * t[r], x -= normal(r, 2) * t[r];
        out[0] = n, out[1] = q, out[2] = x;
    }

    // a labelling into a lane: rows (a, b, h) of its pairs, and where iterations start
    void put(int lane, const double* row, double kept, const double* forces, const double* jumps, double space,
             double push) {
        for (int k = 0; k < PAIRS; ++k, row += 3) {
            lanes_of(a[k])[lane] = row[0], lanes_of(b[k])[lane] = row[1], lanes_of(h[k])[lane] = row[2];
            double x = bends(k) ? forces[2] : kept * forces[1], n = forces[0];
            double turn = row[1] > 0.0 ? -jumps[bends(k) ? 2 : 1] / row[1] : 0.0;
            for (int r = 0; r < 2; ++r) {
                double sign = r ? -1.0 : 1.0, own = row[2] + row[0] * n - sign * row[1] * x;
                double slack = own > space ? own : space;
                lanes_of(s[2 * k + r])[lane] = slack;
                lanes_of(lack[2 * k + r])[lane] = slack - own;
                lanes_of(z[2 * k + r])[lane] = push + (sign * turn > 0.0 ? sign * turn : 0.0);
            }
        }
        lanes_of(keep)[lane] = kept;
        lanes_of(F[0])[lane] = forces[0], lanes_of(F[1])[lane] = kept * forces[1], lanes_of(F[2])[lane] = forces[2];
    }

    // Forces and multipliers of a lane, for one that begins there.
    void save(int lane, double* to) const {
        for (int k = 0; k < 3; ++k) to[k] = lanes_of(F[k])[lane];
        for (int r = 0; r < ROWS; ++r) to[3 + r] = lanes_of(z[r])[lane];
    }

    // The same into a lane under another label; product: the least of a slack and its multiplier.
    void resume(int lane, const double* row, double kept, const double* from, double space, double product) {
        const double forces[3] = {from[0], kept * from[1], from[2]};
        for (int k = 0; k < 3; ++k) lanes_of(F[k])[lane] = forces[k];
        for (int k = 0; k < PAIRS; ++k, row += 3) {
            lanes_of(a[k])[lane] = row[0], lanes_of(b[k])[lane] = row[1], lanes_of(h[k])[lane] = row[2];
            const double middle = row[2] + row[0] * forces[0], side = row[1] * forces[bends(k) ? 2 : 1];
            for (int r = 0; r < 2; ++r) {
                const double own = r ? middle + side : middle - side, slack = own > space ? own : space;
                const double push = from[3 + 2 * k + r], least = product / slack;
                lanes_of(s[2 * k + r])[lane] = slack, lanes_of(lack[2 * k + r])[lane] = slack - own;
                lanes_of(z[2 * k + r])[lane] = push > least ? push : least;
            }
        }
        lanes_of(keep)[lane] = kept;
    }

    // numbers of a ray; whether shear is bounded, so that a ray has none
    static bool recede(double* row) {
        const bool bounded = row[3] == 0.0;
        for (int k = 0; k < PAIRS; ++k) {
            const bool idle = row[3 * k] == 0.0 && (k == 1 || row[3 * k + 1] == 0.0);
            row[3 * k + 2] = idle ? 1.0 : 0.0;
        }
        return bounded;
    }

    void copy(PlanarFace& from, int source, int lane) {
        auto move = [&](Lane& to, const Lane& x) { lanes_of(to)[lane] = lanes_of(x)[source]; };
        for (int k = 0; k < PAIRS; ++k) move(a[k], from.a[k]), move(b[k], from.b[k]), move(h[k], from.h[k]);
        for (int k = 0; k < ROWS; ++k) move(s[k], from.s[k]), move(z[k], from.z[k]);
        for (int k = 0; k < 3; ++k) move(F[k], from.F[k]);
        move(keep, from.keep);
        if constexpr (BOWS) move(a0, from.a0), move(h0, from.h0), move(bow, from.bow), move(knee, from.knee);
        if constexpr (COUPLED) meeting.copy(from.meeting, source, lane);
    }

    // What is left of h - G F = s at the start shrinks with every step.
    Lane short_of(const Iteration& it, int row) const {
        Lane rest = it.lag * (lack[row] + it.margin);
        if constexpr (BOWS)
            if (row < 2 || row >= 2 * PAIRS) return select(bow > 0.0, off[row] + it.margin, rest);
        return rest;
    }

    // jump: A'u. Condenses H, gives the predictor's right-hand side through H^-1.
    void begin(Iteration& it, Lane* jump, Lane* x) {
        if constexpr (BOWS) touch();
        condense(it.delta);
        Lane pull[3], t[ROWS], late[3];
        turned(z, pull);
        for (int r = 0; r < ROWS; ++r) {
            it.gap += s[r] * z[r];
            t[r] = z[r] * is[r] * short_of(it, r);
        }
        turned(t, late);
        jump[0] -= it.press;
        for (int k = 0; k < 3; ++k) {
            it.worst = larger(it.worst, absolute(jump[k] + pull[k]));
            // of s dz + z ds = -s z what depends on z falls out against the residual of the jumps
            c[k] = -jump[k] - late[k];
        }
        apply(c, x);
    }

    void predict(Iteration& it, const Lane* jump) {
        Lane y[3], x[3], rows[ROWS];
        for (int k = 0; k < 3; ++k) y[k] = c[k] - jump[k];
        apply(y, x, rows);
        for (int r = 0; r < ROWS; ++r) {
            Lane step = -short_of(it, r) - rows[r], by = step * is[r];
            Lane push = -z[r] - z[r] * by;
            it.hit_s = larger(it.hit_s, -by), it.hit_z = larger(it.hit_z, 1.0 + by);
            it.zds += z[r] * step, it.dsdz += step * push;
            second[r] = by * push;
        }
    }

    // x: what centring and the second order add to the right-hand side, through H^-1
    void correct(const Iteration& it, Lane* x) {
        Lane t[ROWS], back[3];
        for (int r = 0; r < ROWS; ++r) t[r] = it.centre * is[r] - second[r];
        turned(t, back);
        for (int k = 0; k < 3; ++k) c[k] -= back[k], back[k] = -back[k];
        apply(back, x);
    }

    void move(const Lane* jump, Lane* x) const {
        Lane y[3];
        for (int k = 0; k < 3; ++k) y[k] = c[k] - jump[k];
        apply(y, x);
    }

    void direct(Iteration& it, const Lane* jump) {
        Lane y[3], rows[ROWS];
        for (int k = 0; k < 3; ++k) y[k] = c[k] - jump[k];
        apply(y, dF, rows);
        for (int r = 0; r < ROWS; ++r) {
            Lane step = -short_of(it, r) - rows[r], by = step * is[r];
            Lane push = it.centre * is[r] - second[r] - z[r] - z[r] * by;
            ds[r] = step, dz[r] = push;
            it.hit_s = larger(it.hit_s, -by);
            // the largest -dz / z as a fraction, compared by products
            Mask sooner = -push * it.under > it.over * z[r];
            it.over = select(sooner, -push, it.over), it.under = select(sooner, z[r], it.under);
        }
    }

    void advance(Iteration& it) {
        // what the tangent missed, which the next one mends
        if constexpr (BOWS) it.bent = larger(it.bent, bow * (it.alpha_s * dF[0]) * (it.alpha_s * dF[0]));
        if constexpr (COUPLED) {
            Lane along = it.alpha_s * (meeting.along_n * dF[0] + meeting.along_v * dF[1]);
            it.bent = larger(it.bent, meeting.curve * along * along);
        }
        for (int k = 0; k < 3; ++k) F[k] += it.alpha_s * dF[k], it.moved = larger(it.moved, absolute(dF[k]));
        for (int r = 0; r < ROWS; ++r) {
            s[r] += it.alpha_s * ds[r], z[r] += it.alpha_z * dz[r];
            it.next += s[r] * z[r];
            it.value += height(r) * z[r];
            if constexpr (!BOWS) it.room = smaller(it.room, s[r] + it.margin - (1.0 - it.alpha_s) * short_of(it, r));
        }
        if constexpr (BOWS) it.room = smaller(it.room, slack(F));
    }

    // least slack of forces in the rows
    Lane slack(const Lane* y) const {
        Lane least = splat(1e300);
        for (int p = 0; p < PAIRS; ++p) {
            Lane slope = a[p], height = h[p];
            if constexpr (BOWS)
                if (p == 0) tangent(y[0], slope, height);
            least = smaller(least, height + slope * y[0] - absolute(b[p] * y[bends(p) ? 2 : 1]));
        }
        if constexpr (COUPLED) least = smaller(least, meeting.slack(y));
        return least;
    }

    // margin: what a jump opens more than it must for its dissipation to be finite; work: that dissipation,
    // min h.t over t >= 0 with G't = -J, in closed form.
    void dissipation(const Lane* jump, Lane& margin, Lane& work) const {
        Lane turn = absolute(jump[2]) / b[0], slip = absolute(jump[1] * keep) / b[1];
        Lane rest = jump[0] - a[0] * turn - a[1] * slip;
        Lane dearest = splat(1e300);
        Lane bend = h[0] / a[0];
        Lane slide = select(a[1] > 0.0, h[1] / select(a[1] > 0.0, a[1], splat(1.0)), dearest);
        margin = rest;
        work = h[0] * turn + h[1] * slip + smaller(bend, slide) * rest;
        if constexpr (PAIRS == 3) {
            // the third pair closes: P of the first, R of the third, a0 P - a2 R = opening, b0 P + b2 R >= |turn|
            Mask crushes = b[2] > 0.0;
            Lane a2 = -select(crushes, a[2], splat(-1.0)), b2 = select(crushes, b[2], splat(1.0));
            Lane open = jump[0] - a[1] * slip, bent = absolute(jump[2]);
            Lane R = larger(splat(0.0), -open / a2);
            R = larger(R, (bent - b[0] * open / a[0]) / (b[0] * a2 / a[0] + b2));
            Lane crushed = h[0] * (open + a2 * R) / a[0] + h[1] * slip + h[2] * R;
            work = select(crushes, crushed, work);
            margin = select(crushes, dearest, margin);
        }
        if constexpr (BOWS) {
            Mask bowed = bow > 0.0;
            work = select(bowed, bowing(jump), work);
            if constexpr (COUPLED) work = select(meeting.limit > 0.0, meeting.dissipation(jump, keep), work);
            margin = select(bowed, dearest, margin);
        }
    }

    // sup of p N + |turn| b|M|/b, M at most the first pair and, where there is one, the line of the third; and what
    // slips at N = 0
    Lane bowing(const Lane* jump) const {
        Lane c = select(bow > 0.0, bow, splat(1.0)), turn = absolute(jump[2]), slip = absolute(jump[1] * keep) / b[1];
        Lane p = a[1] * slip - jump[0], t = turn / b[0];
        Lane high = (a0 + root(a0 * a0 + 4.0 * c * h0)) / (2.0 * c);
        Lane steep = a0 - 2.0 * c * knee, start = h0 + c * knee * knee, low = -start / steep, below = low;
        if constexpr (PAIRS == 3) {
            // the line meets the tangent at a corner
            Mask lined = b[2] > 0.0;
            Lane by = select(lined, b[2], splat(1.0)), slope = a[2] / by, height = h[2] / by;
            Lane corner = (start / b[0] - height) / (slope - steep / b[0]);
            Lane foot = -height / select(lined, slope, splat(1.0));
            low = select(lined, foot, low);
            below = select(lined, select(p + turn * slope > 0.0, corner, foot), low);
        }
        Lane turns = select(t > 0.0, t, splat(1.0));
        Lane free = select(t > 0.0, (a0 + p / turns) / (2.0 * c), select(p > 0.0, high, low));
        Lane n = select(free > knee, smaller(free, high), select(t > 0.0, below, free)), slope, height;
        tangent(n, slope, height);
        Lane most = larger(splat(0.0), (height + slope * n) / b[0]);
        if constexpr (PAIRS == 3)
            most = select(b[2] > 0.0, smaller(most, larger(splat(0.0), (h[2] + a[2] * n) / b[2])), most);
        return h[1] * slip + p * n + turn * most;
    }
};

}  // namespace jld
