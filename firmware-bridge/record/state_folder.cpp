// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <vector>

#include "record/left_json.hpp"
#include "slicecorr/bridge/record.hpp"
#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/open_to_all.hpp"
#include "support/files/temporary.hpp"
#include "support/files/text_file.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/text/ascii.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::bridge {
namespace {

using slicecorr::detail::number_in, slicecorr::detail::text_in, slicecorr::detail::whole_in;

std::string base_folder(const std::string& dir) {
  if (!dir.empty()) return dir;
  const auto variable = [](const char* name) {
    const char* const value = std::getenv(name);
    return std::string(value != nullptr ? value : "");
  };
  if (auto own = variable("SLICECORR_BRIDGE_DIR"); !own.empty()) return own;
  if (const auto state = variable("XDG_STATE_HOME"); !state.empty()) {
    return state + "/slicecorr/bridge";
  }
  if (const auto home = variable("HOME"); !home.empty()) {
    return home + "/.local/state/slicecorr/bridge";
  }
  throw InputError("no folder for the printer's state: expected --dir, or $HOME");
}

int open_lock(const StateFolder& folder) {
  const std::string path = folder.file("print.lock");
  const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (file < 0) {
    throw DeviceError(fmt::format("{}: can't be opened: {}", path, std::strerror(errno)));
  }
  return file;
}

/// Last event that says that a print begins, ends or was looked at, with the last frame.
struct JournalEnd {
  bool open = false;
  std::string stack, last;
  int frame = kBlackFrame;
  double stage_um = 0;
  std::optional<double> start_um;  ///< of the first frame
  double um_per_deg = 0;           ///< of a stage that turns
};
JournalEnd journal_of(const StateFolder& folder) {
  JournalEnd end;
  std::ifstream file(folder.file("journal.jsonl"));
  // Without a journal nothing was printed; of one that can't be read nobody knows how it ended.
  if (!file && errno != ENOENT) {
    throw DeviceError(detail::errno_message(folder.file("journal.jsonl"), "can't be read"));
  }
  std::string line;
  while (std::getline(file, line)) {
    const auto json = slicecorr::detail::try_json(line);
    if (!json.is_object()) continue;  // halved by a power cut
    const std::string what = text_in(json, "what");
    if (what == kJournalBegin) {
      end.open = true;
      end.stack = text_in(json, "detail");
      end.start_um.reset();
      end.um_per_deg = 0;
      const auto& facts = slicecorr::detail::member_of(json, "facts");
      end.start_um = number_in(facts, "start_um");
      end.um_per_deg = number_in(facts, "um_per_deg", 0);
    } else if (what == kJournalEnd) {
      end.open = false;
    }
    end.last = what;
    end.frame = whole_in(json, "frame", kBlackFrame);
    end.stage_um = number_in(json, "stage_um", 0);
  }
  return end;
}

/// Numbers of the last whole row of the frame log; empty without one.
std::vector<double> last_row(const StateFolder& folder) {
  std::ifstream file(folder.file("frames.csv"));
  std::vector<double> last;
  std::string line;
  while (std::getline(file, line) && !file.eof()) {  // halved where it has no end
    std::vector<double> row;
    for (const std::string_view cell : comma_separated(line)) {
      const auto number = number_in_text(cell);
      row.push_back(number.value_or(0));
      if (!number) break;
    }
    if (row.size() > 2 && is_digit(line[0])) last = row;
  }
  return last;
}

}  // namespace

StateFolder StateFolder::of(const std::string& dir, const Printer& printer) {
  const std::string& name = printer.name;
  if (name.empty() || name.front() == '.' || name.find('/') != std::string::npos) {
    throw InputError(fmt::format("the printer's name '{}' can't be that of a folder", name));
  }
  StateFolder folder{base_folder(dir) + "/" + name};
  detail::make_own_folder(folder.path);
  return folder;
}

PrintLock::PrintLock(const StateFolder& folder) : file_(open_lock(folder)) {
  if (::flock(file_, LOCK_EX | LOCK_NB) == 0) return;
  ::close(file_);
  throw InputError(folder.path, "", "another printbridge is at work with this printer");
}
PrintLock::~PrintLock() { ::close(file_); }
bool PrintLock::held(const StateFolder& folder) {
  const int file = open_lock(folder);
  const bool free = ::flock(file, LOCK_EX | LOCK_NB) == 0;
  ::close(file);
  return !free;
}

void write_whole(const std::string& path, const std::string& text) {
  detail::Temporary part{detail::make_temporary(path)};
  {
    std::ofstream file(part.path, std::ios::binary);
    file << text;
    file.flush();
    if (!file) throw DeviceError(path + ": can't be written");
  }
  detail::put_in_place(part, path);
}

std::optional<Latch> read_latch(const StateFolder& folder, bool locked) {
  if (std::error_code none; std::filesystem::exists(folder.file("latch.json"), none)) {
    Latch latch;
    const auto json = slicecorr::detail::try_json<nlohmann::ordered_json>(
        text_of_file(folder.file("latch.json")).value_or(""));
    if (!json.is_object()) {
      latch.fault = Fault::defect;
      latch.detail = "latch.json can't be read";
      return latch;
    }
    latch.fault = fault_of(text_in(json, "fault")).value_or(Fault::defect);
    latch.detail = text_in(json, "detail");
    latch.stack = text_in(json, "stack");
    latch.frame = whole_in(json, "frame", kBlackFrame);
    latch.stage_um = number_in(json, "stage_um", 0);
    latch.z_um = number_in(json, "z_um", 0);
    if (const auto left = json.find("after_fault"); left != json.end()) {
      latch.left = left_in(*left);
    }
    return latch;
  }
  const JournalEnd end = journal_of(folder);
  if (!end.open || (!locked && PrintLock::held(folder))) return std::nullopt;
  Latch latch{Fault::defect,
              "the print was killed, or the power failed: its journal ends with '" + end.last + "'",
              end.stack,
              end.frame,
              end.stage_um,
              0,
              {}};
  latch.left = Left{};
  latch.left->touched = latch.left->bridge_gone = true;
  // Frames are logged within a second, so that it was there or somewhat further.
  if (const auto row = last_row(folder); row.size() > 2 && row[0] >= latch.frame) {
    latch.frame = static_cast<int>(row[0]);
    latch.z_um = row[2];
    if (end.start_um) latch.stage_um = *end.start_um + latch.z_um;
    if (row.size() > 9) {
      latch.left->measured = true;
      latch.left->blue_measured = row[9];
      latch.left->stage_um = latch.stage_um;
      if (end.um_per_deg > 0) latch.left->stage_deg = latch.stage_um / end.um_per_deg;
      if (row.size() > 10) latch.left->uv_measured = row[10];
    }
  }
  return latch;
}

void write_latch(const StateFolder& folder, const Latch& latch) {
  nlohmann::ordered_json json;
  // What must be seen first stands first.
  if (latch.left) json["after_fault"] = left_json(*latch.left);
  json["fault"] = name_of(latch.fault);
  json["detail"] = latch.detail;
  json["stack"] = latch.stack;
  json["frame"] = latch.frame;
  json["stage_um"] = latch.stage_um;
  json["z_um"] = latch.z_um;
  write_whole(folder.file("latch.json"), json.dump(1) + "\n");
}

void clear_latch(const StateFolder& folder) {
  if (journal_of(folder).open) {
    std::ofstream file(folder.file("journal.jsonl"), std::ios::app);
    // A line of its own also where the last one was halved.
    file << "\n{\"what\":\"" << kJournalEnd << "\",\"detail\":\"reset\"}\n";
    file.flush();
    if (!file) throw DeviceError(folder.file("journal.jsonl") + ": can't be written");
    file.close();
    detail::sync_file(folder.file("journal.jsonl"));
  }
  ::unlink(folder.file("latch.json").c_str());
  detail::sync_folder(folder.path);
}

}  // namespace slicecorr::bridge
