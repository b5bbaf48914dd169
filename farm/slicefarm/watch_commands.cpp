#include "commands.hpp"

namespace slicecorr::farm {

void add_watch_commands(cli::Program&) {}

}  // namespace slicecorr::farm
