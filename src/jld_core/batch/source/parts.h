// Graphs of many labellings, one after another: the blocks of each, and parts that are joined in the order of keys.
// Whole numbers only, so that every variant answers alike.
#pragma once
#include <cstdint>
#include <vector>

namespace jld {

// Blocks of one labelling, each named by the smallest element in it.
struct Blocks {
    std::vector<int64_t> up;

    int64_t root(int64_t e) {
        while (up[e] != e) e = up[e] = up[up[e]];
        return e;
    }

    void join(int32_t a, int32_t b) {
        int64_t one = root(a), two = root(b);
        if (one < two) up[two] = one;
        else up[one] = two;
    }
};

// Parts in the making: pairs of atoms are joined in an order, as long as a part holds no more cells than it may.
struct Forest {
    int32_t atoms, pairs;
    const int32_t *first, *second;  // (pairs) atoms
    const int64_t* cells;           // (atoms)
    int64_t least, most;            // cells of a part
    std::vector<int64_t> size;

    bool lacking() const {
        for (int64_t own : size)
            if (own > 0 && own < least) return true;
        return false;
    }

    void join(int32_t* name, int64_t pair, bool small_only) {
        int32_t p = name[first[pair]], q = name[second[pair]];
        if (p == q || size[p] + size[q] > most) return;
        if (small_only && size[p] >= least && size[q] >= least) return;
        for (int32_t k = 0; k < atoms; ++k) name[k] = name[k] == q ? p : name[k];
        size[p] += size[q], size[q] = 0;
    }

    // order: (pairs), of which the first `wanted` are joined, then what is too small with what it touches.
    bool grow(const int64_t* order, int64_t wanted, int32_t rounds, int32_t* name) {
        size.assign(cells, cells + atoms);
        for (int32_t k = 0; k < atoms; ++k) name[k] = k;
        for (int64_t k = 0; k < wanted; ++k) join(name, order[k], false);
        for (int32_t round = 0; round < rounds && lacking(); ++round)
            for (int32_t k = 0; k < pairs; ++k) join(name, order[k], true);
        return !lacking();
    }
};

}  // namespace jld
