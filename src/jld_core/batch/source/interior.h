// Predictor-corrector on labellings in lanes: max lambda, A F + lambda l + d = 0, G F <= h, lambda >= -floor.
//
// No lane sees its neighbours: there are masks instead of branches, and whatever is reduced is reduced over faces
// and elements alone. A lane that is done is written out and takes the next labelling.
#pragma once
#include <cmath>
#include <limits>
#include <new>
#include <utility>
#include <vector>

#include "planar.h"
#include "sides.h"
#include "spatial.h"

namespace jld {

// Workspaces of one thread that are not in use. The heap would part an aligned one that is given back among the small
// things that outlive a call, and could never give it out again: a proof grew by ten megabytes a second.
struct Spare {
    static constexpr size_t MOST = size_t(1) << 26, MANY = 512;
    std::vector<std::pair<size_t, void*>> kept;
    size_t bytes = 0;

    Spare() { kept.reserve(MANY); }
    ~Spare() {
        for (auto& one : kept) ::operator delete(one.second, std::align_val_t(64));
    }
    void* take(size_t size) {
        for (size_t k = kept.size(); k-- > 0;)
            if (kept[k].first == size) {
                void* found = kept[k].second;
                kept[k] = kept.back(), kept.pop_back(), bytes -= size;
                return found;
            }
        return ::operator new(size, std::align_val_t(64));
    }
    void give(void* place, size_t size) {
        if (kept.size() >= MANY || bytes + size > MOST) return ::operator delete(place, std::align_val_t(64));
        kept.emplace_back(size, place), bytes += size;
    }
};
inline Spare& spare() {
    static thread_local Spare own;
    return own;
}

template <class T>
struct Aligned {
    typedef T value_type;
    Aligned() = default;
    template <class U>
    Aligned(const Aligned<U>&) {}
    T* allocate(size_t n) { return static_cast<T*>(spare().take(n * sizeof(T))); }
    void deallocate(T* p, size_t n) { spare().give(p, n * sizeof(T)); }
    bool operator==(const Aligned&) const { return true; }
    bool operator!=(const Aligned&) const { return false; }
};
template <class T>
using Store = std::vector<T, Aligned<T>>;

// What is common to all lanes: the factor of A A'.
template <int Q>
struct Shared {
    std::vector<double> diagonal, off;

    explicit Shared(const JldProblem& p)
        : diagonal(TRIANGLE<Q> * p.elements), off(Q * Q * p.pattern.column_start[p.elements]) {
        for (int f = 0; f < p.faces; ++f) Sides<Q>{p}.template squared<double>(f, 1.0, diagonal.data(), off.data(), 1.0);
        Factor<Q, double>::factor(p.pattern, diagonal.data(), off.data());
    }
};

template <class Face>
struct Work {
    static constexpr int Q = Face::Q;
    Store<Face> face;
    Store<Lane> u, du, rhs, left, held, diagonal, off;
    Lane load, s0, z0, lag, delta, press;

    explicit Work(const JldProblem& p)
        : face(p.faces), u(Q * p.elements), du(Q * p.elements), rhs(2 * Q * p.elements), left(Q * p.elements),
          held(Q * p.elements), diagonal(TRIANGLE<Q> * p.elements), off(Q * Q * p.pattern.column_start[p.elements]) {
        load = s0 = z0 = lag = delta = press = splat(1.0);
        for (int i = 0; i < W; ++i) put(p, i, nullptr, JldTry{});
    }

    // a labelling into a lane
    void put(const JldProblem& p, int lane, const uint8_t* labels, const JldTry& how) {
        for (int f = 0; f < p.faces; ++f) {
            int64_t at = int64_t(labels ? labels[f] : 0) * p.faces + f;
            face[f].put(lane, p.rows + Face::NUMBERS * at, p.keep[at], p.forces + Q * f, p.jumps + Q * f, p.room, p.push);
            if constexpr (Face::BOWED) face[f].bend(lane, p.bows + Face::BENT * at, p.room, p.push);
        }
        for (size_t k = 0; k < u.size(); ++k) lanes_of(u[k])[lane] = p.speed[k];
        lanes_of(load)[lane] = p.load, lanes_of(s0)[lane] = p.load + p.floor > 1.0 ? p.load + p.floor : 1.0;
        lanes_of(z0)[lane] = 1.0, lanes_of(lag)[lane] = 1.0, lanes_of(delta)[lane] = how.proximal;
        lanes_of(press)[lane] = how.press > how.margin ? how.press : how.margin;
    }

    // Where a lane stands, for one that begins there: faces, velocities, lambda, and what bounds it.
    void save(int lane, std::vector<double>& to) const {
        to.resize((3 + Face::ROWS) * face.size() + u.size() + 3);
        double* next = to.data();
        for (const Face& one : face) one.save(lane, next), next += 3 + Face::ROWS;
        for (const Lane& x : u) *next++ = lanes_of(x)[lane];
        next[0] = lanes_of(load)[lane], next[1] = lanes_of(s0)[lane], next[2] = lanes_of(z0)[lane];
    }

    // A labelling into a lane that begins where another one stood. space: least slack; product: least one of a slack
    // and its multiplier.
    void resume(const JldProblem& p, int lane, const uint8_t* labels, const JldTry& how, const double* from, double space,
                double product) {
        for (int f = 0; f < p.faces; ++f, from += 3 + Face::ROWS) {
            int64_t at = int64_t(labels[f]) * p.faces + f;
            face[f].resume(lane, p.rows + Face::NUMBERS * at, p.keep[at], from, space, product);
        }
        for (Lane& x : u) lanes_of(x)[lane] = *from++;
        const double least = product / from[1];
        lanes_of(load)[lane] = from[0], lanes_of(s0)[lane] = from[1];
        lanes_of(z0)[lane] = from[2] > least ? from[2] : least;
        lanes_of(lag)[lane] = 1.0, lanes_of(delta)[lane] = how.proximal;
        lanes_of(press)[lane] = how.press > how.margin ? how.press : how.margin;
    }

    // one lane of another
    void copy(Work& from, int source, int lane) {
        for (size_t f = 0; f < face.size(); ++f) face[f].copy(from.face[f], source, lane);
        for (size_t k = 0; k < u.size(); ++k) lanes_of(u[k])[lane] = lanes_of(from.u[k])[source];
        lanes_of(load)[lane] = lanes_of(from.load)[source];
    }

    void clear() {
        for (auto& x : diagonal) x = splat(0.0);
        for (auto& x : off) x = splat(0.0);
    }

    // S + rho, so that it can be factored whatever it is
    void loosen(double rho) {
        for (size_t e = 0; e < u.size() / Q; ++e)
            for (int k = 0; k < Q; ++k) diagonal[TRIANGLE<Q> * e + at(k, k)] += rho;
    }

    Lane dot(const double* a, const Lane* x) const {
        Lane sum = splat(0.0);
        for (size_t k = 0; k < u.size(); ++k) sum += a[k] * x[k];
        return sum;
    }
};

struct Measures {
    Lane gap, balance, jumps, speed, dual;
    Lane room, error;  // least slack of the rows as they are, error of equilibrium

    // Are forces admissible? Then lambda is a bound, however far iterations are from their end.
    bool admissible(int lane) const { return lanes_of(room)[lane] >= 1e-8 && lanes_of(error)[lane] <= 1e-9; }
};

template <class Face>
struct Interior {
    static constexpr int Q = Face::Q;
    static constexpr double FREE = 1e-9;
    const JldProblem& p;
    const JldTry& how;
    Sides<Q> sides;
    Work<Face>& w;

    Interior(const JldProblem& problem, const JldTry& settings, Work<Face>& lanes)
        : p(problem), how(settings), sides{problem}, w(lanes) {}

    // Every face with what velocities make of it, and A times what it answers.
    template <class Call>
    void faces(const Lane* u, Lane* out, Call call) {
        for (int f = 0; f < p.faces; ++f) {
            Face& o = w.face[f];
            Lane jump[Q], x[Q];
            sides.jump(f, u, o.keep, jump);
            call(o, jump, x);
            sides.add(f, x, o.keep, out);
        }
    }

    // One step of every lane. refined: does equilibrium count to the last digit?
    JLD_ONCE void step(Measures& out, bool refined = true) {
        typedef Factor<Q, Lane> Solver;
        const int n = Q * p.elements;
        Lane *u = w.u.data(), *du = w.du.data(), *reach = w.rhs.data(), *rhs = w.rhs.data() + n, *left = w.left.data();
        Lane *held = w.held.data(), *diagonal = w.diagonal.data(), *off = w.off.data();
        const Lane one = splat(1.0), none = splat(0.0);
        Iteration o;
        o.margin = how.margin, o.press = w.press, o.delta = w.delta, o.lag = w.lag;
        o.room = splat(1e300), o.gap = w.s0 * w.z0, o.worst = o.next = o.value = o.moved = o.bent = none;
        for (int k = 0; k < n; ++k)
            left[k] = p.dead[k] + p.live[k] * w.load, rhs[k] = none, reach[k] = splat(p.live[k]);
        w.clear();
        for (int f = 0; f < p.faces; ++f) {
            Face& face = w.face[f];
            Lane jump[Q], x[Q];
            sides.jump(f, u, face.keep, jump);
            face.begin(o, jump, x);
            sides.add(f, x, face.keep, rhs);
            sides.add(f, face.F, face.keep, left);
            sides.condensed(f, face, diagonal, off);
        }
        Lane unbalanced = none;
        for (int k = 0; k < n; ++k) {
            unbalanced = larger(unbalanced, absolute(left[k]));
            rhs[k] += left[k];
            held[k] = rhs[k];
        }
        // where V is dropped velocities may be free of all forces
        if (p.dropping) w.loosen(FREE);
        Solver::factor(p.pattern, diagonal, off);
        Solver::template solve<2>(p.pattern, diagonal, off, w.rhs.data(), n);

        // predictor
        Lane weight0 = w.z0 / w.s0, lack0 = w.s0 - w.load - p.floor;
        Lane work = w.dot(p.live, u) - how.aim - w.z0;
        Lane corner = w.dot(p.live, reach) + weight0;
        Lane side0 = -w.z0 + weight0 * lack0 - work;
        Lane dl = (side0 - w.dot(p.live, rhs)) / corner;
        for (int k = 0; k < n; ++k) du[k] = rhs[k] + reach[k] * dl;
        Lane ds0 = dl - lack0, dz0 = -w.z0 - weight0 * ds0, cross0 = ds0 * dz0;
        o.hit_s = larger(splat(1e-10), -ds0 / w.s0), o.hit_z = larger(splat(1e-10), -dz0 / w.z0);
        o.zds = w.z0 * ds0, o.dsdz = cross0;
        for (int f = 0; f < p.faces; ++f) {
            Lane jump[Q];
            sides.jump(f, du, w.face[f].keep, jump);
            w.face[f].predict(o, jump);
        }
        o.alpha_s = smaller(one, 1.0 / o.hit_s), o.alpha_z = smaller(one, 1.0 / o.hit_z);
        const double count = (Face::ROWS + Face::CONES) * p.faces + 1;
        Lane ahead = o.gap + o.alpha_s * o.zds + o.alpha_z * (-o.gap - o.zds) + o.alpha_s * o.alpha_z * o.dsdz;
        Lane ratio = larger(ahead, none) / o.gap;
        // cones ask for more centring than rows where a predictor gets far
        constexpr double least = Face::CONES ? 0.3 : 0.0;
        o.centre = larger(ratio * larger(ratio * ratio, splat(least)) * o.gap / count, (0.3 * how.target) * scale() / count);

        // corrector
        for (int k = 0; k < n; ++k) rhs[k] = held[k];
        for (int f = 0; f < p.faces; ++f) {
            Lane x[Q];
            w.face[f].correct(o, x);
            sides.add(f, x, w.face[f].keep, rhs);
        }
        Solver::template solve<1>(p.pattern, diagonal, off, rhs, n);
        side0 += (o.centre - cross0) / w.s0;
        dl = (side0 - w.dot(p.live, rhs)) / corner;
        for (int k = 0; k < n; ++k) du[k] = rhs[k] + reach[k] * dl;

        if (refined) {
            // once more for what rounding has left of equilibrium
            for (int k = 0; k < n; ++k) rhs[k] = left[k] + p.live[k] * dl;
            faces(du, rhs, [&](Face& face, const Lane* jump, Lane* x) { face.move(jump, x); });
            Solver::template solve<1>(p.pattern, diagonal, off, rhs, n);
            Lane more = -w.dot(p.live, rhs) / corner;
            for (int k = 0; k < n; ++k) du[k] += rhs[k] + reach[k] * more;
            dl += more;
        }

        ds0 = dl - lack0;
        dz0 = (o.centre - cross0) / w.s0 - w.z0 - weight0 * ds0;
        o.hit_s = larger(splat(1e-10), -ds0 / w.s0), o.hit_z = splat(1e-10);
        o.over = -dz0, o.under = w.z0;
        for (int f = 0; f < p.faces; ++f) {
            Lane jump[Q];
            sides.jump(f, du, w.face[f].keep, jump);
            w.face[f].direct(o, jump);
        }
        o.hit_z = larger(o.hit_z, o.over / o.under);
        Lane near = how.last - (how.last - how.first) * smaller(one, o.gap / (scale() * how.near));
        o.alpha_s = smaller(one, near / o.hit_s), o.alpha_z = smaller(one, near / o.hit_z);
        for (int f = 0; f < p.faces; ++f) w.face[f].advance(o);
        Lane speed = none;
        for (int k = 0; k < n; ++k) u[k] += o.alpha_z * du[k], speed = larger(speed, absolute(u[k]));
        w.load += o.alpha_s * dl, w.s0 += o.alpha_s * ds0, w.z0 += o.alpha_z * dz0;
        w.lag *= 1.0 - o.alpha_s;
        out.gap = o.next + w.s0 * w.z0;
        out.room = o.room, out.error = unbalanced * (1.0 - o.alpha_s);
        out.balance = out.error + w.lag;
        if constexpr (Face::BOWED) out.balance += o.bent;
        out.jumps = o.worst * (1.0 - o.alpha_z) + o.alpha_z * w.delta * o.moved + (w.press - how.margin);
        w.press = larger(splat(how.margin), smaller(w.press, how.press * out.gap / count));
        out.speed = speed;
        // the proximal term holds the motion back as long as forces drift: less of it near the end, more where
        // equilibrium suffers from that
        Mask drifts = (out.gap < how.relax * scale()) & (out.jumps > 0.01 * how.jumps * (1.0 + speed)) & (out.balance < 1e-10);
        Mask loses = (unbalanced > 1e-10) & (out.gap < 1e-6 * scale());
        w.delta = select(drifts, larger(w.delta * 0.3, splat(1e-9)), w.delta);
        w.delta = select(loses, smaller(w.delta * 10.0, splat(1e-4)), w.delta);
        // what the multipliers would bound, were their jumps exact
        out.dual = (o.value - w.dot(p.dead, u)) / w.dot(p.live, u);
    }

    // what a gap is measured by; without an aim there is no lambda to speak of
    Lane scale() const { return larger(absolute(w.load * how.aim), splat(how.aim != 0.0 ? 1e-4 : 1.0)); }
};

}  // namespace jld
