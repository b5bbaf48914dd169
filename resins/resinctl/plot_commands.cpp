#include "commands.hpp"

namespace slicecorr::resinctl {

void add_plot(cli::Program& program) { (void)program; }

}  // namespace slicecorr::resinctl
