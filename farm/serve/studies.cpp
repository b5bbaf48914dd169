// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/studies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "programs/common/program.hpp"
#include "scans/beside.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/token.hpp"
#include "support/process/threads.hpp"
#include "views/moment_text.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;
using http::ApiError;
using Json = nlohmann::ordered_json;

namespace {

constexpr auto kLook = std::chrono::milliseconds(50);

std::string studies_folder(const FarmFolder& folder) { return folder.root + "/studies"; }

/// Studies of servers that were killed.
void remove_left_over(const std::string& folder) {
  std::error_code error;
  const auto now = fs::file_time_type::clock::now();
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const auto changed = fs::last_write_time(entry.path(), error);
    if (!error && now - changed > std::chrono::hours(24)) fs::remove_all(entry.path(), error);
  }
}

}  // namespace

std::string without_folders(std::string text, const FarmFolder& folder) {
  for (std::size_t at; (at = text.find(folder.root + "/")) != std::string::npos;) {
    std::size_t end = at + folder.root.size() + 1;
    // uploads/TOKEN/NAME and studies/TOKEN/NAME: the name is left.
    for (int i = 0; i < 2; ++i) {
      const std::size_t slash = text.find_first_of("/: \n", end);
      if (slash == std::string::npos || text[slash] != '/') break;
      end = slash + 1;
    }
    text.erase(at, end - at);
  }
  // Other whole paths, of which the last name is left.
  for (std::size_t at = 0; (at = text.find('/', at)) != std::string::npos; ++at) {
    if (at > 0 && std::string_view(" \n\"'(=").find(text[at - 1]) == std::string_view::npos)
      continue;
    const std::size_t end = std::min(text.find_first_of(" \n\"':;,)", at), text.size());
    const std::size_t last = text.rfind('/', end - 1);
    if (last > at) text.erase(at, last + 1 - at);
  }
  return text;
}

std::string program_path(const ChildRules& rules, const std::string& name) {
  if (!rules.programs.empty()) return rules.programs + "/" + name;
  return beside_this_program(name);
}

CommandLimits child_limits(const ChildRules& rules, const std::string& folder) {
  // Several threads of a program share its processor time.
  constexpr double threads = 8;
  return {rules.study_s * threads, rules.memory_bytes, rules.file_bytes, 5, folder};
}

std::string told_by(const CommandResult& result, const FarmFolder& folder) {
  if (result.timed_out) return "took too long, and was ended";
  std::string text = last_said(result);
  if (text.empty()) text = result.complaint();
  return text::printable(without_folders(text, folder));
}

Studies::Studies(const FarmFolder& folder, const ChildRules& rules)
    : folder_(folder), rules_(rules) {
  remove_left_over(studies_folder(folder_));
  threads_ = slicecorr::detail::start_threads(std::max(1, rules.studies), [this] { work(); });
}

Studies::~Studies() {
  {
    const std::scoped_lock lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (std::thread& t : threads_) t.join();
  std::error_code error;
  for (const auto& [token, study] : studies_) fs::remove_all(study->folder, error);
}

std::string Studies::start(StudyPlan plan, const std::string& by) {
  auto study = std::make_shared<Study>();
  study->plan = std::move(plan);
  study->by = by;
  study->token = random_token();
  study->folder = studies_folder(folder_) + "/" + study->token;
  {
    const std::scoped_lock lock(mutex_);
    if (static_cast<int>(waiting_.size()) >= rules_.most_waiting) {
      throw ApiError(503, "busy", "too many studies wait; try again soon");
    }
    std::error_code error;
    fs::create_directories(study->folder, error);
    if (error) throw DeviceError(study->folder + ": can't be made: " + error.message());
    studies_[study->token] = study;
    waiting_.push_back(study);
    forget_oldest();
  }
  changed_.notify_one();
  return study->token;
}

void Studies::forget_oldest() {
  while (static_cast<int>(ended_.size()) > rules_.kept) {
    std::error_code error;
    fs::remove_all(ended_.front()->folder, error);
    studies_.erase(ended_.front()->token);
    ended_.pop_front();
  }
}

void Studies::work() {
  for (;;) {
    Pointer study;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return stopping_ || !waiting_.empty(); });
      if (stopping_) return;
      study = waiting_.front();
      waiting_.pop_front();
      study->state = State::running;
      study->begin = std::chrono::steady_clock::now();
    }
    State state = State::failed;
    std::string message;
    try {
      run(*study);
      state = study->cancelled        ? State::cancelled
              : study->exit_code == 0 ? State::done
                                      : State::failed;
    } catch (const std::exception& e) {
      message = without_folders(e.what(), folder_);
    }
    const std::scoped_lock lock(mutex_);
    if (!message.empty()) study->message = message;
    study->state = state;
    study->end = std::chrono::steady_clock::now();
    ended_.push_back(study);
    forget_oldest();
  }
}

void Studies::run(Study& study) {
  for (const auto& [name, text] : study.plan.tables) {
    cli::write_text_file(study.folder + "/" + name, text);
  }
  for (const StudyStep& step : study.plan.steps) {
    std::vector<std::string> arguments = step.arguments(study.folder);
    arguments[0] = program_path(rules_, arguments[0]);
    const auto most = std::chrono::milliseconds(static_cast<std::int64_t>(1000 * rules_.study_s));
    {
      const std::scoped_lock lock(mutex_);
      study.stage = step.what;
    }
    Command command(arguments, most, {}, {}, child_limits(rules_, study.folder));
    while (!command.wait(kLook)) {
      if (stopping_ || study.cancelled) {  // the command goes, and with it its processes
        study.cancelled = true;
        return;
      }
    }
    const CommandResult& result = command.result();
    if (result.exit_code != 0) {
      const std::scoped_lock lock(mutex_);
      study.exit_code = result.exit_code > 0 ? result.exit_code : 1;
      study.message = result.exit_code < 0 && !result.timed_out && result.started
                          ? step.what + " was ended: it needed more than a study may"
                          : told_by(result, folder_);
      return;
    }
  }
  const std::scoped_lock lock(mutex_);
  study.exit_code = 0;
}

Studies::Pointer Studies::find(const std::string& token) const {
  const auto found = studies_.find(token);
  if (found == studies_.end()) {
    throw ApiError(404, "not_found", "there is no such study; they are kept for a while only");
  }
  return found->second;
}

Json Studies::state(const std::string& token) const {
  const std::scoped_lock lock(mutex_);
  const Pointer s = find(token);
  static constexpr const char* names[] = {"waiting", "running", "done", "failed", "cancelled"};
  Json json = {{"study", s->token}, {"kind", s->plan.kind}, {"state", names[int(s->state)]}};
  if (s->state == State::waiting) {
    const auto place = std::find(waiting_.begin(), waiting_.end(), s);
    json["before"] = place - waiting_.begin();
  } else {
    const bool runs = s->state == State::running;
    const auto end = runs ? std::chrono::steady_clock::now() : s->end;
    if (runs) json["stage"] = s->stage;
    json["seconds"] = std::chrono::duration<double>(end - s->begin).count();
  }
  if (s->state == State::failed) {
    json["exit_code"] = s->exit_code;
    json["message"] = s->message;
  }
  json["files"] = Json::array();
  if (s->state == State::done) {
    for (const std::string& name : s->plan.files) {
      std::error_code error;
      const auto bytes = fs::file_size(s->folder + "/" + name, error);
      if (!error) json["files"].push_back({{"name", name}, {"bytes", bytes}});
    }
  }
  return json;
}

void Studies::cancel(const std::string& token, const Asker& asker) {
  const std::scoped_lock lock(mutex_);
  const Pointer s = find(token);
  if (asker.role < Role::operate && asker.name != s->by) {
    throw ApiError(403, "role", "the study is somebody else's");
  }
  if (s->state != State::waiting && s->state != State::running) {
    throw ApiError(409, "too_late", "the study has ended");
  }
  s->cancelled = true;
  if (s->state == State::waiting) {
    std::erase(waiting_, s);
    s->state = State::cancelled;
    s->begin = s->end = std::chrono::steady_clock::now();
    ended_.push_back(s);
  }
}

std::string Studies::path_of(const std::string& token, const std::string& name) const {
  const std::scoped_lock lock(mutex_);
  const Pointer s = find(token);
  if (s->state != State::done) throw ApiError(409, "state", "the study is not done");
  return s->folder + "/" + name;
}

std::string Studies::file(const std::string& token, const std::string& name) const {
  std::string path = path_of(token, name);
  const std::scoped_lock lock(mutex_);
  const auto& files = find(token)->plan.files;
  if (std::find(files.begin(), files.end(), name) == files.end()) {
    throw ApiError(404, "not_found", "the study has no such file");
  }
  return path;
}

std::string Studies::layers(const std::string& token) const { return path_of(token, "layers.bin"); }

std::pair<std::string, std::string> Studies::fitted(const std::string& token) const {
  std::string name;
  {
    const std::scoped_lock lock(mutex_);
    name = find(token)->plan.name;
  }
  if (name.empty()) throw ApiError(409, "state", "the study is no fit");
  return {path_of(token, name + ".toml"), name};
}

}  // namespace slicecorr::farm::detail
