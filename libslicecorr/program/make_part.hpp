/// The main job as programs do it: a corrected stack with the proof of what it prints beside it.
#pragma once

#include <functional>
#include <string>

#include "slicecorr/pipeline.hpp"

namespace slicecorr::cli {

/// Corrects `target` into `file`, and writes the figures (BASE.json: the prediction, with that of
/// the uncorrected part under "uncorrected") and the report (BASE.html), which gets this title.
/// `corrected` is called, when given, after the stack was written.
Correction make_part(const SliceSource& target, Setup setup, const StackFile& file,
                     const std::string& base, const std::string& title, const Job& job,
                     const std::function<void()>& corrected = {});

}  // namespace slicecorr::cli
