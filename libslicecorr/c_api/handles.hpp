// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the handles of the C interface hold.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "c_api/guard.hpp"
#include "c_api/slice_store.hpp"
#include "slicecorr.h"
#include "slicecorr/dose_target.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::c_api {

/// All settings. An empty text, a number of 0 or less and a count below 0: not set.
struct Choices : SetupChoices {
  std::string leave_alone;  ///< path of what is shown as it is sliced; empty: nothing
  std::string part_inside;  ///< paths of meshes, one a line (`PartsInside`)
  /// How these meshes are turned and scaled, as programs have it (`Placement`).
  std::string units;
  double scale = 0, fit_mm = 0;
  std::vector<double> rotate_deg;
  double voxel_mm = 0;
  int angles = -1, iterations = -1;
  std::string method, window;
  double clip_sigma = 0, stop_error = 0, max_time_s = 0;
  std::string beyond_reach;       ///< refuse, allow
  std::string uncertain, robust;  ///< as the option --uncertain; on, off
  double tolerance_um = 0, gap_contrast = 0;
  std::string design, scan_unit;  ///< of a scan: the mesh that was sliced, the unit of its numbers
  double voxel_um = 0;
};

}  // namespace slicecorr::c_api

struct slicecorr_setup {
  slicecorr::c_api::Choices choices;
  std::string error;
};

struct slicecorr_job {
  int threads = 0;
  std::atomic<bool> cancelled{false};
  slicecorr_progress progress = nullptr;
  void* progress_user = nullptr;
  slicecorr_notice notice = nullptr;
  void* notice_user = nullptr;
  std::string scratch_folder;
  std::string error;
};

struct slicecorr_stack {
  std::string path;  ///< of the archive; empty: made in memory
  slicecorr::StackInfo info;
  slicecorr::MissingFacts missing;  ///< as the caller said
  /// Null: the images are in the archive only.
  std::shared_ptr<slicecorr::c_api::SliceStore> slices;
  std::vector<double> uv_of_pixel;
  std::shared_ptr<const slicecorr::c_api::SliceStore> doses;  ///< that are wanted; null: none
  slicecorr::DoseScale dose_scale;
};

struct slicecorr_figures {
  std::optional<slicecorr::Prediction> prediction;  ///< nothing: figures of a tomographic job
  std::string json;
  std::vector<std::pair<std::string, double>> numbers;  ///< by their places in `json`
};

struct slicecorr_list {
  std::vector<std::pair<std::string, std::string>> entries;  ///< name, text
};

namespace slicecorr::c_api {

/// The job of the library that does what `handle`, which may be null, says. Uses it: it must live
/// as long.
ExecutionContext job_of(slicecorr_job* handle);
/// Where scratch files go: what the job says, else the folder of `output`, else the system's.
std::string scratch_folder(const slicecorr_job* job, const std::string& output = "");

/// Throws `InputError` when `now`, what the archive says when its images are read, is not what it
/// said when the stack was opened: nothing is to be corrected twice because someone was faster.
void check_unchanged(const slicecorr_stack& stack, const StackInfo& now);

std::unique_ptr<slicecorr_figures> figures_of(const Prediction& prediction);
/// Figures of something else, from their JSON.
std::unique_ptr<slicecorr_figures> figures_of(std::string json);

using Names = std::vector<std::pair<std::string, std::string>>;
/// Names and meanings, for slicecorr_list.
Names setting_names();
Names property_names();
Names figure_names();
Names bench_property_names();
Names tomo_property_names();
Names tomo_figure_names();
/// Throws `UnknownName`.
[[noreturn]] void unknown_name(const char* name, const char* what, const Names& known);

}  // namespace slicecorr::c_api
