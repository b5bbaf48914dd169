// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Jobs files: TOML, CSV, and JSON for the REST API.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "submit/fields.hpp"
#include "support/json/read_json.hpp"
#include "support/text/csv.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using detail::set_field;
using detail::Value;

namespace {

std::string joined(const std::vector<SubmitError>& errors) {
  std::string text;
  for (const SubmitError& e : errors) {
    text += (text.empty() ? "" : "\n") + e.where + ": " + e.message;
  }
  return text;
}

std::string line_text(const std::string& source, std::int64_t line) {
  return fmt::format("{}: line {}", source, line);
}

/// A value of TOML; nothing when it is of a kind that no key takes.
std::optional<Value> value_of(const toml::node& node, const std::string& source) {
  Value v;
  v.where = line_text(source, node.source().begin.line);
  if (const auto s = node.value_exact<std::string>()) {
    v.value = *s;
  } else if (node.is_number()) {
    v.value = *node.value<double>();
  } else if (const auto b = node.value_exact<bool>()) {
    v.value = *b;
  } else if (const toml::array* list = node.as_array()) {
    std::vector<double> numbers;
    std::vector<std::string> words;
    for (const toml::node& item : *list) {
      if (item.is_number()) numbers.push_back(*item.value<double>());
      if (item.is_string()) words.push_back(*item.value<std::string>());
    }
    if (numbers.size() == list->size() && !numbers.empty()) {
      v.value = numbers;
    } else if (words.size() == list->size()) {
      v.value = words;
    } else {
      return std::nullopt;
    }
  } else {
    return std::nullopt;
  }
  return v;
}

void set_table(JobRequest& request, const toml::table& table, const std::string& source,
               std::vector<SubmitError>& errors) {
  for (const auto& [key, node] : table) {
    const std::string name(key.str());
    const std::string where = line_text(source, key.source().begin.line);
    auto value = value_of(node, source);
    if (!value) {
      errors.push_back({where, name + " is neither text, number nor a list of one of them"});
      continue;
    }
    value->where = where;
    if (const std::string error = set_field(request, name, *value); !error.empty()) {
      errors.push_back({where, error});
    }
  }
}

std::vector<CsvRow> csv_rows(const std::string& text, const std::string& source) {
  CsvReader reader = CsvReader::of_text(text, source, {.lines_in_quotes = true});
  std::vector<CsvRow> rows;
  for (CsvRow row; reader.next(row);) rows.push_back(std::move(row));
  return rows;
}

/// What is wrong with how a row is written; empty where nothing is.
const char* fault_text(const CsvRow& row) {
  switch (row.fault) {
    case CsvRow::Fault::open_quote:
      return "a quoted field has no end";
    case CsvRow::Fault::text_after_quote:
      return "text after a quoted field";
    default:
      return "";
  }
}

/// What a file has of jobs, also of those that something is wrong with, and all that is; errors of a single
/// job have its index.
struct Parsed {
  std::vector<JobRequest> requests;
  std::vector<SubmitError> errors;

  void add(JobRequest request) { requests.push_back(std::move(request)); }
  /// What was found since there were `before` errors is of the request that comes next.
  void belongs_to_next(std::size_t before) {
    for (std::size_t i = before; i < errors.size(); ++i) errors[i].request = std::ssize(requests);
  }
};

std::vector<JobRequest> sound(Parsed parsed) {
  if (!parsed.errors.empty()) throw SubmitErrors(std::move(parsed.errors));
  return std::move(parsed.requests);
}

/// A text that can't be read at all is wrong in one way.
template <class Read>
auto all_of(const std::string& source, const Read& read) {
  try {
    return read();
  } catch (const InputError& e) {
    std::string what = e.what();
    if (what.starts_with(source + ": ")) what.erase(0, source.size() + 2);
    throw SubmitErrors({{source, what}});
  }
}

Parsed jobs_of_toml(const std::string& text, const std::string& source,
                    const JobRequest& defaults) {
  const toml::table root = all_of(source, [&] { return parse_toml(text, source); });
  Parsed parsed;
  auto& [requests, errors] = parsed;
  JobRequest common = defaults;
  if (const toml::node* node = root.get("defaults")) {
    if (const toml::table* table = node->as_table()) {
      set_table(common, *table, source, errors);
      detail::make_defaults(common);
    } else {
      errors.push_back({line_text(source, node->source().begin.line), "expected [defaults]"});
    }
  }
  for (const auto& [key, node] : root) {
    if (key.str() == "defaults") continue;
    const std::string where = line_text(source, key.source().begin.line);
    const toml::array* list = node.as_array();
    if (key.str() != "job" || !list || !list->is_array_of_tables()) {
      errors.push_back(
          {where, fmt::format("'{}' is not known here; expected [defaults] and [[job]]",
                              std::string(key.str()))});
      continue;
    }
    for (const toml::node& item : *list) {
      JobRequest request = common;
      request.where = line_text(source, item.source().begin.line);
      const std::size_t before = errors.size();
      set_table(request, *item.as_table(), source, errors);
      parsed.belongs_to_next(before);
      parsed.add(std::move(request));
    }
  }
  if (requests.empty() && errors.empty()) errors.push_back({source, "has no [[job]]"});
  std::stable_sort(errors.begin(), errors.end(), [](const SubmitError& a, const SubmitError& b) {
    return a.where.size() != b.where.size() ? a.where.size() < b.where.size() : a.where < b.where;
  });
  return parsed;
}

Parsed jobs_of_csv(const std::string& text, const std::string& source, const JobRequest& defaults) {
  const std::vector<CsvRow> rows = csv_rows(text, source);
  if (rows.empty()) throw SubmitErrors({{source, "is empty; expected a header row and jobs"}});
  Parsed parsed;
  auto& [requests, errors] = parsed;
  const std::vector<std::string>& header = rows[0].cells;
  const std::vector<std::string> known = detail::field_names();
  for (std::size_t i = 0; i < header.size(); ++i) {
    const std::string where = line_text(source, rows[0].line);
    if (std::find(known.begin(), known.end(), header[i]) == known.end()) {
      JobRequest scratch;
      std::string error = "column " + set_field(scratch, header[i], Value{});
      if (header[i].find_first_of(";\t") != std::string::npos) {
        error = "'" + header[i] + "' is no column; expected commas between columns";
      }
      errors.push_back({where, error});
    } else if (std::find(header.begin(), header.begin() + static_cast<std::ptrdiff_t>(i),
                         header[i]) != header.begin() + static_cast<std::ptrdiff_t>(i)) {
      errors.push_back({where, "column '" + header[i] + "' is there twice"});
    }
  }
  if (rows[0].fault != CsvRow::Fault::none) {
    errors.push_back({line_text(source, rows[0].line), fault_text(rows[0])});
  }
  if (!errors.empty()) return parsed;
  for (std::size_t n = 1; n < rows.size(); ++n) {
    const CsvRow& row = rows[n];
    JobRequest request = defaults;
    request.where = line_text(source, row.line);
    const std::size_t before = errors.size();
    if (row.fault != CsvRow::Fault::none) {
      errors.push_back({request.where, fault_text(row)});
    } else if (row.cells.size() != header.size()) {
      errors.push_back({request.where, fmt::format("has {} fields, expected {} as in the header",
                                                   row.cells.size(), header.size())});
    }
    const bool whole = errors.size() == before;
    for (std::size_t i = 0; whole && i < header.size(); ++i) {
      if (row.cells[i].empty()) continue;  // not said
      Value v{row.cells[i], true, request.where};
      if (const std::string error = set_field(request, header[i], v); !error.empty()) {
        errors.push_back({request.where, error});
      }
    }
    parsed.belongs_to_next(before);
    parsed.add(std::move(request));
  }
  if (requests.empty() && errors.empty())
    errors.push_back({source, "has no jobs below its header"});
  return parsed;
}

Parsed jobs_of_file(const std::string& path, const JobRequest& defaults) {
  const std::string text = all_of(path, [&] { return read_text_file(path); });
  const std::string folder = fs::absolute(path).parent_path().string();
  JobRequest common = defaults;
  // What the command line says is meant from where it is said.
  detail::make_paths_absolute(common, fs::current_path().string());
  detail::make_defaults(common);
  Parsed parsed =
      path.ends_with(".csv") ? jobs_of_csv(text, path, common) : jobs_of_toml(text, path, common);
  for (JobRequest& r : parsed.requests) detail::make_paths_absolute(r, folder);
  return parsed;
}

}  // namespace

SubmitErrors::SubmitErrors(std::vector<SubmitError> errors)
    : InputError(joined(errors)), errors_(std::move(errors)) {}

bool SubmitErrors::all_infeasible() const {
  return std::all_of(errors_.begin(), errors_.end(),
                     [](const SubmitError& e) { return e.reason == Reason::infeasible; });
}

std::vector<JobRequest> parse_jobs_toml(const std::string& text, const std::string& source,
                                        const JobRequest& defaults) {
  return sound(jobs_of_toml(text, source, defaults));
}

std::vector<JobRequest> parse_jobs_csv(const std::string& text, const std::string& source,
                                       const JobRequest& defaults) {
  return sound(jobs_of_csv(text, source, defaults));
}

std::vector<JobRequest> parse_jobs_json(const std::string& text, const std::string& source,
                                        const JobRequest& defaults) {
  using Json = nlohmann::json;
  /// A job has some 50 fields, most of them one value.
  constexpr slicecorr::detail::JsonBounds kBounds{std::size_t{64} << 20, 16,
                                                  100 * std::size_t{kMostJobsOfRequest}};
  const Json root = all_of(source, [&] {
    return slicecorr::detail::read_json(text, {source, ""}, kBounds);
  });
  std::vector<SubmitError> errors;
  const auto set_object = [&](JobRequest& request, const Json& object, const std::string& where) {
    for (const auto& [key, item] : object.items()) {
      Value v;
      v.where = where;
      if (item.is_string()) {
        v.value = item.get<std::string>();
      } else if (item.is_number()) {
        v.value = item.get<double>();
      } else if (item.is_boolean()) {
        v.value = item.get<bool>();
      } else if (item.is_array() && !item.empty() &&
                 std::all_of(item.begin(), item.end(),
                             [](const Json& j) { return j.is_number(); })) {
        v.value = item.get<std::vector<double>>();
      } else if (item.is_array() && std::all_of(item.begin(), item.end(),
                                                [](const Json& j) { return j.is_string(); })) {
        v.value = item.get<std::vector<std::string>>();
      } else {
        errors.push_back({where, key + " is neither text, number nor a list of one of them"});
        continue;
      }
      if (const std::string error = set_field(request, key, v); !error.empty()) {
        errors.push_back({where, error});
      }
    }
  };
  std::vector<JobRequest> requests;
  JobRequest common = defaults;
  if (!root.is_object() || !root.contains("jobs") || !root.at("jobs").is_array() ||
      root.at("jobs").empty()) {
    throw SubmitErrors({{source, "expected {\"jobs\": [{...}, ...]}"}});
  }
  for (const auto& [key, item] : root.items()) {
    if (key == "defaults" && item.is_object()) {
      set_object(common, item, source + ": defaults");
      detail::make_defaults(common);
    } else if (key != "jobs") {
      errors.push_back({source, "'" + key + "' is not known here; expected defaults and jobs"});
    }
  }
  const auto too_many = [&](std::size_t jobs) {
    return SubmitErrors({{source, fmt::format("has {} jobs, copies counted; expected at most {}",
                                              jobs, kMostJobsOfRequest)}});
  };
  if (root.at("jobs").size() > kMostJobsOfRequest) throw too_many(root.at("jobs").size());
  int n = 0;
  std::size_t jobs = 0, numbers = 0;
  for (const Json& item : root.at("jobs")) {
    if (errors.size() >= kMostErrorsTold) break;
    JobRequest request = common;
    request.where = fmt::format("{}: job {}", source, ++n);
    if (item.is_object()) {
      set_object(request, item, request.where);
    } else {
      errors.push_back({request.where, "is no object"});
    }
    const auto copies = static_cast<std::size_t>(std::max(1, request.copies));
    jobs += copies;
    numbers +=
        copies * (request.setup.slice_speed_mm_h.size() + request.setup.layer_exposure_s.size());
    if (numbers > kMostNumbersOfRequest) {
      throw SubmitErrors({{source, fmt::format("has lists of more than {} numbers, copies counted",
                                               kMostNumbersOfRequest)}});
    }
    requests.push_back(std::move(request));
  }
  if (jobs > kMostJobsOfRequest) throw too_many(jobs);
  if (!errors.empty()) throw SubmitErrors(std::move(errors));
  return requests;
}

std::vector<JobRequest> read_jobs_file(const std::string& path, const JobRequest& defaults) {
  return sound(jobs_of_file(path, defaults));
}

std::vector<JobRequest> read_jobs_to_check(const std::string& path, const JobRequest& defaults) {
  Parsed parsed = jobs_of_file(path, defaults);
  const bool of_jobs = std::all_of(parsed.errors.begin(), parsed.errors.end(),
                                   [](const SubmitError& e) { return e.request >= 0; });
  if (!of_jobs) return sound(std::move(parsed));
  for (SubmitError& e : parsed.errors) {
    parsed.requests[static_cast<std::size_t>(e.request)].wrong.push_back(std::move(e));
  }
  return std::move(parsed.requests);
}

}  // namespace slicecorr::farm
