// The C interface: labellings in, bounds out.
#include <algorithm>
#include <cstring>

#include "blocks.h"
#include "edge.h"
#include "parts.h"
#include "proof.h"
#include "ray.h"
#include "shrink.h"

namespace jld {

template <class Face>
struct Run {
    static constexpr int Q = Face::Q;
    static constexpr double NOTHING = 1e-9;  // of what counts as zero: share that cannot be told from it
    const JldProblem& p;
    const JldTry* tries;
    int count_of_tries;
    const JldAnswers& out;
    const uint8_t* labels;
    const double* thresholds;
    const Shared<Q> shared;
    Work<Face> work, ready;
    int64_t in_lane[W], in_ready[W];
    int age[W], waiting = 0, turn = 0;
    std::vector<int64_t> next, place;
    std::vector<double> kept;
    std::vector<uint8_t> grows, endless;  // forces seem to grow for ever; a ray is proven
    const Recession<Face> recession;
    int64_t total = 0;

    Run(const JldProblem& problem, const JldTry* settings, int tries_, const uint8_t* bits,
        const double* least, const JldAnswers& answers)
        : p(problem), tries(settings), count_of_tries(tries_), out(answers), labels(bits), thresholds(least), shared(problem),
          work(problem), ready(problem), recession(problem) {}

    void settle() {
        if constexpr (Q == 3 && !Face::BOWED)
            if (tries[turn].aim == 0.0) return at_edges();
        if (tries[turn].aim < 0.0) return along_rays();
        Proof<Face> proof(p, tries[turn], shared, ready);
        proof.run();
        for (int i = 0; i < waiting; ++i) {
            int64_t who = in_ready[i];
            double low = lanes_of(proof.low)[i], high = lanes_of(proof.high)[i];
            bool falls = reinterpret_cast<int64_t*>(&proof.falls)[i] != 0;
            bool better = low > out.low[who], lower = high < out.high[who];
            if (better) out.low[who] = low;
            if (lower) out.high[who] = high;
            if (falls) out.verdict[who] = JLD_FALLS;
            if (out.diagnosis) {
                double* d = out.diagnosis + 4 * who;
                d[0] = lanes_of(proof.slack)[i], d[1] = lanes_of(proof.error)[i], d[2] = lanes_of(proof.margin)[i];
            }
            if (out.forces && better)
                for (int f = 0; f < p.faces; ++f)
                    for (int k = 0; k < Q; ++k) out.forces[(who * p.faces + f) * Q + k] = lanes_of(ready.face[f].F[k])[i];
            if (out.velocity && (lower || falls))
                for (int k = 0; k < Q * p.elements; ++k) out.velocity[who * Q * p.elements + k] = lanes_of(proof.best[k])[i];
            judge(who);
            if (out.verdict[who] == JLD_OPEN) {
                // where no motion bounds anything forces may grow
                if (!(out.high[who] < 1e300)) grows[who] = 1;
                next.push_back(who);
                keep(who, i);
            }
        }
        waiting = 0;
    }

    // forces and lambda of what is open, for the try that needs them
    void keep(int64_t who, int lane) {
        if (Q != 3 || turn + 1 >= count_of_tries) return;
        if (place.empty()) place.assign(total, -1);
        const int size = 3 * p.faces + 1;
        if (place[who] < 0) place[who] = kept.size() / size, kept.resize(kept.size() + size);
        double* to = &kept[place[who] * size];
        for (int f = 0; f < p.faces; ++f)
            for (int k = 0; k < 3; ++k) *to++ = lanes_of(ready.face[f].F[k])[lane];
        *to = lanes_of(ready.load)[lane];
    }

    void at_edges() {
        Edge<Face::P> edge(p, ready);
        Lane load = splat(0.0);
        for (int i = 0; i < waiting; ++i) {
            const double* from = &kept[place[in_ready[i]] * (3 * p.faces + 1)];
            for (int f = 0; f < p.faces; ++f)
                for (int k = 0; k < 3; ++k) lanes_of(ready.face[f].dF[k])[i] = *from++;
            lanes_of(load)[i] = *from;
        }
        edge.run(load);
        for (int i = 0; i < waiting; ++i) {
            int64_t who = in_ready[i];
            double low = lanes_of(edge.low)[i];
            if (low > out.low[who]) {
                out.low[who] = low;
                if (out.forces)
                    for (int k = 0; k < 3 * p.faces; ++k) out.forces[who * 3 * p.faces + k] = lanes_of(edge.best[k])[i];
            }
            judge(who);
            if (out.verdict[who] == JLD_OPEN) next.push_back(who);
        }
        waiting = 0;
    }

    void along_rays() {
        Ray<Face> ray(recession.p, ready);
        ray.run();
        for (int i = 0; i < waiting; ++i) {
            int64_t who = in_ready[i];
            endless[who] = reinterpret_cast<int64_t*>(&ray.found)[i] != 0;
            if (out.rays && endless[who])
                for (int f = 0; f < p.faces; ++f)
                    for (int k = 0; k < Q; ++k) out.rays[(who * p.faces + f) * Q + k] = lanes_of(ready.face[f].F[k])[i];
            judge(who);
            if (out.verdict[who] == JLD_OPEN) next.push_back(who);
        }
        waiting = 0;
    }

    void judge(int64_t who) {
        // a lambda that is the rounding of zero is zero
        if (out.low[who] > 0.0 && out.low[who] <= NOTHING * p.zero) out.low[who] = 0.0;
        if (out.high[who] < 0.0 && out.high[who] >= -NOTHING * p.zero) out.high[who] = 0.0;
        double low = std::fabs(out.low[who]), high = std::fabs(out.high[who]), size = low > high ? low : high;
        if (out.low[who] <= 0.0 && out.high[who] >= 0.0 && size < p.zero) size = p.zero;
        // proofs that contradict each other prove nothing
        int32_t& verdict = out.verdict[who];
        if (verdict == JLD_FALLS && out.low[who] >= 0.0) verdict = JLD_OPEN;
        if (verdict == JLD_OPEN && thresholds && out.low[who] > thresholds[who]) verdict = JLD_CARRIES;
        if (verdict == JLD_OPEN && size < 1e30 && out.high[who] - out.low[who] <= p.gap * size) verdict = JLD_PROVEN;
        if (verdict == JLD_OPEN && endless[who] && out.low[who] > -1e30) verdict = JLD_LOCKED;
    }

    void pass(std::vector<int64_t> todo) {
        const JldTry& how = tries[turn];
        const JldProblem& now = how.aim < 0.0 ? recession.p : p;
        if (how.aim < 0.0) {
            // rays where forces grow, all others wait for the next try
            std::vector<int64_t> some;
            for (int64_t who : todo) (grows[who] && !Face::BOWED ? some : next).push_back(who);
            todo = some;
        }
        Interior<Face> interior(now, how, work);
        size_t given = 0;
        int busy = 0;
        for (int i = 0; i < W; ++i) in_lane[i] = -1;
        auto fill = [&](int i) {
            if (given == todo.size()) {
                in_lane[i] = -1;
                return;
            }
            in_lane[i] = todo[given++], age[i] = 0, ++busy;
            work.put(now, i, labels + in_lane[i] * p.faces, how);
            ++out.tries[in_lane[i]];
        };
        for (int i = 0; i < W; ++i) fill(i);
        while (busy) {
            Measures m;
            interior.step(m);
            for (int i = 0; i < W; ++i) {
                if (in_lane[i] < 0) continue;
                ++age[i];
                double gap = lanes_of(m.gap)[i], balance = lanes_of(m.balance)[i], jumps = lanes_of(m.jumps)[i];
                double load = lanes_of(work.load)[i], dual = lanes_of(m.dual)[i], speed = lanes_of(m.speed)[i];
                double size = std::fabs(load) > 1e-4 ? std::fabs(load) : 1e-4;
                bool solved = gap <= 2.0 * how.target * size && balance <= 5e-11 && jumps <= how.jumps * (1.0 + speed);
                bool falls = how.aim > 0.0 && dual < -1e-6 && jumps <= 1e-10 * (1.0 + speed);
                // forces that carry more than matters say all that is asked
                bool carries = thresholds && load > thresholds[in_lane[i]] && m.admissible(i);
                bool ray = how.aim < 0.0 && load <= -0.5 && balance <= 1e-9;
                // no motion comes near what would stop it
                bool free = jumps > 1e-3 * (1.0 + speed) && how.endless < 1e30;
                bool far = load > how.endless * (1.0 + std::fabs(p.load)) || gap < 1e-2 * load;
                bool runs = how.aim > 0.0 && age[i] > 6 && free && far && balance <= 1e-6;
                bool lost = !(gap < 1e30) || !(speed < 1e30);
                if (runs || (free && age[i] >= how.most)) grows[in_lane[i]] = 1;
                if (solved || falls || carries || ray || runs || lost || age[i] >= how.most) {
                    out.iterations[in_lane[i]] += age[i];
                    if (out.diagnosis) out.diagnosis[4 * in_lane[i] + 3] = gap;
                    in_ready[waiting] = in_lane[i];
                    ready.copy(work, i, waiting++);
                    if (waiting == W) settle();
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
        grows.assign(count, 0), endless.assign(count, 0);
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

// Calls with a face of the kind that a problem has; false where there is none.
template <class Call>
bool with_faces(const JldProblem& p, Call call) {
    if (p.freedoms == 6) {
        if (p.pairs == 2) call(SpatialFace<PairBending>{});
        else if (p.pairs == 4) call(SpatialFace<HullBending<4>>{});
        else if (p.pairs == 8) call(SpatialFace<HullBending<8>>{});
        else return false;
    } else if (p.pairs == 2) {
        if (p.bows) call(PlanarFace<2, true>{});
        else call(PlanarFace<2>{});
    } else if (p.pairs == 3) {
        if (p.meets) call(PlanarFace<3, true, true>{});
        else if (p.bows) call(PlanarFace<3, true>{});
        else call(PlanarFace<3>{});
    } else {
        return false;
    }
    return true;
}

}  // namespace jld

extern "C" {

// in the library as text: what was built from other sources is told by it
const char* jld_lanes_sources() { return JLD_SOURCES; }

const char* jld_lanes_variant() { return jld::VARIANT; }
int32_t jld_lanes_width() { return jld::W; }

int32_t jld_lanes_solve(const JldProblem* problem, const JldTry* tries, int32_t count_of_tries, int64_t count,
                        const uint8_t* labels, const double* thresholds, const JldAnswers* answers) {
    try {
        const bool known = jld::with_faces(*problem, [&](auto face) {
            jld::Run<decltype(face)>(*problem, tries, count_of_tries, labels, thresholds, *answers).run(count);
        });
        if (!known) return 2;
        return 0;
    } catch (const std::bad_alloc&) {
        return 1;
    }
}

int32_t jld_lanes_shrink(const JldProblem* problem, const JldTry* how, const JldShrinking* asked) {
    try {
        const bool known = jld::with_faces(
            *problem, [&](auto face) { jld::Shrink<decltype(face)>(*problem, *how, *asked).run(); });
        if (!known) return 2;
        return 0;
    } catch (const std::bad_alloc&) {
        return 1;
    }
}

int32_t jld_lanes_blocks(const JldBlocks* problem, const JldBlockTask* asked) {
    try {
        if (!jld::BlockRun::fits(*problem)) return 2;
        jld::BlockRun(*problem, *asked).run();
        return 0;
    } catch (const std::bad_alloc&) {
        return 1;
    }
}

// names: (count, elements) smallest element in the block of each. always: (joins, 2) elements that are one whatever the
// labels, (faces) a, b: elements of each face, labels: (count, faces) 0 where they are joined.
int32_t jld_blocks(int32_t elements, int32_t joins, const int32_t* always, int32_t faces, const int32_t* a,
                   const int32_t* b, int64_t count, const uint8_t* labels, int64_t* names) {
    try {
        jld::Blocks blocks{std::vector<int64_t>(elements)};
        for (int64_t row = 0; row < count; ++row, labels += faces, names += elements) {
            for (int32_t e = 0; e < elements; ++e) blocks.up[e] = e;
            for (int32_t k = 0; k < joins; ++k) blocks.join(always[2 * k], always[2 * k + 1]);
            for (int32_t f = 0; f < faces; ++f)
                if (!labels[f]) blocks.join(a[f], b[f]);
            for (int32_t e = 0; e < elements; ++e) names[e] = blocks.root(e);
        }
        return 0;
    } catch (const std::bad_alloc&) {
        return 1;
    }
}

// names: (count, atoms) part of each; good: (count) 1 where no part is too small. order: (count, pairs), wanted: (count).
int32_t jld_parts(int32_t atoms, int32_t pairs, const int32_t* first, const int32_t* second, const int64_t* cells,
                  int64_t least, int64_t most, int32_t rounds, int64_t count, const int64_t* order,
                  const int64_t* wanted, int32_t* names, uint8_t* good) {
    try {
        jld::Forest forest{atoms, pairs, first, second, cells, least, most, {}};
        for (int64_t row = 0; row < count; ++row)
            good[row] = forest.grow(order + row * pairs, wanted[row], rounds, names + row * atoms);
        return 0;
    } catch (const std::bad_alloc&) {
        return 1;
    }
}
}
