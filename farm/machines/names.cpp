// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// States in words, and the names and hashes of files that are sent.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "machines/digest.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/machines.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/sha256.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::farm {

const char* name_of(MachineState state) {
  constexpr const char* names[] = {"unknown",  "idle",     "uploading", "checking", "busy",
                                   "starting", "printing", "pausing",   "paused",   "resuming",
                                   "stopping", "stopped",  "finished",  "failed"};
  return names[static_cast<int>(state)];
}

bool is_print(MachineState state) {
  return state >= MachineState::starting && state <= MachineState::stopping;
}

bool is_at_rest(MachineState state) {
  return state == MachineState::idle || state == MachineState::stopped ||
         state == MachineState::finished;
}

std::string sent_name(const std::string& real_name, const std::string& sha256, int again) {
  constexpr std::size_t most = 64;
  const std::size_t dot = real_name.rfind('.');
  const bool has_ending = dot != real_name.npos && dot > 0 && real_name.size() - dot <= 13;
  const auto cleaned = [](const std::string& text) {
    std::string out;
    bool in_letter = false;  // in the bytes of a letter that is not of ASCII
    for (const char c : text) {
      const bool more = (static_cast<unsigned char>(c) & 0xC0U) == 0x80;
      if (more && in_letter) continue;
      in_letter = (static_cast<unsigned char>(c) & 0x80U) != 0;
      const char small = lower_case(c);
      const bool plain =
          (small >= 'a' && small <= 'z') || is_digit(c) || c == '.' || c == '_' || c == '-';
      out += plain ? c : '_';
    }
    return out;
  };
  std::string stem = cleaned(has_ending ? real_name.substr(0, dot) : real_name);
  const std::string ending = has_ending ? lower_case(cleaned(real_name.substr(dot))) : "";
  if (!stem.empty() && (stem[0] == '.' || stem[0] == '-')) stem[0] = '_';
  if (stem.empty()) stem = "_";
  const std::string tail = "-" + sha256.substr(0, 4) +
                           (again > 0 ? fmt::format("-{}", again + 1) : std::string()) + ending;
  stem.resize(std::min(stem.size(), most - tail.size()));
  return stem + tail;
}

std::string stack_for(const MachineSpec& machine, const Job& job) {
  std::string path = stack_of(job);
  if (!machine.printer.empty() && machine.printer != job.printer) {
    throw InputError(fmt::format("job {} is for the printer {}, the machine {} is a {}", job.id,
                                 job.printer, machine.name, machine.printer));
  }
  return path;
}

MachineFile machine_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(slicecorr::detail::errno_message(path, "can't be read"));
  std::string buffer(std::size_t{1} << 20, '\0');
  cli::Sha256 sha;
  detail::Md5 md5;
  MachineFile file;
  while (in) {
    in.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    const auto size = static_cast<std::size_t>(in.gcount());
    sha.add(buffer.data(), size);
    md5.add(buffer.data(), size);
    file.bytes += static_cast<std::int64_t>(size);
  }
  if (!in.eof()) throw InputError(path, "", "can't be read");
  if (file.bytes == 0) throw InputError(path, "", "is empty; a machine takes no empty file");
  file.path = path;
  file.real_name = std::filesystem::path(path).filename().string();
  file.sha256 = sha.hex();
  file.md5 = md5.hex();
  file.name = sent_name(file.real_name, file.sha256);
  return file;
}

}  // namespace slicecorr::farm
