// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file scan_tune.hpp
/// What scans of printed parts say of resin and light (docs/scan.md).
///
/// A scan's point lies r away from the surface that the stack was predicted to print. Where an input of the print changes
/// by dx, that surface moves by u dx along its normal n; u comes from surfaces that are predicted with the input a little
/// higher and a little lower. So, with the pose (a small turn w and a shift t), for each point
///
///     r - sum of u dx + n (w x arm + t) = noise,
///
/// which is solved for all unknowns at once with what was known before as the prior, by least squares with the weights of
/// Cauchy, at last of Tukey, until nothing changes. What is off near to each other is off together: covariances are by how
/// much the answer changes when a cube of a twentieth of the diagonal is left out (a jackknife), with Student's t where few
/// cubes tell an input.
///
/// Plain values; functions are thread-safe, results do not depend on threads. Errors are `InputError`.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/scan.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::resins {

/// A print, as it was shown, and its scan. All must stay.
struct PrintScan {
  const Scan* scan = nullptr;
  const SliceSource* shown = nullptr;
  const Process* process = nullptr;  ///< how it was printed; null: as the setup says
};

/// What scans are asked for, in this order: the four of `TuneVector`, then what the part alone has.
enum class ScanInput {
  ha,
  light,
  stray,
  exchange,
  shrinkage_plane,
  shrinkage_z,
  walls,
  first_layers,
  spread,     ///< width of the light at the window
  scatter,    ///< `Resin::scatter_um2_per_um`
  dead_zone,  ///< logarithm of `Inhibition::beta`
};
inline constexpr std::size_t kScanInputs = 11;

/// One of them: a change, where the first four are those of `TuneVector`; shrinkage as a share of lengths, above 0
/// shorter; offsets in mm, above 0 outwards, that of the first layers falling to 0 where `Shrinkage::height_um` says;
/// spread in um, the standard deviation of all Gaussians together. All are changes of what the files say.
struct ScanFinding {
  double value = 0, sd = 0;  ///< found
  double sd_before = 0;      ///< known before
  bool sought = true;  ///< false: nothing of these prints, or not asked for; `sd` is as before
  /// The sd fell to half or less: the scan tells it.
  bool told() const { return sd <= 0.5 * sd_before; }
  /// Told, and beyond its 95 %.
  bool sure() const { return told() && (value > 1.96 * sd || value < -1.96 * sd); }
};

/// How far a surface is off as a whole at a place, after all that was found.
struct Unexplained {
  Point3 place{};  ///< mm
  double mean_um = 0;
  std::size_t points = 0;
};

struct ScanTuneResult {
  TuneResult tuned;                   ///< for the files of resin and printer
  std::vector<ScanFinding> findings;  ///< `kScanInputs`
  /// Combinations that the scans tell less of than was known before, in words: "ha 0.7, light -0.7".
  std::vector<std::string> not_apart;
  std::vector<Registration> registrations;  ///< with the poses after the fit
  double noise_um = 0;                      ///< of single points, from the median of what is left
  /// Root of the mean square of means over cubes, before and after: without the noise of single points.
  double before_um = 0, after_um = 0;
  std::vector<Unexplained>
      unexplained;  ///< the largest, at most five, beyond 4 standard deviations of noise
  std::size_t points = 0,
              left_out = 0;  ///< left out: beside the part, or where the surface comes and goes
  const ScanFinding& finding(ScanInput input) const {
    return findings[static_cast<std::size_t>(input)];
  }
  std::string to_text(const Printer& printer, const Resin& resin, const TunePrior& prior) const;
};

struct ScanTuneOptions {
  std::size_t points = 12'000;  ///< of each scan, at most
  int rounds = 12;              ///< at most
  /// `spread` and `scatter` where files say nothing of them: else they are taken for none. Where files say them, they
  /// are sought anyway, as is the dead zone under UV light.
  std::vector<ScanInput> seek{};
  /// Of a predicted surface that is held at once, > 0, 100 bytes each: what would have more is made in strips of image rows.
  double most_triangles = 4e6;
};

/// What a resin's file says from now on of shrinkage and first layers: what is told and lies beyond its 95 % is new;
/// nothing where nothing is.
std::optional<Shrinkage> found_shrinkage(const std::vector<ScanFinding>& findings,
                                         const Shrinkage& before);

/// The most probable inputs. `setup`: as the prints were made, by what is believed. Throws as `register_scan`, and where
/// nothing was scanned.
ScanTuneResult tune_by_scans(const std::vector<PrintScan>& prints, const Setup& setup,
                             const TunePrior& prior, const ScanTuneOptions& options = {},
                             const ExecutionContext& context = {});

/// A short mark of a scan's points, by which the same scan is known again whatever its file is called.
std::string mark_of(const Scan& scan);
/// The marks of scans that are to be counted, for `TuneResult::counted`. Throws `InputError` where two are one, or where the
/// text of a resin's file notes one of them: what was measured once would count twice.
std::vector<std::string> marks_to_count(const std::vector<Scan>& scans,
                                        const std::string& resin_text,
                                        const std::string& resin_source);

/// What a scan of a part would tell.
struct ScanForecast {
  std::string part;  ///< how it is called
  std::vector<ScanFinding> findings;
  std::vector<std::string> not_apart;
};
/// Of a print (`PrintScan::scan` is not heeded) of which places all over are seen, `noise_um` >= 0 off: the print that is
/// believed, made up, scanned and tuned by. Throws as `tune_by_scans`.
ScanForecast forecast_scan(const PrintScan& print, const Setup& setup, const TunePrior& prior,
                           double noise_um, const ScanTuneOptions& options = {},
                           const ExecutionContext& context = {});
/// A table of parts beside each other.
std::string forecast_text(const std::vector<ScanForecast>& parts, double noise_um);

/// A setup as findings say it is.
Setup tuned_setup(const Setup& setup, const TuneVector& x);

}  // namespace slicecorr::resins
