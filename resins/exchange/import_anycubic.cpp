// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resin profiles of Anycubic's slicer, as they stand in its .pwsz archives and resin files (JSON).
//
//     depth_penetration_curve { light_intensity, safety_coefficient, current_tempcurve_selector,
//                               temperature_coefficients [ { temperature, x_coefficient,
//                                                            y_compensation } ] }
//
// The maker documents none of it. Read as depth_um = x ln(E) - y with E in uJ/cm², light_intensity
// in uW/cm², its default curve at 25 °C (197.78, 1803.2, 9000) says 198 um and 9.1 mJ/cm², as
// ordinary resins have, and its default margin of 1.6 gives 2.1 s for a layer of 50 um, as ordinary
// printers need. No other units come near.
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "exchange/import.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::resins {

namespace {

using nlohmann::json;

struct Curve {
  double temperature = 0, x = 0, y = 0;
};

class Reader {
 public:
  Reader(const ImportSource& source, const ImportOptions& options)
      : source_(source), options_(options) {}

  std::vector<Imported> read() {
    walk(detail::read_json(source_.text, {source_.path, ""}), "");
    return std::move(made_);
  }

 private:
  void walk(const json& node, const std::string& place) {
    if (node.is_object()) {
      if (const auto at = node.find("depth_penetration_curve"); at != node.end()) {
        take(node, *at, place + "/depth_penetration_curve");
      }
      for (const auto& [key, value] : node.items()) walk(value, place + "/" + key);
    } else if (node.is_array()) {
      for (std::size_t i = 0; i < node.size(); ++i) walk(node[i], fmt::format("{}/{}", place, i));
    }
  }

  static std::string text(const json& node, const char* key) {
    const auto at = node.find(key);
    return at != node.end() && at->is_string() ? at->get<std::string>() : "";
  }
  [[noreturn]] void fail(const std::string& place, const std::string& message) const {
    throw InputError(source_.path, place, message);
  }
  double number(const json& node, const char* key, const std::string& place) const {
    const auto at = node.find(key);
    if (at == node.end() || !at->is_number()) fail(place, fmt::format("has no number {}", key));
    return at->get<double>();
  }

  std::vector<Curve> curves_of(const json& list, const std::string& place) const {
    std::vector<Curve> curves;
    for (std::size_t i = 0; i < list.size(); ++i) {
      const std::string at = fmt::format("{}/temperature_coefficients/{}", place, i);
      const json& c = list[i];
      if (!c.is_object()) fail(at, "expected {temperature, x_coefficient, y_compensation}");
      curves.push_back({number(c, "temperature", at), number(c, "x_coefficient", at),
                        number(c, "y_compensation", at)});
    }
    return curves;
  }

  struct Chosen {
    std::size_t curve = 0;
    bool selected = false;  ///< by the profile's selector
  };
  /// The selector counts where it points at one; else the curve nearest to the target temperature.
  static Chosen choose(const std::vector<Curve>& curves, const json& curve, double target) {
    const auto selector_at = curve.find("current_tempcurve_selector");
    const int selector = selector_at != curve.end() && selector_at->is_number_integer()
                             ? selector_at->get<int>()
                             : -1;
    std::size_t chosen = 0;
    const bool selected = selector >= 0 && static_cast<std::size_t>(selector) < curves.size();
    if (selected) {
      chosen = static_cast<std::size_t>(selector);
    } else {
      for (std::size_t i = 1; i < curves.size(); ++i) {
        if (std::abs(curves[i].temperature - target) <
            std::abs(curves[chosen].temperature - target)) {
          chosen = i;
        }
      }
    }
    return {chosen, selected};
  }

  void take(const json& resin, const json& curve, const std::string& place) {
    const auto property_at = resin.find("property");
    const json property =
        property_at != resin.end() && property_at->is_object() ? *property_at : json::object();
    std::string title = text(property, "name");
    const std::string brand = text(property, "brand_name"), product = text(property, "resin_name");
    if (title.empty()) title = brand + " " + product;
    if (title.find(options_.only) == std::string::npos) return;
    const auto list = curve.is_object() ? curve.find("temperature_coefficients") : curve.end();
    if (!curve.is_object() || list == curve.end() || !list->is_array()) {
      fail(place,
           "expected temperature_coefficients: [{temperature, x_coefficient, y_compensation}, "
           "...]");
    }
    if (list->empty()) {
      source_.leave_out(
          fmt::format("{}: resin '{}' has no temperature_coefficients", place, title));
      return;
    }
    const std::vector<Curve> curves = curves_of(*list, place);
    const auto target_at = property.find("target_temperature");
    const double target =
        target_at != property.end() && target_at->is_number() ? target_at->get<double>() : 25.0;
    const auto [chosen, selected] = choose(curves, curve, target);
    const Curve& c = curves[chosen];
    const double dose_mj_cm2 = std::exp(c.y / c.x) * 1e-3;
    if (!(c.x > 0) || !(c.x < 1e4) || !(dose_mj_cm2 > 1e-4) || !(dose_mj_cm2 < 1e5)) {
      fail(place, fmt::format("the curve {:g} ln(E) - {:g} gives a height of {:g} um and a dose of "
                              "{:g} mJ/cm², which no resin has",
                              c.x, c.y, c.x, dose_mj_cm2));
    }
    ResinDraft d;
    std::string base = stable_name_of(title.empty() || title == " " ? source_.file : title);
    d.name = base;
    // The same resin may stand in a file once as the factory's and once as the user's.
    for (int n = 2; !names_.insert(d.name).second; ++n) d.name = fmt::format("{}-{}", base, n);
    if (!options_.name.empty()) d.name = options_.name;
    d.maker = brand;
    d.product = product.empty() ? title : product;
    d.notes = text(property, "type");
    d.height_e_um = c.x;
    d.gel_mj_cm2 = dose_mj_cm2;
    d.dose_factor = kDefaultDoseFactor;
    d.wavelength_nm = options_.wavelength_nm;
    const double intensity = curve.value("light_intensity", 0.0);
    const double safety = curve.value("safety_coefficient", 0.0);
    d.assumptions.emplace_back(
        "The maker documents no units. The curve is read as depth_um = x_coefficient ln(E) - "
        "y_compensation with E in uJ/cm², which gives figures of ordinary resins; not verified.");
    d.assumptions.push_back(fmt::format(
        "The curve at {:g} °C was taken ({}); dose {:.4g} mJ/cm² areal at depth 0.", c.temperature,
        selected ? "current_tempcurve_selector"
                 : fmt::format("nearest to the target temperature of {:g} °C", target),
        dose_mj_cm2));
    d.assumptions.push_back(fmt::format(
        "Correction aims at {:g} times that dose, the default; the profile's own margin "
        "(safety_coefficient {:g}) multiplies exposure times and is not used.",
        kDefaultDoseFactor, safety));
    d.assumptions.emplace_back("Intensity times time counts (m = 1).");
    d.provenance.emplace_back(
        "source", fmt::format("{}, depth_penetration_curve of '{}'", source_.file, title));
    std::string all;
    for (const Curve& k : curves) {
      all += fmt::format("{}{:g} °C: {:g}, {:g}", all.empty() ? "" : "; ", k.temperature, k.x, k.y);
    }
    d.provenance.emplace_back("curves", all);
    d.provenance.emplace_back("light_intensity", fmt::format("{:g} (uW/cm² as read)", intensity));
    d.provenance.emplace_back("measurements", "none in the profile");
    made_.push_back(finish_resin(d, source_, "anycubic"));
  }

  const ImportSource& source_;
  const ImportOptions& options_;
  std::vector<Imported> made_;
  std::set<std::string> names_;
};

}  // namespace

std::vector<Imported> import_anycubic(const ImportSource& source, const ImportOptions& options) {
  return Reader(source, options).read();
}

}  // namespace slicecorr::resins
