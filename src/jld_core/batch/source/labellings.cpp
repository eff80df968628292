// The C interface of bounds and of conflict minimisation. They stand in one unit because they share the solver that is
// compiled for each kind of face.
#include "bounds.h"
#include "faces.h"
#include "minimization.h"
#include "outcome.h"

extern "C" {

// The hash stands in the library as text, so that a library of other sources is recognised without loading it.
const char* jld_sources() { return JLD_SOURCES; }

const char* jld_variant() { return jld::VARIANT; }
int32_t jld_width() { return jld::LANES; }

int32_t jld_solve(const JldProblem* problem, const JldTry* tries, int32_t number_of_tries, int64_t count,
                  const uint8_t* labels, const double* thresholds, const JldAnswers* answers) {
    return jld::outcome_of([&] {
        const bool known = jld::with_faces(*problem, [&](auto face) {
            jld::LabellingBounds<decltype(face)>(*problem, tries, number_of_tries, labels, thresholds, *answers)
                .run(count);
        });
        return known ? JLD_DONE : JLD_UNSUPPORTED;
    });
}
int32_t jld_minimize(const JldProblem* problem, const JldTry* settings, const JldMinimization* request) {
    return jld::outcome_of([&] {
        const bool known = jld::with_faces(*problem, [&](auto face) {
            jld::ConflictMinimization<decltype(face)>(*problem, *settings, *request).run();
        });
        return known ? JLD_DONE : JLD_UNSUPPORTED;
    });
}
}
