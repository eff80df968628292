// The C interface of the relaxation by blocks.
#include "block_program.h"

#include "outcome.h"

extern "C" int32_t jld_solve_blocks(const JldBlocks* problem, const JldBlockTask* task) {
    return jld::outcome_of([&] {
        if (!jld::BlockProgram::fits(*problem)) return JLD_UNSUPPORTED;
        jld::BlockProgram(*problem, *task).run();
        return JLD_DONE;
    });
}
