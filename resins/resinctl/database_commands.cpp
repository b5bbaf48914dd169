#include "commands.hpp"

namespace slicecorr::resinctl {

void add_database(cli::Program& program) { (void)program; }

}  // namespace slicecorr::resinctl
