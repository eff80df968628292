// Whole shrinkings: labellings that are too weak, with fewer and fewer faces decided, one relaxation after the other in
// the lane that is free next. A relaxation ends early where its forces are admissible and carry more than matters; a
// motion that refutes is waited for until it hardly moves any more, since one that is stopped as soon as it refutes frees
// fewer faces and makes for more conflicts. What is asked next differs in few faces and begins where iterations of the
// last one were still far from all rows.
#pragma once
#include <deque>
#include <memory>

#include "proof.h"

namespace jld {

struct Job {
    int64_t row;
    const uint8_t* labels;
    double threshold;
    bool drawn;
    std::vector<uint8_t> asked;    // (faces) of JldLabel
    std::vector<uint8_t> tried;    // (faces) tried alone
    std::vector<double> cost;      // (faces) of the mechanism at hand
    std::vector<double> velocity;  // its own
    // where this relaxation begins, none for a cold start, where the next may, and where neighbours do
    std::vector<double> start, passed, first;
    double product = 0.0, further = 0.0, earliest = 0.0;  // of a slack and its multiplier there, on the mean
    bool thorough = false;  // to the last digit?
    double excess = 0.0;
    bool refuted = false;
    int alone = -1, vain = 0, relaxations = 0;
};

template <class Face>
struct Shrink {
    static constexpr int Q = Face::Q;
    // only rows that are linear know how to begin elsewhere
    static constexpr bool WARM = Q == 3 && !Face::BOWED;
    // relative gap at which another relaxation may begin; least slack there, and share of the mean product
    static constexpr double FAR = 0.5, SPACE = 1e-3, SHARE = 0.1;
    // relative gap and error of jumps at which a motion is good enough where it refutes
    static constexpr double GOOD = 1e-5;
    // lanes that may idle before motions are weighed: a weighing takes as long however many there are
    static constexpr int IDLE = W > 3 ? 3 : W;
    const JldProblem& p;
    const JldTry& how;
    const JldShrinking& s;
    Sides<Q> sides;
    const Shared<Q> shared;
    Work<Face> work, ready;
    std::vector<Store<Face>> sheet;  // faces as inner and as dry ones
    std::vector<std::unique_ptr<Job>> jobs;
    std::deque<Job*> queue;
    Job* in_lane[W];
    Job* parked[W];
    int age[W], waiting = 0, busy = 0;
    Store<Lane> u, v, cost;
    double gate = 0.0;  // margin of the motion that opens all, whatever the label

    Shrink(const JldProblem& problem, const JldTry& settings, const JldShrinking& asked)
        : p(problem), how(settings), s(asked), sides{problem}, shared(problem), work(problem), ready(problem), sheet(2, Store<Face>(problem.faces)),
          u(Q * problem.elements), v(Q * problem.elements), cost(problem.faces) {
        std::vector<uint8_t> labels(p.faces);
        for (int label = 0; label < 2; ++label) {
            labels.assign(p.faces, label);
            for (int i = 0; i < W; ++i) work.put(p, i, labels.data(), how);
            sheet[label] = work.face;
        }
        if (!p.opening) return;
        for (size_t k = 0; k < v.size(); ++k) v[k] = splat(p.opening[k]);
        Lane least = splat(1e300);
        for (int f = 0; f < p.faces; ++f) {
            Lane jump[Q], margin, spent;
            sides.jump(f, v.data(), splat(1.0), jump);
            for (auto& faces : sheet) faces[f].dissipation(jump, margin, spent), least = smaller(least, margin);
        }
        gate = lanes_of(least)[0];
    }

    Job* begin(int64_t row, const uint8_t* labels, double threshold, bool drawn) {
        jobs.emplace_back(new Job{row, labels, threshold, drawn, {}, {}, {}, {}});
        Job* job = jobs.back().get();
        job->asked.assign(labels, labels + p.faces), job->tried.assign(p.faces, 0), job->cost.resize(p.faces);
        queue.push_back(job);
        return job;
    }

    void fill(int lane) {
        in_lane[lane] = nullptr;
        if (queue.empty()) return;
        Job* job = queue.front();
        queue.pop_front();
        in_lane[lane] = job, age[lane] = 0, ++busy, ++job->relaxations;
        job->passed.clear();
        if constexpr (WARM)
            if (!job->start.empty())
                return work.resume(p, lane, job->asked.data(), how, job->start.data(), SPACE, SHARE * job->product);
        work.put(p, lane, job->asked.data(), how);
    }

    void run() {
        for (int64_t k = 0; k < s.count; ++k) {
            const uint8_t* labels = s.labels + k * p.faces;
            begin(k * (1 + s.neighbours), labels, s.thresholds[k], true);
        }
        Interior<Face> interior(p, how, work);
        for (int i = 0; i < W; ++i) fill(i);
        while (busy) {
            Measures m;
            interior.step(m, false);
            for (int i = 0; i < W; ++i)
                if (in_lane[i]) look(i, m);
            // nobody waits for what may be decided now
            if (waiting && queue.empty() && W - busy >= IDLE) settle();
            for (int i = 0; i < W; ++i)
                if (!in_lane[i]) fill(i);
        }
    }

    void look(int i, Measures& m) {
        Job* job = in_lane[i];
        ++age[i];
        double gap = lanes_of(m.gap)[i], balance = lanes_of(m.balance)[i], jumps = lanes_of(m.jumps)[i];
        double load = lanes_of(work.load)[i], dual = lanes_of(m.dual)[i], speed = lanes_of(m.speed)[i];
        double size = std::fabs(load) > 1e-4 ? std::fabs(load) : 1e-4;
        bool carries = load > job->threshold && (balance <= s.balance || m.admissible(i));
        double target = job->thorough ? how.target : GOOD, error = job->thorough ? how.jumps : GOOD;
        bool solved = gap <= 2.0 * target * size && jumps <= error * (1.0 + speed);
        if constexpr (WARM)
            if (job->passed.empty() && gap < FAR * size && m.admissible(i)) {
                work.save(i, job->passed);
                job->further = gap / (Face::ROWS * p.faces + 1);
            }
        bool falls = dual < -1e-6 && jumps <= 1e-10 * (1.0 + speed);
        bool lost = !(gap < 1e30) || !(speed < 1e30) || age[i] >= how.most;
        if (carries) {
            leave(i);
            advance(job, false, JLD_CARRIED);
        } else if (solved || falls || lost) {
            ready.copy(work, i, waiting);
            parked[waiting++] = job;
            leave(i);
            if (waiting == W) settle();
        }
    }

    void leave(int lane) { in_lane[lane] = nullptr, --busy; }

    // What parked motions spend at the least, face by face, and what that would be more of without a label.
    void measure(Lane& least, Lane& total) {
        least = splat(1e300), total = splat(0.0);
        for (int f = 0; f < p.faces; ++f) {
            Lane jump[Q], m[2], d[2], dry = splat(0.0), free = splat(0.0);
            sides.jump(f, u.data(), splat(1.0), jump);
            for (int label = 0; label < 2; ++label) {
                sheet[label][f].dissipation(jump, m[label], d[label]);
                d[label] = select(m[label] >= 0.0, d[label], splat(1e300));
            }
            for (int i = 0; i < waiting; ++i) {
                uint8_t label = parked[i]->asked[f];
                lanes_of(dry)[i] = label == JLD_DRY, lanes_of(free)[i] = label == JLD_UNDECIDED;
            }
            Lane either = larger(d[0], d[1]), own = select(dry > 0.0, d[1], d[0]), margin = select(dry > 0.0, m[1], m[0]);
            own = select(free > 0.0, either, own), margin = select(free > 0.0, smaller(m[0], m[1]), margin);
            least = select(margin >= least, least, margin);
            total += own;
            cost[f] = either - own;
        }
    }

    void settle() {
        const size_t n = u.size();
        Proof<Face> proof(p, how, shared, ready);
        proof.motion();
        for (size_t k = 0; k < n; ++k) u[k] = proof.best[k];
        Lane fastest = splat(0.0), least, total;
        for (size_t k = 0; k < n; ++k) fastest = larger(fastest, absolute(u[k]));
        Lane by = 1.0 / select(fastest > 0.0, fastest, splat(1.0));
        for (size_t k = 0; k < n; ++k) u[k] *= by;
        measure(least, total);
        for (int round = 0; round < 3 && gate > 0.0; ++round) {
            Mask lacks = least < 1e-16;
            bool any = false;
            for (int i = 0; i < waiting; ++i) any |= lanes_of(least)[i] < 1e-16;
            if (!any) break;
            Lane share = select(lacks & (least > -1.0), (1.0 + round) * (2e-16 - least) / gate, splat(0.0));
            for (size_t k = 0; k < n; ++k) u[k] += share * p.opening[k];
            measure(least, total);
        }
        Lane work_done = splat(0.0), heavy = splat(0.0), own = splat(0.0);
        double weight = 0.0;
        fastest = splat(0.0);
        for (size_t k = 0; k < n; ++k) {
            Lane fast = absolute(u[k]);
            work_done += p.live[k] * u[k], own += p.dead[k] * u[k], heavy += std::fabs(p.dead[k]) * fast;
            fastest = larger(fastest, fast), weight += std::fabs(p.dead[k]);
        }
        total -= own;
        Lane noise = p.noise * (heavy + absolute(total) + 1e-3 * weight * fastest);
        const int done = waiting;
        waiting = 0;
        Job* all[W];
        for (int i = 0; i < done; ++i) all[i] = parked[i];
        for (int i = 0; i < done; ++i) {
            Job* job = all[i];
            double spent = lanes_of(total)[i] + lanes_of(noise)[i], works = lanes_of(work_done)[i];
            double excess = job->threshold * works - spent;
            if (!(lanes_of(least)[i] >= 0.0 && spent < 1e200 && works >= 0.0 && excess > 0.0)) {
                if (job->thorough) advance(job, false, JLD_LEFT);
                else job->thorough = true, begin_at_passed(job), queue.push_back(job);
                continue;
            }
            job->excess = excess;
            job->velocity.resize(n);
            for (size_t k = 0; k < n; ++k) job->velocity[k] = lanes_of(u[k])[i];
            for (int f = 0; f < p.faces; ++f) job->cost[f] = lanes_of(cost[f])[i];
            advance(job, true, JLD_REFUTED);
        }
    }

    void begin_at_passed(Job* job) {
        if (job->passed.empty()) return;
        job->start.swap(job->passed), job->product = job->further;
        if (job->first.empty() && s.neighbours) job->first = job->start, job->earliest = job->product;
    }

    // What is asked next, once it is known whether the last relaxation refuted.
    void advance(Job* job, bool refuted, JldFate fate) {
        const bool whole = job->refuted || refuted, together = job->alone < 0;
        if (!whole) return finish(job, fate);
        if (!refuted) {
            if (together) return finish(job, JLD_REFUTED);  // the mechanism before still stands
            job->asked[job->alone] = job->labels[job->alone];
            ++job->vain;
        }
        job->refuted = true, job->alone = -1, job->thorough = false;
        if (refuted) begin_at_passed(job);
        std::vector<std::pair<double, int>> order;
        order.reserve(p.faces);
        for (int f = 0; f < p.faces; ++f)
            if (s.free[f] && job->asked[f] != JLD_UNDECIDED) order.emplace_back(job->cost[f], f);
        std::sort(order.begin(), order.end());
        if (refuted) {
            double spare = job->excess;
            bool freed = false;
            for (auto& [_, f] : order) {
                if (!(job->cost[f] < spare)) break;
                spare -= job->cost[f], job->asked[f] = JLD_UNDECIDED, freed = true;
            }
            job->excess = spare;
            if (freed) return queue.push_back(job);
        }
        // inner faces that the mechanism needs are tried before dry ones where that is asked for
        for (int pass = 0; pass < 2 && job->vain < s.tries; ++pass)
            for (auto& [_, f] : order)
                if (!job->tried[f] && (!s.inner || pass == job->labels[f])) {
                    job->tried[f] = 1, job->asked[f] = JLD_UNDECIDED, job->alone = f;
                    return queue.push_back(job);
                }
        finish(job, JLD_REFUTED);
    }

    void finish(Job* job, JldFate fate) {
        s.fate[job->row] = fate;
        s.relaxations[job->row] = job->relaxations;
        uint8_t* decided = s.conflict + job->row * p.faces;
        for (int f = 0; f < p.faces; ++f) decided[f] = s.free[f] && job->asked[f] != JLD_UNDECIDED;
        if (fate == JLD_REFUTED) {
            std::memcpy(s.velocity + job->row * u.size(), job->velocity.data(), 8 * u.size());
            if (job->drawn && s.neighbours) spawn(job, decided);
        }
        job->asked = {}, job->tried = {}, job->cost = {}, job->velocity = {}, job->start = {}, job->passed = {}, job->first = {};
    }

    // The same labelling with one face of its conflict undecided from the start.
    void spawn(const Job* job, const uint8_t* conflict) {
        std::vector<int> inside;
        for (int f = 0; f < p.faces; ++f)
            if (conflict[f]) inside.push_back(f);
        uint64_t state = s.seed + 0x9e3779b97f4a7c15ull * (job->row + 1);
        for (int k = 0; k < s.neighbours && !inside.empty(); ++k) {
            state ^= state << 13, state ^= state >> 7, state ^= state << 17;
            size_t at = (state >> 11) % inside.size();
            Job* next = begin(job->row + 1 + k, job->labels, job->threshold, false);
            next->asked[inside[at]] = JLD_UNDECIDED;
            next->start = job->first, next->product = job->earliest;
            inside.erase(inside.begin() + at);
        }
    }
};

}  // namespace jld
