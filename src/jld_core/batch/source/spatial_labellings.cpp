// Bounds and conflict minimisation of spatial faces.
#include "labelling_runs.h"
#include "spatial.h"

namespace jld {

template <class Call>
static bool run_of_kind(const Call& call) {
    const JldProblem& p = call.problem;
    if (p.pairs == 2) run<SpatialFace<PairBending>>(call);
    else if (p.pairs == 4) run<SpatialFace<HullBending<4>>>(call);
    else if (p.pairs == 8) run<SpatialFace<HullBending<8>>>(call);
    else if (p.pairs == 16) run<SpatialFace<HullBending<16>>>(call);
    else return false;
    return true;
}

bool run_spatial(const BoundsCall& call) { return run_of_kind(call); }
bool run_spatial(const MinimizationCall& call) { return run_of_kind(call); }

}  // namespace jld
