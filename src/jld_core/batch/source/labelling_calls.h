// Calls of the C interface for the kinds of faces, which `planar_labellings.cpp` and `spatial_labellings.cpp` compile at
// the same time: the solver is compiled for each kind of face, and both families take about as long.
#pragma once
#include "interface.h"

// Arguments of calls, the same for all numbers of lanes.
namespace jld_calls {

// Arguments of `jld_solve`.
struct BoundsCall {
    const JldProblem& problem;
    const JldTry* tries;
    int32_t number_of_tries;
    int64_t count;
    const uint8_t* labels;
    const double* thresholds;
    const JldAnswers& answers;
};

// Arguments of `jld_minimize`.
struct MinimizationCall {
    const JldProblem& problem;
    const JldTry& settings;
    const JldMinimization& request;
};

}  // namespace jld_calls

// In half the lanes of AVX-512; false where the problem has no kind of face that this is compiled for.
namespace jld_narrow {
bool run_planar(const jld_calls::BoundsCall& call);
}

namespace jld {

using jld_calls::BoundsCall;
using jld_calls::MinimizationCall;

// False where the problem has no kind of face of the family.
bool run_planar(const BoundsCall& call);
bool run_planar(const MinimizationCall& call);
bool run_spatial(const BoundsCall& call);
bool run_spatial(const MinimizationCall& call);

}  // namespace jld
