// Calls carried out for one kind of face.
#pragma once
#include "bounds.h"
#include "labelling_calls.h"
#include "minimization.h"

namespace jld {

template <class Face>
void run(const BoundsCall& c) {
    LabellingBounds<Face>(c.problem, c.tries, c.number_of_tries, c.labels, c.thresholds, c.answers).run(c.count);
}

template <class Face>
void run(const MinimizationCall& c) {
    ConflictMinimization<Face>(c.problem, c.settings, c.request).run();
}

}  // namespace jld
