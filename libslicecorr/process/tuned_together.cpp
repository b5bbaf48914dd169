// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tuned_together.hpp"

#include <fmt/format.h>

#include "slicecorr/error.hpp"
#include "support/files/text_file.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {

DefinitionText DefinitionText::of_printer(const std::string& name) {
  const std::string path = find_definition(name, "printer");
  return {read_text_file(path), path};
}

void check_tuned_together(const DefinitionText& printer, const Resin& resin) {
  const toml::table root = parse_toml(printer.text, printer.source);
  const auto provenance = TomlTable(root, printer.source).table("provenance");
  if (!provenance || !provenance->has(kTunedFromResin)) return;
  const std::string before = provenance->text(kTunedFromResin, "");
  if (resin.name != before || !resin.tuned_with.empty()) return;
  throw InputError(
      printer.source, fmt::format("provenance.{}", kTunedFromResin),
      fmt::format(
          "is '{}': this printer's light was tuned together with that resin, of which this is the "
          "file from before; expected the resin file that was written with the printer's, or the "
          "printer file from before",
          before));
}

}  // namespace slicecorr
