// Bounds on lambda of many labellings, pass by pass.
#pragma once
#include "edge.h"
#include "proof.h"
#include "ray.h"

namespace jld {

template <class Face>
struct LabellingBounds {
    static constexpr int FREEDOMS = Face::FREEDOMS;
    static constexpr double NOTHING = 1e-9;  // share of `zero` that cannot be distinguished from zero
    // Least slack and relative gap where a pass begins at the end of the last one.
    static constexpr double SPACE = 1e-8, SHARE = 1e-7;
    const JldProblem& problem;
    const JldTry* tries;
    int count_of_tries;
    const JldAnswers& out;
    const uint8_t* labels;
    const double* thresholds;
    const Shared<FREEDOMS> shared;
    Workspace<Face> work, ready;
    int64_t in_lane[LANES], in_ready[LANES];
    int age[LANES], waiting = 0, turn = 0;
    std::vector<int64_t> next;
    std::vector<std::vector<double>> kept;  // where the iterations of each open labelling have ended
    std::vector<uint8_t> grows, endless;  // forces seem to grow without bound; a ray is proven
    const Recession<Face> recession;
    int64_t total = 0;

    LabellingBounds(const JldProblem& problem, const JldTry* settings, int tries_, const uint8_t* bits,
                    const double* least, const JldAnswers& answers)
        : problem(problem),
          tries(settings),
          count_of_tries(tries_),
          out(answers),
          labels(bits),
          thresholds(least),
          shared(problem),
          work(problem),
          ready(problem),
          recession(problem) {}

    void settle() {
        if constexpr (FREEDOMS == 3 && !Face::PARABOLIC)
            if (tries[turn].aim == 0.0) return at_edges();
        if (tries[turn].aim < 0.0) return along_rays();
        Proof<Face> proof(problem, tries[turn], shared, ready);
        ready.held = ready.velocity;  // the proof moves velocities
        proof.run();
        std::swap(ready.held, ready.velocity);
        for (int i = 0; i < waiting; ++i) {
            int64_t who = in_ready[i];
            double low = lanes_of(proof.low)[i], high = lanes_of(proof.high)[i];
            bool falls = is_set(proof.falls, i);
            bool better = low > out.low[who], lower = high < out.high[who];
            if (better) out.low[who] = low;
            if (lower) out.high[who] = high;
            if (falls) out.verdict[who] = JLD_FALLS;
            if (out.diagnosis) {
                double* d = out.diagnosis + 4 * who;
                d[0] = lanes_of(proof.slack)[i], d[1] = lanes_of(proof.error)[i], d[2] = lanes_of(proof.margin)[i];
            }
            if (out.forces && better)
                for (int f = 0; f < problem.faces; ++f)
                    for (int k = 0; k < FREEDOMS; ++k)
                        out.forces[(who * problem.faces + f) * FREEDOMS + k] = lanes_of(ready.face[f].force[k])[i];
            if (out.velocity && (lower || falls))
                for (int k = 0; k < FREEDOMS * problem.elements; ++k)
                    out.velocity[who * FREEDOMS * problem.elements + k] = lanes_of(proof.best[k])[i];
            judge(who);
            if (out.verdict[who] == JLD_OPEN) {
                // Forces may grow without bound where no motion gives an upper bound.
                if (!(out.high[who] < 1e300)) grows[who] = 1;
                next.push_back(who);
                keep(who, i);
            }
        }
        waiting = 0;
    }

    // Keep where an open labelling has ended, for the passes that begin there.
    void keep(int64_t who, int lane) {
        if constexpr (FREEDOMS == 3) {
            if (turn + 1 >= count_of_tries) return;
            ready.save(lane, kept[who]);
            if (!(std::fabs(lanes_of(ready.load)[lane]) < 1e30)) kept[who].clear();
        }
    }

    void at_edges() {
        Edge<Face::PAIR_COUNT> edge(problem, ready);
        Lane load = splat(0.0);
        for (int i = 0; i < waiting; ++i) {
            const std::vector<double>& from = kept[in_ready[i]];
            if (from.empty()) continue;
            for (int f = 0; f < problem.faces; ++f)
                for (int k = 0; k < 3; ++k) lanes_of(ready.face[f].force_step[k])[i] = from[(3 + Face::ROWS) * f + k];
            lanes_of(load)[i] = from[from.size() - 3];
        }
        edge.run(load);
        for (int i = 0; i < waiting; ++i) {
            int64_t who = in_ready[i];
            double low = lanes_of(edge.low)[i];
            if (low > out.low[who]) {
                out.low[who] = low;
                if (out.forces)
                    for (int k = 0; k < 3 * problem.faces; ++k)
                        out.forces[who * 3 * problem.faces + k] = lanes_of(edge.best[k])[i];
            }
            judge(who);
            if (out.verdict[who] == JLD_OPEN) next.push_back(who);
        }
        waiting = 0;
    }

    void along_rays() {
        Ray<Face> ray(recession.problem, ready);
        ray.run();
        for (int i = 0; i < waiting; ++i) {
            int64_t who = in_ready[i];
            endless[who] = is_set(ray.found, i);
            if (out.rays && endless[who])
                for (int f = 0; f < problem.faces; ++f)
                    for (int k = 0; k < FREEDOMS; ++k)
                        out.rays[(who * problem.faces + f) * FREEDOMS + k] = lanes_of(ready.face[f].force[k])[i];
            judge(who);
            if (out.verdict[who] == JLD_OPEN) next.push_back(who);
        }
        waiting = 0;
    }

    void judge(int64_t who) {
        // A lambda of the size of rounding is zero.
        if (out.low[who] > 0.0 && out.low[who] <= NOTHING * problem.zero) out.low[who] = 0.0;
        if (out.high[who] < 0.0 && out.high[who] >= -NOTHING * problem.zero) out.high[who] = 0.0;
        double low = std::fabs(out.low[who]), high = std::fabs(out.high[who]), size = low > high ? low : high;
        if (out.low[who] <= 0.0 && out.high[who] >= 0.0 && size < problem.zero) size = problem.zero;
        // Contradicting proofs prove nothing.
        int32_t& verdict = out.verdict[who];
        if (verdict == JLD_FALLS && out.low[who] >= 0.0) verdict = JLD_OPEN;
        if (verdict == JLD_OPEN && thresholds && out.low[who] > thresholds[who]) verdict = JLD_CARRIES;
        if (verdict == JLD_OPEN && size < 1e30 && out.high[who] - out.low[who] <= problem.gap * size)
            verdict = JLD_PROVEN;
        if (verdict == JLD_OPEN && endless[who] && out.low[who] > -1e30) verdict = JLD_LOCKED;
    }

    // Begin where the last pass has ended, with products of slacks and multipliers raised to SHARE of a gap of lambda.
    void resume(const JldProblem& now, int lane, const JldTry& how) {
        const std::vector<double>& from = kept[in_lane[lane]];
        const double load = std::fabs(from[from.size() - 3]), size = load > 1e-4 ? load : 1e-4;
        work.resume(now, lane, labels + in_lane[lane] * problem.faces, how, from.data(), SPACE,
                    SHARE * size / (Face::ROWS * problem.faces + 1));
    }

    void pass(std::vector<int64_t> todo) {
        const JldTry& how = tries[turn];
        const JldProblem& now = how.aim < 0.0 ? recession.problem : problem;
        if (how.aim < 0.0) {
            // Look for rays where forces grow; all other labellings wait for the next pass.
            std::vector<int64_t> some;
            for (int64_t who : todo) (grows[who] && !Face::PARABOLIC ? some : next).push_back(who);
            todo = some;
        }
        if (how.resumes) {
            // Without a state to begin at, as after a factor that broke down, a labelling waits for the next pass.
            std::vector<int64_t> some;
            for (int64_t who : todo) (kept[who].empty() ? next : some).push_back(who);
            todo = some;
        }
        Interior<Face> interior(now, how, work);
        size_t given = 0;
        int busy = 0;
        for (int i = 0; i < LANES; ++i) in_lane[i] = -1;
        auto fill = [&](int i) {
            if (given == todo.size()) {
                in_lane[i] = -1;
                return;
            }
            in_lane[i] = todo[given++], age[i] = 0, ++busy;
            work.put(now, i, labels + in_lane[i] * problem.faces, how);
            if constexpr (FREEDOMS == 3)
                if (how.resumes) resume(now, i, how);
            ++out.tries[in_lane[i]];
        };
        for (int i = 0; i < LANES; ++i) fill(i);
        while (busy) {
            Measures m;
            interior.step(m);
            for (int i = 0; i < LANES; ++i) {
                if (in_lane[i] < 0) continue;
                ++age[i];
                double gap = lanes_of(m.gap)[i], balance = lanes_of(m.balance)[i], jumps = lanes_of(m.jumps)[i];
                double load = lanes_of(work.load)[i], dual = lanes_of(m.dual)[i], speed = lanes_of(m.speed)[i];
                double size = std::fabs(load) > 1e-4 ? std::fabs(load) : 1e-4;
                bool solved = gap <= 2.0 * how.target * size && balance <= 5e-11 && jumps <= how.jumps * (1.0 + speed);
                bool falls = how.aim > 0.0 && dual < -1e-6 && jumps <= 1e-10 * (1.0 + speed);
                // Stop where admissible forces carry more than the threshold.
                bool carries = thresholds && load > thresholds[in_lane[i]] && m.admissible(i);
                bool ray = how.aim < 0.0 && load <= -0.5 && balance <= 1e-9;
                // Detect that no motion approaches finite dissipation.
                bool free = jumps > 1e-3 * (1.0 + speed) && how.endless < 1e30;
                bool far = load > how.endless * (1.0 + std::fabs(problem.load)) || gap < 1e-2 * load;
                bool runs = how.aim > 0.0 && age[i] > 6 && free && far && balance <= 1e-6;
                bool lost = !(gap < 1e30) || !(speed < 1e30);
                if (runs || (free && age[i] >= how.most)) grows[in_lane[i]] = 1;
                if (solved || falls || carries || ray || runs || lost || age[i] >= how.most) {
                    out.iterations[in_lane[i]] += age[i];
                    if (out.diagnosis) out.diagnosis[4 * in_lane[i] + 3] = gap;
                    in_ready[waiting] = in_lane[i];
                    ready.copy(work, i, waiting++);
                    if (waiting == LANES) settle();
                    --busy;
                    fill(i);
                }
            }
        }
        if (waiting) settle();
    }

    void run(int64_t count) {
        total = count;
        std::vector<int64_t> todo(count);
        grows.assign(count, 0), endless.assign(count, 0), kept.resize(count);
        for (int64_t k = 0; k < count; ++k) {
            todo[k] = k;
            out.low[k] = -std::numeric_limits<double>::infinity(), out.high[k] = -out.low[k];
            out.verdict[k] = JLD_OPEN, out.iterations[k] = out.tries[k] = 0;
        }
        for (turn = 0; turn < count_of_tries && !todo.empty(); ++turn) {
            next.clear();
            pass(todo);
            todo = next;
        }
    }
};

}  // namespace jld
