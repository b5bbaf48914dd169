// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Where jobs write: nothing that another one writes or reads.

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <map>
#include <set>

#include "programs/common/make_part.hpp"
#include "submit/fields.hpp"
#include "submit/resolved.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;

namespace {

/// Longest name of an output: endings, tokens and dots are added to it.
constexpr std::size_t kLongestName = 150;

std::string problem_of_name(const std::string& name) {
  if (name.empty() || name == "." || name == "..") return "is no file name";
  if (name.size() > kLongestName) return fmt::format("has more than {} bytes", kLongestName);
  for (const char c : name) {
    if (c == '/' || static_cast<unsigned char>(c) < 0x20)
      return "has a slash or a control character";
  }
  return {};
}

/// Whether files can be made in the folder, or the folder itself.
bool can_write(const std::string& folder) {
  for (fs::path at = folder;; at = at.parent_path()) {
    std::error_code error;
    const fs::file_status status = fs::status(at, error);
    if (fs::exists(status)) {
      return fs::is_directory(status) && ::access(at.c_str(), W_OK | X_OK) == 0;
    }
    if (at == at.parent_path()) return false;
  }
}

/// Without the ending of a target, or of what was left alone; as it is where it has none.
std::string without_beside(const std::string& name) {
  for (const char* ending : {cli::kTargetEnding, cli::kLeftAloneEnding}) {
    const std::string stem = std::string(ending).substr(0, std::string(ending).rfind('.'));
    if (name.ends_with(stem)) return name.substr(0, name.size() - stem.size());
  }
  return name;
}

/// The outputs of requests, as they come.
class Outputs {
 public:
  Outputs(const std::vector<JobRequest>& requests, Queue& queue, std::vector<SubmitError>& errors)
      : requests_(requests), queue_(queue), errors_(errors) {
    for (const JobRequest& r : requests) {
      for (const std::string& input : inputs_of(r)) inputs_.insert(input);
    }
  }

  void add(const JobRequest& r, const WorkSpec& spec) {
    if (const std::string problem = problem_of_name(name_of_copy(r, 1)); !problem.empty()) {
      refuse(r, fmt::format("name '{}' {}", name_of_copy(r, 1), problem));
      return;
    }
    if (r.out.empty()) return;
    const auto [known, fresh] = writable_.emplace(r.out, false);
    if (fresh) known->second = can_write(r.out);
    if (!known->second) refuse(r, fmt::format("{}: nothing can be written there", r.out));
    for (int copy = 1; copy <= r.copies; ++copy) add_copy(r, spec, name_of_copy(r, copy));
  }

 private:
  void refuse(const JobRequest& r, const std::string& why) {
    errors_.push_back({r.where, why, Reason::bad_input, &r - requests_.data()});
  }

  void add_copy(const JobRequest& r, const WorkSpec& spec, const std::string& name) {
    const std::string output = r.out + "/" + name;
    if (!written_by(r, written_, output)) return;
    std::vector<std::string> endings{spec.ending};
    if (spec.kind == "run") endings.emplace_back(cli::kTargetEnding);
    if (spec.kind == "run" && spec.left_alone > 0) endings.emplace_back(cli::kLeftAloneEnding);
    for (const std::string& ending : endings) {
      const std::string file = result_name(output, ending);
      if (inputs_.contains(file)) {
        refuse(r, fmt::format("{} is an input; expected another name or folder", file));
      } else {
        written_by(r, files_, file);
      }
    }
    // What a mesh leaves beside its stack may be what another job is called.
    std::set<std::string> others{name, without_beside(name)};
    if (spec.kind == "run") {
      for (const char* ending : {cli::kTargetEnding, cli::kLeftAloneEnding}) {
        others.insert(stem_of(result_name(name, ending)));
      }
    }
    for (const std::string& other : others) {
      const JobId id = queue_.unfinished_output(r.out, other);
      if (id == 0) continue;
      refuse(r,
             other == name
                 ? fmt::format("{} will be written by job {}, which is not finished", output, id)
                 : fmt::format("{}: job {}, which is not finished, writes {} there, and of meshes "
                               "the design is written, too; expected another name or folder",
                               output, id, other));
    }
  }

  /// Notes who writes it; false, and refused, where that is another one.
  bool written_by(const JobRequest& r, std::map<std::string, std::string>& who,
                  const std::string& what) {
    const auto [other, first] = who.emplace(what, r.where);
    if (!first) {
      refuse(r, fmt::format("{} is written by {}, too; expected another name or folder", what,
                            other->second));
    }
    return first;
  }

  const std::vector<JobRequest>& requests_;
  Queue& queue_;
  std::vector<SubmitError>& errors_;
  std::set<std::string> inputs_;
  std::map<std::string, std::string> written_,
      files_;  ///< without ending and with, to who writes it
  std::map<std::string, bool> writable_;
};

}  // namespace

std::string name_of_copy(const JobRequest& request, int copy) {
  const std::string name =
      request.name.empty() && !request.parts.empty() ? stem_of(request.parts[0]) : request.name;
  return copy == 1 ? name : fmt::format("{}-{}", name, copy);
}

void check_outputs(const std::vector<JobRequest>& requests, const std::vector<Resolved>& resolved,
                   Queue& queue, std::vector<SubmitError>& errors) {
  Outputs outputs(requests, queue, errors);
  for (std::size_t i = 0; i < requests.size(); ++i) {
    if (!requests[i].parts.empty()) outputs.add(requests[i], resolved[i].spec);
  }
}

}  // namespace slicecorr::farm::detail
