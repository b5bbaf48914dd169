// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file work.hpp
/// What a worker gets, does and leaves: files in the folder of its attempt, nothing else. A worker
/// knows neither database nor service, so it runs wherever the farm's store can be seen.
///
///     order.json     what to do (`WorkOrder`), before the worker starts
///     log.txt        all it says
///     progress.json  how far it is, replaced several times a second at most
///     out/NAME.uvj   the stack; NAME.html, NAME.json: report and figures, NAME-target.uvj and
///                    NAME-left-alone.uvj: its design and what was left alone, as `slicecorr run`; of
///                    tomographic prints NAME.frames, NAME.json and NAME.html, as `tomo solve` and `tomo report`
///     result.json    the end (`WorkOutcome`), by rename: who finds it finds it whole
///
/// Plain values and thread-safe functions; `do_work` is meant to be all that a process does. What
/// can't be read throws `InputError`, what can't be written `DeviceError`; `do_work` gives exit
/// codes instead.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/farm/job.hpp"
#include "slicecorr/plate.hpp"

namespace slicecorr::farm {

/// Of a tomographic print, in the words of `slicecorr tomo solve`.
struct TomoWork {
  bool volume = false;  ///< inputs are volumes (.npy), else meshes
  int inserts = 0;  ///< so many inputs, the last ones, turn with the part and let no light through
  double voxel_mm = 0;  ///< > 0
  std::string method = "ladder", window = "hamming";
  int angles = 0;                         ///< frames of a turn, >= 3
  int iterations = 0;                     ///< 0: the method's usual number
  double clip_sigma = 0, stop_error = 0;  ///< OSMO's; 0: neither
  double max_time_s = 0;                  ///< 0: no limit
  bool beyond_reach = false;
  bool operator==(const TomoWork&) const = default;
};

/// What decides the bytes of a result, besides the setup. Its canonical text is part of the key.
struct WorkSpec {
  /// "run": cut meshes; "correct": an archive of slices; "tomo": meshes or a volume, printed
  /// tomographically.
  std::string kind = "run";
  struct Input {
    std::string file;  ///< name in the store: SHA-256 and ending
    std::string sha256;
    std::string name;  ///< as submitted, for messages; not part of the key
  };
  std::vector<Input> inputs;
  int left_alone = 0;  ///< so many inputs, after the parts, are shown as they are sliced
  int inside =
      0;  ///< so many inputs, the last ones, are meshes that the archive holds beside supports
  std::optional<TomoWork> tomo;  ///< given exactly with kind "tomo"
  double layer_um = 0;           ///< 0: the archive says it
  std::string antialias = "on", units = "auto";
  double scale = 1;                           ///< of the mesh, a factor > 0
  std::vector<double> center_mm, rotate_deg;  ///< x and y; about x, y and z; empty: not given
  PlateChoices plate;
  std::string format = "uvj";  ///< of the archive or "frames", and its ending
  std::string ending = "uvj";
  std::string name;  ///< part of the key only where the format writes it into the archive
  /// By how much inputs may be off, as asked for, and the text of the resin's file where that says it
  /// (`fit`); empty: not asked.
  std::string uncertain, uncertain_resin_toml;
  bool robust = false;  ///< the correction is to allow for it
  /// What is known when it is submitted, by files that a worker does not see: its figures may not hold.
  std::vector<std::string> warnings;
};
std::string spec_json(const WorkSpec& spec);
WorkSpec parse_spec(const std::string& json);
/// SHA-256, 64 hex digits, of the canonical text of spec, setup and program version. `setup_json`: of
/// tomographic prints `definitions_json`.
std::string work_key(const WorkSpec& spec, const std::string& setup_json);

struct WorkOrder {
  std::string token;
  JobId job = 0;
  int number = 1;  ///< of the attempt, from 1
  std::string key, name;
  WorkSpec spec;
  std::string setup_json;
  std::string store;           ///< the farm's store, for inputs
  int threads = 1;             ///< >= 1
  std::int64_t memory_mb = 0;  ///< limit of the worker's own data; 0: none
};
void write_order(const std::string& folder, const WorkOrder& order);
WorkOrder read_order(const std::string& folder);

struct ProgressNote {
  std::string stage, node;
  double fraction = 0;    ///< of the whole work, 0..1
  int layers_done = 0;    ///< that share of all layers
  std::int64_t beat = 0;  ///< rises with every note
};
/// None when there is none (yet), or it is unreadable.
std::optional<ProgressNote> read_progress(const std::string& folder);

struct WorkOutcome {
  std::string token, key;
  int exit_code = 0;  ///< of the contract
  Reason reason = Reason::none;
  std::string message, node, program;
  ResultFigures figures;
  std::vector<ResultFile> files;
  std::int64_t voxels = 0;       ///< of the part's bounding box
  double wall_s = 0, cpu_s = 0;  ///< time that passed, processor time of all threads
  std::int64_t peak_mb = 0;      ///< greatest memory
};
/// None when the worker did not come to an end of its own.
std::optional<WorkOutcome> read_outcome(const std::string& folder);

/// Does the order in `folder`, writes result.json, and gives the exit code. Limits the memory of
/// this process: it is meant to be the only thing that a process does. Every engine runs it as
/// `slicefarm worker FOLDER`. `say` gets lines for the log.
int do_work(const std::string& folder, const std::atomic<bool>* cancel,
            const std::function<void(const std::string&)>& say);

}  // namespace slicecorr::farm
