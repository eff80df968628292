// SIMD vectors of doubles, one labelling per lane, and operations on them that C++ has no operator for.
#pragma once
#include <cstdint>

// Functions with several callers are compiled once.
#define JLD_NOINLINE __attribute__((noinline))

// Short loops are unrolled completely, so that their sums stay in registers.
#if defined(__clang__)
#define JLD_UNROLL _Pragma("clang loop unroll(full)")
#else
#define JLD_UNROLL _Pragma("GCC unroll 40")
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

// Half the lanes of AVX-512, for workspaces that exceed the cache: see planar_narrow.cpp.
#if defined(__AVX512F__) && defined(__AVX512DQ__) && !defined(JLD_NARROW)
#define JLD_WIDE
#endif

#if defined(JLD_WIDE)
constexpr int LANES = 8;
constexpr const char* VARIANT = "avx512";
#elif defined(__AVX2__) && defined(__FMA__)
constexpr int LANES = 4;
constexpr const char* VARIANT = "avx2";
#elif defined(__aarch64__)
constexpr int LANES = 2;
constexpr const char* VARIANT = "neon";
#else
constexpr int LANES = 2;
constexpr const char* VARIANT = "base";
#endif

typedef double Lane __attribute__((vector_size(8 * LANES)));
typedef int64_t Mask __attribute__((vector_size(8 * LANES)));

inline Lane splat(double x) { return Lane{} + x; }
#if defined(__SSE2__) && !defined(__AVX2__)
// SSE2 has no 64-bit integer comparison, which the compiler would use for a mask.
inline Lane select(Mask m, Lane a, Lane b) { return (Lane)((m & (Mask)a) | (~m & (Mask)b)); }
#else
inline Lane select(Mask m, Lane a, Lane b) { return m ? a : b; }
#endif
// If b is NaN the result is a, so errors are tested as !(x <= tolerance).
inline Lane larger(Lane a, Lane b) { return b > a ? b : a; }
inline Lane smaller(Lane a, Lane b) { return b < a ? b : a; }
inline Lane absolute(Lane a) { return a < 0.0 ? -a : a; }

inline Lane root(Lane a) {
#if defined(JLD_WIDE)
    return (Lane)_mm512_sqrt_pd((__m512d)a);
#elif defined(__AVX2__) && defined(__FMA__)
    return (Lane)_mm256_sqrt_pd((__m256d)a);
#elif defined(__aarch64__)
    return (Lane)vsqrtq_f64((float64x2_t)a);
#elif defined(__SSE2__)
    return (Lane)_mm_sqrt_pd((__m128d)a);
#else
    Lane r;
    for (int i = 0; i < LANES; ++i) r[i] = __builtin_sqrt(a[i]);
    return r;
#endif
}

inline bool is_set(const Mask& m, int lane) { return m[lane] != 0; }

// The lanes of a vector as an array. GCC and Clang let vectors alias their elements, as their vector extension states.
inline double* lanes_of(Lane& x) { return reinterpret_cast<double*>(&x); }
inline const double* lanes_of(const Lane& x) { return reinterpret_cast<const double*>(&x); }

}  // namespace jld
#endif
