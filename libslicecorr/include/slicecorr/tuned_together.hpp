// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tuned_together.hpp
/// The two files that tuning writes belong together. The resin's says with which printer and light
/// (same_light.hpp), the printer's which resin: with the file of that resin from before, stray light
/// would count and the dose that was found with it would not. Other resins take the printer as it is:
/// its stray light is theirs, too.
///
/// Thread-safe.
#pragma once

#include <string>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// The key of a printer file's [provenance] that names that resin, as it was called before.
inline constexpr const char* kTunedFromResin = "tuned_from_resin";

/// A definition as text, and what messages call it.
struct DefinitionText {
  std::string text, source;
  /// By name or path. Throws `InputError` where it can't be read.
  static DefinitionText of_printer(const std::string& name);
};

/// Throws `InputError` where the printer was tuned together with a resin of this name, and this one
/// was not tuned.
void check_tuned_together(const DefinitionText& printer, const Resin& resin);

}  // namespace slicecorr
