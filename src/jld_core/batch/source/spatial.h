// Spatial faces: bending rows (bending.h), -a N + b t +- b MT <= h and (t, V1, V2) in a second-order cone, (2.8).
// Nesterov-Todd scaling (8.4) in the coordinates p = x0 + x_e, m = x0 - x_e, q of a cone, in which it acts as one more
// pair of rows. Derivation: docs/guide/batch_solver.md.
#pragma once
#include <cmath>

#include "bending.h"
#include "iteration.h"

namespace jld {

template <class Bending>
struct SpatialFace {
    static constexpr bool PARABOLIC = false;
    static constexpr bool drops(int resultant) { return resultant == 1 || resultant == 2 || resultant == 5; }
    static constexpr int FREEDOMS = 6, BENDING_ROWS = Bending::ROWS, ROWS = BENDING_ROWS + 2, CONES = 1, SIDES = 27;
    static constexpr int NUMBERS = Bending::NUMBERS + 3, COLUMNS = Bending::COLUMNS;
    Bending bending;
    Lane row_normal, row_other, row_bound, keep;  // row of torsion and of the bound t on shear
    Lane force[6], shear_bound, row_slack[ROWS], row_multiplier[ROWS], lack[ROWS], cone_slack[3], cone_multiplier[3];
    // Of one iteration: axes and factors of the scaling, the scaled point, inverse pivots, and elimination columns.
    Lane axis_x, axis_y, scale_p, scale_m, scale_q, scaled[3], unit[3], far, by_root;
    Lane inverse_slack[ROWS], torsion_pivot, torsion_follows, along_follows_bound, along_pivot, across_pivot,
        bound_pivot, bound_follows, pressure_follows, normal_pivot, upper, lower, first, last;
    Lane right_side[7], second_order[ROWS], cone_second_order[3], cone_target[3], force_step[6], shear_bound_step,
        slack_step[ROWS], multiplier_step[ROWS], cone_slack_step[3], cone_multiplier_step[3];

    void put(int lane, const double* row, double kept, const double* from, const double* turns, double space,
             double push) {
        double forces[6], jumps[6];
        for (int f = 0; f < 6; ++f) {
            const double by = drops(f) ? kept : 1.0;
            forces[f] = by * from[f], jumps[f] = by * turns[f], lanes_of(force[f])[lane] = forces[f];
        }
        double size = std::sqrt(forces[1] * forces[1] + forces[2] * forces[2]);
        double slip = std::sqrt(jumps[1] * jumps[1] + jumps[2] * jumps[2]);
        double bound = size + space, pressed = slip + push;
        lanes_of(shear_bound)[lane] = bound;
        lanes_of(cone_slack[0])[lane] = bound, lanes_of(cone_slack[1])[lane] = forces[1],
        lanes_of(cone_slack[2])[lane] = forces[2];
        lanes_of(cone_multiplier[0])[lane] = pressed, lanes_of(cone_multiplier[1])[lane] = jumps[1],
        lanes_of(cone_multiplier[2])[lane] = jumps[2];
        bending.put(lane, row);
        const double* twist = row + Bending::NUMBERS;
        lanes_of(row_normal)[lane] = twist[0], lanes_of(row_other)[lane] = twist[1],
        lanes_of(row_bound)[lane] = twist[2];
        JLD_UNROLL
        for (int r = 0; r < ROWS; ++r) {
            double own, turn;
            if (r < BENDING_ROWS) {
                own = Bending::slack(row, r, forces), turn = Bending::turn(row, r, jumps);
            } else {
                const double sign = r == BENDING_ROWS ? 1.0 : -1.0, by = -sign * jumps[5] / twist[1];
                own = twist[2] + twist[0] * forces[0] - twist[1] * (sign * forces[5] + bound);
                turn = (by > 0.0 ? by : 0.0) + 0.5 * slip / twist[1];
            }
            const double slack = own > space ? own : space;
            lanes_of(row_slack[r])[lane] = slack, lanes_of(lack[r])[lane] = slack - own;
            lanes_of(row_multiplier[r])[lane] = push + turn;
        }
        lanes_of(keep)[lane] = kept;
    }

    // Turn the numbers of rows into those of their recession cone, (3.12); return true if shear is bounded, so that
    // rays have none.
    static bool recede(double* row) {
        Bending::recede(row);
        double* twist = row + Bending::NUMBERS;
        const bool bounded = twist[0] == 0.0;
        twist[2] = bounded ? 1.0 : 0.0;
        return bounded;
    }

    void copy(const SpatialFace& from, int source, int lane) {
        auto move = [&](Lane& to, const Lane& x) { lanes_of(to)[lane] = lanes_of(x)[source]; };
        bending.copy(from.bending, move);
        move(row_normal, from.row_normal), move(row_other, from.row_other), move(row_bound, from.row_bound);
        JLD_UNROLL
        for (int k = 0; k < 6; ++k) move(force[k], from.force[k]);
        JLD_UNROLL
        for (int r = 0; r < ROWS; ++r) move(row_slack[r], from.row_slack[r]);
        move(keep, from.keep);
    }

    Lane short_of(const Iteration& o, int row) const { return o.residual_share * (lack[row] + o.margin); }

    // Eliminate in the order moments, V along e, V across, t, N; every pivot is a sum of positive terms.
    void condense(Lane delta) {
        Lane w[ROWS];
        Bending::invert(row_slack, inverse_slack);
        Lane both = 1.0 / (row_slack[BENDING_ROWS] * row_slack[BENDING_ROWS + 1]);
        inverse_slack[BENDING_ROWS] = both * row_slack[BENDING_ROWS + 1],
        inverse_slack[BENDING_ROWS + 1] = both * row_slack[BENDING_ROWS];
        JLD_UNROLL
        for (int r = 0; r < ROWS; ++r) w[r] = row_multiplier[r] * inverse_slack[r];
        const Lane bent = bending.condense(w, delta), one = w[BENDING_ROWS], two = w[BENDING_ROWS + 1];
        Lane plus = one + two, square = row_other * row_other;
        torsion_pivot = 1.0 / (square * plus + delta);
        torsion_follows = row_other * (one - two) * torsion_pivot;
        Lane torsion = (4.0 * square * one * two + delta * plus) * torsion_pivot;
        first = (2.0 * square * two + delta) * torsion_pivot, last = (2.0 * square * one + delta) * torsion_pivot;
        // Scaling point of the cone, (8.4).
        Lane ns = root(cone_slack[1] * cone_slack[1] + cone_slack[2] * cone_slack[2]),
             nz = root(cone_multiplier[1] * cone_multiplier[1] + cone_multiplier[2] * cone_multiplier[2]);
        Lane rs = root(larger((cone_slack[0] - ns) * (cone_slack[0] + ns), 1e-24 * (cone_slack[0] * cone_slack[0])));
        Lane rz = root(larger((cone_multiplier[0] - nz) * (cone_multiplier[0] + nz),
                              1e-24 * (cone_multiplier[0] * cone_multiplier[0])));
        Lane both_r = 1.0 / (rs * rz), by_s = both_r * rz, by_z = both_r * rs;
        Lane inner = (cone_slack[0] * cone_multiplier[0] + cone_slack[1] * cone_multiplier[1] +
                      cone_slack[2] * cone_multiplier[2]) *
                     by_s * by_z;
        Lane twice = root(2.0 * (1.0 + inner)), by = 1.0 / twice;
        Lane w0 = (cone_slack[0] * by_s + cone_multiplier[0] * by_z) * by;
        Lane x1 = (cone_slack[1] * by_s - cone_multiplier[1] * by_z) * by,
             x2 = (cone_slack[2] * by_s - cone_multiplier[2] * by_z) * by;
        Lane size = root(x1 * x1 + x2 * x2);
        Mask flat = size > 1e-12;
        Lane away = 1.0 / select(flat, size, splat(1.0));
        axis_x = select(flat, x1 * away, splat(1.0)), axis_y = select(flat, x2 * away, splat(0.0));
        Lane rho = w0 + size, eta2 = rs * by_z, eta = root(eta2), ieta = 1.0 / eta;
        scale_m = rho * ieta;  // factor of m
        scale_p = ieta / rho;  // factor of p
        scale_q = ieta;        // factor of q
        Lane along = axis_x * cone_slack[1] + axis_y * cone_slack[2],
             across = axis_x * cone_slack[2] - axis_y * cone_slack[1];
        scaled[0] = (cone_slack[0] + along) * scale_p, scaled[1] = (cone_slack[0] - along) * scale_m,
        scaled[2] = across * scale_q;
        // The scaled point on the unit hyperboloid, relative to which steps are measured.
        by_root = root(both_r);
        unit[0] = 0.5 * (scaled[0] + scaled[1]) * by_root, unit[1] = 0.5 * (scaled[0] - scaled[1]) * by_root;
        unit[2] = scaled[2] * by_root;
        far = 1.0 / (unit[0] + 1.0);
        Lane wp = 0.5 * scale_p * scale_p, wm = 0.5 * scale_m * scale_m, wq = scale_q * scale_q;
        along_pivot = 1.0 / (wp + wm + delta);
        along_follows_bound = (wm - wp) * along_pivot;
        upper = (2.0 * wm + delta) * along_pivot, lower = (2.0 * wp + delta) * along_pivot;
        Lane cone = (4.0 * wp * wm + delta * (wp + wm)) * along_pivot + delta;
        across_pivot = 1.0 / (wq + delta);
        bound_pivot = 1.0 / (cone + square * torsion);
        bound_follows = row_other * row_normal * torsion * bound_pivot;
        pressure_follows = -row_normal * cone * bound_pivot;
        normal_pivot = 1.0 / (row_normal * row_normal * torsion * cone * bound_pivot + bent + delta);
    }

    // Compute the columns of N, t and both directions of V in the axes of the face, and their weights in H^-1.
    void pivots(Lane (*columns)[6], Lane* weight) const {
        Lane m[2];
        bending.follow(m);
        Lane none = splat(0.0), x = axis_x * keep, y = axis_y * keep, along = along_follows_bound * bound_follows,
             twist = -torsion_follows * keep;
        const Lane normal[6] = {splat(1.0), x * along, y * along, m[0], m[1], twist * pressure_follows};
        const Lane bound[6] = {none, x * along_follows_bound, y * along_follows_bound, none, none, twist * row_other};
        const Lane one[6] = {none, x, y, none, none, none}, other[6] = {none, -y, x, none, none, none};
        JLD_UNROLL
        for (int j = 0; j < 6; ++j)
            columns[0][j] = normal[j], columns[1][j] = bound[j], columns[2][j] = one[j], columns[3][j] = other[j];
        weight[0] = normal_pivot, weight[1] = bound_pivot, weight[2] = along_pivot, weight[3] = across_pivot;
        bending.further(columns, weight);
    }

    // Compute the inverse pivots of M1, M2 and MT.
    void couples(Lane* out) const { bending.couples(out), out[2] = torsion_pivot * keep; }

    // Compute x = H^-1 y in the axes of the face, t, rows = G x and the cone (p, m, q). y: N, V along e, V across, M1,
    // M2, MT, t.
    void solve(const Lane* y, Lane* x, Lane& bound, Lane* rows, Lane* cone) const {
        Lane rest = y[6] - row_other * torsion_follows * y[5] + along_follows_bound * y[1];
        Lane n =
            normal_pivot * (y[0] + row_normal * torsion_follows * y[5] + bound_follows * rest + bending.lean(y + 3));
        bound = rest * bound_pivot + bound_follows * n;
        Lane own = y[1] * along_pivot, along = own + along_follows_bound * bound, across = y[2] * across_pivot;
        Lane pressed = pressure_follows * n + row_other * bound_pivot * rest, twist = y[5] * torsion_pivot;
        x[0] = n, x[1] = axis_x * along - axis_y * across, x[2] = axis_y * along + axis_x * across;
        bending.solve(n, y + 3, x + 3, rows);
        x[5] = twist - torsion_follows * pressed;
        rows[BENDING_ROWS] = pressed * first + row_other * twist,
        rows[BENDING_ROWS + 1] = pressed * last - row_other * twist;
        cone[0] = bound * upper + own, cone[1] = bound * lower - own, cone[2] = across;
    }

    // Convert jumps from the axes of the face to those of y.
    void turn(const Lane* jump, Lane* y) const {
        y[0] = jump[0], y[1] = axis_x * jump[1] + axis_y * jump[2], y[2] = axis_x * jump[2] - axis_y * jump[1];
        y[3] = jump[3], y[4] = jump[4], y[5] = jump[5];
    }

    void begin(Iteration& o, Lane* jump, Lane* x) {
        condense(o.proximal);
        Lane late[ROWS], off[7], lag[7];
        JLD_UNROLL
        for (int r = 0; r < ROWS; ++r) {
            o.gap += row_slack[r] * row_multiplier[r];
            late[r] = row_multiplier[r] * inverse_slack[r] * short_of(o, r);
        }
        o.gap += cone_slack[0] * cone_multiplier[0] + cone_slack[1] * cone_multiplier[1] +
                 cone_slack[2] * cone_multiplier[2];
        jump[0] -= o.press;
        turned(row_multiplier, off), turned(late, lag);
        JLD_UNROLL
        for (int j = 0; j < 6; ++j) off[j] += jump[j];
        off[1] -= cone_multiplier[1], off[2] -= cone_multiplier[2], off[6] -= cone_multiplier[0];
        JLD_UNROLL
        for (int j = 0; j < 7; ++j) o.worst = larger(o.worst, absolute(off[j]));
        turn(jump, right_side);
        right_side[6] = splat(0.0);
        JLD_UNROLL
        for (int j = 0; j < 7; ++j) right_side[j] = -right_side[j] - lag[j];
        Lane bound, rows[ROWS], cone[3];
        solve(right_side, x, bound, rows, cone);
    }

    // out = G't, of resultants and of t.
    void turned(const Lane* t_, Lane* out) const {
        JLD_UNROLL
        for (int j = 0; j < 7; ++j) out[j] = splat(0.0);
        bending.turned(t_, out);
        out[0] -= row_normal * (t_[BENDING_ROWS] + t_[BENDING_ROWS + 1]),
            out[5] += row_other * (t_[BENDING_ROWS] - t_[BENDING_ROWS + 1]),
            out[6] = row_other * (t_[BENDING_ROWS] + t_[BENDING_ROWS + 1]);
    }

    // Return the reciprocal of the longest step in the cone. d: step in scaled coordinates.
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
        JLD_UNROLL
        for (int j = 0; j < 6; ++j) y[j] = right_side[j] - y[j];
        y[6] = right_side[6];
        solve(y, x, bound, rows, cone);
        JLD_UNROLL
        for (int r = 0; r < ROWS; ++r) {
            Lane step = -short_of(o, r) - rows[r], by = step * inverse_slack[r];
            Lane push = -row_multiplier[r] - row_multiplier[r] * by;
            o.primal_blocking = larger(o.primal_blocking, -by), o.dual_blocking = larger(o.dual_blocking, 1.0 + by);
            o.multiplier_slack_step += row_multiplier[r] * step, o.step_product += step * push;
            second_order[r] = by * push;
        }
        Lane there[3] = {cone[0] * scale_p, cone[1] * scale_m, cone[2] * scale_q}, back[3];
        JLD_UNROLL
        for (int j = 0; j < 3; ++j) back[j] = -scaled[j] - there[j];
        o.primal_blocking = larger(o.primal_blocking, reach(there)),
        o.dual_blocking = larger(o.dual_blocking, reach(back));
        Lane product = dot(there, back);
        o.multiplier_slack_step += dot(scaled, there), o.step_product += product;
        Lane x0 = 0.5 * (there[0] + there[1]), y0 = 0.5 * (back[0] + back[1]);
        cone_second_order[0] = product;
        cone_second_order[1] = 0.5 * (x0 * (back[0] - back[1]) + y0 * (there[0] - there[1]));
        cone_second_order[2] = x0 * back[2] + y0 * there[2];
    }

    void correct(const Iteration& o, Lane* x) {
        Lane add[7], t_[ROWS];
        JLD_UNROLL
        for (int r = 0; r < ROWS; ++r) t_[r] = second_order[r] - o.centre * inverse_slack[r];
        turned(t_, add);
        // Divide the terms of centring and second order by the scaled point (Jordan product).
        Lane r0 = o.centre - cone_second_order[0], re = -cone_second_order[1], rq = -cone_second_order[2];
        const Lane l0 = unit[0], le = unit[1], lq = unit[2];
        Lane u0 = (l0 * r0 - le * re - lq * rq) * by_root, by = 1.0 / l0;
        Lane ue = (re * by_root - u0 * le) * by, uq = (rq * by_root - u0 * lq) * by;
        cone_target[0] = u0 + ue, cone_target[1] = u0 - ue, cone_target[2] = uq;
        Lane p = cone_target[0] * scale_p, m_ = cone_target[1] * scale_m;
        add[6] += 0.5 * (p + m_), add[1] = 0.5 * (p - m_), add[2] = uq * scale_q;
        JLD_UNROLL
        for (int j = 0; j < 7; ++j) right_side[j] += add[j];
        Lane bound, rows[ROWS], cone[3];
        solve(add, x, bound, rows, cone);
    }

    void move(const Lane* jump, Lane* x) const {
        Lane y[7], bound, rows[ROWS], cone[3];
        turn(jump, y);
        JLD_UNROLL
        for (int j = 0; j < 6; ++j) y[j] = right_side[j] - y[j];
        y[6] = right_side[6];
        solve(y, x, bound, rows, cone);
    }

    void direct(Iteration& o, const Lane* jump) {
        Lane y[7], rows[ROWS], cone[3];
        turn(jump, y);
        JLD_UNROLL
        for (int j = 0; j < 6; ++j) y[j] = right_side[j] - y[j];
        y[6] = right_side[6];
        solve(y, force_step, shear_bound_step, rows, cone);
        JLD_UNROLL
        for (int r = 0; r < ROWS; ++r) {
            Lane step = -short_of(o, r) - rows[r], by = step * inverse_slack[r];
            Lane push = o.centre * inverse_slack[r] - second_order[r] - row_multiplier[r] - row_multiplier[r] * by;
            slack_step[r] = step, multiplier_step[r] = push;
            o.primal_blocking = larger(o.primal_blocking, -by);
            Mask sooner = -push * o.blocking_denominator > o.blocking_numerator * row_multiplier[r];
            o.blocking_numerator = select(sooner, -push, o.blocking_numerator),
            o.blocking_denominator = select(sooner, row_multiplier[r], o.blocking_denominator);
        }
        Lane there[3] = {cone[0] * scale_p, cone[1] * scale_m, cone[2] * scale_q}, back[3];
        JLD_UNROLL
        for (int j = 0; j < 3; ++j) back[j] = cone_target[j] - scaled[j] - there[j];
        o.primal_blocking = larger(o.primal_blocking, reach(there)),
        o.dual_blocking = larger(o.dual_blocking, reach(back));
        unturn(cone[0], cone[1], cone[2], cone_slack_step);
        unturn(back[0] * scale_p, back[1] * scale_m, back[2] * scale_q, cone_multiplier_step);
    }

    void unturn(Lane p, Lane m_, Lane q, Lane* out) const {
        Lane along = 0.5 * (p - m_);
        out[0] = 0.5 * (p + m_), out[1] = axis_x * along - axis_y * q, out[2] = axis_y * along + axis_x * q;
    }

    void advance(Iteration& o) {
        JLD_UNROLL
        for (int j = 0; j < 6; ++j)
            force[j] += o.primal_step * force_step[j], o.moved = larger(o.moved, absolute(force_step[j]));
        shear_bound += o.primal_step * shear_bound_step;
        JLD_UNROLL
        for (int r = 0; r < ROWS; ++r) {
            row_slack[r] += o.primal_step * slack_step[r], row_multiplier[r] += o.dual_step * multiplier_step[r];
            o.next_gap += row_slack[r] * row_multiplier[r];
            o.value += (r < BENDING_ROWS ? bending.side(r) : row_bound) * row_multiplier[r];
            o.room = smaller(o.room, row_slack[r] + o.margin - (1.0 - o.primal_step) * short_of(o, r));
        }
        JLD_UNROLL
        for (int j = 0; j < 3; ++j) {
            cone_slack[j] += o.primal_step * cone_slack_step[j],
                cone_multiplier[j] += o.dual_step * cone_multiplier_step[j];
            o.next_gap += cone_slack[j] * cone_multiplier[j];
        }
    }

    Lane slack(const Lane* y) const {
        Lane shear = root(y[1] * y[1] + y[2] * y[2]) + absolute(y[5]);
        return smaller(row_bound + row_normal * y[0] - row_other * shear, bending.slack(y));
    }

    void dissipation(const Lane* jump, Lane& margin, Lane& work) const {
        Lane slip = larger(root(jump[1] * jump[1] + jump[2] * jump[2]), absolute(jump[5])) / row_other;
        margin = jump[0] - bending.need(jump) - row_normal * slip;
        Mask slides = row_normal > 0.0;
        Lane rate =
            smaller(bending.rate(), select(slides, row_bound / select(slides, row_normal, splat(1.0)), splat(1e300)));
        work = bending.cost(jump) + row_bound * slip + rate * margin;
    }
};

}  // namespace jld
