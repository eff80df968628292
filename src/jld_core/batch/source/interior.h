// Mehrotra's predictor-corrector for (2.1), one labelling per SIMD lane: max lambda, A F + lambda l + d = 0, G F <= h,
// lambda >= -floor.
//
// Lanes do not interact: masks replace branches, and sums run over faces and elements of one lane. A finished lane is
// written out and receives the next labelling.
#pragma once
#include <cmath>
#include <limits>
#include <vector>

#include "planar.h"
#include "sides.h"
#include "spatial.h"
#include "store.h"

namespace jld {

// Factor of A A', the same for all labellings that drop no V.
template <int Q>
struct Shared {
    std::vector<double> diagonal, off;

    explicit Shared(const JldProblem& p)
        : diagonal(TRIANGLE<Q> * p.elements), off(Q * Q * p.pattern.column_start[p.elements]) {
        for (int f = 0; f < p.faces; ++f)
            Sides<Q>{p}.template squared<double>(f, 1.0, diagonal.data(), off.data(), 1.0);
        Factor<Q, double>::factor(p.pattern, diagonal.data(), off.data());
    }
};

template <class Face>
struct Workspace {
    static constexpr int FREEDOMS = Face::FREEDOMS;
    Store<Face> face;
    Store<Lane> velocity, velocity_step, rhs, left, held, diagonal, off;
    Store<Lane> dead, live;  // loads of each lane: of its label where labels have their own
    Lane load, load_slack, load_multiplier, lag, delta, press;

    explicit Workspace(const JldProblem& p)
        : face(p.faces),
          velocity(FREEDOMS * p.elements),
          velocity_step(FREEDOMS * p.elements),
          rhs(2 * FREEDOMS * p.elements),
          left(FREEDOMS * p.elements),
          held(FREEDOMS * p.elements),
          diagonal(TRIANGLE<FREEDOMS> * p.elements),
          off(FREEDOMS * FREEDOMS * p.pattern.column_start[p.elements]),
          dead(FREEDOMS * p.elements),
          live(FREEDOMS * p.elements) {
        load = load_slack = load_multiplier = lag = delta = press = splat(1.0);
        for (int i = 0; i < LANES; ++i) put(p, i, nullptr, JldTry{});
    }

    // Put a labelling and the starting point into a lane.
    void put(const JldProblem& p, int lane, const uint8_t* labels, const JldTry& how) {
        for (int f = 0; f < p.faces; ++f) {
            int64_t at = int64_t(labels ? labels[f] : 0) * p.faces + f;
            face[f].put(lane, p.rows + Face::NUMBERS * at, p.keep[at], p.forces + FREEDOMS * f, p.jumps + FREEDOMS * f,
                        p.least_slack, p.least_multiplier);
            if constexpr (Face::PARABOLIC)
                face[f].bend(lane, p.parabolas + Face::PARABOLA_NUMBERS * at, p.least_slack, p.least_multiplier);
        }
        const size_t own = p.own_loads && labels ? labels[0] * velocity.size() : 0;
        for (size_t k = 0; k < velocity.size(); ++k) {
            lanes_of(velocity[k])[lane] = p.velocity[k];
            lanes_of(dead[k])[lane] = p.dead[own + k], lanes_of(live[k])[lane] = p.live[own + k];
        }
        lanes_of(load)[lane] = p.load, lanes_of(load_slack)[lane] = p.load + p.floor > 1.0 ? p.load + p.floor : 1.0;
        lanes_of(load_multiplier)[lane] = 1.0, lanes_of(lag)[lane] = 1.0, lanes_of(delta)[lane] = how.proximal;
        lanes_of(press)[lane] = how.press > how.margin ? how.press : how.margin;
    }

    // Store the state of a lane: forces and multipliers of the faces, velocities, lambda and its row.
    void save(int lane, std::vector<double>& to) const {
        to.resize((3 + Face::ROWS) * face.size() + velocity.size() + 3);
        double* next = to.data();
        for (const Face& one : face) one.save(lane, next), next += 3 + Face::ROWS;
        for (const Lane& x : velocity) *next++ = lanes_of(x)[lane];
        next[0] = lanes_of(load)[lane], next[1] = lanes_of(load_slack)[lane], next[2] = lanes_of(load_multiplier)[lane];
    }

    // Put a labelling into a lane, starting from a stored state. space: least slack; product: least product of a slack
    // and its multiplier.
    void resume(const JldProblem& p, int lane, const uint8_t* labels, const JldTry& how, const double* from,
                double space, double product) {
        for (int f = 0; f < p.faces; ++f, from += 3 + Face::ROWS) {
            int64_t at = int64_t(labels[f]) * p.faces + f;
            face[f].resume(lane, p.rows + Face::NUMBERS * at, p.keep[at], from, space, product);
            if constexpr (Face::PARABOLIC)
                face[f].bend(lane, p.parabolas + Face::PARABOLA_NUMBERS * at, space, product / space);
        }
        for (Lane& x : velocity) lanes_of(x)[lane] = *from++;
        const double least = product / from[1];
        lanes_of(load)[lane] = from[0], lanes_of(load_slack)[lane] = from[1];
        lanes_of(load_multiplier)[lane] = from[2] > least ? from[2] : least;
        lanes_of(lag)[lane] = 1.0, lanes_of(delta)[lane] = how.proximal;
        lanes_of(press)[lane] = how.press > how.margin ? how.press : how.margin;
    }

    // Copy one lane of another workspace.
    void copy(Workspace& from, int source, int lane) {
        for (size_t f = 0; f < face.size(); ++f) face[f].copy(from.face[f], source, lane);
        for (size_t k = 0; k < velocity.size(); ++k) {
            lanes_of(velocity[k])[lane] = lanes_of(from.velocity[k])[source];
            lanes_of(dead[k])[lane] = lanes_of(from.dead[k])[source];
            lanes_of(live[k])[lane] = lanes_of(from.live[k])[source];
        }
        for (Lane Workspace::* own : {&Workspace::load, &Workspace::load_slack, &Workspace::load_multiplier})
            lanes_of(this->*own)[lane] = lanes_of(from.*own)[source];
    }

    // Set the matrix blocks that S itself enters to zero; the factorisation does not read the others.
    void clear(const JldProblem& p) {
        for (auto& x : diagonal) x = splat(0.0);
        for (int f = 0; f < p.faces; ++f)
            for (int k = 0; p.block[f] >= 0 && k < FREEDOMS * FREEDOMS; ++k)
                off[FREEDOMS * FREEDOMS * p.block[f] + k] = splat(0.0);
    }

    // Add rho to the diagonal of S, so that S has a factor whatever it is.
    void loosen(double rho) {
        for (size_t e = 0; e < velocity.size() / FREEDOMS; ++e)
            for (int k = 0; k < FREEDOMS; ++k) diagonal[TRIANGLE<FREEDOMS> * e + at(k, k)] += rho;
    }

    // Return the sum of a load times velocities of the same lane.
    Lane dot(const Store<Lane>& a, const Lane* x) const {
        Lane sum = splat(0.0);
        for (size_t k = 0; k < velocity.size(); ++k) sum += a[k] * x[k];
        return sum;
    }
};

struct Measures {
    Lane gap, balance, jumps, speed, dual;
    Lane room, error;  // least slack of the rows without margin; error of equilibrium

    // Return true if the forces are admissible; lambda is then a lower bound, (3.3), before the iterations converge.
    bool admissible(int lane) const { return lanes_of(room)[lane] >= 1e-8 && lanes_of(error)[lane] <= 1e-9; }
};

template <class Face>
struct Interior {
    static constexpr int FREEDOMS = Face::FREEDOMS;
    static constexpr double FREE = 1e-9;
    const JldProblem& problem;
    const JldTry& how;
    Sides<FREEDOMS> sides;
    Workspace<Face>& lanes;

    Interior(const JldProblem& problem, const JldTry& settings, Workspace<Face>& lanes)
        : problem(problem), how(settings), sides{problem}, lanes(lanes) {}

    // out += A x for every face, with x = call(face, A'u).
    template <class Call>
    void faces(const Lane* u, Lane* out, Call call) {
        for (int f = 0; f < problem.faces; ++f) {
            Face& o = lanes.face[f];
            Lane jump[FREEDOMS], x[FREEDOMS];
            sides.jump(f, u, o.keep, jump);
            call(o, jump, x);
            sides.add(f, x, o.keep, out);
        }
    }

    // Do one iteration in every lane. refined: correct the equilibrium once more to the last digit.
    JLD_NOINLINE void step(Measures& out, bool refined = true) {
        typedef Factor<FREEDOMS, Lane> Solver;
        const int n = FREEDOMS * problem.elements;
        Lane *u = lanes.velocity.data(), *du = lanes.velocity_step.data(), *reach = lanes.rhs.data(),
             *rhs = lanes.rhs.data() + n, *left = lanes.left.data();
        Lane *held = lanes.held.data(), *diagonal = lanes.diagonal.data(), *off = lanes.off.data();
        const Lane one = splat(1.0), none = splat(0.0);
        Iteration o;
        o.margin = how.margin, o.press = lanes.press, o.proximal = lanes.delta, o.residual_share = lanes.lag;
        o.room = splat(1e300), o.gap = lanes.load_slack * lanes.load_multiplier,
        o.worst = o.next_gap = o.value = o.moved = o.parabola_error = none;
        for (int k = 0; k < n; ++k)
            left[k] = lanes.dead[k] + lanes.live[k] * lanes.load, rhs[k] = none, reach[k] = lanes.live[k];
        lanes.clear(problem);
        for (int f = 0; f < problem.faces; ++f) {
            Face& face = lanes.face[f];
            Lane jump[FREEDOMS], x[FREEDOMS];
            sides.jump(f, u, face.keep, jump);
            face.begin(o, jump, x);
            sides.add(f, x, face.keep, rhs);
            sides.add(f, face.force, face.keep, left);
            sides.condensed(f, face, diagonal, off);
        }
        Lane unbalanced = none;
        for (int k = 0; k < n; ++k) {
            unbalanced = larger(unbalanced, absolute(left[k]));
            rhs[k] += left[k];
            held[k] = rhs[k];
        }
        // Regularise: where V is dropped, velocities may be free of all forces.
        if (problem.drops_shear) lanes.loosen(FREE);
        if constexpr (FREEDOMS == 3) {
            Solver::template factor<2>(problem.pattern, diagonal, off, lanes.rhs.data(), n);
            Solver::template backward<2>(problem.pattern, diagonal, off, lanes.rhs.data(), n);
        } else {  // the sums of both together would not fit into the registers
            Solver::factor(problem.pattern, diagonal, off);
            Solver::template solve<2>(problem.pattern, diagonal, off, lanes.rhs.data(), n);
        }

        // Predictor step, (8.4) with S of (8.5).
        Lane weight0 = lanes.load_multiplier / lanes.load_slack, lack0 = lanes.load_slack - lanes.load - problem.floor;
        Lane work = lanes.dot(lanes.live, u) - how.aim - lanes.load_multiplier;
        Lane corner = lanes.dot(lanes.live, reach) + weight0;
        Lane side0 = -lanes.load_multiplier + weight0 * lack0 - work;
        Lane dl = (side0 - lanes.dot(lanes.live, rhs)) / corner;
        for (int k = 0; k < n; ++k) du[k] = rhs[k] + reach[k] * dl;
        Lane ds0 = dl - lack0, dz0 = -lanes.load_multiplier - weight0 * ds0, cross0 = ds0 * dz0;
        o.primal_blocking = larger(splat(1e-10), -ds0 / lanes.load_slack),
        o.dual_blocking = larger(splat(1e-10), -dz0 / lanes.load_multiplier);
        o.multiplier_slack_step = lanes.load_multiplier * ds0, o.step_product = cross0;
        for (int f = 0; f < problem.faces; ++f) {
            Lane jump[FREEDOMS];
            sides.jump(f, du, lanes.face[f].keep, jump);
            lanes.face[f].predict(o, jump);
        }
        o.primal_step = smaller(one, 1.0 / o.primal_blocking), o.dual_step = smaller(one, 1.0 / o.dual_blocking);
        const double count = (Face::ROWS + Face::CONES) * problem.faces + 1;
        Lane ahead = o.gap + o.primal_step * o.multiplier_slack_step +
                     o.dual_step * (-o.gap - o.multiplier_slack_step) + o.primal_step * o.dual_step * o.step_product;
        Lane ratio = larger(ahead, none) / o.gap;
        // Cones need more centring than linear rows where the predictor step is long.
        constexpr double least = Face::CONES ? 0.3 : 0.0;
        o.centre =
            larger(ratio * larger(ratio * ratio, splat(least)) * o.gap / count, (0.3 * how.target) * scale() / count);

        // Corrector step.
        for (int k = 0; k < n; ++k) rhs[k] = held[k];
        for (int f = 0; f < problem.faces; ++f) {
            Lane x[FREEDOMS];
            lanes.face[f].correct(o, x);
            sides.add(f, x, lanes.face[f].keep, rhs);
        }
        Solver::template solve<1>(problem.pattern, diagonal, off, rhs, n);
        side0 += (o.centre - cross0) / lanes.load_slack;
        dl = (side0 - lanes.dot(lanes.live, rhs)) / corner;
        for (int k = 0; k < n; ++k) du[k] = rhs[k] + reach[k] * dl;

        // Stiff faces turn the last digit of a velocity into a force, so a correction added to du would lose its digits.
        const bool apart = FREEDOMS == 3 && refined && how.apart;
        if (refined) {
            // Correct the rounding error of equilibrium once more.
            for (int k = 0; k < n; ++k) rhs[k] = left[k] + lanes.live[k] * dl;
            faces(du, rhs, [&](Face& face, const Lane* jump, Lane* x) { face.move(jump, x); });
            Solver::template solve<1>(problem.pattern, diagonal, off, rhs, n);
            Lane more = -lanes.dot(lanes.live, rhs) / corner;
            for (int k = 0; k < n; ++k) rhs[k] += reach[k] * more;
            dl += more;
            if (!apart)
                for (int k = 0; k < n; ++k) du[k] += rhs[k];
        }

        ds0 = dl - lack0;
        dz0 = (o.centre - cross0) / lanes.load_slack - lanes.load_multiplier - weight0 * ds0;
        o.primal_blocking = larger(splat(1e-10), -ds0 / lanes.load_slack), o.dual_blocking = splat(1e-10);
        o.blocking_numerator = -dz0, o.blocking_denominator = lanes.load_multiplier;
        for (int f = 0; f < problem.faces; ++f) {
            Lane jump[FREEDOMS];
            sides.jump(f, du, lanes.face[f].keep, jump);
            if constexpr (FREEDOMS == 3) {
                Lane more[FREEDOMS];
                if (apart) sides.jump(f, rhs, lanes.face[f].keep, more);
                lanes.face[f].direct(o, jump, apart ? more : nullptr);
            } else {
                lanes.face[f].direct(o, jump);
            }
        }
        if (apart)
            for (int k = 0; k < n; ++k) du[k] += rhs[k];
        Lane sum = dl;
        for (int k = 0; k < n; ++k) sum += du[k];
        const Mask fails = ~(absolute(sum) < 1e30);
        if constexpr (FREEDOMS == 3) {
            // Where the factor broke down, take no step, and a larger proximal term for the next one.
            bool any = false;
            for (int i = 0; i < LANES; ++i) any |= is_set(fails, i);
            if (any) {
                for (Face& face : lanes.face) face.halt(fails);
                for (int k = 0; k < n; ++k) du[k] = select(fails, none, du[k]);
                for (Lane* one : {&dl, &ds0, &dz0}) *one = select(fails, none, *one);
            }
        }
        o.dual_blocking = larger(o.dual_blocking, o.blocking_numerator / o.blocking_denominator);
        Lane near = how.last - (how.last - how.first) * smaller(one, o.gap / (scale() * how.near));
        o.primal_step = smaller(one, near / o.primal_blocking), o.dual_step = smaller(one, near / o.dual_blocking);
        o.primal_step = select(fails, none, o.primal_step), o.dual_step = select(fails, none, o.dual_step);
        for (int f = 0; f < problem.faces; ++f) lanes.face[f].advance(o);
        Lane speed = none;
        for (int k = 0; k < n; ++k) u[k] += o.dual_step * du[k], speed = larger(speed, absolute(u[k]));
        lanes.load += o.primal_step * dl, lanes.load_slack += o.primal_step * ds0,
            lanes.load_multiplier += o.dual_step * dz0;
        lanes.lag *= 1.0 - o.primal_step;
        out.gap = o.next_gap + lanes.load_slack * lanes.load_multiplier;
        out.room = o.room, out.error = unbalanced * (1.0 - o.primal_step);
        out.balance = out.error + lanes.lag;
        if constexpr (Face::PARABOLIC) out.balance += o.parabola_error;
        out.jumps = o.worst * (1.0 - o.dual_step) + o.dual_step * lanes.delta * o.moved + (lanes.press - how.margin);
        lanes.press = larger(splat(how.margin), smaller(lanes.press, how.press * out.gap / count));
        out.speed = speed;
        // The proximal term delays the motion while forces drift. Decrease it near the solution, and increase it where
        // equilibrium loses digits.
        Mask drifts =
            (out.gap < how.relax * scale()) & (out.jumps > 0.01 * how.jumps * (1.0 + speed)) & (out.balance < 1e-10);
        Mask loses = (unbalanced > 1e-10) & (out.gap < 1e-6 * scale());
        const double small = std::fmin(1e-9, how.proximal), large = std::fmin(1e-4, 1e4 * how.proximal);
        lanes.delta = select(drifts, larger(lanes.delta * 0.3, splat(small)), lanes.delta);
        lanes.delta = select(loses & ~fails, smaller(lanes.delta * 10.0, splat(large)), lanes.delta);
        lanes.delta = select(fails, lanes.delta * 100.0, lanes.delta);
        // Upper bound (3.3) that the multipliers would give if their jumps were exact.
        out.dual = (o.value - lanes.dot(lanes.dead, u)) / lanes.dot(lanes.live, u);
    }

    // Reference of relative gaps; without an aim there is no lambda to refer to.
    Lane scale() const { return larger(absolute(lanes.load * how.aim), splat(how.aim != 0.0 ? 1e-4 : 1.0)); }
};

}  // namespace jld
