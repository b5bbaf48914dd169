#include "commands.hpp"

namespace slicecorr::resinctl {

void add_design(cli::Program& program) { (void)program; }

}  // namespace slicecorr::resinctl
