// What the caller hands over (plain arrays, kept by the caller) and what it gets back. Scaled, as the template is.
#pragma once
#include <cstdint>

#include "cholesky.h"

extern "C" {

// Of a face in a labelling.
enum JldLabel : uint8_t { JLD_INNER = 0, JLD_DRY = 1, JLD_UNDECIDED = 2 };

// What is proven of a labelling: nothing yet; both bounds, a narrow bracket; that it falls without live load; that it
// carries more than its threshold; that it carries any load.
enum JldVerdict : int32_t { JLD_OPEN = 0, JLD_PROVEN = 1, JLD_FALLS = 2, JLD_CARRIES = 3, JLD_LOCKED = 4 };

// What became of a labelling that was to be shrunk: open or never begun, refuted, seen to carry more.
enum JldFate : uint8_t { JLD_LEFT = 0, JLD_REFUTED = 1, JLD_CARRIED = 2 };

struct JldProblem {
    int32_t elements, faces, pairs, labels, freedoms;
    int32_t dropping;      // does any label drop V?
    jld::FactorPattern pattern;
    const int32_t* low;    // (faces) element of a face that is eliminated first, -1 for none
    const int32_t* high;   // (faces) the other one, -1 for a support
    const int32_t* block;  // (faces) block below the diagonal that the two share, -1 for none
    // (faces, 2, 7 or 27) what resultants do to either element. Planar: N and V row by row, then M in the last row.
    // Spatial: N, V1, V2 row by row, then M1, M2, MT in the last three.
    const double* sides;
    // (labels, faces, numbers) a, b, h of -a N +- b X <= h for each pair, X is M, V, M; spatial M1, M2 and MT + t, or
    // a, p, q, h of -a N + p M1 + q M2 <= h for each edge of a hull, (x, y) of corners between edges, a, b, h of MT + t.
    // pairs: how many pairs, spatial 2 of bending or the number of edges
    const double* rows;
    const double* keep;    // (labels, faces) 1 where V takes part in equilibrium
    const double* dead;    // (3 elements)
    const double* live;    // (3 elements)
    double floor;          // lambda >= -floor
    const double* opening; // (3 elements) velocities that open every face, or null
    double noise;          // what rounding may do to a sum, relative
    const double* forces;  // (3 faces) where iterations start
    const double* jumps;   // (3 faces) of the velocities that they start from
    const double* speed;   // (3 elements) those velocities
    double load;           // lambda there
    double room, push;     // least slack and multiplier at the start
    double zero;           // lambda beside which a bracket around zero may be narrow
    double gap;            // relative width of a narrow bracket
    // (labels, faces, 2 or more) c and n0 of planar first pairs that bow, b |M| <= h + a N - c N^2 from n0 on and its
    // tangent at n0 below; where V and M meet the numbers of Meeting follow. Null where none does
    const double* bows;
    int32_t meets;         // do V and M meet under any label?
};

struct JldTry {
    double proximal; // added to H
    double margin;   // slack that every row keeps
    double target;   // relative gap that is asked for
    double active;   // slack below which a row may move
    double first, last, near; // share of the longest step, far away and at a relative gap of `near` and below
    double relax;    // relative gap below which the proximal term fades
    double jumps;    // error of the jumps, relative to speeds, that a motion may have
    double aim;      // 1: the largest lambda; 0: the middle of what is admissible; -1: a ray that carries ever more
    double press;    // what a normal force costs, beside what its slack earns: bounds forces that nothing else does
    double endless;  // lambda, beside where iterations start, above which a ray is looked for
    int32_t most;    // iterations
};

// Labellings that are too weak, each to be shrunk to what makes it so. Results have 1 + neighbours rows for each.
struct JldShrinking {
    int64_t count;
    const uint8_t* labels;     // (count, faces) of JldLabel, undecided where it is so from the start
    const uint8_t* free;       // (faces) 1 where a face may take either label
    const double* thresholds;  // (count) scaled lambda
    int32_t neighbours;        // labellings of one face less begun from each that gives a conflict
    int32_t tries;             // single faces tried in vain
    int32_t inner;             // are inner faces tried before dry ones?
    double balance;            // error of equilibrium with which forces that carry more end it
    uint64_t seed;
    uint8_t* fate;             // (rows) of JldFate
    uint8_t* conflict;         // (rows, faces) 1 where decided in the end
    double* velocity;          // (rows, 3 elements) what refutes
    int32_t* relaxations;      // (rows)
};

struct JldAnswers {
    double* low;         // (count) proven lower bound, -inf for none
    double* high;        // (count) proven upper bound, +inf for none
    int32_t* verdict;    // (count) of JldVerdict
    int32_t* iterations; // (count) of all tries
    int32_t* tries;      // (count)
    double* forces;      // (count, 3 faces) or null
    double* velocity;    // (count, 3 elements) or null
    double* diagnosis;   // (count, 4) slack, error, margin before opening, gap; or null
    double* rays;        // (count, faces Q) or null: for lambda = 1, of those that carry any load
};
}
