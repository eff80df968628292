// The C interface of bounds and of conflict minimisation.
#include "labelling_calls.h"
#include "outcome.h"
#include "simd.h"

namespace {

bool run_planar(const jld::BoundsCall& call) {
    return (call.problem.narrow && jld_narrow::run_planar(call)) || jld::run_planar(call);
}
bool run_planar(const jld::MinimizationCall& call) { return jld::run_planar(call); }

template <class Call>
int32_t outcome_of_faces(const Call& call) {
    return jld::outcome_of([&] {
        const bool known = call.problem.freedoms == 6 ? jld::run_spatial(call) : run_planar(call);
        return known ? JLD_DONE : JLD_UNSUPPORTED;
    });
}

}  // namespace

extern "C" {

// The hash stands in the library as text, so that a library of other sources is recognised without loading it.
const char* jld_sources() { return JLD_SOURCES; }

const char* jld_variant() { return jld::VARIANT; }
int32_t jld_width() { return jld::LANES; }

int32_t jld_solve(const JldProblem* problem, const JldTry* tries, int32_t number_of_tries, int64_t count,
                  const uint8_t* labels, const double* thresholds, const JldAnswers* answers) {
    return outcome_of_faces(jld::BoundsCall{*problem, tries, number_of_tries, count, labels, thresholds, *answers});
}
int32_t jld_minimize(const JldProblem* problem, const JldTry* settings, const JldMinimization* request) {
    return outcome_of_faces(jld::MinimizationCall{*problem, *settings, *request});
}
}
