// Graphs of many labellings, one after another: their blocks, (5.1), and parts that are joined in a given order.
// Integers only, so every variant gives the same result.
#pragma once
#include <cstdint>
#include <vector>

namespace jld {

// Disjoint sets of the elements of one labelling; each set is named by its smallest element.
struct DisjointSets {
    std::vector<int64_t> parent;

    int64_t root(int64_t e) {
        while (parent[e] != e) e = parent[e] = parent[parent[e]];
        return e;
    }

    void join(int32_t a, int32_t b) {
        int64_t one = root(a), two = root(b);
        if (one < two) parent[two] = one;
        else parent[one] = two;
    }
};

// Parts that grow by joining pairs of atoms in a given order, as long as a part does not exceed the largest number of
// cells.
struct PartGrowth {
    int32_t atoms, pairs;
    const int32_t *first, *second;  // (pairs) atoms
    const int64_t* cells;           // (atoms) cells of each
    int64_t least, most;            // smallest and largest number of cells of a part
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

    // Join the first `wanted` pairs of `order`, then parts that are too small with parts that they touch.
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
