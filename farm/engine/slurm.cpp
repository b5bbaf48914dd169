#include "slicecorr/error.hpp"
#include "slicecorr/farm/engine.hpp"

namespace slicecorr::farm {

std::unique_ptr<Engine> make_slurm_engine(const SlurmEngineOptions&) {
  throw InputError("the engine slurm is not in this build; expected --engine local");
}

}  // namespace slicecorr::farm
