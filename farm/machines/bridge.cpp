// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Machines that printbridge drives: what is sent stays on this computer, and a print is a program of its
// own that goes on when the farm ends.

#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <filesystem>
#include <thread>

#include "machines/adapters.hpp"
#include "machines/detached.hpp"
#include "machines/json_answers.hpp"
#include "slicecorr/error.hpp"
#include "support/files/lasting_folder.hpp"
#include "support/files/temporary.hpp"
#include "support/process/command.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;

namespace {

/// The program beside this one, else the one of $PATH.
std::string beside_us(const std::string& name) {
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  const fs::path beside = self.parent_path() / name;
  return !error && ::access(beside.c_str(), X_OK) == 0 ? beside.string() : name;
}

class Bridge final : public MachineAdapter {
 public:
  Bridge(const MachineSpec& machine, const MachineTimes& times)
      : machine_(machine), times_(times), program_(beside_us("printbridge")) {}

  MachineFacts facts() override {
    MachineFacts facts;
    facts.model = machine_.printer;
    return facts;
  }

  MachineStatus status() override {
    const CommandResult result = run("status", {"--json", "-"}, machine_.status_options);
    const Json json = slicecorr::detail::try_json<Json>(result.out, kAnswerBounds);
    if (!json.is_object()) throw DeviceError(machine_.name + ": " + result.complaint());
    MachineStatus s;
    const std::string phase = text_in(json, "phase");
    const bool running = slicecorr::detail::flag_in(json, "running");
    const std::string fault = text_in(json, "fault");
    if (!fault.empty() && fault != "none") s.trouble = fault + ": " + shown_text(json, "detail");
    if (!running) {
      s.state = phase == "done"              ? MachineState::finished
                : fault == "stopped_by_user" ? MachineState::stopped
                : !s.trouble.empty()         ? MachineState::failed
                                             : MachineState::idle;
      return s;
    }
    s.state = phase == "pausing"    ? MachineState::pausing
              : phase == "paused"   ? MachineState::paused
              : phase == "resuming" ? MachineState::resuming
              : phase == "stopping" ? MachineState::stopping
                                    : MachineState::printing;
    s.phase = shown_text(json, "phase");
    const auto frame = number_in(json, "frame"), frames = number_in(json, "frames");
    if (frame && *frame >= 0) s.layer = static_cast<int>(*frame);
    if (frames && *frames > 0) s.layers = static_cast<int>(*frames);
    if (const auto left = number_in(json, "left_s"); left && *left >= 0) s.left_s = *left;
    s.file = fs::path(shown_text(json, "stack")).filename().string();
    return s;
  }

  std::string upload(const MachineFile& file, const UploadProgress& progress) override {
    std::error_code error;
    slicecorr::detail::make_lasting_folder(folder());
    const std::string to = folder() + "/" + file.name;
    slicecorr::detail::Temporary part{slicecorr::detail::make_temporary(to)};
    fs::copy_file(file.path, part.path, fs::copy_options::overwrite_existing, error);
    if (error) throw DeviceError(to + ": can't be written: " + error.message());
    slicecorr::detail::put_in_place(part, to);
    if (progress) progress(file.bytes, file.bytes);
    return file.name;
  }

  std::optional<HeldFile> holds(const std::string& name) override {
    std::error_code error;
    const auto bytes = fs::file_size(folder() + "/" + name, error);
    if (error) return std::nullopt;
    return HeldFile{static_cast<std::int64_t>(bytes)};
  }

  bool start(const std::string& name) override {
    std::vector<std::string> command{program_,    "print",          folder() + "/" + name,
                                     "--printer", machine_.printer, "--machine-is-clear"};
    command.insert(command.end(), machine_.options.begin(), machine_.options.end());
    const pid_t pid = start_detached(command, folder() + "/print.log");
    if (pid < 0) throw InputError(machine_.name + ": printbridge can't be started");
    // Where this process lives longer than the print, nothing of it stays.
    std::thread([pid] {
      while (::waitpid(pid, nullptr, 0) < 0 && errno == EINTR) {
      }
    }).detach();
    return true;
  }
  void pause() override { act("pause"); }
  void resume() override { act("resume"); }
  void stop() override { act("stop"); }

 private:
  const std::string& folder() const { return machine_.files_folder; }
  CommandResult run(const char* what, const std::vector<std::string>& more,
                    const std::vector<std::string>& options) const {
    std::vector<std::string> command{program_, what, "--printer", machine_.printer};
    command.insert(command.end(), more.begin(), more.end());
    command.insert(command.end(), options.begin(), options.end());
    return run_command(command,
                       std::chrono::milliseconds(static_cast<long>(times_.answer_s * 1000)));
  }
  void act(const char* what) const {
    const CommandResult result = run(what, {}, machine_.status_options);
    if (!result.ok()) throw InputError(machine_.name + ": " + result.complaint());
  }

  MachineSpec machine_;
  MachineTimes times_;
  std::string program_;
};

}  // namespace

std::unique_ptr<MachineAdapter> make_bridge(const MachineSpec& machine, const MachineTimes& times) {
  return std::make_unique<Bridge>(machine, times);
}

}  // namespace slicecorr::farm::detail
