// One labelling in a number that counts what is done to it: how much arithmetic an answer takes (benchmarks/arithmetic.py).
#pragma once
#include <cmath>
#include <cstdint>

namespace jld {

constexpr int LANES = 1;
constexpr const char* VARIANT = "counted";

// additions and products; divisions and roots; comparisons
inline uint64_t counted[3];

struct Mask {
    int64_t x;
    explicit operator bool() const { return x != 0; }
    Mask operator&(Mask o) const { return {x & o.x}; }
    Mask operator|(Mask o) const { return {x | o.x}; }
    Mask operator~() const { return {~x}; }
};

struct Lane {
    double x = 0.0;
};

#define JLD_SIGN(sign, which)                                                                        \
    inline Lane operator sign(Lane a, Lane b) { return ++counted[which], Lane{a.x sign b.x}; }      \
    inline Lane operator sign(double a, Lane b) { return ++counted[which], Lane{a sign b.x}; }      \
    inline Lane operator sign(Lane a, double b) { return ++counted[which], Lane{a.x sign b}; }      \
    inline Lane& operator sign##=(Lane & a, Lane b) { return a = a sign b; }                         \
    inline Lane& operator sign##=(Lane & a, double b) { return a = a sign b; }
JLD_SIGN(+, 0)
JLD_SIGN(-, 0)
JLD_SIGN(*, 0)
JLD_SIGN(/, 1)
#undef JLD_SIGN
inline Lane operator-(Lane a) { return {-a.x}; }

#define JLD_COMPARE(sign)                                                                            \
    inline Mask operator sign(Lane a, Lane b) { return ++counted[2], Mask{a.x sign b.x ? -1 : 0}; } \
    inline Mask operator sign(double a, Lane b) { return ++counted[2], Mask{a sign b.x ? -1 : 0}; } \
    inline Mask operator sign(Lane a, double b) { return ++counted[2], Mask{a.x sign b ? -1 : 0}; }
JLD_COMPARE(<)
JLD_COMPARE(>)
JLD_COMPARE(<=)
JLD_COMPARE(>=)
JLD_COMPARE(==)
#undef JLD_COMPARE

inline Lane splat(double x) { return {x}; }
inline Lane select(Mask m, Lane a, Lane b) { return m ? a : b; }
inline Lane larger(Lane a, Lane b) { return b > a ? b : a; }
inline Lane smaller(Lane a, Lane b) { return b < a ? b : a; }
inline Lane absolute(Lane a) { return {std::fabs(a.x)}; }
inline Lane root(Lane a) { return ++counted[1], Lane{std::sqrt(a.x)}; }
inline bool is_set(Mask m, int) { return m.x != 0; }
inline double* lanes_of(Lane& x) { return &x.x; }
inline const double* lanes_of(const Lane& x) { return &x.x; }

}  // namespace jld

extern "C" inline __attribute__((used)) void jld_counted(uint64_t* found) {
    for (int k = 0; k < 3; ++k) found[k] = jld::counted[k], jld::counted[k] = 0;
}
