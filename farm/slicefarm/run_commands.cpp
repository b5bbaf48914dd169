#include "commands.hpp"

namespace slicecorr::farm {

void add_run_commands(cli::Program&) {}

}  // namespace slicecorr::farm
