// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Files of resins and printers with what was found.
#include "tune/files.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string_view>

#include "database/schema.hpp"
#include "database/toml_edit.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/scan_tune.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/tuned_together.hpp"
#include "slicecorr/units.hpp"
#include "support/toml/toml_table.hpp"
#include "tune/matrix.hpp"

namespace slicecorr::resins {

namespace {

constexpr const char* kFoundInScans = "# As slicecorr tune found it in scans.";
constexpr const char* kScatterKey = "scatter_um2_per_um";

}  // namespace

std::string tuned_with(const Printer& printer, bool exchange) {
  return fmt::format("{}{}{}{}: ", printer_and_light(printer), kTunedFigures,
                     is_relative(printer) ? "stray_of_full" : "stray_mw_cm2",
                     exchange ? ", exchange" : "");
}

namespace {

constexpr const char* kCounted = "tuned_by";

std::string counted_before(const std::string& text, const std::string& source) {
  const toml::table root = parse_toml(text, source);
  const auto provenance = TomlTable(root, source).table("provenance");
  return provenance && provenance->has(kCounted) ? provenance->text(kCounted, "") : std::string();
}

/// FNV-1a, of 64 bits.
class Mark {
 public:
  void add(std::string_view bytes) {
    for (const char c : bytes) mark_ = (mark_ ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  }
  std::string text() const { return fmt::format("{:016x}", mark_); }

 private:
  std::uint64_t mark_ = 0xcbf29ce484222325;
};

void refuse_counted(const std::string& before, const std::string& mark, const std::string& measured,
                    const std::string& resin_source) {
  if (before.find(mark) == std::string::npos) return;
  throw InputError(
      measured, "",
      fmt::format(
          "was counted before: '{}' was tuned by these measurements (provenance.{}), and counted "
          "again they would seem to say more than they do; expected new ones, or the resin file "
          "from before",
          resin_source, kCounted));
}

}  // namespace

std::string mark_of(const MeasuredPart& part) {
  Mark mark;
  for (const MeasuredEdge& e : part.edges) {
    if (std::isnan(e.measured_um)) continue;
    mark.add(fmt::format("{} {:.9g} {:.9g} {:.9g} {:.9g};", static_cast<int>(e.kind), e.designed_um,
                         e.exposure_s, e.intensity_mw_cm2, e.measured_um));
  }
  return mark.text();
}

std::string mark_of(const Scan& scan) {
  Mark mark;
  for (const Point3& p : scan.points) {
    for (const double c : p) {
      const auto bytes = std::bit_cast<std::array<char, sizeof c>>(c);
      mark.add({bytes.data(), bytes.size()});
    }
  }
  return mark.text();
}

std::vector<std::string> marks_to_count(const std::vector<Scan>& scans,
                                        const std::string& resin_text,
                                        const std::string& resin_source) {
  const std::string before = counted_before(resin_text, resin_source);
  std::vector<std::string> marks;
  for (const Scan& scan : scans) {
    std::string mark = mark_of(scan);
    refuse_counted(before, mark, scan.source, resin_source);
    if (std::find(marks.begin(), marks.end(), mark) != marks.end()) {
      throw InputError(scan.source, "",
                       "is one of the other scans once more; expected each scan once");
    }
    marks.push_back(std::move(mark));
  }
  return marks;
}

void check_not_counted(const std::string& resin_text, const std::string& resin_source,
                       const std::vector<MeasuredPart>& parts) {
  const std::string before = counted_before(resin_text, resin_source);
  std::map<std::string, std::string> given;
  for (const MeasuredPart& part : parts) {
    const auto [first, is_new] = given.emplace(mark_of(part), part.source);
    if (!is_new) {
      throw InputError(part.source, "",
                       fmt::format("holds the same measurements as {}; expected each table once",
                                   first->second));
    }
    refuse_counted(before, mark_of(part), part.source, resin_source);
  }
}

std::string name_in_file(const std::string& path, const std::string& before) {
  const std::string stem = std::filesystem::path(path).stem().string();
  return is_stable_name(stem) ? stem : before;
}

std::string resin_with_tuning(const std::string& text, const std::string& source,
                              const std::string& name, const Printer& printer,
                              const TuneResult& result) {
  TomlEdit edit(text, source);
  edit.set("", "name", toml_text(name));
  const toml::table parsed = parse_toml(text, source);
  const TomlTable root(parsed, source);
  const Resin before = parse_resin(text, source);
  const Resin after = tuned_resin(before, result.x);
  const bool relative = is_relative(before);
  const double full = relative ? full_light(result.x) : 1, height = std::exp(result.x[0]),
               areal = std::exp(-before.m * result.x[1]) / full;
  const auto scale = [&](const char* table, const char* key, double by) {
    const auto keys = root.table(table);
    if (!keys || !keys->has(key)) return false;
    edit.set(table, key, toml_number(keys->required_number(key, 0, 1e12) * by));
    edit.set_comment(table, key, "");
    return true;
  };
  const bool as_height = scale("cure", "absorbance_height_um", height);
  const bool as_absorption = scale("cure", "absorption_per_cm", 1 / height);
  if (!as_height && !as_absorption) {
    throw InputError(source, "cure.absorbance_height_um", "missing, which tune changes");
  }
  scale("cure", "active_absorption_per_cm", 1 / height);
  for (const char* key : {"critical_dose_mj_cm3", "gel_dose_mj_cm3"}) {
    scale("cure", key, areal / height);
  }
  for (const char* key :
       {"critical_dose_mj_cm2", "gel_dose_mj_cm2", "critical_dose_prime", "critical_dose_s"}) {
    scale("cure", key, areal);
  }
  if (relative) edit.set("cure", "display", toml_text(printer.name));
  if (before.inhibition) {
    scale("inhibition", "critical_dose_prime", std::exp(-before.inhibition->m * result.x[1]));
  }
  if (const auto& shrinkage = result.shrinkage) {
    const auto put = [&](const char* table, const char* key, double value) {
      edit.set(table, key, toml_number(value));
      edit.set_comment(table, key, kFoundInScans);
    };
    if (shrinkage->plane_per_cent != before.shrinkage.plane_per_cent) {
      put("shrinkage", "plane", shrinkage->plane_per_cent);
    }
    if (shrinkage->z_per_cent != before.shrinkage.z_per_cent) {
      put("shrinkage", "z", shrinkage->z_per_cent);
    }
    if (shrinkage->growth_um != before.shrinkage.growth_um) {
      put("first_layers", "growth_um", shrinkage->growth_um);
      put("first_layers", "height_um", shrinkage->height_um);
    }
  }
  const auto found = [&](const char* table, const char* key, double value) {
    edit.set(table, key, toml_number(value, 6));
    edit.set_comment(table, key, kFoundInScans);
  };
  if (result.scatter_um2_per_um) {
    found(edit.has("", kScatterKey) ? "" : "cure", kScatterKey, *result.scatter_um2_per_um);
  }
  if (result.uv_beta) found("inhibition", "beta", *result.uv_beta);
  // From now on it is a resin of this light.
  if (other_wavelength(printer, before)) {
    edit.set("cure", "wavelength_nm", toml_number(printer.wavelength_nm));
    edit.set_comment("cure", "wavelength_nm", "");
  }
  const TuneMatrix& c = result.covariance;
  if ((relative || after.gel_dose_mj_cm3 > 0) && before.m == 1) {
    const double h = units::height_e_from_10(after.absorbance_height10_um);
    const double d =
        relative ? critical_dose_s(after)
                 : units::areal_from_volumetric(after.gel_dose_mj_cm3, dose_height_e_um(after));
    edit.set("provenance", "covariance",
             toml_text(fmt::format("h_um, {}: [[{:.6g}, {:.6g}], [{:.6g}, {:.6g}]]",
                                   relative ? "critical_dose_s" : "dc_mj_cm2", c[0][0] * h * h,
                                   -c[0][1] * h * d, -c[0][1] * h * d, c[1][1] * d * d)));
  }
  // Stray light is counted as the new printer file says light.
  const double stray = std::exp(-result.x[1]) / full;
  std::string matrix;
  const std::size_t told = result.lift_exchange ? kTuned : kExchange;
  for (std::size_t i = 0; i < told; ++i) {
    for (std::size_t j = 0; j < told; ++j) {
      const double unit = (i == kStray ? stray : 1) * (j == kStray ? stray : 1);
      matrix += fmt::format("{}{:.8g}", j ? ", " : i ? "], [" : "[[", c[i][j] * unit);
    }
  }
  edit.set("provenance", "tuning",
           toml_text(tuned_with(tuned_printer(printer, before.m, result.x),
                                result.lift_exchange.has_value()) +
                     matrix + "]]"));
  if (!result.counted.empty()) {
    const std::string earlier = counted_before(text, source);
    edit.set("provenance", kCounted,
             toml_text(fmt::format("{}{}{}", earlier, earlier.empty() ? "" : ", ",
                                   fmt::join(result.counted, ", "))));
  }
  parse_resin(edit.text(), source);
  return edit.text();
}

std::string printer_with_tuning(const std::string& text, const std::string& source,
                                const Printer& printer, const TuneResult& result) {
  TomlEdit edit(text, source);
  std::string points;
  for (const CalibrationPoint& c : tuned_printer(printer, 1, result.x).calibration) {
    points += fmt::format("{}[{:g}, {}]", points.empty() ? "" : ", ", c.level,
                          toml_number(c.intensity_mw_cm2));
  }
  edit.set("", "name", toml_text(printer.name));
  edit.set("blue", "calibration", "[" + points + "]");
  edit.set_comment("blue", "calibration",
                   fmt::format("# Measured light and {:+.4g} {} of stray light at all levels, "
                               "which slicecorr tune found{}.",
                               result.x[2] * std::exp(-result.x[1]),
                               is_relative(printer) ? "of full light" : "mW/cm2",
                               is_relative(printer) ? "; in shares of both at the brightest" : ""));
  if (!result.resin_before.empty()) {
    edit.set("provenance", kTunedFromResin, toml_text(result.resin_before));
  }
  if (result.lift_exchange) {
    const auto at = [](const TuneMatrix& m) { return std::sqrt(m[kExchange][kExchange]); };
    edit.set("process", "lift_exchange", toml_number(*result.lift_exchange));
    edit.set_comment("process", "lift_exchange",
                     "# Share of resin that a lift exchanges, which slicecorr tune found.");
    edit.set("process", "lift_exchange_sd", toml_number(at(result.covariance), 3));
    edit.set_comment("process", "lift_exchange_sd", "# Its standard deviation.");
  }
  if (result.spread) {
    std::string gaussians;
    for (const SpreadGaussian& g : result.spread->gaussians) {
      gaussians += fmt::format("{}[{}, {}]", gaussians.empty() ? "" : ", ",
                               toml_number(g.sigma_um, 6), toml_number(g.weight, 6));
    }
    if (gaussians.empty()) {
      edit.remove("blue", "spread");
    } else {
      edit.set("blue", "spread", "[" + gaussians + "]");
      edit.set_comment("blue", "spread", kFoundInScans);
    }
  }
  parse_printer(edit.text(), source);
  return edit.text();
}

}  // namespace slicecorr::resins
