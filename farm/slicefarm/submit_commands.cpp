#include "commands.hpp"

namespace slicecorr::farm {

void add_submit_commands(cli::Program&) {}

}  // namespace slicecorr::farm
