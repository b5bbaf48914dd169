/// The main job as programs do it: a corrected stack with the proof of what it prints beside it.
#pragma once

#include <string>

#include "slicecorr/pipeline.hpp"

namespace slicecorr::cli {

/// Corrects `target` into `file`, and writes the figures (BASE.json: the prediction, with that of
/// the uncorrected part under "uncorrected") and the report (BASE.html), which gets this title.
Correction make_part(const SliceSource& target, Setup setup, const StackFile& file,
                     const std::string& base, const std::string& title, const Job& job);

}  // namespace slicecorr::cli
