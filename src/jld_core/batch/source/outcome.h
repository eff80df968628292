// The boundary of the C interface.
#pragma once
#include <new>

#include "interface.h"

namespace jld {

// Run a call of the C interface and return its outcome. No exception may leave it: the caller is no C++.
template <class Call>
JldOutcome outcome_of(Call call) noexcept {
    try {
        return call();
    } catch (const std::bad_alloc&) {
        return JLD_NO_MEMORY;
    } catch (...) {
        return JLD_FAILED;
    }
}

}  // namespace jld
