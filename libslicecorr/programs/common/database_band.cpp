// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/database_band.hpp"

#include <fmt/format.h>

#include <cstdlib>
#include <filesystem>

#include "slicecorr/process.hpp"

namespace slicecorr::cli {

namespace fs = std::filesystem;

std::string database_band(const std::string& resin) {
  // Ratios: NIST interlaboratory study of 24 laboratories, 2024 (docs/measured.md).
  if (resin.empty() || resin.ends_with(".toml")) return {};
  const fs::path found = fs::path(find_definition(resin, "resin")).lexically_normal();
  const char* const database = std::getenv("SLICECORR_DB");
  for (const std::string& own : {std::string(database ? database : ""), user_definition_folder()}) {
    if (own.empty()) continue;
    for (const fs::path& folder : {fs::path(own), fs::path(own) / "resins"}) {
      if ((folder / found.filename()).lexically_normal() == found) return {};
    }
  }
  return fmt::format(
      "resin '{}' is from the database, not measured on this printer: laboratories that measured one resin "
      "were up to 7 times apart in absorbance height and 70 times in dose, so heights hold to an order of "
      "magnitude until you measure here (slicecorr testpart staircase, slicecorr tune)",
      resin);
}

void tell_database_band(const std::string& resin, const ExecutionContext& context) {
  if (const std::string text = database_band(resin); !text.empty()) context.tell(text);
}

}  // namespace slicecorr::cli
