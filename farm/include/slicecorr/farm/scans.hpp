// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file scans.hpp
/// Scans of prints: compared with what a job's stack was predicted to print, kept beside its results,
/// charted over prints, and told to the next job.
///
/// The programs do the work (`slicecorr scan compare`, `tune --scan`), as children of whoever calls:
/// servers call through a process of their own. What does not fit throws `InputError`, with the
/// program's own words; failing disks `DeviceError`. Functions are thread-safe, but a `Queue` and a
/// `ReadModel` belong to one thread.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/scan.hpp"

namespace slicecorr::farm {

/// Bytes of one scan at most.
inline constexpr std::int64_t kMostScanBytes = std::int64_t{2} << 30;

/// A scan that somebody has.
struct NewScan {
  JobId job = 0;
  std::string path;  ///< a file: mesh, points or volume (.npy)
  std::string user;
  std::string unit = "auto";  ///< as `slicecorr scan compare --scan-unit`
  double voxel_um = 0;        ///< of volumes; else 0
};
struct TakenScan {
  KeptScan scan;
  std::string words;  ///< of the comparison, lines of plain text
  std::string drift;  ///< that the print lies beyond its band, in a sentence; empty: it does not
  std::vector<std::string> notes;
};
/// Compares a scan with its job's print and keeps both. Throws where the job is not done, is
/// tomographic, or its stack is not as it was; where the scan is too large, none of this part, or one
/// more than `kMostScansOfJob`; where the farm's disk has less than its setting `min-free-mb` left.
TakenScan take_scan(const FarmFolder& folder, const NewScan& given);
/// Its files go. False: there is none.
bool remove_scan(const FarmFolder& folder, Queue& queue, const KeptScan& scan,
                 const std::string& by);
/// The scan of a job with this number; throws where there is none.
KeptScan scan_of(ReadModel& model, JobId job, int number);

/// Prints of one printer and resin that were scanned, in the order of their scans, each scan a print.
struct PrintsOverTime {
  std::string printer, resin;
  std::vector<KeptScan> scans;
  /// Of three or more; its bands are those of the prints before the last, of at most the first
  /// `kSettledScans`.
  std::optional<ScanDrift> drift;
};
inline constexpr std::size_t kSettledScans = 20;
/// The last print is told to lie beyond its band where so many came before it.
inline constexpr std::size_t kLeastSettledScans = 8;
/// By printer and resin, the one with the newest scan first.
std::vector<PrintsOverTime> prints_over_time(ReadModel& model);
/// That the last print lies beyond its band, in a sentence; empty: it does not, or too few came before.
std::string beyond_in_words(const PrintsOverTime& prints);
/// What `slicefarm scans --json` and the REST API give.
std::string prints_over_time_json(const std::vector<PrintsOverTime>& all);

/// The next print of a job, corrected anew.
struct NextAsk {
  JobId job = 0;
  std::vector<int> scans;  ///< numbers; empty: all of the job's
  std::string user;
  std::string printer, resin;  ///< names or files to tune; empty: those of the job's names
  std::string folder = ".";    ///< in which resin, printer and what was told are written
};
/// The name of a printer or resin that scans of a job tuned, and of its file without ".toml".
std::string tuned_name(const std::string& name, JobId job);
struct NextMade {
  NextPrint print;
  std::string resin, printer;  ///< paths of the files that were tuned
  std::vector<std::string> notes;
};
/// Tunes printer and resin of a job by its scans (`slicecorr tune --scan`) and queues the job again
/// with both. Throws where the job has no scans, the database has its printer or resin no more, or its
/// inputs were collected.
NextMade make_next(const FarmFolder& folder, const NextAsk& ask, const ExecutionContext& context);

}  // namespace slicecorr::farm
