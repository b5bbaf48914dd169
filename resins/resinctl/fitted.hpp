// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the commands share that fit parameters of printers and resins.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "programs/common/program.hpp"
#include "slicecorr/resins/database.hpp"

namespace slicecorr::resinctl {

/// What `--fix NAME` holds where it begins, and `--fix NAME=VALUE` at a value. Throws `InputError`
/// with an `example` of what was expected.
void read_fixed(const std::vector<std::string>& texts, const char* example,
                std::set<std::string>& held, std::map<std::string, double>& fixed);

/// Files that a printer file names lie beside it: those of a new one in another folder, too, but for a
/// calibration, which becomes part of it. Throws `InputError` where others of these names are there.
void copy_its_files(const std::string& from, const std::string& to);

/// A fit as JSON, where `json` asks for it, and as text: on stderr where JSON goes to stdout.
template <class Fit>
void tell_fit(const Fit& fit, const std::string& json, cli::Console& console) {
  if (!json.empty()) cli::print_or_write(json, fit.to_json());
  if (json == "-") {
    console.say(fit.to_text());
  } else {
    cli::print_result(fit.to_text());
  }
}

/// Says which version of a definition was written.
void say_saved(const resins::Saved& saved, cli::Console& console);

}  // namespace slicecorr::resinctl
