// The C interface of graphs of many labellings.
#include "graphs.h"

#include "outcome.h"

extern "C" {

int32_t jld_find_blocks(int32_t elements, int32_t number_of_joins, const int32_t* joins, int32_t faces,
                        const int32_t* first, const int32_t* second, int64_t count, const uint8_t* labels,
                        int64_t* names) {
    return jld::outcome_of([&] {
        jld::DisjointSets sets{std::vector<int64_t>(elements)};
        for (int64_t row = 0; row < count; ++row, labels += faces, names += elements) {
            for (int32_t e = 0; e < elements; ++e) sets.parent[e] = e;
            for (int32_t k = 0; k < number_of_joins; ++k) sets.join(joins[2 * k], joins[2 * k + 1]);
            for (int32_t f = 0; f < faces; ++f)
                if (!labels[f]) sets.join(first[f], second[f]);
            for (int32_t e = 0; e < elements; ++e) names[e] = sets.root(e);
        }
        return JLD_DONE;
    });
}

int32_t jld_join_parts(int32_t atoms, int32_t pairs, const int32_t* first, const int32_t* second, const int64_t* cells,
                       int64_t least, int64_t most, int32_t rounds, int64_t count, const int64_t* order,
                       const int64_t* wanted, int32_t* names, uint8_t* complete) {
    return jld::outcome_of([&] {
        jld::PartGrowth growth{atoms, pairs, first, second, cells, least, most, {}, {}, {}, {}};
        for (int64_t row = 0; row < count; ++row)
            complete[row] = growth.grow(order + row * pairs, wanted[row], rounds, names + row * atoms);
        return JLD_DONE;
    });
}
}
