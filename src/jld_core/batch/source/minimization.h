// Conflict minimisation: undecide faces of labellings below their thresholds, (6.4), one relaxation (6.3) after another
// in the next free lane.
//
// A relaxation ends early where its forces are admissible and carry more than the threshold. A mechanism that refutes
// is iterated until it is accurate: stopping as soon as it refutes frees fewer faces and causes more conflicts. The
// next relaxation differs in few faces, so it starts from an iterate that was still far from all rows.
#pragma once
#include <algorithm>
#include <cstring>
#include <deque>
#include <memory>

#include "proof.h"

namespace jld {

struct MinimizationJob {
    int64_t row;
    const uint8_t* labels;
    double threshold;
    bool drawn;
    std::vector<uint8_t> asked;  // (faces) JldLabel of the next relaxation
    std::vector<uint8_t> tried;  // (faces) 1 where tried as a single face
    // (faces) increase of the dissipation if the face is undecided, under the present mechanism.
    std::vector<double> cost;
    std::vector<double> velocity;  // present mechanism
    // Stored states: start of this relaxation (empty: default), of the next one, and of those of neighbours.
    std::vector<double> start, passed, first;
    double product = 0.0, further = 0.0, earliest = 0.0;  // mean product of a slack and its multiplier in each
    bool thorough = false;                                // iterate to full accuracy
    double excess = 0.0;
    bool refuted = false;
    int alone = -1, vain = 0, relaxations = 0;
};

template <class Face>
struct ConflictMinimization {
    static constexpr int FREEDOMS = Face::FREEDOMS;
    // Only linear rows can start from a stored state.
    static constexpr bool WARM = FREEDOMS == 3 && !Face::PARABOLIC;
    // Relative gap at which a state is stored; least slack there; share of the mean product.
    static constexpr double FAR = 0.5, SPACE = 1e-3, SHARE = 0.1;
    // Relative gap and error of the jumps at which a mechanism that refutes is accepted.
    static constexpr double GOOD = 1e-5;
    // Idle lanes up to which mechanisms wait to be evaluated together; the time does not depend on their number.
    static constexpr int IDLE = LANES > 3 ? 3 : LANES;
    const JldProblem& problem;
    const JldTry& how;
    const JldMinimization& request;
    Sides<FREEDOMS> sides;
    const Shared<FREEDOMS> shared;
    Workspace<Face> work, ready;
    std::vector<Store<Face>> sheet;  // all faces as inner, and as dry ones
    std::vector<std::unique_ptr<MinimizationJob>> jobs;
    std::deque<MinimizationJob*> queue;
    MinimizationJob* in_lane[LANES];
    MinimizationJob* parked[LANES];
    int age[LANES], waiting = 0, busy = 0;
    Store<Lane> velocity, opening, cost;
    double gate = 0.0;  // least margin of the opening motion under either label, (3.11)

    ConflictMinimization(const JldProblem& problem, const JldTry& settings, const JldMinimization& asked)
        : problem(problem),
          how(settings),
          request(asked),
          sides{problem},
          shared(problem),
          work(problem),
          ready(problem),
          sheet(2, Store<Face>(problem.faces)),
          velocity(FREEDOMS * problem.elements),
          opening(FREEDOMS * problem.elements),
          cost(problem.faces) {
        std::vector<uint8_t> labels(problem.faces);
        for (int label = 0; label < 2; ++label) {
            labels.assign(problem.faces, label);
            for (int i = 0; i < LANES; ++i) work.put(problem, i, labels.data(), how);
            sheet[label] = work.face;
        }
        if (!problem.opening) return;
        for (size_t k = 0; k < opening.size(); ++k) opening[k] = splat(problem.opening[k]);
        Lane least = splat(1e300);
        for (int f = 0; f < problem.faces; ++f) {
            Lane jump[FREEDOMS], margin, spent;
            sides.jump(f, opening.data(), splat(1.0), jump);
            for (auto& faces : sheet) faces[f].dissipation(jump, margin, spent), least = smaller(least, margin);
        }
        gate = lanes_of(least)[0];
    }

    MinimizationJob* begin(int64_t row, const uint8_t* labels, double threshold, bool drawn) {
        jobs.emplace_back(new MinimizationJob{row, labels, threshold, drawn, {}, {}, {}, {}});
        MinimizationJob* job = jobs.back().get();
        job->asked.assign(labels, labels + problem.faces), job->tried.assign(problem.faces, 0),
            job->cost.resize(problem.faces);
        queue.push_back(job);
        return job;
    }

    void fill(int lane) {
        in_lane[lane] = nullptr;
        if (queue.empty()) return;
        MinimizationJob* job = queue.front();
        queue.pop_front();
        in_lane[lane] = job, age[lane] = 0, ++busy, ++job->relaxations;
        job->passed.clear();
        if constexpr (WARM)
            if (!job->start.empty())
                return work.resume(problem, lane, job->asked.data(), how, job->start.data(), SPACE,
                                   SHARE * job->product);
        work.put(problem, lane, job->asked.data(), how);
    }

    void run() {
        for (int64_t k = 0; k < request.count; ++k) {
            const uint8_t* labels = request.labels + k * problem.faces;
            begin(k * (1 + request.neighbours), labels, request.thresholds[k], true);
        }
        Interior<Face> interior(problem, how, work);
        for (int i = 0; i < LANES; ++i) fill(i);
        while (busy) {
            Measures m;
            interior.step(m, false);
            for (int i = 0; i < LANES; ++i)
                if (in_lane[i]) look(i, m);
            // Evaluate waiting mechanisms where lanes would idle otherwise.
            if (waiting && queue.empty() && LANES - busy >= IDLE) settle();
            for (int i = 0; i < LANES; ++i)
                if (!in_lane[i]) fill(i);
        }
    }

    void look(int i, Measures& m) {
        MinimizationJob* job = in_lane[i];
        ++age[i];
        double gap = lanes_of(m.gap)[i], balance = lanes_of(m.balance)[i], jumps = lanes_of(m.jumps)[i];
        double load = lanes_of(work.load)[i], dual = lanes_of(m.dual)[i], speed = lanes_of(m.speed)[i];
        double size = std::fabs(load) > 1e-4 ? std::fabs(load) : 1e-4;
        bool carries = load > job->threshold && (balance <= request.balance || m.admissible(i));
        double target = job->thorough ? how.target : GOOD, error = job->thorough ? how.jumps : GOOD;
        bool solved = gap <= 2.0 * target * size && jumps <= error * (1.0 + speed);
        if constexpr (WARM)
            if (job->passed.empty() && gap < FAR * size && m.admissible(i)) {
                work.save(i, job->passed);
                job->further = gap / (Face::ROWS * problem.faces + 1);
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
            if (waiting == LANES) settle();
        }
    }

    void leave(int lane) { in_lane[lane] = nullptr, --busy; }

    // Compute least margin and total dissipation of the waiting mechanisms, and the cost of undeciding each face,
    // (6.3).
    void measure(Lane& least, Lane& total) {
        least = splat(1e300), total = splat(0.0);
        for (int f = 0; f < problem.faces; ++f) {
            Lane jump[FREEDOMS], m[2], d[2], dry = splat(0.0), free = splat(0.0);
            sides.jump(f, velocity.data(), splat(1.0), jump);
            for (int label = 0; label < 2; ++label) {
                sheet[label][f].dissipation(jump, m[label], d[label]);
                d[label] = select(m[label] >= 0.0, d[label], splat(1e300));
            }
            for (int i = 0; i < waiting; ++i) {
                uint8_t label = parked[i]->asked[f];
                lanes_of(dry)[i] = label == JLD_DRY, lanes_of(free)[i] = label == JLD_UNDECIDED;
            }
            Lane either = larger(d[0], d[1]), own = select(dry > 0.0, d[1], d[0]),
                 margin = select(dry > 0.0, m[1], m[0]);
            own = select(free > 0.0, either, own), margin = select(free > 0.0, smaller(m[0], m[1]), margin);
            least = select(margin >= least, least, margin);
            total += own;
            cost[f] = either - own;
        }
    }

    void settle() {
        const size_t n = velocity.size();
        Proof<Face> proof(problem, how, shared, ready);
        proof.motion();
        for (size_t k = 0; k < n; ++k) velocity[k] = proof.best[k];
        Lane fastest = splat(0.0), least, total;
        for (size_t k = 0; k < n; ++k) fastest = larger(fastest, absolute(velocity[k]));
        Lane by = 1.0 / select(fastest > 0.0, fastest, splat(1.0));
        for (size_t k = 0; k < n; ++k) velocity[k] *= by;
        measure(least, total);
        for (int round = 0; round < 3 && gate > 0.0; ++round) {
            Mask lacks = least < 1e-16;
            bool any = false;
            for (int i = 0; i < waiting; ++i) any |= lanes_of(least)[i] < 1e-16;
            if (!any) break;
            Lane share = select(lacks & (least > -1.0), (1.0 + round) * (2e-16 - least) / gate, splat(0.0));
            for (size_t k = 0; k < n; ++k) velocity[k] += share * problem.opening[k];
            measure(least, total);
        }
        Lane work_done = splat(0.0), heavy = splat(0.0), own = splat(0.0);
        double weight = 0.0;
        fastest = splat(0.0);
        for (size_t k = 0; k < n; ++k) {
            Lane fast = absolute(velocity[k]);
            work_done += problem.live[k] * velocity[k], own += problem.dead[k] * velocity[k],
                heavy += std::fabs(problem.dead[k]) * fast;
            fastest = larger(fastest, fast), weight += std::fabs(problem.dead[k]);
        }
        total -= own;
        Lane noise = problem.noise * (heavy + absolute(total) + 1e-3 * weight * fastest);
        const int done = waiting;
        waiting = 0;
        MinimizationJob* all[LANES];
        for (int i = 0; i < done; ++i) all[i] = parked[i];
        for (int i = 0; i < done; ++i) {
            MinimizationJob* job = all[i];
            double spent = lanes_of(total)[i] + lanes_of(noise)[i], works = lanes_of(work_done)[i];
            double excess = job->threshold * works - spent;
            if (!(lanes_of(least)[i] >= 0.0 && spent < 1e200 && works >= 0.0 && excess > 0.0)) {
                if (job->thorough) advance(job, false, JLD_LEFT);
                else job->thorough = true, begin_at_passed(job), queue.push_back(job);
                continue;
            }
            job->excess = excess;
            job->velocity.resize(n);
            for (size_t k = 0; k < n; ++k) job->velocity[k] = lanes_of(velocity[k])[i];
            for (int f = 0; f < problem.faces; ++f) job->cost[f] = lanes_of(cost[f])[i];
            advance(job, true, JLD_REFUTED);
        }
    }

    void begin_at_passed(MinimizationJob* job) {
        if (job->passed.empty()) return;
        job->start.swap(job->passed), job->product = job->further;
        if (job->first.empty() && request.neighbours) job->first = job->start, job->earliest = job->product;
    }

    // Choose the next relaxation once it is known whether the last one refuted.
    void advance(MinimizationJob* job, bool refuted, JldFate fate) {
        const bool whole = job->refuted || refuted, together = job->alone < 0;
        if (!whole) return finish(job, fate);
        if (!refuted) {
            if (together) return finish(job, JLD_REFUTED);  // the mechanism before remains valid
            job->asked[job->alone] = job->labels[job->alone];
            ++job->vain;
        }
        job->refuted = true, job->alone = -1, job->thorough = false;
        if (refuted) begin_at_passed(job);
        std::vector<std::pair<double, int>> order;
        order.reserve(problem.faces);
        for (int f = 0; f < problem.faces; ++f)
            if (request.free[f] && job->asked[f] != JLD_UNDECIDED) order.emplace_back(job->cost[f], f);
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
        // Try inner faces before dry ones if the request says so.
        for (int pass = 0; pass < 2 && job->vain < request.tries; ++pass)
            for (auto& [_, f] : order)
                if (!job->tried[f] && (!request.inner || pass == job->labels[f])) {
                    job->tried[f] = 1, job->asked[f] = JLD_UNDECIDED, job->alone = f;
                    return queue.push_back(job);
                }
        finish(job, JLD_REFUTED);
    }

    void finish(MinimizationJob* job, JldFate fate) {
        request.fate[job->row] = fate;
        request.relaxations[job->row] = job->relaxations;
        uint8_t* decided = request.conflict + job->row * problem.faces;
        for (int f = 0; f < problem.faces; ++f) decided[f] = request.free[f] && job->asked[f] != JLD_UNDECIDED;
        if (fate == JLD_REFUTED) {
            std::memcpy(request.velocity + job->row * velocity.size(), job->velocity.data(), 8 * velocity.size());
            if (job->drawn && request.neighbours) spawn(job, decided);
        }
        job->asked = {}, job->tried = {}, job->cost = {}, job->velocity = {}, job->start = {}, job->passed = {},
        job->first = {};
    }

    // Begin neighbours: the same labelling with one face of its conflict undecided from the start.
    void spawn(const MinimizationJob* job, const uint8_t* conflict) {
        std::vector<int> inside;
        for (int f = 0; f < problem.faces; ++f)
            if (conflict[f]) inside.push_back(f);
        uint64_t state = request.seed + 0x9e3779b97f4a7c15ull * (job->row + 1);
        for (int k = 0; k < request.neighbours && !inside.empty(); ++k) {
            state ^= state << 13, state ^= state >> 7, state ^= state << 17;
            size_t at = (state >> 11) % inside.size();
            MinimizationJob* next = begin(job->row + 1 + k, job->labels, job->threshold, false);
            next->asked[inside[at]] = JLD_UNDECIDED;
            next->start = job->first, next->product = job->earliest;
            inside.erase(inside.begin() + at);
        }
    }
};

}  // namespace jld
