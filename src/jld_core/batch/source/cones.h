// Cone programs of one sparsity, solved for many right-hand sides, costs and sets of rows: homogeneous self-dual
// embedding with Nesterov-Todd scaling. Domahidi, Chu & Boyd, ECC 2013; Goulart & Chen, arXiv:2405.12762.
//
// T is a vector of lanes, one program each, or a double for one program. Both round alike: fused products are written
// out as `fused`, and the compiler makes no others in this unit.
#pragma once

#include "interface.h"
#include "simd.h"
#include "store.h"

namespace jld {

inline double select(bool m, double a, double b) { return m ? a : b; }
inline double larger(double a, double b) { return b > a ? b : a; }
inline double smaller(double a, double b) { return b < a ? b : a; }
inline double absolute(double a) { return a < 0.0 ? -a : a; }
inline double root(double a) { return __builtin_sqrt(a); }

#if defined(__AVX512F__) && defined(__AVX512DQ__)
inline Lane fused(Lane a, Lane b, Lane c) { return (Lane)_mm512_fmadd_pd((__m512d)a, (__m512d)b, (__m512d)c); }
#elif defined(__AVX2__) && defined(__FMA__)
inline Lane fused(Lane a, Lane b, Lane c) { return (Lane)_mm256_fmadd_pd((__m256d)a, (__m256d)b, (__m256d)c); }
#elif defined(__aarch64__)
inline Lane fused(Lane a, Lane b, Lane c) {
    return (Lane)vfmaq_f64((float64x2_t)c, (float64x2_t)a, (float64x2_t)b);
}
#else
inline Lane fused(Lane a, Lane b, Lane c) { return a * b + c; }
#endif
#if defined(__FMA__) || defined(__aarch64__)
inline double fused(double a, double b, double c) { return __builtin_fma(a, b, c); }
#else
inline double fused(double a, double b, double c) { return a * b + c; }
#endif

template <class T>
struct Width;
template <>
struct Width<Lane> {
    static constexpr int lanes = LANES;
    static Lane all(double x) { return splat(x); }
    static double get(const Lane& v, int lane) { return lanes_of(v)[lane]; }
    static void set(Lane& v, int lane, double x) { lanes_of(v)[lane] = x; }
};
template <>
struct Width<double> {
    static constexpr int lanes = 1;
    static double all(double x) { return x; }
    static double get(const double& v, int) { return v; }
    static void set(double& v, int, double x) { v = x; }
};

// A cone of three rows at the point of Nesterov and Todd: W = scale (2 w w' - J)^(1/2), point = W z = W^-1 s.
template <class T>
struct Cone3 {
    T w0, w1, w2, scale, inverse, determinant, point[3];
    // W^2 has eigenvalues along (1, d), (1, -d) and across; these are the inverses, regularised.
    T d1, d2, plus, minus, across;

    // Regularised weights (W^2 + bound)^-1 and their upper triangle row by row.
    void weigh(double bound, T* g) {
        const T size = root(fused(w1, w1, w2 * w2)), by = 1.0 / larger(size, 1e-300 + 0.0 * size);
        const auto round = size < 1e-300;
        d1 = select(round, 1.0 + 0.0 * size, w1 * by);
        d2 = select(round, 0.0 * size, w2 * by);
        const T far = scale * (w0 + size), near = scale / (w0 + size);
        plus = 1.0 / fused(far, far, bound + 0.0 * far);
        minus = 1.0 / fused(near, near, bound + 0.0 * near);
        across = 1.0 / fused(scale, scale, bound + 0.0 * scale);
        const T half = 0.5 * (plus + minus), skew = 0.5 * (plus - minus), rest = half - across;
        g[0] = half;  // 00 01 02 11 12 22
        g[1] = skew * d1;
        g[2] = skew * d2;
        g[3] = fused(rest * d1, d1, across);
        g[4] = rest * d1 * d2;
        g[5] = fused(rest * d2, d2, across);
    }
};

template <class T>
class ConeSolver {
    using V = Width<T>;
    const JldCones& c;
    const int n, p, l, q, m, unknowns;
    Store<T> x, z, s, cost, rhs, on;
    Store<T> rx, rz, dx, dz, ds, du, dv, step_s, step_z, affine;
    Store<T> weight, masked, factor, pivot, work, one, two;
    Store<T> linear_w, linear_point;
    Store<Cone3<T>> cone;
    Store<T> constant_x, constant_z, step_x, second, minus_cost, correction_x, correction_z, missing_rows;
    T tau, kappa, rt, mu, refined, moving;
    bool refining = false;
    bool ended[V::lanes];
    int64_t number[V::lanes];

    T zero() const { return V::all(0.0); }

    // Return A x of one row.
    T row_product(int row, const T* v) const {
        T sum = zero();
        for (int64_t k = c.row_start[row]; k < c.row_start[row + 1]; ++k)
            sum = fused(V::all(c.value[k]), v[c.column[k]], sum);
        return sum * on[row];
    }
    // to += A' v
    void add_transposed(const T* v, T* to) const {
        for (int row = 0; row < m; ++row) {
            const T y = v[row] * on[row];
            for (int64_t k = c.row_start[row]; k < c.row_start[row + 1]; ++k)
                to[c.column[k]] = fused(V::all(c.value[k]), y, to[c.column[k]]);
        }
    }
    static T dot(const Store<T>& a, const Store<T>& b) {
        T sum = V::all(0.0);
        for (size_t k = 0; k < a.size(); ++k) sum = fused(a[k], b[k], sum);
        return sum;
    }
    static T norm(const Store<T>& a) {
        T most = V::all(0.0);
        for (size_t k = 0; k < a.size(); ++k) most = larger(most, absolute(a[k]));
        return most;
    }

    // out = W v or W^-1 v of a cone
    static void scaled(const Cone3<T>& k, const T* v, T* out) {
        const T inner = fused(k.w1, v[1], k.w2 * v[2]), share = v[0] + inner / (1.0 + k.w0);
        out[0] = k.scale * fused(k.w0, v[0], inner);
        out[1] = k.scale * fused(k.w1, share, v[1]);
        out[2] = k.scale * fused(k.w2, share, v[2]);
    }
    static void unscaled(const Cone3<T>& k, const T* v, T* out) {
        const T inner = fused(k.w1, v[1], k.w2 * v[2]), share = inner / (1.0 + k.w0) - v[0];
        out[0] = k.inverse * fused(k.w0, v[0], -inner);
        out[1] = k.inverse * fused(k.w1, share, v[1]);
        out[2] = k.inverse * fused(k.w2, share, v[2]);
    }
    // (v0 - |v|) (v0 + |v|), at least a tiny number
    static T determinant(const T* v) {
        const T size = root(fused(v[1], v[1], v[2] * v[2]));
        return larger((v[0] - size) * (v[0] + size), V::all(1e-300));
    }

    // Scaling of all cones at s, z, and the weights W^-2 of the rows.
    void scale() {
        for (int k = 0; k < l; ++k) {
            const int row = p + k;
            linear_w[k] = root(s[row] / z[row]);
            linear_point[k] = root(s[row] * z[row]);
            weight[k] = 1.0 / (s[row] / z[row] + c.bound);
        }
        for (int k = 0; k < q; ++k) {
            const int row = p + l + 3 * k;
            Cone3<T>& own = cone[k];
            const T in_s = determinant(&s[row]), in_z = determinant(&z[row]);
            const T by_s = 1.0 / root(in_s), by_z = 1.0 / root(in_z);
            T a[3], b[3];
            for (int i = 0; i < 3; ++i) a[i] = s[row + i] * by_s, b[i] = z[row + i] * by_z;
            // 1 + a'b without cancellation: a = (cosh, sinh), b turned by nearly half a turn
            const T size_a = root(fused(a[1], a[1], a[2] * a[2])), size_b = root(fused(b[1], b[1], b[2] * b[2]));
            const T ratio = (a[0] + size_a) / (b[0] + size_b);
            const T cross = fused(a[1], b[2], -(a[2] * b[1])), along = fused(a[1], b[1], a[2] * b[2]);
            const T opposed = cross * cross / larger(fused(size_a, size_b, -along), V::all(1e-300));
            const T turned = select(along < 0.0, opposed, fused(size_a, size_b, along));
            const T middle = root(0.5 + 0.5 * (0.5 * (ratio + 1.0 / ratio) + turned)), half = 0.5 / middle;
            own.w1 = (a[1] - b[1]) * half;
            own.w2 = (a[2] - b[2]) * half;
            own.w0 = root(1.0 + fused(own.w1, own.w1, own.w2 * own.w2));
            own.scale = root(root(in_s / in_z));
            own.inverse = 1.0 / own.scale;
            own.determinant = root(in_s * in_z);
            const T length = root(own.determinant), over = length / (a[0] + b[0] + 2.0 * middle);
            own.point[0] = length * middle;
            for (int i = 1; i < 3; ++i)
                own.point[i] = over * fused(b[0] + middle, a[i], (a[0] + middle) * b[i]);
            own.weigh(c.bound, &weight[l + 6 * k]);
        }
    }
    void unit_weights() {
        for (int k = 0; k < l; ++k) weight[k] = V::all(1.0), linear_w[k] = V::all(1.0);
        for (int k = 0; k < q; ++k) {
            Cone3<T>& own = cone[k];
            own.w1 = own.w2 = zero();
            own.w0 = own.scale = own.inverse = V::all(1.0);
            own.weigh(0.0, &weight[l + 6 * k]);
        }
    }
    // Weights of the rows that are on, which the matrix is made of.
    void mask() {
        for (int k = 0; k < l; ++k) masked[k] = weight[k] * on[p + k];
        for (int k = 0; k < q; ++k)
            for (int i = 0; i < 6; ++i) masked[l + 6 * k + i] = weight[l + 6 * k + i] * on[p + l + 3 * k];
    }
    // out = (W^2 + bound)^-1 v of the rows of cones, by eigenvectors: entries of the inverse would lose the small ones.
    void weighted(const T* v, T* out) const {
        for (int k = 0; k < l; ++k) out[k] = weight[k] * v[k];
        for (int k = 0; k < q; ++k) {
            const Cone3<T>& own = cone[k];
            const T *a = v + l + 3 * k;
            T* to = out + l + 3 * k;
            const T along = fused(own.d1, a[1], own.d2 * a[2]);
            const T aside = own.across * fused(own.d1, a[2], -(own.d2 * a[1]));
            const T one_side = 0.5 * own.plus * (a[0] + along), other = 0.5 * own.minus * (a[0] - along);
            to[0] = one_side + other;
            const T forth = one_side - other;
            to[1] = fused(forth, own.d1, -(aside * own.d2));
            to[2] = fused(forth, own.d2, aside * own.d1);
        }
    }
    // out = W^2 v of the rows of cones
    void squared(const T* v, T* out) const {
        for (int k = 0; k < l; ++k) out[k] = linear_w[k] * linear_w[k] * v[k];
        for (int k = 0; k < q; ++k) {
            T half[3];
            scaled(cone[k], v + l + 3 * k, half);
            scaled(cone[k], half, out + l + 3 * k);
        }
    }

    // Entry of the matrix of the reduced system, docs/method.md (9.17)
    T entry(int64_t k) const {
        T sum = V::all(c.fixed[k]);
        for (int64_t i = c.term_start[k]; i < c.term_start[k + 1]; ++i)
            sum = fused(V::all(c.coefficient[i]), masked[c.term[i]], sum);
        return sum;
    }
    // L D L' of the reduced system, column by column.
    void factorise() {
        mask();
        for (int j = 0; j < unknowns; ++j) {
            const int64_t first = c.factor_start[j], last = c.factor_start[j + 1];
            const double sign = c.sign[j];
            T d = entry(j) + sign * c.regular;
            for (int64_t k = first; k < last; ++k) work[c.factor_row[k]] = entry(unknowns + k);
            for (int64_t r = c.left_start[j]; r < c.left_start[j + 1]; ++r) {
                const int column = c.left_column[r];
                const int64_t place = c.left_place[r], end = c.factor_start[column + 1];
                const T own = factor[place], share = -own * pivot[column];
                d = fused(share, own, d);
                for (int64_t k = place + 1; k < end; ++k) {
                    T& to = work[c.factor_row[k]];
                    to = fused(share, factor[k], to);
                }
            }
            d = select(sign * d > c.least_pivot, d, V::all(sign * c.new_pivot));
            pivot[j] = d;
            const T by = 1.0 / d;
            for (int64_t k = first; k < last; ++k) factor[k] = work[c.factor_row[k]] * by;
        }
    }
    // Solve for right-hand sides that stand in `one`, and in `two` if it is asked for.
    template <bool both>
    void substitute() {
        for (int j = 0; j < unknowns; ++j) {
            const T a = -one[j], b = both ? -two[j] : a;
            for (int64_t k = c.factor_start[j]; k < c.factor_start[j + 1]; ++k) {
                const int row = c.factor_row[k];
                one[row] = fused(factor[k], a, one[row]);
                if (both) two[row] = fused(factor[k], b, two[row]);
            }
        }
        for (int j = unknowns; j-- > 0;) {
            const T by = 1.0 / pivot[j];
            T a = one[j] * by, b = both ? two[j] * by : a;
            for (int64_t k = c.factor_start[j]; k < c.factor_start[j + 1]; ++k) {
                const int row = c.factor_row[k];
                a = fused(-factor[k], one[row], a);
                if (both) b = fused(-factor[k], two[row], b);
            }
            one[j] = a;
            if (both) two[j] = b;
        }
    }
    // Write the right-hand side (first, second) of [0 A'; A -W^2] as one of the reduced system.
    void load(const T* first, const T* second, Store<T>& to) {
        weighted(second + p, &dv[p]);
        for (int k = 0; k < p; ++k) dv[k] = zero();
        for (int k = 0; k < n; ++k) du[k] = first[k];
        add_transposed(dv.data(), du.data());
        for (int k = 0; k < n; ++k) to[c.place[k]] = du[k];
        for (int k = 0; k < p; ++k) to[c.place[n + k]] = second[k];
    }
    // Read u (n) and v (m) of the solution that stands in `from`.
    void read(const Store<T>& from, const T* second, Store<T>& u, Store<T>& v) {
        for (int k = 0; k < n; ++k) u[k] = from[c.place[k]];
        for (int k = 0; k < p; ++k) v[k] = from[c.place[n + k]];
        for (int row = p; row < m; ++row) dz[row] = row_product(row, u.data()) - second[row];
        weighted(&dz[p], &v[p]);
    }

    // Improve u, v by one step of refinement, where `refined` asks for it. W^2 is that without `bound` here.
    void refine(const T* first, const T* rows, Store<T>& u, Store<T>& v) {
        if (!refining) return;
        const auto wanted = refined > 0.0;
        squared(&v[p], &missing_rows[p]);
        for (int k = 0; k < p; ++k) missing_rows[k] = rows[k] - row_product(k, u.data());
        for (int k = p; k < m; ++k) missing_rows[k] += rows[k] - row_product(k, u.data());
        for (int k = 0; k < n; ++k) correction_x[k] = zero();
        add_transposed(v.data(), correction_x.data());
        for (int k = 0; k < n; ++k) correction_x[k] = first[k] - correction_x[k];
        load(correction_x.data(), missing_rows.data(), one);
        substitute<false>();
        read(one, missing_rows.data(), correction_x, correction_z);
        for (int k = 0; k < n; ++k) u[k] = select(wanted, u[k] + correction_x[k], u[k]);
        for (int k = 0; k < m; ++k) v[k] = select(wanted, v[k] + correction_z[k], v[k]);
    }

    // The longest step t <= most with v + t d in all cones.
    T longest(const Store<T>& v, const Store<T>& d, T most) const {
        T t = most;
        const T never = V::all(1e300);
        for (int row = p; row < p + l; ++row) t = smaller(t, select(d[row] < 0.0, -v[row] / d[row], never));
        for (int row = p + l; row < m; row += 3) {
            const T *a = &v[row], *b = &d[row];
            const T size = root(fused(b[1], b[1], b[2] * b[2]));
            const T square = (b[0] - size) * (b[0] + size), free = determinant(a);
            const T middle = fused(a[0], b[0], -fused(a[1], b[1], a[2] * b[2]));
            const T under = fused(middle, middle, -square * free);
            const T far = root(larger(under, zero()));
            // roots of square t^2 + 2 middle t + free, without cancellation
            const T sum = select(middle < 0.0, far - middle, -middle - far);
            const T r1 = sum / select(absolute(square) < 1e-300, V::all(1e-300), square);
            const T r2 = free / select(absolute(sum) < 1e-300, V::all(1e-300), sum);
            const T first = smaller(select(r1 > 0.0, r1, never), select(r2 > 0.0, r2, never));
            t = smaller(t, select(under < 0.0, never, first));
            t = smaller(t, select(b[0] < 0.0, -a[0] / b[0], never));
        }
        return t;
    }

    // Add a multiple of the identity of the cones so that v lies inside them.
    void inside(Store<T>& v) const {
        T lack = V::all(-1e300);
        for (int row = p; row < p + l; ++row) lack = larger(lack, -v[row]);
        for (int row = p + l; row < m; row += 3)
            lack = larger(lack, root(fused(v[row + 1], v[row + 1], v[row + 2] * v[row + 2])) - v[row]);
        const T add = select(lack < -1e-8, zero(), 1.0 + larger(lack, zero()));
        for (int row = p; row < p + l; ++row) v[row] += add;
        for (int row = p + l; row < m; row += 3) v[row] += add;
    }
    void start() {
        unit_weights();
        factorise();
        for (int k = 0; k < n; ++k) rx[k] = zero();
        for (int k = 0; k < m; ++k) rz[k] = zero();
        load(rx.data(), rhs.data(), one);
        load(minus_cost.data(), rz.data(), two);
        substitute<true>();
        read(one, rhs.data(), x, s);
        for (int row = 0; row < m; ++row) s[row] = row < p ? zero() : -s[row];
        read(two, rz.data(), dx, z);
        inside(s);
        inside(z);
        tau = kappa = V::all(1.0);
    }

    // d of the complementarity, out = W (point \ d) of the rows of cones.
    void relaxed(const Store<T>& d, Store<T>& out) const {
        for (int k = 0; k < l; ++k) out[p + k] = linear_w[k] * (d[p + k] / linear_point[k]);
        for (int k = 0; k < q; ++k) {
            const int row = p + l + 3 * k;
            const Cone3<T>& own = cone[k];
            const T* a = own.point;
            const T by = 1.0 / own.determinant;
            T ratio[3];
            ratio[0] = by * fused(a[0], d[row], -fused(a[1], d[row + 1], a[2] * d[row + 2]));
            const T over = 1.0 / a[0];
            for (int i = 1; i < 3; ++i) ratio[i] = over * fused(-a[i], ratio[0], d[row + i]);
            scaled(own, ratio, &out[row]);
        }
    }
    // Complementarity of the next step: -point o point, plus sigma mu e less the product of the affine steps.
    void complementarity(bool affine_step, T centre) {
        for (int k = 0; k < l; ++k) {
            const int row = p + k;
            ds[row] = -linear_point[k] * linear_point[k];
            if (!affine_step) ds[row] += centre - step_s[row] * step_z[row];
        }
        for (int k = 0; k < q; ++k) {
            const int row = p + l + 3 * k;
            const Cone3<T>& own = cone[k];
            const T* a = own.point;
            ds[row] = -fused(a[0], a[0], fused(a[1], a[1], a[2] * a[2]));
            for (int i = 1; i < 3; ++i) ds[row + i] = -2.0 * a[0] * a[i];
            if (affine_step) continue;
            T b[3], d[3];
            unscaled(own, &step_s[row], b);
            scaled(own, &step_z[row], d);
            ds[row] += centre - fused(b[0], d[0], fused(b[1], d[1], b[2] * d[2]));
            for (int i = 1; i < 3; ++i) ds[row + i] -= fused(b[0], d[i], b[i] * d[0]);
        }
    }

    struct Step {
        T tau, kappa, length;
    };
    // Write the right-hand side of a Newton step that keeps a share of the residuals away into dx and `second`.
    void right_hand_side(T keep) {
        relaxed(ds, affine);
        for (int k = 0; k < n; ++k) dx[k] = keep * rx[k];
        for (int k = 0; k < p; ++k) second[k] = keep * rz[k];
        for (int k = p; k < m; ++k) second[k] = keep * rz[k] - affine[k];
    }
    // Complete the step that stands in step_x, step_z by its multiple of the constant solution, and find its length.
    Step finish(T keep, T between, T denominator) {
        const T top = keep * rt - between / tau - dot(cost, step_x) - dot(rhs, step_z);
        Step step;
        step.tau = top / denominator;
        for (int k = 0; k < n; ++k) step_x[k] = fused(step.tau, constant_x[k], step_x[k]);
        for (int k = 0; k < m; ++k) step_z[k] = fused(step.tau, constant_z[k], step_z[k]);
        step.kappa = (between - kappa * step.tau) / tau;
        // the rows themselves give the step of s
        for (int row = 0; row < p; ++row) step_s[row] = zero();
        for (int row = p; row < m; ++row)
            step_s[row] = fused(rhs[row], step.tau, keep * rz[row]) - row_product(row, step_x.data());
        T t = V::all(1.0);
        t = smaller(t, select(step.tau < 0.0, -tau / step.tau, t));
        t = smaller(t, select(step.kappa < 0.0, -kappa / step.kappa, t));
        t = longest(s, step_s, t);
        step.length = longest(z, step_z, t);
        return step;
    }

    // Read costs and rows of the programs first, first + 1, ...; the last is repeated in spare lanes.
    void read_task(const JldConeTask& task, int64_t first) {
        for (int lane = 0; lane < V::lanes; ++lane) {
            const int64_t k = first + lane < task.count ? first + lane : task.count - 1;
            number[lane] = k, ended[lane] = false;
            for (int row = 0; row < m; ++row) {
                const bool off = task.off[k * m + row] != 0;
                V::set(on[row], lane, off ? 0.0 : 1.0);
                V::set(rhs[row], lane, off ? c.idle[row] : c.rhs[row]);
            }
            for (int column = 0; column < n; ++column) V::set(cost[column], lane, task.objective[k * n + column]);
        }
        for (int k = 0; k < n; ++k) minus_cost[k] = -cost[k];
    }
    void write(const JldConeTask& task, int lane, int32_t state, int iteration, double value) const {
        const int64_t k = number[lane];
        const bool ray = state == JLD_CONES_INFEASIBLE || state == JLD_CONES_UNBOUNDED;
        const double scale = 1.0 / V::get(ray ? kappa : tau, lane);
        for (int i = 0; i < n; ++i) task.x[k * n + i] = V::get(x[i], lane) * scale;
        for (int i = 0; i < m; ++i) task.z[k * m + i] = V::get(z[i], lane) * scale;
        task.value[k] = value;
        task.state[k] = state;
        task.used[k] = iteration;
    }
    // Compute residuals and complementarity, end programs that are done, and return whether any is left.
    bool judge(const JldConeTask& task, int64_t first, int iteration) {
        for (int k = 0; k < n; ++k) rx[k] = zero();
        add_transposed(z.data(), rx.data());
        const T norm_az = norm(rx), qx = dot(cost, x), bz = dot(rhs, z);
        for (int k = 0; k < n; ++k) rx[k] = -fused(cost[k], tau, rx[k]);
        T norm_axs = zero();
        for (int row = 0; row < m; ++row) {
            const T own = row_product(row, x.data()) + s[row];
            norm_axs = larger(norm_axs, absolute(own));
            rz[row] = fused(rhs[row], tau, -own);
        }
        rt = -(qx + bz + kappa);
        mu = fused(kappa, tau, dot(s, z)) / static_cast<double>(l + q + 1);
        const T one_lane = V::all(1.0), by = 1.0 / tau, primal = qx * by, dual = -bz * by;
        const T gap = absolute(primal - dual), least = smaller(absolute(primal), absolute(dual));
        const T relative = gap / larger(one_lane, least), size_x = norm(x) * by;
        const T res_p = norm(rz) * by / larger(one_lane, norm(rhs) + size_x + norm(s) * by);
        const T res_d = norm(rx) * by / larger(one_lane, norm(cost) + size_x + norm(z) * by);
        bool left = false;
        for (int lane = 0; lane < V::lanes; ++lane) {
            if (ended[lane]) continue;
            const auto get = [lane](const T& v) { return V::get(v, lane); };
            int32_t state = JLD_CONES_OPEN;
            const bool small = get(gap) <= task.gap || get(relative) <= task.gap, far = get(kappa) > get(tau);
            if (small && get(res_p) <= task.residual && get(res_d) <= task.residual) state = JLD_CONES_SOLVED;
            else if (far && get(bz) < 0.0 && get(norm_az) <= -task.ray * get(bz)) state = JLD_CONES_INFEASIBLE;
            else if (far && get(qx) < 0.0 && get(norm_axs) <= -task.ray * get(qx)) state = JLD_CONES_UNBOUNDED;
            // comparisons with what is no number are false
            const bool lost = !(get(mu) > 0.0 && get(tau) > 0.0 && get(moving) > task.least_step);
            if (state == JLD_CONES_OPEN && !lost && iteration < task.iterations) {
                left = true;
                continue;
            }
            ended[lane] = true;
            if (first + lane < task.count) write(task, lane, state, iteration, get(primal));
        }
        return left;
    }
    // One step of predictor and corrector.
    Step newton() {
        // linear systems are well conditioned until complementarity is small
        refined = select(mu < c.refined, V::all(1.0), V::all(0.0));
        refining = false;
        for (int lane = 0; lane < V::lanes; ++lane) refining |= !ended[lane] && V::get(refined, lane) > 0.0;
        scale();
        factorise();
        complementarity(true, zero());
        right_hand_side(V::all(1.0));
        load(dx.data(), second.data(), one);
        load(minus_cost.data(), rhs.data(), two);
        substitute<true>();
        read(two, rhs.data(), constant_x, constant_z);
        read(one, second.data(), step_x, step_z);
        refine(minus_cost.data(), rhs.data(), constant_x, constant_z);
        refine(dx.data(), second.data(), step_x, step_z);
        const T denominator = dot(cost, constant_x) + dot(rhs, constant_z) - kappa / tau;
        const Step predicted = finish(V::all(1.0), -kappa * tau, denominator);
        const T rest = 1.0 - predicted.length, sigma = rest * rest * rest, keep = 1.0 - sigma;
        const T between = fused(sigma, mu, -fused(kappa, tau, predicted.kappa * predicted.tau));
        complementarity(false, sigma * mu);
        right_hand_side(keep);
        load(dx.data(), second.data(), one);
        substitute<false>();
        read(one, second.data(), step_x, step_z);
        refine(dx.data(), second.data(), step_x, step_z);
        return finish(keep, between, denominator);
    }

  public:
    explicit ConeSolver(const JldCones& cones)
        : c(cones), n(c.columns), p(c.equations), l(c.linear), q(c.cones), m(p + l + 3 * q), unknowns(n + p), x(n),
          z(m), s(m), cost(n), rhs(m), on(m), rx(n), rz(m), dx(n), dz(m), ds(m), du(n), dv(m), step_s(m), step_z(m),
          affine(m), weight(l + 6 * q), masked(l + 6 * q), factor(c.factor_start[unknowns]), pivot(unknowns),
          work(unknowns), one(unknowns), two(unknowns), linear_w(l), linear_point(l), cone(q), constant_x(n),
          constant_z(m), step_x(n), second(m), minus_cost(n), correction_x(n), correction_z(m), missing_rows(m) {}

    // Solve the programs numbered first, first + 1, ... of a task, one per lane.
    void run(const JldConeTask& task, int64_t first) {
        read_task(task, first);
        start();
        moving = V::all(1.0);
        for (int iteration = 0; judge(task, first, iteration); ++iteration) {
            const Step step = newton();
            moving = step.length * task.share;
            // programs that ended stand still
            T length = moving;
            for (int lane = 0; lane < V::lanes; ++lane)
                if (ended[lane]) V::set(length, lane, 0.0);
            for (int k = 0; k < n; ++k) x[k] = fused(length, step_x[k], x[k]);
            for (int k = 0; k < m; ++k) z[k] = fused(length, step_z[k], z[k]);
            for (int k = p; k < m; ++k) s[k] = fused(length, step_s[k], s[k]);
            tau = fused(length, step.tau, tau);
            kappa = fused(length, step.kappa, kappa);
        }
    }
};

}  // namespace jld
