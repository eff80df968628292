// As many products and additions as the registers take: what a core can do at the most (benchmarks/arithmetic.py).
#include "simd.h"

extern "C" double jld_peak(int64_t rounds) {
    constexpr int CHAINS = 16;
    jld::Lane x[CHAINS], by = jld::splat(0.999999), more = jld::splat(1e-9);
    for (int k = 0; k < CHAINS; ++k) x[k] = jld::splat(1.0 + k);
    for (int64_t n = 0; n < rounds; ++n)
        for (int k = 0; k < CHAINS; ++k) x[k] = x[k] * by + more;
    double sum = 0.0;
    for (int k = 0; k < CHAINS; ++k) sum += jld::lanes_of(x[k])[0];
    return sum;
}
