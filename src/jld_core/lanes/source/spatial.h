// Spatial faces in lanes: rows -a N +- b M1 <= h and the same with M2 (rocking), -a N + b t +- b MT <= h (sliding and
// torsion), and (t, V1, V2) in a second-order cone. Nesterov-Todd scaling in the light-cone coordinates p = x0 + x_e,
// m = x0 - x_e, q of a cone, in which it is a pair of rows more. Source: docs/guide/kernel.md.
#pragma once
#include "iteration.h"

namespace jld {

struct SpatialFace {
    static constexpr bool BOWED = false;
    static constexpr bool drops(int resultant) { return resultant == 1 || resultant == 2 || resultant == 5; }
    static constexpr bool bends(int pair) { return pair != 2; }
    static constexpr int Q = 6, P = 3, ROWS = 6, CONES = 1, SIDES = 27;
    Lane a[3], b[3], h[3], keep;
    Lane F[6], t, s[6], z[6], lack[6], S[3], Z[3];
    // of one iteration: axes of the scaling (e, and q across it), the scaled point, pivots and what follows them
    Lane e1, e2, ip, iw, iq, scaled[3], det;
    Lane is[6], k[4], m[2], im[2], iT, sT, sv, iv, ic, it, tau, fall, g, upper, lower, first, last;
    Lane c[7], second[6], turned2[3], pull[3], dF[6], dt, ds[6], dz[6], dS[3], dZ[3];

    void put(int lane, const double* row, double kept, const double* from, const double* turns, double space,
             double push) {
        double forces[6], jumps[6];
        for (int f = 0; f < 6; ++f) {
            const double by = drops(f) ? kept : 1.0;
            forces[f] = by * from[f], jumps[f] = by * turns[f], lanes_of(F[f])[lane] = forces[f];
        }
        double size = std::sqrt(forces[1] * forces[1] + forces[2] * forces[2]);
        double slip = std::sqrt(jumps[1] * jumps[1] + jumps[2] * jumps[2]);
        double bound = size + space, pressed = slip + push;
        lanes_of(t)[lane] = bound;
        lanes_of(S[0])[lane] = bound, lanes_of(S[1])[lane] = forces[1], lanes_of(S[2])[lane] = forces[2];
        lanes_of(Z[0])[lane] = pressed, lanes_of(Z[1])[lane] = jumps[1], lanes_of(Z[2])[lane] = jumps[2];
        for (int k = 0; k < 3; ++k, row += 3) {
            lanes_of(a[k])[lane] = row[0], lanes_of(b[k])[lane] = row[1], lanes_of(h[k])[lane] = row[2];
            double turn = -jumps[3 + k] / row[1];
            for (int r = 0; r < 2; ++r) {
                double sign = r ? -1.0 : 1.0;
                double own = row[2] + row[0] * forces[0] - sign * row[1] * forces[3 + k] - (k == 2 ? row[1] * bound : 0.0);
                double slack = own > space ? own : space;
                lanes_of(s[2 * k + r])[lane] = slack;
                lanes_of(lack[2 * k + r])[lane] = slack - own;
                lanes_of(z[2 * k + r])[lane] =
                    push + (sign * turn > 0.0 ? sign * turn : 0.0) + (k == 2 ? 0.5 * slip / row[1] : 0.0);
            }
        }
        lanes_of(keep)[lane] = kept;
    }

    void copy(const SpatialFace& from, int source, int lane) {
        auto move = [&](Lane& to, const Lane& x) { lanes_of(to)[lane] = lanes_of(x)[source]; };
        for (int k = 0; k < 3; ++k) move(a[k], from.a[k]), move(b[k], from.b[k]), move(h[k], from.h[k]);
        for (int k = 0; k < 6; ++k) move(F[k], from.F[k]), move(s[k], from.s[k]);
        move(keep, from.keep);
    }

    Lane short_of(const Iteration& o, int row) const { return o.lag * (lack[row] + o.margin); }

    // eliminated in the order moments, V along e, V across, t, N: every pivot is a sum of positive terms
    void condense(Lane delta) {
        Lane w[6], bend[2];
        {
            Lane one = s[0] * s[1], two = s[2] * s[3], both = 1.0 / (one * two), x = both * two, y = both * one;
            is[0] = x * s[1], is[1] = x * s[0], is[2] = y * s[3], is[3] = y * s[2];
            Lane last_pair = 1.0 / (s[4] * s[5]);
            is[4] = last_pair * s[5], is[5] = last_pair * s[4];
        }
        for (int r = 0; r < 6; ++r) w[r] = z[r] * is[r];
        for (int j = 0; j < 2; ++j) {
            Lane plus = w[2 * j] + w[2 * j + 1], two = 2.0 * b[j] * b[j];
            im[j] = 1.0 / (b[j] * b[j] * plus + delta);
            m[j] = a[j] * b[j] * (w[2 * j] - w[2 * j + 1]) * im[j];
            bend[j] = a[j] * a[j] * (4.0 * (b[j] * b[j]) * w[2 * j] * w[2 * j + 1] + delta * plus) * im[j];
            k[2 * j] = -a[j] * (two * w[2 * j + 1] + delta) * im[j];
            k[2 * j + 1] = -a[j] * (two * w[2 * j] + delta) * im[j];
        }
        Lane plus = w[4] + w[5], square = b[2] * b[2];
        iT = 1.0 / (square * plus + delta);
        sT = b[2] * (w[4] - w[5]) * iT;
        Lane torsion = (4.0 * square * w[4] * w[5] + delta * plus) * iT;
        first = (2.0 * square * w[5] + delta) * iT, last = (2.0 * square * w[4] + delta) * iT;
        // the scaling point of the cone
        Lane ns = root(S[1] * S[1] + S[2] * S[2]), nz = root(Z[1] * Z[1] + Z[2] * Z[2]);
        Lane rs = root(larger((S[0] - ns) * (S[0] + ns), 1e-24 * (S[0] * S[0])));
        Lane rz = root(larger((Z[0] - nz) * (Z[0] + nz), 1e-24 * (Z[0] * Z[0])));
        Lane by_s = 1.0 / rs, by_z = 1.0 / rz;
        Lane inner = (S[0] * Z[0] + S[1] * Z[1] + S[2] * Z[2]) * by_s * by_z;
        Lane twice = root(2.0 * (1.0 + inner)), by = 1.0 / twice;
        Lane w0 = (S[0] * by_s + Z[0] * by_z) * by;
        Lane x1 = (S[1] * by_s - Z[1] * by_z) * by, x2 = (S[2] * by_s - Z[2] * by_z) * by;
        Lane size = root(x1 * x1 + x2 * x2);
        Mask flat = size > 1e-12;
        Lane away = 1.0 / select(flat, size, splat(1.0));
        e1 = select(flat, x1 * away, splat(1.0)), e2 = select(flat, x2 * away, splat(0.0));
        Lane rho = w0 + size, eta2 = rs * by_z, eta = root(eta2), ieta = 1.0 / eta;
        det = rs * rz;
        iw = rho * ieta;       // multiplies m
        ip = ieta / rho;       // multiplies p
        iq = ieta;             // multiplies q
        Lane along = e1 * S[1] + e2 * S[2], across = e1 * S[2] - e2 * S[1];
        scaled[0] = (S[0] + along) * ip, scaled[1] = (S[0] - along) * iw, scaled[2] = across * iq;
        Lane wp = 0.5 * ip * ip, wm = 0.5 * iw * iw, wq = iq * iq;
        iv = 1.0 / (wp + wm + delta);
        sv = (wm - wp) * iv;
        upper = (2.0 * wm + delta) * iv, lower = (2.0 * wp + delta) * iv;
        Lane cone = (4.0 * wp * wm + delta * (wp + wm)) * iv + delta;
        ic = 1.0 / (wq + delta);
        it = 1.0 / (cone + square * torsion);
        tau = b[2] * a[2] * torsion * it;
        fall = -a[2] * cone * it;
        g = 1.0 / (a[2] * a[2] * torsion * cone * it + bend[0] + bend[1] + delta);
    }

    // columns of N, t and the two directions of V, in the axes of the face, and their weights in H^-1
    void pivots(Lane columns[4][6], Lane* weight) const {
        Lane none = splat(0.0), x = e1 * keep, y = e2 * keep, along = sv * tau, twist = -sT * keep;
        const Lane normal[6] = {splat(1.0), x * along, y * along, m[0], m[1], twist * fall};
        const Lane bound[6] = {none, x * sv, y * sv, none, none, twist * b[2]};
        const Lane one[6] = {none, x, y, none, none, none}, other[6] = {none, -y, x, none, none, none};
        for (int j = 0; j < 6; ++j)
            columns[0][j] = normal[j], columns[1][j] = bound[j], columns[2][j] = one[j], columns[3][j] = other[j];
        weight[0] = g, weight[1] = it, weight[2] = iv, weight[3] = ic;
    }

    // y: N, V along e, V across, M1, M2, MT, t. x = H^-1 y in the axes of the face; also t, rows G x, cone (p, m, q).
    void solve(const Lane* y, Lane* x, Lane& bound, Lane* rows, Lane* cone) const {
        Lane rest = y[6] - b[2] * sT * y[5] + sv * y[1];
        Lane n = g * (y[0] + a[2] * sT * y[5] + tau * rest + m[0] * y[3] + m[1] * y[4]);
        bound = rest * it + tau * n;
        Lane own = y[1] * iv, along = own + sv * bound, across = y[2] * ic;
        Lane pressed = fall * n + b[2] * it * rest, twist = y[5] * iT;
        x[0] = n, x[1] = e1 * along - e2 * across, x[2] = e2 * along + e1 * across;
        x[3] = m[0] * n + y[3] * im[0], x[4] = m[1] * n + y[4] * im[1], x[5] = twist - sT * pressed;
        for (int j = 0; j < 2; ++j) {
            Lane part = b[j] * (y[3 + j] * im[j]);
            rows[2 * j] = k[2 * j] * n + part, rows[2 * j + 1] = k[2 * j + 1] * n - part;
        }
        rows[4] = pressed * first + b[2] * twist, rows[5] = pressed * last - b[2] * twist;
        cone[0] = bound * upper + own, cone[1] = bound * lower - own, cone[2] = across;
    }

    // jumps in the axes of the face into y's axes
    void turn(const Lane* jump, Lane* y) const {
        y[0] = jump[0], y[1] = e1 * jump[1] + e2 * jump[2], y[2] = e1 * jump[2] - e2 * jump[1];
        y[3] = jump[3], y[4] = jump[4], y[5] = jump[5];
    }

    void begin(Iteration& o, Lane* jump, Lane* x) {
        condense(o.delta);
        Lane late[6];
        for (int r = 0; r < 6; ++r) {
            o.gap += s[r] * z[r];
            late[r] = z[r] * is[r] * short_of(o, r);
        }
        o.gap += S[0] * Z[0] + S[1] * Z[1] + S[2] * Z[2];
        jump[0] -= o.press;
        Lane off[7] = {jump[0], jump[1] - Z[1], jump[2] - Z[2], jump[3], jump[4], jump[5], b[2] * (z[4] + z[5]) - Z[0]};
        Lane lag[7];
        for (int j = 0; j < 7; ++j) lag[j] = splat(0.0);
        for (int j = 0; j < 3; ++j) {
            off[0] -= a[j] * (z[2 * j] + z[2 * j + 1]), off[3 + j] += b[j] * (z[2 * j] - z[2 * j + 1]);
            lag[0] -= a[j] * (late[2 * j] + late[2 * j + 1]), lag[3 + j] += b[j] * (late[2 * j] - late[2 * j + 1]);
        }
        lag[6] = b[2] * (late[4] + late[5]);
        for (int j = 0; j < 7; ++j) o.worst = larger(o.worst, absolute(off[j]));
        turn(jump, c);
        c[6] = splat(0.0);
        for (int j = 0; j < 7; ++j) c[j] = -c[j] - lag[j];
        Lane bound, rows[6], cone[3];
        solve(c, x, bound, rows, cone);
    }

    // longest step of a cone, as the reciprocal: d in scaled coordinates against the scaled point
    Lane reach(const Lane* d) const {
        Lane by = 1.0 / det, rd = root(by);
        Lane l0 = 0.5 * (scaled[0] + scaled[1]) * rd, le = 0.5 * (scaled[0] - scaled[1]) * rd, lq = scaled[2] * rd;
        Lane d0 = 0.5 * (d[0] + d[1]) * rd, de = 0.5 * (d[0] - d[1]) * rd, dq = d[2] * rd;
        Lane first_part = l0 * d0 - le * de - lq * dq, share = (first_part + d0) / (l0 + 1.0);
        Lane re = de - share * le, rq = dq - share * lq;
        return root(re * re + rq * rq) - first_part;
    }

    static Lane dot(const Lane* x, const Lane* y) { return 0.5 * (x[0] * y[0] + x[1] * y[1]) + x[2] * y[2]; }

    void predict(Iteration& o, const Lane* jump) {
        Lane y[7], x[6], bound, rows[6], cone[3];
        turn(jump, y);
        for (int j = 0; j < 6; ++j) y[j] = c[j] - y[j];
        y[6] = c[6];
        solve(y, x, bound, rows, cone);
        for (int r = 0; r < 6; ++r) {
            Lane step = -short_of(o, r) - rows[r], by = step * is[r];
            Lane push = -z[r] - z[r] * by;
            o.hit_s = larger(o.hit_s, -by), o.hit_z = larger(o.hit_z, 1.0 + by);
            o.zds += z[r] * step, o.dsdz += step * push;
            second[r] = by * push;
        }
        Lane there[3] = {cone[0] * ip, cone[1] * iw, cone[2] * iq}, back[3];
        for (int j = 0; j < 3; ++j) back[j] = -scaled[j] - there[j];
        o.hit_s = larger(o.hit_s, reach(there)), o.hit_z = larger(o.hit_z, reach(back));
        Lane product = dot(there, back);
        o.zds += dot(scaled, there), o.dsdz += product;
        Lane x0 = 0.5 * (there[0] + there[1]), y0 = 0.5 * (back[0] + back[1]);
        turned2[0] = product;
        turned2[1] = 0.5 * (x0 * (back[0] - back[1]) + y0 * (there[0] - there[1]));
        turned2[2] = x0 * back[2] + y0 * there[2];
    }

    void correct(const Iteration& o, Lane* x) {
        Lane add[7], t_[6];
        for (int r = 0; r < 6; ++r) t_[r] = o.centre * is[r] - second[r];
        add[0] = splat(0.0);
        for (int j = 0; j < 3; ++j) {
            add[0] += a[j] * (t_[2 * j] + t_[2 * j + 1]);
            add[3 + j] = -b[j] * (t_[2 * j] - t_[2 * j + 1]);
        }
        add[6] = -b[2] * (t_[4] + t_[5]);
        // the scaled point divides what centring and the second order ask
        Lane r0 = o.centre - turned2[0], re = -turned2[1], rq = -turned2[2];
        Lane l0 = 0.5 * (scaled[0] + scaled[1]), le = 0.5 * (scaled[0] - scaled[1]), lq = scaled[2];
        Lane u0 = (l0 * r0 - le * re - lq * rq) / det, by = 1.0 / l0;
        Lane ue = (re - u0 * le) * by, uq = (rq - u0 * lq) * by;
        pull[0] = u0 + ue, pull[1] = u0 - ue, pull[2] = uq;
        Lane p = pull[0] * ip, m_ = pull[1] * iw;
        add[6] += 0.5 * (p + m_), add[1] = 0.5 * (p - m_), add[2] = uq * iq;
        for (int j = 0; j < 7; ++j) c[j] += add[j];
        Lane bound, rows[6], cone[3];
        solve(add, x, bound, rows, cone);
    }

    void move(const Lane* jump, Lane* x) const {
        Lane y[7], bound, rows[6], cone[3];
        turn(jump, y);
        for (int j = 0; j < 6; ++j) y[j] = c[j] - y[j];
        y[6] = c[6];
        solve(y, x, bound, rows, cone);
    }

    void direct(Iteration& o, const Lane* jump) {
        Lane y[7], rows[6], cone[3];
        turn(jump, y);
        for (int j = 0; j < 6; ++j) y[j] = c[j] - y[j];
        y[6] = c[6];
        solve(y, dF, dt, rows, cone);
        for (int r = 0; r < 6; ++r) {
            Lane step = -short_of(o, r) - rows[r], by = step * is[r];
            Lane push = o.centre * is[r] - second[r] - z[r] - z[r] * by;
            ds[r] = step, dz[r] = push;
            o.hit_s = larger(o.hit_s, -by);
            Mask sooner = -push * o.under > o.over * z[r];
            o.over = select(sooner, -push, o.over), o.under = select(sooner, z[r], o.under);
        }
        Lane there[3] = {cone[0] * ip, cone[1] * iw, cone[2] * iq}, back[3];
        for (int j = 0; j < 3; ++j) back[j] = pull[j] - scaled[j] - there[j];
        o.hit_s = larger(o.hit_s, reach(there)), o.hit_z = larger(o.hit_z, reach(back));
        unturn(cone[0], cone[1], cone[2], dS);
        unturn(back[0] * ip, back[1] * iw, back[2] * iq, dZ);
    }

    void unturn(Lane p, Lane m_, Lane q, Lane* out) const {
        Lane along = 0.5 * (p - m_);
        out[0] = 0.5 * (p + m_), out[1] = e1 * along - e2 * q, out[2] = e2 * along + e1 * q;
    }

    void advance(Iteration& o) {
        for (int j = 0; j < 6; ++j) F[j] += o.alpha_s * dF[j], o.moved = larger(o.moved, absolute(dF[j]));
        t += o.alpha_s * dt;
        for (int r = 0; r < 6; ++r) {
            s[r] += o.alpha_s * ds[r], z[r] += o.alpha_z * dz[r];
            o.next += s[r] * z[r];
            o.value += h[r / 2] * z[r];
        }
        for (int j = 0; j < 3; ++j) {
            S[j] += o.alpha_s * dS[j], Z[j] += o.alpha_z * dZ[j];
            o.next += S[j] * Z[j];
        }
    }

    Lane slack(const Lane* y) const {
        Lane shear = root(y[1] * y[1] + y[2] * y[2]) + absolute(y[5]);
        Lane least = h[2] + a[2] * y[0] - b[2] * shear;
        for (int j = 0; j < 2; ++j) least = smaller(least, h[j] + a[j] * y[0] - absolute(b[j] * y[3 + j]));
        return least;
    }

    void dissipation(const Lane* jump, Lane& margin, Lane& work) const {
        Lane slip = larger(root(jump[1] * jump[1] + jump[2] * jump[2]), absolute(jump[5])) / b[2];
        Lane one = absolute(jump[3]) / b[0], two = absolute(jump[4]) / b[1];
        margin = jump[0] - a[0] * one - a[1] * two - a[2] * slip;
        Lane rate = smaller(h[0] / a[0], h[1] / a[1]);
        Mask slides = a[2] > 0.0;
        rate = smaller(rate, select(slides, h[2] / select(slides, a[2], splat(1.0)), splat(1e300)));
        work = h[0] * one + h[1] * two + h[2] * slip + rate * margin;
    }
};

}  // namespace jld
