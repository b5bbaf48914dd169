// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "post/decide.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

#include "post/profiles.hpp"
#include "programs/common/database_band.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/settings.hpp"

namespace slicecorr::post {

namespace {

std::string variable(const char* name) {
  const char* const value = std::getenv(name);
  return value ? value : "";
}

std::string exposure_in_words(const Process& p) {
  if (p.mode == ExposureMode::continuous) return fmt::format("continuous, {:g} mm/h", p.speed_mm_h);
  return "layer by layer, " + exposures_in_words(p);
}

void refuse_corrected(const StackInfo& info, const std::string& path) {
  if (info.kind != StackKind::corrected) return;
  std::string how;
  if (info.printer && info.resin && info.process) {
    how = " for " + in_one_line(*info.printer, *info.resin, *info.process);
  }
  throw AlreadyCorrected(
      path, "",
      fmt::format(
          "is already corrected{}{}; expected the slicer's file, or --again, which corrects its "
          "backup anew",
          how, info.program.empty() ? "" : ", by " + info.program));
}

void check_fits(const StackInfo& info, const Printer& printer) {
  const Grid& g = info.grid;
  if (g.width_px != printer.width_px || g.height_px != printer.height_px) {
    const bool turned = g.width_px == printer.height_px && g.height_px == printer.width_px;
    throw InputError(fmt::format(
        "its images have {} x {} pixels; the display of printer '{}' has {} x {}{}", g.width_px,
        g.height_px, printer.name, printer.width_px, printer.height_px,
        turned
            ? ": they are turned by 90 degrees; expected a printer file with width and height as "
              "the images have them"
            : ""));
  }
  const auto differ = [](double archive, double ours) {
    return archive > 0 && std::abs(archive - ours) > 0.01 * ours;
  };
  if (differ(g.pixel_x_um, printer.pixel_x_um) || differ(g.pixel_y_um, printer.pixel_y_um)) {
    throw InputError(fmt::format(
        "its pixels are {:.4g} x {:.4g} um; those of printer '{}' are {:g} x {:g} um", g.pixel_x_um,
        g.pixel_y_um, printer.name, printer.pixel_x_um, printer.pixel_y_um));
  }
}

/// Finds out one thing after the other; each may use those before it.
class Deciding {
 public:
  Deciding(const std::string& archive, const std::string& named, const PostRequest& request)
      : request_(request) {
    decision_.info = read_archive(archive);
    refuse_corrected(decision_.info, archive);
    profiles_ = decision_.info.profiles;
    // Where the slicer that calls us says its profiles, they are those of this file.
    const auto said = [](std::string& name, const std::string& by_slicer) {
      if (!by_slicer.empty()) name = by_slicer;
    };
    said(profiles_.printer, request.slicer.profiles.printer);
    said(profiles_.material, request.slicer.profiles.material);
    rule_ = request.config.match({named, profiles_});
  }

  Decision decide() {
    Values values = request_.config.defaults;
    if (rule_ != nullptr) {
      values = over(values, rule_->values);
      decision_.rule =
          fmt::format("rule '{}' ({}, line {})", rule_->name, request_.config.path, rule_->line);
    }
    said_ = over(values, request_.given);
    decision_.settings = settings_of(said_);
    if (decision_.settings.leave_alone) return std::move(decision_);
    find_definitions();
    cli::SetupOptions& setup = decision_.settings.setup;
    if (setup.mode.empty() && !(setup.speed_mm_h > 0)) setup.mode = "layerwise";
    try {
      decision_.setup = setup.resolve(nullptr, &decision_.info);
    } catch (const InputError& e) {
      throw InputError(e.what() + said_by_rules());
    }
    find_facts();
    find_exposure();
    return std::move(decision_);
  }

 private:
  std::string source_of(const std::string& name) const {
    if (request_.given.contains(name)) return "the command line";
    if (rule_ != nullptr && rule_->values.contains(name)) return decision_.rule;
    return fmt::format("[default] of {}", request_.config.path);
  }

  /// Which settings nobody said on the command line, and who said them: messages do not tell that.
  std::string said_by_rules() const {
    std::map<std::string, std::string> by_source;
    for (const auto& [name, value] : said_) {
      std::string field = name;
      std::replace(field.begin(), field.end(), '-', '_');
      if (request_.given.contains(name) || find_setting(field) == nullptr) continue;
      by_source[source_of(name)] += " " + name + ",";
    }
    std::string text;
    for (auto& [source, names] : by_source) {
      names.pop_back();
      text += fmt::format("{}{} by {}", text.empty() ? " (said" : ";", names, source);
    }
    return text.empty() ? text : text + ")";
  }

  void find_definitions() {
    cli::SetupOptions& setup = decision_.settings.setup;
    const auto find = [&](const char* kind, std::string& name, const std::string& profile,
                          const char* key, double wavelength_nm) {
      if (!name.empty()) return source_of(kind);
      name = definition_of_profile(profile, kind, wavelength_nm);
      if (!name.empty()) return fmt::format("the archive's profile '{}'", profile);
      throw InputError(fmt::format(
          "no {0} is given{1}; expected --{0}, or a rule in {2}{3}", kind,
          profile.empty()
              ? fmt::format(", and the archive names none")
              : fmt::format(", and none is known for the archive's profile '{}'", profile),
          request_.config.path.empty() ? "post.toml" : request_.config.path,
          profile.empty() ? "" : fmt::format(" with {} = \"{}\"", key, profile)));
    };
    decision_.printer_from =
        find("printer", setup.printer, profiles_.printer, "printer_profile", 0);
    decision_.resin_from = find("resin", setup.resin, profiles_.material, "material_profile",
                                load_display(setup.printer).wavelength_nm);
  }

  void find_facts() {
    const Grid& g = decision_.info.grid;
    const Printer& printer = decision_.setup.printer;
    check_fits(decision_.info, printer);
    MissingFacts& facts = decision_.missing;
    facts.pixel_x_um = g.pixel_x_um > 0 ? g.pixel_x_um : printer.pixel_x_um;
    facts.pixel_y_um = g.pixel_y_um > 0 ? g.pixel_y_um : printer.pixel_y_um;
    const double asked_um = decision_.settings.layer_um;
    if (!(g.layer_um > 0) && !(asked_um > 0)) {
      throw InputError("the archive does not say its layer height; expected --layer-um");
    }
    if (g.layer_um > 0 && asked_um > 0 && std::abs(g.layer_um - asked_um) > 1e-6 * asked_um) {
      throw InputError(
          fmt::format("its layers are {:g} um high; --layer-um says {:g}", g.layer_um, asked_um));
    }
    facts.layer_um = g.layer_um > 0 ? g.layer_um : asked_um;
  }

  void find_exposure() {
    const cli::SetupOptions& s = decision_.settings.setup;
    const bool given =
        s.exposure_s > 0 || s.bottom_exposure_s > 0 || s.bottom_layers >= 0 || s.fade_layers >= 0;
    if (decision_.setup.process.mode == ExposureMode::continuous) {
      decision_.exposure_from = source_of("speed-mm-h");
    } else if (!given) {
      decision_.exposure_from = "the archive's times";
    } else {
      decision_.exposure_from = s.exposure_s > 0 ? source_of("exposure-s") : "the archive in part";
    }
  }

  const PostRequest& request_;
  Decision decision_;
  ArchiveProfiles profiles_;
  const Rule* rule_ = nullptr;
  Values said_;  ///< all that holds of rules and command line
};

}  // namespace

SlicerCall slicer_call_from_environment() {
  SlicerCall call;
  const std::string host = variable("SLIC3R_PP_HOST");
  const std::string name = variable("SLIC3R_PP_OUTPUT_NAME");
  call.by_slicer = !host.empty() || !name.empty();
  // For other hosts it is a name there.
  if ((host.empty() || host == "File") && !name.empty() && name.front() == '/') {
    call.output_name = name;
  }
  if (!call.by_slicer) return call;
  call.profiles = {variable("SLIC3R_PRINTER_SETTINGS_ID"),
                   variable("SLIC3R_SLA_MATERIAL_SETTINGS_ID"),
                   variable("SLIC3R_SLA_PRINT_SETTINGS_ID")};
  return call;
}

std::string in_one_line(const Printer& printer, const Resin& resin, const Process& process) {
  return fmt::format("printer '{}', resin '{}', {}", printer.name, resin.name,
                     exposure_in_words(process));
}

StackInfo read_archive(const std::string& path) {
  try {
    return StackReader::read_info(path);
  } catch (const InputError& e) {
    throw NotReadable(e.what());
  }
}

Decision decide(const std::string& archive, const std::string& named, const PostRequest& request) {
  return Deciding(archive, named, request).decide();
}

std::string describe(const Decision& d) {
  std::string text = fmt::format("rule      {}\n", d.rule.empty() ? "none matches" : d.rule);
  if (d.settings.leave_alone) return text + "file      is left alone\n";
  const Grid& g = d.info.grid;
  text += fmt::format(
      "archive   {}, {} slices of {:g} um, {} x {} pixels of {:.4g} x {:.4g} um\n"
      "printer   {}, from {}\nresin     {}, {:g} um base 10, from {}\nexposure  {}, from {}\n"
      "backup    {}\nreport    {}\n",
      d.info.format, g.layers, d.missing.layer_um, g.width_px, g.height_px, d.missing.pixel_x_um,
      d.missing.pixel_y_um, d.setup.printer.name, d.printer_from, d.setup.resin.name,
      d.setup.resin.absorbance_height10_um, d.resin_from, exposure_in_words(d.setup.process),
      d.exposure_from, d.settings.backup.empty() ? "none" : d.settings.backup,
      d.settings.report.empty() ? "none" : d.settings.report);
  for (const std::string& notice : setup_notices(d.setup, &d.info, ChoiceNames::options)) {
    text += fmt::format("note      {}\n", notice);
  }
  for (const std::string& words : cli::unmeasured_in_words(d.settings.setup, d.setup)) {
    text += fmt::format("note      {}\n", words);
  }
  return text;
}

}  // namespace slicecorr::post
