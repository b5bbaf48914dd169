#include "commands.hpp"

namespace slicecorr::farm {

void add_control_commands(cli::Program&) {}

}  // namespace slicecorr::farm
