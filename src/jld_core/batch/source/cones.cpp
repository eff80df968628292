// The C interface of cone programs of one sparsity.
#include "cones.h"
#include "outcome.h"

extern "C" {

int32_t jld_solve_cones(const JldCones* problem, const JldConeTask* task) {
    return jld::outcome_of([&] {
        // a program that is left alone takes less time without vectors, and the result is the same
        int64_t first = 0;
        if (task->count > 1) {
            jld::ConeSolver<jld::Lane> together(*problem);
            for (; task->count - first > 1; first += jld::LANES) together.run(*task, first);
        }
        if (first < task->count) jld::ConeSolver<double>(*problem).run(*task, first);
        return JLD_DONE;
    });
}
}
