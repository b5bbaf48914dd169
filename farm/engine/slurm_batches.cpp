// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The folder store/slurm: which task of which array is which attempt.

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "engine/slurm_tasks.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/token.hpp"
#include "support/files/lasting_folder.hpp"
#include "support/files/temporary.hpp"
#include "support/files/text_file.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;

namespace {

bool is_token(const std::string& text) {
  return !text.empty() && text.size() <= 64 && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
  });
}

void write_whole(const std::string& path, const std::string& text) {
  slicecorr::detail::Temporary part{slicecorr::detail::make_temporary(path)};
  {
    std::ofstream out(part.path, std::ios::binary);
    out << text << "\n";
    out.close();
    if (!out) throw DeviceError(path + ": can't be written");
  }
  slicecorr::detail::put_in_place(part, path);
}

std::optional<Batch> read_batch(const std::string& folder, const std::string& token) {
  if (!is_token(token)) return std::nullopt;
  const auto json =
      slicecorr::detail::try_json(text_of_file(folder + "/" + token + "/batch.json").value_or(""));
  if (!json.is_object() || !json.contains("tasks") || !json["tasks"].is_array()) {
    return std::nullopt;
  }
  Batch batch;
  batch.token = token;
  for (const auto& task : json["tasks"]) {
    if (!task.is_string() || !is_token(task.get<std::string>())) return std::nullopt;
    batch.tasks.push_back(task.get<std::string>());
  }
  return batch;
}

/// What a folder knows of its attempts: a batch that was not written to its end has links to their
/// logs only.
std::vector<std::string> tasks_in(const std::string& folder, const std::string& token) {
  if (auto batch = read_batch(folder, token)) return std::move(batch->tasks);
  std::vector<std::string> tasks;
  std::error_code error;
  for (fs::directory_iterator it(folder + "/" + token, error), end; !error && it != end;
       it.increment(error)) {
    std::error_code no_link;
    const fs::path log = fs::read_symlink(it->path(), no_link);
    if (!no_link) tasks.push_back(log.parent_path().filename().string());
  }
  return tasks;
}

/// Whether a folder is so new that it may be about to be filled.
bool is_young(const fs::path& folder) {
  std::error_code error;
  const auto changed = fs::last_write_time(folder, error);
  return error || fs::file_time_type::clock::now() - changed < std::chrono::hours(1);
}

}  // namespace

BatchFolder::BatchFolder(std::string store) : store_(std::move(store)), folder_(store_ + "/slurm") {
  std::error_code error;
  slicecorr::detail::make_lasting_folder(folder_);
  const std::string path = folder_ + "/farm.id";
  const auto read = [&] {
    std::ifstream in(path);
    std::getline(in, farm_);
    return is_token(farm_);
  };
  if (read()) return;
  // Of two services that start at the same time, the first to link gives the name.
  const std::string part = slicecorr::detail::make_temporary(path);
  const slicecorr::detail::Temporary guard{part};
  std::ofstream(part) << random_token() << "\n";
  slicecorr::detail::sync_file(part);
  fs::create_hard_link(part, path, error);
  if (error && error != std::errc::file_exists) fs::copy_file(part, path, error);
  slicecorr::detail::sync_folder(folder_);
  if (!read()) throw DeviceError(path + ": can't be made, or is damaged");
}

void BatchFolder::write(const Batch& batch) const {
  const std::string folder = path(batch.token);
  std::error_code error;
  fs::create_directory(folder, error);
  if (error) throw DeviceError(folder + ": can't be made: " + error.message());
  for (std::size_t i = 0; i < batch.tasks.size(); ++i) {
    // What Slurm itself has to say comes into the attempt's log, and is lost with the attempt.
    fs::create_symlink(fmt::format("../../attempts/{}/log.txt", batch.tasks[i]),
                       fmt::format("{}/{}.txt", folder, i), error);
    if (error) throw DeviceError(folder + ": no links can be made: " + error.message());
  }
  write_whole(folder + "/batch.json", nlohmann::json{{"tasks", batch.tasks}}.dump());
  slicecorr::detail::sync_folder(folder);
  slicecorr::detail::sync_folder(folder_);
}

std::optional<Batch> BatchFolder::read(const std::string& token) const {
  return read_batch(folder_, token);
}

std::vector<Batch> BatchFolder::read_all() const {
  std::vector<Batch> list;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    if (auto batch = read(entry.path().filename().string())) list.push_back(std::move(*batch));
  }
  return list;
}

void BatchFolder::remove(const std::string& token) const {
  if (!is_token(token)) return;
  std::error_code error;
  fs::remove_all(path(token), error);
}

bool BatchFolder::has_attempt(const std::string& token) const {
  std::error_code error;
  const bool there = fs::exists(store_ + "/attempts/" + token, error);
  // When the file system does not answer, nothing is said.
  return there || error;
}

bool BatchFolder::has_ended(const std::string& token) const {
  const std::vector<std::string> tasks = tasks_in(folder_, token);
  return !tasks.empty() && std::none_of(tasks.begin(), tasks.end(),
                                        [this](const std::string& t) { return has_attempt(t); });
}

std::vector<std::string> ended_batch_folders(
    const std::string& store, const std::function<bool(const std::string& token)>& is_open) {
  const std::string folder = store + "/slurm";
  std::vector<std::string> list;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string token = it->path().filename().string();
    if (!is_token(token)) continue;
    const std::vector<std::string> tasks = tasks_in(folder, token);
    const bool needed =
        tasks.empty() ? is_young(it->path()) : std::any_of(tasks.begin(), tasks.end(), is_open);
    if (!needed) list.push_back(it->path());
  }
  return list;
}

}  // namespace slicecorr::farm::detail
