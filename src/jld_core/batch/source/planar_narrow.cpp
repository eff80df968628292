// Bounds of planar faces in half the lanes of AVX-512: workspaces of large assemblies exceed the cache, and those of fewer
// labellings exceed it less. Everything of namespace jld gets another name here, because its vectors are shorter.
#if defined(__AVX512F__) && defined(__AVX512DQ__)
#define JLD_NARROW
#define jld jld_narrow
#include "labelling_runs.h"
#include "planar.h"

namespace jld_narrow {

bool run_planar(const BoundsCall& call) {
    const JldProblem& p = call.problem;
    if (p.parabolas || p.pairs > 3) return false;
    if (p.pairs == 2) run<PlanarFace<2>>(call);
    else run<PlanarFace<3>>(call);
    return true;
}

}  // namespace jld_narrow
#else
#include "labelling_calls.h"

bool jld_narrow::run_planar(const jld_calls::BoundsCall&) { return false; }
#endif
