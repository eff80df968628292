// Planar faces: pairs of rows -a N +- b M <= h, (2.2) and (2.5), -a N +- b V <= h, (2.4) and (2.7), and a third pair of
// M for compressive strength, (2.9), under any label. Derivation: docs/guide/batch_solver.md.
#pragma once
#include "interaction.h"
#include "iteration.h"

namespace jld {

template <int PAIRS, bool PARABOLAS = false, bool COUPLES = false>
struct PlanarFace {
    static constexpr int FREEDOMS = 3, PAIR_COUNT = PAIRS, ROWS = 2 * PAIRS + MomentShearInteraction<COUPLES>::ROWS,
                         CONES = 0, SIDES = 7;
    static constexpr int NUMBERS = 3 * PAIRS, PARABOLA_NUMBERS = 2 + MomentShearInteraction<COUPLES>::NUMBERS;
    static constexpr bool PARABOLIC = PARABOLAS, COUPLED = COUPLES;
    Lane row_normal[PAIRS], row_other[PAIRS], row_bound[PAIRS], keep;
    Lane force[3], row_slack[ROWS], row_multiplier[ROWS], lack[ROWS];
    // Of one iteration: 1 / slack, G H^-1 e_N by rows, inverse pivots, and elimination columns of V and M.
    Lane inverse_slack[ROWS], normal_effect[ROWS], normal_pivot, shear_follows, moment_follows, shear_pivot,
        moment_pivot, right_side[3], second_order[ROWS], force_step[3], slack_step[ROWS], multiplier_step[ROWS];

    // Of a first pair that is a parabola, (2.10): its numbers before a tangent replaces them, c, N0, residuals of its
    // rows.
    Lane parabola_normal, parabola_bound, curvature, knee, row_defect[ROWS];

    // Rows in which V and M interact; how M follows V there, and the effect of V on the rows.
    MomentShearInteraction<COUPLES> interaction;
    Lane moment_follows_shear, shear_effect[ROWS];

    static constexpr bool bends(int pair) { return pair != 1; }
    // Return true for resultants that a face drops after (2.8).
    static constexpr bool drops(int resultant) { return resultant == 1; }

    // Compute slope and height of the tangent of the parabola at a normal force.
    void tangent(Lane n, Lane& slope, Lane& height) const {
        Lane at = larger(n, knee);
        slope = parabola_normal - 2.0 * curvature * at, height = parabola_bound + curvature * at * at;
    }

    // Return -G of N, V or M in a row.
    Lane normal(int r, int of) const {
        if constexpr (COUPLED)
            if (r >= 2 * PAIRS) return interaction.row(r - 2 * PAIRS, of);
        if (of == 0) return row_normal[r / 2];
        return bends(r / 2) == (of == 2) ? (r % 2 ? row_other[r / 2] : -row_other[r / 2]) : splat(0.0);
    }

    Lane height(int r) const {
        if constexpr (COUPLED)
            if (r >= 2 * PAIRS) return interaction.plane_bound;
        return row_bound[r / 2];
    }

    void touch() {
        tangent(force[0], row_normal[0], row_bound[0]);
        for (int r = 0; r < 2; ++r)
            row_defect[r] = row_slack[r] -
                            (row_bound[0] + row_normal[0] * force[0] - (r ? -row_other[0] : row_other[0]) * force[2]);
        if constexpr (COUPLED) {
            interaction.touch(force);
            for (int r = 2 * PAIRS; r < ROWS; ++r)
                row_defect[r] = row_slack[r] - (height(r) + normal(r, 0) * force[0] + normal(r, 1) * force[1] +
                                                normal(r, 2) * force[2]);
        }
    }

    void bend(int lane, const double* numbers, double space, double push) {
        lanes_of(parabola_normal)[lane] = lanes_of(row_normal[0])[lane],
        lanes_of(parabola_bound)[lane] = lanes_of(row_bound[0])[lane];
        lanes_of(curvature)[lane] = numbers[0], lanes_of(knee)[lane] = numbers[1];
        double n = lanes_of(force[0])[lane], at = n > numbers[1] ? n : numbers[1];
        double lower = numbers[0] * (at * at - 2.0 * at * n);
        for (int r = 0; r < 2; ++r) {
            double own = lanes_of(row_slack[r])[lane] - lanes_of(lack[r])[lane] + lower,
                   slack = own > space ? own : space;
            lanes_of(row_slack[r])[lane] = slack, lanes_of(lack[r])[lane] = slack - own;
        }
        if constexpr (COUPLED) {
            interaction.put(lane, numbers + 2);
            interaction.touch(force);
            for (int r = 2 * PAIRS; r < ROWS; ++r) {
                Lane room = height(r) + normal(r, 0) * force[0] + normal(r, 1) * force[1] + normal(r, 2) * force[2];
                double own = lanes_of(room)[lane], slack = own > space ? own : space;
                lanes_of(row_slack[r])[lane] = slack, lanes_of(lack[r])[lane] = slack - own;
                lanes_of(row_multiplier[r])[lane] = push;
            }
        }
    }

    // Compute 1 / slack of two pairs with one division; divisions take most of the time here.
    void invert() {
        Lane bend = row_slack[0] * row_slack[1], slide = row_slack[2] * row_slack[3], both = 1.0 / (bend * slide);
        Lane first = both * slide, last = both * bend;
        inverse_slack[0] = first * row_slack[1], inverse_slack[1] = first * row_slack[0],
        inverse_slack[2] = last * row_slack[3], inverse_slack[3] = last * row_slack[2];
        if constexpr (PAIRS == 3) {
            Lane by = 1.0 / (row_slack[4] * row_slack[5]);
            inverse_slack[4] = by * row_slack[5], inverse_slack[5] = by * row_slack[4];
        }
        if constexpr (COUPLED)
            for (int r = 2 * PAIRS; r < ROWS; r += 2) {
                Lane by = 1.0 / (row_slack[r] * row_slack[r + 1]);
                inverse_slack[r] = by * row_slack[r + 1], inverse_slack[r + 1] = by * row_slack[r];
            }
    }

    // Eliminate with interaction: first M, then V. The rest of N is a least sum of squares over V and M, so all its
    // terms are positive and an error in the last digit of what follows N does no harm.
    void couple(const Lane* w, Lane delta) {
        const Lane none = splat(0.0), *meet = w + 2 * PAIRS, *push = row_multiplier + 2 * PAIRS;
        const Lane same = meet[0] + meet[1], other = meet[2] + meet[3];
        const Lane bb = interaction.plane_shear * interaction.plane_shear,
                   cc = interaction.plane_moment * interaction.plane_moment,
                   pushed = push[0] + push[1] + push[2] + push[3];
        const Lane curve = 2.0 * interaction.curve * pushed, along_n = interaction.along_n,
                   along_v = interaction.along_v;
        Lane bending = none, sliding = row_other[1] * row_other[1] * (w[2] + w[3]) + curve * along_v * along_v;
        for (int p = 0; p < PAIRS; ++p)
            if (bends(p)) bending += row_other[p] * row_other[p] * (w[2 * p] + w[2 * p + 1]);
        Lane both = same + other, pm = delta + bending + cc * both, pv = delta + sliding + bb * both;
        Lane det = bending * sliding + (bending * bb + sliding * cc) * both + 4.0 * bb * cc * same * other;
        det += delta * (pm + pv - delta);
        moment_pivot = 1.0 / pm, shear_pivot = pm / det,
        moment_follows_shear = -(interaction.plane_shear * interaction.plane_moment * (same - other)) * moment_pivot;
        Lane with_m = none, with_v = curve * along_n * along_v;
        for (int r = 0; r < ROWS; ++r)
            with_v += w[r] * normal(r, 0) * normal(r, 1), with_m += w[r] * normal(r, 0) * normal(r, 2);
        shear_follows = -shear_pivot * (with_v + moment_follows_shear * with_m),
        moment_follows = moment_follows_shear * shear_follows - moment_pivot * with_m;
        Lane left = delta * (1.0 + moment_follows * moment_follows + shear_follows * shear_follows) +
                    select(force[0] >= knee, 2.0 * curvature * (row_multiplier[0] + row_multiplier[1]), none);
        left += curve * (along_n + along_v * shear_follows) * (along_n + along_v * shear_follows);
        for (int r = 0; r < ROWS; ++r) {
            normal_effect[r] = -(normal(r, 0) + normal(r, 1) * shear_follows + normal(r, 2) * moment_follows);
            shear_effect[r] = -(normal(r, 1) + normal(r, 2) * moment_follows_shear);
            left += w[r] * normal_effect[r] * normal_effect[r];
        }
        normal_pivot = 1.0 / left;
    }

    // Eliminate H = G'WG + delta of (8.5) in the order M, V, N; every pivot is a sum of positive terms.
    void condense(Lane delta) {
        Lane w[ROWS];
        invert();
        for (int r = 0; r < ROWS; ++r) w[r] = row_multiplier[r] * inverse_slack[r];
        if constexpr (COUPLED) return couple(w, delta);
        Lane pm = delta, pv = delta, cm = splat(0.0), plus[PAIRS];
        for (int p = 0; p < PAIRS; ++p) {
            plus[p] = w[2 * p] + w[2 * p + 1];
            Lane minus = row_normal[p] * row_other[p] * (w[2 * p] - w[2 * p + 1]);
            if (bends(p)) pm += row_other[p] * row_other[p] * plus[p], cm += minus;
        }
        pv += row_other[1] * row_other[1] * plus[1];
        Lane both = 1.0 / (pm * pv);
        moment_pivot = both * pv, shear_pivot = both * pm;
        moment_follows = cm * moment_pivot;
        shear_follows = row_normal[1] * row_other[1] * (w[2] - w[3]) * shear_pivot;
        // Products of two weights with the squared determinant of their rows.
        Lane bend = 4.0 * (row_normal[0] * row_normal[0]) * (row_other[0] * row_other[0]) * w[0] * w[1] +
                    delta * (row_normal[0] * row_normal[0]) * plus[0];
        Lane lean = splat(0.0), tilt = splat(0.0);
        if constexpr (PAIRS == 3) {
            bend += 4.0 * (row_normal[2] * row_normal[2]) * (row_other[2] * row_other[2]) * w[4] * w[5] +
                    delta * (row_normal[2] * row_normal[2]) * plus[2];
            lean = row_normal[0] * row_other[2] - row_normal[2] * row_other[0],
            tilt = row_normal[0] * row_other[2] + row_normal[2] * row_other[0];
            bend += lean * lean * (w[0] * w[4] + w[1] * w[5]) + tilt * tilt * (w[0] * w[5] + w[1] * w[4]);
        }
        Lane slide =
            row_normal[1] * row_normal[1] * (4.0 * (row_other[1] * row_other[1]) * w[2] * w[3] + delta * plus[1]);
        if constexpr (PARABOLAS)
            bend = bend * moment_pivot +
                   select(force[0] >= knee, 2.0 * curvature * (row_multiplier[0] + row_multiplier[1]), splat(0.0));
        else bend *= moment_pivot;
        normal_pivot = 1.0 / (bend + slide * shear_pivot + delta);
        // Effect of a unit of N on each row when M and V follow it.
        for (int p = 0; p < PAIRS; ++p) {
            Lane by = bends(p) ? moment_pivot : shear_pivot;
            Lane two = 2.0 * row_other[p] * row_other[p];
            normal_effect[2 * p] = -row_normal[p] * (two * w[2 * p + 1] + delta) * by;
            normal_effect[2 * p + 1] = -row_normal[p] * (two * w[2 * p] + delta) * by;
        }
        if constexpr (PAIRS == 3) {
            normal_effect[0] += row_other[2] * (-lean * w[4] - tilt * w[5]) * moment_pivot;
            normal_effect[1] += row_other[2] * (-tilt * w[4] - lean * w[5]) * moment_pivot;
            normal_effect[4] += row_other[0] * (lean * w[0] - tilt * w[1]) * moment_pivot;
            normal_effect[5] += row_other[0] * (-tilt * w[0] + lean * w[1]) * moment_pivot;
        }
    }

    // x = H^-1 y
    void apply(const Lane* y, Lane* x) const {
        if constexpr (COUPLED) return follow(y, x, nullptr);
        Lane n = normal_pivot * (y[0] + shear_follows * y[1] + moment_follows * y[2]);
        x[0] = n, x[1] = shear_follows * n + shear_pivot * y[1], x[2] = moment_follows * n + moment_pivot * y[2];
    }

    // x = H^-1 y, and rows = G x without cancellation.
    void apply(const Lane* y, Lane* x, Lane* rows) const {
        if constexpr (COUPLED) return follow(y, x, rows);
        Lane n = normal_pivot * (y[0] + shear_follows * y[1] + moment_follows * y[2]), slip = shear_pivot * y[1],
             turn = moment_pivot * y[2];
        x[0] = n, x[1] = shear_follows * n + slip, x[2] = moment_follows * n + turn;
        for (int p = 0; p < PAIRS; ++p) {
            Lane part = row_other[p] * (bends(p) ? turn : slip);
            rows[2 * p] = normal_effect[2 * p] * n + part;
            rows[2 * p + 1] = normal_effect[2 * p + 1] * n - part;
        }
    }

    void follow(const Lane* y, Lane* x, Lane* rows) const {
        Lane n = normal_pivot * (y[0] + shear_follows * y[1] + moment_follows * y[2]),
             slip = shear_pivot * (y[1] + moment_follows_shear * y[2]), turn = moment_pivot * y[2];
        x[0] = n, x[1] = shear_follows * n + slip, x[2] = moment_follows * n + turn + moment_follows_shear * slip;
        if (rows)
            for (int r = 0; r < ROWS; ++r)
                rows[r] = normal_effect[r] * n + shear_effect[r] * slip - normal(r, 2) * turn;
    }

    // out = G't
    void turned(const Lane* t, Lane* out) const {
        Lane n = splat(0.0), q = splat(0.0), x = splat(0.0);
        for (int p = 0; p < PAIRS; ++p) {
            n -= row_normal[p] * (t[2 * p] + t[2 * p + 1]);
            Lane d = row_other[p] * (t[2 * p] - t[2 * p + 1]);
            if (bends(p)) x += d;
            else q += d;
        }
        if constexpr (COUPLED)
            for (int r = 2 * PAIRS; r < ROWS; ++r)
                n -= normal(r, 0) * t[r], q -= normal(r, 1) * t[r], x -= normal(r, 2) * t[r];
        out[0] = n, out[1] = q, out[2] = x;
    }

    // Put a labelling into a lane: rows (a, b, h) of its pairs, and the starting point.
    void put(int lane, const double* row, double kept, const double* forces, const double* jumps, double space,
             double push) {
        for (int k = 0; k < PAIRS; ++k, row += 3) {
            lanes_of(row_normal[k])[lane] = row[0], lanes_of(row_other[k])[lane] = row[1],
            lanes_of(row_bound[k])[lane] = row[2];
            double x = bends(k) ? forces[2] : kept * forces[1], n = forces[0];
            double turn = row[1] > 0.0 ? -jumps[bends(k) ? 2 : 1] / row[1] : 0.0;
            for (int r = 0; r < 2; ++r) {
                double sign = r ? -1.0 : 1.0, own = row[2] + row[0] * n - sign * row[1] * x;
                double slack = own > space ? own : space;
                lanes_of(row_slack[2 * k + r])[lane] = slack;
                lanes_of(lack[2 * k + r])[lane] = slack - own;
                lanes_of(row_multiplier[2 * k + r])[lane] = push + (sign * turn > 0.0 ? sign * turn : 0.0);
            }
        }
        lanes_of(keep)[lane] = kept;
        lanes_of(force[0])[lane] = forces[0], lanes_of(force[1])[lane] = kept * forces[1],
        lanes_of(force[2])[lane] = forces[2];
    }

    // Store forces and multipliers of a lane.
    void save(int lane, double* to) const {
        for (int k = 0; k < 3; ++k) to[k] = lanes_of(force[k])[lane];
        for (int r = 0; r < ROWS; ++r) to[3 + r] = lanes_of(row_multiplier[r])[lane];
    }

    // Put a stored state into a lane under another label. product: least product of a slack and its multiplier.
    void resume(int lane, const double* row, double kept, const double* from, double space, double product) {
        const double forces[3] = {from[0], kept * from[1], from[2]};
        for (int k = 0; k < 3; ++k) lanes_of(force[k])[lane] = forces[k];
        for (int k = 0; k < PAIRS; ++k, row += 3) {
            lanes_of(row_normal[k])[lane] = row[0], lanes_of(row_other[k])[lane] = row[1],
            lanes_of(row_bound[k])[lane] = row[2];
            const double middle = row[2] + row[0] * forces[0], side = row[1] * forces[bends(k) ? 2 : 1];
            for (int r = 0; r < 2; ++r) {
                const double own = r ? middle + side : middle - side, slack = own > space ? own : space;
                const double push = from[3 + 2 * k + r], least = product / slack;
                lanes_of(row_slack[2 * k + r])[lane] = slack, lanes_of(lack[2 * k + r])[lane] = slack - own;
                lanes_of(row_multiplier[2 * k + r])[lane] = push > least ? push : least;
            }
        }
        lanes_of(keep)[lane] = kept;
    }

    // Turn the numbers of rows into those of their recession cone, (3.12); return true if shear is bounded, so that
    // rays have none.
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
        for (int k = 0; k < PAIRS; ++k)
            move(row_normal[k], from.row_normal[k]), move(row_other[k], from.row_other[k]),
                move(row_bound[k], from.row_bound[k]);
        for (int k = 0; k < ROWS; ++k)
            move(row_slack[k], from.row_slack[k]), move(row_multiplier[k], from.row_multiplier[k]);
        for (int k = 0; k < 3; ++k) move(force[k], from.force[k]);
        move(keep, from.keep);
        if constexpr (PARABOLAS)
            move(parabola_normal, from.parabola_normal), move(parabola_bound, from.parabola_bound),
                move(curvature, from.curvature), move(knee, from.knee);
        if constexpr (COUPLED) interaction.copy(from.interaction, source, lane);
    }

    // Return the residual of h - G F = slack; that of the starting point decreases with every step.
    Lane short_of(const Iteration& it, int row) const {
        Lane rest = it.residual_share * (lack[row] + it.margin);
        if constexpr (PARABOLAS)
            if (row < 2 || row >= 2 * PAIRS) return select(curvature > 0.0, row_defect[row] + it.margin, rest);
        return rest;
    }

    // Condense H, and compute x = H^-1 of the predictor's right-hand side. jump: A'u.
    void begin(Iteration& it, Lane* jump, Lane* x) {
        if constexpr (PARABOLAS) touch();
        condense(it.proximal);
        Lane pull[3], t[ROWS], late[3];
        turned(row_multiplier, pull);
        for (int r = 0; r < ROWS; ++r) {
            it.gap += row_slack[r] * row_multiplier[r];
            t[r] = row_multiplier[r] * inverse_slack[r] * short_of(it, r);
        }
        turned(t, late);
        jump[0] -= it.press;
        for (int k = 0; k < 3; ++k) {
            it.worst = larger(it.worst, absolute(jump[k] + pull[k]));
            // The terms with multipliers cancel against the residual of the jumps, because s dz + z ds = -s z.
            right_side[k] = -jump[k] - late[k];
        }
        apply(right_side, x);
    }

    void predict(Iteration& it, const Lane* jump) {
        Lane y[3], x[3], rows[ROWS];
        for (int k = 0; k < 3; ++k) y[k] = right_side[k] - jump[k];
        apply(y, x, rows);
        for (int r = 0; r < ROWS; ++r) {
            Lane step = -short_of(it, r) - rows[r], by = step * inverse_slack[r];
            Lane push = -row_multiplier[r] - row_multiplier[r] * by;
            it.primal_blocking = larger(it.primal_blocking, -by), it.dual_blocking = larger(it.dual_blocking, 1.0 + by);
            it.multiplier_slack_step += row_multiplier[r] * step, it.step_product += step * push;
            second_order[r] = by * push;
        }
    }

    // x = H^-1 of what centring and second order add to the right-hand side.
    void correct(const Iteration& it, Lane* x) {
        Lane t[ROWS], back[3];
        for (int r = 0; r < ROWS; ++r) t[r] = it.centre * inverse_slack[r] - second_order[r];
        turned(t, back);
        for (int k = 0; k < 3; ++k) right_side[k] -= back[k], back[k] = -back[k];
        apply(back, x);
    }

    void move(const Lane* jump, Lane* x) const {
        Lane y[3];
        for (int k = 0; k < 3; ++k) y[k] = right_side[k] - jump[k];
        apply(y, x);
    }

    // more: jump of a correction that is kept apart from the step, or null.
    void direct(Iteration& it, const Lane* jump, const Lane* more) {
        Lane y[3], rows[ROWS];
        for (int k = 0; k < 3; ++k) y[k] = right_side[k] - jump[k];
        apply(y, force_step, rows);
        if (more) {
            Lane x[3], further[ROWS];
            for (int k = 0; k < 3; ++k) y[k] = -more[k];
            apply(y, x, further);
            for (int k = 0; k < 3; ++k) force_step[k] += x[k];
            for (int r = 0; r < ROWS; ++r) rows[r] += further[r];
        }
        for (int r = 0; r < ROWS; ++r) {
            Lane step = -short_of(it, r) - rows[r], by = step * inverse_slack[r];
            Lane push = it.centre * inverse_slack[r] - second_order[r] - row_multiplier[r] - row_multiplier[r] * by;
            slack_step[r] = step, multiplier_step[r] = push;
            it.primal_blocking = larger(it.primal_blocking, -by);
            // Find the largest -dz / z as a fraction, by products instead of divisions.
            Mask sooner = -push * it.blocking_denominator > it.blocking_numerator * row_multiplier[r];
            it.blocking_numerator = select(sooner, -push, it.blocking_numerator),
            it.blocking_denominator = select(sooner, row_multiplier[r], it.blocking_denominator);
        }
    }

    // Take no step in some lanes.
    void halt(const Mask& lanes) {
        const Lane none = splat(0.0);
        for (int k = 0; k < 3; ++k) force_step[k] = select(lanes, none, force_step[k]);
        for (int r = 0; r < ROWS; ++r)
            slack_step[r] = select(lanes, none, slack_step[r]),
            multiplier_step[r] = select(lanes, none, multiplier_step[r]);
    }

    void advance(Iteration& it) {
        // Error of the tangent, which the next tangent corrects.
        if constexpr (PARABOLAS)
            it.parabola_error = larger(it.parabola_error,
                                       curvature * (it.primal_step * force_step[0]) * (it.primal_step * force_step[0]));
        if constexpr (COUPLED) {
            Lane along = it.primal_step * (interaction.along_n * force_step[0] + interaction.along_v * force_step[1]);
            it.parabola_error = larger(it.parabola_error, interaction.curve * along * along);
        }
        for (int k = 0; k < 3; ++k)
            force[k] += it.primal_step * force_step[k], it.moved = larger(it.moved, absolute(force_step[k]));
        for (int r = 0; r < ROWS; ++r) {
            row_slack[r] += it.primal_step * slack_step[r], row_multiplier[r] += it.dual_step * multiplier_step[r];
            it.next_gap += row_slack[r] * row_multiplier[r];
            it.value += height(r) * row_multiplier[r];
            if constexpr (!PARABOLAS)
                it.room = smaller(it.room, row_slack[r] + it.margin - (1.0 - it.primal_step) * short_of(it, r));
        }
        if constexpr (PARABOLAS) it.room = smaller(it.room, slack(force));
    }

    // Return the least slack of forces in the rows.
    Lane slack(const Lane* y) const {
        Lane least = splat(1e300);
        for (int p = 0; p < PAIRS; ++p) {
            Lane slope = row_normal[p], height = row_bound[p];
            if constexpr (PARABOLAS)
                if (p == 0) tangent(y[0], slope, height);
            least = smaller(least, height + slope * y[0] - absolute(row_other[p] * y[bends(p) ? 2 : 1]));
        }
        if constexpr (COUPLED) least = smaller(least, interaction.slack(y));
        return least;
    }

    // Compute margin and dissipation (3.4) to (3.7) of a jump in closed form. margin: opening beyond that for which the
    // dissipation is finite; work: min h.t over t >= 0 with G't = -J, (3.2).
    void dissipation(const Lane* jump, Lane& margin, Lane& work) const {
        Lane turn = absolute(jump[2]) / row_other[0], slip = absolute(jump[1] * keep) / row_other[1];
        Lane rest = jump[0] - row_normal[0] * turn - row_normal[1] * slip;
        Lane dearest = splat(1e300);
        Lane bend = row_bound[0] / row_normal[0];
        Lane slide =
            select(row_normal[1] > 0.0, row_bound[1] / select(row_normal[1] > 0.0, row_normal[1], splat(1.0)), dearest);
        margin = rest;
        work = row_bound[0] * turn + row_bound[1] * slip + smaller(bend, slide) * rest;
        if constexpr (PAIRS == 3) {
            // The third pair takes part: P of the first, R of the third, a0 P - a2 R = opening, b0 P + b2 R >= |turn|.
            Mask crushes = row_other[2] > 0.0;
            Lane a2 = -select(crushes, row_normal[2], splat(-1.0)), b2 = select(crushes, row_other[2], splat(1.0));
            Lane open = jump[0] - row_normal[1] * slip, bent = absolute(jump[2]);
            Lane R = larger(splat(0.0), -open / a2);
            R = larger(R, (bent - row_other[0] * open / row_normal[0]) / (row_other[0] * a2 / row_normal[0] + b2));
            Lane crushed = row_bound[0] * (open + a2 * R) / row_normal[0] + row_bound[1] * slip + row_bound[2] * R;
            work = select(crushes, crushed, work);
            margin = select(crushes, dearest, margin);
        }
        if constexpr (PARABOLAS) {
            Mask bowed = curvature > 0.0;
            work = select(bowed, bowing(jump), work);
            if constexpr (COUPLED) work = select(interaction.limit > 0.0, interaction.dissipation(jump, keep), work);
            margin = select(bowed, dearest, margin);
        }
    }

    // Return the dissipation (3.7) of a parabola: sup of p N + |turn| b|M| / b with M at most the first pair and the
    // line of the third, plus the slip at N = 0.
    Lane bowing(const Lane* jump) const {
        Lane c = select(curvature > 0.0, curvature, splat(1.0)), turn = absolute(jump[2]),
             slip = absolute(jump[1] * keep) / row_other[1];
        Lane p = row_normal[1] * slip - jump[0], t = turn / row_other[0];
        Lane high = (parabola_normal + root(parabola_normal * parabola_normal + 4.0 * c * parabola_bound)) / (2.0 * c);
        Lane steep = parabola_normal - 2.0 * c * knee, start = parabola_bound + c * knee * knee, low = -start / steep,
             below = low;
        if constexpr (PAIRS == 3) {
            // The line meets the tangent at a corner.
            Mask lined = row_other[2] > 0.0;
            Lane by = select(lined, row_other[2], splat(1.0)), slope = row_normal[2] / by, height = row_bound[2] / by;
            Lane corner = (start / row_other[0] - height) / (slope - steep / row_other[0]);
            Lane foot = -height / select(lined, slope, splat(1.0));
            low = select(lined, foot, low);
            below = select(lined, select(p + turn * slope > 0.0, corner, foot), low);
        }
        Lane turns = select(t > 0.0, t, splat(1.0));
        Lane free = select(t > 0.0, (parabola_normal + p / turns) / (2.0 * c), select(p > 0.0, high, low));
        Lane n = select(free > knee, smaller(free, high), select(t > 0.0, below, free)), slope, height;
        tangent(n, slope, height);
        Lane most = larger(splat(0.0), (height + slope * n) / row_other[0]);
        if constexpr (PAIRS == 3)
            most = select(row_other[2] > 0.0,
                          smaller(most, larger(splat(0.0), (row_bound[2] + row_normal[2] * n) / row_other[2])), most);
        return row_bound[1] * slip + p * n + turn * most;
    }
};

}  // namespace jld
