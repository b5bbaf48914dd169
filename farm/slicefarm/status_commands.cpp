#include "commands.hpp"

namespace slicecorr::farm {

void add_status_commands(cli::Program&) {}

}  // namespace slicecorr::farm
