// Spatial faces in lanes: rows -a N +- b M1 <= h and the same with M2 (rocking), -a N + b t +- b MT <= h (sliding and
// torsion), and (t, V1, V2) in a second-order cone. Nesterov-Todd scaling in the light-cone coordinates p = x0 + x_e,
// m = x0 - x_e, q of a cone, in which it is a pair of rows more. Source: docs/guide/batch_solver.md.
#pragma once
#include <cmath>

#include "bending.h"
#include "iteration.h"

namespace jld {

template <class Bending>
struct SpatialFace {
    static constexpr bool BOWED = false;
    static constexpr bool drops(int resultant) { return resultant == 1 || resultant == 2 || resultant == 5; }
    static constexpr int Q = 6, B = Bending::ROWS, ROWS = B + 2, CONES = 1, SIDES = 27;
    static constexpr int NUMBERS = Bending::NUMBERS + 3, COLUMNS = Bending::COLUMNS;
    Bending bend;
    Lane a, b, h, keep;  // of torsion with the bound on shear
    Lane F[6], t, s[ROWS], z[ROWS], lack[ROWS], S[3], Z[3];
    // of one iteration: axes of the scaling (e, and q across it), the scaled point, pivots and what follows them
    Lane e1, e2, ip, iw, iq, scaled[3], unit[3], far, by_root;
    Lane is[ROWS], iT, sT, sv, iv, ic, it, tau, fall, g, upper, lower, first, last;
    Lane c[7], second[ROWS], turned2[3], pull[3], dF[6], dt, ds[ROWS], dz[ROWS], dS[3], dZ[3];

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
        bend.put(lane, row);
        const double* twist = row + Bending::NUMBERS;
        lanes_of(a)[lane] = twist[0], lanes_of(b)[lane] = twist[1], lanes_of(h)[lane] = twist[2];
        JLD_WHOLE
        for (int r = 0; r < ROWS; ++r) {
            double own, turn;
            if (r < B) {
                own = Bending::slack(row, r, forces), turn = Bending::turn(row, r, jumps);
            } else {
                const double sign = r == B ? 1.0 : -1.0, by = -sign * jumps[5] / twist[1];
                own = twist[2] + twist[0] * forces[0] - twist[1] * (sign * forces[5] + bound);
                turn = (by > 0.0 ? by : 0.0) + 0.5 * slip / twist[1];
            }
            const double slack = own > space ? own : space;
            lanes_of(s[r])[lane] = slack, lanes_of(lack[r])[lane] = slack - own;
            lanes_of(z[r])[lane] = push + turn;
        }
        lanes_of(keep)[lane] = kept;
    }

    // numbers of a ray; whether shear is bounded, so that a ray has none
    static bool recede(double* row) {
        Bending::recede(row);
        double* twist = row + Bending::NUMBERS;
        const bool bounded = twist[0] == 0.0;
        twist[2] = bounded ? 1.0 : 0.0;
        return bounded;
    }

    void copy(const SpatialFace& from, int source, int lane) {
        auto move = [&](Lane& to, const Lane& x) { lanes_of(to)[lane] = lanes_of(x)[source]; };
        bend.copy(from.bend, move);
        move(a, from.a), move(b, from.b), move(h, from.h);
        JLD_WHOLE
        for (int k = 0; k < 6; ++k) move(F[k], from.F[k]);
        JLD_WHOLE
        for (int r = 0; r < ROWS; ++r) move(s[r], from.s[r]);
        move(keep, from.keep);
    }

    Lane short_of(const Iteration& o, int row) const { return o.lag * (lack[row] + o.margin); }

    // eliminated in the order moments, V along e, V across, t, N: every pivot is a sum of positive terms
    void condense(Lane delta) {
        Lane w[ROWS];
        Bending::invert(s, is);
        Lane both = 1.0 / (s[B] * s[B + 1]);
        is[B] = both * s[B + 1], is[B + 1] = both * s[B];
        JLD_WHOLE
        for (int r = 0; r < ROWS; ++r) w[r] = z[r] * is[r];
        const Lane bent = bend.condense(w, delta), one = w[B], two = w[B + 1];
        Lane plus = one + two, square = b * b;
        iT = 1.0 / (square * plus + delta);
        sT = b * (one - two) * iT;
        Lane torsion = (4.0 * square * one * two + delta * plus) * iT;
        first = (2.0 * square * two + delta) * iT, last = (2.0 * square * one + delta) * iT;
        // the scaling point of the cone
        Lane ns = root(S[1] * S[1] + S[2] * S[2]), nz = root(Z[1] * Z[1] + Z[2] * Z[2]);
        Lane rs = root(larger((S[0] - ns) * (S[0] + ns), 1e-24 * (S[0] * S[0])));
        Lane rz = root(larger((Z[0] - nz) * (Z[0] + nz), 1e-24 * (Z[0] * Z[0])));
        Lane both_r = 1.0 / (rs * rz), by_s = both_r * rz, by_z = both_r * rs;
        Lane inner = (S[0] * Z[0] + S[1] * Z[1] + S[2] * Z[2]) * by_s * by_z;
        Lane twice = root(2.0 * (1.0 + inner)), by = 1.0 / twice;
        Lane w0 = (S[0] * by_s + Z[0] * by_z) * by;
        Lane x1 = (S[1] * by_s - Z[1] * by_z) * by, x2 = (S[2] * by_s - Z[2] * by_z) * by;
        Lane size = root(x1 * x1 + x2 * x2);
        Mask flat = size > 1e-12;
        Lane away = 1.0 / select(flat, size, splat(1.0));
        e1 = select(flat, x1 * away, splat(1.0)), e2 = select(flat, x2 * away, splat(0.0));
        Lane rho = w0 + size, eta2 = rs * by_z, eta = root(eta2), ieta = 1.0 / eta;
        iw = rho * ieta;       // multiplies m
        ip = ieta / rho;       // multiplies p
        iq = ieta;             // multiplies q
        Lane along = e1 * S[1] + e2 * S[2], across = e1 * S[2] - e2 * S[1];
        scaled[0] = (S[0] + along) * ip, scaled[1] = (S[0] - along) * iw, scaled[2] = across * iq;
        // the same as an arrow and on the unit hyperboloid, and what steps of it are measured by
        by_root = root(both_r);
        unit[0] = 0.5 * (scaled[0] + scaled[1]) * by_root, unit[1] = 0.5 * (scaled[0] - scaled[1]) * by_root;
        unit[2] = scaled[2] * by_root;
        far = 1.0 / (unit[0] + 1.0);
        Lane wp = 0.5 * ip * ip, wm = 0.5 * iw * iw, wq = iq * iq;
        iv = 1.0 / (wp + wm + delta);
        sv = (wm - wp) * iv;
        upper = (2.0 * wm + delta) * iv, lower = (2.0 * wp + delta) * iv;
        Lane cone = (4.0 * wp * wm + delta * (wp + wm)) * iv + delta;
        ic = 1.0 / (wq + delta);
        it = 1.0 / (cone + square * torsion);
        tau = b * a * torsion * it;
        fall = -a * cone * it;
        g = 1.0 / (a * a * torsion * cone * it + bent + delta);
    }

    // columns of N, t and the two directions of V, in the axes of the face, and their weights in H^-1
    void pivots(Lane (*columns)[6], Lane* weight) const {
        Lane m[2];
        bend.follow(m);
        Lane none = splat(0.0), x = e1 * keep, y = e2 * keep, along = sv * tau, twist = -sT * keep;
        const Lane normal[6] = {splat(1.0), x * along, y * along, m[0], m[1], twist * fall};
        const Lane bound[6] = {none, x * sv, y * sv, none, none, twist * b};
        const Lane one[6] = {none, x, y, none, none, none}, other[6] = {none, -y, x, none, none, none};
        JLD_WHOLE
        for (int j = 0; j < 6; ++j)
            columns[0][j] = normal[j], columns[1][j] = bound[j], columns[2][j] = one[j], columns[3][j] = other[j];
        weight[0] = g, weight[1] = it, weight[2] = iv, weight[3] = ic;
        bend.further(columns, weight);
    }

    // pivots of M1, M2 and MT alone
    void couples(Lane* out) const { bend.couples(out), out[2] = iT * keep; }

    // y: N, V along e, V across, M1, M2, MT, t. x = H^-1 y in the axes of the face; also t, rows G x, cone (p, m, q).
    void solve(const Lane* y, Lane* x, Lane& bound, Lane* rows, Lane* cone) const {
        Lane rest = y[6] - b * sT * y[5] + sv * y[1];
        Lane n = g * (y[0] + a * sT * y[5] + tau * rest + bend.lean(y + 3));
        bound = rest * it + tau * n;
        Lane own = y[1] * iv, along = own + sv * bound, across = y[2] * ic;
        Lane pressed = fall * n + b * it * rest, twist = y[5] * iT;
        x[0] = n, x[1] = e1 * along - e2 * across, x[2] = e2 * along + e1 * across;
        bend.solve(n, y + 3, x + 3, rows);
        x[5] = twist - sT * pressed;
        rows[B] = pressed * first + b * twist, rows[B + 1] = pressed * last - b * twist;
        cone[0] = bound * upper + own, cone[1] = bound * lower - own, cone[2] = across;
    }

    // jumps in the axes of the face into y's axes
    void turn(const Lane* jump, Lane* y) const {
        y[0] = jump[0], y[1] = e1 * jump[1] + e2 * jump[2], y[2] = e1 * jump[2] - e2 * jump[1];
        y[3] = jump[3], y[4] = jump[4], y[5] = jump[5];
    }

    void begin(Iteration& o, Lane* jump, Lane* x) {
        condense(o.delta);
        Lane late[ROWS], off[7], lag[7];
        JLD_WHOLE
        for (int r = 0; r < ROWS; ++r) {
            o.gap += s[r] * z[r];
            late[r] = z[r] * is[r] * short_of(o, r);
        }
        o.gap += S[0] * Z[0] + S[1] * Z[1] + S[2] * Z[2];
        jump[0] -= o.press;
        turned(z, off), turned(late, lag);
        JLD_WHOLE
        for (int j = 0; j < 6; ++j) off[j] += jump[j];
        off[1] -= Z[1], off[2] -= Z[2], off[6] -= Z[0];
        JLD_WHOLE
        for (int j = 0; j < 7; ++j) o.worst = larger(o.worst, absolute(off[j]));
        turn(jump, c);
        c[6] = splat(0.0);
        JLD_WHOLE
        for (int j = 0; j < 7; ++j) c[j] = -c[j] - lag[j];
        Lane bound, rows[ROWS], cone[3];
        solve(c, x, bound, rows, cone);
    }

    // out = G't, of resultants and the bound
    void turned(const Lane* t_, Lane* out) const {
        JLD_WHOLE
        for (int j = 0; j < 7; ++j) out[j] = splat(0.0);
        bend.turned(t_, out);
        out[0] -= a * (t_[B] + t_[B + 1]), out[5] += b * (t_[B] - t_[B + 1]), out[6] = b * (t_[B] + t_[B + 1]);
    }

    // longest step of a cone, as the reciprocal: d in scaled coordinates against the scaled point
    Lane reach(const Lane* d) const {
        const Lane l0 = unit[0], le = unit[1], lq = unit[2];
        Lane d0 = 0.5 * (d[0] + d[1]) * by_root, de = 0.5 * (d[0] - d[1]) * by_root, dq = d[2] * by_root;
        Lane first_part = l0 * d0 - le * de - lq * dq, share = (first_part + d0) * far;
        Lane re = de - share * le, rq = dq - share * lq;
        return root(re * re + rq * rq) - first_part;
    }

    static Lane dot(const Lane* x, const Lane* y) { return 0.5 * (x[0] * y[0] + x[1] * y[1]) + x[2] * y[2]; }

    void predict(Iteration& o, const Lane* jump) {
        Lane y[7], x[6], bound, rows[ROWS], cone[3];
        turn(jump, y);
        JLD_WHOLE
        for (int j = 0; j < 6; ++j) y[j] = c[j] - y[j];
        y[6] = c[6];
        solve(y, x, bound, rows, cone);
        JLD_WHOLE
        for (int r = 0; r < ROWS; ++r) {
            Lane step = -short_of(o, r) - rows[r], by = step * is[r];
            Lane push = -z[r] - z[r] * by;
            o.hit_s = larger(o.hit_s, -by), o.hit_z = larger(o.hit_z, 1.0 + by);
            o.zds += z[r] * step, o.dsdz += step * push;
            second[r] = by * push;
        }
        Lane there[3] = {cone[0] * ip, cone[1] * iw, cone[2] * iq}, back[3];
        JLD_WHOLE
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
        Lane add[7], t_[ROWS];
        JLD_WHOLE
        for (int r = 0; r < ROWS; ++r) t_[r] = second[r] - o.centre * is[r];
        turned(t_, add);
        // the scaled point divides what centring and the second order ask
        Lane r0 = o.centre - turned2[0], re = -turned2[1], rq = -turned2[2];
        const Lane l0 = unit[0], le = unit[1], lq = unit[2];
        Lane u0 = (l0 * r0 - le * re - lq * rq) * by_root, by = 1.0 / l0;
        Lane ue = (re * by_root - u0 * le) * by, uq = (rq * by_root - u0 * lq) * by;
        pull[0] = u0 + ue, pull[1] = u0 - ue, pull[2] = uq;
        Lane p = pull[0] * ip, m_ = pull[1] * iw;
        add[6] += 0.5 * (p + m_), add[1] = 0.5 * (p - m_), add[2] = uq * iq;
        JLD_WHOLE
        for (int j = 0; j < 7; ++j) c[j] += add[j];
        Lane bound, rows[ROWS], cone[3];
        solve(add, x, bound, rows, cone);
    }

    void move(const Lane* jump, Lane* x) const {
        Lane y[7], bound, rows[ROWS], cone[3];
        turn(jump, y);
        JLD_WHOLE
        for (int j = 0; j < 6; ++j) y[j] = c[j] - y[j];
        y[6] = c[6];
        solve(y, x, bound, rows, cone);
    }

    void direct(Iteration& o, const Lane* jump) {
        Lane y[7], rows[ROWS], cone[3];
        turn(jump, y);
        JLD_WHOLE
        for (int j = 0; j < 6; ++j) y[j] = c[j] - y[j];
        y[6] = c[6];
        solve(y, dF, dt, rows, cone);
        JLD_WHOLE
        for (int r = 0; r < ROWS; ++r) {
            Lane step = -short_of(o, r) - rows[r], by = step * is[r];
            Lane push = o.centre * is[r] - second[r] - z[r] - z[r] * by;
            ds[r] = step, dz[r] = push;
            o.hit_s = larger(o.hit_s, -by);
            Mask sooner = -push * o.under > o.over * z[r];
            o.over = select(sooner, -push, o.over), o.under = select(sooner, z[r], o.under);
        }
        Lane there[3] = {cone[0] * ip, cone[1] * iw, cone[2] * iq}, back[3];
        JLD_WHOLE
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
        JLD_WHOLE
        for (int j = 0; j < 6; ++j) F[j] += o.alpha_s * dF[j], o.moved = larger(o.moved, absolute(dF[j]));
        t += o.alpha_s * dt;
        JLD_WHOLE
        for (int r = 0; r < ROWS; ++r) {
            s[r] += o.alpha_s * ds[r], z[r] += o.alpha_z * dz[r];
            o.next += s[r] * z[r];
            o.value += (r < B ? bend.side(r) : h) * z[r];
            o.room = smaller(o.room, s[r] + o.margin - (1.0 - o.alpha_s) * short_of(o, r));
        }
        JLD_WHOLE
        for (int j = 0; j < 3; ++j) {
            S[j] += o.alpha_s * dS[j], Z[j] += o.alpha_z * dZ[j];
            o.next += S[j] * Z[j];
        }
    }

    Lane slack(const Lane* y) const {
        Lane shear = root(y[1] * y[1] + y[2] * y[2]) + absolute(y[5]);
        return smaller(h + a * y[0] - b * shear, bend.slack(y));
    }

    void dissipation(const Lane* jump, Lane& margin, Lane& work) const {
        Lane slip = larger(root(jump[1] * jump[1] + jump[2] * jump[2]), absolute(jump[5])) / b;
        margin = jump[0] - bend.need(jump) - a * slip;
        Mask slides = a > 0.0;
        Lane rate = smaller(bend.rate(), select(slides, h / select(slides, a, splat(1.0)), splat(1e300)));
        work = bend.cost(jump) + h * slip + rate * margin;
    }
};

}  // namespace jld
