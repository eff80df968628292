// Data of one iteration that faces read, and sums that they contribute to.
#pragma once
#include "simd.h"

namespace jld {

struct Iteration {
    double margin;
    Lane press, proximal, residual_share, centre, primal_step, dual_step;
    // Sums and maxima over the faces.
    Lane gap, worst, primal_blocking, dual_blocking, blocking_numerator, blocking_denominator, multiplier_slack_step,
        step_product, next_gap, value, moved, parabola_error, room;
};

}  // namespace jld
