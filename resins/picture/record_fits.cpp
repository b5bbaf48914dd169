// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <filesystem>
#include <set>

#include "slicecorr/error.hpp"
#include "slicecorr/resins/plots.hpp"

namespace slicecorr::resins {

FitOptions on_resin(const Resin& resin, FitOptions options) {
  if (resin.has_gel_time()) {
    throw InputError(resin.name, "cure.model",
                     "is \"gel-time\"; dead zones follow the kinetic law: expected a resin of it");
  }
  const Kinetics k = make_kinetics(resin, false, false);
  options.hb_um = k.hb_um;
  options.critical_dose_prime = k.critical_dose_prime;
  options.m = k.m;
  return options;
}

FitModel dead_zone_model(const ResinRecord& record) {
  const auto said = record.provenance.find("dead_zone_fit");
  if (said != record.provenance.end()) {
    for (const FitModel model : {FitModel::dead_zone_steady, FitModel::dead_zone_transient}) {
      if (said->second.starts_with(name_of(model))) return model;
    }
  }
  const auto& i = record.resin.inhibition;
  const bool own_law = i && (i->m != record.resin.m || i->critical_dose_prime > 0);
  return own_law ? FitModel::dead_zone_transient : FitModel::dead_zone_steady;
}

bool has_intensities(const Measurements& data) {
  std::set<double> intensities;
  for (const CuredHeight& c : data.cured) {
    if (!(c.blue_mw_cm2 > 0)) return false;
    intensities.insert(c.blue_mw_cm2);
  }
  return intensities.size() >= 2;
}

RecordFits fits_of_record(const ResinRecord& record, const ExecutionContext& context) {
  RecordFits result;
  if (record.measurements.empty()) return result;
  const auto attempt = [&](auto action) {
    try {
      action();
    } catch (const InputError& e) {
      result.problems.emplace_back(e.what());
    }
  };
  Measurements data;
  attempt([&] {
    std::vector<std::string> paths;
    for (const std::string& name : record.measurements) {
      paths.push_back((std::filesystem::path(record.path).parent_path() / name).string());
    }
    data = read_measurements(paths, context);
  });
  if (!data.cured.empty()) {
    attempt([&] { result.fits.push_back(fit(data, FitModel::jacobs, {}, context)); });
    if (record.resin.bleaches()) {
      attempt([&] { result.fits.push_back(fit(data, FitModel::bleaching, {}, context)); });
    }
    if (has_intensities(data)) {
      attempt([&] { result.fits.push_back(fit(data, FitModel::kinetic, {}, context)); });
      if (record.resin.has_gel_time()) {
        attempt([&] { result.fits.push_back(fit(data, FitModel::gel_time, {}, context)); });
      }
    }
  }
  if (!data.dead_zones.empty()) {
    attempt([&] {
      result.fits.push_back(fit(data, dead_zone_model(record), on_resin(record.resin), context));
    });
  }
  return result;
}

}  // namespace slicecorr::resins
