// Multifrontal Cholesky factorisation of one sparse matrix, with the dense routines of the caller's BLAS and LAPACK.
// Duff & Reid, ACM TOMS 9 (1983) 302-325; Liu, SIAM Review 34 (1992) 82-109.
#include <algorithm>
#include <memory>
#include <vector>

#include "interface.h"
#include "outcome.h"

namespace jld {
namespace {

// Addresses of Fortran routines, in the order of JldFronts.routines.
struct Routines {
    using Potrf = void (*)(const char*, const int*, double*, const int*, int*);
    using Trsm = void (*)(const char*, const char*, const char*, const char*, const int*, const int*, const double*,
                          const double*, const int*, double*, const int*);
    using Syrk = void (*)(const char*, const char*, const int*, const int*, const double*, const double*, const int*,
                          const double*, double*, const int*);
    using Trsv = void (*)(const char*, const char*, const char*, const int*, const double*, const int*, double*,
                          const int*);
    using Gemv = void (*)(const char*, const int*, const int*, const double*, const double*, const int*, const double*,
                          const int*, const double*, double*, const int*);
    Potrf potrf;
    Trsm trsm;
    Syrk syrk;
    Trsv trsv;
    Gemv gemv;

    explicit Routines(const int64_t* address)
        : potrf(reinterpret_cast<Potrf>(address[0])),
          trsm(reinterpret_cast<Trsm>(address[1])),
          syrk(reinterpret_cast<Syrk>(address[2])),
          trsv(reinterpret_cast<Trsv>(address[3])),
          gemv(reinterpret_cast<Gemv>(address[4])) {}
};

constexpr double ONE = 1.0, MINUS_ONE = -1.0, ZERO = 0.0;
constexpr int STEP = 1;

// Rows of an update matrix that are consecutive rows of its parent front.
struct Run {
    int first, last, place;
};

// One front: `own` pivot columns of own + rest rows, stored column by column, of which the lower triangle counts.
struct Front {
    int own, rest, height;
    double* columns;
    const int64_t* passed;
    const int32_t* place;

    Front(const JldFronts& fronts, int64_t number, double* factor)
        : own(static_cast<int>(fronts.bounds[number + 1] - fronts.bounds[number])),
          rest(static_cast<int>(fronts.passed_start[number + 1] - fronts.passed_start[number])),
          height(own + rest),
          columns(factor + fronts.factor_start[number]),
          passed(fronts.passed + fronts.passed_start[number]),
          place(fronts.place + fronts.passed_start[number]) {}
};

// Add the update matrix of a child to the pivot columns and the update matrix of its parent.
void extend(const Front& child, const double* update, const Front& parent, double* target, std::vector<Run>& runs) {
    runs.clear();
    for (int i = 0; i < child.rest; ++i) {
        // a run ends where pivot rows end, since the rows below are stored elsewhere
        const bool next = i && child.place[i] == child.place[i - 1] + 1 && child.place[i] != parent.own;
        if (next) runs.back().last = i + 1;
        else runs.push_back({i, i + 1, child.place[i]});
    }
    for (size_t block = 0; block < runs.size(); ++block)
        for (int j = runs[block].first; j < runs[block].last; ++j) {
            const int column = child.place[j];
            const bool pivot = column < parent.own;
            double* to = pivot ? parent.columns + static_cast<int64_t>(column) * parent.height
                               : target + static_cast<int64_t>(column - parent.own) * parent.rest - parent.own;
            const double* from = update + static_cast<int64_t>(j) * child.rest;
            for (size_t other = block; other < runs.size(); ++other) {
                const int begin = other == block ? j : runs[other].first;
                double* __restrict at = to + (runs[other].place - runs[other].first);
                for (int i = begin; i < runs[other].last; ++i) at[i] += from[i];
            }
        }
}

// Factor one front whose updates of children are complete. Returns false if the matrix is not positive definite.
bool eliminate(const Routines& call, const Front& front, double* update) {
    if (!front.own) return true;
    int info = 0;
    call.potrf("L", &front.own, front.columns, &front.height, &info);
    if (info) return false;
    if (!front.rest) return true;
    double* panel = front.columns + front.own;
    call.trsm("R", "L", "T", "N", &front.rest, &front.own, &ONE, front.columns, &front.height, panel, &front.height);
    call.syrk("L", "N", &front.rest, &front.own, &MINUS_ONE, panel, &front.height, &ONE, update, &front.rest);
    return true;
}

bool factor_all(const JldFronts& fronts, double* factor) {
    const Routines call(fronts.routines);
    std::vector<std::unique_ptr<double[]>> updates(fronts.count);
    std::vector<std::vector<int64_t>> children(fronts.count);
    std::vector<Run> runs;
    for (int64_t number = 0; number < fronts.count; ++number) {
        const Front front(fronts, number, factor);
        const int64_t size = static_cast<int64_t>(front.rest) * front.rest;
        if (size) updates[number] = std::make_unique<double[]>(size);
        for (int64_t child : children[number]) {
            if (!updates[child]) continue;
            extend(Front(fronts, child, factor), updates[child].get(), front, updates[number].get(), runs);
            updates[child].reset();
        }
        if (!eliminate(call, front, updates[number].get())) return false;
        if (fronts.parent[number] >= 0) children[fronts.parent[number]].push_back(number);
    }
    return true;
}

void solve_one(const JldFronts& fronts, double* factor, double* x, std::vector<double>& work) {
    const Routines call(fronts.routines);
    for (int64_t number = 0; number < fronts.count; ++number) {
        const Front front(fronts, number, factor);
        if (!front.own) continue;
        double* own = x + fronts.bounds[number];
        call.trsv("L", "N", "N", &front.own, front.columns, &front.height, own, &STEP);
        if (!front.rest) continue;
        call.gemv("N", &front.rest, &front.own, &ONE, front.columns + front.own, &front.height, own, &STEP, &ZERO,
                  work.data(), &STEP);
        for (int i = 0; i < front.rest; ++i) x[front.passed[i]] -= work[i];
    }
    for (int64_t number = fronts.count - 1; number >= 0; --number) {
        const Front front(fronts, number, factor);
        if (!front.own) continue;
        double* own = x + fronts.bounds[number];
        if (front.rest) {
            for (int i = 0; i < front.rest; ++i) work[i] = x[front.passed[i]];
            call.gemv("T", &front.rest, &front.own, &MINUS_ONE, front.columns + front.own, &front.height, work.data(),
                      &STEP, &ONE, own, &STEP);
        }
        call.trsv("L", "T", "N", &front.own, front.columns, &front.height, own, &STEP);
    }
}

}  // namespace
}  // namespace jld

extern "C" {

int32_t jld_factor_fronts(const JldFronts* fronts, double* factor, uint8_t* definite) {
    return jld::outcome_of([&] {
        *definite = jld::factor_all(*fronts, factor);
        return JLD_DONE;
    });
}

int32_t jld_solve_fronts(const JldFronts* fronts, double* factor, int32_t columns, double* x) {
    return jld::outcome_of([&] {
        int64_t longest = 0;
        for (int32_t number = 0; number < fronts->count; ++number)
            longest = std::max(longest, fronts->passed_start[number + 1] - fronts->passed_start[number]);
        std::vector<double> work(longest);
        const int64_t size = fronts->bounds[fronts->count];
        for (int32_t k = 0; k < columns; ++k) jld::solve_one(*fronts, factor, x + k * size, work);
        return JLD_DONE;
    });
}
}
