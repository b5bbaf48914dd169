#include "commands.hpp"

namespace slicecorr::resinctl {

void add_fit(cli::Program& program) { (void)program; }

}  // namespace slicecorr::resinctl
