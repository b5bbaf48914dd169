// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Print files of resin printers (GOO, CTB and the like): the times and the light that a slicer wrote
// into them for a resin.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>

#include "exchange/import.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/print_file.hpp"
#include "support/text/ascii.hpp"
#include "support/text/csv.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::resins {

namespace {

/// Of 255, of layers as a rule and of bottom layers.
struct LampSettings {
  int normal = 255, bottom = 255;
};

/// "light: 128 of 255, 255 for bottom layers", as files tell it to people.
std::optional<LampSettings> lamp_of(const std::vector<std::pair<std::string, std::string>>& facts) {
  const auto at =
      std::find_if(facts.begin(), facts.end(), [](const auto& f) { return f.first == "light"; });
  if (at == facts.end()) return std::nullopt;
  const std::string& text = at->second;
  const auto leading = [&](std::size_t from) {
    return number_in_text(text.substr(from, text.find_first_not_of("0123456789", from) - from));
  };
  constexpr std::string_view of = " of 255, ";
  const std::size_t bottom = text.find(of);
  if (bottom == std::string::npos) return std::nullopt;
  const auto normal = leading(0), first = leading(bottom + of.size());
  if (!normal || !first) return std::nullopt;
  return LampSettings{static_cast<int>(*normal), static_cast<int>(*first)};
}

}  // namespace

bool is_print_file(const std::string& path, const std::string& begin) {
  // Zips of images and tars hold their slicer's profile as text, which is what is read of those.
  const bool packed = begin.starts_with("PK") || begin.starts_with("\x1f\x8b");
  const std::string name = lower_case(std::filesystem::path(path).filename().string());
  for (const FormatInfo& format : archive_formats()) {
    if (packed && !format.codes_layers) continue;
    const bool known =
        std::any_of(format.endings.begin(), format.endings.end(),
                    [&](const std::string& ending) { return name.ends_with(ending); });
    if (known) return !print_file_facts(path).empty();
  }
  return false;
}

std::vector<Imported> import_print_file(const ImportSource& source, const ImportOptions& options) {
  const StackInfo info = StackReader::read_info(source.path);
  if (!(info.exposure_s > 0) || !(info.grid.layer_um > 0)) {
    throw InputError(source.path, "",
                     fmt::format("is a print file that says no {}; expected one that does",
                                 info.exposure_s > 0 ? "layer height" : "exposure time"));
  }
  const std::optional<LampSettings> lamp = lamp_of(print_file_facts(source.path));
  if (lamp && lamp->normal == 0) {
    throw InputError(source.path, "light", "is 0 of 255; expected a print file that gives light");
  }
  const std::string material = text::printable(info.profiles.material);
  ResinDraft draft;
  draft.product = material;
  draft.name =
      options.name.empty()
          ? stable_name_of(material.empty() ? std::filesystem::path(source.file).stem().string()
                                            : material)
          : options.name;
  draft.assumptions.push_back(
      fmt::format("The file is a print of {} layers of {:g} um; {:g} s is the exposure of its "
                  "layers as a rule.",
                  info.grid.layers, info.grid.layer_um, info.exposure_s));
  if (!info.layer_exposure_s.empty()) {
    draft.assumptions.emplace_back(
        "Its layers have exposures of their own, too, which were not used.");
  }
  if (info.bottom_layers > 0 && info.bottom_exposure_s > 0) {
    draft.assumptions.push_back(fmt::format(
        "Its first {} layers get {:g} s so that the part sticks, {} more lead from one to "
        "the other; they say nothing of the resin and were not used.",
        info.bottom_layers, info.bottom_exposure_s, info.fade_layers));
  }
  if (!lamp) {
    draft.assumptions.emplace_back(
        "The file says nothing of how bright the lamp is driven; it is taken for all of it.");
  } else {
    draft.assumptions.push_back(fmt::format(
        "The file drives the lamp at {} of 255, bottom layers at {} of 255; light is taken to go "
        "with that number.",
        lamp->normal, lamp->bottom));
    draft.provenance.emplace_back(
        "lamp", fmt::format("{} of 255, {} of 255 for bottom layers", lamp->normal, lamp->bottom));
  }
  const std::string printer = text::printable(info.profiles.printer);
  if (!printer.empty()) draft.provenance.emplace_back("printer", printer);
  draft.provenance.emplace_back("source", fmt::format("{}, format {}", source.file, info.format));
  const std::string problem =
      resin_of_exposures({{info.grid.layer_um, info.exposure_s}}, options, draft,
                         lamp ? std::min(lamp->normal, 255) / 255.0 : 1);
  if (!problem.empty()) throw InputError(source.path, "", problem);
  return {finish_resin(draft, source, "print-file")};
}

}  // namespace slicecorr::resins
