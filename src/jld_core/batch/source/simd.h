// A register of doubles, one labelling to a lane, and the few operations on it that the language has no sign for.
#pragma once
#include <cstdint>

// what is called from more than one place is compiled once
#define JLD_ONCE __attribute__((noinline))

// a loop over a few numbers is laid out whole, so that what it gathers stays in registers
#if defined(__clang__)
#define JLD_WHOLE _Pragma("clang loop unroll(full)")
#else
#define JLD_WHOLE _Pragma("GCC unroll 40")
#endif

#if defined(JLD_COUNTED)
#include JLD_COUNTED
#else
#if defined(__AVX512F__) || defined(__AVX2__) || defined(__SSE2__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

namespace jld {

#if defined(__AVX512F__) && defined(__AVX512DQ__)
constexpr int W = 8;
constexpr const char* VARIANT = "avx512";
#elif defined(__AVX2__) && defined(__FMA__)
constexpr int W = 4;
constexpr const char* VARIANT = "avx2";
#elif defined(__aarch64__)
constexpr int W = 2;
constexpr const char* VARIANT = "neon";
#else
constexpr int W = 2;
constexpr const char* VARIANT = "base";
#endif

typedef double Lane __attribute__((vector_size(8 * W)));
typedef int64_t Mask __attribute__((vector_size(8 * W)));

inline Lane splat(double x) { return Lane{} + x; }
#if defined(__SSE2__) && !defined(__AVX2__)
// there are no comparisons of 64-bit integers, which is what a mask is to the compiler
inline Lane select(Mask m, Lane a, Lane b) { return (Lane)((m & (Mask)a) | (~m & (Mask)b)); }
#else
inline Lane select(Mask m, Lane a, Lane b) { return m ? a : b; }
#endif
// where b is no number a is kept: what measures an error asks for !(x <= tolerance) instead
inline Lane larger(Lane a, Lane b) { return b > a ? b : a; }
inline Lane smaller(Lane a, Lane b) { return b < a ? b : a; }
inline Lane absolute(Lane a) { return a < 0.0 ? -a : a; }

inline Lane root(Lane a) {
#if defined(__AVX512F__) && defined(__AVX512DQ__)
    return (Lane)_mm512_sqrt_pd((__m512d)a);
#elif defined(__AVX2__) && defined(__FMA__)
    return (Lane)_mm256_sqrt_pd((__m256d)a);
#elif defined(__aarch64__)
    return (Lane)vsqrtq_f64((float64x2_t)a);
#elif defined(__SSE2__)
    return (Lane)_mm_sqrt_pd((__m128d)a);
#else
    Lane r;
    for (int i = 0; i < W; ++i) r[i] = __builtin_sqrt(a[i]);
    return r;
#endif
}

inline double* lanes_of(Lane& x) { return reinterpret_cast<double*>(&x); }
inline const double* lanes_of(const Lane& x) { return reinterpret_cast<const double*>(&x); }

}  // namespace jld
#endif
