// Predictor-corrector on labellings in lanes: max lambda, A F + lambda l + d = 0, G F <= h, lambda >= -floor.
//
// No lane sees its neighbours: there are masks instead of branches, and whatever is reduced is reduced over faces
// and elements alone. A lane that is done is written out and takes the next labelling.
#pragma once
#include <cmath>
#include <limits>
#include <new>
#include <vector>

#include "planar.h"
#include "problem.h"

namespace jld {

template <class T>
struct Aligned {
    typedef T value_type;
    Aligned() = default;
    template <class U>
    Aligned(const Aligned<U>&) {}
    T* allocate(size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64))); }
    void deallocate(T* p, size_t) { ::operator delete(p, std::align_val_t(64)); }
    bool operator==(const Aligned&) const { return true; }
    bool operator!=(const Aligned&) const { return false; }
};
template <class T>
using Store = std::vector<T, Aligned<T>>;

// Equilibrium between faces and elements: A is made of one block per face and side, 7 numbers each.
struct Sides {
    const JldProblem& p;

    // out += A x, of one face; V counts where it is kept
    void add(int f, const Lane* x, Lane keep, Lane* out) const {
        Lane slip = x[1] * keep;
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0) {
                Lane* o = out + 3 * end[side];
                o[0] += b[0] * x[0] + b[1] * slip;
                o[1] += b[2] * x[0] + b[3] * slip;
                o[2] += b[4] * x[0] + b[5] * slip + b[6] * x[2];
            }
    }

    // out += |A| |x|, of one face
    void weigh(int f, const Lane* x, Lane* out) const {
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0)
                for (int r = 0; r < 3; ++r) {
                    Lane& o = out[3 * end[side] + r];
                    o += std::fabs(b[2 * r]) * absolute(x[0]) + std::fabs(b[2 * r + 1]) * absolute(x[1]);
                    if (r == 2) o += std::fabs(b[6]) * absolute(x[2]);
                }
    }

    // A'u of one face
    void jump(int f, const Lane* u, Lane keep, Lane* out) const {
        Lane n = splat(0.0), s = splat(0.0), m = splat(0.0);
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        for (int side = 0; side < 2; ++side, b += 7)
            if (end[side] >= 0) {
                const Lane* o = u + 3 * end[side];
                n += b[0] * o[0] + b[2] * o[1] + b[4] * o[2];
                s += b[1] * o[0] + b[3] * o[1] + b[5] * o[2];
                m += b[6] * o[2];
            }
        out[0] = n, out[1] = s * keep, out[2] = m;
    }

    // S += A (g v v' + diag(0, iv, im)) A', v = (1, v, m), of one face
    void condensed(int f, Lane g, Lane v, Lane m, Lane iv, Lane im, Lane* diagonal, Lane* off) const {
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        Lane q[2][3], gq[2][3], sv[2][3];
        for (int side = 0; side < 2; ++side, b += 7) {
            if (end[side] < 0) continue;
            q[side][0] = b[0] + b[1] * v, q[side][1] = b[2] + b[3] * v, q[side][2] = b[4] + b[5] * v + b[6] * m;
            for (int r = 0; r < 3; ++r) gq[side][r] = g * q[side][r], sv[side][r] = iv * b[2 * r + 1];
            Lane* d = diagonal + 6 * end[side];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c <= r; ++c) d[at(r, c)] += gq[side][r] * q[side][c] + sv[side][r] * b[2 * c + 1];
            d[5] += im * (b[6] * b[6]);
        }
        if (p.block[f] >= 0) {
            b = p.sides + 14 * f;  // the block stands in the row of the later element
            Lane* o = off + 9 * p.block[f];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) o[3 * r + c] += gq[1][r] * q[0][c] + sv[1][r] * b[2 * c + 1];
            o[8] += im * (b[6] * b[13]);
        }
    }

    // S += A P A', P symmetric (NN, NV, VV, NM, VM, MM)
    template <class T>
    void full(int f, const T* P, T* diagonal, T* off) const {
        const double* b = p.sides + 14 * f;
        const int end[2] = {p.low[f], p.high[f]};
        T half[2][3][3];
        for (int side = 0; side < 2; ++side) {
            if (end[side] < 0) continue;
            const double* own = b + 7 * side;
            for (int r = 0; r < 3; ++r) {
                const int index[3][3] = {{0, 1, 3}, {1, 2, 4}, {3, 4, 5}};
                for (int c = 0; c < 3; ++c) {
                    half[side][r][c] = own[2 * r] * P[index[0][c]] + own[2 * r + 1] * P[index[1][c]];
                    if (r == 2) half[side][r][c] += own[6] * P[index[2][c]];
                }
            }
            T* d = diagonal + 6 * end[side];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c <= r; ++c) {
                    d[at(r, c)] += half[side][r][0] * own[2 * c] + half[side][r][1] * own[2 * c + 1];
                    if (c == 2) d[at(r, c)] += half[side][r][2] * own[6];
                }
        }
        if (p.block[f] >= 0) {
            T* o = off + 9 * p.block[f];
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) {
                    o[3 * r + c] += half[1][r][0] * b[2 * c] + half[1][r][1] * b[2 * c + 1];
                    if (c == 2) o[3 * r + c] += half[1][r][2] * b[6];
                }
        }
    }
};

// What is common to all lanes: the factor of A A'.
struct Shared {
    std::vector<double> diagonal, off;

    explicit Shared(const JldProblem& p) : diagonal(6 * p.elements), off(9 * p.pattern.column_start[p.elements]) {
        const double one[6] = {1, 0, 1, 0, 0, 1};
        for (int f = 0; f < p.faces; ++f) Sides{p}.full<double>(f, one, diagonal.data(), off.data());
        Factor<3, double>::factor(p.pattern, diagonal.data(), off.data());
    }
};

template <int PAIRS>
struct Work {
    typedef PlanarFace<PAIRS> Face;
    Store<Face> face;
    Store<Lane> u, du, rhs, left, held, diagonal, off;
    Lane load, s0, z0, lag, delta;

    explicit Work(const JldProblem& p)
        : face(p.faces), u(3 * p.elements), du(3 * p.elements), rhs(6 * p.elements), left(3 * p.elements),
          held(3 * p.elements), diagonal(6 * p.elements), off(9 * p.pattern.column_start[p.elements]) {
        load = s0 = z0 = lag = delta = splat(1.0);
        for (int i = 0; i < W; ++i) put(p, i, nullptr, 1.0);
    }

    // a labelling into a lane
    void put(const JldProblem& p, int lane, const uint8_t* labels, double proximal) {
        for (int f = 0; f < p.faces; ++f) {
            int label = labels ? labels[f] : 0;
            const double* row = p.rows + 3 * PAIRS * (int64_t(label) * p.faces + f);
            Face& at = face[f];
            const double keep = p.keep[int64_t(label) * p.faces + f];
            for (int k = 0; k < PAIRS; ++k, row += 3) {
                lanes_of(at.a[k])[lane] = row[0], lanes_of(at.b[k])[lane] = row[1], lanes_of(at.h[k])[lane] = row[2];
                double x = Face::bends(k) ? p.forces[3 * f + 2] : keep * p.forces[3 * f + 1], n = p.forces[3 * f];
                double turn = row[1] > 0.0 ? -p.jumps[3 * f + (Face::bends(k) ? 2 : 1)] / row[1] : 0.0;
                for (int r = 0; r < 2; ++r) {
                    double sign = r ? -1.0 : 1.0, own = row[2] + row[0] * n - sign * row[1] * x;
                    double slack = own > p.room ? own : p.room;
                    lanes_of(at.s[2 * k + r])[lane] = slack;
                    lanes_of(at.lack[2 * k + r])[lane] = slack - own;
                    lanes_of(at.z[2 * k + r])[lane] = p.push + (sign * turn > 0.0 ? sign * turn : 0.0);
                }
            }
            lanes_of(at.keep)[lane] = keep;
            for (int k = 0; k < 3; ++k) lanes_of(at.F[k])[lane] = p.forces[3 * f + k];
            lanes_of(at.F[1])[lane] *= keep;
        }
        for (size_t k = 0; k < u.size(); ++k) lanes_of(u[k])[lane] = p.speed[k];
        lanes_of(load)[lane] = p.load, lanes_of(s0)[lane] = p.load + p.floor > 1.0 ? p.load + p.floor : 1.0, lanes_of(z0)[lane] = 1.0, lanes_of(lag)[lane] = 1.0, lanes_of(delta)[lane] = proximal;
    }

    // one lane of another
    void copy(const Work& from, int source, int lane) {
        auto move = [&](Lane& to, const Lane& x) { lanes_of(to)[lane] = lanes_of(x)[source]; };
        for (size_t f = 0; f < face.size(); ++f) {
            Face& to = face[f];
            const Face& x = from.face[f];
            for (int k = 0; k < PAIRS; ++k) move(to.a[k], x.a[k]), move(to.b[k], x.b[k]), move(to.h[k], x.h[k]);
            for (int k = 0; k < 2 * PAIRS; ++k) move(to.s[k], x.s[k]), move(to.z[k], x.z[k]);
            for (int k = 0; k < 3; ++k) move(to.F[k], x.F[k]);
            move(to.keep, x.keep);
        }
        for (size_t k = 0; k < u.size(); ++k) move(u[k], from.u[k]);
        move(load, from.load), move(s0, from.s0), move(z0, from.z0);
    }
};

struct Measures {
    Lane gap, balance, jumps, speed, value, dual;
};

template <int PAIRS>
struct Interior {
    typedef Work<PAIRS> Lanes;
    typedef PlanarFace<PAIRS> Face;
    static constexpr int ROWS = 2 * PAIRS;
    const JldProblem& p;
    const JldTry& how;
    Sides sides;
    Lanes& w;

    Interior(const JldProblem& problem, const JldTry& settings, Lanes& lanes)
        : p(problem), how(settings), sides{problem}, w(lanes) {}

    Lane dot(const double* a, const Lane* x) const {
        Lane sum = splat(0.0);
        for (int k = 0; k < 3 * p.elements; ++k) sum += a[k] * x[k];
        return sum;
    }

    // what is left of h - G F = s at the start, of one row: it shrinks with every step
    Lane lack(const Face& f, int row) const { return w.lag * (f.lack[row] + how.margin); }

    // One step of every lane.
    void step(Measures& out) {
        const int n = 3 * p.elements;
        Lane *u = w.u.data(), *du = w.du.data(), *reach = w.rhs.data(), *rhs = w.rhs.data() + n, *left = w.left.data();
        Lane* held = w.held.data();
        for (int k = 0; k < n; ++k)
            left[k] = p.dead[k] + p.live[k] * w.load, rhs[k] = splat(0.0), reach[k] = splat(p.live[k]);
        for (auto& x : w.diagonal) x = splat(0.0);
        for (auto& x : w.off) x = splat(0.0);
        Lane gap = w.s0 * w.z0, worst = splat(0.0);
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            o.condense(w.delta);
            Lane jump[3], pull[3], t[ROWS], x[3];
            sides.jump(f, u, o.keep, jump);
            o.turned(o.z, pull);
            for (int r = 0; r < ROWS; ++r) {
                gap += o.s[r] * o.z[r];
                t[r] = o.z[r] * o.is[r] * lack(o, r);
            }
            Lane lag[3];
            o.turned(t, lag);
            jump[0] -= how.margin;
            for (int k = 0; k < 3; ++k) {
                worst = larger(worst, absolute(jump[k] + pull[k]));
                // of s dz + z ds = -s z what depends on z falls out against the residual of the jumps
                o.c[k] = -jump[k] - lag[k];
            }
            o.apply(o.c, x);
            sides.add(f, x, o.keep, rhs);
            sides.add(f, o.F, o.keep, left);
            sides.condensed(f, o.g, o.v, o.m, o.iv * o.keep, o.im, w.diagonal.data(), w.off.data());
        }
        out.jumps = worst;
        Lane unbalanced = splat(0.0);
        for (int k = 0; k < n; ++k) {
            unbalanced = larger(unbalanced, absolute(left[k]));
            rhs[k] += left[k];
        }
        for (int k = 0; k < n; ++k) held[k] = rhs[k];
        Factor<3, Lane>::factor(p.pattern, w.diagonal.data(), w.off.data());
        Factor<3, Lane>::template solve<2>(p.pattern, w.diagonal.data(), w.off.data(), w.rhs.data(), n);

        // predictor
        Lane weight0 = w.z0 / w.s0, lack0 = w.s0 - w.load - p.floor;
        Lane work = dot(p.live, u) - how.aim - w.z0;
        Lane corner = dot(p.live, reach) + weight0;
        Lane side0 = -w.z0 + weight0 * lack0 - work;  // comp = -s0 z0
        Lane dl = (side0 - dot(p.live, rhs)) / corner;
        for (int k = 0; k < n; ++k) du[k] = rhs[k] + reach[k] * dl;
        Lane ds0 = dl - lack0, dz0 = -w.z0 - weight0 * ds0;
        Lane hit_s = larger(splat(1e-10), -ds0 / w.s0), hit_z = larger(splat(1e-10), -dz0 / w.z0);
        Lane zds = w.z0 * ds0, dsdz = ds0 * dz0;
        Lane cross0 = dsdz;
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane jump[3], x[3], rows[ROWS];
            sides.jump(f, du, o.keep, jump);
            for (int k = 0; k < 3; ++k) jump[k] = o.c[k] - jump[k];
            o.apply(jump, x, rows);
            for (int r = 0; r < ROWS; ++r) {
                Lane ds = -lack(o, r) - rows[r], by = ds * o.is[r];
                Lane dz = -o.z[r] - o.z[r] * by;
                hit_s = larger(hit_s, -by), hit_z = larger(hit_z, 1.0 + by);
                zds += o.z[r] * ds, dsdz += ds * dz;
                o.second[r] = by * dz;
            }
        }
        Lane one = splat(1.0);
        Lane alpha_s = smaller(one, 1.0 / hit_s), alpha_z = smaller(one, 1.0 / hit_z);
        const double count = ROWS * p.faces + 1;
        Lane ahead = gap + alpha_s * zds + alpha_z * (-gap - zds) + alpha_s * alpha_z * dsdz;
        Lane ratio = larger(ahead, splat(0.0)) / gap, sigma = ratio * ratio * ratio;
        Lane least = (0.3 * how.target) * scale() / count;
        Lane centre = larger(sigma * gap / count, least);

        // corrector
        for (int k = 0; k < n; ++k) rhs[k] = held[k];
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane t[ROWS], back[3], x[3];
            for (int r = 0; r < ROWS; ++r) t[r] = centre * o.is[r] - o.second[r];
            o.turned(t, back);
            for (int k = 0; k < 3; ++k) o.c[k] -= back[k], back[k] = -back[k];
            o.apply(back, x);
            sides.add(f, x, o.keep, rhs);
        }
        Factor<3, Lane>::template solve<1>(p.pattern, w.diagonal.data(), w.off.data(), rhs, n);
        side0 += (centre - cross0) / w.s0;
        dl = (side0 - dot(p.live, rhs)) / corner;
        for (int k = 0; k < n; ++k) du[k] = rhs[k] + reach[k] * dl;

        // once more for what rounding has left of equilibrium
        for (int k = 0; k < n; ++k) rhs[k] = left[k] + p.live[k] * dl;
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane jump[3], x[3];
            sides.jump(f, du, o.keep, jump);
            for (int k = 0; k < 3; ++k) jump[k] = o.c[k] - jump[k];
            o.apply(jump, x);
            sides.add(f, x, o.keep, rhs);
        }
        Factor<3, Lane>::template solve<1>(p.pattern, w.diagonal.data(), w.off.data(), rhs, n);
        Lane more = -dot(p.live, rhs) / corner;
        for (int k = 0; k < n; ++k) du[k] += rhs[k] + reach[k] * more;
        dl += more;

        ds0 = dl - lack0;
        dz0 = (centre - cross0) / w.s0 - w.z0 - weight0 * ds0;
        hit_s = larger(splat(1e-10), -ds0 / w.s0);
        // the largest -dz / z as a fraction, compared by products
        Lane over = -dz0, under = w.z0;
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane jump[3], rows[ROWS];
            sides.jump(f, du, o.keep, jump);
            for (int k = 0; k < 3; ++k) jump[k] = o.c[k] - jump[k];
            o.apply(jump, o.dF, rows);
            for (int r = 0; r < ROWS; ++r) {
                Lane ds = -lack(o, r) - rows[r], by = ds * o.is[r];
                Lane dz = centre * o.is[r] - o.second[r] - o.z[r] - o.z[r] * by;
                o.ds[r] = ds, o.dz[r] = dz;
                hit_s = larger(hit_s, -by);
                Mask sooner = -dz * under > over * o.z[r];
                over = select(sooner, -dz, over), under = select(sooner, o.z[r], under);
            }
        }
        hit_z = larger(splat(1e-10), over / under);
        Lane small = gap / (scale() * how.near);
        Lane near = how.last - (how.last - how.first) * smaller(one, small);
        alpha_s = smaller(one, near / hit_s), alpha_z = smaller(one, near / hit_z);
        Lane next = splat(0.0), value = splat(0.0), moved = splat(0.0);
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            for (int k = 0; k < 3; ++k) o.F[k] += alpha_s * o.dF[k], moved = larger(moved, absolute(o.dF[k]));
            for (int r = 0; r < ROWS; ++r) {
                o.s[r] += alpha_s * o.ds[r], o.z[r] += alpha_z * o.dz[r];
                next += o.s[r] * o.z[r];
                value += o.h[r / 2] * o.z[r];
            }
        }
        Lane speed = splat(0.0);
        for (int k = 0; k < n; ++k) u[k] += alpha_z * du[k], speed = larger(speed, absolute(u[k]));
        w.load += alpha_s * dl, w.s0 += alpha_s * ds0, w.z0 += alpha_z * dz0;
        w.lag *= 1.0 - alpha_s;
        out.gap = next + w.s0 * w.z0;
        out.balance = unbalanced * (1.0 - alpha_s) + w.lag;
        out.jumps = out.jumps * (1.0 - alpha_z) + alpha_z * w.delta * moved;
        out.speed = speed;
        // the proximal term holds the motion back as long as forces drift: less of it near the end, more where
        // equilibrium suffers from that
        Mask drifts = (out.gap < how.relax * scale()) & (out.jumps > 1e-10 * (1.0 + speed)) & (out.balance < 1e-10);
        Mask loses = (unbalanced > 1e-10) & (out.gap < 1e-6 * scale());
        w.delta = select(drifts, larger(w.delta * 0.3, splat(1e-9)), w.delta);
        w.delta = select(loses, smaller(w.delta * 10.0, splat(1e-4)), w.delta);
        // what the multipliers would bound, were their jumps exact
        out.dual = (value - dot(p.dead, u)) / dot(p.live, u);
    }

    // what a gap is measured by; without an aim there is no lambda to speak of
    Lane scale() const { return larger(absolute(w.load) * how.aim, splat(how.aim > 0.0 ? 1e-4 : 1.0)); }
};

}  // namespace jld
