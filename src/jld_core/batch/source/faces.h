// The kinds of faces, as types that the solvers are compiled for.
#pragma once
#include "planar.h"
#include "spatial.h"

namespace jld {

// Calls with a face of the kind that a problem has; false where there is none.
template <class Call>
bool with_faces(const JldProblem& p, Call call) {
    if (p.freedoms == 6) {
        if (p.pairs == 2) call(SpatialFace<PairBending>{});
        else if (p.pairs == 4) call(SpatialFace<HullBending<4>>{});
        else if (p.pairs == 8) call(SpatialFace<HullBending<8>>{});
        else return false;
    } else if (p.pairs == 2) {
        if (p.parabolas) call(PlanarFace<2, true>{});
        else call(PlanarFace<2>{});
    } else if (p.pairs == 3) {
        if (p.coupled) call(PlanarFace<3, true, true>{});
        else if (p.parabolas) call(PlanarFace<3, true>{});
        else call(PlanarFace<3>{});
    } else {
        return false;
    }
    return true;
}

}  // namespace jld
