// What a face needs to know of an iteration, and what it adds to.
#pragma once
#include "simd.h"

namespace jld {

struct Iteration {
    double margin;
    Lane press, delta, lag, centre, alpha_s, alpha_z;
    // sums and maxima over faces
    Lane gap, worst, hit_s, hit_z, over, under, zds, dsdz, next, value, moved, bent, room;
};

}  // namespace jld
