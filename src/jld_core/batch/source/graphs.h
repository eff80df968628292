// Graphs of many labellings, one after another: their blocks, (5.1), and parts that are joined in a given order.
// Integers only, so every variant gives the same result.
#pragma once
#include <cstdint>
#include <utility>
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
    std::vector<int64_t> size;   // (sets) cells of each set of atoms, 0 where it was joined to another
    std::vector<int32_t> next;   // (atoms) next member of the same set; the members form a ring
    std::vector<int32_t> count;  // (sets) atoms of each set
    std::vector<int32_t> named;  // (sets) name of the part that a set forms

    bool lacking() const {
        for (int64_t own : size)
            if (own > 0 && own < least) return true;
        return false;
    }

    // set: (atoms) set of each atom. The smaller set is relabelled, and the part keeps the name of the first atom's.
    void join(int32_t* set, int64_t pair, bool small_only) {
        int32_t p = set[first[pair]], q = set[second[pair]];
        if (p == q || size[p] + size[q] > most) return;
        if (small_only && size[p] >= least && size[q] >= least) return;
        const int32_t name = named[p], one = first[pair], other = second[pair];
        const bool swapped = count[p] < count[q];
        const int32_t kept = swapped ? q : p, gone = swapped ? p : q, start = swapped ? one : other;
        int32_t member = start;
        do {
            set[member] = kept;
            member = next[member];
        } while (member != start);
        std::swap(next[one], next[other]);
        size[kept] += size[gone], size[gone] = 0;
        count[kept] += count[gone];
        named[kept] = name;
    }

    // Join the first `wanted` pairs of `order`, then parts that are too small with parts that they touch.
    bool grow(const int64_t* order, int64_t wanted, int32_t rounds, int32_t* name) {
        size.assign(cells, cells + atoms);
        count.assign(atoms, 1);
        next.resize(atoms), named.resize(atoms);
        for (int32_t k = 0; k < atoms; ++k) name[k] = next[k] = named[k] = k;
        for (int64_t k = 0; k < wanted; ++k) join(name, order[k], false);
        for (int32_t round = 0; round < rounds && lacking(); ++round)
            for (int32_t k = 0; k < pairs; ++k) join(name, order[k], true);
        for (int32_t k = 0; k < atoms; ++k) name[k] = named[name[k]];
        return !lacking();
    }
};

}  // namespace jld
