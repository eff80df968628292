// Bounds and conflict minimisation of planar faces.
#include "labelling_runs.h"
#include "planar.h"

namespace jld {

template <class Call>
static bool run_of_kind(const Call& call) {
    const JldProblem& p = call.problem;
    if (p.pairs == 2) {
        if (p.parabolas) run<PlanarFace<2, true>>(call);
        else run<PlanarFace<2>>(call);
    } else if (p.pairs == 3) {
        if (p.coupled) run<PlanarFace<3, true, true>>(call);
        else if (p.parabolas) run<PlanarFace<3, true>>(call);
        else run<PlanarFace<3>>(call);
    } else {
        return false;
    }
    return true;
}

bool run_planar(const BoundsCall& call) { return run_of_kind(call); }
bool run_planar(const MinimizationCall& call) { return run_of_kind(call); }

}  // namespace jld
