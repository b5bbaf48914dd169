// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "submit/pass_over.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "slicecorr/misfit.hpp"
#include "submit/fields.hpp"

namespace slicecorr::farm::detail {

namespace {

/// Whether a message has `key` as a word.
bool names(const std::string& message, const std::string& key) {
  const auto is_part = [](char c) {
    return c == '_' || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
  };
  for (std::size_t at = message.find(key); at != message.npos; at = message.find(key, at + 1)) {
    const std::size_t end = at + key.size();
    if ((at == 0 || !is_part(message[at - 1])) && (end == message.size() || !is_part(message[end])))
      return true;
  }
  return false;
}

}  // namespace

bool pass_over(JobRequest& request, const std::string& key, const std::string& why) {
  const auto said = request.said.find(key);
  if (said == request.said.end() || !said->second.default_) return false;
  request.passed_over[key] = {said->second.where, why};
  request.said.erase(said);
  unset_field(request, key);
  return true;
}

Setup resolve_passing_over(JobRequest& request,
                           const std::function<Setup(const JobRequest&)>& resolve) {
  for (;;) {
    try {
      return resolve(request);
    } catch (const MisfitError& e) {
      const std::string why = e.what();
      const auto& keys = e.settings();
      if (!std::any_of(keys.begin(), keys.end(),
                       [&](const std::string& key) { return pass_over(request, key, why); })) {
        throw;
      }
    }
  }
}

std::string with_defaults_named(const JobRequest& request, std::string message) {
  if (request.as_options) return message;
  std::string more;
  for (const auto& [key, said] : request.said) {
    if (!said.default_ || said.where == request.where || !names(message, key)) continue;
    more += fmt::format("{}{} is a default, {}", more.empty() ? "" : "; ", key, said.where);
  }
  return more.empty() ? message : fmt::format("{} ({})", message, more);
}

void check_defaults(const std::vector<JobRequest>& requests, std::vector<SubmitError>& errors) {
  /// Whether a default fits one of the requests, else why not, and the request that it did not fit.
  struct Default {
    bool fits = false;
    std::string why;
    std::ptrdiff_t index = 0;
  };
  std::map<std::pair<std::string, std::string>, Default> defaults;  // by place and key
  for (const JobRequest& r : requests) {
    const JobKind kind = kind_of(r);
    const std::ptrdiff_t index = &r - requests.data();
    for (const auto& [key, said] : r.said) {
      if (!said.default_) continue;
      std::string why = misfit(key, key, kind);
      Default& d = defaults[{said.where, key}];
      d = {d.fits || why.empty(), std::move(why), index};
    }
    for (const auto& [key, left_out] : r.passed_over) {
      Default& d = defaults[{left_out.where, key}];
      d = {d.fits, left_out.message, index};
    }
  }
  for (const auto& [place, d] : defaults) {
    if (!d.fits) errors.push_back({place.first, d.why, Reason::bad_input, d.index});
  }
}

void for_each_sound(std::vector<JobRequest>& requests, std::vector<SubmitError>& errors,
                    const std::function<void(JobRequest&)>& work) {
  std::set<std::ptrdiff_t> refused;
  for (const SubmitError& e : errors) refused.insert(e.request);
  for (JobRequest& r : requests) {
    const std::ptrdiff_t index = &r - requests.data();
    if (refused.contains(index)) continue;
    const auto refuse = [&](const std::string& why, Reason reason) {
      errors.push_back({r.where, with_defaults_named(r, why), reason, index});
    };
    try {
      work(r);
    } catch (const Cancelled&) {
      throw;
    } catch (const InfeasibleError& e) {
      refuse(e.what(), Reason::infeasible);
    } catch (const Error& e) {
      refuse(e.what(), Reason::bad_input);
    }
  }
}

}  // namespace slicecorr::farm::detail
